"""One set of names for the array types of the whole project, their median and bands, and what carries values on.

The name states the dtype; the docstring of a function states the shape, unit and range of each array. Pictures are
`Floats` (float32); accumulation, solves and geometry are `Doubles` (float64).
"""

from collections.abc import Callable, Iterator, Sequence
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

Halves: TypeAlias = npt.NDArray[np.float16]
Floats: TypeAlias = npt.NDArray[np.float32]
Doubles: TypeAlias = npt.NDArray[np.float64]
Flags: TypeAlias = npt.NDArray[np.bool_]
Bytes: TypeAlias = npt.NDArray[np.uint8]
Int8s: TypeAlias = npt.NDArray[np.int8]
Int16s: TypeAlias = npt.NDArray[np.int16]
Int32s: TypeAlias = npt.NDArray[np.int32]
Int64s: TypeAlias = npt.NDArray[np.int64]
Indices: TypeAlias = npt.NDArray[np.intp]
UInt16s: TypeAlias = npt.NDArray[np.uint16]
UInt64s: TypeAlias = npt.NDArray[np.uint64]
Reals: TypeAlias = npt.NDArray[np.floating]  # of either precision
AnyArray: TypeAlias = npt.NDArray[Any]  # of any dtype, such as a picture's codes of 8 or 16 bits
Vector: TypeAlias = tuple[float, float, float]  # x, y, z of a place or a size, in metres, or of a direction
Rgb: TypeAlias = tuple[float, float, float]  # red, green and blue, or a value for each channel


def bands(count: int, step: int) -> Iterator[slice]:
    """Return parts of ``count`` rows or places, so many at a time."""
    return (slice(start, min(start + step, count)) for start in range(0, count, step))


def weighted_median(values: Reals, weight: Reals) -> Any:
    """Return the values (...), from an array (N, ...), with half of the weight (N,) of the first axis below them."""
    order = np.argsort(values, axis=0)
    share = np.cumsum(weight[order], axis=0) / weight.sum()
    place = (share >= 0.5 - 1e-12).argmax(axis=0)[None]
    return np.take_along_axis(np.take_along_axis(values, order, axis=0), place, axis=0)[0]


def carried_on(
    values: Floats, known: Flags, blurs: Sequence[Callable[[Floats], npt.ArrayLike]], usual: npt.ArrayLike
) -> Floats:
    """Return values (H, W, C) of which those that are not ``known`` (H, W) are the mean around them, ever farther.

    ``blurs``: weighted means of pictures (H, W[, C]) around each place, the nearest first; ``usual`` (C,): what stands
    where none of them meets enough.
    """
    out = np.where(known[..., None], values, 0).astype(np.float32)
    seen, weight, todo = out.copy(), known.astype(np.float32), ~known
    for blur in blurs if known.any() else ():
        share = np.asarray(blur(weight))
        ready = todo & (share > 0.05)
        out[ready] = np.asarray(blur(seen))[ready] / share[ready, None]
        todo &= ~ready
    out[todo] = usual
    return out
