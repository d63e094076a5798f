"""Score a controller of your own on the same noisy robot as ours, as rows of a sweep (extra `gym`)."""

import numpy as np

from sim import gym


def law(x):
    """Straight to the goal of `slit`, pulled to the middle of the slit: state (2,) -> control (2,)."""
    return np.array([1.0, 4.0 * (2.5 - x[1])])


for noise in (0.1, 0.3):
    rows = gym.score(law, scene="slit", noise=noise, seeds=range(10), method="mine")
    reached = [row["cost"] for row in rows if row["outcome"] == "goal"]
    print(f"b = {noise:g}: {len(reached)} of {len(rows)} reach the goal, mean cost {np.mean(reached or [np.nan]):.2f}")
