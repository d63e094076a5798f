"""Plan in front of and behind a disc that crosses, at several times of the run."""

import numpy as np

from sim.scenario import prepare

scenario = prepare("crossing", given={"vertices": 300, "samples": 100})
controller = scenario.driver(scenario.grown_tree())
controller.begin(scenario.start)
plan = controller.plan(scenario.start)
for reference in plan.references:
    share = plan.estimate.class_weights.get(reference.id, 0.0)
    print(f"class {reference.id}: cost {reference.cost:.3f}, share {share:.3f}")
(walker,) = plan.movers
for time in (0.0, 1.0, 2.0):
    x, y, _ = walker.motion.pose(time)
    print(f"{time:.0f} s: the disc is predicted at ({x:.2f}, {y:.2f})")
print(f"control {np.round(plan.control, 3)}, favourite {plan.favourite}")
