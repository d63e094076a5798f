"""Weighted samples: psi, the value, the control, and the share of each class.

`assembly` puts the sampler of a problem together. `factory` makes proposal controls and wall drift, and writes batches
into the tables of a backend. `sampler` draws batches until an error is small enough or time is up, weighs them, and
simulates samples again for control sequences and pictures. `weights` has the rules that weigh samples (the paper's
average of section IV-C, and the balance heuristic) and their errors. `estimate` has the result, and distributes the
next samples among references by it. `sampling` has the settings, and the numbers that tune all this. psi of the first
batch is unbiased for the chain that is sampled (sections III-A and III-B), in whose steps walls are flat. u is a ratio
and v a logarithm of psi: both are consistent, no more.

It may import `proposals`, `rollouts` and packages below; it knows neither tree nor policy.
"""
