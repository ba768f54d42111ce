"""The truth of a simulated room on disk: pictures as OpenEXR and PNG, everything else in truth.json."""

from __future__ import annotations

import json
import os
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from drivers.errors import DaylitError
from mocks.rooms.room import Room
from mocks.rooms.truth import PointLight, TruthPictures, description, point_lights, truth_pictures
from mocks.rooms.world import RoomWorld
from processing.ground.arrays import Floats

FORMAT = 1
TRUTH_NAME = "truth.json"
LIGHT = {
    "luminance_rgb": "luminance.exr",
    "empty_rgb": "empty_luminance.exr",
    "albedo": "albedo.exr",
    "empty_albedo": "empty_albedo.exr",
    "depth_m": "depth.exr",
    "normal": "normal.exr",
    "sunlit": "sunlit.exr",
    "empty_sunlit": "empty_sunlit.exr",
}
"""Pictures of 32-bit floats, by field of `TruthPictures`: channels R, G, B, or Y alone."""
NUMBERS = {"ade": "ade.png", "instance": "instance.png", "wall": "wall.png", "surface": "surface.png"}
"""16-bit PNG. All but instances are stored plus 1, so that 0 stands for none (-1)."""
MASKS = {"furniture": "furniture.png", "tripod": "tripod.png"}
"""8-bit PNG, 0 or 255."""
_COUNTED_FROM_0 = ("instance",)

Picture = npt.NDArray[Any]


class TruthFileError(DaylitError):
    """The truth of a simulated room cannot be written, or what is there is not whole."""

    code = "SIM-004"
    exit_code = 6


@dataclass(frozen=True)
class Truth:
    """What `save_truth` wrote: ``facts`` is truth.json without the lights."""

    facts: dict[str, Any]
    lights: tuple[PointLight, ...]
    pictures: TruthPictures


def make_truth(world: RoomWorld, folder: Path, rows: int = 512) -> None:
    """Work out the truth of a room, pictures (rows, 2 rows), and save it; takes some seconds to minutes."""
    save_truth(folder, world.room, truth_pictures(world, rows), point_lights(world.room))


def save_truth(folder: Path, room: Room, pictures: TruthPictures, lights: list[PointLight]) -> None:
    """Write the truth into a new folder.

    Raises
    ------
    TruthFileError
        The folder is there already or may not be written, or the disk is full.
    """
    try:
        folder.mkdir(parents=True)
        _write(folder, room, pictures, lights)
    except (OSError, RuntimeError) as error:
        text = f"cannot be written ({getattr(error, 'strerror', None) or error})"
        raise TruthFileError(text, where=str(folder), advice="make room, or choose another folder") from error


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
            found[name] = stored if name in _COUNTED_FROM_0 else stored - np.int16(1)
        found |= {name: _read_png(folder / file) > 0 for name, file in MASKS.items()}
        return Truth(facts, lights, TruthPictures(surface_names=tuple(facts["surface_names"]), **found))
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RuntimeError) as error:
        raise TruthFileError(f"cannot be read ({error!r})", where=str(folder), advice="make it anew") from error


def _write(folder: Path, room: Room, pictures: TruthPictures, lights: list[PointLight]) -> None:
    for name, file in LIGHT.items():
        _write_exr(folder / file, getattr(pictures, name))
    for name, file in NUMBERS.items():
        values = getattr(pictures, name)
        stored = values if name in _COUNTED_FROM_0 else values + np.int16(1)
        _write_png(folder / file, stored.astype(np.uint16))
    for name, file in MASKS.items():
        _write_png(folder / file, getattr(pictures, name).astype(np.uint8) * np.uint8(255))
    facts = {
        "format": FORMAT,
        **description(room),
        "seed": room.seed,
        "point_lights": [asdict(light) for light in lights],
        "surface_names": pictures.surface_names,
        "rows": pictures.ade.shape[0],
        "pictures": {**LIGHT, **NUMBERS, **MASKS},
    }
    (folder / TRUTH_NAME).write_text(json.dumps(facts, indent=1, allow_nan=False) + "\n", "utf-8")


def _point_light(values: dict[str, Any]) -> PointLight:
    return PointLight(values["name"], tuple(values["point_m"]), tuple(values["normal"]), values["illuminance_lx"])


def _write_exr(path: Path, picture: Floats) -> None:
    import OpenEXR

    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    channel = "Y" if picture.ndim == 2 else "RGB"
    OpenEXR.File(header, {channel: np.ascontiguousarray(picture, dtype=np.float32)}).write(os.fspath(path))


def _read_exr(path: Path) -> Floats:
    import OpenEXR

    with OpenEXR.File(os.fspath(path)) as file:
        channels = file.channels()
        channel = channels["RGB"] if "RGB" in channels else channels["Y"]
        return np.array(channel.pixels, dtype=np.float32)


def _write_png(path: Path, picture: Picture) -> None:
    import cv2

    whole, data = cv2.imencode(".png", picture)
    if not whole:
        raise OSError("the picture cannot be encoded")
    path.write_bytes(data.tobytes())


def _read_png(path: Path) -> Picture:
    import cv2

    data = np.fromfile(path, np.uint8)
    # OpenCV's own error for no bytes at all is nobody's to expect.
    picture = cv2.imdecode(data, cv2.IMREAD_UNCHANGED) if data.size else None
    if picture is None or picture.ndim != 2:
        raise ValueError(f"{path.name} is no grey PNG")
    return np.asarray(picture)
