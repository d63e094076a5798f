"""A grown tree as a file or as bytes: NumPy's npz without pickled objects.

A tree is of use only where it was grown: in the same free space, for the same steering. What it depends on is kept next
to it in plain words and numbers, so that another tree is refused by name. What is read is checked before kernels follow
an index, which they do blindly; a checksum tells damage that is still a tree.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import fields, is_dataclass
from io import BytesIO
from pathlib import Path
from tokenize import TokenError
from typing import Any, BinaryIO

import numpy as np

import pirrht
from pirrht.errors import OptionError
from pirrht.files import MISSING, replaced, why_unreadable
from pirrht.freespace import FreeSpace
from pirrht.geometry.obstacle import Mover
from pirrht.geometry.scene import Obstacle
from pirrht.planner import graph as g
from pirrht.planner.checks import BROKEN, Arrays, check, checksum, read_arrays
from pirrht.planner.expand import Storage
from pirrht.planner.graph import Graph, Vertices
from pirrht.planner.tree import HomologyTree
from pirrht.planner.tuning import TUNING
from pirrht.steering.steering import Steering

FORMAT, UNSIGNED = 2, 1  # the second has no checksum: trees of 0.1 and 0.2
MOVING = "moving obstacles"  # key of what a tree depends on
UNREADABLE = (
    ValueError, LookupError, TypeError, AttributeError, ArithmeticError, RuntimeError, MemoryError, SyntaxError,
    TokenError,
)  # NumPy reads headers as Python source  # fmt: skip


def save(tree: HomologyTree, file: str | Path | BinaryIO) -> None:
    """Write a tree, its source of random states included.

    Args:
        file: a path, which is replaced once the content is complete, or a binary stream.

    Raises:
        OptionError: the file cannot be written.
    """
    about = {
        "format": FORMAT,
        "version": pirrht.__version__,
        "belongs": belongings(tree.space, tree.steering) | {"limit": tree.limit, "classes": tree.classes},
        "draws": tree.draws,
        "rng": _plain(tree.rng.bit_generator.state),
    }
    arrays = {name: _used(tree.graph, name) for name in Graph._fields if name not in _DERIVED}
    arrays |= {"states": tree.states[: tree.size], "in_goal": tree.in_goal[: tree.size]}
    about = json.loads(json.dumps(about))  # as it is read again
    signed = about | {"checksum": checksum(arrays, about)}
    content = BytesIO()
    packed: dict[str, Any] = {**arrays, "about": np.array(json.dumps(signed))}
    np.savez_compressed(content, **packed)
    if isinstance(file, str | Path):
        with replaced(Path(file), "tree") as stream:
            stream.write(content.getbuffer())
    else:
        file.write(content.getbuffer())


def load(
    file: str | Path | BinaryIO,
    space: FreeSpace,
    steering: Steering,
    *,
    limit: float | None = None,
    classes: int | None = None,
) -> HomologyTree:
    """Read a tree that was grown in this space for this steering; it grows on as if it had never been written.

    Args:
        limit: H_limit [turns] that is asked for; None: whatever the tree has.
        classes: most classes per vertex that are asked for; None: whatever the tree has.

    Raises:
        OptionError: no such file, none of ours, damaged, or grown for something else; says what differs.
    """
    name = str(file) if isinstance(file, str | Path) else "the tree"
    about, arrays = _read(file, name)
    required = belongings(space, steering)
    required |= {key: value for key, value in (("limit", limit), ("classes", classes)) if value is not None}
    _check_belongs(name, about, required)
    try:
        belongs = about["belongs"]
        left_open = np.any(np.isnan(steering.roots(space.scene.goal.center)), axis=0)
        check(arrays, steering.homology(space), left_open, int(belongs["classes"]))
        limits = {"limit": float(belongs["limit"]), "classes": int(belongs["classes"])}
        tree = HomologyTree(space, steering, **limits, rng=_generator(about["rng"]))  # type: ignore[arg-type]
        tree.draws = int(about["draws"])
    except (OSError, *UNREADABLE) as error:
        raise OptionError(f"{name} is a damaged tree ({_line(error)}); make it anew with `pirrht plan`") from None
    tree.storage = _roomy(arrays)
    return tree


def belongings(space: FreeSpace, steering: Steering) -> dict[str, Any]:
    """Facts that a tree depends on besides its limits, as numbers (lengths [m]) and texts by name."""
    scene = space.scene
    moving = {MOVING: f"{len(scene.movers)} bodies, {_motions(scene.movers)}"} if scene.movers else {}
    return {
        "workspace": [*scene.lower.tolist(), *scene.upper.tolist()],
        "goal": [*scene.goal.center.tolist(), scene.goal.radius],
        "robot radius": [scene.robot_radius, *map(list, scene.waivers)] if scene.waivers else scene.robot_radius,
        "robot height": scene.robot_height,
        "obstacles": f"{len(scene.obstacles)} solids, {_digest(scene.obstacles)}",
        "obstacles to wind around": [[round(v, 9) for v in marker] for marker in space.homology.markers.tolist()],
        "motion": _described(steering),
        **moving,
    }


def _motions(movers: tuple[Mover, ...]) -> str:
    """A digest of what bodies are made of and how they move."""
    digest = hashlib.sha256()
    for mover in movers:
        motion = mover.motion
        digest.update(f"{_digest(mover.solids)} {motion.repeat} {motion.offset} ".encode() + motion.rows.tobytes())
    return digest.hexdigest()[:16]


_DERIVED = ("queue_cost", "queue_vertex", "queue_key", "refill", "waiting")  # empty between two states


def _read(file: str | Path | BinaryIO, name: str) -> tuple[dict[str, Any], Arrays]:
    try:
        with _opened(file, name) as stream:
            arrays = read_arrays(stream)
        about = json.loads(str(arrays.pop("about")))
        known, version = about["format"], about["version"]
    except (OSError, *BROKEN) as error:
        raise OptionError(f"{name} is no tree that can be read ({_line(error)}); make one with `pirrht plan`") from None
    except UNREADABLE:  # in words of NumPy's that help nobody here
        raise OptionError(f"{name} is no tree of pirrht; make one with `pirrht plan`") from None
    if known not in (FORMAT, UNSIGNED):
        raise OptionError(
            f"{name} was written by pirrht {version} in format {known}; this is {pirrht.__version__} with "
            f"format {FORMAT}: make it anew"
        )
    if known == FORMAT and about.pop("checksum", None) != checksum(arrays, about):
        raise OptionError(f"{name} is a damaged tree (its checksum is another); make it anew with `pirrht plan`")
    return about, arrays


def _opened(file: str | Path | BinaryIO, name: str) -> AbstractContextManager[BinaryIO]:
    if not isinstance(file, str | Path):
        return nullcontext(file)
    why = why_unreadable(Path(file))
    if why == MISSING:
        raise OptionError(f"{name} does not exist; make it with `pirrht plan`")
    if why is not None:
        raise OptionError(f"{name} {why}, and no tree that can be read; make one with `pirrht plan`")
    return Path(file).open("rb")


def _check_belongs(name: str, about: Mapping[str, Any], required: Mapping[str, Any]) -> None:
    belongs = about.get("belongs")
    known = belongs if isinstance(belongs, dict) else {}
    known = {MOVING if key.startswith("bodies") else key: value for key, value in known.items()}  # of earlier versions
    for what, value in required.items():
        if known.get(what) != json.loads(json.dumps(value)):
            raise OptionError(
                f"{name} was grown for another task: {what} is {known.get(what)} there and {value} here; "
                "grow a tree for this one, or ask for what it was grown for"
            )


# -- arrays ------------------------------------------------------------------------------------------------------


def _used(graph: Graph, name: str) -> Any:
    """The entries of an array that count."""
    vertices, edges, _, _, pairs = (int(v) for v in graph.size)
    array = getattr(graph, name)
    if name in ("size", "pruned"):
        return array
    if name == "edge_first":
        return array[: edges + 1]
    return array[: pairs if name in g.EDGE_PAIRS else edges if name in g.EDGES else vertices]


def _roomy(arrays: Arrays) -> Storage:
    """Copy arrays to where there is room to grow."""
    vertices, edges, _, _, pairs = (int(v) for v in arrays["size"])
    M, (_, K, C) = arrays["straight"].shape[1], arrays["marker"].shape
    graph = g.empty_graph(_room(TUNING.vertices, vertices), _room(TUNING.edges, max(edges, pairs)), K, M)
    V = len(graph.nodes)
    graph = graph._replace(marker=np.zeros((V, K, C), graph.marker.dtype), turn=np.zeros((V, K, C), graph.turn.dtype))
    for name, array in arrays.items():
        if name in Graph._fields:
            getattr(graph, name)[tuple(slice(0, length) for length in array.shape)] = array
    states, in_goal = np.zeros((V, arrays["states"].shape[1])), np.zeros(V, np.bool_)
    states[:vertices], in_goal[:vertices] = arrays["states"], arrays["in_goal"]
    return Storage(Vertices(states, in_goal), graph)


def _room(least: int, count: int) -> int:
    while least < count:
        least *= 2
    return least


# -- what is not an array ----------------------------------------------------------------------------------------


def _digest(obstacles: tuple[Obstacle, ...]) -> str:
    """A short name of a geometry; equal for equal shapes in equal places and order."""
    known = hashlib.sha256()
    for o in obstacles:
        known.update(o.kind.value.encode())
        for array in (o.size, o.position, o.rotation, o.vertices, o.faces):
            known.update(b"-" if array is None else np.ascontiguousarray(array).tobytes())
    return known.hexdigest()[:16]


def _described(steering: Steering) -> str:
    """Kind and numbers of a steering."""
    names = [f.name for f in fields(steering)] if is_dataclass(steering) else sorted(vars(steering))
    numbers = {name: getattr(steering, name) for name in names}
    plain = [f"{k}={v!r}" for k, v in numbers.items() if isinstance(v, int | float | str)]
    return f"{type(steering).__qualname__}({', '.join(plain)})"


def _plain(state: Any) -> Any:
    """The state of a bit generator as JSON has it."""
    if isinstance(state, np.ndarray):
        return {"dtype": state.dtype.str, "values": state.tolist()}
    if isinstance(state, Mapping):
        return {key: _plain(value) for key, value in state.items()}
    return int(state) if isinstance(state, np.integer) else state


def _generator(state: Mapping[str, Any]) -> np.random.Generator:
    kinds = {kind.__name__: kind for kind in (np.random.PCG64, np.random.PCG64DXSM, np.random.MT19937,
                                              np.random.Philox, np.random.SFC64)}  # fmt: skip
    bits = kinds[state["bit_generator"]]()
    bits.state = _again(state)
    return np.random.Generator(bits)


def _again(state: Any) -> Any:
    if isinstance(state, Mapping):
        if state.keys() == {"dtype", "values"}:
            return np.array(state["values"], dtype=state["dtype"])
        return {key: _again(value) for key, value in state.items()}
    return state


def _line(error: Exception) -> str:
    text = str(error).strip().splitlines()
    return text[0] if text else type(error).__name__
