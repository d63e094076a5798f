"""What a function computes, as a name that is the same in every process: kernels on disk are found by it.

A function of this package is named by its place, since the folder of kernels is of exactly these sources. One of
somebody else's is named by its code and by all that this refers to: numbers, arrays, numpy, and functions of that kind.
Whatever else it refers to could change unseen, so it has no name and what is made of it is not kept.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Iterable
from types import CodeType, FunctionType, ModuleType
from typing import Any
from weakref import WeakSet

import numpy as np
from numba.core.dispatcher import Dispatcher

OURS = "pirrht."
_TRUSTED = (math, np)  # modules whose functions do what they did
_PLAIN = (bool, int, float, complex, str, bytes, type(None))
named: WeakSet[Any] = WeakSet()  # kernels that have the same name in every process


def name_of(function: Callable[..., Any]) -> str:
    """Module and qualified name."""
    return f"{getattr(function, '__module__', '')}.{getattr(function, '__qualname__', repr(function))}"


def identity(function: Callable[..., Any]) -> str | None:
    """A name of a function for all processes; None if there is none."""
    parts = _parts(function, frozenset())
    return None if parts is None else hashlib.sha256("\n".join(parts).encode()).hexdigest()


def _parts(function: Callable[..., Any], above: frozenset[CodeType]) -> list[str] | None:
    code = getattr(function, "__code__", None)
    if not isinstance(function, FunctionType) or not isinstance(code, CodeType) or code in above:
        return None
    closed = [cell.cell_contents for cell in function.__closure__ or ()]
    if name_of(function).startswith(OURS):
        if any(isinstance(value, FunctionType) and not name_of(value).startswith(OURS) for value in closed):
            return None  # numba would look it up by its name alone
        return _joined(name_of(function), closed, above)
    read = [(name, function.__globals__.get(name)) for name in _names(code) if name in function.__globals__]
    return _joined(_text(code), [*closed, *(part for pair in read for part in pair)], above | {code})


def _joined(first: str, values: Iterable[Any], above: frozenset[CodeType]) -> list[str] | None:
    parts = [first]
    for value in values:
        more = _value(value, above)
        if more is None:
            return None
        parts += more
    return parts


def _value(value: Any, above: frozenset[CodeType]) -> list[str] | None:
    if isinstance(value, Dispatcher):
        return [str(value._uuid)] if value in named else None  # type: ignore[attr-defined]
    if isinstance(value, _PLAIN):
        return [repr(value)]
    if isinstance(value, np.ndarray) and value.dtype != object:
        return [str(value.dtype), repr(value.shape), hashlib.sha256(np.ascontiguousarray(value).tobytes()).hexdigest()]
    if isinstance(value, ModuleType) or getattr(value, "__module__", None) in ("math", "numpy"):
        return [name_of(value)] if value in _TRUSTED or not isinstance(value, ModuleType) else None
    if callable(value) and name_of(value).startswith(OURS):
        return [name_of(value)]
    return _parts(value, above)


def _names(code: CodeType) -> list[str]:
    """Names that code may look up, that of functions and loops within it included."""
    inner = (constant for constant in code.co_consts if isinstance(constant, CodeType))
    return sorted({*code.co_names, *(name for part in inner for name in _names(part))})


def _text(code: CodeType) -> str:
    """Everything that code does, without where it stands."""
    constants = [_text(c) if isinstance(c, CodeType) else repr(c) for c in code.co_consts]
    return repr((code.co_code.hex(), code.co_names, code.co_varnames, code.co_freevars, constants, code.co_argcount))
