"""Leads around references, the controls u(x, s) that samples follow so that few samples suffice.

`leads` has the kinds: a tape (the paper's), the climb of a way and a guide's feedback; and the `Batch` of `Proposal`s
that a sampler draws. For a point that noise moves, `ways` computes psi of one class along its shortened reference, from
one of its `sections` to the one before; `walls` has the scales of noise and cost and the wall drift, `near_walls` its
effect on the mean that estimates the control. For a car `tracking` makes guides and `ddp` optimises them. For any other
system `any_guides` makes an `any_guide` from `starts`, by the noise that is `probed`; `any_ddp` optimises it by
`forward_pass` and `backward_pass`, on the derivatives of a step from `step_map`. Both include a `clearance_cost`. No
lead biases psi: the likelihood ratio of the paper's section III-B is that of whatever was followed. The paper's section
IV-C takes the reference's own tape; ways and feedback are ours.

It may import `rollouts` for the records that kernels read, `steering` for trajectories, and what lies below.
"""
