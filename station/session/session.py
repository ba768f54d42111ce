"""The data model of a session: what session.json says, and all that processing needs to know about a capture.

The models are strict (unknown keys are refused) and frozen; a changed manifest is a new object
(``manifest.model_copy(update=...)``). Text that came from a device is text: file names are ours alone.
"""

import math
from datetime import datetime
from enum import StrEnum
from typing import Annotated, Any, Literal, Self

from pydantic import AwareDatetime, BaseModel, ConfigDict, Field, StringConstraints, model_validator

SCHEMA_VERSION = 1  # docs/schemas
MANIFEST_NAME = "session.json"
JOURNAL_NAME = "journal.jsonl"

SafeText = Annotated[str, StringConstraints(max_length=500)]
FramePath = Annotated[
    str, StringConstraints(pattern=r"^(indoor|outdoor|rejected)/[A-Za-z0-9][A-Za-z0-9._-]{0,99}$", max_length=120)
]
PANORAMA_FOLDER = "given"
PanoramaPath = Annotated[str, StringConstraints(pattern=r"^given/panorama\.(jpg|png|tif|webp|avif|heic|exr|hdr)$")]
Sha256 = Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{64}$")]
Fraction = Annotated[float, Field(ge=0, le=1)]
PositiveSeconds = Annotated[float, Field(gt=0, le=3600)]


class Model(BaseModel):
    """Base of all records: frozen, no unknown keys, no NaN or infinity."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, ser_json_inf_nan="strings")


class Side(StrEnum):
    """Which camera: the room or the sky."""

    INDOOR = "indoor"
    OUTDOOR = "outdoor"


class SessionStatus(StrEnum):
    """Whether all that was planned is there."""

    COMPLETE = "complete"
    PARTIAL = "partial"


class Site(Model):
    """Where the room is; degrees as geographers write them (north and east positive)."""

    name: SafeText = ""
    latitude_deg: Annotated[float, Field(ge=-90, le=90)] | None = None
    longitude_deg: Annotated[float, Field(ge=-180, le=180)] | None = None
    altitude_m: Annotated[float, Field(ge=-500, le=9000)] | None = None


class SettingRecord(Model):
    """One camera setting, asked and read back."""

    name: SafeText
    asked: SafeText
    got: SafeText
    raw: SafeText = ""


class DeviceRecord(Model):
    """An instrument of the session, its settings and its clock (``clock_offset_s`` = its clock minus ours)."""

    role: Literal["indoor", "outdoor", "meter"]
    kind: SafeText
    manufacturer: SafeText = ""
    model: SafeText = ""
    serial: SafeText = ""
    firmware: SafeText = ""
    simulated: bool = False
    clock_offset_s: float | None = None
    lens: SafeText = ""
    nd_filter: SafeText = ""
    dialect: SafeText | None = None
    dialect_verified: bool | None = None
    settings: tuple[SettingRecord, ...] = ()


class FrameStatistics(Model):
    """Brightness of a frame, from its 8-bit values (0..1): checks and the adaptive bracket use it."""

    mean_frac: Fraction
    clipped_frac: Fraction
    """Share of pixels with any channel at or above 250/255."""
    dark_frac: Fraction
    """Share of pixels with every channel at or below 8/255."""


class FrameRecord(Model):
    """A frame that is safely on disk."""

    side: Side
    stop: Annotated[int, Field(ge=0, le=99)]
    """Index into the bracket's ``stops_s``."""
    file: FramePath
    format: Literal["jpeg", "png", "tiff", "cr2", "dng"] = "jpeg"
    size_bytes: Annotated[int, Field(gt=0, le=1_000_000_000)]
    sha256: Sha256
    asked_s: PositiveSeconds
    camera_s: PositiveSeconds
    """The nominal time the camera was set to (read back), or EXIF's where a session was imported."""
    exif_s: PositiveSeconds | None = None
    iso: int | None = None
    f_number: float | None = None
    width_px: Annotated[int, Field(gt=0, le=50_000)] | None = None
    height_px: Annotated[int, Field(gt=0, le=50_000)] | None = None
    taken_utc: AwareDatetime | None = None
    """Moment of release by the computer's clock."""
    release_monotonic_s: float | None = None
    camera_name: SafeText = ""
    statistics: FrameStatistics | None = None
    retakes: Annotated[int, Field(ge=0, le=10)] = 0

    @property
    def is_raw(self) -> bool:
        """Whether it is a raw file, mostly the companion of a picture."""
        return self.format in ("cr2", "dng")


class PanoramaRecord(Model):
    """One whole panorama that was given instead of brackets: no exposure times, no meter."""

    file: PanoramaPath
    format: Literal["jpeg", "png", "tiff", "webp", "avif", "heic", "exr", "hdr"]
    size_bytes: Annotated[int, Field(gt=0, le=1_000_000_000)]
    sha256: Sha256
    width_px: Annotated[int, Field(gt=0, le=65_536)]
    height_px: Annotated[int, Field(gt=0, le=65_536)]
    given_name: SafeText = ""
    """What the file was called."""


class RejectedFrame(Model):
    """A frame that was taken and does not count; kept aside with the reason."""

    side: Side
    stop: int
    """-1: which stop it would have been is not known (an imported session is then partial)."""
    file: FramePath | None = None
    reason: SafeText


class ReferenceRecord(Model):
    """A frame repeated at the end of a bracket; its file is among the rejected, for it is none of the bracket."""

    side: Side
    stop: Annotated[int, Field(ge=0, le=99)]
    file: FramePath | None = None
    taken_utc: AwareDatetime
    after_s: Annotated[float, Field(ge=0)]
    """Since the frame of the bracket."""
    ratio: Annotated[float, Field(gt=0)] | None = None
    """Of light, to that frame: median over parts of the picture; None where nothing could be compared."""
    patches: Annotated[int, Field(ge=0)] = 0
    """Parts of the picture that were compared."""
    moved_patches: Annotated[int, Field(ge=0)] = 0
    """Of these, changed by more than a quarter against the median."""


class SkippedStop(Model):
    """A stop that was left out on purpose, with the reason."""

    side: Side
    stop: int
    reason: SafeText


class MeterTarget(Model):
    """The point the meter looks at, in the indoor panorama: longitude (-pi, pi], latitude [-pi/2, pi/2]."""

    longitude_rad: Annotated[float, Field(ge=-math.pi, le=math.pi)]
    latitude_rad: Annotated[float, Field(ge=-math.pi / 2, le=math.pi / 2)]


class ReadingRecord(Model):
    """A meter reading; the number is there only when the status is "ok" or "typed"."""

    when: Literal["before", "after", "extra"]
    status: SafeText
    luminance_cd_m2: Annotated[float, Field(ge=0, le=1e10)] | None = None
    taken_utc: AwareDatetime
    taken_monotonic_s: float | None = None
    raw: SafeText = ""
    dialect: SafeText = ""
    dialect_verified: bool = False
    n_samples: Annotated[int, Field(ge=1)] = 1
    spread_frac: Annotated[float, Field(ge=0)] = 0.0
    detail: SafeText = ""

    @model_validator(mode="after")
    def _number_only_when_ok(self) -> Self:
        if (self.luminance_cd_m2 is not None) != (self.status in ("ok", "typed")):
            raise ValueError("a reading has a number exactly when its status is 'ok' or 'typed'")
        return self


class BracketRecord(Model):
    """What was planned: asked exposure times (longest first) and which sides take them."""

    mode: Literal["full", "adaptive", "imported", "panorama"]
    """imported: from folders of JPEGs; panorama: no bracket at all, see `SessionManifest.panorama`."""
    stops_s: tuple[PositiveSeconds, ...]
    sides: tuple[Side, ...]
    order: tuple[int, ...] = ()
    """Of a capture's planned stops; times behind them in ``stops_s`` are further exposures, of which none is missed."""
    raw_sides: tuple[Side, ...] = ()
    """Sides whose camera was asked for a raw file beside each JPEG."""

    @model_validator(mode="after")
    def _order_is_of_its_stops(self) -> Self:
        if len(self.order) > len(self.stops_s):
            raise ValueError(f"order names {len(self.order)} stops, and there are {len(self.stops_s)}")
        return self


class WarningRecord(Model):
    """Something worth knowing that does not stop the work."""

    code: SafeText
    message: SafeText


class SessionManifest(Model):
    """session.json."""

    schema_version: Literal[1] = 1
    session_id: Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{32}$")]
    name: SafeText
    created_utc: AwareDatetime
    software: dict[str, SafeText] = {}
    simulated: bool = False
    site: Site = Site()
    heading_rad: float | None = None
    """Compass azimuth of the panorama's centre column."""
    camera_height_m: Annotated[float, Field(gt=0, lt=20)] = 1.6
    bracket: BracketRecord
    devices: tuple[DeviceRecord, ...] = ()
    frames: tuple[FrameRecord, ...] = ()
    panorama: PanoramaRecord | None = None
    rejected: tuple[RejectedFrame, ...] = ()
    skipped: tuple[SkippedStop, ...] = ()
    target: MeterTarget | None = None
    readings: tuple[ReadingRecord, ...] = ()
    readings_planned: Literal[0, 1, 2] = 2
    drift_frac: float | None = None
    """Change of the meter's luminance from before to after, relative to before."""
    references: tuple[ReferenceRecord, ...] = ()
    warnings: tuple[WarningRecord, ...] = ()
    status: SessionStatus = SessionStatus.PARTIAL
    missing: tuple[SafeText, ...] = ()
    rig: dict[str, Any] = {}

    @property
    def taken_utc(self) -> datetime | None:
        """Return when its middle frame was taken, else a capture's begin; None: nobody says (imported, one picture)."""
        times = sorted(one.taken_utc for one in self.frames if one.taken_utc is not None)
        captured = self.created_utc if self.bracket.mode in ("full", "adaptive") else None
        return times[len(times) // 2] if times else captured

    def frame(self, side: Side, stop: int, format_: str = "jpeg") -> FrameRecord | None:
        """Return the frame of that side, stop and format, or None."""
        return next((f for f in self.frames if (f.side, f.stop, f.format) == (side, stop, format_)), None)

    def pictures(self, side: Side) -> tuple[FrameRecord, ...]:
        """Return a side's frames: its raw files where it has nothing else, else without them."""
        found = tuple(f for f in self.frames if f.side == side)
        return tuple(f for f in found if not f.is_raw) or found

    def repeat_drift(self, side: Side) -> float:
        """Return by how much a side's light changed, relative, during its bracket, by stops repeated after it; else 0.

        What changed since the repeated frame was first taken is taken to have gone on so from the bracket's beginning.
        """
        begun, found = min((f.taken_utc for f in self.frames if f.side is side and f.taken_utc), default=None), [0.0]
        for one in self.references:
            if one.side is side and one.ratio:
                whole_s = one.after_s if begun is None else (one.taken_utc - begun).total_seconds()
                found.append(abs(one.ratio - 1) * max(whole_s / max(one.after_s, 1.0), 1.0))
        return max(found)

    def missing_stops(self, side: Side) -> tuple[int, ...]:
        """Return the indices of planned stops that are neither taken (raw file and all) nor left out on purpose."""
        if side not in self.bracket.sides:
            return ()
        left_out = {s.stop for s in self.skipped if s.side == side}
        taken = {f.stop for f in self.pictures(side)}
        if side in self.bracket.raw_sides:
            taken &= {f.stop for f in self.frames if f.side == side and f.is_raw}
        wanted = range(len(self.bracket.order or self.bracket.stops_s))
        return tuple(i for i in wanted if i not in left_out | taken)

    def missing_readings(self) -> tuple[str, ...]:
        """Return which of the planned readings have no number."""
        planned = ("before", "after")[: self.readings_planned]
        have = {r.when for r in self.readings if r.luminance_cd_m2 is not None}
        return tuple(when for when in planned if when not in have)

    def assess(self) -> Self:
        """Return the manifest with ``status`` and ``missing`` as its contents say."""
        missing = [
            f"{side}: {'raw file of ' if self.frame(side, stop) else ''}stop {stop} "
            f"({shutter_label(self.bracket.stops_s[stop])})"
            for side in self.bracket.sides
            for stop in self.missing_stops(side)
        ]
        if self.bracket.mode == "imported":
            lost = (r for r in self.rejected if r.stop < 0)
            missing += [f"{r.side}: a frame of unknown exposure ({r.reason[:300]})" for r in lost]
        missing += [f"meter reading {when}" for when in self.missing_readings()]
        if self.bracket.mode == "panorama" and self.panorama is None:
            missing.append("the panorama")
        status = SessionStatus.PARTIAL if missing else SessionStatus.COMPLETE
        return self.model_copy(update={"status": status, "missing": tuple(missing)})


def folder_name(created_utc: datetime, room: str) -> str:
    """Return the folder name of a session, e.g. ``2023-05-19T1554Z_coda-320``; ``room`` is reduced to a-z 0-9 -."""
    kept = "".join(c if c.isascii() and c.isalnum() else "-" for c in room.lower())
    slug = "-".join(part for part in kept.split("-") if part)[:60] or "room"
    return f"{created_utc:%Y-%m-%dT%H%MZ}_{slug}"


def shutter_label(shutter_s: float) -> str:
    """Return the time as photographers write it: ``4 s``, ``1/60 s``."""
    return f"{shutter_s:g} s" if shutter_s >= 0.3 else f"1/{round(1 / shutter_s)} s"
