"""A system of somebody's own by the module and the name that it has there: `--system MODULE:NAME`."""

from __future__ import annotations

import importlib
import os
import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from pirrht.errors import OptionError, PirrhtError, one_line
from sim.systems import BUILT_IN, System, named, names, register

LONGEST = 200  # characters of a reason that numba gives
_COLORS = re.compile(r"\x1b\[\d*m")
_PLACES = re.compile(r'File "([^"\n]+)", line (\d+)|Raised from ([^\n]+) \((\d+)\)')  # as numba names them

_folders: set[Path] = set()  # of modules that systems came from


def chosen(which: str | System) -> System:
    """Return a system, registered: itself, the built-in one of that name, or MODULE:NAME of a module that is imported.

    The module is looked for in the current folder too, as `python -m` does. A function of that name is called for the
    system.

    Raises:
        OptionError: there is no such module or name, it is no system, or the module cannot be imported.
    """
    if isinstance(which, System):
        return which if which.name in BUILT_IN and named(which.name) is which else register(which)
    if which in names():
        return named(which)
    module_name, _, name = str(which).partition(":")
    if not (module_name and name):
        raise OptionError(
            f"--system is {which!r}; write MODULE:NAME, as in my_module:BOAT, or one of {', '.join(names())}"
        )
    if module_name.endswith(".py") or "/" in module_name or os.sep in module_name:
        path = Path(module_name).with_suffix("")
        raise OptionError(
            f"--system {which}: {module_name} is a file, and a module is wanted; in its folder, or with "
            f"PYTHONPATH={path.parent}, write --system {path.name}:{name}"
        )
    module = _module(module_name, which)
    made = getattr(module, name, None)
    if made is None:
        others = ", ".join(other for other, value in vars(module).items() if isinstance(value, System))
        offers = f"its systems are {others}" if others else "it has no sim.systems.System at all"
        raise OptionError(f"--system {which}: the module {module_name} has no {name}; {offers}")
    if not isinstance(made, System) and callable(made):
        try:
            made = made()
        except (Exception, SystemExit) as error:
            why = error if isinstance(error, PirrhtError) else f"{one_line(error)} when it was called; fix it"
            raise OptionError(f"--system {which}: {why}") from None
    if not isinstance(made, System):
        raise OptionError(
            f"--system {which}: {name} is of the type {type(made).__name__}; it must be a sim.systems.System or a "
            "function that returns one"
        )
    return register(made)


def source(which: str | System | None) -> bytes:
    """Return the file of the module that a system is from, as far as there is one; results depend on it."""
    if not isinstance(which, str) or ":" not in which:
        return b""
    file = getattr(sys.modules.get(which.partition(":")[0]), "__file__", None)
    return Path(file).read_bytes() if file is not None and Path(file).is_file() else b""


def blamed(error: BaseException) -> str | None:
    """Locate and name an error of somebody's own code: the last line of its traceback in a file of theirs.

    That is a file in the folder of a module that a system came from.
    """
    place, trace = None, error.__traceback__
    while trace is not None:
        code = trace.tb_frame.f_code
        if Path(code.co_filename).parent in _folders:
            place = f"{code.co_filename}, line {trace.tb_lineno}, in {code.co_name}"
        trace = trace.tb_next
    if place is None and type(error).__module__.startswith("numba."):
        return _uncompiled(_COLORS.sub("", str(error)))
    return None if place is None else f"{place}: {one_line(error)}; fix it"


def _uncompiled(text: str) -> str | None:
    """Locate in somebody's own code what numba cannot compile, and why; None if it names no file of theirs."""
    places = [(Path(one or other).resolve(), line or at) for one, line, other, at in _PLACES.findall(text)]
    theirs = [f"{path}, line {line}" for path, line in places if path.parent in _folders]
    if not theirs:
        return None
    lines = (" ".join(line.partition("Raised from")[0].split()) for line in text.splitlines())
    reason = next((line for line in lines if line and not line.startswith("Failed in ")), "")
    return (
        f"{theirs[-1]}: numba cannot compile this ({reason.strip(' .:>')[:LONGEST]}); use numbers, arrays and "
        "functions of math and NumPy alone"
    )


def _module(name: str, which: str) -> Any:
    folder = os.getcwd()
    importlib.invalidate_caches()
    try:
        with _first_on_path(folder):
            module = importlib.import_module(name)
    except (Exception, SystemExit) as error:
        where, trace = f"the module {name}", error.__traceback__
        while trace is not None and isinstance(error, PirrhtError):
            if trace.tb_frame.f_globals.get("__name__") == name:
                where = f"line {trace.tb_lineno} of {trace.tb_frame.f_code.co_filename}"
            trace = trace.tb_next
        why = f"{one_line(error)} while {where} was imported; fix it"
        if isinstance(error, PirrhtError):
            why = f"{error}, while {where} was imported"
        elif isinstance(error, ModuleNotFoundError) and f"{name}.".startswith(f"{error.name}."):
            why = f"there is no module {name} in {folder} or among what is installed; fix the name, or set PYTHONPATH"
        raise OptionError(f"--system {which}: {why}") from None
    if (file := getattr(module, "__file__", None)) is not None:
        _folders.add(Path(file).resolve().parent)
    return module


@contextmanager
def _first_on_path(folder: str) -> Iterator[None]:
    """Look for modules in a folder first; afterwards last, so that it hides nothing that is imported later."""
    sys.path.insert(0, folder)
    try:
        yield
    finally:
        with suppress(ValueError):
            sys.path.remove(folder)
        if folder not in sys.path:
            sys.path.append(folder)
