"""Decisions during a drive: Algorithm 4 and its baselines.

A `Policy` begins, observes, expects and plans, and holds the record of its drive. `Controller` is the paper's:
`references` of every class from the tree, `proposals` around all of them, one control. `methods` lists its baselines,
and `best_class` follows one class alone. `Mppi` has a tape and no reference. A `Plan` is the
decision at one state; between plans `feedback` mixes the classes' controls as the state moves.

The one package in which tree and path integral meet; it imports every other but `exact`.
"""
