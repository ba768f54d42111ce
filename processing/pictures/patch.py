"""What makes a picture of another: the pixels in which they differ; a few percent of another picture's bytes."""

import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from processing.errors import PictureFileError
from processing.pictures.exr import read_exr
from processing.pictures.images import LuminanceImage, RelativeImage
from processing.pictures.writing import P


def write_patch(path: Path, image: LuminanceImage, before: LuminanceImage) -> None:
    """Write those pixels of a picture in which its light is not that of the picture ``before``."""
    changed = np.logical_or.reduce([image.rgb[..., k] != before.rgb[..., k] for k in range(3)])
    parts = {name: getattr(image, name)[changed] for name in ("rgb", "uncertainty", "validity")}
    with path.open("wb") as file:
        np.savez_compressed(file, where=np.packbits(changed), before=before.rgb[changed], **parts)


def patched(before: P, path: Path | None, *, own: bool = False) -> P:
    """Return the picture that `write_patch` was given; ``before`` itself without a patch, or if it is of another.

    ``own``: ``before`` may be written into, where its arrays can be.
    """
    if path is None:
        return before
    try:
        with path.open("rb") as opened, np.load(opened) as file:
            kept = dict(file)
    except (OSError, ValueError, EOFError, zipfile.BadZipFile) as error:
        raise PictureFileError(f"not a patch: {error}", where=path.name, advice="rerun --force materials") from error
    where = np.unpackbits(kept["where"]).view(bool)[: before.validity.size]
    if where.size < before.validity.size or not np.array_equal(before.rgb.reshape(-1, 3)[where], kept["before"]):
        return before
    parts = {name: getattr(before, name) for name in ("rgb", "uncertainty", "validity")}
    parts = {name: np.require(values if own else values.copy(), requirements="W") for name, values in parts.items()}
    for name, values in parts.items():
        values[where.reshape(before.validity.shape)] = kept[name]
    return replace(before, **parts)


def read_shown(path: Path) -> LuminanceImage | RelativeImage:
    """Return a picture of a session as it is shown: the emptied room in its own sun, where that is known."""
    sun = path.parents[1] / "materials" / "sun.npz"
    return patched(read_exr(path), sun if path.parts[-2:] == ("remove", "empty.exr") and sun.is_file() else None)
