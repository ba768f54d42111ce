"""Parameters of the stage calibrate."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import Field, field_validator

from processing.stages.contract import StageParameters

Positive = Annotated[float, Field(gt=0, le=1e12)]


class CalibrateParameters(StageParameters):
    """What a user may say about the scale, the lens and the sky; everything has a default."""

    k1: Positive | None = None
    """Takes the place of meter reading and target (paper, eq. 1)."""
    k2: Positive | None = None
    """Takes the place of the rig profile's (eq. 2)."""
    target: str | None = None
    """Where the meter looked, "LON,LAT" in degrees in the panorama; None: as recorded, else the board is looked for."""
    outdoor_lux: Positive | None = None
    """Horizontal illuminance measured outside: compared, or the scale where there is no k2, or the sun's repair."""
    repair_sun: Literal["no", "illuminance", "clear-sky"] = "no"
    outdoor_view: Literal["hemispherical", "equidistant", "equirectangular"] = "equidistant"
    outdoor_field_deg: Annotated[float, Field(gt=60, le=250)] = 180.0
    """Whole field of the outdoor lens within its image circle, where no lens calibration says it."""
    outdoor_top_deg: float | None = None
    """Compass azimuth of the outdoor picture's top; None: from the sun, else the panorama's heading."""
    falloff: Literal["auto", "off"] = "auto"
    """auto: the profile's vignetting, else the published one of that kind of camera."""
    glare: Literal["auto", "keep"] = "auto"
    """auto: the veil seen around the outdoor image circle is taken off."""

    @field_validator("target")
    @classmethod
    def _two_angles(cls, value: str | None) -> str | None:
        if value is not None:
            cls.angles_rad(value)
        return value

    @staticmethod
    def angles_rad(value: str) -> tuple[float, float]:
        """Return longitude and latitude in radians of "LON,LAT" in degrees; `ValueError` where it is no direction."""
        parts = value.split(",")
        try:
            longitude, latitude = (float(part) for part in parts)
        except ValueError:
            raise ValueError(f"{value!r} is not LON,LAT in degrees") from None
        if not (abs(longitude) <= 180 and abs(latitude) <= 90):
            raise ValueError(f"{value!r}: longitude is -180 to 180, latitude -90 to 90 degrees")
        return math.radians(longitude), math.radians(latitude)
