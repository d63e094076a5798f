"""LLVM IR that other code links, and machine code that Python calls, as libraries of numba's.

Signals wait while LLVM makes or loads machine code: an exception that breaks into that leaves it in pieces, and a crash
later.
"""

from __future__ import annotations

from _thread import interrupt_main
from collections.abc import Iterator
from contextlib import contextmanager
from signal import Signals
from typing import Any

from llvmlite import binding
from numba.core import event
from numba.core.codegen import JITCodeLibrary
from numba.core.runtime import rtsys

LOWERING = "native_lowering"  # numba's pass that hands a function to LLVM; of the largest kernel it takes some seconds
_at_work: list[str] = []  # appending and popping are atomic
_waiting: list[int] = []


def waits(number: int) -> bool:
    """Return whether a signal has to wait; then it comes again as soon as LLVM is done."""
    if _at_work:
        _waiting.append(number)
    return bool(_at_work)


@contextmanager
def unbroken(work: str) -> Iterator[None]:
    """Let signals wait during some work."""
    _begin(work)
    try:
        yield
    finally:
        _end()


def _begin(work: str) -> None:
    _at_work.append(work)


def _end() -> None:
    _at_work.pop()
    if not _at_work and _waiting:
        numbers, _waiting[:] = _waiting[-1:], []  # before it is heeded: work of another thread may make it wait again
        for number in numbers:  # none, where another thread ended its work at the same moment
            interrupt_main(Signals(number))


class _Passes(event.Listener):  # type: ignore[misc]
    def on_start(self, happening: Any) -> None:
        if _lowers(happening):
            _begin(LOWERING)

    def on_end(self, happening: Any) -> None:
        if _lowers(happening):
            _end()


def _lowers(happening: Any) -> bool:
    return str(happening.data["name"]).split(" ")[0] == LOWERING  # the function's name follows it


event.register("numba:run_pass", _Passes())


class PartLibrary(JITCodeLibrary):  # type: ignore[misc]
    """LLVM IR of one function that other code links; it never becomes machine code by itself."""

    _final_module: Any
    _shared_module: Any

    def finalize(self) -> None:
        """Link libraries of numba; other parts are named, and linked where an entry is made."""
        self._raise_if_finalized()
        self.key: str | None = None
        self.parts: list[PartLibrary] = []
        for library in dict.fromkeys(self._linking_libraries):
            self._reload_init.update(library._reload_init)
            if isinstance(library, PartLibrary):
                self.parts.append(library)
            elif library is not rtsys.library:  # every entry links that
                self._final_module.link_in(library._get_module_for_linking(), preserve=True)
        for function in list(self._final_module.functions):  # a linker keeps one of those of a name
            if not function.is_declaration and function.linkage.name == "external":
                function.linkage = "linkonce_odr"
        self._own = self._final_module
        self._finalize_dynamic_globals()
        self._finalized = True

    def restore(self, bitcode: bytes, parts: list[PartLibrary], key: str) -> None:
        """Take over code that an earlier process has kept."""
        self._final_module = self._own = binding.parse_bitcode(bitcode)
        self.parts, self.key, self._finalized = parts, key, True

    @property
    def bound(self) -> bool:
        """Return whether the code is of this process only: it holds addresses of large arrays, or nameless parts."""
        return bool(self._dynamic_globals) or any(part.key is None for part in self.parts)

    def state(self) -> tuple[str, bytes, list[str | None], list[Any]]:
        """Return name, own IR, names of parts that it links and functions that begin it, for the disk."""
        return self.name, self._own.as_bitcode(), [part.key for part in self.parts], list(self._reload_init)

    def _get_module_for_linking(self) -> Any:
        """Return the IR of this function and of all that it calls."""
        self._ensure_finalized()
        if self._shared_module is None:
            self._shared_module = self._own.clone()
            for library in _callers_first(self)[1:]:
                self._shared_module.link_in(library._own, preserve=True)
        return self._shared_module


def _callers_first(library: PartLibrary) -> list[PartLibrary]:
    """Return a part and all parts below it, each before those that it calls: a linker takes over only called code."""
    order: dict[PartLibrary, None] = {}

    def visit(one: PartLibrary) -> None:
        if one not in order:
            for part in one.parts:
                visit(part)
            order[one] = None

    visit(library)
    return list(reversed(order))


class EntryLibrary(JITCodeLibrary):  # type: ignore[misc]
    """Machine code that Python calls; on disk it leaves out the IR, since nothing links it."""

    def serialize_using_object_code(self) -> tuple[str, str, tuple[bytes, bytes]]:
        """Return name, kind of the data, machine code, and a module with the names of all definitions."""
        self._ensure_finalized()
        module = self._final_module
        functions = [f'define void @"{f.name}"() {{ ret void }}' for f in module.functions if not f.is_declaration]
        numbers = [f'@"{v.name}" = global i8 0' for v in module.global_variables if not v.is_declaration]
        names = binding.parse_assembly("\n".join([*functions, *numbers]))
        return self.name, "object", (self._get_compiled_object(), names.as_bitcode())

    def _verify_declare_only_symbols(self) -> None:
        """Refuse code that calls a function of which there is none: it would end the process."""
        lost = [f.name for f in self._final_module.functions if f.is_declaration and f.name.startswith("_ZN")]
        if lost:
            raise AssertionError(f"{self.name} calls {lost[0]}, which was not linked")
