"""Rows of a sweep that nobody drove."""

from sim.sweeps.parts import KEY, RESULTS


def record(seed: int, **changes) -> dict:
    known = dict.fromkeys(RESULTS)
    known |= {"scene": "slit", "scene_digest": "0123", "method": "pi-rrht", "noise": 0.1, "plan_seed": 0}
    known |= {"seed": seed, "outcome": "goal", "cost": 8.0 + seed, "executed_class": "0,0", "steps": 3}
    known |= {"step_ms": {"median": 1.0, "p95": 2.0, "max": 3.0}, "deadline_misses": 1, "plan_seconds": None}
    return {**known, "drive_seconds": 0.5, **changes}


def failed(seed: int) -> dict:
    return {**{name: record(seed)[name] for name in KEY}, "outcome": None, "error": "ValueError: no"}
