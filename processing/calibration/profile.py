"""A rig's calibration profile: what `daylit rig calibrate` found, kept as JSON and used by every session of the rig.

A profile belongs to cameras at fixed settings. `profile_matches` says where a session differs; k2 is refused then
(the paper: "k2 is a fixed constant when the two camera settings stay the same").
"""

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import AwareDatetime, Field, ValidationError

from processing.calibration import profile_records
from processing.calibration.scale.chart import spectral_mismatch
from processing.calibration.scale.chart_patches import PATCH_NAMES
from processing.errors import ProfileError
from processing.ground.room_model import read_json
from station.session import strict_json
from station.session.folder import Folder, write_file
from station.session.session import DeviceRecord, FrameRecord, Model, SafeText, SessionManifest, Side

PROFILE_SCHEMA_VERSION = 1  # raised when a field changes its meaning
MAX_PROFILE_BYTES = 32 << 20  # chosen
SHAPING = (
    "picture style",
    "colour space",
    "highlight tone priority",
    "lighting optimiser",
    "high-ISO noise reduction",
    "white-balance shift amber-blue",
    "white-balance shift green-magenta",
    "stitching",
    "filter",
)
"""Settings of a session's cameras that bend the curve or the colours: a profile holds for what it was measured with."""
_REL_TOLERANCE = 0.01  # of f-numbers: cameras write 5.6 for 5.657

Correction = Literal["panorama", "vignetting", "nd"]  # the panorama's fall-off, the fisheye's, the tint of its filter


class CameraState(Model):
    """Which camera, and the settings that a scale factor depends on; None or "" where it is not known."""

    kind: SafeText = ""
    model: SafeText = ""
    serial: SafeText = ""
    lens: SafeText = ""
    nd_filter: SafeText = ""
    f_number: profile_records.Positive | None = None
    iso: Annotated[int, Field(gt=0)] | None = None
    color_temperature_k: Annotated[int, Field(gt=0)] | None = None
    body: dict[SafeText, SafeText] = Field(default={})
    """Settings of the body that shape its pictures, by name (`SHAPING`), where the session knows them."""

    def differences(self, now: Self) -> list[str]:
        """Return in words how ``now`` differs, in what both know."""
        found = []
        for name in (n for n in CameraState.model_fields if n != "body"):
            mine, theirs = getattr(self, name), getattr(now, name)
            known = mine not in (None, "") and theirs not in (None, "")
            if name == "nd_filter" and bool(mine) != bool(theirs) and self.lens and now.lens:
                known = True  # no filter is a state of its own where the optics are on record
            if known and not _equal(mine, theirs):
                found.append(f"{name} is {theirs or 'none'}, in the profile {mine or 'none'}")
        both = sorted(self.body.keys() & now.body.keys())
        found += [f"{n} is {now.body[n]}, in the profile {self.body[n]}" for n in both if self.body[n] != now.body[n]]
        return found


class CameraProfile(Model):
    """One camera's calibration; parts that were not measured are None."""

    side: Side
    state: CameraState
    created_utc: AwareDatetime
    sessions: tuple[SafeText, ...] = ()
    """Ids of the sessions that it comes from."""
    response: profile_records.ResponseRecord | None = None
    noise: profile_records.NoiseRecord | None = None
    shutter: profile_records.ShutterRecord = profile_records.ShutterRecord()
    vignetting: profile_records.VignettingRecord | None = None
    lens: profile_records.LensRecord | None = None
    nd: profile_records.NdRecord | None = None
    glare: profile_records.GlareRecord | None = None


class PatchRecord(Model):
    """A chart patch in both pictures: relative luminances, ratio residual (stops) and colour difference."""

    name: SafeText
    indoor: profile_records.NonNegative
    outdoor: profile_records.NonNegative
    residual_stops: float
    color_difference: profile_records.NonNegative


class K2Record(Model):
    """The constant between the two cameras: outdoor values times ``value`` are on the indoor scale (eq. 2)."""

    value: profile_records.Positive
    relative_uncertainty: profile_records.NonNegative
    measured_utc: AwareDatetime
    session: SafeText = ""
    indoor: CameraState
    outdoor: CameraState
    white_ratio: profile_records.Positive
    """From the white patch alone, as in the paper."""
    n_patches: Annotated[int, Field(ge=1)]
    residual_stops: profile_records.NonNegative
    """Robust rms of the neutral patches about the fit."""
    patches: tuple[PatchRecord, ...] = ()
    light: Annotated[float, Field(ge=-3, le=3)] = 0.0
    """Blueness of the light on the chart (`blueness`), by its white patch in the indoor camera; 0: daylight."""
    corrections: tuple[Correction, ...] = ()
    """What was undone in the pictures before k2 was measured; the same must be done before it is used."""
    responses: dict[Side, SafeText] = Field(default={})
    """Digests of the response curves it was measured with (`ResponseRecord.digest`)."""

    def spectral_mismatch(self, side: Side) -> float | None:
        """Return a camera's `chart.spectral_mismatch`; patches without a residual are clipped or dark."""
        if tuple(patch.name for patch in self.patches) != PATCH_NAMES:
            return None
        seen = np.array([patch.indoor if side is Side.INDOOR else patch.outdoor for patch in self.patches])
        usable = (seen > 0) & np.array([patch.residual_stops != 0 for patch in self.patches])
        return spectral_mismatch(seen, np.asarray(usable), self.light)


class RigProfile(Model):
    """calibration.json."""

    schema_version: Literal[1] = 1
    created_utc: AwareDatetime
    software: dict[str, SafeText] = Field(default={})
    cameras: dict[Side, CameraProfile] = Field(default={})
    k2: K2Record | None = None
    warnings: tuple[SafeText, ...] = ()
    frames: dict[Side, Literal["raw", "jpeg"]] = Field(default={})
    """Which frames of each camera all this was measured on, and holds for; JPEGs where a side is not named."""
    raw: "RigProfile | None" = None
    """The same rig by its raw files, of the cameras that have them."""

    def of(self, by_raw: Mapping[Side, bool]) -> "RigProfile":
        """Return what holds for sides by whether they were merged from raw files: the part `raw`, else this."""
        mine = self.raw.frames if self.raw else {}
        held = any(by_raw.values()) and all((mine.get(side) == "raw") is one for side, one in by_raw.items())
        return self.raw if self.raw and held else self


def camera_state(device: DeviceRecord | None, frames: Sequence[FrameRecord] = ()) -> CameraState:
    """Return what a session says of one camera; f-number and ISO as its frames have them, None where they differ."""
    settings = device.settings if device else ()
    named = [s.got for s in settings if s.name.casefold() in ("colour temperature", "color temperature")]
    temperature = next((float(n[0]) for got in named if (n := re.search(r"[0-9]+(\.[0-9]+)?", got))), None)
    f_numbers = {f.f_number for f in frames if f.f_number}
    isos = {f.iso for f in frames if f.iso}
    names = ("kind", "model", "serial", "lens", "nd_filter")
    return CameraState(
        **{name: getattr(device, name) if device else "" for name in names},
        f_number=f_numbers.pop() if len(f_numbers) == 1 else None,
        iso=isos.pop() if len(isos) == 1 else None,
        color_temperature_k=int(temperature) if temperature else None,
        body={s.name: s.got for s in settings if s.name in SHAPING and s.got != "not reported"},
    )


def profile_matches(
    profile: RigProfile, side: Side, device: DeviceRecord | None, frames: Sequence[FrameRecord] = ()
) -> list[str]:
    """Return where a session's camera disagrees with the profile; empty if nowhere (or nothing is known to compare).

    A response curve from other settings is still a good start (a warning); `require_k2` refuses k2.
    """
    camera = profile.cameras.get(side)
    if camera is None:
        return [f"{side}: the profile does not include this camera"]
    return [f"{side}: {text}" for text in camera.state.differences(camera_state(device, frames))]


def unlike_profile(profile: RigProfile | None, session: SessionManifest) -> list[str]:
    """Return where cameras disagree with a profile that brings no curve of theirs (merging compares those that do)."""
    roles, now = {device.role for device in session.devices}, states_of(session)
    mine = profile.cameras.items() if profile else ()
    bare = [(side, camera.state) for side, camera in mine if camera.response is None and side.value in roles]
    return [f"{side}: {text}" for side, state in bare for text in state.differences(now[side])]


def states_of(session: SessionManifest) -> dict[Side, CameraState]:
    """Return what a session says of both cameras."""
    devices = {device.role: device for device in session.devices}
    return {s: camera_state(devices.get(s.value), [f for f in session.frames if f.side is s]) for s in Side}


def chart_mismatches(profile: RigProfile | None, session: SessionManifest) -> dict[Side, float | None]:
    """Return the spectral mismatch of a session's cameras by the profile's chart; none of a camera set otherwise."""
    if profile is None or profile.k2 is None:
        return {}
    k2, now = profile.k2, states_of(session)
    measured = {Side.INDOOR: k2.indoor, Side.OUTDOOR: k2.outdoor}
    return {side: k2.spectral_mismatch(side) for side, old in measured.items() if not old.differences(now[side])}


def require_k2(profile: RigProfile, states: dict[Side, CameraState], where: str = "") -> K2Record:
    """Return k2 if it holds for these cameras as they are set.

    Raises `ProfileError`: no k2 in the profile, or a setting differs from when it was measured.
    """
    k2 = profile.k2
    if k2 is None:
        raise ProfileError(
            "the profile has no k2", where=where, advice="measure it: daylit rig calibrate --chart SESSION; or --k2"
        )
    measured = {Side.INDOOR: k2.indoor, Side.OUTDOOR: k2.outdoor}
    found = [f"{s}: {text}" for s, old in measured.items() if s in states for text in old.differences(states[s])]
    if found:
        what = f"k2 was measured with other settings: {'; '.join(found)}"
        advice = "capture the chart again with these settings and run daylit rig calibrate, or give --k2"
        raise ProfileError(what, where=where, likely="the rig was changed after its calibration", advice=advice)
    return k2


def load_profile(path: Path) -> RigProfile:
    """Read a calibration profile.

    Raises `ProfileError`: missing, too large, not JSON, of a newer schema, or a key that cannot be right; names the
    file and the keys.
    """
    where = str(path)
    if not path.is_file():
        raise ProfileError("no such profile", where=where, advice="create one: daylit rig calibrate")
    data = read_json(path, ProfileError, MAX_PROFILE_BYTES)
    if not isinstance(data, dict):
        raise ProfileError("not a JSON object", where=where, advice="name a calibration.json")
    version = data.get("schema_version", 1)
    if isinstance(version, int) and version > PROFILE_SCHEMA_VERSION:
        raise ProfileError(f"written with schema {version}, known are up to 1", where=where, advice="update daylit")
    try:
        return RigProfile.model_validate_json(json.dumps(data))
    except ValidationError as error:
        keys = "; ".join(strict_json.faults_of(error)[:5])
        raise ProfileError(keys, where=where, advice="correct these keys, or run daylit rig calibrate again") from error


def save_profile(path: Path, profile: RigProfile) -> None:
    """Write calibration.json whole or not at all (an old one is replaced); `DiskError` where that is not possible."""
    try:
        folder = Folder.open(path.parent)
    except OSError as error:
        raise ProfileError(f"the folder cannot be opened: {error.strerror}", where=str(path.parent)) from error
    with folder:
        write_file(folder, path.name, profile.model_dump_json(indent=1).encode() + b"\n")


def _equal(mine: object, theirs: object) -> bool:
    if isinstance(mine, float) and isinstance(theirs, float | int):
        return abs(mine - theirs) <= _REL_TOLERANCE * mine
    if isinstance(mine, str) and isinstance(theirs, str):
        return " ".join(mine.casefold().split()) == " ".join(theirs.casefold().split())
    return mine == theirs
