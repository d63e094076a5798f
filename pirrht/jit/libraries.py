"""LLVM IR that other code links, and machine code that Python calls, as libraries of numba's."""

from __future__ import annotations

from typing import Any

from llvmlite import binding
from numba.core.codegen import JITCodeLibrary
from numba.core.runtime import rtsys


class PartLibrary(JITCodeLibrary):  # type: ignore[misc]
    """LLVM IR of one function that other code links; it never becomes machine code by itself."""

    _final_module: Any
    _shared_module: Any

    def finalize(self) -> None:
        """Link what numba brings along; other parts are named, and linked where an entry is made."""
        self._raise_if_finalized()
        self.key: str | None = None
        self.parts: list[PartLibrary] = []
        for library in dict.fromkeys(self._linking_libraries):
            self._reload_init.update(library._reload_init)
            if isinstance(library, PartLibrary):
                self.parts.append(library)
            elif library is not rtsys.library:  # every entry links that
                self._final_module.link_in(library._get_module_for_linking(), preserve=True)
        self._own = self._to_link_often()
        self._finalize_dynamic_globals()
        self._finalized = True

    def restore(self, bitcode: bytes, parts: list[PartLibrary], key: str) -> None:
        """Be what an earlier process has kept."""
        self._final_module = self._own = binding.parse_bitcode(bitcode)
        self.parts, self.key, self._finalized = parts, key, True

    @property
    def bound(self) -> bool:
        """Whether only this process can use the code: it holds addresses, as of large arrays, or nameless parts."""
        return bool(self._dynamic_globals) or any(part.key is None for part in self.parts)

    def state(self) -> tuple[str, bytes, list[str | None], list[Any]]:
        """What is kept on disk: name, IR of this function alone, names of parts that it links, what begins it."""
        return self.name, self._own.as_bitcode(), [part.key for part in self.parts], list(self._reload_init)

    def _to_link_often(self) -> Any:
        """The module with its functions marked as those of which a linker keeps one."""
        names = [f.name for f in self._final_module.functions if not f.is_declaration and f.linkage.name == "external"]
        for name in names:
            self._final_module.get_function(name).linkage = "linkonce_odr"
        return self._final_module

    def _get_module_for_linking(self) -> Any:
        """The IR of this function and of all that it calls."""
        self._ensure_finalized()
        if self._shared_module is None:
            self._shared_module = self._own.clone()
            for library in _callers_first(self)[1:]:
                self._shared_module.link_in(library._own, preserve=True)
        return self._shared_module


def _callers_first(library: PartLibrary) -> list[PartLibrary]:
    """A part and all parts below it, each before those that it calls.

    A linker takes over only what is called by what it already has.
    """
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
        """Its name, the kind of what follows, machine code, and a module that names what it defines."""
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
