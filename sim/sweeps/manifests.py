"""Contents of a sweep's `manifest.json`, and the runs that it asks for."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

MOST = 10_000_000  # seeds of a wish
MOST_POINTS = 1_000_000  # combinations of scene, noise and method of all wishes: some hundred megabytes


def flaw(manifest: Mapping[str, Any]) -> str:
    """The first thing that is wrong with a manifest; empty if nothing is."""
    fits = {"version": _all([manifest.get("version")], str), "settings": isinstance(manifest.get("settings"), dict)}
    for name in ("scenes", "libraries"):
        texts = manifest.get(name)
        fits[name] = isinstance(texts, dict) and _all([*texts.values()], str)
    asked = manifest.get("asked")
    fits["asked"] = isinstance(asked, list) and all(map(_is_wish, asked)) and _points_of(asked) <= MOST_POINTS
    return next((f'"{name}" is not what a sweep writes' for name, fit in fits.items() if not fit), "")


def _points_of(asked: Sequence[Mapping[str, Any]]) -> int:
    return sum(len(wish["methods"]) * sum(map(len, wish["noise"].values())) for wish in asked)


def _is_wish(wish: Any) -> bool:
    if not isinstance(wish, dict) or not isinstance(wish.get("noise"), dict):
        return False
    seeds: Any = wish.get("seeds")
    return (
        _all(wish.get("methods"), str)
        and all(_all(values, (int, float)) for values in wish["noise"].values())
        and (_all(seeds, int) and len(seeds) == 2 and 0 <= seeds[0] <= seeds[1] <= seeds[0] + MOST)
    )


def _all(values: Any, kind: Any) -> bool:
    return isinstance(values, list) and all(isinstance(v, kind) and not isinstance(v, bool) for v in values)


def wishes(method: str, scene: str, noise: float, seeds: Iterable[int]) -> Iterator[dict[str, Any]]:
    """Drives of one method as entries of "asked", one per stretch of seeds."""
    known = sorted(set(seeds))
    stretch: list[int] = []
    for seed, after in zip(known, [*known[1:], None], strict=True):
        stretch.append(seed)
        if after != seed + 1:
            yield {"methods": [method], "noise": {scene: [noise]}, "seeds": [stretch[0], seed + 1]}
            stretch = []


def wished(asked: Sequence[Mapping[str, Any]]) -> int:
    """Count the different runs that the wishes of a manifest add up to."""
    stretches: dict[tuple[str, float, str], list[tuple[int, int]]] = {}
    for wish in asked:
        first, end = wish["seeds"]
        for point in _points(wish):
            stretches.setdefault(point, []).append((first, end))
    total = 0
    for known in stretches.values():
        reached = 0
        for first, end in sorted(known):
            total += max(0, end - max(first, reached))
            reached = max(reached, end)
    return total


def _points(wish: Mapping[str, Any]) -> Iterator[tuple[str, float, str]]:
    """Scene, noise and method of the runs of a wish, each combination once."""
    for scene, noises in wish["noise"].items():
        yield from ((scene, noise, method) for noise in set(noises) for method in set(wish["methods"]))
