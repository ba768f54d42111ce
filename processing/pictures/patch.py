"""What makes a picture of another: the pixels in which they differ, a fiftieth of the bytes of one more picture."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from processing.pictures.exr import read_exr
from processing.pictures.images import LuminanceImage, RelativeImage
from processing.pictures.writing import P


def write_patch(path: Path, image: LuminanceImage, before: LuminanceImage) -> None:
    """Write those pixels of a picture in which its light is not that of the picture ``before``."""
    changed = (image.rgb != before.rgb).any(axis=2)
    parts = {name: getattr(image, name)[changed] for name in ("rgb", "uncertainty", "validity")}
    with path.open("wb") as file:
        np.savez_compressed(file, where=np.packbits(changed), **parts)


def patched(before: P, path: Path | None) -> P:
    """Return the picture that `write_patch` was given, of the one ``before``; that itself where there is no patch."""
    if path is None:
        return before
    with np.load(path) as kept:
        where = np.unpackbits(kept["where"], count=before.validity.size).view(bool).reshape(before.validity.shape)
        parts = {name: getattr(before, name).copy() for name in ("rgb", "uncertainty", "validity")}
        for name, values in parts.items():
            values[where] = kept[name]
    return replace(before, **parts)


def read_shown(path: Path) -> LuminanceImage | RelativeImage:
    """Return a picture of a session as it is shown: the emptied room in its own sun, where that is known."""
    sun = path.parents[1] / "materials" / "sun.npz"
    own = (path.parent.name, path.name) == ("remove", "empty.exr") and sun.is_file()
    return patched(read_exr(path), sun if own else None)
