"""Pictures with matplotlib: maps seen from above (`ground`), trees and plans on them (`prompt`).

Here and in `sim.figures` and `sim.report.plots` matplotlib is imported, of the extra `pirrht[figures]`, when a picture
is drawn. `tree.plot()` and `plan.plot()` of the method call `prompt`.
"""
