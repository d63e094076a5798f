"""Two-point optima: what leads from one state to another where there are no obstacles (the paper's TPBVP).

`steering` is the interface, one file each its members: `straight_line` for the single integrator, `dubins` for the
unicycle, `rover` for two inputs, `double_integrator` for a mass, `tracked` for what has none of its own; `poses` is
what the two of arcs share. `motion` says what the tree and the shortening ask of a motion, compiled, so that a kind can
be added without a change to either; `along_arcs`, `along_priced_arcs` and `along_cubics` are such kinds. `trajectory`:
paths with the controls along them. Among bodies that move `in_time` steers in space and time for all of them, by
`along_legs`; `useful` says where and when draws are of use there.

A new system takes one file here: a `Steering` and, if its paths are no arcs, the `Motion` that they are.
It imports the geometry, the topology, the free space, the systems and the problem; of the tree it knows nothing.
"""
