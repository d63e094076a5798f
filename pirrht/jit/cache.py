"""Compiled kernels on disk, each under a name of all that it computes.

A name is a digest of the bytecode of a function, of all values and functions that it refers to, of the types of its
arguments, compiler and processor. So an edit costs the kernels that it touches and those that call them. A function
that refers to a value that could change unseen has no name, and its code is not kept.

Loading a kernel runs code of its file. So nothing is read but from a folder and files that belong to this user or to
root and that nobody else may write to or replace. Nothing is unpickled unless it has the digest with which its file
begins.
"""

import builtins
import dis
import enum
import hashlib
import logging
import math
import os
import pickle
import stat
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from functools import cache
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import IO, Any

import llvmlite
import numba
import numpy as np
from numba import types
from numba.core.dispatcher import Dispatcher
from numba.core.serialize import dumps
from numba.extending import intrinsic

from pirrht.jit.ownership import Foreign, is_foreign, own

try:
    import fcntl
except ImportError:  # a system without such locks: everyone compiles
    fcntl = None  # type: ignore[assignment]

UNUSED = 30 * 86400.0  # a kernel that was not loaded for so long is removed [s]
DAY = 86400.0  # precision of the time at which a kernel was loaded last [s]
PATIENCE = 60.0  # longest wait for a kernel that another process compiles [s]; the largest takes some seconds
POLL = 0.01  # between two attempts to take a lock [s]
_PLAIN = (bool, int, float, complex, str, bytes, type(None), np.generic)
_Intrinsic = type(intrinsic(lambda context: None))
_PACKAGE = Path(__file__).resolve().parent.parent
_patience = [PATIENCE]  # of this process, the last counts [s]
_warned: set[str] = set()  # kinds of lines that this process has written
_identities: dict[FunctionType, str] = {}


class Unknown(Exception):
    """A function refers to a value that could change unseen."""


def key_of(function: Callable[..., Any], kind: str, args: tuple[Any, ...], options: Any, context: Any) -> str | None:
    """Return the name on disk of compiled code for argument types; None if there is none."""
    if (code := identity(function)) is None:
        return None
    makers = [_code_of_module(f"pirrht.jit.{name}") for name in ("cache", "linking", "patches")]
    made = (numba.__version__, llvmlite.__version__, sys.version_info[:2], context.codegen().magic_tuple(), makers)
    whole = repr((code, kind, [_of(one, ()) for one in args], sorted(options.items()), made))
    name = "".join(c if c.isalnum() or c in "._" else "" for c in f"{function.__module__}.{function.__name__}")
    return f"{name[-80:]}-{hashlib.sha256(whole.encode()).hexdigest()[:32]}"


def identity(function: Callable[..., Any]) -> str | None:
    """Return a name of all that a function computes, equal in all processes; None if there is none."""
    try:
        return _of_function(getattr(function, "py_func", function), ())
    except Unknown:
        return None


def _of_function(function: Any, above: tuple[Any, ...]) -> str:
    if not isinstance(function, FunctionType) or function in above:
        raise Unknown
    if function not in _identities:
        code = function.__code__
        values = [*_closed(function), *(function.__defaults__ or ()), *_globals(code, function.__globals__)]
        parts = [_text(code, function.__doc__), *(_of(value, (*above, function)) for value in values)]
        _identities[function] = hashlib.sha256("\n".join(parts).encode()).hexdigest()
    return _identities[function]


def _closed(function: Any) -> list[Any]:
    return [cell.cell_contents for cell in function.__closure__ or ()]


def _text(code: CodeType, documentation: str | None) -> str:
    """Return all that code does, without its place and its docstring."""
    constants = [_text(c, None) if isinstance(c, CodeType) else c for c in code.co_consts]
    constants = [None if c == documentation else repr(c) for c in constants]
    names = (code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars, code.co_argcount)
    return repr((code.co_code.hex(), *names, code.co_kwonlyargcount, code.co_exceptiontable.hex(), constants))


def _globals(code: CodeType, scope: dict[str, Any]) -> Iterator[Any]:
    """Yield values of the global names that code reads; of a module other than math and NumPy, of its attributes."""
    steps = [step for step in dis.get_instructions(code) if step.opname != "PRECALL"]
    for i, step in enumerate(steps):
        if step.opname in ("LOAD_GLOBAL", "LOAD_NAME"):
            value = scope.get(step.argval, getattr(builtins, step.argval, Unknown))
            while isinstance(value, ModuleType) and value not in (math, np):
                i += 1
                value = getattr(value, str(steps[i].argval), Unknown)
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
    if isinstance(value, (tuple, types.BaseTuple)):  # of numba's types, whose own text leaves out names of fields
        kind = getattr(value, "instance_class", tuple) if isinstance(value, types.BaseTuple) else type(value)
        return f"{'' if kind is tuple else _of_class(kind)}({','.join(_of(one, above) for one in value)})"
    if isinstance(value, types.Type):
        return str(value)
    if isinstance(value, slice):
        return f"slice{_of((value.start, value.stop, value.step), above)}"
    if isinstance(value, Dispatcher):
        return f"{_of_function(value.py_func, above)} {sorted(value.targetoptions.items())}"
    if isinstance(value, _Intrinsic):  # it writes LLVM IR: all code of its module counts, and its closure
        define = value._defn
        return f"{_code_of_module(define.__module__)} {define.__qualname__} {_of(tuple(_closed(define)), above)}"
    if isinstance(value, FunctionType):
        return _of_function(value, above)
    if isinstance(value, type):
        return _of_class(value)
    owner = (getattr(value, "__module__", None) or "").split(".")[0]
    if isinstance(value, np.ufunc) or owner in ("math", "builtins", "numpy") or value is math or value is np:
        return f"{owner} {value.__name__}"
    raise Unknown


def _of_class(value: type) -> str:
    if hasattr(value, "_fields"):
        return f"{value.__module__}.{value.__qualname__}{value._fields}"
    if issubclass(value, enum.Enum):
        return f"{value.__qualname__}{[(one.name, one.value) for one in value]}"
    if value.__module__ in ("builtins", "numpy"):
        return value.__qualname__
    raise Unknown


@cache
def _code_of_module(name: str) -> str:
    """Return a digest of a module's source; of numba's, whose version is in every key, its name."""
    path = getattr(sys.modules[name], "__file__", None)
    if name.split(".")[0] == "numba":
        return name
    if path is None or not os.path.exists(path):
        raise Unknown
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()


def load(key: str | None, made: Callable[[Any], Any]) -> Any:
    """Return `made` of the content that is kept under a name; None if there is none that is whole and ours."""
    if key is None:
        return None
    try:
        path = _own_folder() / key
        with open(path, "rb", opener=_opened) as stream:
            found = os.fstat(stream.fileno())  # of what is read, whatever the name stands for by now
            if not stat.S_ISREG(found.st_mode):
                return None
            if is_foreign(found):
                _warn_once(f"a compiled kernel is not used, since another user may have written it: {path}")
                return None
            if time.time() - found.st_mtime > DAY:
                with suppress(OSError):
                    os.utime(path)
            content = stream.read()
    except OSError:
        return None
    try:
        if content[:32] != hashlib.sha256(content[32:]).digest():
            raise ValueError
        return made(pickle.loads(content[32:]))
    except Exception:  # whatever rebuilding meets
        _warn_once(f"a compiled kernel on disk is damaged, {path}; it is compiled again")
        return None


def _opened(path: str, flags: int) -> int:
    """Open a file, not what a link leads to; a pipe keeps nobody waiting, and others cannot open what is new."""
    return os.open(path, flags | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0), 0o600)


def save(key: str, content: Any) -> None:
    """Keep something under a name; where that is not possible every process compiles it."""
    try:
        data = dumps(content)
    except (TypeError, pickle.PicklingError) as error:
        _warn_once(
            f"a compiled kernel cannot be kept, since numba {numba.__version__} does not write it ({error}), so every "
            "command compiles anew; another release of numba may help"
        )
        return
    try:
        handle, part = tempfile.mkstemp(dir=_own_folder())  # nobody finds half of a file
        try:
            with os.fdopen(handle, "wb") as stream:
                stream.write(hashlib.sha256(data).digest() + data)
            os.chmod(part, 0o644)
            os.replace(part, folder() / key)
        except BaseException:
            os.unlink(part)
            raise
        _tidy()
    except OSError as error:
        if not isinstance(error, Foreign):
            _warn_once(
                f"compiled kernels cannot be kept in {folder()} ({error.strerror}), so every command compiles anew; "
                "set NUMBA_CACHE_DIR to a folder that may be written"
            )


@contextmanager
def locked(key: str | None) -> Iterator[None]:
    """Hold the lock of a name until done or gone: others wait, and then find what one has compiled.

    Who waits longer than any kernel takes to compile waits for no lock any more, and compiles.
    """
    stream = None
    if key is not None and fcntl is not None:
        with suppress(OSError):
            stream = open(_own_folder() / f"{key}.lock", "ab", opener=_opened)  # noqa: SIM115
            began = time.monotonic()
            while not _is_ours(stream):
                if time.monotonic() - began > _patience[-1]:
                    _patience.append(0.0)
                    _warn_once(f"a process compiles a kernel for more than {PATIENCE:.0f} s, so this one compiles too")
                    break
                time.sleep(POLL)
    with stream or nullcontext():
        yield


def _is_ours(stream: IO[bytes]) -> bool:
    """Take the lock of a file, if nobody has it."""
    try:
        fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def kept() -> bool:
    """Return whether compiled code can be kept on disk for the next process."""
    try:
        tempfile.TemporaryFile(dir=_own_folder()).close()
    except OSError:
        return False
    return not numba.config.DISABLE_JIT


@cache
def folder() -> Path:
    """Return the folder of kernels: in NUMBA_CACHE_DIR, else next to the package, else in the user's cache, or /tmp.

    It is the first that this user may write to and nobody else. The variable is read from the environment, since a file
    of the current folder may change numba's own.
    """
    user = os.geteuid() if hasattr(os, "geteuid") else "user"
    place = Path("pirrht", "kernels")
    homes = [os.environ.get("NUMBA_CACHE_DIR")]
    if homes == [None] or homes == [""]:
        homes = [str(_PACKAGE / "__pycache__"), os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")]
        homes.append(os.path.join(tempfile.gettempdir(), f"pirrht-{user}"))
    paths = [Path(home).resolve() / place for home in homes if home and not home.startswith("~")]
    for path in paths:
        with suppress(OSError):
            if os.access(own(path), os.W_OK):
                return path
    return paths[0]


def _own_folder() -> Path:
    """Make the folder of kernels, if need be; Foreign and a line where somebody else may write there."""
    path = folder()
    try:
        return own(path)
    except Foreign:
        _warn_once(
            f"compiled kernels in {path} are not used, since another user may write there, so every command "
            "compiles anew; remove it, or set NUMBA_CACHE_DIR to a folder of your own"
        )
        raise


@cache
def _tidy() -> None:
    """Remove, once per process, files that were not loaded for a month."""
    for path in folder().iterdir():
        with suppress(OSError):
            if time.time() - path.stat().st_mtime > UNUSED:
                path.unlink()


def _warn_once(line: str) -> None:
    """Once per process and kind; without a handler of the caller's own it goes to standard error as it is."""
    if (kind := line.split(",")[0]) not in _warned:
        _warned.add(kind)
        logging.getLogger("pirrht").warning("pirrht: %s", line)
