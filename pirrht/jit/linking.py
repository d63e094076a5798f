"""Compile and link kernels with numba's private interface, which only this module and `libraries` use.

Numba turns every function that a kernel calls into machine code of its own, with a wrapper for Python, and optimises it
again in each of its callers. Here a function that is called from kernels stays LLVM IR (`Part`); what Python calls
(`Entry`) links the parts that it needs, is optimised once and becomes machine code. Both are kept on disk (`cache`).

`USED` lists what is used of numba. Where a version of numba lacks some of it, importing this module fails, and `plain`
compiles kernels with numba's public interface instead.
"""

from __future__ import annotations

import gc
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from copy import copy
from itertools import count
from secrets import randbits
from typing import Any

import numba
from numba import jit, types
from numba.core import event, sigutils
from numba.core.bytecode import FunctionIdentity
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, CompileResult, DefaultPassBuilder
from numba.core.compiler_lock import global_compiler_lock
from numba.core.compiler_machinery import register_pass
from numba.core.environment import Environment
from numba.core.registry import CPUDispatcher, cpu_target
from numba.core.runtime import rtsys
from numba.core.typed_passes import NativeLowering
from numba.core.types.functions import BaseFunction
from numba.core.typing.templates import _OverloadFunctionTemplate

from pirrht.jit import cache, names
from pirrht.jit.libraries import EntryLibrary, PartLibrary, unbroken

USED = {
    CPUDispatcher: "compile get_call_template get_overload add_overload",  # which code a call means
    DefaultPassBuilder: "define_nopython_pipeline",  # where the library of a function is made
    JITCodeLibrary: "finalize add_linking_library serialize_using_object_code enable_object_caching "
    "_get_module_for_linking _ensure_finalized _raise_if_finalized _get_compiled_object",  # linking, form on disk
    CompileResult: "_reduce _rebuild",
    FunctionIdentity: "_unique_ids",  # names of machine code
    BaseFunction: "get_call_type",  # types of operations, remembered
    _OverloadFunctionTemplate: "_get_jit_decorator",  # numba's own functions on arrays and numbers become parts
}
_MISSING = [name for owner, all_of in USED.items() for name in all_of.split() if not hasattr(owner, name)]
if _MISSING:
    raise ImportError(f"numba {numba.__version__} has no {', '.join(_MISSING)}")

VALUES = (types.Number, types.Boolean, types.Array, types.BaseTuple)
KEPT = ("numba.cpython.builtins", "numba.np.arrayobj")  # modules of numba whose functions become parts
BITS = 48  # among a thousand processes two share a count with a chance of one in a million


def count_from_chance() -> None:
    """Let this process count what it compiles from a random number.

    Numba puts its count into the names of code, and the linker takes the first code of a name. Numba's own functions,
    compiled by two processes that count alike, would be mistaken for each other.
    """
    FunctionIdentity._unique_ids = count(randbits(BITS))


count_from_chance()
if hasattr(os, "register_at_fork"):  # not on Windows, where there is no fork
    os.register_at_fork(after_in_child=count_from_chance)


def _remember_types() -> None:
    """Let numba search once for the templates of an operation: the answer depends on operation and types alone."""
    known: dict[Any, Any] = {}
    plain = BaseFunction.get_call_type

    def get_call_type(self: Any, context: Any, args: Any, kws: Any) -> Any:
        if kws or not all(isinstance(kind, VALUES) for kind in args):
            return plain(self, context, args, kws)
        key = (self, args)
        if key not in known:
            known[key] = plain(self, context, args, kws)
        return known[key]

    BaseFunction.get_call_type = get_call_type  # type: ignore[method-assign]


_remember_types()


@contextmanager
def _compiling(dispatcher: CPUDispatcher, args: tuple[Any, ...]) -> Iterator[None]:
    """Trigger the event of numba's own dispatchers, and collect no garbage: it would take a sixth of the time."""
    collects = gc.isenabled()
    gc.disable()
    try:
        with event.trigger_event("numba:compile", data={"dispatcher": dispatcher, "args": args, "return_type": None}):
            yield
    finally:
        if collects:
            gc.enable()


class Name:
    """Represents the code of a part where numba expects a function that Python may call."""


@register_pass(mutates_CFG=True, analysis_only=False)
class PartLowering(NativeLowering):  # type: ignore[misc]
    """Lowers to LLVM IR, and no further."""

    _name = "native_lowering"

    def run_pass(self, state: Any) -> bool:
        """Lower into a `PartLibrary`, and register it for calls from other kernels.

        The name of its code follows from the key: code on disk that calls it finds it, even where it was compiled anew.
        """
        if _keys[-1] is not None:
            state.func_id.unique_id = int(_keys[-1][-15:], 16)
        state.library = PartLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
        state.flags.no_compile = True
        super().run_pass(state)
        state.library.finalize()
        state.cr = state.cr._replace(cfunc=_registered(state.targetctx, state.cr.fndesc, state.library))
        return True


def _registered(context: Any, described: Any, library: PartLibrary) -> Name:
    """Return the name by which calls of a part find its code."""
    name = Name()
    context.insert_user_function(name, described, [library])
    return name


class PartCompiler(CompilerBase):  # type: ignore[misc]
    """Compiles up to LLVM IR."""

    def define_pipelines(self) -> list[Any]:
        """Return numba's own passes, with `PartLowering` for its lowering."""
        passes = DefaultPassBuilder.define_nopython_pipeline(self.state)
        passes.passes = [(PartLowering if one is NativeLowering else one, text) for one, text in passes.passes]
        return [passes]


class Part(CPUDispatcher):  # type: ignore[misc]
    """A function as kernels call it: LLVM IR for each signature, taken from disk or compiled and kept there."""

    def __init__(self, function: Callable[..., Any], options: dict[str, Any]) -> None:
        super().__init__(function, {}, options | {"no_cpython_wrapper": True}, pipeline_class=PartCompiler)

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """Return types of a call.

        With a literal or a short whole number it is the call with any such number: otherwise a kernel would be compiled
        once for 0, once for 2 and once for an index out of an array of 32 bits.
        """
        return super().get_call_template(tuple(map(_widened, args)), {name: _widened(kws[name]) for name in kws})

    def compile(self, sig: Any) -> Any:
        """Return the name of the code for a signature."""
        args, _ = sigutils.normalize_signature(sig)
        return self.result_of(tuple(args)).entry_point

    def result_of(self, args: tuple[Any, ...]) -> Any:
        """Return code for argument types, and its description."""
        with global_compiler_lock:
            if args not in self.overloads:
                self.overloads[args] = self._found_or_compiled(args)
            return self.overloads[args]

    def _found_or_compiled(self, args: tuple[Any, ...]) -> Any:
        key = names.key_of(self.py_func, "part", args, self.targetoptions, self.targetctx)
        with cache.locked(key):
            result = cache.load(key, lambda data: _restored(data, str(key)), unbroken)
            if result is not None:
                return result
            _keys.append(key)
            try:
                with _compiling(self, args):
                    result = self._compiler.compile(args, None)
            finally:
                _keys.pop()
            if not self.targetoptions.get("_nrt", True) and _holds_array(result.signature.return_type):
                raise TypeError(f"{self.py_func.__name__} is part of a kernel and returns an array; write into one")
            library, described = result.library, result.fndesc
            described.typemap = described.calltypes = None  # large, and of no use any more
            if not library.bound:
                cache.save(key, lambda: (library.state(), described, result.signature))
        if key is not None:
            library.key = key
            _known[key] = library
        return result


_keys: list[str | None] = []  # of parts that are being compiled, the innermost last; numba's lock guards it
_known: dict[str, PartLibrary] = {}  # parts of this process by their names on disk


def _restored(data: Any, key: str) -> Any:
    """Return a part from disk; None if another that it links is not there."""
    state, described, signature = data
    context, typing = cpu_target.target_context, cpu_target.typing_context
    library = _library_of(key, state)
    if library is None:
        return None
    return CompileResult(
        target_context=context, typing_context=typing, library=library, fndesc=described, signature=signature,
        entry_point=_registered(context, described, library), objectmode=False, lifted=(), typing_error=None,
        environment=None, type_annotation=None, call_helper=None, metadata=None, reload_init=(), referenced_envs=(),
    )  # fmt: skip


def _library_of(key: str, state: Any = None) -> PartLibrary | None:
    """Return the IR that is kept under a name, with all parts that it links."""
    if key in _known:
        return _known[key]
    state = state or cache.load(key, lambda data: data[0], unbroken)
    if state is None:
        return None
    name, bitcode, below, begin = state
    parts = [part for part in map(_library_of, below) if part is not None]
    if len(parts) < len(below):
        return None
    for one in begin:
        one()
    library = PartLibrary(cpu_target.target_context.codegen(), name)
    library.restore(bitcode, parts, key)
    library._reload_init.update(begin)
    _known[key] = library
    return library


class Entry(CPUDispatcher):  # type: ignore[misc]
    """A function as Python calls it: machine code of a part and all that it calls; kernels link the part.

    With `by_address`, kernels can call its machine code too.
    """

    def __init__(self, function: Callable[..., Any], options: dict[str, Any], *, by_address: bool = False) -> None:
        super().__init__(function, {}, options)
        self.part, self.by_address = Part(function, options), by_address

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """Return types of a call from a kernel."""
        return self.part.get_call_template(args, kws)

    def get_overload(self, sig: Any) -> Any:
        """Return the code of a call from a kernel."""
        return self.part.get_overload(sig)

    def compile(self, sig: Any) -> Any:
        """Return the entry point of a signature, which Python calls."""
        args, _ = sigutils.normalize_signature(sig)
        with global_compiler_lock:
            if tuple(args) not in self.overloads:
                self.add_overload(self._found_or_linked(tuple(args)))
            return self.overloads[tuple(args)].entry_point

    def address(self, args: tuple[Any, ...]) -> int:
        """Return the address of its machine code for argument types."""
        self.compile(args)
        result = self.overloads[args]
        return int(result.library.get_pointer_to_function(result.fndesc.llvm_cfunc_wrapper_name))

    def _found_or_linked(self, args: tuple[Any, ...]) -> Any:
        self.targetctx.refresh()  # else code from disk would find nothing of numba's runtime
        kind = "pointer" if self.by_address else "entry"
        key = names.key_of(self.py_func, kind, args, self.targetoptions, self.targetctx)
        result = self._found(key)
        if result is None:
            with cache.locked(key):
                result = self._found(key)
                if result is None:
                    with _compiling(self, args):
                        result = self._linked(self.part.result_of(args))
                    if not result.library.has_dynamic_globals:
                        cache.save(key, result._reduce)
        return result

    def _found(self, key: str | None) -> Any:
        return cache.load(key, lambda data: CompileResult._rebuild(self.targetctx, *data), unbroken)

    def _linked(self, part: Any) -> Any:
        context = self.targetctx
        described, library = copy(part.fndesc), EntryLibrary(context.codegen(), self.py_func.__qualname__)
        described.env_name += "entry"  # where the wrapper keeps constants; the part's own is in other entries as well
        library.enable_object_caching()
        library.add_linking_library(part.library)
        library.add_linking_library(rtsys.library)
        library._reload_init.update(part.library._reload_init)
        environment = Environment.from_fndesc(described)
        ours = context.subtarget(enable_nrt=self.targetoptions["_nrt"], environment=environment, fndesc=described)
        with unbroken("linking"):
            ours.create_cpython_wrapper(library, described, environment, None, release_gil=True)
            if self.by_address:
                ours.create_cfunc_wrapper(library, described, environment, None)
            entry = context.get_executable(library, described, environment)
        return part._replace(
            library=library, fndesc=described, environment=environment, entry_point=entry, type_annotation="",
            reload_init=list(library._reload_init),
        )  # fmt: skip


compiled = Entry  # as `plain` names it


def addressed(function: Callable[..., Any], options: dict[str, Any]) -> Callable[[tuple[Any, ...]], int]:
    """Return the function of argument types that compiles for them and returns the address of machine code."""
    return Entry(function, options, by_address=True).address


_parts: dict[Callable[..., Any], Part] = {}  # of functions that stay Python's: numba holds its types of them weakly


def register(function: Callable[..., Any], options: dict[str, Any]) -> None:
    """Let kernels call a Python function."""
    part = _parts[function] = Part(function, options)
    part.typingctx.insert_global(function, types.Dispatcher(part))


def keep_functions_of_numba(options: dict[str, Any]) -> None:
    """Make parts of numba's own functions on arrays and numbers, which it would compile anew in every process."""
    plain = _OverloadFunctionTemplate._get_jit_decorator

    def decorator(self: Any) -> Any:
        found = plain(self)
        if found is not jit or self._overload_func.__module__ not in KEPT:  # on other devices numba compiles them
            return found

        def made(**given: Any) -> Callable[..., Any]:
            """Make a part of a function that can be kept; others stay numba's."""
            return lambda one: Part(one, options | given) if names.identity(one) else found(**given)(one)

        return made

    _OverloadFunctionTemplate._get_jit_decorator = decorator


def _widened(kind: Any) -> Any:
    kind = types.unliteral(kind)
    return types.int64 if kind in (types.int8, types.int16, types.int32) else kind


def _holds_array(kind: types.Type) -> bool:
    """Return whether values of a type hold arrays."""
    return isinstance(kind, types.Array) or any(_holds_array(one) for one in getattr(kind, "types", ()))
