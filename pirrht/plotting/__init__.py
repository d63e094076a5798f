"""Pictures at the prompt, of `tree.plot()` and `plan.plot()`.

The only package of the method that imports matplotlib, of the extra `pirrht[figures]`, when something is drawn.
`ground` draws maps, `lines` trees, references and samples, on `axes`.
It takes plain values, scenes and polylines, so that trees and plans may import it.
"""
