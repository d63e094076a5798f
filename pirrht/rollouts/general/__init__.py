"""One sampled path of any dynamics at a time.

`path` builds the kernel that simulates a path from a system's compiled drift and matrices, under any lead and either
exit rule; `loops` weighs many of them, or simulates chosen ones again. The oracle of what `rollouts.point` does
abreast, and what every system without constant matrices or with drift uses.

It may ask what `rollouts` may.
"""
