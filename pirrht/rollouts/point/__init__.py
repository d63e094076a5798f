"""Sampled paths of a point, many abreast: dx = G u dt + B dw with B B' = b^2 I.

`block` advances a block of paths through the stages of a step: its length, noise and weights (`stages`), what leads
would have them do (`leads`), what is near, which may have ended and what the others weigh (`exits`). Each path keeps
its own time, since steps fit the place. Each stage is a loop over lanes without
branches, in single precision, which compiles to vector instructions. `replay` simulates chosen samples again.

It may ask what `rollouts` may.
"""
