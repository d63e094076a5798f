"""Compile and link kernels with numba's private interface, which only this module and `patches` use.

Numba turns every function that a kernel calls into machine code of its own, with a wrapper for Python, and optimises it
again in each of its callers. Here a function that is called from kernels stays LLVM IR (`Part`); what Python calls
(`Entry`) links the parts that it needs, is optimised once and becomes machine code. Both are kept on disk (`cache`).

`USED` lists what is used of numba. Where a version of numba lacks some of it, importing this module fails, and `jit`
compiles kernels with numba's public interface instead.
"""

from collections.abc import Callable
from copy import copy
from typing import Any

import numba
from llvmlite import binding
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

from pirrht.jit import cache
from pirrht.jit.patches import LOWERING, remember_types, unbroken, without_garbage

USED = {
    CPUDispatcher: "compile get_call_template get_overload add_overload",  # which code a call means
    DefaultPassBuilder: "define_nopython_pipeline",  # where the library of a function is made
    JITCodeLibrary: "finalize add_linking_library enable_object_caching _get_module_for_linking _ensure_finalized "
    "_raise_if_finalized _finalize_dynamic_globals",  # linking
    CompileResult: "_reduce _rebuild",  # form on disk
    FunctionIdentity: "_unique_ids",  # names of machine code
    BaseFunction: "get_call_type",  # types of operations, remembered
    _OverloadFunctionTemplate: "_get_jit_decorator",  # numba's own functions on arrays and numbers become parts
}
_MISSING = [name for owner, all_of in USED.items() for name in all_of.split() if not hasattr(owner, name)]
if _MISSING:
    raise ImportError(f"numba {numba.__version__} has no {', '.join(_MISSING)}")

KEPT = ("numba.cpython.builtins", "numba.np.arrayobj")  # modules of numba whose functions become parts
remember_types()


class PartLibrary(JITCodeLibrary):  # type: ignore[misc]
    """LLVM IR of one function that other code links; it never becomes machine code by itself."""

    _final_module: Any
    _shared_module: Any
    key: str | None = None
    parts: "tuple[PartLibrary, ...]" = ()

    def finalize(self) -> None:
        """Link libraries of numba; other parts are named, and linked where an entry is made."""
        self._raise_if_finalized()
        libraries = dict.fromkeys(self._linking_libraries)
        self.parts = tuple(library for library in libraries if isinstance(library, PartLibrary))
        for library in libraries:
            self._reload_init.update(library._reload_init)
            if not isinstance(library, PartLibrary) and library is not rtsys.library:  # every entry links that
                self._final_module.link_in(library._get_module_for_linking(), preserve=True)
        for function in list(self._final_module.functions):  # a linker keeps one of those of a name
            if not function.is_declaration and function.linkage.name == "external":
                function.linkage = "linkonce_odr"
        self._finalize_dynamic_globals()
        self._finalized = True

    @property
    def bound(self) -> bool:
        """Return whether the code is of this process only: it holds addresses of large arrays, or nameless parts."""
        return bool(self._dynamic_globals) or any(part.key is None for part in self.parts)

    def state(self) -> tuple[str, bytes, list[str | None], list[Any]]:
        """Return name, own IR, names of parts that it links and functions that begin it, for the disk."""
        return self.name, self._final_module.as_bitcode(), [part.key for part in self.parts], list(self._reload_init)

    @classmethod
    def kept(cls, key: str, state: Any = None) -> "PartLibrary | None":
        """Return the IR that is on disk under a name, with all parts that it links."""
        if key in _known or (state := state or cache.load(key, lambda data: data[0])) is None:
            return _known.get(key)
        name, bitcode, below, begin = state
        parts = tuple(part for part in map(cls.kept, below) if part is not None)
        if len(parts) < len(below):
            return None
        for one in begin:
            one()
        library = _known[key] = cls(cpu_target.target_context.codegen(), name)
        library._final_module = binding.parse_bitcode(bitcode)
        library.parts, library.key, library._finalized = parts, key, True
        library._reload_init.update(begin)
        return library

    def _get_module_for_linking(self) -> Any:
        """Return the IR of this function and of all that it calls."""
        self._ensure_finalized()
        if self._shared_module is None:
            self._shared_module = self._final_module.clone()
            for library in _callers_first(self)[1:]:
                self._shared_module.link_in(library._final_module, preserve=True)
        return self._shared_module


_known: dict[str, PartLibrary] = {}  # parts of this process by their names on disk
_keys: list[str | None] = []  # of parts that are being compiled, the innermost last; numba's lock guards it


def _callers_first(library: PartLibrary) -> list[PartLibrary]:
    """Return a part and all parts below it, each before those that it calls: a linker takes over only called code."""
    order: dict[PartLibrary, None] = {}

    def visit(one: PartLibrary) -> None:
        for part in one.parts:
            if part not in order:
                visit(part)
        order[one] = None

    visit(library)
    return list(reversed(order))


class Name:
    """Represents the code of a part where numba expects a function that Python may call: calls find it by this."""

    def __init__(self, context: Any, described: Any, library: PartLibrary) -> None:
        context.insert_user_function(self, described, [library])


@register_pass(mutates_CFG=True, analysis_only=False)
class PartLowering(NativeLowering):  # type: ignore[misc]
    """Lowers to LLVM IR, and no further."""

    _name = LOWERING

    def run_pass(self, state: Any) -> bool:
        """Lower into a `PartLibrary` whose code is named by its key, so that code on disk finds it."""
        if _keys[-1] is not None:
            state.func_id.unique_id = int(_keys[-1][-15:], 16)
        state.library = PartLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
        state.flags.no_compile = True
        super().run_pass(state)
        state.library.finalize()
        state.cr = state.cr._replace(cfunc=Name(state.targetctx, state.cr.fndesc, state.library))
        return True


class PartCompiler(CompilerBase):  # type: ignore[misc]
    """Compiles up to LLVM IR."""

    def define_pipelines(self) -> list[Any]:
        """Return numba's own passes, with `PartLowering` for its lowering."""
        passes = DefaultPassBuilder.define_nopython_pipeline(self.state)
        passes.passes = [(PartLowering if one is NativeLowering else one, text) for one, text in passes.passes]
        return [passes]


class Code(CPUDispatcher):  # type: ignore[misc]
    """A function whose code for a signature is taken from disk, or made and kept there."""

    kind: str  # in names on disk

    def compile(self, sig: Any) -> Any:
        """Return the entry point of a signature."""
        return self.result_of(tuple(sigutils.normalize_signature(sig)[0])).entry_point

    def result_of(self, args: tuple[Any, ...]) -> CompileResult:
        """Return code for argument types, and its description."""
        with global_compiler_lock:
            if args not in self.overloads:
                self.add_overload(self._found_or_made(args))
            return self.overloads[args]

    def _found_or_made(self, args: tuple[Any, ...]) -> CompileResult:
        self.targetctx.refresh()  # else code from disk would find nothing of numba's runtime
        key = cache.key_of(self.py_func, self.kind, args, self.targetoptions, self.targetctx)
        if (result := self._kept(key)) is None:
            heard = {"dispatcher": self, "args": args, "return_type": None}  # as by numba's own dispatchers
            with event.trigger_event("numba:compile", data=heard), cache.locked(key), without_garbage():
                if (result := self._kept(key)) is None:  # nobody else has made it meanwhile
                    result = self._made(key, args)
                    if key is not None and (state := self._state(result)) is not None:
                        cache.save(key, state)
        return result

    def _kept(self, key: str | None) -> CompileResult | None:
        with unbroken:
            return cache.load(key, lambda data: self._rebuilt(key, data))


class Part(Code):
    """A function as kernels call it: LLVM IR for each signature."""

    kind = "part"

    def __init__(self, function: Callable[..., Any], options: dict[str, Any]) -> None:
        super().__init__(function, {}, options | {"no_cpython_wrapper": True}, pipeline_class=PartCompiler)

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """Return types of a call; literals and short whole numbers are any such number, compiled once for all."""
        return super().get_call_template(tuple(map(_widened, args)), {name: _widened(kws[name]) for name in kws})

    def add_overload(self, result: CompileResult) -> None:
        """Take over code, which Python does not call."""
        self.overloads[tuple(result.signature.args)] = result

    def _made(self, key: str | None, args: tuple[Any, ...]) -> CompileResult:
        _keys.append(key)
        try:
            result = self._compiler.compile(args, None)
        finally:
            _keys.pop()
        if not self.targetoptions.get("_nrt", True) and _holds_array(result.signature.return_type):
            raise TypeError(f"{self.py_func.__name__} is part of a kernel and returns an array; write into one")
        result.fndesc.typemap = result.fndesc.calltypes = None  # large, and of no use any more
        if key is not None:
            result.library.key = key
            _known[key] = result.library
        return result

    def _state(self, result: CompileResult) -> Any:
        return None if result.library.bound else (result.library.state(), result.fndesc, result.signature)

    def _rebuilt(self, key: str, data: Any) -> CompileResult | None:
        """Return a part from disk; None if another that it links is not there."""
        state, described, signature = data
        library = PartLibrary.kept(key, state)
        if library is None:
            return None
        return CompileResult(
            target_context=self.targetctx, typing_context=self.typingctx, library=library, fndesc=described,
            signature=signature, entry_point=Name(self.targetctx, described, library), objectmode=False,
            lifted=(), typing_error=None, environment=None, type_annotation=None, call_helper=None, metadata=None,
            reload_init=(), referenced_envs=(),
        )  # fmt: skip


class Entry(Code):
    """A function as Python calls it: machine code of a part and all that it calls; with `by_address`, kernels too."""

    def __init__(self, function: Callable[..., Any], options: dict[str, Any], *, by_address: bool = False) -> None:
        super().__init__(function, {}, options)
        self.part = Part(function, options)
        self.kind = "pointer" if by_address else "entry"

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """Return types of a call from a kernel."""
        return self.part.get_call_template(args, kws)

    def get_overload(self, sig: Any) -> Any:
        """Return the code of a call from a kernel."""
        return self.part.get_overload(sig)

    def address(self, args: tuple[Any, ...]) -> int:
        """Return the address of its machine code for argument types."""
        result = self.result_of(args)
        return int(result.library.get_pointer_to_function(result.fndesc.llvm_cfunc_wrapper_name))

    def _made(self, key: str | None, args: tuple[Any, ...]) -> CompileResult:
        """Link a part and all that it calls."""
        part, context = self.part.result_of(args), self.targetctx
        described = copy(part.fndesc)
        library = context.codegen().create_library(self.py_func.__qualname__)
        described.env_name += "entry"  # where the wrapper keeps constants; the part's own is in other entries as well
        library.enable_object_caching()
        library.add_linking_library(part.library)
        library.add_linking_library(rtsys.library)
        library._reload_init.update(part.library._reload_init)
        environment = Environment.from_fndesc(described)
        ours = context.subtarget(enable_nrt=self.targetoptions["_nrt"], environment=environment, fndesc=described)
        with unbroken:
            ours.create_cpython_wrapper(library, described, environment, None, release_gil=True)
            if self.kind == "pointer":
                ours.create_cfunc_wrapper(library, described, environment, None)
            entry = context.get_executable(library, described, environment)
        return part._replace(
            library=library, fndesc=described, environment=environment, entry_point=entry, type_annotation="",
            reload_init=list(library._reload_init),
        )  # fmt: skip

    def _state(self, result: CompileResult) -> Any:
        return None if result.library.has_dynamic_globals else result._reduce()

    def _rebuilt(self, key: str, data: Any) -> CompileResult:
        return CompileResult._rebuild(self.targetctx, *data)


_parts: dict[Callable[..., Any], Part] = {}  # of functions that stay Python's: numba holds its types of them weakly


def register(function: Callable[..., Any], options: dict[str, Any]) -> None:
    """Let kernels call a Python function."""
    part = _parts[function] = Part(function, options)
    part.typingctx.insert_global(function, types.Dispatcher(part))


def keep_functions_of_numba(options: dict[str, Any]) -> None:
    """Make parts of numba's functions on arrays and numbers, which saves a fifth of the time that kernels compile."""
    plain = _OverloadFunctionTemplate._get_jit_decorator

    def decorator(self: Any) -> Any:
        found = plain(self)
        if found is not jit or self._overload_func.__module__ not in KEPT:  # on other devices numba compiles them
            return found
        return lambda **given: lambda one: Part(one, options | given) if cache.identity(one) else jit(**given)(one)

    _OverloadFunctionTemplate._get_jit_decorator = decorator


def _widened(kind: Any) -> Any:
    kind = types.unliteral(kind)
    return types.int64 if kind in (types.int8, types.int16, types.int32) else kind


def _holds_array(kind: types.Type) -> bool:
    """Return whether values of a type hold arrays."""
    return isinstance(kind, types.Array) or any(_holds_array(one) for one in getattr(kind, "types", ()))
