"""Decisions during a run: Algorithm 4 and its baselines.

Read `controller`, which shows the algorithm from top to bottom: `references` of every class from the tree, `proposals`
around all of them, one control, and `blocked` where there is none. `run_state` holds all that plans change, `mixture`
is the feedback between plans, `budget` the time that a plan has, `prediction` that of moving obstacles. A `Plan` is the
decision at one state, a `Policy` whatever makes plans. Baselines: `methods` lists them, `best_class` follows one class
alone, `Mppi` has a control sequence and no reference.

The one package in which tree and path integral meet; it imports every other but `exact`.
"""
