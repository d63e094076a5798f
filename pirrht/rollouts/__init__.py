"""Sample paths: rollouts around references, and their likelihood under each of these.

`backend` is the interface to the estimator, `cpu` its implementation by compiled kernels: `path` simulates any dynamics
path by path, `point_block` a point without drift many abreast, in `point_stages`; both draw the same numbers in the
same order, and so does `plain`, which judges them in plain Python. They share `tables` (inputs, outputs and tubes that
a point climbs), `first_exit` (the end of a step) and `tuning`. This is the paper's Algorithm 4, lines 5 to 13, in noise
units: with a = B_c^-1 G_c u and increments y = a dt + dw, log dQ/dP grows by a'y - a'a dt / 2. It imports `jit`,
`geometry`, `moving`, `topology`, `systems` and `problem`.
"""
