"""Compile kernels with numba's public interface: slower, and not kept on disk, but with any version of numba."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba
from numba.extending import register_jitable


def compiled(function: Callable[..., Any], options: dict[str, Any]) -> Any:
    """Compile a function that Python and kernels call."""
    return numba.jit(**options)(function)


def addressed(function: Callable[..., Any], options: dict[str, Any]) -> Callable[[tuple[Any, ...]], int]:
    """Return the function of argument types that compiles for them and returns the address of machine code."""
    dispatcher, callbacks = numba.jit(**options)(function), []

    def address(args: tuple[Any, ...]) -> int:
        dispatcher.compile(args)
        callbacks.append(numba.cfunc(dispatcher.overloads[args].signature)(function))  # it lives as long as its address
        return int(callbacks[-1].address)

    return address


def register(function: Callable[..., Any], options: dict[str, Any]) -> None:
    """Let kernels call a Python function."""
    register_jitable(function)


def keep_functions_of_numba(options: dict[str, Any]) -> None:
    """Leave numba's own functions to numba."""
