"""What `manifest.json` of a sweep must hold, and what its wishes add up to."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

_PARTS = {"version": str, "libraries": dict, "settings": dict, "scenes": dict, "asked": list}
_WORDS = {str: "a text", dict: "an object", list: "a list"}
MOST = 10_000_000  # seeds of a wish


def flaw(manifest: Mapping[str, Any]) -> str:
    """The first thing that is wrong with a manifest; empty if nothing is."""
    for name, kind in _PARTS.items():
        if name not in manifest:
            return f'it has no "{name}"'
        if not isinstance(manifest[name], kind):
            return f'"{name}" is not {_WORDS[kind]}'
    for name in ("scenes", "libraries"):
        if not all(isinstance(value, str) for value in manifest[name].values()):
            return f'"{name}" holds something that is no text'
    for number, wish in enumerate(manifest["asked"], start=1):
        if not _is_wish(wish):
            return f'entry {number} of "asked" is no grid of methods, noise and seeds'
    return ""


def _is_wish(wish: Any) -> bool:
    if not isinstance(wish, dict):
        return False
    methods, noise, seeds = (wish.get(name) for name in ("methods", "noise", "seeds"))
    return (
        _all(methods, str)
        and isinstance(noise, dict)
        and all(_all(values, (int, float)) for values in noise.values())
        and _is_range(seeds)
    )


def _is_range(seeds: Any) -> bool:
    return _all(seeds, int) and len(seeds) == 2 and 0 <= seeds[0] <= seeds[1] <= seeds[0] + MOST


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
    """How many different runs the wishes of a manifest add up to."""
    return len(
        {
            (scene, method, noise, seed)
            for wish in asked
            for scene, noises in wish["noise"].items()
            for noise in noises
            for method in wish["methods"]
            for seed in range(*wish["seeds"])
        }
    )
