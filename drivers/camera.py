"""What every camera can do, and the small types that camera drivers, capture and tests share.

A camera driver is synchronous and single-threaded: one thread owns one camera. A frame is taken in steps so that
the owner can put transfers of earlier frames behind a running exposure::

    camera.prepare(settings)                  # once: everything but the shutter, read back
    camera.set_shutter(1 / 60)                # per stop, read back
    camera.arm()                              # optional: whatever can be done before the moment of release
    camera.release()                          # returns when the camera has accepted the release
    while not camera.poll_exposure().done:    # never blocks longer than about 50 ms
        ...                                   # read_chunk() of an earlier frame, if can_transfer_while_exposing
    frame = progress.frames[0]
    camera.read_chunk(frame, offset, max_bytes)   # until frame.size_bytes are read
    camera.finish_frame(frame)                # the camera may forget the frame: it is safe with us
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from enum import StrEnum
from typing import Protocol, TypeVar, runtime_checkable

T = TypeVar("T")


class FrameFormat(StrEnum):
    """File format of a frame as the camera gives it."""

    JPEG = "jpeg"
    CR2 = "cr2"
    DNG = "dng"


@dataclass(frozen=True)
class CameraIdentity:
    """Who the camera says it is. Text from the device: never used as a path."""

    manufacturer: str
    model: str
    serial: str
    firmware: str


@dataclass(frozen=True)
class CameraSettings:
    """Everything of a bracket that stays the same from stop to stop.

    ``width_px``/``height_px`` are the asked picture size; ``keep_raw`` asks for CR2/DNG beside the JPEG.
    """

    iso: int
    f_number: float
    color_temperature_k: int
    width_px: int
    height_px: int
    keep_raw: bool = False


@dataclass(frozen=True)
class SettingReadback:
    """One setting as asked and as the camera then reported it (``raw`` is the value on the wire)."""

    name: str
    asked: str
    got: str
    raw: str

    @property
    def honoured(self) -> bool:
        """Whether the camera took exactly what was asked."""
        return self.asked == self.got


NOT_REPORTED = "not reported"  # of a setting of the body that the camera says nothing of


class Verdict(StrEnum):
    """What becomes of a setting of the body that no rig file sets."""

    OK = "ok"
    SET = "set"
    """It was changed to what a bracket needs."""
    RECORDED = "recorded"
    """It may be what it is; the session keeps it."""
    REFUSED = "refused"
    """It spoils a bracket, and only a person at the camera can change it."""


@dataclass(frozen=True)
class BodySetting:
    """One setting of the body as it now is, and what becomes of it; ``reason`` says why it is set or refused."""

    name: str
    got: str
    raw: str
    verdict: Verdict
    reason: str = ""


@dataclass(frozen=True)
class ShutterReadback:
    """Exposure time asked, and the nearest the camera has, as read back (nominal, seconds)."""

    asked_s: float
    nominal_s: float
    raw: str


def nearest_time(shutter_s: float, times_s: Mapping[T, float]) -> T:
    """Return the key whose time, seconds, is nearest to ``shutter_s`` (> 0 s) on the scale of stops.

    Raises `ValueError`: ``shutter_s`` is no positive time, or there is nothing to choose from.
    """
    if not times_s or not (shutter_s > 0 and math.isfinite(shutter_s)):
        raise ValueError(f"no shutter time for {shutter_s!r} s among {len(times_s)}")
    return min(times_s, key=lambda key: abs(math.log2(times_s[key] / shutter_s)))


@dataclass(frozen=True)
class CameraStatus:
    """State before a bracket; ``None`` where the camera does not say."""

    battery_frac: float | None
    free_bytes: int | None
    free_frames: int | None
    clock_utc: datetime | None
    ready: bool
    problems: tuple[str, ...] = ()
    """Things that forbid a capture, in words."""
    warnings: tuple[str, ...] = ()
    """Things worth a warning, in words."""


@dataclass(frozen=True)
class FrameRef:
    """A frame on the camera. ``name`` is the camera's own file name: text, never a path."""

    handle: int
    name: str
    format: FrameFormat
    size_bytes: int
    storage_id: int = 0


@dataclass(frozen=True)
class ExposureProgress:
    """Answer of one poll: the frames announced so far, and whether the exposure is over and all are announced."""

    done: bool
    frames: tuple[FrameRef, ...] = field(default=())


@runtime_checkable
class Camera(Protocol):
    """A camera that takes brackets. All methods raise `drivers.errors.DeviceError` kinds and nothing else.

    ``kind``: ``"theta_z1"`` or ``"canon_5d2"``.
    ``shutter_times_s``: nominal exposure times the camera offers, longest first; known after `connect`.
    ``can_transfer_while_exposing``: whether ``read_chunk`` may be called while an exposure runs. Drivers start
      optimistic and set it to False when the camera answers "busy" to a transfer during an exposure.
    ``holds_pictures``: whether it keeps each picture in its memory and is busy until `finish_frame` (no card).
    ``release_lag_s``: time from ``release`` to the shutter opening, as the driver knows it; a rig file may override
      it.
    """

    kind: str
    shutter_times_s: tuple[float, ...]
    can_transfer_while_exposing: bool
    holds_pictures: bool
    release_lag_s: float

    def connect(self) -> CameraIdentity:
        """Open the link and the session, wake the camera, clear what an earlier crash left behind."""

    def status(self) -> CameraStatus:
        """Return battery, space, clock and mode."""

    def prepare(self, settings: CameraSettings) -> tuple[SettingReadback, ...]:
        """Make all fixed settings and read each back; `SettingRefusedError` where one does not take."""

    def body_settings(self) -> tuple[BodySetting, ...]:
        """Read the settings of the body that no rig file sets, after `prepare`; set those with one right value."""

    def set_shutter(self, shutter_s: float) -> ShutterReadback:
        """Set the nearest exposure time the camera has and read it back."""

    def arm(self) -> None:
        """Do whatever may be done before the moment of release (drain events, half press)."""

    def stand_down(self) -> None:
        """Undo `arm`: let go of the button."""

    def release(self) -> None:
        """Open the shutter; return when the camera has accepted."""

    def poll_exposure(self) -> ExposureProgress:
        """Look for the frames of the running exposure; returns within about 50 ms."""

    def read_chunk(self, frame: FrameRef, offset: int, max_bytes: int) -> bytes:
        """Return up to ``max_bytes`` of the frame from ``offset``; `DeviceBusyError` if it cannot just now."""

    def finish_frame(self, frame: FrameRef) -> None:
        """Let the camera know that the frame is safe on our side (nothing to do on some)."""

    def delete(self, frame: FrameRef) -> None:
        """Delete the frame from the camera's store."""

    def list_frames(self) -> tuple[FrameRef, ...]:
        """Return the frames on the camera's store, oldest first (to find what a lost event announced)."""

    def keep_alive(self) -> None:
        """Keep the camera from falling asleep; cheap, call every few seconds while idle."""

    def recover(self) -> None:
        """Resynchronise after an error: drain, cancel, reset, reconnect; raise what remains broken."""

    def close(self) -> None:
        """Leave the camera usable by its own buttons and release the link; never raises."""
