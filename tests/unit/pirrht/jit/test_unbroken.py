"""What interrupts LLVM comes a little later, but it comes."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from types import FrameType

import numpy as np
import pytest
from numba import njit
from numba.core import event

from pirrht.jit import patches


@pytest.fixture
def heard() -> Iterator[list[str]]:
    """Signals of Ctrl-C: what became of each."""
    happened: list[str] = []

    def handler(number: int, _: FrameType | None) -> None:
        happened.append("waits" if patches.waits(number) else "heeded")

    before = signal.signal(signal.SIGINT, handler)
    yield happened
    signal.signal(signal.SIGINT, before)


def test_a_signal_waits_until_the_outermost_work_is_done_and_comes_once(heard: list[str]):
    with patches.unbroken:
        with patches.unbroken:
            signal.raise_signal(signal.SIGINT)
            signal.raise_signal(signal.SIGINT)
        assert heard == ["waits", "waits"]
    assert heard == ["waits", "waits", "heeded"]


def test_a_signal_without_any_work_is_heeded_at_once(heard: list[str]):
    signal.raise_signal(signal.SIGINT)
    assert heard == ["heeded"]


class During(event.Listener):  # type: ignore[misc]
    """Interrupts a pass of the compiler when it begins."""

    def __init__(self, name: str) -> None:
        self.name = name

    def on_start(self, happening: event.Event) -> None:
        if happening.data["name"].startswith(self.name):
            signal.raise_signal(signal.SIGINT)

    def on_end(self, happening: event.Event) -> None:
        pass


@pytest.mark.parametrize(("name", "first"), [(patches.LOWERING, "waits"), ("nopython_type_inference", "heeded")])
def test_compiling_is_interrupted_before_and_after_llvm_but_not_within(heard: list[str], name: str, first: str):
    listener = During(name)
    event.register("numba:run_pass", listener)
    try:
        assert njit(lambda x: x + 1)(np.int64(1)) == 2
    finally:
        event.unregister("numba:run_pass", listener)
    assert heard[0] == first
    assert heard[-1] == "heeded"
