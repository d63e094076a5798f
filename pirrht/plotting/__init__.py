"""Pictures at the prompt: what `tree.plot()` and `plan.plot()` draw with.

The only room that names matplotlib, which comes with the extra `pirrht[figures]` and is imported when something is
drawn. It takes plain values, scenes and polylines, so that trees and plans may ask it; figures on paper are elsewhere.

    ground    workspace, obstacles seen from above, start and goal
    lines     trees, references, samples
    axes      where to draw, and what is missing if one cannot
"""
