"""rig.toml: which instruments, where they are, and what a bracket is; read, checked, and written as an example."""

import math
import tomllib
from importlib import resources
from pathlib import Path
from stat import S_ISREG
from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator

from drivers.camera import CameraSettings
from station.capture.bracket import PAPER_STOPS_S, parse_shutter
from station.errors import RigError, UsageError
from station.session.session import Fraction, MeterTarget, SafeText, Side, Site

MAX_RIG_BYTES = 256 * 1024
SideKind = Literal["theta_z1", "canon_5d2"]
Accepted = Literal[
    "colour space",
    "picture style",
    "highlight tone priority",
    "lighting optimiser",
    "mirror lock-up",
    "firmware",
    "static stitching",
]
"""What preflight refuses by these names (`drivers.camera.BodySetting`)."""
TYPED = "typed"  # in place of a dialect: the meter is not read over a line


class _Table(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class CameraTable(_Table):
    """``[indoor]`` and ``[outdoor]``: one camera and its fixed settings."""

    kind: SideKind
    serial: str = ""
    """Take only the camera with this serial number; empty: the only one of its kind."""
    iso: Annotated[int, Field(ge=25, le=102_400)]
    f_number: Annotated[float, Field(ge=0.9, le=64)]
    color_temperature_k: Annotated[int, Field(ge=2500, le=10_000)] = 6500
    size_px: tuple[Annotated[int, Field(ge=16, le=20_000)], Annotated[int, Field(ge=16, le=20_000)]]
    keep_raw: bool = False
    delete_after: bool = False
    """Delete each frame from the camera once it is safe here."""
    destination: Literal["card", "pc"] | None = None
    """Of a Canon: where pictures go until they are fetched; empty: the card."""
    release_lag_s: Annotated[float, Field(ge=0, le=2)] | None = None
    """Release to shutter opening; empty: the driver's own figure."""
    lens: SafeText = ""
    nd_filter: SafeText = ""
    image_circle: tuple[Fraction, Fraction, Fraction] | None = None
    """Of a fisheye: centre column, row and radius as fractions of width, height and width; what is outside is black."""

    @model_validator(mode="after")
    def _no_key_without_effect(self) -> Self:
        if self.destination is not None and self.kind != "canon_5d2":
            raise ValueError("destination: only canon_5d2 has this key")
        return self

    accept: tuple[Accepted, ...] = ()
    """Settings of the body that preflight would refuse, and that are to be a warning only."""

    def settings(self) -> CameraSettings:
        """Return what the driver is asked to set."""
        exposure = self.iso, self.f_number, self.color_temperature_k
        return CameraSettings(*exposure, *self.size_px, keep_raw=self.keep_raw)


class MeterTable(_Table):
    """``[meter]``: the luminance meter."""

    dialect: str = TYPED
    """"typed": a person types what the display shows (--reading). Else the name of a shipped dialect (see
    docs/reference/meter-dialects.md for what is assumed) or the path of your own file."""
    port: str = "auto"
    samples: Annotated[int, Field(ge=1, le=50)] = 3
    timeout_s: Annotated[float, Field(gt=0, le=120)] = 20.0
    target_deg: tuple[Annotated[float, Field(ge=-180, le=180)], Annotated[float, Field(ge=-90, le=90)]] | None = None
    """Where it looks, in the indoor panorama: longitude (right of centre), latitude (up)."""

    @model_validator(mode="after")
    def _a_port_needs_a_dialect(self) -> Self:
        if self.dialect == TYPED and self.port != "auto":
            raise ValueError("port is given, but no dialect: name it (daylit meter probe finds it), or leave port out")
        return self

    @property
    def is_read(self) -> bool:
        """Whether the meter is read over its line."""
        return self.dialect != TYPED

    def target(self) -> MeterTarget | None:
        """Return the target in radians."""
        if self.target_deg is None:
            return None
        longitude_rad, latitude_rad = (math.radians(v) for v in self.target_deg)
        return MeterTarget(longitude_rad=longitude_rad, latitude_rad=latitude_rad)


class BracketTable(_Table):
    """``[bracket]``: the stops."""

    stops: tuple[str, ...] = tuple(f"{s:g}" if s >= 1 else f"1/{round(1 / s)}" for s in PAPER_STOPS_S)
    mode: Literal["full", "adaptive"] = "full"
    reference: bool = False
    """Repeat one stop at the end: it shows whether light or lamps changed meanwhile."""

    @field_validator("stops")
    @classmethod
    def _readable(cls, stops: tuple[str, ...]) -> tuple[str, ...]:
        for stop in stops:
            try:
                parse_shutter(stop)
            except UsageError as error:
                raise ValueError(str(error)) from error  # so that the key is named with the others
        return stops

    def stops_s(self) -> tuple[float, ...]:
        """Return the stops in seconds."""
        return tuple(parse_shutter(s) for s in self.stops)


class LimitsTable(_Table):
    """``[limits]``: when preflight warns or refuses."""

    min_battery_frac: Fraction = 0.15
    min_free_disk_mb: Annotated[float, Field(ge=0)] = 1000.0
    max_clock_skew_s: Annotated[float, Field(gt=0)] = 5.0
    max_drift_frac: Annotated[float, Field(gt=0)] = 0.05
    max_start_skew_s: Annotated[float, Field(gt=0)] = 0.02


class RigFile(_Table):
    """The whole file."""

    site: Site = Site()
    heading_deg: Annotated[float, Field(ge=-360, le=360)] | None = None
    """Compass azimuth of the panorama's centre column."""
    camera_height_m: Annotated[float, Field(gt=0, lt=20)] = 1.6
    indoor: CameraTable | None = None
    outdoor: CameraTable | None = None
    meter: MeterTable | None = None
    bracket: BracketTable = BracketTable()
    limits: LimitsTable = LimitsTable()

    def cameras(self) -> dict[Side, CameraTable]:
        """Return the cameras that the rig has."""
        found = {Side.INDOOR: self.indoor, Side.OUTDOOR: self.outdoor}
        return {side: table for side, table in found.items() if table is not None}


PAPER_INDOOR = CameraTable(kind="theta_z1", iso=100, f_number=5.6, size_px=(6720, 3360))
PAPER_OUTDOOR = CameraTable(
    kind="canon_5d2",
    iso=200,
    f_number=16,
    size_px=(5616, 3744),
    lens="EF 8-15mm f/4L FISHEYE USM at 8 mm",
    nd_filter="ND 3.0",
    image_circle=(0.5, 0.5, 0.314),
)
PAPER_RIG = RigFile(indoor=PAPER_INDOOR, outdoor=PAPER_OUTDOOR, meter=MeterTable(dialect="ls160"))
"""The rig of the paper: its cameras, settings and stops."""


def load_rig(path: Path) -> RigFile:
    """Read and check a rig file.

    Raises `RigError`: missing, too large, no regular file (a device has no end), not TOML, or a key that is unknown or
    out of range; names the file and every such key.
    """
    try:
        if not S_ISREG((found := path.stat()).st_mode) or found.st_size > MAX_RIG_BYTES:
            raise RigError("too large for a rig file, or no regular file", where=str(path))
        return RigFile.model_validate(tomllib.loads(path.read_text("utf-8-sig")))
    except FileNotFoundError as error:
        advice = "write one with: daylit doctor --write-rig rig.toml"
        raise RigError("no such rig file", where=str(path), advice=advice) from error
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError, RecursionError) as error:
        raise RigError(f"cannot be read: {error}", where=str(path), advice="correct the file") from error
    except ValidationError as error:
        keys = "; ".join(f"[{'.'.join(map(str, e['loc']))}] {e['msg']}" for e in error.errors())
        raise RigError(keys, where=str(path), advice="correct them; example: daylit doctor --write-rig FILE") from error


def example_text() -> str:
    """Return the example that ``daylit doctor --write-rig`` writes."""
    return resources.files("station.capture").joinpath("rig.example.toml").read_text("utf-8")
