"""The files of a folder that may be frames: JPEGs, the raw file beside each, and what the checker finds in them."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

from station.errors import FrameRejectedError, SessionNotFoundError, UsageError
from station.frames.check import FrameChecker, RawFormat
from station.frames.facts import Reason
from station.frames.import_plan import Candidate, RawCompanion, Refusal, refusal
from station.frames.rules import printable, rejection
from station.session.session import Side

MAX_FRAMES = 99  # a stop's number has two digits in a frame's name
JPEG_SUFFIXES = (".jpg", ".jpeg")
LOSSLESS_SUFFIXES = (".png", ".tif", ".tiff")
"""Taken where a folder has no JPEGs: film scans, other programs' exports."""
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
        raise UsageError(
            f"{len(files)} pictures, a bracket has at most {MAX_FRAMES}", where=str(folder), advice="sort the folder"
        )
    taken = {*files, *raws.values()}
    return files, raws, [printable(path.name) for path in entries if path not in taken]


def inspect_files(
    side: Side, files: Sequence[Path], times_s: Sequence[float | None], checker: FrameChecker, raws: Mapping[str, Path]
) -> tuple[list[Candidate], list[Refusal]]:
    """Return what the checker finds in JPEGs and their raw files, and what it refuses; ``times_s`` are typed ones."""
    candidates: list[Candidate] = []
    refused: list[Refusal] = []
    for path, typed_s in zip(files, times_s, strict=True):
        try:
            facts = checker.inspect(path.resolve(), name=path.name)
        except FrameRejectedError as error:
            refused.append(refusal(side, printable(path.name), error, typed_s))
            continue
        time_s, raw = typed_s or facts.exif.exposure_s, raws.get(path.stem.lower())
        companion = _companion(raw, checker) if raw else None
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
        return RawCompanion(path, checker.check_raw(path.resolve(), format_, name=path.name))
    except FrameRejectedError as error:
        return error


def raw_only(side: Side, files: Sequence[Path], raws: Mapping[str, Path], checker: FrameChecker) -> list[Refusal]:
    """Return the raw files that have no JPEG beside them."""
    refused = []
    for path in (path for stem, path in raws.items() if stem not in {f.stem.lower() for f in files}):
        found, time_s = _companion(path, checker), None
        if isinstance(found, RawCompanion):
            time_s, advice = found.facts.exif.exposure_s, "export JPEGs of the same names beside the raw files"
            found = rejection(path.name, Reason.UNSUPPORTED, "a raw file without its JPEG, which others have", advice)
        refused.append(refusal(side, printable(path.name), found, time_s))
    return refused
