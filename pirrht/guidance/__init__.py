"""What samples follow, so that few of them tell much: leads around references.

A lead is a control u(x, s). `leads` has the three kinds, a tape (the paper's), gates and a guide's feedback, and the
`Batch` of `Proposal`s that a sampler draws. `gates` places the gates of a taut reference, `walls` says how hard walls
push, `tracking` makes and keeps guides of a car, and `ddp` optimises them. No lead biases psi: the likelihood ratio
of the paper's section III-B is that of whatever was followed. The paper's section IV-C takes the reference's own
tape; gates, pushes and feedback are ours.

It may ask `rollouts` for the records that kernels read, `steering` for trajectories, and what lies below.
"""
