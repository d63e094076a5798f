"""Simulate paths of a point many abreast: dx = G u dt + B dw with B B' = b^2 I.

`block` advances a block of paths through the stages of a step: length, controls, noise and weights (`stages`), walls
and exits (`exits`). Each path keeps its own time, since steps fit the place. Stages are loops over lanes without
branches, in single precision, which compile to vector instructions. Chosen samples are simulated again with steps.
"""
