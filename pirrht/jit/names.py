"""Names of compiled kernels: a digest of all that a function computes, code and values, without docstrings.

It covers the bytecode of a function, the numbers, records and functions that it refers to, the types of its arguments,
compiler and processor. So an edit costs the kernels that it touches and those that call them. A function that refers
to a value that could change unseen has no name, and its code is not kept.
"""

from __future__ import annotations

import ast
import builtins
import dis
import enum
import hashlib
import math
import os
import sys
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any

import llvmlite
import numba
import numpy as np
from numba import types
from numba.core.dispatcher import Dispatcher
from numba.extending import intrinsic

HAS_DOCSTRING = 0x4000000  # of code objects, from Python 3.13 on
_TRUSTED = (math, np)  # modules whose functions do what they did
_PLAIN = (bool, int, float, complex, str, bytes, type(None), np.generic)
_Intrinsic = type(intrinsic(lambda context: None))


class Unknown(Exception):
    """A function refers to a value that could change unseen."""


def key_of(function: Callable[..., Any], kind: str, args: tuple[Any, ...], options: Any, context: Any) -> str | None:
    """Return the name on disk of compiled code for argument types; None if there is none."""
    code = identity(function)
    if code is None:
        return None
    made = (numba.__version__, llvmlite.__version__, sys.version_info[:2], context.codegen().magic_tuple(), *_makers())
    whole = repr((code, kind, [_type(one) for one in args], sorted(options.items()), made))
    name = "".join(c if c.isalnum() or c in "._" else "" for c in f"{function.__module__}.{function.__name__}")
    return f"{name[-80:]}-{hashlib.sha256(whole.encode()).hexdigest()[:32]}"


def identity(function: Callable[..., Any]) -> str | None:
    """Return a name of all that a function computes, equal in all processes; None if there is none."""
    try:
        return _of_function(getattr(function, "py_func", function), ())
    except Unknown:
        return None


_identities: dict[FunctionType, str] = {}


def _of_function(function: Any, above: tuple[Any, ...]) -> str:
    if not isinstance(function, FunctionType) or function in above:
        raise Unknown
    if function in _identities:
        return _identities[function]
    closed = [cell.cell_contents for cell in function.__closure__ or ()]
    above = (*above, function)
    values = [*closed, *(function.__defaults__ or ()), *_globals(function.__code__, function.__globals__)]
    parts = [_text(function.__code__), *(_of(value, above) for value in values)]
    _identities[function] = found = hashlib.sha256("\n".join(parts).encode()).hexdigest()
    return found


def _text(code: CodeType) -> str:
    """Return all that code does, without its place and its docstring."""
    constants = [_text(c) if isinstance(c, CodeType) else repr(c) for c in code.co_consts]
    documented = code.co_flags & HAS_DOCSTRING if sys.version_info >= (3, 13) else not code.co_name.startswith("<")
    if documented and isinstance(code.co_consts[0], str):
        constants[0] = "None"
    names = (code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars, code.co_argcount)
    return repr((code.co_code.hex(), *names, code.co_kwonlyargcount, code.co_exceptiontable.hex(), constants))


def _globals(code: CodeType, scope: dict[str, Any]) -> Iterator[Any]:
    """Yield values of the global names that code reads; of a module, the attributes that it takes."""
    steps = [step for step in dis.get_instructions(code) if step.opname != "PRECALL"]
    for i, step in enumerate(steps):
        if step.opname not in ("LOAD_GLOBAL", "LOAD_NAME"):
            continue
        if step.argval not in scope:
            if hasattr(builtins, step.argval):
                continue
            raise Unknown
        value, name = scope[step.argval], step.argval
        while isinstance(value, ModuleType) and value not in _TRUSTED:
            i += 1
            if steps[i].opname not in ("LOAD_ATTR", "LOAD_METHOD") or not hasattr(value, steps[i].argval):
                raise Unknown
            value, name = getattr(value, steps[i].argval), steps[i].argval
        yield name
        yield value
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _globals(constant, scope)


def _of(value: Any, above: tuple[Any, ...]) -> str:
    """Return a text that changes with all that kernels can read of a value."""
    if isinstance(value, _PLAIN):
        return f"{type(value).__name__} {value!r}"
    if isinstance(value, np.ndarray) and value.dtype != object:
        return f"{value.dtype} {value.shape} {hashlib.sha256(np.ascontiguousarray(value).tobytes()).hexdigest()}"
    if isinstance(value, tuple):
        record = "" if type(value) is tuple else _of_class(type(value))
        return f"{record}({','.join(_of(v, above) for v in value)})"
    if isinstance(value, slice):
        return f"slice{_of((value.start, value.stop, value.step), above)}"
    if isinstance(value, Dispatcher):
        return f"{_of_function(value.py_func, above)} {sorted(value.targetoptions.items())}"
    if isinstance(value, _Intrinsic):
        return _of_intrinsic(value, above)
    if isinstance(value, FunctionType):
        return _of_function(value, above)
    if isinstance(value, type):
        return _of_class(value)
    if isinstance(value, types.Type):
        return _type(value)
    if value in _TRUSTED or isinstance(value, np.ufunc) or getattr(value, "__module__", "") in ("math", "builtins"):
        return getattr(value, "__name__", repr(value))
    if getattr(value, "__module__", "").split(".")[0] == "numpy":
        return str(getattr(value, "__qualname__", repr(value)))
    raise Unknown


def _of_class(value: type) -> str:
    fields = getattr(value, "_fields", None)
    if fields is not None:
        return f"{value.__module__}.{value.__qualname__}{fields}"
    if issubclass(value, enum.Enum):
        return f"{value.__qualname__}{[(one.name, one.value) for one in value]}"
    if value.__module__ in ("builtins", "numpy"):
        return value.__qualname__
    raise Unknown


def _of_intrinsic(value: Any, above: tuple[Any, ...]) -> str:
    """An intrinsic writes LLVM IR itself: all code of its module counts, and what its function closes over."""
    define = value._defn
    closed = [cell.cell_contents for cell in define.__closure__ or ()]
    return f"{_code_of_module(define.__module__)} {define.__qualname__} {[_of(one, above) for one in closed]}"


@cache
def _code_of_module(name: str) -> str:
    """Return a digest of a module's code without docstrings and comments."""
    path = getattr(sys.modules[name], "__file__", None)
    if name.split(".")[0] == "numba":
        return name  # its version is in every key
    if path is None or not os.path.exists(path):
        raise Unknown
    tree = ast.parse(Path(path).read_bytes())
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(node) is not None:
            node.body[0] = ast.Pass()
    return hashlib.sha256(ast.dump(tree).encode()).hexdigest()


@cache
def _makers() -> tuple[str, ...]:
    """Return digests of the code that makes kernels and writes them down."""
    return tuple(_code_of_module(f"pirrht.jit.{name}") for name in ("cache", "names", "libraries", "linking"))


def _type(kind: Any) -> str:
    """Return the text of a type of numba's with the names of fields, which its own text leaves out."""
    if isinstance(kind, types.BaseNamedTuple):
        return f"{_of_class(kind.instance_class)}[{','.join(map(_type, kind.types))}]"
    if isinstance(kind, types.BaseTuple):
        return f"({','.join(map(_type, kind.types))})"
    return str(kind)
