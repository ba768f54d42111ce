"""A session from plain folders of JPEGs, their raw files beside them: every file checked, copied durably, and the
folders left as they are."""

import itertools
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path
from typing import Any
from uuid import uuid4
from zoneinfo import ZoneInfo

from drivers.clock import Clock, SystemClock
from station.capture.intake import drift_frac
from station.errors import FrameRejectedError, IncompleteBracketError, UsageError, software_versions
from station.frames import import_plan
from station.frames.check import FrameChecker, picture_format
from station.frames.facts import FrameFacts
from station.frames.problems import Reason
from station.frames.rules import printable, rejection
from station.session.manifest import require_names
from station.session.session import (
    BracketRecord,
    DeviceRecord,
    FrameRecord,
    MeterTarget,
    ReadingRecord,
    RejectedFrame,
    SessionManifest,
    Side,
    Site,
    SkippedStop,
    WarningRecord,
)
from station.session.store import SessionStore

Zone = ZoneInfo | int  # of a clock: with its summer time, or minutes east of UTC
_COPY_BYTES = 1 << 20
CLOCKS_APART = timedelta(hours=1)  # chosen: no bracket takes as long; a clock that was reset is off by years


@dataclass(frozen=True)
class ImportRequest:
    """What to import, and what no file says.

    ``shutter_s`` gives the exposure times in the order of the file names, seconds (empty: EXIF's). ``readings_cd_m2``
    are none, one (before) or two (before and after). ``camera_zone`` is that of the cameras' clocks (None: unknown,
    unless EXIF says). ``strict`` refuses the import when any file is refused. ``files`` are taken instead of all that
    is in a side's folder; ``devices`` is what is known of the cameras (fields of `DeviceRecord`), ``notes`` what else
    is worth a warning. ``raw``: raw files of the same name as a JPEG are copied, too.
    """

    room: str
    folders: Mapping[Side, Path]
    into: Path
    files: Mapping[Side, Sequence[Path]] = field(default_factory=dict)
    devices: Mapping[Side, Mapping[str, str]] = field(default_factory=dict)
    notes: Sequence[WarningRecord] = ()
    raw: bool = True
    lost_s: tuple[float, ...] = ()
    """Exposure times of the files, in the order of their names, for those that say none themselves."""
    whole: bool = False
    """Make no session if a side has no usable frame."""
    kinds: Mapping[str, str] = field(default_factory=dict)
    """Kind of camera (`DeviceRecord.kind`) by the model that EXIF names."""
    shutter_s: tuple[float, ...] = ()
    readings_cd_m2: tuple[float, ...] = ()
    site: Site = field(default_factory=Site)
    heading_rad: float | None = None
    target: MeterTarget | None = None
    camera_zone: Zone | None = None
    strict: bool = False


@dataclass(frozen=True)
class ImportReport:
    """What became of the files: the session, the refused files, and the files that are no JPEG by name."""

    session: Path
    manifest: SessionManifest
    refused: tuple[import_plan.Refusal, ...]
    ignored: tuple[str, ...]


@dataclass(frozen=True)
class _Sorted:
    """The files of all folders, sorted into frames, refusals and files of no interest."""

    frames: Mapping[Side, Sequence[import_plan.Candidate]]
    refused: tuple[import_plan.Refusal, ...]
    ignored: tuple[str, ...]
    stops_s: tuple[float, ...]


def import_session(
    request: ImportRequest, *, checker: FrameChecker | None = None, clock: Clock | None = None
) -> ImportReport:
    """Make a session from plain folders; nothing in them is changed.

    Raises `UsageError`: no folder, or not as many times as JPEGs; `SessionNotFoundError`: A folder that is not there;
    `FrameRejectedError`: ``strict``, and a file is refused; no session is made; `IncompleteBracketError`: no file is a
    usable frame; no session is made; `ResourceError`: the disk is full or failing; what was copied so far stays as a
    partial session.
    """
    clock = clock or SystemClock()
    if checker is None:
        with FrameChecker() as own:
            return import_session(request, checker=own, clock=clock)
    found = _sort_files(request, checker)
    if request.strict and found.refused:
        raise _strict_error(found.refused)
    if not any(found.frames.values()) or (request.whole and not all(found.frames.values())):
        raise _nothing_error(found)
    with SessionStore.create(request.into, _manifest(request, found, clock), clock=clock) as store:
        refused = (*found.refused, *_fill(store, request, found, clock))
        return ImportReport(store.path, store.finish(), refused, found.ignored)


def _strict_error(refused: Sequence[import_plan.Refusal]) -> FrameRejectedError:
    others = f" (and {len(refused) - 1} more)" if len(refused) > 1 else ""
    error = rejection(refused[0].name, Reason.DAMAGED, refused[0].message + others, "import without --strict")
    error.details["reason"] = refused[0].reason
    error.details["refused"] = [f"{r.side}/{r.name}: {r.message}" for r in refused]
    return error


def _nothing_error(found: _Sorted) -> IncompleteBracketError:
    message, advice = "no file is a usable frame", "name the folder that holds the JPEGs of the bracket"
    if found.refused:
        first = found.refused[0]
        others = f" (and {len(found.refused) - 1} more)" if len(found.refused) > 1 else ""
        message += f": {first.side}/{first.name}: {first.message}{others}"
        advice = "correct the files named (--shutter: one time per file, in file-name order)"
    refused = [f"{r.side}/{r.name}: {r.message}" for r in found.refused]
    return IncompleteBracketError(message, where="import", advice=advice, refused=refused, ignored=list(found.ignored))


def _sort_files(request: ImportRequest, checker: FrameChecker) -> _Sorted:
    if not request.folders:
        raise UsageError("nothing to import", where="import", advice="give --indoor FOLDER")
    require_names(request.room, request.site.name, where="import")
    frames: dict[Side, Sequence[import_plan.Candidate]] = {}
    refused, ignored = list[import_plan.Refusal](), list[str]()
    for side, folder in request.folders.items():
        entries = sorted(request.files[side]) if side in request.files else import_plan.list_folder(folder)
        files, raws, others = import_plan.sort_entries(entries, folder, raw=request.raw)
        ignored += [f"{side}/{name}" for name in others]
        candidates, unreadable = import_plan.inspect_files(side, files, _times(request, side, files), checker, raws)
        unreadable += import_plan.raw_only(side, files, raws, checker)
        if len(request.lost_s) == len(files):
            said = dict(zip(files, request.lost_s, strict=True))
            candidates = [replace(c, time_s=c.time_s or said[c.path]) for c in candidates]
        frames[side], misfits = import_plan.plan_side(side, candidates)
        refused += [*unreadable, *misfits]
    known_s = [c.time_s for c in itertools.chain(*frames.values()) if c.time_s is not None]
    known_s += [r.time_s for r in refused if r.time_s is not None]
    return _Sorted(frames, tuple(refused), tuple(ignored), import_plan.join_stops(known_s))


def _times(request: ImportRequest, side: Side, files: Sequence[Path]) -> Sequence[float | None]:
    if not request.shutter_s:
        return [None] * len(files)
    if len(request.shutter_s) != len(files):
        text = f"{len(request.shutter_s)} exposure times for {len(files)} JPEGs ({side})"
        raise UsageError(text, where="--shutter", advice="give one time per file, in file-name order")
    counted = sorted(files, key=lambda path: [int(w) if w.isdecimal() else w for w in re.split(r"(\d+)", path.name)])
    if unclear := [(a.name, b.name) for a, b in zip(files, counted, strict=True) if a != b]:
        text = f"is {' or '.join(map(printable, unclear[0]))} the earlier name ({side})?"
        raise UsageError(text, where="--shutter", advice="give the numbers in the names as many digits")
    return request.shutter_s


def _manifest(request: ImportRequest, found: _Sorted, clock: Clock) -> SessionManifest:
    n_readings = len(request.readings_cd_m2)
    if n_readings > 2:
        raise UsageError("more than two readings", where="--reading", advice="give one, or before and after")
    sides = tuple(side for side in Side if side in found.frames)
    return SessionManifest(
        session_id=uuid4().hex,
        name=request.room,
        created_utc=clock.utc_now(),
        software=software_versions(),
        site=request.site,
        heading_rad=request.heading_rad,
        bracket=BracketRecord(
            mode="imported",
            stops_s=found.stops_s,
            sides=sides,
            raw_sides=tuple(s for s in sides if found.frames[s] and all(c.raw for c in found.frames[s])),
        ),
        devices=tuple(_device(side, found.frames[side], request) for side in sides if found.frames[side]),
        target=request.target,
        readings_planned=0 if n_readings == 0 else 1 if n_readings == 1 else 2,
    )


def _device(side: Side, frames: Sequence[import_plan.Candidate], request: ImportRequest) -> DeviceRecord:
    exif, kind = frames[0].exif, request.kinds.get(frames[0].exif.model, "imported")
    found = {"kind": kind, "manufacturer": exif.make, "model": exif.model, "serial": exif.serial}
    return DeviceRecord.model_validate({"role": side.value, **found, **request.devices.get(side, {})})


def _fill(store: SessionStore, request: ImportRequest, found: _Sorted, clock: Clock) -> list[import_plan.Refusal]:
    """Copy and record everything; return the files that changed under the import."""
    changed: list[import_plan.Refusal] = []
    for side, frames in found.frames.items():
        for candidate in frames:
            try:
                _copy(store, side, candidate, found.stops_s, request.camera_zone)
            except FrameRejectedError as error:
                changed.append(import_plan.refusal(side, candidate.facts.name, error, candidate.time_s))
    for refused in (*found.refused, *changed):
        stop = import_plan.stop_of(found.stops_s, refused.time_s)
        reason = f"{refused.name}: {refused.message}"[:500]
        store.add(RejectedFrame(side=refused.side, stop=stop, reason=reason))
    for skipped in _other_side_only(found):
        store.add(skipped)
    for reading in _readings(request, clock.utc_now()):
        store.add(reading)
    drift = drift_frac(store.manifest.readings)
    if drift is not None:
        store.update(drift_frac=drift)
    for warning in _warnings(request, found):
        store.add(warning)
    return changed


def _copy(
    store: SessionStore, side: Side, candidate: import_plan.Candidate, stops_s: Sequence[float], zone: Zone | None
) -> None:
    """Copy a JPEG and its raw file into the session, make sure that they are what was checked, and acknowledge them."""
    facts, time_s = candidate.facts, candidate.time_s
    assert time_s is not None
    stop = import_plan.stop_of(stops_s, time_s)
    shot = {
        "side": side,
        "stop": stop,
        "asked_s": stops_s[stop],
        "camera_s": time_s,
        "iso": candidate.exif.iso,
        "f_number": candidate.exif.f_number,
        "taken_utc": _taken_utc(candidate, zone),
    }
    size = {"width_px": facts.width_px, "height_px": facts.height_px, "statistics": facts.statistics}
    beside = [(candidate.raw.path, candidate.raw.facts, dict[str, Any]())] if candidate.raw else []
    for path, of, extra in ((candidate.path, facts, size), *beside):
        _copy_file(store, path, of, {**shot, **extra, "exif_s": of.exif.exposure_s, "format": picture_format(path)})


def _copy_file(store: SessionStore, path: Path, facts: FrameFacts, record: Mapping[str, Any]) -> None:
    side, stop, format_ = record["side"], record["stop"], record["format"]
    part = store.begin_frame(side, stop, record["asked_s"], format_)
    try:
        for chunk in _chunks(path, facts.name):
            part.write(chunk)
        stored = part.commit()
    finally:
        part.abort()
    what = {"file": stored.file, "size_bytes": stored.size_bytes, "sha256": stored.sha256, "camera_name": facts.name}
    store.add_frame(FrameRecord.model_validate({**record, **what}))
    if stored.sha256 != facts.sha256:
        message = "changed while it was imported"
        store.withdraw_frame(side, stop, format_, message)
        raise rejection(facts.name, Reason.DAMAGED, message, "import again")


def _chunks(path: Path, name: str) -> Iterator[bytes]:
    try:
        with path.open("rb") as file:
            while chunk := file.read(_COPY_BYTES):
                yield chunk
    except OSError as error:
        raise rejection(name, Reason.NOT_A_FILE, f"can no longer be read: {error.strerror}") from error


def _taken_utc(candidate: import_plan.Candidate, zone: Zone | None) -> datetime | None:
    """Return the moment of the frame by the camera's clock, where its zone is known."""
    taken, zone = candidate.exif.taken_local, candidate.exif.offset_min if zone is None else zone
    known = timezone(timedelta(minutes=zone)) if isinstance(zone, int) else zone
    return None if taken is None or known is None else taken.replace(tzinfo=known).astimezone(UTC)


def _other_side_only(found: _Sorted) -> Iterator[SkippedStop]:
    """Yield the stops that only the other folder has: nothing of them was lost, unless a file is unreadable."""
    for side, frames in found.frames.items():
        times_s = [c.time_s for c in frames] + [r.time_s for r in found.refused if r.side == side]
        have = {import_plan.stop_of(found.stops_s, time_s) for time_s in times_s}
        for stop in range(len(found.stops_s)):
            if stop not in have and -1 not in have:
                yield SkippedStop(side=side, stop=stop, reason="the folder has no frame of this exposure time")


def _readings(request: ImportRequest, now: datetime) -> Iterator[ReadingRecord]:
    for when, luminance in zip(("before", "after"), request.readings_cd_m2, strict=False):
        said = {"status": "typed", "luminance_cd_m2": luminance, "taken_utc": now, "detail": "typed at import"}
        yield ReadingRecord.model_validate({"when": when, **said})


def _warnings(request: ImportRequest, found: _Sorted) -> Iterator[WarningRecord]:
    if not request.readings_cd_m2:
        yield WarningRecord(code="no_meter", message="no meter reading: luminance is relative until one is given")
    if len(found.frames) == 1:
        yield WarningRecord(code="one_side", message=f"{next(iter(found.frames))} only")
    times = [[t for c in side if (t := _taken_utc(c, request.camera_zone))] for side in found.frames.values()]
    if len(times) > 1 and all(times) and (apart := abs(min(times[1]) - min(times[0]))) > CLOCKS_APART:
        text = f"by EXIF the cameras' frames were taken {apart} apart: one clock was wrong, and with it date and sun"
        yield WarningRecord(code="clocks_apart", message=f"{text}; correct the files' times and import again")
    for side, frames in found.frames.items():
        for candidate in frames:
            lost = candidate.facts.exif_problem
            notes = [*candidate.facts.notes, f"{lost}: the raw file's is used" if lost and candidate.raw else lost]
            for note in filter(None, notes):
                yield WarningRecord(code="frame_note", message=f"{side}/{candidate.facts.name}: {note}"[:500])
    yield from request.notes
    if found.ignored:
        yield WarningRecord(code="ignored_files", message=f"not frames, ignored: {', '.join(found.ignored)}"[:500])
