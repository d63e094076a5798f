"""Proposals of importance sampling: the controls u(x, s) around references that samples follow, so that few suffice.

`proposal` has the interface, the open-loop control sequence (paper, section IV-C) and the batch that a sampler draws;
`controls` those that depend on the state. A point among static obstacles ascends the desirability of its class, which
`desirability_tube` computes from one cross-section of a reference to the one before. Any other system follows a
`guide`: `guidance` makes one from an `initialisation` by the `noise_scales` of the system, and `ddp` optimises it by
`forward_pass` and `backward_pass`, with a `clearance_cost`. Near walls `half_spaces` bend the law, and `wall_drift`
corrects the mean that estimates the control. `tuning` has the tuned numbers. No proposal biases psi: weights divide by
the likelihood of whatever was followed (section III-B).

It may import `rollouts` for the records that kernels read, `steering` for trajectories, and what lies below.
"""
