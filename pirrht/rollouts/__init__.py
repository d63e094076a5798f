"""Sample paths: compiled rollouts around references, and how likely each reference makes them.

`backend` picks the kernels of a problem: `general` simulates any dynamics path by path, `point` a point without drift
many abreast; both draw the same numbers in the same order. They share `records` (inputs and outputs of kernels), `ways`
(proposal controls of a point), `first_exit` and `sweep` (how a step ends), `among` and `nearby` (moving obstacles).
This is the paper's Algorithm 4, lines 5 to 13, in noise units: with a = B_c^-1 G_c u and increments y = a dt + dw, log
dQ/dP grows by a'y - a'a dt / 2. It imports `compiled`, `geometry`, `topology`, `systems` and `problem`.
"""
