"""The frames of one side of a session: from disk, decoded once and held while a stage works on them."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from processing.calibration.optics import stated_circle
from processing.errors import BracketError
from processing.ground.arrays import Bytes
from processing.pictures.frames import FrameSource, Reduce, frame_of
from processing.sphere import Equirectangular, Fisheye, Geometry, LensMapping
from station.session.session import DeviceRecord, FrameRecord, SessionManifest, Side

DECODERS = 2
COARSE_PX = 800
PANORAMA_CAMERAS = ("THETA", "INSTA360")
"""In the model that EXIF names."""
USUAL_CIRCLE = (0.5, 0.5, 1 / 3)
"""Fills the height of the usual frame."""


@dataclass(frozen=True)
class SideBracket:
    """One camera's bracket as the session records it, longest time first."""

    side: Side
    records: tuple[FrameRecord, ...]
    frames: tuple[FrameSource, ...]
    device: DeviceRecord | None

    @property
    def nominal_s(self) -> tuple[float, ...]:
        """Return the times the camera was set to."""
        return tuple(record.camera_s for record in self.records)

    @property
    def size_px(self) -> tuple[int, int]:
        """Return width and height."""
        return self.frames[0].size_px


def side_bracket(manifest: SessionManifest, session_path: Path, side: Side) -> SideBracket | None:
    """Return a side's pictures (JPEG, PNG, TIFF), None where the session has none.

    Raises `BracketError` for frames of different settings: only the time may differ within a bracket.
    """
    found = [frame for frame in manifest.frames if frame.side == side and not frame.is_raw]
    if not found:
        return None
    records = tuple(sorted(found, key=lambda frame: frame.stop))
    for name in ("iso", "f_number"):
        values = {getattr(record, name) for record in records} - {None}
        if len(values) > 1:
            raise BracketError(
                f"{side}: frames of different {name}: {', '.join(map(str, sorted(values)))}",
                where=records[0].file,
                likely="a setting was changed, or frames of two brackets",
                advice="capture the bracket anew, or leave frames out when importing",
            )
    device = next((device for device in manifest.devices if device.role == side.value), None)
    frames = tuple(frame_of(session_path / record.file, record.file) for record in records)
    return SideBracket(side, records, frames, device)


def decoded(frames: Sequence[FrameSource], reduce: Reduce = 1) -> list[Bytes]:
    """Return the codes of 8-bit frames, (H, W, 3) uint8 sRGB each, in order; decoded by a few threads."""
    with ThreadPoolExecutor(DECODERS) as pool:
        return list(pool.map(lambda frame: np.asarray(frame.decode(reduce), dtype=np.uint8), frames))


def coarse(frames: Sequence[FrameSource]) -> Reduce:
    """Return by how much frames can be reduced and still show enough for a check."""
    width_px = frames[0].size_px[0]
    factors: tuple[Reduce, ...] = (8, 4, 2)
    return next((factor for factor in factors if width_px // factor >= COARSE_PX), 1)


def merge_geometry(bracket: SideBracket, rig: dict[str, object]) -> Geometry:
    """Return what the camera's picture shows before calibration: a panorama, or a circle of which only the size counts.

    The outdoor mapping and field are those of the common fisheye lens until the stage calibrate puts the lens in. An
    outdoor picture of a panorama camera, twice as wide as high, is a panorama, taken from behind the glass.
    """
    width_px, height_px = bracket.size_px
    model = bracket.device.model.upper() if bracket.device else ""
    if bracket.side is Side.INDOOR or (width_px == 2 * height_px and any(name in model for name in PANORAMA_CAMERAS)):
        return Equirectangular(width_px, height_px)
    circle = stated_circle(rig) or USUAL_CIRCLE
    centre_px = (circle[0] * width_px, circle[1] * height_px)
    return Fisheye(width_px, height_px, LensMapping.EQUIDISTANT, circle[2] * width_px, centre_px=centre_px)
