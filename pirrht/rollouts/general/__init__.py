"""One sampled path of any dynamics at a time.

`path` builds the kernel that simulates a path from a system's compiled drift and matrices, under any lead and either
exit rule, out of the parts of a step: its length and its noise (`noise`), what every reference would do (`aims`), where
it leads (`motion`), whether a path ends there (`exits`), and what that says for each reference (`ratios`). `loops`
weighs many paths, or simulates chosen ones again. The oracle of what `rollouts.point` does abreast, and what every
system without constant matrices or with drift uses.

It may ask what `rollouts` may.
"""
