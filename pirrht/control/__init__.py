"""Who decides during a drive: Algorithm 4 and what it is compared with.

A `Policy` begins, observes, expects and plans, and holds the record of its drive. `Controller` is the paper's:
references of every class from the tree, samples around all of them, one control; its `guides` go from plan to plan.
`methods` says what its baselines leave out, and `best_class` follows one class alone. `Mppi` has a tape and no
reference, `Optimal` the exact law. A `Plan` is what was decided at one state; between plans `feedback` mixes the
classes' controls as the state moves.

The one package in which tree and path integral meet; it may ask every other.
"""
