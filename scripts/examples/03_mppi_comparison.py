"""Run MPPI and PI-RRHT* on the same robot with the same noise, and count who reaches the goal at what cost."""

import numpy as np

from sim.scenario import prepare

SEEDS = range(3)
for method in ("mppi", "pi-rrht"):
    costs, outcomes = [], []
    for seed in SEEDS:
        scenario = prepare("slit", given={"method": method, "noise": 0.2, "seed": seed, "vertices": 300, "period": 0.1})
        tree = scenario.grown_tree() if method == "pi-rrht" else None
        controller = scenario.driver(tree)
        for frame in scenario.drive(scenario.plant(), controller):
            last = frame
        outcomes.append(last.outcome.name)
        costs.append(last.cost)
    reached = [cost for cost, outcome in zip(costs, outcomes, strict=True) if outcome == "GOAL"]
    mean = f"{np.mean(reached):.2f}" if reached else "none"
    print(f"{method:8} reached the goal in {len(reached)} of {len(SEEDS)} runs; mean cost {mean}")
