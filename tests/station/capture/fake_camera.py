"""A camera that follows `drivers.camera.Camera` without a wire: for tests of the capture itself.

Failures are a mapping from (method, nth call, counted from 1) to the error to raise there.
"""

from __future__ import annotations

import io
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import datetime

import numpy as np
from PIL import Image
from PIL.TiffImagePlugin import IFDRational

from drivers.camera import (
    BodySetting,
    CameraIdentity,
    CameraSettings,
    CameraStatus,
    ExposureProgress,
    FrameFormat,
    FrameRef,
    SettingReadback,
    ShutterReadback,
)
from drivers.clock import Clock
from drivers.errors import DeviceBusyError, DeviceError

SIZE = (96, 48)


def make_jpeg(
    shutter_s: float, *, iso: int, f_number: float, taken: datetime, gain: float = 30.0, seed: int = 0
) -> bytes:
    """Return a small JPEG of a ramp of light, exposed for ``shutter_s``, with EXIF."""
    light = np.geomspace(1e-3, 1e3, SIZE[0])[None, :] * np.ones((SIZE[1], 1))
    values = np.clip(255 * (light * shutter_s * gain) ** (1 / 2.2), 0, 255)
    noise = np.random.default_rng(seed).normal(0, 2, values.shape)
    pixels = np.clip(values + noise * (values > 3), 0, 255).astype(np.uint8)
    image = Image.fromarray(np.repeat(pixels[..., None], 3, axis=2))
    exif = Image.Exif()
    exif[0x0110] = "Fake"
    details = exif.get_ifd(0x8769)
    details[0x829A] = IFDRational(round(shutter_s * 1_000_000), 1_000_000)
    details[0x829D] = IFDRational(round(f_number * 10), 10)
    details[0x8827] = iso
    details[0x9003] = taken.strftime("%Y:%m:%d %H:%M:%S")
    exif[0x8769] = details
    buffer = io.BytesIO()
    image.save(buffer, "JPEG", quality=92, exif=exif)
    return buffer.getvalue()


@dataclass
class FakeCamera:
    """One simulated camera; times in seconds of its clock."""

    clock: Clock
    kind: str = "theta_z1"
    release_lag_s: float = 0.0
    readout_s: float = 0.02
    overlaps: bool = True
    chunk_bytes: int = 1000
    chunk_s: float = 0.0
    gain: float = 30.0
    failures: dict[tuple[str, int], DeviceError] = field(default_factory=dict)
    spoil: Callable[[int, float, bytes], bytes] = lambda shot, shutter_s, data: data
    shutter_times_s: tuple[float, ...] = (4, 1, 1 / 4, 1 / 15, 1 / 60, 1 / 250, 1 / 1000, 1 / 4000, 1 / 8000)
    can_transfer_while_exposing: bool = True
    holds_pictures: bool = False
    calls: Counter[str] = field(default_factory=Counter)
    opened_s: list[tuple[float, float]] = field(default_factory=list)
    safe: list[int] = field(default_factory=list)
    deleted: list[int] = field(default_factory=list)
    recovered: int = 0
    closed: bool = False

    def __post_init__(self) -> None:
        self._shutter_s = 0.0
        self._store: dict[int, bytes] = {}
        self._running: tuple[float, FrameRef] | None = None

    def _call(self, name: str) -> None:
        self.calls[name] += 1
        error = self.failures.get((name, self.calls[name]))
        if error is not None:
            raise error

    def connect(self) -> CameraIdentity:
        self._call("connect")
        return CameraIdentity("Fake", "Fake camera", "42", "1.0")

    def status(self) -> CameraStatus:
        self._call("status")
        return CameraStatus(0.9, 10**10, 1000, self.clock.utc_now(), ready=True)

    def prepare(self, settings: CameraSettings) -> tuple[SettingReadback, ...]:
        self._call("prepare")
        self._settings = settings
        return (SettingReadback("iso", str(settings.iso), str(settings.iso), "00"),)

    def body_settings(self) -> tuple[BodySetting, ...]:
        return ()

    def set_shutter(self, shutter_s: float) -> ShutterReadback:
        self._call("set_shutter")
        self._shutter_s = min(self.shutter_times_s, key=lambda t: abs(np.log(t / shutter_s)))
        return ShutterReadback(shutter_s, self._shutter_s, "00")

    def arm(self) -> None:
        self._call("arm")

    def stand_down(self) -> None:
        self._call("stand_down")

    def release(self) -> None:
        self._call("release")
        now_s = self.clock.monotonic_s()
        self.opened_s.append((now_s + self.release_lag_s, self._shutter_s))
        number = len(self.opened_s)
        data = make_jpeg(
            self._shutter_s,
            iso=self._settings.iso,
            f_number=self._settings.f_number,
            taken=self.clock.utc_now(),
            gain=self.gain,
            seed=number,
        )
        data = self.spoil(number, self._shutter_s, data)
        self._store[number] = data
        frame = FrameRef(number, f"../../etc/R{number:07d}.JPG", FrameFormat.JPEG, len(data))
        self._running = (now_s + self.release_lag_s + self._shutter_s + self.readout_s, frame)

    def poll_exposure(self) -> ExposureProgress:
        self._call("poll_exposure")
        assert self._running is not None
        done_s, frame = self._running
        if self.clock.monotonic_s() < done_s:
            self.clock.sleep(0.002)
            return ExposureProgress(done=False)
        self._running = None
        return ExposureProgress(done=True, frames=(frame,))

    def read_chunk(self, frame: FrameRef, offset: int, max_bytes: int) -> bytes:
        self._call("read_chunk")
        if self._running is not None and not self.overlaps:
            self.can_transfer_while_exposing = False
            raise DeviceBusyError("busy exposing")
        self.clock.sleep(self.chunk_s)
        return self._store[frame.handle][offset : offset + min(max_bytes, self.chunk_bytes)]

    def finish_frame(self, frame: FrameRef) -> None:
        self._call("finish_frame")
        self.safe.append(frame.handle)

    def delete(self, frame: FrameRef) -> None:
        self._call("delete")
        self.deleted.append(frame.handle)

    def list_frames(self) -> tuple[FrameRef, ...]:
        return ()

    def keep_alive(self) -> None:
        self._call("keep_alive")

    def recover(self) -> None:
        self._call("recover")
        self._running = None
        self.recovered += 1

    def close(self) -> None:
        self.closed = True
