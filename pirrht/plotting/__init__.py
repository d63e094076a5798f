"""Maps seen from above with matplotlib, an extra of the package (`figures`) that is imported when a map is drawn.

`strokes` makes the lines, `colors` gives classes their colours, and `maps` draws both. A map is of a scene: what knows
nothing of trees and plans is here, and these compose it, as `HomologyTree.plot` and `Plan.plot` do. Other pictures of
the project build on the same parts, so that a class has one colour in all of them.
"""
