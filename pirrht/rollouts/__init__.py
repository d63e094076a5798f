"""Sampled paths: compiled rollouts around references, and how likely each reference makes them.

`backend` picks the kernels of a problem. `general` simulates any dynamics path by path, `point` a point without drift
many abreast; both draw the same numbers in the same order, and a test holds their paths equal. What they share stands
beside them: `records` (what kernels take and give), `setup` (of a problem in its scene), `ways` and `homing` (what a
lead does inside a step), `first_exit` (how long a step may be near walls and goal, how it ends, what its survival
weighs), `sweep` (the same of steps on whose position no noise acts), `among` (what bodies that move do to a step) and
`nearby` (which of them may, for all paths at once). The paper's Algorithm 4, lines 5 to 13: Euler-Maruyama steps of
eq. 1, the path cost W of section III-A, and Girsanov's log dQ/dP of section III-B for every reference, all in noise
units: with a = B_c^-1 G_c u and the path's own increments y = a dt + dw it grows by a'y - a'a dt / 2.

It may ask `compiled`, `geometry`, `topology`, `systems` and `problem`; it knows no tree, no class by name and no
weights.
"""
