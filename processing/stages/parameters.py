"""Parameters of the stages, apart from their code: they are needed to see whether a stage has to run at all."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import Field, field_validator

from processing.stages.contract import StageParameters


class MergeParameters(StageParameters):
    """Of the stage merge."""

    side: Literal["both", "indoor", "outdoor"] = "both"
    """Which brackets are merged."""


# Parameters of the stage calibrate.


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


# Parameters of the stage room.


class RoomParameters(StageParameters):
    """What a user may say about the room; everything has a default."""

    camera_height_m: Annotated[float, Field(ge=0.1, lt=20)] | None = None
    """Height of the panorama camera's lens: it sets the scale. None: the session's."""
    level: Literal["auto", "off"] = "auto"
    """Whether a tilted panorama is made upright."""


# Parameters of the stage detect.


class DetectParameters(StageParameters):
    """What a user may say about masks."""

    margin_deg: Annotated[float, Field(ge=0, le=10)] = 0.6
    """By which the target reaches over what was found."""
    sunlight: Literal["auto", "off"] = "auto"
    """off: direct sunlight stays in the picture."""


# Parameters of the stage remove.


class RemoveParameters(StageParameters):
    """What a user may say about removal."""

    keep_sunlight: bool = False
    """Direct sunlight stays where it is: not for relighting."""
    filler_channels: Literal["rgb", "bgr"] = "rgb"
    """Channel order of the user's filling network."""


# Parameters of the stage materials.


class MaterialsParameters(StageParameters):
    """What a user may say about what the room is made of, and whether it is to be staged at all."""

    set: str = "auto"
    """Of furniture; "none": no staging."""
    items: str | None = None
    """A list of furniture of the user's own."""
    reveal_m: Annotated[float, Field(ge=0, le=2)] | None = None
    """Depth of the windows' niches; None: a common one."""

    @property
    def asked(self) -> bool:
        """Tell whether the room is to be staged."""
        return self.items is not None or self.set != "none"


# Parameters of the stage arrange.


MOST_STAGED = 7
"""Alternatives: as many as the paper shows."""

NO_SUCH = "no such alternative"
"""Why an artifact of an alternative that nobody asked for is left out."""


class ArrangeParameters(StageParameters):
    """What is to stand in the room."""

    set: str = "auto"
    """A built-in set, "auto", or "none"."""
    items: str | None = None
    """A list of one's own instead: "bed, 2 nightstand"."""
    rules: str = "standard"
    alternatives: Annotated[int, Field(ge=1, le=MOST_STAGED)] = 3
    seed: Annotated[int, Field(ge=0)] = 0

    @property
    def asked(self) -> bool:
        """Tell whether furniture is asked for."""
        return self.items is not None or self.set != "none"


# Parameters of the stage render.


class RenderParameters(StageParameters):
    """How furniture is put into the picture."""

    method: Literal["differential", "global", "ibl"] = "differential"
    style: str | None = None
    """Of the built-in furniture; None: another one for each alternative."""
    seed: Annotated[int, Field(ge=0)] = 0
    """Of the arrangement and of chance."""


# Parameters of the stage report.


class ReportParameters(StageParameters):
    """What a user may say about the page."""

    no_staged_label: bool = False
    """Staged pictures go without their visible label; their metadata keep saying what they are."""
