"""The truth of a simulated room, read back from the files that `mocks.rooms.truth` wrote."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import OpenEXR

from mocks.rooms.truth import (
    COUNTED_FROM_0,
    FORMAT,
    LIGHT,
    MASKS,
    NUMBERS,
    TRUTH_NAME,
    PointLight,
    TruthFileError,
    TruthPictures,
)
from processing.ground.arrays import AnyArray, Floats


@dataclass(frozen=True)
class Truth:
    """What `save_truth` wrote: ``facts`` is truth.json without the lights."""

    facts: dict[str, Any]
    lights: tuple[PointLight, ...]
    pictures: TruthPictures


def load_truth(folder: Path) -> Truth:
    """Read the truth of a room.

    Raises
    ------
    TruthFileError
        A file is missing or damaged.
    """
    try:
        facts = json.loads((folder / TRUTH_NAME).read_text("utf-8"))
        if facts.pop("format") != FORMAT:
            raise TruthFileError(f"is not of format {FORMAT}", where=str(folder), advice="make it anew")
        lights = tuple(_point_light(values) for values in facts.pop("point_lights"))
        found: dict[str, Any] = {name: _read_exr(folder / file) for name, file in LIGHT.items()}
        for name, file in NUMBERS.items():
            stored = _read_png(folder / file).astype(np.int16)
            found[name] = stored if name in COUNTED_FROM_0 else stored - np.int16(1)
        found |= {name: _read_png(folder / file) > 0 for name, file in MASKS.items()}
        return Truth(facts, lights, TruthPictures(surface_names=tuple(facts["surface_names"]), **found))
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RuntimeError) as error:
        raise TruthFileError(f"cannot be read ({error!r})", where=str(folder), advice="make it anew") from error


def _point_light(values: dict[str, Any]) -> PointLight:
    return PointLight(values["name"], tuple(values["point_m"]), tuple(values["normal"]), values["illuminance_lx"])


def _read_exr(path: Path) -> Floats:
    with OpenEXR.File(os.fspath(path)) as file:
        channels = file.channels()
        channel = channels["RGB"] if "RGB" in channels else channels["Y"]
        return np.array(channel.pixels, dtype=np.float32)


def _read_png(path: Path) -> AnyArray:
    data = np.fromfile(path, np.uint8)
    # OpenCV's own error for no bytes at all is nobody's to expect.
    picture = cv2.imdecode(data, cv2.IMREAD_UNCHANGED) if data.size else None
    if picture is None or picture.ndim != 2:
        raise ValueError(f"{path.name} is no grey PNG")
    return np.asarray(picture)
