"""The frames of one side of a session: from disk, decoded once and held while a stage works on them."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from processing.calibration.optics import stated_circle
from processing.calibration.outdoor.lens import find_image_circle
from processing.errors import BracketError, LensError, PictureFileError
from processing.ground.arrays import Bytes
from processing.ground.threads import side_by_side
from processing.pictures.frames import FrameSource, Reduce, frame_of, raw_frame
from processing.sphere import Equirectangular, Fisheye, Geometry, LensMapping
from station.session.session import DeviceRecord, FrameRecord, SessionManifest, Side

FramesAsked = Literal["auto", "raw", "jpeg"]
DECODERS = 2  # chosen: threads of a small computer
COARSE_PX = 800  # chosen: shows enough for a check
PANORAMA_CAMERAS = ("THETA", "INSTA360")  # in the model that EXIF names
USUAL_CIRCLE = (0.5, 0.5, 1 / 3)  # fills the height of the usual frame


@dataclass(frozen=True)
class SideBracket:
    """One camera's bracket as the session records it, longest time first."""

    side: Side
    records: tuple[FrameRecord, ...]
    frames: tuple[FrameSource, ...]
    device: DeviceRecord | None
    raw_refused: str = ""
    """Why the raw files that there are were not taken."""
    panoramas: tuple[FrameSource, ...] = ()
    """The camera's own, of raw frames that show its two lenses side by side; empty for others."""

    @property
    def linear(self) -> bool:
        """Whether the frames' codes are proportional to light."""
        return self.frames[0].linear

    @property
    def nominal_s(self) -> tuple[float, ...]:
        """Return the times the camera was set to."""
        return tuple(record.camera_s for record in self.records)

    @property
    def size_px(self) -> tuple[int, int]:
        """Return width and height."""
        return self.frames[0].size_px


def is_panorama_camera(device: DeviceRecord | None) -> bool:
    """Return whether a device is a camera of two lenses, by its model."""
    return device is not None and any(name in device.model.upper() for name in PANORAMA_CAMERAS)


def side_bracket(
    manifest: SessionManifest, session_path: Path, side: Side, frames: FramesAsked = "auto"
) -> SideBracket | None:
    """Return a side's frames, None where the session has none; ``frames``: raw files or what lies beside them.

    Raises `BracketError` for frames of different settings: only the time may differ within a bracket; and for raw
    files that were asked for and cannot be used (auto: then the others are).
    """
    pictures = sorted(manifest.pictures(side), key=lambda f: (-f.camera_s, f.stop))
    if not pictures:
        return None
    device = next((device for device in manifest.devices if device.role == side.value), None)
    raws = sorted((f for f in manifest.frames if f.side == side and f.is_raw), key=lambda f: (-f.camera_s, f.stop))
    refused = ""
    if frames == "raw" or (frames == "auto" and raws) or pictures[0].is_raw:
        try:
            return _raw_bracket(session_path, pictures, raws, device)
        except (PictureFileError, BracketError) as error:
            refused = str(error)
            if frames == "raw" or pictures[0].is_raw:
                raise BracketError(f"{side}: its raw files are unusable: {refused}", where=error.where) from error
    _check_settings(side, pictures)
    read = tuple(frame_of(session_path / record.file, record.file, coded=True) for record in pictures)
    return SideBracket(side, tuple(pictures), read, device, refused)


def _raw_bracket(
    session_path: Path, pictures: Sequence[FrameRecord], raws: Sequence[FrameRecord], device: DeviceRecord | None
) -> SideBracket:
    """Return the raw files beside pictures, where each has one that shows the same; or the raw files alone."""
    alone = [picture for picture in pictures if picture.stop not in {raw.stop for raw in raws}]
    if alone or len(raws) != len(pictures):
        what = f"{len(raws)} raw files beside {len(pictures)} pictures"
        raise BracketError(what, where=(alone or pictures)[0].file, advice="give each picture its raw file")
    _check_settings(pictures[0].side, raws)
    apart = is_panorama_camera(device)
    shown = () if pictures[0].is_raw else pictures
    beside = tuple(frame_of(session_path / one.file, one.file, coded=True) for one in shown)
    if apart and not beside:
        what = "its raw files show the lenses side by side, and no picture of the camera's shows where they look"
        raise BracketError(what, where=raws[0].file, advice="give the camera's JPEGs with them")
    size_px = beside[0].size_px if beside and not apart else None
    named = [(session_path / raw.file, raw.file, size_px) for raw in raws]
    longest = raw_frame(*named[0], None)
    frames = (longest, *(raw_frame(*one, longest.white) for one in named[1:]))
    for frame in frames:
        if not all(np.array_equal(a, b) for a, b in zip(frame.colours, frames[0].colours, strict=True)):
            raise BracketError("its colours are not those of the first raw file", where=frame.name)
    return SideBracket(pictures[0].side, tuple(raws), frames, device, panoramas=beside if apart else ())


def _check_settings(side: Side, records: Sequence[FrameRecord]) -> None:
    for name in ("iso", "f_number"):
        values = {getattr(record, name) for record in records} - {None}
        if len(values) > 1:
            text = f"{side}: frames of different {name}: {', '.join(map(str, sorted(values)))}"
            likely = "a setting was changed, or frames of two brackets"
            advice = "capture the bracket anew, or leave frames out when importing"
            raise BracketError(text, where=records[0].file, likely=likely, advice=advice)


def decoded(frames: Sequence[FrameSource], reduce: Reduce = 1) -> list[Bytes]:
    """Return the codes of 8-bit frames, (H, W, 3) uint8 sRGB each, in order; decoded by a few threads."""
    return side_by_side(lambda frame: np.asarray(frame.decode(reduce), dtype=np.uint8), frames, DECODERS)


def coarse(frames: Sequence[FrameSource]) -> Reduce:
    """Return by how much frames can be reduced and still show enough for a check."""
    width_px = frames[0].size_px[0]
    factors: tuple[Reduce, ...] = (8, 4, 2)
    return next((factor for factor in factors if width_px // factor >= COARSE_PX), 1)


def merge_geometry(bracket: SideBracket, rig: dict[str, object]) -> Geometry:
    """Return what the camera's picture shows before calibration: a panorama, or a circle of which only the size counts.

    A fisheye's mapping and field are those of the common lens until the stage calibrate puts the lens in. Indoor frames
    with an image circle are a fisheye's at the eye. An outdoor picture of a panorama camera, twice as wide as high, is
    a panorama, taken from behind the glass.
    """
    width_px, height_px = bracket.size_px
    circle = stated_circle(rig, bracket.side) or USUAL_CIRCLE
    if bracket.side is Side.OUTDOOR:
        whole = width_px == 2 * height_px and is_panorama_camera(bracket.device)
    elif not (whole := abs(width_px / height_px - 2) <= 0.1):  # chosen: far more than lost rows
        try:
            find_image_circle([frame.decode(coarse(bracket.frames)) for frame in bracket.frames])
        except LensError:
            whole = True
    if whole:
        return Equirectangular(width_px, height_px)
    centre_px = (circle[0] * width_px, circle[1] * height_px)
    return Fisheye(width_px, height_px, LensMapping.EQUIDISTANT, circle[2] * width_px, centre_px=centre_px)
