"""A grown tree as a file or as bytes: NumPy's npz without pickled objects, and one record in JSON.

A tree is of use only where it was grown: in the same free space, for the same steering. What it depends on is kept in
plain words and numbers, so that another tree is refused by name. Kernels follow indices blindly, so those of edges are
checked; nodes are searched for anew over the edges. The zip's checksums find damage that is still a tree.
"""

import hashlib
import json
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

import pirrht
from pirrht.errors import OptionError, one_line
from pirrht.freespace import FreeSpace
from pirrht.geometry.obstacle import Mover
from pirrht.geometry.scene import Obstacle
from pirrht.planner.expand import restore
from pirrht.planner.graph import SIZE, Storage
from pirrht.planner.tree import HomologyTree
from pirrht.steering.chain import keys_of
from pirrht.steering.steering import Steering
from pirrht.topology.pairs import Turns
from sim.files import why_unreadable

Arrays = dict[str, np.ndarray[Any, Any]]

MOST_BYTES = 2 << 30  # of all arrays of a file together: some million vertices
TREE_FORMAT = 5  # earlier ones have more arrays, or a checksum next to those of the zip
# Arrays of a `Graph` that are kept, the rest follows: how many they are, and what their indices lie below (`_sizes`).
KEPT = {
    "states": "V", "in_goal": "V", "tail": "EV", "head": "EV", "edge_cost": "E", "edge_first": "ep",
    "edge_marker": "PM", "edge_turn": "P",
}  # fmt: skip
MOVING = "moving obstacles"  # key of what a tree depends on


def save(tree: HomologyTree, stream: BinaryIO) -> None:
    """Write a tree, its source of random states included; OptionError if that is not NumPy's default."""
    bits = tree.rng.bit_generator
    if not isinstance(bits, np.random.PCG64):
        raise OptionError(f"the tree draws from {type(bits).__name__}; trees are saved that draw from PCG64")
    about = {
        "format": TREE_FORMAT, "version": pirrht.__version__, "draws": tree.draws, "rng": bits.state,
        "belongs": belongings(tree.space, tree.steering) | {"limit": tree.limit, "classes": tree.classes},
    }  # fmt: skip
    count = _sizes(tree, *(int(tree.graph.size[k]) for k in (SIZE.vertices, SIZE.edges, SIZE.pairs)))
    packed: Arrays = {name: np.array(getattr(tree.graph, name)[: count[letters[0]]]) for name, letters in KEPT.items()}
    packed["about"] = np.array(json.dumps(about))
    np.savez_compressed(stream, **packed)  # type: ignore[arg-type]


def load(
    file: str | BinaryIO, space: FreeSpace, steering: Steering, *, limit: float | None = None,
    classes: int | None = None,
) -> HomologyTree:  # fmt: skip
    """Read a tree that was grown in this space for this steering; it grows on as if it had never been written.

    `limit` [turns] and `classes` per vertex are required of it; None: whatever the tree has. OptionError says what
    differs, or that there is no such file, none of ours, or a damaged one.
    """
    name = file if isinstance(file, str) else "the tree"
    about, arrays = _read(file, name)
    required = belongings(space, steering)
    required |= {key: value for key, value in (("limit", limit), ("classes", classes)) if value is not None}
    known = about["belongs"] if isinstance(about.get("belongs"), dict) else {}
    known = {MOVING if key.startswith("bodies") else key: value for key, value in known.items()}  # of formats 1 and 2
    for what, value in required.items():
        if known.get(what) != json.loads(json.dumps(value)):
            raise OptionError(
                f"{name} was grown for another task: {what} is {known.get(what)} there and {value} here; "
                "grow a tree for this one, or ask for what it was grown for"
            )
    try:
        bits = np.random.PCG64()
        bits.state = about["rng"]
        limits = {"limit": float(known["limit"]), "classes": int(known["classes"])}
        tree = HomologyTree(space, steering, **limits, rng=np.random.Generator(bits))  # type: ignore[arg-type]
        tree.draws = int(about["draws"])
        _restore(tree, arrays)
    except Exception as error:  # of whatever kind: a file may hold anything
        raise OptionError(f"{name} is a damaged tree ({one_line(error)}); make it anew with `pirrht plan`") from None
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
        "obstacles": f"{len(scene.obstacles)} solids, {_solids(scene.obstacles)}",
        "obstacles to wind around": [[round(v, 9) for v in marker] for marker in space.homology.markers.tolist()],
        "motion": _described(steering),
        **moving,
        **({} if scene.footprint.is_disc else {"footprint": [*scene.footprint.corners, scene.footprint.rounding]}),
    }


def _read(file: str | BinaryIO, name: str) -> tuple[dict[str, Any], Arrays]:
    if isinstance(file, str) and (why := why_unreadable(Path(file))) is not None:
        raise OptionError(f"{name} {why}; make a tree with `pirrht plan`")
    try:
        with np.load(file, mmap_mode="r", allow_pickle=False) as content:  # mapped, lest a single array be read whole
            total = sum(member.file_size for member in content.zip.infolist())  # more is not unpacked
            if total > MOST_BYTES:
                raise ValueError("it unpacks to more than a tree has")
            arrays = dict(content)
        about = json.loads(str(arrays.pop("about")))
        known = about["format"]
        version = about["version"]
    except Exception:  # of whatever kind, in words of NumPy's that help nobody here
        raise OptionError(f"{name} is no tree of pirrht; make one with `pirrht plan`") from None
    if known not in range(1, TREE_FORMAT + 1):
        raise OptionError(
            f"{name} was written by pirrht {version} in format {known}; this is {pirrht.__version__} with "
            f"format {TREE_FORMAT}: make it anew"
        )
    return about, arrays


def _sizes(tree: HomologyTree, V: int, E: int, P: int) -> dict[str, int]:
    """Numbers by the letters of KEPT: of vertices, edges and their pairs, of ends of ranges, of markers."""
    return {"V": V, "E": E, "P": P, "e": E + 1, "p": P + 1, "M": tree.homology.M}


def _restore(tree: HomologyTree, arrays: Arrays) -> None:
    """Give a tree the vertices and edges of arrays, and search for its nodes; ValueError if they are of no tree."""
    V, E, P = (len(arrays[name]) for name in ("in_goal", "tail", "edge_marker"))
    sizes = _sizes(tree, V, E, P)
    first = arrays["edge_first"]
    tree.storage = Storage(tree.steering.n, tree.homology.M, tree.classes)
    for name, letters in KEPT.items():
        array = arrays[name]
        like = getattr(tree.graph, name)

        if array.shape != (sizes[letters[0]], *like.shape[1:]) or array.dtype != like.dtype:
            raise ValueError(f"{name} has the shape {array.shape} of {array.dtype}")
        if len(letters) > 1 and np.any((array < 0) | (array >= sizes[letters[1]])):
            raise ValueError(f"{name} points out of its range")
    if V < 1 or first[0] != 0 or first[-1] != P or np.any(np.diff(first) < 0):
        raise ValueError("its sizes do not fit together")
    left_open = np.any(np.isnan(tree.steering.roots(tree.space.scene.goal.center)), axis=0)
    states = np.where(np.isnan(arrays["states"]) & arrays["in_goal"][:, None] & left_open, 0.0, arrays["states"])
    if not np.all(np.isfinite(states)) or not np.all((arrays["edge_cost"] >= 0.0) & (arrays["edge_cost"] < np.inf)):
        raise ValueError("its states and costs are not numbers")
    tree.storage.make_room(V=V, E=E, P=P)
    graph = tree.graph
    for name in KEPT:
        getattr(graph, name)[: len(arrays[name])] = arrays[name]
    graph.size[[SIZE.vertices, SIZE.edges, SIZE.pairs]] = V, E, P
    graph.straight[:V] = [tree.homology.base(x) for x in arrays["states"]]
    turns = Turns(first, arrays["edge_marker"], arrays["edge_turn"])
    graph.edge_key[:E] = keys_of(turns, tree.homology.hash_weights)
    restore(tree.storage.places, graph.in_goal)
    tree.relax()


def _digest(*parts: bytes) -> str:
    return hashlib.sha256(b"".join(parts)).hexdigest()[:16]


def _solids(obstacles: tuple[Obstacle, ...]) -> str:
    """Name a geometry; equal for equal shapes in equal places and order."""
    arrays = [(o.size, o.position, o.rotation, o.vertices, o.faces) for o in obstacles]
    texts = [[b"-" if one is None else one.tobytes() for one in known] for known in arrays]
    return _digest(*(part for o, own in zip(obstacles, texts, strict=True) for part in (o.kind.value.encode(), *own)))


def _motions(movers: tuple[Mover, ...]) -> str:
    motions = ((_solids(mover.solids), mover.motion) for mover in movers)
    return _digest(*(f"{name} {m.repeat} {m.offset} ".encode() + m.rows.tobytes() for name, m in motions))


def _described(steering: Steering) -> str:
    """Kind and numbers of a steering."""
    names = [f.name for f in fields(steering)] if is_dataclass(steering) else sorted(vars(steering))
    numbers = {name: getattr(steering, name) for name in names}
    plain = [f"{k}={v!r}" for k, v in numbers.items() if isinstance(v, int | float | str)]
    return f"{type(steering).__qualname__}({', '.join(plain)})"
