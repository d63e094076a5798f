"""Decisions during a run: Algorithm 4 and its baselines.

Read `controller`, which shows the algorithm from top to bottom: `references` of every class from the tree, `proposals`
around all of them, one control, and `blocked` where there is none. `run_state` holds all that plans change, `mixture`
is the feedback between plans, `prediction` that of moving obstacles. A `Plan` is the decision at one state, a `Policy`
whatever makes plans. `settings` lists methods and numbers. `baselines` follow one class
alone, or have a control sequence and no reference.

The one package in which tree and path integral meet; it imports every other but `exact`.
"""
