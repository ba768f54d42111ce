"""What an observer's eye meets, as files that Radiance's evalglare takes; and what evalglare says of them."""

from __future__ import annotations

import math
import subprocess
from pathlib import Path

from processing.errors import ProcessingError
from processing.images import LuminanceImage
from processing.light_figures.figures import DIRECTIONS
from processing.light_figures.views import eye_view
from processing.radiance_files import write_radiance_hdr

SIZE_PX = 1000
_TIMEOUT_S = 900.0


def write_glare_views(folder: Path, name: str, image: LuminanceImage, *, size_px: int = SIZE_PX) -> list[Path]:
    """Write a fisheye of 180 degrees for each direction of the light figures; return their paths in that order."""
    found = []
    for k in range(DIRECTIONS):
        degrees = 360 * k // DIRECTIONS
        path = folder / f"{name}_eye-{degrees:03d}.hdr"
        write_radiance_hdr(path, eye_view(image, math.radians(degrees), size_px))
        found.append(path)
    return found


def evalglare(tool: Path, view: Path) -> dict[str, float]:
    """Return evalglare's own figures of a view: dgp, dgi, ugr, vcp, cgi, veiling luminance (by its names).

    Raises `ProcessingError` where it gives none (its exit code says nothing).
    """
    try:
        done = subprocess.run([str(tool), str(view)], capture_output=True, text=True, timeout=_TIMEOUT_S, check=False)
        names, _, values = done.stdout.partition(":")
        found = dict(zip(names.split(","), (float(v) for v in values.split()), strict=False))
    except (OSError, subprocess.TimeoutExpired, ValueError) as error:
        raise ProcessingError(f"evalglare did not answer: {error}", where=view.name) from None
    if "dgp" not in found:
        raise ProcessingError(f"evalglare gave no dgp: {done.stderr.strip()[:200]}", where=view.name)
    return found
