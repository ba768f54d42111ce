"""What every picture must hold before it is written and after it is read: shapes, types, finite light, known codes."""

import errno
import math
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from processing.errors import PictureFileError
from processing.ground.arrays import Flags, Floats, bands
from processing.ground.kernels import compiled
from processing.ground.threads import side_by_side
from processing.pictures.images import LuminanceImage, RelativeImage, Validity
from station.session import durable
from station.session.folder import Folder, part_name, write_file

MAX_PIXELS = 1 << 28  # a picture of the whole sphere at 1 arc minute; more is a damaged header, or a bomb
MAX_SIDE_PX = 1 << 16  # chosen
LEAST_LIGHT = 1e-36  # chosen: of such values, and of 1 over them, float32 still holds products and sums

_ROWS = 256  # rows looked at in one go, so that checks need little memory beside the picture
_BAND_ROWS = 32  # chosen: of a panorama these stay in the processor's cache


def check_image(image: RelativeImage | LuminanceImage, where: Path | str) -> None:
    """Raise `PictureFileError` naming ``where`` unless the picture keeps its type's promises
    (`processing.pictures.images`).
    """
    height, width = image.geometry.height_px, image.geometry.width_px
    check_size(width, height, where)
    check_array(image.rgb, "rgb", (height, width, 3), np.float32, where)
    check_array(image.uncertainty, "uncertainty", (height, width), np.float32, where)
    check_array(image.validity, "validity", (height, width), np.uint8, where)
    if image.ghost is not None:
        check_array(image.ghost, "ghost", (height, width), np.uint8, where)
    check_light(image.rgb, where)
    # Relative uncertainties (H, W) are above 0; infinity: nothing is known.
    if not bool((image.uncertainty > 0).all()):
        wrong = int((~(image.uncertainty > 0)).sum())
        raise refused(where, f"{wrong} relative uncertainties are NaN, zero or negative")
    if int(image.validity.max(initial=0)) > max(Validity):
        raise refused(where, f"validity {int(image.validity.max())} is not a known code (0 to {int(max(Validity))})")
    if isinstance(image, LuminanceImage) and not 0 <= image.scale_uncertainty < math.inf:
        raise refused(where, f"scale_uncertainty is {image.scale_uncertainty}, not a finite number from 0 up")


def check_size(width: int, height: int, where: Path | str) -> None:
    """Raise unless the size is one that a picture can have."""
    if not (1 <= width <= MAX_SIDE_PX and 1 <= height <= MAX_SIDE_PX and width * height <= MAX_PIXELS):
        raise refused(where, f"is {width} x {height} pixels; 1 to {MAX_SIDE_PX} a side, {MAX_PIXELS} in all are taken")


def check_array(
    array: npt.NDArray[np.generic], name: str, shape: tuple[int, ...], dtype: npt.DTypeLike, where: Path | str
) -> None:
    """Raise unless an array has this shape and type."""
    if array.shape != shape or array.dtype != dtype:
        raise refused(where, f"{name} is {array.dtype} {array.shape}, and should be {np.dtype(dtype)} {shape}")


def check_light(rgb: Floats, where: Path | str, factor: float | None = None) -> None:
    """Raise unless all values are finite and not negative; the message counts the wrong ones and names the first.

    ``rgb``: (H, W, 3). With a ``factor``, also where times it they are too large for sums, or all 0 and were not.
    """
    for top in range(0, rgb.shape[0], _ROWS):
        rows = rgb[top : top + _ROWS]
        # One pass in the good case: NaN and infinity both fail these two comparisons of the ends.
        if rows.size and rows.min() >= 0 and rows.max() < np.inf:
            continue
        wrong = ~(np.isfinite(rows) & (rows >= 0))
        y, x, channel = (int(v) for v in np.argwhere(wrong)[0])
        raise refused(
            where,
            f"rows {top} to {top + rows.shape[0] - 1} hold impossible light, {int(wrong.sum())} in all; the first, "
            f"{rows[y, x, channel]}, is {'RGB'[channel]} of the pixel in column {x}, row {top + y}",
        )
    most = float(rgb.max(initial=0)) or 1.0
    if factor is not None and not all(LEAST_LIGHT <= one <= 1 / LEAST_LIGHT for one in (most, factor, most * factor)):
        ends = f"{LEAST_LIGHT:g} to {1 / LEAST_LIGHT:g}"
        what = f"its brightest value, {rgb.max():g}, times {factor:g}: both, and what comes of it, are to be {ends}"
        raise refused(where, what, likely="a wrong unit, scale or exposure", advice="write it again in usual units")


def refused(where: Path | str, what: str, *, likely: str = "", advice: str = "") -> PictureFileError:
    """Return the error of a picture that is not taken."""
    return PictureFileError(what, where=str(where), likely=likely, advice=advice)


# Putting a picture file in its place whole or not at all, whatever library writes it.


def write_whole(path: Path, write: Callable[[Path], None]) -> None:
    """Let ``write`` fill a file of a temporary name in the same folder, then make it durable under its own name.

    Raises `DiskFullError` or `DiskError` (also for the `RuntimeError` by which libraries report a failed write).
    Whoever looks at ``path`` sees the old content or the new.
    """
    with durable.disk_errors(path, "writing"):
        folder = Folder.open(path.parent)
    temporary = part_name(path.name)
    with folder:
        try:
            with durable.disk_errors(path, "writing"):
                try:
                    write(path.with_name(temporary))
                except RuntimeError as error:
                    full = next((n for n in durable.FULL if os.strerror(n) in str(error)), None)
                    raise OSError(full or errno.EIO, os.strerror(full) if full else str(error)) from error
                with folder.opened(temporary) as fd:
                    durable.os_calls.fsync(fd)
                durable.os_calls.rename(temporary, path.name, src_dir_fd=folder.fd, dst_dir_fd=folder.fd)
            folder.sync()
        except BaseException:
            folder.remove(temporary)
            raise


def write_bytes(path: Path, data: bytes) -> None:
    """Write a small file in the same way."""
    with durable.disk_errors(path, "writing"):
        folder = Folder.open(path.parent)
    with folder:
        write_file(folder, path.name, data)


# Light and uncertainty to as many bits as are known of them: what stages hand on.

LIGHT_BITS = 13  # of a mantissa's 23, kept between stages: 6e-5 relative, a fiftieth of the best pixel's uncertainty
UNCERTAINTY_BITS = 5  # of a half's 10: an uncertainty to 1.6 % of itself (chosen; nobody knows one so well)
ESTIMATED_BITS = 10  # 5e-4 of light known to 2 % at best; its uncertainty is rounded upwards, by 3 % at most (chosen)
_ALL = np.ones(1, bool)
_LEAST_HALF, _MOST_HALF = np.float32(2.0**-14), np.float32(2.0**15)
"""Between these a half is exact to its bits; smaller uncertainties are no camera's, larger ones say nothing."""
P = TypeVar("P", bound=RelativeImage | LuminanceImage)


def handed_on(image: P, made: Flags | None = None, *, own: bool = False) -> P:
    """Return a picture as it goes from stage to stage: light to `LIGHT_BITS`, uncertainty to `UNCERTAINTY_BITS`.

    Where it was ``made`` (H, W) rather than photographed, it is as `estimated` says. ``own``: it may be rounded in
    place, where its arrays can be written.
    """
    return _in_bits(image, made, photographed=True, own=own)


def estimated(image: P, where: Flags, *, own: bool = False) -> P:
    """Return a picture with light to `ESTIMATED_BITS` ``where`` (H, W) it was estimated rather than photographed.

    ``own``: see `handed_on`.
    """
    return _in_bits(image, where, photographed=False, own=own)


def _in_bits(image: P, made: Flags | None, *, photographed: bool, own: bool) -> P:
    """Return a picture rounded where it was ``made`` (H, W), and, if asked, where it was ``photographed``."""
    given = (image.rgb, image.uncertainty) if own else (image.rgb.copy(), image.uncertainty.copy())
    rgb, uncertainty = (np.require(one, np.float32, ["C", "W"]) for one in given)

    def band(rows: slice) -> None:
        light, doubt = (one[rows].view(np.uint32) for one in (rgb, uncertainty))
        if made is not None:
            _round_bits(light.reshape(-1, 3), made[rows].ravel(), 23 - ESTIMATED_BITS, False)
            _round_bits(doubt.reshape(-1, 1), made[rows].ravel(), 23 - UNCERTAINTY_BITS, True)
        if photographed:
            some = uncertainty[rows]
            np.clip(some, _LEAST_HALF, _MOST_HALF, out=some, where=~np.isinf(some))
            _round_bits(light.reshape(1, -1), _ALL, 23 - LIGHT_BITS, False)
            _round_bits(doubt.reshape(1, -1), _ALL, 23 - UNCERTAINTY_BITS, False)

    side_by_side(band, bands(len(rgb), _BAND_ROWS))
    return replace(image, rgb=rgb, uncertainty=uncertainty)


@compiled
def _round_bits(raw: Any, chosen: Any, drop: int, up: bool) -> None:
    """Round, in place, the ``chosen`` (N,) of float32 values as bits, (N, C), so that their last ``drop`` are 0."""
    half, mask = np.uint32(1 << (drop - 1)) - np.uint32(1), np.uint32(0xFFFFFFFF ^ ((1 << drop) - 1))
    for n in range(raw.shape[0]):
        if chosen[n]:
            for c in range(raw.shape[1]):
                bits = raw[n, c]
                more = np.uint32((1 << drop) - 1) if up else half + ((bits >> np.uint32(drop)) & np.uint32(1))
                raw[n, c] = np.uint32(bits + more) & mask
