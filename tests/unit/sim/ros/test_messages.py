"""Messages are those of ROS: its own definitions read their bytes back, and give the same hash."""

import typing
from dataclasses import fields, is_dataclass

import numpy as np
import pytest

pytest.importorskip("cyclonedds")
pytest.importorskip("rosbags")

from rosbags.typesys import Stores, get_typestore

from sim.ros import messages

STORE = get_typestore(Stores.ROS2_JAZZY)
KINDS = [one for one in vars(messages).values() if is_dataclass(one)]


def drawn(kind, rng: np.random.Generator):
    """A value of a type, of which nothing is left as it would be by default."""
    if is_dataclass(kind):
        return kind(**{field.name: drawn(field.type, rng) for field in fields(kind)})
    if kind is str:
        return "".join(chr(c) for c in rng.integers(0x61, 0x3FF, rng.integers(1, 9)))
    if kind is bool:
        return True
    if typing.get_origin(kind) is typing.Annotated:
        note = typing.get_args(kind)[1]
        name = type(note).__name__
        if name in ("array", "sequence"):
            count = note.length if name == "array" else int(rng.integers(1, 5))
            return [drawn(note.subtype, rng) for _ in range(count)]
        return number(note, rng)
    raise AssertionError(kind)


def number(note: str, rng: np.random.Generator):
    """A number of a type such as int8 or float32, as exact as that is."""
    if note.startswith("float"):
        return np.dtype(note).type(rng.normal()).item()
    known = np.iinfo(note)
    return int(rng.integers(known.min, known.max, endpoint=True)) or 1


def same(mine, theirs, where: str) -> None:
    """Assert that all fields of a message are equal."""
    if is_dataclass(mine):
        assert [field.name for field in fields(mine)] == [name for name, _ in STORE.fielddefs[theirs.__msgtype__][1]]
        for field in fields(mine):
            same(getattr(mine, field.name), getattr(theirs, field.name), f"{where}.{field.name}")
    elif isinstance(mine, list):
        assert len(mine) == len(theirs), where
        for k, pair in enumerate(zip(mine, theirs, strict=True)):
            same(*pair, f"{where}[{k}]")
    else:
        assert mine == (theirs % 256 if where.endswith(".level") else theirs), where  # rosbags takes bytes as signed


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
@pytest.mark.parametrize("seed", range(3))
def test_ros_reads_every_field_of_a_message_as_it_was_written(kind, seed):
    message = drawn(kind, np.random.default_rng(seed))
    name = messages.ros_name(kind)
    data = message.serialize()
    theirs = STORE.deserialize_cdr(data, name)
    same(message, theirs, name)
    assert bytes(STORE.serialize_cdr(theirs, name)) == bytes(data)


def test_hashes_of_types_are_those_that_ros_computes():
    assert {messages.ros_name(kind): f"RIHS01_{one}" for kind, one in messages.HASHES.items()} == {
        messages.ros_name(kind): STORE.hash_rihs01(messages.ros_name(kind)) for kind in messages.HASHES
    }


@pytest.mark.parametrize("seconds", [0.0, 0.1, 1.999999999, 2.9999999999, 1.7e9 + 0.25, -0.5])
def test_a_time_is_a_number_of_seconds(seconds):
    time = messages.Time.of(seconds)
    assert time.seconds == pytest.approx(seconds, abs=1e-6)
    assert 0 <= time.nanosec < 10**9
