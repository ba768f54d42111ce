"""What every picture must hold before it is written and after it is read: shapes, types, finite light, known codes."""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import numpy.typing as npt

from processing.errors import PictureFileError
from processing.ground.arrays import Floats
from processing.pictures.images import LuminanceImage, RelativeImage, Validity
from station.session import durable
from station.session.folder import Folder, part_name, write_file

MAX_PIXELS = 1 << 28  # a picture of the whole sphere at 1 arc minute; more is a damaged header, or a bomb
MAX_SIDE_PX = 1 << 16  # chosen

_ROWS = 256  # rows looked at in one go, so that checks need little memory beside the picture


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
        raise refused(where, f"validity {int(image.validity.max())} is no known code (0 to {int(max(Validity))})")
    if isinstance(image, LuminanceImage) and not (
        math.isfinite(image.scale_uncertainty) and image.scale_uncertainty >= 0
    ):
        raise refused(where, f"scale_uncertainty is {image.scale_uncertainty}, not a finite number from 0 up")


def check_size(width: int, height: int, where: Path | str) -> None:
    """Raise unless the size is one that a picture can have."""
    if not (1 <= width <= MAX_SIDE_PX and 1 <= height <= MAX_SIDE_PX and width * height <= MAX_PIXELS):
        raise refused(
            where, f"is {width} x {height} pixels; 1 to {MAX_SIDE_PX} a side and {MAX_PIXELS} in all are taken"
        )


def check_array(
    array: npt.NDArray[np.generic], name: str, shape: tuple[int, ...], dtype: npt.DTypeLike, where: Path | str
) -> None:
    """Raise unless an array has this shape and type."""
    if array.shape != shape or array.dtype != dtype:
        wanted = f"{np.dtype(dtype)} {shape}"
        raise refused(where, f"{name} is {array.dtype} {array.shape}, and should be {wanted}")


def check_light(rgb: Floats, where: Path | str) -> None:
    """Raise unless all values are finite and not negative; the message counts the wrong ones and names the first.

    ``rgb``: (H, W, 3).
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
            f"{int(wrong.sum())} values in rows {top} to {top + rows.shape[0] - 1} are no light; the first, "
            f"{rows[y, x, channel]}, is {'RGB'[channel]} of the pixel in column {x}, row {top + y}",
        )


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
    try:
        with durable.disk_errors(path, "writing"):
            try:
                write(path.with_name(temporary))
            except RuntimeError as error:
                raise OSError(5, str(error)) from error
            fd = durable.os_calls.open(temporary, os.O_RDONLY, dir_fd=folder.fd)
            try:
                durable.os_calls.fsync(fd)
            finally:
                os.close(fd)
            durable.os_calls.rename(temporary, path.name, src_dir_fd=folder.fd, dst_dir_fd=folder.fd)
        folder.sync()
    except BaseException:
        folder.remove(temporary)
        raise
    finally:
        folder.close()


def write_bytes(path: Path, data: bytes) -> None:
    """Write a small file in the same way."""
    with durable.disk_errors(path, "writing"):
        folder = Folder.open(path.parent)
    try:
        write_file(folder, path.name, data)
    finally:
        folder.close()
