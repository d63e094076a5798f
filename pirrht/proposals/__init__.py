"""Proposals of importance sampling: the controls u(x, s) around references that samples follow, so that few suffice.

`proposal` has the interface, the open-loop control sequence (paper, section IV-C) and the batch that a sampler draws. A
point among static obstacles ascends the desirability of its class, which `desirability_tube` computes from one
cross-section of a reference to the one before. Any other system follows a `guide`, which `guidance` makes: `ddp`
optimises it by `forward_pass` and `backward_pass`, with a clearance cost (`walls`). `wall_drift` corrects the mean that
estimates the control. `tuning` has the tuned numbers. No proposal biases psi: weights divide by the likelihood of
whatever was followed (section III-B).

It may import `rollouts` for the records that kernels read, `steering` for trajectories, and what lies below.
"""
