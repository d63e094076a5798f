"""Connect two states optimally where there are no obstacles (the paper's TPBVP).

`steering` is the interface, one file each its members: `straight_line` for the single integrator and systems without
their own, `turn_and_go` for those with corners, `dubins` for the unicycle, `double_integrator` for a mass, `in_time`
among moving obstacles. `motion` has motions along arcs as kernels, and trajectories with their controls; `legs` has
those in space and time; `edges` judges motions, `tuning` has the numbers. Paths are shortened inside their class by
`polyline` where they are straight, by `relaxation` in space and time, and by `chain`, the cheapest chain of a method's
own connections, everywhere else.

A new system takes one file here: a `Steering` and, if its paths are no arcs, its `MotionKind`. It imports the geometry,
the topology, the free space, the systems and the problem, not the tree.
"""
