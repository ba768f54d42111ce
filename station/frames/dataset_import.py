"""Sessions from a tree of brackets: one for each indoor bracket, with its sky, its row of a table, and its cameras."""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path

from drivers.errors import DaylitError
from station.errors import AmbiguousImportError, IncompleteBracketError, SessionError
from station.frames.check import FrameChecker
from station.frames.dataset import Bracket, Doubt, Pair, TableRow, find_brackets, pair_brackets, read_table, row_of
from station.frames.import_plan import JPEG_SUFFIXES, Candidate, has_suffix, inspect_files, sort_entries
from station.frames.importer import ImportReport, ImportRequest, Zone, import_session
from station.frames.rules import same_stop
from station.session.folder import file_sha256
from station.session.session import SessionManifest, SessionStatus, Side, Site, WarningRecord
from station.session.store import load_manifest

BRACKET_FRAMES = 9  # of the paper; a folder with more may hold several brackets
KINDS = {"RICOH THETA Z1": "theta_z1", "Canon EOS 5D Mark II": "canon_5d2"}
"""The paper's cameras by the model that EXIF names: their fall-off and mapping are known."""
LENS = "EF 8-15mm f/4L FISHEYE USM at 8 mm"
ND_FILTER = "ND 3.0"  # of the paper's outdoor camera (section 3.1)


@dataclass(frozen=True)
class DatasetRequest:
    """What to import. ``zone`` is that of the cameras' clocks.

    ``lost_s``: exposure times, in the order of the file names, for brackets without EXIF. ``only``: part of
    the names of the brackets wanted. ``strict``: a doubt is an error before anything is made.
    """

    root: Path
    into: Path
    table: Path | None = None
    lost_s: tuple[float, ...] = ()
    site: Site = field(default_factory=Site)
    zone: Zone | None = None
    only: str = ""
    raw: bool = True
    strict: bool = False


@dataclass(frozen=True)
class Outcome:
    """What became of one bracket: a session, an error, or a session that was there before (none of the two)."""

    pair: Pair
    report: ImportReport | None = None
    error: DaylitError | None = None


@dataclass(frozen=True)
class DatasetPlan:
    """What belongs together, and what is not decided."""

    pairs: tuple[Pair, ...]
    rows: dict[Bracket, TableRow]
    doubts: tuple[Doubt, ...]
    unused_lines: tuple[int, ...]
    """Lines of the table that no bracket was found for."""


def plan_dataset(request: DatasetRequest, checker: FrameChecker) -> DatasetPlan:
    """Return which brackets make sessions; reads pictures only in folders with more than one bracket.

    Raises `AmbiguousImportError`: ``strict``, and something is not decided; `IncompleteBracketError`: no bracket at
    all; `UsageError`: the table cannot be read.
    """
    table = read_table(request.table) if request.table else []
    found, doubts = find_brackets(request.root)
    if not found and not doubts:
        raise IncompleteBracketError("no folder holds frames", where=str(request.root), advice="name the unpacked set")
    brackets: list[Bracket] = []
    for bracket in found:
        parts = _parts(bracket, request, checker)
        if isinstance(parts, Doubt):
            doubts.append(parts)
        else:
            brackets += parts
    pairs, more = pair_brackets(brackets)
    doubts += more
    rows: dict[Bracket, TableRow] = {}
    for pair in list(pairs):
        row = row_of(pair.indoor, table) if pair.indoor else None
        if isinstance(row, Doubt):
            doubts.append(row)
            pairs.remove(pair)
        elif row is not None and pair.indoor:
            rows[pair.indoor] = row
    if request.strict and doubts:
        raise doubt_error(doubts)
    wanted = tuple(p for p in pairs if request.only.lower() in p.main.name.lower())
    return DatasetPlan(wanted, rows, tuple(doubts), tuple(row.line for row in table if row not in rows.values()))


def doubt_error(doubts: Sequence[Doubt]) -> AmbiguousImportError:
    """Return the error that names what is not decided."""
    others = f" (and {len(doubts) - 1} more)" if len(doubts) > 1 else ""
    text, where = f"{doubts[0].message}{others}", doubts[0].paths[0]
    advice = "import these with --indoor and --outdoor, or give their folders clearer names"
    named = [{"message": doubt.message, "paths": list(doubt.paths)} for doubt in doubts]
    return AmbiguousImportError(text, where=where, advice=advice, doubts=named)


def import_dataset(request: DatasetRequest, plan: DatasetPlan, checker: FrameChecker) -> Iterator[Outcome]:
    """Make the sessions of a plan, one after the other; what fails is an outcome, and the rest goes on.

    A complete session of the same name and pictures that is there already is not made again. Raises `ResourceError`:
    the disk is full or failing.
    """
    done = list[SessionManifest]()
    for path in request.into.glob("*/session.json"):
        with suppress(SessionError):
            done.append(load_manifest(path.parent))
    for pair in plan.pairs:
        if any(manifest.status is SessionStatus.COMPLETE and _is_of(manifest, pair) for manifest in done):
            yield Outcome(pair)
            continue
        try:
            yield Outcome(pair, import_session(_request_of(pair, plan, request), checker=checker))
        except SessionError as error:
            yield Outcome(pair, error=error)


def _is_of(manifest: SessionManifest, pair: Pair) -> bool:
    """Whether a session has the name of a bracket, and no picture but its own."""
    if manifest.name != pair.main.name:
        return False
    files = [path for bracket in (pair.indoor, pair.outdoor) if bracket is not None for path in bracket.files]
    frames = [frame for side in Side for frame in manifest.pictures(side)]
    sizes = {frame.size_bytes for frame in frames}  # no other file need be read
    with suppress(OSError):
        found = {file_sha256(path) for path in files if path.stat().st_size in sizes}
        return bool(frames) and {frame.sha256 for frame in frames} <= found
    return False


def _request_of(pair: Pair, plan: DatasetPlan, request: DatasetRequest) -> ImportRequest:
    sides = {b.side: b for b in (pair.indoor, pair.outdoor) if b is not None}
    row = plan.rows.get(pair.indoor) if pair.indoor else None
    devices: dict[Side, dict[str, str]] = {}
    if pair.outdoor is not None and any(path.suffix.lower() == ".cr2" for path in pair.outdoor.files):
        filtered = row is None or row.nd_filter.upper() != "NO"
        devices[Side.OUTDOOR] = {"lens": LENS, "nd_filter": ND_FILTER if filtered else ""}
    return ImportRequest(
        room=pair.main.name,
        folders={side: b.folder for side, b in sides.items()},
        files={side: b.files for side, b in sides.items()},
        into=request.into,
        readings_cd_m2=(row.luminance_cd_m2,) if row and row.luminance_cd_m2 is not None else (),
        site=request.site,
        camera_zone=request.zone,
        devices=devices,
        kinds=KINDS,
        notes=tuple(_notes(pair, row)),
        raw=request.raw,
        lost_s=request.lost_s,
        whole=True,
    )


def _notes(pair: Pair, row: TableRow | None) -> Iterator[WarningRecord]:
    if pair.indoor and pair.outdoor and pair.indoor.minute is not None and pair.outdoor.minute is not None:
        apart = pair.outdoor.minute - pair.indoor.minute
        if apart:
            text = f"the sky was taken {abs(apart)} minutes {'later' if apart > 0 else 'earlier'} than the room"
            yield WarningRecord(code="sky_apart", message=text)
    if row is not None and row.illuminance_lx is not None:
        text = f"the table has {row.illuminance_lx:g} lx outside: daylit process --outdoor-lux {row.illuminance_lx:g}"
        yield WarningRecord(code="outdoor_lux", message=text)
    if row is not None and row.remark:
        yield WarningRecord(code="table", message=row.remark[:500])


def _parts(bracket: Bracket, request: DatasetRequest, checker: FrameChecker) -> list[Bracket] | Doubt:
    """Return the brackets of one folder: a new one begins where an exposure time comes again."""
    jpegs = [path for path in bracket.files if has_suffix(path, JPEG_SUFFIXES)]
    if len(jpegs) <= BRACKET_FRAMES:
        return [bracket]
    files, raws, _ = sort_entries(bracket.files, bracket.folder, raw=True)
    found, _ = inspect_files(bracket.side, files, [None] * len(files), checker, raws)
    if request.lost_s and not any(c.time_s for c in found) and len(files) % len(request.lost_s) == 0:
        typed = request.lost_s * (len(files) // len(request.lost_s))
        if len(found) == len(files):
            found = [replace(c, time_s=s) for c, s in zip(found, typed, strict=False)]
    if unknown := [c.path.name for c in found if c.time_s is None]:
        text = f"{bracket.name}: {len(jpegs)} frames may be several brackets, and {len(unknown)} have no exposure time"
        return Doubt(text, (str(bracket.folder), *unknown))
    groups: list[list[Candidate]] = [[]]
    for candidate in found:
        if any(same_stop(candidate.time_s or 1, other.time_s or 1) for other in groups[-1]):
            groups.append([])
        groups[-1].append(candidate)
    if len(groups) == 1:
        return [bracket]
    return [_part(bracket, number, group) for number, group in enumerate(groups, 1)]


def _part(bracket: Bracket, number: int, group: Sequence[Candidate]) -> Bracket:
    stems = {candidate.path.stem.lower() for candidate in group}
    files = tuple(path for path in bracket.files if path.stem.lower() in stems)
    taken = group[0].exif.taken_local
    minute = bracket.minute if taken is None else taken.hour * 60 + taken.minute
    return replace(bracket, files=files, part=number, minute=minute)
