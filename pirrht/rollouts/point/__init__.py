"""Sampled paths of a point, many abreast: dx = G u dt + B dw with B B' = b^2 I.

`block` advances a block of paths in lockstep through the stages of a step: noise and weights (`stages`), what leads
would have them do (`leads`), what is near and which may have ended (`exits`). Each stage is a loop over lanes without
branches, in single precision, which compiles to vector instructions. `replay` simulates chosen samples again.

It may ask what `rollouts` may.
"""
