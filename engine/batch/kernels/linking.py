"""Which of several copies of a function compiled code calls: its own.

What is compiled carries copies of all functions that it calls, each optimised for its place, so that they round differently. The linker of a
process takes the first function of a name for all of them: numbers would depend on what a process had compiled or loaded before. numba
has no option for that, so this file, and no other, uses what it keeps to itself.
"""

from __future__ import annotations

from typing import Any, Final

from llvmlite.binding import Linkage
from numba.core.codegen import JITCodeLibrary

_finish: Final = JITCodeLibrary._finalize_final_module


def _with_its_own_copies(library: Any) -> None:
    """Hide the copies in a module from all others, once it is optimised and before it becomes machine code."""
    module = library._final_module
    defined = [one for one in module.functions if not one.is_declaration]
    copies = [one.name for one in defined if one.linkage == Linkage.linkonce_odr]
    if copies:
        # callers get copies of this module in which they are merged as ever
        library._shared_module = module.clone()
        for one in defined:
            if one.linkage == Linkage.external:
                library._shared_module.get_function(one.name).linkage = Linkage.linkonce_odr
        for name in copies:
            module.get_function(name).linkage = Linkage.internal
    _finish(library)  # type: ignore[no-untyped-call]


def keep_copies_apart() -> None:
    """Let everything that this process compiles from now on call its own copies."""
    JITCodeLibrary._finalize_final_module = _with_its_own_copies  # type: ignore[method-assign]
