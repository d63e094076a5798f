"""Simulate one path of any dynamics at a time; the oracle of what `rollouts.point` does abreast.

`path` builds the kernel of a path from a system's compiled drift and matrices out of the parts of a step: its length,
its noise and where it leads (`step`), the controls of all references (`law`), and exits (`exits`). `kind` says for what
kernels are compiled, `scratch` holds their arrays.
"""
