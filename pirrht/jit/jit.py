"""Numeric functions as kernels; small ones become part of them and stay plain Python.

Numba counts references whenever an array is taken out of a tuple, atomically and far more often than its optimiser can
undo in a long function: 460 counts in the rollout loop made it five times slower. A kernel therefore takes arrays,
which keeps them alive, and hands addresses of their elements to the functions that it calls in its loops.
"""

import ctypes
import logging
import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import suppress
from functools import cache
from itertools import count, pairwise
from threading import Barrier, Event, Thread, get_ident
from time import sleep
from typing import Any, TypeVar

import numba
import numpy as np
from llvmlite import ir
from numba import typeof, types
from numba.core.dispatcher import Dispatcher
from numba.extending import intrinsic, register_jitable
from numba.np.unsafe.ndarray import to_fixed_tuple

try:
    from pirrht.jit import linking
except ImportError as _change:  # of numba's private interface: its public one is slower, and keeps nothing on disk
    linking = None  # type: ignore[assignment]
    logging.getLogger("pirrht").warning("pirrht: kernels are compiled anew by every command: %s", _change)

A = TypeVar("A")
B = TypeVar("B")
F = TypeVar("F", bound=Callable[..., Any])

DISABLED = bool(numba.config.DISABLE_JIT)  # NUMBA_DISABLE_JIT=1: kernels are plain Python, for debuggers and coverage
if DISABLED:
    np.seterr(over="ignore", divide="ignore", invalid="ignore")  # as compiled: keys wrap, division is IEEE's

# All are set: numba takes over those that are not from whatever calls a function first.
OPTIONS = {
    "nopython": True, "nogil": True, "error_model": "numpy", "fastmath": False, "forceinline": False, "_nrt": True,
    "no_cfunc_wrapper": True,
}  # fmt: skip
if linking:
    linking.keep_functions_of_numba(OPTIONS)
as_tuple = (lambda values, count: tuple(values[:count])) if DISABLED else to_fixed_tuple  # the first of an array
RETRY = 1e-3  # time between checks of the work of other threads [s]


def kernel(function: Callable[..., Any], **options: Any) -> Any:
    """Compile a numeric function: without the interpreter lock, cached on disk, IEEE division."""
    if DISABLED:
        return function
    return linking.Entry(function, OPTIONS | options) if linking else numba.jit(**OPTIONS | options)(function)


def inlined(function: Callable[..., Any]) -> Any:
    """Compile a small function of numbers, which is always inlined: a call would cost more than it does."""
    return kernel(function, forceinline=True)


def borrowing(function: Callable[..., Any], **options: Any) -> Any:
    """Compile a function that does not count who holds the arrays that it is given.

    It makes no arrays, and returns none (TypeError), since its caller would let go of what it never held.
    """
    return kernel(function, _nrt=False, **options)


def part(function: Callable[..., Any]) -> Any:
    """Compile a part of a long kernel: inlined, and `borrowing`, else it would take five times as long."""
    return borrowing(function, forceinline=True)


@cache  # kernels are built once per function
def as_jitable(function: Callable[..., Any]) -> Callable[..., Any]:
    """Let kernels call any numeric Python function, which stays an ordinary one."""
    if isinstance(function, Dispatcher):
        function.targetoptions.setdefault("_nrt", True)  # else numba takes over that of its first caller
    elif not DISABLED:
        linking.register(function, OPTIONS) if linking else register_jitable(function)
    return function


def jitable(function: F) -> F:
    """Let kernels call a function of a module, which stays an ordinary one with its types."""
    as_jitable(function)
    return function


def address_of(function: Callable[..., Any], arguments: tuple[Any, ...]) -> Any:
    """Compile a function for arguments like these and return its address; uncompiled, the function itself."""
    if DISABLED:
        return function
    kinds = tuple(map(typeof, arguments))
    return _by_address(function).address(kinds) if linking else _callback(function, kinds).address


@cache
def _by_address(function: Callable[..., Any]) -> Any:
    return linking.Entry(function, OPTIONS, by_address=True)


@cache  # it lives as long as its address
def _callback(function: Callable[..., Any], kinds: tuple[Any, ...]) -> Any:
    dispatcher = numba.jit(**OPTIONS)(function)
    dispatcher.compile(kinds)
    return numba.cfunc(dispatcher.overloads[kinds].signature)(function)


def caller(result: Any) -> Any:
    """Make the kernel function (address, arguments) that calls by address and returns values like `result`.

    The arguments are a tuple of exactly the types that `address_of` was given.
    """
    if DISABLED:
        return lambda function, arguments: function(*arguments)
    returned = typeof(result)

    @intrinsic  # type: ignore[untyped-decorator]
    def call(typing_context: Any, address: Any, arguments: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, given: Any) -> Any:
            kinds = [context.get_value_type(kind) for kind in arguments]
            function = ir.FunctionType(context.get_value_type(returned), kinds)
            values = [builder.extract_value(given[1], i) for i in range(len(kinds))]
            return builder.call(builder.inttoptr(given[0], function.as_pointer()), values)

        return returned(types.intp, arguments), generate

    return call


def _accessors(name: str) -> tuple[Any, Any]:
    """Make the functions (address, index) and (address, index, value) that load and store an element in kernels."""
    kind = getattr(types, name)
    plain = np.ctypeslib.as_ctypes_type(name)
    number, exact = (getattr(np, name), float) if name.startswith("float") else (np.int64, int)  # as in kernels

    def element(address: int, index: int) -> Any:
        return plain.from_address(int(address) + ctypes.sizeof(plain) * int(index))

    def put(address: int, index: int, value: Any) -> None:
        element(address, index).value = exact(value)

    if DISABLED:
        return (lambda address, index: number(element(address, index).value)), put

    def place(context: Any, builder: Any, given: Any) -> Any:
        return builder.gep(builder.inttoptr(given[0], context.get_value_type(kind).as_pointer()), [given[1]])

    @intrinsic  # type: ignore[untyped-decorator]
    def load(typing_context: Any, address: Any, index: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, given: Any) -> Any:
            return builder.load(place(context, builder, given))

        return kind(types.intp, types.intp), generate

    @intrinsic  # type: ignore[untyped-decorator]
    def store(typing_context: Any, address: Any, index: Any, value: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, given: Any) -> Any:
            builder.store(given[2], place(context, builder, given))
            return context.get_dummy_value()

        return types.none(types.intp, types.intp, kind), generate

    return load, store


load_int8, store_int8 = _accessors("int8")
load_int16, store_int16 = _accessors("int16")
load_int32, store_int32 = _accessors("int32")
load_int64, store_int64 = _accessors("int64")
load_float64, store_float64 = _accessors("float64")
load_float32, _ = _accessors("float32")


def mapped(work: Callable[[A], B], items: Iterable[A], threads: int) -> list[B]:
    """The results of a function for every item, in their order; the calling thread takes its share of them.

    It ends when all are there, since waking a thread takes longer than a short call does. After an interruption it ends
    when no thread is at work on any: they write to arrays of the caller.
    """
    given = list(items)
    if threads == 1 or len(given) < 2:
        return [work(item) for item in given]
    found: dict[int, B] = {}
    errors: list[BaseException] = []
    busy: set[int] = set()  # threads

    turn = count()  # a step of it is atomic
    total = len(given)
    over = Event()

    def pull() -> None:
        busy.add(get_ident())
        try:
            while (i := next(turn)) < len(given):
                found[i] = work(given[i])
        except BaseException as error:
            errors.append(error)
        finally:
            busy.discard(get_ident())
            if errors or len(found) == total:
                over.set()

    try:
        for _ in range(min(threads, total) - 1):
            _pool(threads - 1, os.getpid()).submit(pull)
        pull()
        over.wait()
        if errors:
            raise errors[0]
    except BaseException:
        while given or busy - {get_ident()}:
            with suppress(BaseException):
                given.clear()  # so that nothing more is begun
                sleep(RETRY)
        raise
    return [found[i] for i in range(total)]


def over_ranges(work: Callable[[int, int], None], count: int, threads: int) -> None:
    """Call a function (start, stop) for ranges that cover 0 to `count`, on several threads."""
    parts = 2 * threads if threads > 1 else 1
    mapped(lambda ends: work(*ends), pairwise([count * i // parts for i in range(parts + 1)]), threads)


@cache
def _pool(threads: int, process: int) -> ThreadPoolExecutor:
    """A pool whose threads all wait for work, begun by another thread than the main one, which signals strike."""
    pool = ThreadPoolExecutor(threads)
    all_here = Barrier(threads)
    starter = Thread(target=lambda: wait([pool.submit(all_here.wait) for _ in range(threads)]))
    starter.start()
    starter.join()
    return pool
