"""A grown tree as a file or as bytes: NumPy's npz without pickled objects, and one record in JSON.

A tree is of use only where it was grown: in the same free space, for the same steering. What it depends on is kept in
plain words and numbers, so that another tree is refused by name. Kernels follow indices blindly, so those of edges are
checked, and nodes are compared with a search over the edges. A checksum finds damage that is still a tree.
"""

from __future__ import annotations

import hashlib
import json
import zipfile
import zlib
from collections.abc import Mapping
from contextlib import nullcontext
from dataclasses import fields, is_dataclass
from io import BytesIO
from pathlib import Path
from tokenize import TokenError
from typing import Any, BinaryIO, cast

import numpy as np
from numpy.typing import NDArray

import pirrht
from pirrht.arrays import Array
from pirrht.errors import OptionError
from pirrht.freespace import FreeSpace
from pirrht.geometry.obstacle import Mover
from pirrht.geometry.scene import Obstacle
from pirrht.planner import graph as g
from pirrht.planner.chain import keys_of
from pirrht.planner.expand import restore
from pirrht.planner.graph import SIZE, Graph, Storage
from pirrht.planner.tree import HomologyTree
from pirrht.planner.tuning import TUNING
from pirrht.steering.steering import Steering
from pirrht.topology.crossings import Turns
from sim.files import MISSING, replaced, why_unreadable

Arrays = dict[str, np.ndarray[Any, Any]]

TREE_FORMAT = 3
OLD, UNSIGNED = (1, 2), 1  # with more arrays; without a checksum
# Arrays of a `Graph` that are kept: of vertices and their nodes, of edges, of the turns of these; the rest follows.
KEPT = {
    "states": "f8", "in_goal": "b1", "nodes": "i4", "cost": "f8", "key": "i8", "parent": "i4", "tail": "i4",
    "head": "i4", "edge_cost": "f8", "edge_first": "i8", "edge_marker": "i4", "edge_turn": "i2", "pruned": "i8",
}  # fmt: skip
NODES = ("cost", "key", "parent")
MOVING = "moving obstacles"  # key of what a tree depends on
BROKEN = (zipfile.BadZipFile, zlib.error, EOFError)
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
        "format": TREE_FORMAT,
        "version": pirrht.__version__,
        "belongs": belongings(tree.space, tree.steering) | {"limit": tree.limit, "classes": tree.classes},
        "draws": tree.draws,
        "rng": tree.rng.bit_generator.state,
    }
    V, E, P = (int(tree.graph.size[k]) for k in (SIZE.vertices, SIZE.edges, SIZE.pairs))
    count = dict.fromkeys(("states", "in_goal", "nodes", *NODES), V) | {"edge_first": E + 1, "pruned": 1}
    count |= {"edge_marker": P, "edge_turn": P}
    packed: Arrays = {name: np.array(getattr(tree.graph, name)[: count.get(name, E)]) for name in KEPT}
    about = json.loads(json.dumps(about, default=_plain))  # as it is read again
    packed["about"] = np.array(json.dumps(about | {"checksum": checksum(packed, about)}))
    content = BytesIO()
    np.savez_compressed(content, **packed)  # type: ignore[arg-type]
    if isinstance(file, str | Path):
        with replaced(Path(file), "tree") as stream:
            stream.write(content.getbuffer())
    else:
        file.write(content.getbuffer())


def load(
    file: str | Path | BinaryIO, space: FreeSpace, steering: Steering, *, limit: float | None = None,
    classes: int | None = None,
) -> HomologyTree:  # fmt: skip
    """Read a tree that was grown in this space for this steering; it grows on as if it had never been written.

    Args:
        limit: H_limit [turns] that is required; None: whatever the tree has.
        classes: most classes per vertex that are required; None: whatever the tree has.

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
        limits = {"limit": float(belongs["limit"]), "classes": int(belongs["classes"])}
        tree = HomologyTree(space, steering, **limits, rng=_generator(about["rng"]))  # type: ignore[arg-type]
        tree.draws = int(about["draws"])
        _check(arrays, tree, np.any(np.isnan(steering.roots(space.scene.goal.center)), axis=0))
        _restore(tree, arrays)
    except (OSError, *UNREADABLE) as error:
        raise OptionError(f"{name} is a damaged tree ({_line(error)}); make it anew with `pirrht plan`") from None
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


def _read(file: str | Path | BinaryIO, name: str) -> tuple[dict[str, Any], Arrays]:
    path = Path(file) if isinstance(file, str | Path) else None
    if path is not None and (why := why_unreadable(path)) is not None:
        if why == MISSING:
            raise OptionError(f"{name} does not exist; make it with `pirrht plan`")
        raise OptionError(f"{name} {why}, and no tree that can be read; make one with `pirrht plan`")
    try:
        with path.open("rb") if path is not None else nullcontext(cast(BinaryIO, file)) as stream:
            arrays = read_arrays(stream)
        about = json.loads(str(arrays.pop("about")))
        known, version = about["format"], about["version"]
    except (OSError, *BROKEN) as error:
        raise OptionError(f"{name} is no tree that can be read ({_line(error)}); make one with `pirrht plan`") from None
    except UNREADABLE:  # in words of NumPy's that help nobody here
        raise OptionError(f"{name} is no tree of pirrht; make one with `pirrht plan`") from None
    if known not in (TREE_FORMAT, *OLD):
        raise OptionError(
            f"{name} was written by pirrht {version} in format {known}; this is {pirrht.__version__} with "
            f"format {TREE_FORMAT}: make it anew"
        )
    if known != UNSIGNED and about.pop("checksum", None) != checksum(arrays, about):
        raise OptionError(f"{name} is a damaged tree (its checksum is another); make it anew with `pirrht plan`")
    return about, arrays


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


def read_arrays(stream: BinaryIO) -> Arrays:
    """Read the arrays of an npz file by name; an OSError or one of BROKEN or UNREADABLE if it is not one."""
    if not zipfile.is_zipfile(stream):
        raise ValueError("it is no zip file")
    with zipfile.ZipFile(stream) as archive:
        total = sum(member.file_size for member in archive.infolist())  # more is not unpacked
    if total > TUNING.file_bytes:
        raise ValueError(f"it unpacks to {total / 2**30:.3g} GB, and a tree has {TUNING.file_bytes / 2**30:g} at most")
    stream.seek(0)
    with np.load(stream, allow_pickle=False) as content:
        return dict(content)


def checksum(arrays: Mapping[str, np.ndarray[Any, Any]], about: Mapping[str, Any]) -> str:
    """SHA-256 of arrays, their names, kinds and shapes, and of a JSON record next to them."""
    digest = hashlib.sha256(json.dumps(about, sort_keys=True).encode())
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        digest.update(f"\0{name}\0{array.dtype.str}\0{array.shape}\0".encode())
        digest.update(array.tobytes())
    return digest.hexdigest()


def _check(arrays: Arrays, tree: HomologyTree, left_open: NDArray[np.bool_]) -> None:
    """Raise a ValueError unless edges are those of a tree, whose roots may have numbers `left_open` (n,)."""
    V, E, P, K = *(len(arrays[name]) for name in ("in_goal", "tail", "edge_marker")), arrays["cost"].shape[-1]
    shapes = {"states": (V, len(left_open)), "edge_first": (E + 1,), "pruned": (1,)}
    shapes |= dict.fromkeys(("in_goal", "nodes"), (V,)) | dict.fromkeys(NODES, (V, K))
    shapes |= {"edge_marker": (P,), "edge_turn": (P,)}
    for name, kind in KEPT.items():
        array = arrays[name]
        if array.shape != shapes.get(name, (E,)) or array.dtype != np.dtype(kind):
            raise ValueError(f"{name} has the shape {array.shape} of {array.dtype}")
    first = arrays["edge_first"]
    ends = {"tail": V, "head": V, "edge_marker": tree.homology.M, "edge_first": P + 1, "nodes": K + 1}
    for name, end in (ends | {"pruned": np.iinfo(np.int64).max}).items():
        if np.any((arrays[name] < 0) | (arrays[name] >= end)):
            raise ValueError(f"{name} points out of its range")
    if V < 1 or K < 1 or tree.classes not in (0, K) or first[0] != 0 or first[-1] != P or np.any(np.diff(first) < 0):
        raise ValueError("its sizes do not fit together")
    states = np.where(np.isnan(arrays["states"]) & arrays["in_goal"][:, None] & left_open, 0.0, arrays["states"])
    if not np.all(np.isfinite(states)) or not np.all((arrays["edge_cost"] >= 0.0) & (arrays["edge_cost"] < np.inf)):
        raise ValueError("its states and costs are not numbers")


def _restore(tree: HomologyTree, arrays: Arrays) -> None:
    """Give a tree the vertices and edges of arrays, search for its nodes, and take over those of the arrays."""
    V, E, P, K = *(len(arrays[name]) for name in ("states", "tail", "edge_marker")), arrays["cost"].shape[1]
    tree.storage = Storage(tree.steering.n, tree.homology.M, tree.classes)
    tree.storage.make_room(V=V, E=E, P=P, K=K)
    graph = tree.graph
    for name in KEPT.keys() - {"nodes", *NODES}:
        getattr(graph, name)[: len(arrays[name])] = arrays[name]
    graph.size[[SIZE.vertices, SIZE.edges, SIZE.pairs]] = V, E, P
    for v in range(V):
        graph.straight[v] = tree.homology.base(graph.states[v])
    turns = Turns(arrays["edge_first"], arrays["edge_marker"], arrays["edge_turn"])
    graph.edge_key[:E] = keys_of(turns, tree.homology.hash_weights)
    restore(tree.storage.places, graph.in_goal)
    tree.relax()
    tree.graph.pruned[0] = arrays["pruned"][0]
    _take_over(tree.graph, arrays)


def _near(cost: Array, other: Array) -> NDArray[np.bool_]:
    return np.asarray(np.abs(cost - other) <= TUNING.cost_rounding * (1.0 + cost))


def _take_over(graph: Graph, arrays: Arrays) -> None:
    """Take nodes in the order of a file, and of equally good parents that of the file; a ValueError if they differ."""
    V, K = arrays["key"].shape
    known, last = np.arange(K) < arrays["nodes"][:, None], np.iinfo(np.int64).max
    if not np.array_equal(graph.nodes[:V], arrays["nodes"]):
        raise ValueError("nodes and edges do not fit together")
    own, other = (np.argsort(np.where(known, keys, last), axis=1) for keys in (graph.key[:V, :K], arrays["key"]))
    source, (vertex, slot) = np.take_along_axis(own, np.argsort(other, axis=1), axis=1)[known], np.nonzero(known)
    cost, key, edge = (arrays[name][known] for name in NODES)
    if np.any((edge < g.ROOT) | (edge >= len(arrays["tail"]))):
        raise ValueError("parent points out of its range")
    equal = (key == graph.key[vertex, source]) & _near(cost, graph.cost[vertex, source])
    inner = np.flatnonzero(edge != g.ROOT)
    tail, edge, total, head = vertex[inner], edge[inner], cost[inner], arrays["head"][edge[inner]]
    with np.errstate(over="ignore"):
        above = (arrays["key"][head] == (key[inner] - graph.edge_key[edge])[:, None]) & known[head]
    begin = arrays["cost"][head, above.argmax(axis=1)]
    equal[inner] &= (arrays["tail"][edge] == tail) & above.any(axis=1) & _near(total, begin + arrays["edge_cost"][edge])
    equal[inner] &= arrays["in_goal"][head] | (begin < total)  # so that there is no circle
    if not np.all(equal) or np.any(arrays["in_goal"][tail]):
        raise ValueError("costs and parents do not fit together")
    for name in ("marker", "turn", "pairs"):
        getattr(graph, name)[vertex, slot] = getattr(graph, name)[vertex, source]
    for name in NODES:
        getattr(graph, name)[:V, :K] = arrays[name]


def _digest(obstacles: tuple[Obstacle, ...]) -> str:
    """A short name of a geometry; equal for equal shapes in equal places and order."""
    known = hashlib.sha256()
    for o in obstacles:
        known.update(o.kind.value.encode())
        for array in (o.size, o.position, o.rotation, o.vertices, o.faces):
            known.update(b"-" if array is None else np.ascontiguousarray(array).tobytes())
    return known.hexdigest()[:16]


def _motions(movers: tuple[Mover, ...]) -> str:
    """Return a digest of the solids of moving obstacles and of their motions."""
    digest = hashlib.sha256()
    for mover in movers:
        motion = mover.motion
        digest.update(f"{_digest(mover.solids)} {motion.repeat} {motion.offset} ".encode() + motion.rows.tobytes())
    return digest.hexdigest()[:16]


def _described(steering: Steering) -> str:
    """Kind and numbers of a steering."""
    names = [f.name for f in fields(steering)] if is_dataclass(steering) else sorted(vars(steering))
    numbers = {name: getattr(steering, name) for name in names}
    plain = [f"{k}={v!r}" for k, v in numbers.items() if isinstance(v, int | float | str)]
    return f"{type(steering).__qualname__}({', '.join(plain)})"


def _plain(value: Any) -> Any:
    """A part of the state of a bit generator as JSON has it."""
    return {"dtype": value.dtype.str, "values": value.tolist()} if isinstance(value, np.ndarray) else int(value)


def _generator(state: Mapping[str, Any]) -> np.random.Generator:
    kinds = {kind.__name__: kind for kind in (np.random.PCG64, np.random.PCG64DXSM, np.random.MT19937,
                                              np.random.Philox, np.random.SFC64)}  # fmt: skip
    bits = kinds[state["bit_generator"]]()
    bits.state = json.loads(
        json.dumps(state),
        object_hook=lambda value: np.array(value["values"], value["dtype"]) if "dtype" in value else value,
    )
    return np.random.Generator(bits)


def _line(error: Exception) -> str:
    text = str(error).strip().splitlines()
    return text[0] if text else type(error).__name__
