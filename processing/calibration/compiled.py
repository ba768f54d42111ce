"""Compiled loops: numba's settings in one place, and what its language lacks.

Compilation takes seconds once; the machine code is kept beside the package, or in the user's cache folder where the
package cannot be written, or nowhere where neither can (then each process compiles anew).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba
from llvmlite import ir  # type: ignore[import-untyped]
from numba import types
from numba.extending import intrinsic

# Not nnan and ninf: infinities are an honest uncertainty. Sums may be reordered and products fused.
FAST_MATH = {"reassoc", "contract", "arcp", "nsz"}


def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a function: without the GIL, kept on disk where a folder can be written; 1/0 is inf, not an error."""
    settings: dict[str, Any] = {"nogil": True, "error_model": "numpy", "fastmath": FAST_MATH}
    try:
        return numba.njit(cache=True, **settings)(function)  # type: ignore[no-any-return]
    except RuntimeError:  # numba: no folder for its cache
        return numba.njit(**settings)(function)  # type: ignore[no-any-return]


def _pointer(of: types.Type, bits: ir.Type) -> Any:
    def build(_typing: Any, _address: Any) -> Any:
        def code(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
            return builder.inttoptr(args[0], bits.as_pointer())

        return types.CPointer(of)(types.uint64), code  # type: ignore[no-untyped-call]

    return intrinsic(build)


def _four_floats(*, add: bool) -> Any:
    vector = ir.VectorType(ir.FloatType(), 4)

    def build(_typing: Any, _target: Any, _source: Any) -> Any:
        def code(context: Any, builder: Any, _signature: Any, args: Any) -> Any:
            target, source = (builder.inttoptr(a, vector.as_pointer()) for a in args)
            value = builder.load(source, align=4)
            if add:
                value = builder.fadd(builder.load(target, align=4), value)
            builder.store(value, target, align=4)
            return context.get_dummy_value()

        return types.void(types.uint64, types.uint64), code

    return intrinsic(build)


bytes_at = _pointer(types.uint8, ir.IntType(8))
"""``bytes_at(address)``: for ``numba.carray``; a tuple of arrays would compile anew for every number of frames."""
floats_at = _pointer(types.float32, ir.FloatType())
set_four = _four_floats(add=False)
"""``set_four(target, source)``: copies four float32 from address to address, as one vector."""
add_four = _four_floats(add=True)
"""``add_four(target, source)``: adds four float32 to what is at ``target``: numba does not find this by itself."""
