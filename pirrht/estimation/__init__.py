"""Weighted samples: psi, the value, the control, and how much of it each class accounts for.

`sampler` draws a batch and weighs it; `leading` has what samples of points follow and how walls push, `tables` what
kernels read of a batch. `batches` draws on until an error is small enough or time is up, `estimate` holds what samples
say and the two rules that weigh them (the paper's average of section IV-C, and the balance heuristic), `replay`
simulates samples again for tapes and pictures, `allocation` shares samples out among references, `sampling` has the
settings, `sums` the compiled sums. psi of the first batch is unbiased for the chain that is sampled (sections III-A and
III-B): steps that take walls as flat, and the more exactly the better they fit the place. u is a ratio and v a
logarithm of it: both are consistent, no more.

It may ask `guidance`, `rollouts` and what lies below; it knows neither tree nor policy.
"""
