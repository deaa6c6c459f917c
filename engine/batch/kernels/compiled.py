"""How every kernel is compiled: once for a machine, cached on disk, running without Python's lock.

`LANES` candidates lie side by side in the last axis of every array, so that one vector instruction serves all of them.
Floating-point reordering is allowed, but NaN and infinity keep their meaning: they mark candidates that do not exist.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final, TypeVar, cast

import numba
from llvmlite import ir
from numba import njit, types
from numba.core import caching, cgutils
from numba.extending import intrinsic

from engine.batch.kernels import linking

LANES: Final = 8


def _cache() -> Path:
    """Return where compiled code is kept: numba looks only at the file of a function, not at those that it calls."""
    sources = sorted(Path(__file__).parent.glob("*.py"))
    content = hashlib.sha256(b"".join(source.read_bytes() for source in sources)).hexdigest()[:16]
    home = os.environ.get("NUMBA_CACHE_DIR") or os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(home) / "servotune" / f"kernels-{content}"


class ByContent(caching.UserProvidedCacheLocator):
    """Keep the code of a file under its name and content, not under its path: all copies of the same sources share it."""

    @classmethod
    def get_suitable_cache_subpath(cls, py_file: str) -> str:
        """Return the name of the folder in `CACHE_DIR` for a file's code."""
        path = Path(py_file)
        return f"{path.parent.name}_{path.stem}_{hashlib.sha256(path.read_bytes()).hexdigest()[:16]}"


# Where that folder cannot be written, numba's own places are tried in their order.
_PLACES = ["UserProvidedCacheLocator", "InTreeCacheLocator", "UserWideCacheLocator", "ZipCacheLocator"]
vars(numba.config)["CACHE_LOCATOR_CLASSES"] = ",".join([f"{__name__}.ByContent", *_PLACES])
vars(numba.config)["CACHE_DIR"] = str(_cache())

linking.keep_copies_apart()

F = TypeVar("F", bound=Callable[..., Any])
_OPTIONS: Final[dict[str, Any]] = {
    "fastmath": {"nsz", "arcp", "contract", "reassoc"}, "nogil": True, "cache": True, "error_model": "numpy",
}  # fmt: skip
# numba's own tests use this option, its documentation does not name it; a kernel that then makes an array does not compile
_UNCOUNTED: Final[dict[str, Any]] = {"_nrt": False}


def compiled(function: F) -> F:
    """Return the function compiled at its first call; it makes no arrays and counts no references to those it is given.

    Counting costs two locked instructions for every view of an array, which added up to a twelfth of all time.
    """
    return cast("F", njit(**_OPTIONS, **_UNCOUNTED)(function))


def allocating(function: F) -> F:
    """Return the function compiled at its first call; it may make arrays."""
    return cast("F", njit(**_OPTIONS)(function))


def instruction(typed: Callable[..., Any]) -> Any:
    """Return a function of compiled code that writes its own machine instructions; numba calls it with types."""
    return intrinsic(typed)


def align_stack(builder: Any) -> None:
    """Let the function being written keep its stack in lines of the cache, so that no vector put there lies across two."""
    builder.function.attributes.alignstack = 8 * LANES
    builder.function.attributes.add("nounwind")  # llvmlite writes no alignment where there is no attribute beside it


def _attribute(name: str) -> Any:
    def code(context: Any, builder: Any, _signature: Any, _arguments: Any) -> Any:
        builder.function.attributes.add(name)
        return context.get_dummy_value()

    return types.void(), code


@instruction
def apart(_context: Any) -> Any:
    """Let the function in which this stands be called, not merged into its caller: it keeps the registers for itself."""
    return _attribute("noinline")


@instruction
def merged(_context: Any) -> Any:
    """Let the function in which this stands be merged into its caller, however often it is used: a call would empty the registers."""
    return _attribute("alwaysinline")


def _product(rows: int, columns: int, *, accumulate: bool) -> Any:
    """Return a product C (+)= A B of matrices whose entries are vectors of lanes, in tiles that stay in registers.

    Numba's own loops over such matrices reach a tenth of what the processor can do, because every partial sum goes
    through memory; the tile keeps ``rows`` x ``columns`` sums in registers. Sizes must be multiples of the tile.
    """

    @instruction
    def product(
        _context: Any, c: Any, a: Any, b: Any, _ni: Any, _nj: Any, _nk: Any, _lda: Any, _ldb: Any, _ldc: Any
    ) -> Any:
        signature = types.void(c, a, b, *[types.intp] * 6)

        def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            align_stack(builder)
            integer = context.get_value_type(types.intp)
            vector = ir.VectorType(ir.DoubleType(), LANES)

            def pointer(k: int) -> Any:
                array = context.make_array(signature.args[k])(context, builder, arguments[k])
                return builder.bitcast(array.data, vector.as_pointer())

            def place(base: Any, i: Any, stride: Any, j: Any) -> Any:
                return builder.gep(base, [builder.add(builder.mul(i, stride), j)])

            out, left, right = pointer(0), pointer(1), pointer(2)
            ni, nj, nk, lda, ldb, ldc = arguments[3:9]
            with (
                cgutils.for_range_slice(builder, integer(0), ni, integer(rows), integer) as (i, _),
                cgutils.for_range_slice(builder, integer(0), nj, integer(columns), integer) as (j, _),
            ):
                at = [builder.add(i, integer(r)) for r in range(rows)]
                to = [builder.add(j, integer(s)) for s in range(columns)]
                tile = [[cgutils.alloca_once(builder, vector) for _ in to] for _ in at]
                for r, row in enumerate(at):
                    for s, column in enumerate(to):
                        start = (
                            builder.load(place(out, row, ldc, column), align=8)
                            if accumulate
                            else ir.Constant(vector, [0.0] * LANES)
                        )
                        builder.store(start, tile[r][s])
                with cgutils.for_range(builder, nk, intp=integer) as loop:
                    lefts = [builder.load(place(left, row, lda, loop.index), align=8) for row in at]
                    for s, column in enumerate(to):
                        factor = builder.load(place(right, loop.index, ldb, column), align=8)
                        for r in range(rows):
                            term = builder.fmul(lefts[r], factor, flags=("contract",))
                            total = builder.fadd(term, builder.load(tile[r][s]), flags=("contract",))
                            builder.store(total, tile[r][s])
                for r, row in enumerate(at):
                    for s, column in enumerate(to):
                        builder.store(builder.load(tile[r][s]), place(out, row, ldc, column), align=8)
            return context.get_dummy_value()

        return signature, code

    return product


multiply: Final = _product(4, 4, accumulate=False)
"""C = A B: ``multiply(c, a, b, rows, columns, inner, stride of a, of b, of c)``, arrays (i, j, LANES), strides in entries."""
multiply_add: Final = _product(4, 4, accumulate=True)
"""C += A B."""
multiply_pairs: Final = _product(2, 4, accumulate=False)
"""C = A B for an even number of rows."""
multiply_pairs_add: Final = _product(2, 4, accumulate=True)
"""C += A B for an even number of rows."""
apply: Final = _product(4, 1, accumulate=False)
"""C = A B for any number of columns."""
apply_two: Final = _product(4, 2, accumulate=False)
"""C = A B for an even number of columns."""
apply_add: Final = _product(4, 1, accumulate=True)
"""C += A B for any number of columns."""
