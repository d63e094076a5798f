"""Sweeps that nobody drove, for reports of them."""

from pathlib import Path

import sweep_samples

from sim.sweeps.dataset import Dataset

ASKED = {"methods": ["pi-rrht", "passive", "optimal"], "noise": {"slit": [0.1]}, "seeds": [0, 40]}
SETTINGS = {"samples": 50, "plan_seed": 0}


def record(method: str, seed: int, outcome: str | None = "goal", cost: float = 8.0, **changes) -> dict:
    known = {"scene_digest": "01", "method": method, "outcome": outcome, "cost": cost, "path_length": 4.0, "time": 5.0}
    known |= {"class_switches": seed % 2, "class_reversals": int(seed % 4 == 1), "steps": 10, "deadline_misses": 0}
    known["executed_class"] = ("0,0" if seed % 4 else "0,1") if outcome == "goal" else None
    known |= {"step_ms": {"median": 2.0, "p95": 3.0, "max": 9.0}, "plan_seconds": 1.0, "drive_seconds": 1.0}
    return sweep_samples.record(seed, **known | changes)


def stored(folder: Path, records: list[dict], asked: dict = ASKED) -> Dataset:
    dataset = Dataset(folder)
    dataset.begin(SETTINGS, dict.fromkeys(asked["noise"], "01"), asked)
    for one in records:
        dataset.add(one)
    dataset.flush()
    return dataset
