"""One camera's bracket of a session: frames, times, settings, and the geometry of its pictures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

import numpy as np
import numpy.typing as npt

from processing.calibration.optics import stated_circle
from processing.calibration.outdoor.lens import ImageCircle, LensModel, find_image_circle
from processing.calibration.profile import CameraState, camera_state
from processing.calibration.profile_records import ShutterRecord
from processing.calibration.response.samples import Bracket8
from processing.calibration.scale.chart import ChartView
from processing.calibration.scale.chart_patches import WHITE, WINDOW, chart_points, homography
from processing.errors import BracketError, LensError
from processing.ground.arrays import Bytes
from processing.pictures.frames import FrameSource, frame_of
from processing.sphere import LensMapping
from station.session.session import FrameRecord, MeterTarget, ReadingRecord, Side
from station.session.store import load_manifest


@dataclass(frozen=True)
class SessionSide:
    """What one camera took in one session; frames in the order of their stops, longest first."""

    path: Path
    side: Side
    session_id: str
    created_utc: datetime
    records: tuple[FrameRecord, ...]
    state: CameraState
    target: MeterTarget | None
    readings: tuple[ReadingRecord, ...]
    circle_frac: tuple[float, float, float] | None
    """The image circle that the rig file states: centre and radius as fractions of width, height and width."""

    @property
    def nominal_s(self) -> tuple[float, ...]:
        """Return the times the camera was set to."""
        return tuple(record.camera_s for record in self.records)

    def true_times_s(self, shutter: ShutterRecord) -> tuple[float, ...]:
        """Return the times that the frames were open."""
        return tuple(shutter.true_s(nominal) for nominal in self.nominal_s)

    def sources(self) -> list[FrameSource]:
        """Return the frames, not yet decoded."""
        return [frame_of(self.path / record.file, record.file) for record in self.records]

    def bracket(self, times_s: Sequence[float]) -> Bracket8:
        """Return the decoded frames (uint8 RGB) with their times."""
        return Bracket8([np.asarray(source.decode(), dtype=np.uint8) for source in self.sources()], times_s)

    @property
    def size_px(self) -> tuple[int, int]:
        """Return width and height."""
        return self.sources()[0].size_px


def read_side(path: Path, side: Side) -> SessionSide | None:
    """Return one camera's bracket of a session, None where it took none.

    Raises
    ------
    SessionError
        No session there, or one that cannot be read.
    BracketError
        Fewer than two frames.
    """
    manifest = load_manifest(path)
    records = sorted(
        (f for f in manifest.frames if f.side is side and not f.is_raw), key=lambda f: f.camera_s, reverse=True
    )
    if not records:
        return None
    if len(records) < 2:
        raise BracketError(f"only one {side} frame", where=str(path), advice="capture a bracket of several times")
    device = next((d for d in manifest.devices if d.role == side.value), None)
    return SessionSide(
        path=path,
        side=side,
        session_id=manifest.session_id,
        created_utc=manifest.created_utc,
        records=tuple(records),
        state=camera_state(device, records),
        target=manifest.target,
        readings=manifest.readings,
        circle_frac=stated_circle(manifest.rig) if side is Side.OUTDOOR else None,
    )


def outdoor_lens(side: SessionSide, frames: Sequence[npt.NDArray[np.uint8]], half_field_rad: float) -> LensModel:
    """Return the fisheye: its circle as the frames show it, else as the rig file states it; an equisolid mapping.

    ``frames``: (H, W, 3) uint8 each.

    Raises
    ------
    LensError
        No circle is seen, and none is stated.
    """
    try:
        circle = find_image_circle(list(frames))
        source = "image circle found in the frames"
    except LensError:
        if side.circle_frac is None:
            raise
        x, y, radius = side.circle_frac
        wide, high = side.size_px
        circle = ImageCircle((x * wide, y * high), radius * wide, (wide, high), support=0.0)
        source = "image circle of the rig file"
    return LensModel(LensMapping.EQUISOLID, circle, half_field_rad, source=f"equisolid; {source}")


_CORNER = np.array(((-1, -1), (1, -1), (1, 1), (-1, 1))) * WINDOW / 2


def chart_png(found: ChartView) -> bytes:
    """Return a PNG by which a person can check the chart.

    White stands at 90 %; the windows that were averaged are outlined, the white patch's in red.
    """
    import cv2

    picture = _shown(found)
    mapping = homography(found.chart.corners_px)
    width = max(1, picture.shape[1] // 600)
    middles = chart_points(mapping, 0.0, 1)[:, 0]
    for number in range(24):
        window = np.array((number % 6 + 0.5, number // 6 + 0.5)) + _CORNER
        flat = np.column_stack([window, np.ones(4)]) @ mapping.T
        outline = np.rint(flat[:, :2] / flat[:, 2:]).astype(np.int32)
        colour = (0, 0, 255) if number == WHITE else (0, 255, 0)
        cv2.polylines(picture, [outline[:, None]], True, colour, width, cv2.LINE_AA)
    x, y = middles[WHITE]
    cv2.putText(picture, "white", (int(x), int(y)), cv2.FONT_HERSHEY_SIMPLEX, 0.4 * width, (0, 0, 255), width)
    done, data = cv2.imencode(".png", picture)
    assert done
    return bytes(data)


def _shown(found: ChartView) -> Bytes:
    """Return the view in 8 bits, blue first as cv2 wants it."""
    white = max(float(found.chart.rgb[WHITE].mean()), 1e-30)
    values = 0.9 * np.clip(found.view.rgb / np.float32(white), 0, 1 / 0.9)
    return np.ascontiguousarray((255 * values ** (1 / 2.2))[..., ::-1].astype(np.uint8))
