"""What a simulated camera asks for when its shutter has closed: the bytes of the picture.

The camera's protocol side (`mocks.theta_z1`, `mocks.canon_5d2`) knows settings and time; the picture side
(`mocks.optics` behind `mocks.world`) knows light. They meet only here.
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from typing import Protocol


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
        ...

    def raw(self, request: ShotRequest) -> bytes:
        """Return the raw companion (CR2 or DNG)."""
        ...
