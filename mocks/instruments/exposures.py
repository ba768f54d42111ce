"""What happens between release and picture: delays, true exposure times, the log, and pictures gone wrong."""

import io
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from typing import Protocol

from mocks.instruments.faults import Fault, FaultKind

# What a simulated camera asks for when its shutter has closed: the bytes of the picture.
#
# The camera's protocol side (`mocks.instruments.theta_z1`, `mocks.instruments.canon_5d2`) knows settings and time; the
# picture side (`mocks.optics.camera` behind `mocks.worlds.world`) knows light. They meet only here.


@dataclass(frozen=True)
class ShotRequest:
    """One exposure, as the camera was set.

    ``shutter_s`` is the nominal time of the setting (1/60), not the true one; ``taken_local`` is the camera's own
    clock (it may be wrong), naive as EXIF writes it.
    """

    shutter_s: float
    iso: int
    f_number: float
    color_temperature_k: int
    width_px: int
    height_px: int
    taken_local: datetime
    sequence: int
    manufacturer: str
    model: str
    serial: str
    firmware: str


class ShotSource(Protocol):
    """Gives the files of an exposure. Must answer quickly: pictures are rendered before the capture starts."""

    def jpeg(self, request: ShotRequest) -> bytes:
        """Return the JPEG with its EXIF."""

    def raw(self, request: ShotRequest) -> bytes:
        """Return the raw companion (CR2 or DNG)."""


@dataclass(frozen=True)
class CameraTiming:
    """How long a simulated camera takes; seconds, and bytes per second.

    What no source gives is plausible for age and link of our cameras. The true exposure time is the nearest third-stop
    power of two (1/60 -> 1/64 s) when ``power_of_two_times``, else the nominal one. ``raw_cycle_s``: with raw files no
    exposure follows another sooner. ``dated_after_s``: EXIF has the time so long after the shutter closed (None: at its
    release).
    """

    release_lag_s: float
    processing_s: float
    transfer_bytes_per_s: float
    release_jitter_s: float = 0.002
    transaction_latency_s: float = 0.001
    cancel_s: float = 0.05
    wake_s: float = 1.5
    focus_s: float = 0.8
    power_of_two_times: bool = True
    transfer_while_exposing: bool = True
    raw_cycle_s: float = 0.0
    dated_after_s: float | None = None


@dataclass(frozen=True)
class ExposureRecord:
    """One opening of the shutter as it truly was, on the simulation's clock."""

    sequence: int
    start_s: float
    end_s: float
    nominal_s: float
    iso: int
    f_number: float
    color_temperature_k: int


def true_time_s(nominal_s: float, *, power_of_two: bool) -> float:
    """Return the time a shutter marked ``nominal_s`` really stays open."""
    return float(2.0 ** (round(3 * math.log2(nominal_s)) / 3)) if power_of_two else nominal_s


class Darkroom:
    """Asks the shot source for pictures, and spoils them as the faults say."""

    def __init__(self, source: ShotSource) -> None:
        self.source = source
        self._last_jpeg = b""

    def jpeg(self, request: ShotRequest, faults: Sequence[Fault]) -> bytes:
        """Return the JPEG of an exposure."""
        by_kind = {fault.kind: fault for fault in faults}
        wrong = by_kind.get(FaultKind.WRONG_EXPOSURE)
        if wrong:
            request = replace(request, shutter_s=request.shutter_s * wrong.number("factor"))
        if FaultKind.REPEATED_FRAME in by_kind and self._last_jpeg:
            return self._last_jpeg
        data = self.source.jpeg(request)
        self._last_jpeg = data
        if FaultKind.BLACK_FRAME in by_kind:
            data = blacken(data)
        if FaultKind.TRUNCATED_JPEG in by_kind:
            data = data[: int(len(data) * by_kind[FaultKind.TRUNCATED_JPEG].number("fraction"))]
        return data


def blacken(jpeg: bytes) -> bytes:
    """Return a black JPEG of the same size with the same EXIF, as a closed shutter would give."""
    from PIL import Image

    with Image.open(io.BytesIO(jpeg)) as picture:
        size, exif = picture.size, picture.info.get("exif", b"")
    out = io.BytesIO()
    Image.new("RGB", size).save(out, "JPEG", exif=exif)
    return out.getvalue()
