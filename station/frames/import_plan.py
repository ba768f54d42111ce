"""Which files of a plain folder make a bracket: pure decisions from what the frame checker found.

Whatever does not fit the rest (another size, another camera, a time that is there already, darker than a
shorter frame) is refused by name, and the rest goes on.
"""

import os
from collections import Counter
from collections.abc import Callable, Collection, Hashable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from station.errors import FrameRejectedError, SessionNotFoundError, UsageError
from station.frames.check import FrameChecker, RawFormat
from station.frames.facts import ExifRecord, ExpectedFrame, FrameFacts
from station.frames.problems import Reason
from station.frames.rules import check_order, judge, printable, rejection, same_stop, seconds_text
from station.session.session import Side


@dataclass(frozen=True)
class RawCompanion:
    """The raw file of the same shot."""

    path: Path
    facts: FrameFacts


@dataclass(frozen=True)
class Candidate:
    """A file that decodes, and its exposure time (typed by the user, or else EXIF's; None: neither)."""

    path: Path
    facts: FrameFacts
    time_s: float | None
    raw: RawCompanion | None = None

    @property
    def exif(self) -> ExifRecord:
        """Return the JPEG's EXIF, or the raw file's where the JPEG has lost it."""
        return self.raw.facts.exif if self.raw and self.facts.exif_problem else self.facts.exif


@dataclass(frozen=True)
class Refusal:
    """A file that does not become a frame; ``time_s`` is its exposure time where that is known."""

    side: Side
    name: str
    reason: str
    message: str
    time_s: float | None = None


@dataclass
class _Sieve:
    """The files of one side: those that fit so far, and those refused."""

    side: Side
    kept: list[Candidate]
    refused: list[Refusal]

    def refuse(self, candidate: Candidate, error: FrameRejectedError) -> None:
        self.kept = [other for other in self.kept if other is not candidate]
        self.refused.append(refusal(self.side, candidate.facts.name, error, candidate.time_s))


def refusal(side: Side, name: str, error: FrameRejectedError, time_s: float | None) -> Refusal:
    """Return the record of a refused file."""
    return Refusal(side, name, str(error.details.get("reason", "")), error.message, time_s)


def plan_side(side: Side, candidates: Sequence[Candidate]) -> tuple[list[Candidate], list[Refusal]]:
    """Return the frames of one side, longest exposure first, and the files that do not fit.

    What most files agree on (size, camera, ISO, F-number) is taken to be meant; of equals, what comes first by name.
    """
    sieve = _Sieve(side, list(candidates), [])
    for candidate in candidates:
        if candidate.time_s is None:
            why = f"no exposure time: {candidate.facts.exif_problem or 'its EXIF has no exposure time'}"
            advice = "give the times with --shutter"
            sieve.refuse(candidate, rejection(candidate.facts.name, Reason.EXIF_MISSING, why, advice))
        elif side is Side.INDOOR and (turn := candidate.exif.orientation or 1) != 1:  # a sky's has no meaning
            why = f"its EXIF says that it must be rotated (orientation {turn})"
            advice = "turn the files without loss (jpegtran -rotate), or remove the tag if they are upright"
            sieve.refuse(candidate, rejection(candidate.facts.name, Reason.UNSUPPORTED, why, advice))
    _keep_most(sieve, Reason.WRONG_SIZE, lambda c: f"{c.facts.width_px}x{c.facts.height_px}", "pixels")
    _keep_most(sieve, Reason.WRONG_CAMERA, _camera, "taken by")
    _keep_most(sieve, Reason.WRONG_ISO, lambda c: c.exif.iso, "ISO")
    _keep_most(sieve, Reason.WRONG_F_NUMBER, lambda c: c.exif.f_number, "F-number")
    _judge_each(sieve)
    _keep_order(sieve)
    return sorted(sieve.kept, key=_time, reverse=True), sieve.refused


def _time(candidate: Candidate) -> float:
    assert candidate.time_s is not None
    return candidate.time_s


def _camera(candidate: Candidate) -> str:
    exif = candidate.exif
    return " ".join(part for part in (exif.make, exif.model, exif.serial) if part) or "an unnamed camera"


def _keep_most(sieve: _Sieve, reason: Reason, key: Callable[[Candidate], Hashable], what: str) -> None:
    """Refuse the files that differ from what most files say."""
    if not sieve.kept:
        return
    most = Counter(key(candidate) for candidate in sieve.kept).most_common(1)[0][0]
    for candidate in list(sieve.kept):
        if key(candidate) != most:
            message = f"{what} {key(candidate)}, while the others say {most}"
            sieve.refuse(candidate, rejection(candidate.facts.name, reason, message, "sort the folder"))


def _judge_each(sieve: _Sieve) -> None:
    """Refuse repeated pictures, times that contradict EXIF, times that are there already, and black frames."""
    accepted: list[Candidate] = []
    for candidate in list(sieve.kept):
        time_s = _time(candidate)
        twin = next((other for other in accepted if same_stop(_time(other), time_s)), None)
        try:
            expected = ExpectedFrame(exposure_s=time_s, require_exif=False)
            judge(candidate.facts, expected, [other.facts for other in accepted])
            if twin is not None:
                message = f"the same exposure time ({seconds_text(time_s)}) as {twin.facts.name}"
                raise rejection(candidate.facts.name, Reason.REPEATED, message, "keep the better of the two")
        except FrameRejectedError as error:
            sieve.refuse(candidate, error)
        else:
            accepted.append(candidate)


def _keep_order(sieve: _Sieve) -> None:
    """Refuse the frames whose brightness contradicts their exposure times."""
    while True:
        by_stop = dict(enumerate(candidate.facts for candidate in sieve.kept))
        try:
            check_order(by_stop, [_time(candidate) for candidate in sieve.kept])
        except FrameRejectedError as error:
            for candidate in [sieve.kept[stop] for stop in error.details["stops"]]:
                sieve.refuse(candidate, error)
        else:
            return


def join_stops(times_s: Sequence[float]) -> tuple[float, ...]:
    """Return the stops of a session from the exposure times of both sides, longest first, forms of one stop once."""
    stops: list[float] = []
    for time_s in sorted(times_s, reverse=True):
        if not stops or not same_stop(stops[-1], time_s):
            stops.append(time_s)
    return tuple(stops)


def stop_of(stops_s: Sequence[float], time_s: float | None) -> int:
    """Return the index of the stop that a time belongs to; -1 for an unknown time."""
    return -1 if time_s is None else min(range(len(stops_s)), key=lambda i: abs(stops_s[i] / time_s - 1))


# The files of a folder that may be frames: JPEGs, the raw file beside each, and what the checker finds in them.

MAX_FRAMES = 99  # a stop's number has two digits in a frame's name
JPEG_SUFFIXES = (".jpg", ".jpeg")
LOSSLESS_SUFFIXES = (".png", ".tif", ".tiff")  # taken where a folder has no JPEGs: film scans, other programs' exports
RAW_SUFFIXES = (".dng", ".cr2")


def list_folder(folder: Path) -> list[Path]:
    """Return what is in a folder, by name; `SessionNotFoundError` where it cannot be listed."""
    try:
        return sorted(folder.iterdir(), key=lambda path: path.name)
    except OSError as error:
        raise SessionNotFoundError(f"cannot be listed: {error.strerror}", where=str(folder)) from error


def has_suffix(path: Path, suffixes: Collection[str]) -> bool:
    """Whether a file has one of these suffixes; names that begin with a dot are the system's own files."""
    return path.suffix.lower() in suffixes and not path.name.startswith(".") and not path.is_dir()


def sort_entries(entries: Sequence[Path], folder: Path, *, raw: bool) -> tuple[list[Path], dict[str, Path], list[str]]:
    """Return the pictures by name, the raw files by their names without suffix, and the names of everything else.

    The pictures are the JPEGs, or PNGs and TIFFs where there are none, or else the raw files themselves.
    """
    files = [path for path in entries if has_suffix(path, JPEG_SUFFIXES)]
    files = files or [path for path in entries if has_suffix(path, LOSSLESS_SUFFIXES)]
    raws = {path.stem.lower(): path for path in entries if raw and has_suffix(path, RAW_SUFFIXES)}
    files, raws = (files, raws) if files else (list(raws.values()), {})
    if len(files) > MAX_FRAMES:
        text = f"{len(files)} pictures, a bracket has at most {MAX_FRAMES}"
        raise UsageError(text, where=str(folder), advice="sort the folder")
    taken = {*files, *raws.values()}
    return files, raws, [printable(path.name) for path in entries if path not in taken]


def inspect_files(
    side: Side, files: Sequence[Path], times_s: Sequence[float | None], checker: FrameChecker, raws: Mapping[str, Path]
) -> tuple[list[Candidate], list[Refusal]]:
    """Return what the checker finds in JPEGs and their raw files, and what it refuses; ``times_s`` are typed ones."""
    candidates, refused = list[Candidate](), list[Refusal]()
    for path, typed_s in zip(files, times_s, strict=True):
        try:
            facts = checker.inspect(Path(os.path.realpath(path)), name=path.name)  # resolve() stops at a loop of links
        except FrameRejectedError as error:
            refused.append(refusal(side, printable(path.name), error, typed_s))
            continue
        time_s, raw = typed_s or facts.exif.exposure_s, raws.get(path.stem.lower())
        companion = _companion(raw, checker) if raw else None
        said_s = companion.facts.exif.exposure_s if isinstance(companion, RawCompanion) else None
        if raw and said_s and time_s and not same_stop(said_s, time_s):
            why = f"its EXIF says {seconds_text(said_s)}, not {seconds_text(time_s)} as {printable(path.name)} has"
            companion = rejection(raw.name, Reason.WRONG_EXPOSURE, why, "keep raw files beside their own pictures")
        if isinstance(companion, FrameRejectedError):
            refused.append(refusal(side, printable(str(companion.where)), companion, time_s))
            companion = None
        if time_s is None and companion is not None:
            time_s = companion.facts.exif.exposure_s
        candidates.append(Candidate(path, facts, time_s, companion))
    return candidates, refused


def _companion(path: Path, checker: FrameChecker) -> RawCompanion | FrameRejectedError:
    """Return a raw file that is what its name says, or why it is not."""
    format_: RawFormat = "dng" if path.suffix.lower() == ".dng" else "cr2"
    try:
        return RawCompanion(path, checker.check_raw(Path(os.path.realpath(path)), format_, name=path.name))
    except FrameRejectedError as error:
        return error


def raw_only(side: Side, files: Sequence[Path], raws: Mapping[str, Path], checker: FrameChecker) -> list[Refusal]:
    """Return the raw files that have no JPEG beside them."""
    refused = []
    for path in (path for stem, path in raws.items() if stem not in {f.stem.lower() for f in files}):
        found, time_s = _companion(path, checker), None
        if isinstance(found, RawCompanion):
            time_s, advice = found.facts.exif.exposure_s, "export JPEGs of the same names beside the raw files"
            found = rejection(path.name, Reason.UNSUPPORTED, "a raw file without JPEG, unlike others", advice)
        refused.append(refusal(side, printable(path.name), found, time_s))
    return refused
