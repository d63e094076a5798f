"""The paper's first example through the Python API: plan, look at every way around, drive in MuJoCo, record."""

import argparse
from pathlib import Path

import numpy as np

from pirrht import Controller, FreeSpace, HomologyTree, Problem, Sampling, SingleIntegrator, StraightLine
from sim.drive import episode
from sim.drive.executor import Executor
from sim.mjcf import load
from sim.recording.recorder import Recorder, Sinks

PERIOD = 0.01  # the plan is made anew this often [s]


def main() -> int:
    """Drive once; the exit status is 0 if the goal was reached."""
    parser = argparse.ArgumentParser(allow_abbrev=False, description=__doc__)
    parser.add_argument("--noise", type=float, default=0.1, help="b of dx = u dt + b dw; try 0.3")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--record", type=Path, default=Path("single_integrator.rrd"))
    options = parser.parse_args()
    for_tree, for_samples, for_plant = (np.random.default_rng(s) for s in np.random.SeedSequence(options.seed).spawn(3))

    loaded = load("slit", robot="puck")
    problem = Problem(dynamics=SingleIntegrator(b=options.noise), scene=loaded.scene, R=2 * np.eye(2), q=1.0)
    space = FreeSpace.of(loaded.scene)
    tree = HomologyTree(space, StraightLine.of(problem), limit=0.6, rng=for_tree)
    tree.grow(1000)
    for reference in tree.references(loaded.scene.start[:2]):
        print(f"class {reference.id:>5}: cost {reference.cost:.3f}")

    sampling = Sampling(dt=0.1, first=PERIOD, samples=200)
    controller = Controller(problem, space, tree, sampling, rng=for_samples)
    plant = Executor(loaded, problem, period=PERIOD)
    settings: dict[str, object] = {"noise": options.noise, "seed": options.seed}
    sinks = Sinks(file=options.record)
    with Recorder(loaded, tree, controller.path_integral, sinks, settings=settings) as recorder:
        for frame in episode.run(plant, controller, loaded.scene.start, for_plant, max_time=30.0):
            recorder.log(frame)

    result = frame.metrics.json()
    print(f"{result['outcome']} after {result['time']:.2f} s through class {result['executed_class']}")
    print(
        f"lambda {problem.temperature:.3f}, cost {result['cost']:.3f}, estimated value {result['value_estimate']:.3f}"
    )
    return 0 if result["outcome"] == "goal" else 1


if __name__ == "__main__":
    raise SystemExit(main())
