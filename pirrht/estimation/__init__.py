"""Weighted samples: psi, the value, the control, and the share of each class.

`sampler` draws a batch and weighs it; `leading` makes leads of points and wall drift, `tables` what kernels read of a
batch. `batches` draws on until an error is small enough or time is up, `weights` has the two rules that weigh samples
(the paper's average of section IV-C, and the balance heuristic) and their errors, `estimate` the result. `replay`
simulates samples again for tapes and pictures, `allocation` distributes samples among references, `sampling` has the
settings. psi of the first batch is unbiased for the chain that is sampled (sections III-A and III-B), in whose steps
walls are flat. u is a ratio and v a logarithm of psi: both are consistent, no more.

It may import `guidance`, `rollouts` and what lies below; it knows neither tree nor policy.
"""
