"""What samples follow, so that few of them tell much: leads around references.

A lead is a control u(x, s). `leads` has the three kinds, a tape (the paper's), the climb of a way and a guide's
feedback, and the `Batch` of `Proposal`s that a sampler draws. For a point that noise moves, `ways` computes psi of one
class along its taut reference: `sections` places the cross-sections, `transfer` passes psi on from each to the one
before it; `walls` has the scales of noise and cost, and how hard walls push, `near_walls` what they do to the mean that
the control now is told from. For a `car` `tracking` makes and keeps guides and `ddp` optimises them, clearances being
priced by a `barrier` (`priced` along a step, `priced_among` bodies that move). For any other system `any_guides` makes
an `any_guide`: `starts` has what it begins with, `probed` what noise does to the system, and `any_ddp` optimises a
`course` by `forward_pass` and `backward_pass`, on the derivatives of a step from `step_map`; `following` is their lead.
No lead biases psi: the likelihood ratio of the paper's section III-B is that of whatever was followed. The paper's
section IV-C takes the reference's own tape; ways and feedback are ours.

It may ask `rollouts` for the records that kernels read, `steering` for trajectories, and what lies below.
"""
