"""The paper's second example through the Python API: a car that cannot turn on the spot, in clutter."""

import argparse
from pathlib import Path

import numpy as np

from pirrht import Controller, Dubins, FreeSpace, HomologyTree, Problem, Sampling, Unicycle
from sim.drive import episode
from sim.drive.executor import Executor
from sim.mjcf import load
from sim.recording.recorder import Recorder, Sinks

PERIOD = 0.1  # the plan is made anew this often [s]


def main() -> int:
    """Drive once; the exit status is 0 if the goal was reached."""
    parser = argparse.ArgumentParser(allow_abbrev=False, description=__doc__)
    parser.add_argument("--robot", default="unicycle", help="unicycle (the equation's own robot) or diffdrive (wheels)")
    parser.add_argument("--noise", type=float, default=0.03, help="b of dtheta = u/rho dt + b dw")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--record", type=Path, default=Path("wheeled_robot.rrd"))
    options = parser.parse_args()
    for_tree, for_samples, for_plant = (np.random.default_rng(s) for s in np.random.SeedSequence(options.seed).spawn(3))

    loaded = load("clutter", robot=options.robot)
    problem = Problem(dynamics=Unicycle(b=options.noise), scene=loaded.scene, R=np.eye(1), phi=1000.0)
    space = FreeSpace.of(loaded.scene)
    tree = HomologyTree(space, Dubins.of(problem), limit=0.8, rng=for_tree)
    tree.grow(2000)
    for reference in tree.references(loaded.scene.start):
        print(f"class {reference.id}: cost {reference.cost:.3f}")

    sampling = Sampling(dt=0.1, samples=300)
    controller = Controller(problem, space, tree, sampling, rng=for_samples)
    plant = Executor(loaded, problem, period=PERIOD)
    settings: dict[str, object] = {"noise": options.noise, "seed": options.seed}
    sinks = Sinks(file=options.record)
    with Recorder(loaded, tree, controller.path_integral, sinks, settings=settings) as recorder:
        for frame in episode.run(plant, controller, loaded.scene.start, for_plant, max_time=60.0):
            recorder.log(frame)

    result = frame.metrics.json()
    print(f"{result['outcome']} after {result['time']:.2f} s through class {result['executed_class']}")
    print(
        f"lambda {problem.temperature:.4f}, cost {result['cost']:.3f}, estimated value {result['value_estimate']:.3f}"
    )
    return 0 if result["outcome"] == "goal" else 1


if __name__ == "__main__":
    raise SystemExit(main())
