"""Brackets in a tree of folders, as photographers keep a day's work: which files are one, and which belong together.

Known layouts (Cali-HDR and Pano2Pano as published, by their file lists): ``20230521/pano/coda320_16:56/*.JPG|DNG``
with ``20230521/fisheye/coda320_16:53/*.JPG|CR2``, ``20230709/essex/theta/...``, ``20240330/indoor/1349_Kitchen`` with
``20240330/outdoor/1339_living``, ``20240324/12 Elm St/Outdoor/1154_2F_SW``, ``20240312/1356-in`` with ``1400-out``.
Only names are looked at here, and nothing is guessed: what can mean two things is a `Doubt` with the names of both.
"""

import csv
import os
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import date
from pathlib import Path

from station.errors import SessionNotFoundError, UsageError
from station.frames.import_plan import JPEG_SUFFIXES, RAW_SUFFIXES, has_suffix
from station.session.session import MANIFEST_NAME, Side

MAX_FOLDERS = 20_000  # chosen: the larger of the two datasets has some three hundred
PAIR_LIMIT_MIN = 10
"""Chosen: in the authors' table the two cameras are at most 6 minutes apart (but for one slip of the pen)."""
SAME_MIN = 1  # chosen: a table's time and a folder's may differ by rounding
SIDE_WORDS = {
    Side.INDOOR: {"indoor", "indoors", "inside", "interior", "theta", "pano", "panorama"},
    Side.OUTDOOR: {"outdoor", "outdoors", "outside", "exterior", "fisheye", "canon", "sky"},
}
LAST_WORDS = {"in": Side.INDOOR, "out": Side.OUTDOOR}  # as the last word of a folder's name: ``1356-in``
_DATE = re.compile(r"(20\d\d)[-_.]?([01]\d)[-_.]?([0-3]\d)")
# A colon cannot be in a name on Windows: archivers write _, -, ., nothing, a wide colon or %3A in its place.
_ROOM_TIME = re.compile(r"(?P<room>.*?)[ _-]?(?P<h>[01]?\d|2[0-3])(?::|：|_|-|\.|%3A)(?P<m>[0-5]\d)", re.IGNORECASE)
_TIME_ROOM = re.compile(r"(?P<h>[01]\d|2[0-3])(?P<m>[0-5]\d)(?:[ _-]+(?P<room>.*))?")
COLUMNS = ("date", "scene_name", "theta_time")
"""A table needs them; known further ones: fisheye_time, luminance_cd_m2, illuminance_lux, nd_filter, natural_light,
orientation."""


@dataclass(frozen=True)
class Bracket:
    """The files of one bracket. ``minute``: of the day, by the folder's name (None: it says none)."""

    folder: Path
    side: Side
    day: str
    place: str
    room: str
    minute: int | None
    files: tuple[Path, ...]
    part: int = 0
    """Number among the brackets of one folder, from 1; 0: the folder has one."""

    @property
    def name(self) -> str:
        """Return what the bracket is called in messages and session names."""
        time = "" if self.minute is None else f"{self.minute // 60:02d}:{self.minute % 60:02d}"
        part = f"part {self.part}" if self.part else ""
        return " ".join(word for word in (self.day, self.place, self.room, time, part) if word)

    @property
    def key(self) -> tuple[str, str, str]:
        """Return day, place and room as they are compared: letters and digits only, in lower case."""
        return self.day, plain(self.place), plain(self.room)


@dataclass(frozen=True)
class Doubt:
    """What cannot be decided, and the files or folders concerned."""

    message: str
    paths: tuple[str, ...]


@dataclass(frozen=True)
class Pair:
    """An indoor bracket and the sky that belongs to it; one of them may be missing."""

    indoor: Bracket | None
    outdoor: Bracket | None

    @property
    def main(self) -> Bracket:
        """Return the bracket that gives the session its name."""
        found = self.indoor or self.outdoor
        assert found is not None
        return found


def plain(text: str) -> str:
    """Return the letters and digits of a name in lower case: ``coda_320`` is ``coda320``."""
    return "".join(c for c in text.lower() if c.isalnum())


def find_brackets(root: Path) -> tuple[list[Bracket], list[Doubt]]:
    """Return a bracket for each folder that holds frames, and the folders whose names do not say what they are.

    Raises `SessionNotFoundError`: the tree cannot be listed; `UsageError`: it has too many folders.
    """
    brackets, doubts = list[Bracket](), list[Doubt]()
    for folder, files in _frame_folders(root):
        words = (root.resolve().name, *folder.relative_to(root).parts)
        sides = [(i, side) for i, word in enumerate(words) for side in _sides_of(word, whole=i == 0)]
        if len({side for _, side in sides}) != 1:
            what = "both indoors and outdoors" if sides else "neither indoors nor outdoors"
            doubts.append(Doubt(f"the name fits {what}: give this folder as --indoor or --outdoor", (str(folder),)))
            continue
        brackets.append(_bracket(folder, files, words, {i for i, _ in sides}, sides[0][1]))
    return brackets, doubts


def _frame_folders(root: Path) -> Iterator[tuple[Path, tuple[Path, ...]]]:
    """Yield the folders below ``root`` that hold frames, by name; links to folders are not followed."""

    def refuse(error: OSError) -> None:
        raise SessionNotFoundError(f"cannot be listed: {error.strerror}", where=str(error.filename)) from error

    for n_folders, (where, names, entries) in enumerate(os.walk(root, onerror=refuse), 1):
        if n_folders > MAX_FOLDERS:
            raise UsageError(f"more than {MAX_FOLDERS} folders", where=str(root), advice="name a subfolder")
        if MANIFEST_NAME in entries:  # a session of our own: its frames are imported already
            names.clear()
        names[:] = sorted(name for name in names if not name.startswith((".", "__MACOSX")))
        files = tuple(Path(where) / name for name in sorted(entries))
        frames = tuple(path for path in files if has_suffix(path, (*JPEG_SUFFIXES, *RAW_SUFFIXES)))
        if frames:
            yield Path(where), frames


def _sides_of(word: str, *, whole: bool) -> set[Side]:
    """Return the sides that a folder's name says; ``whole``: only where it says nothing else."""
    tokens = [token for token in re.split(r"[^a-z0-9]+", word.lower()) if token]
    named = {side for side, words in SIDE_WORDS.items() if words & set(tokens)}
    found = named if not whole or set(tokens) <= set().union(*SIDE_WORDS.values()) else set()
    return found or ({LAST_WORDS[tokens[-1]]} if tokens and tokens[-1] in LAST_WORDS else set())


def _bracket(folder: Path, files: tuple[Path, ...], words: Sequence[str], said: set[int], side: Side) -> Bracket:
    dated = [(i, day) for i, word in enumerate(words) if (day := _day_of(word))]
    last = len(words) - 1
    room, minute = room_and_minute(words[last]) if last not in {i for i, _ in dated} else ("", None)
    if last in said and minute is None:
        room = ""  # the camera's folder itself
    room = re.sub(r"(?i)[ _-]*\b(in|out)$", "", room)
    first = dated[-1][0] if dated else 0
    place = " ".join(words[i] for i in range(first + 1, last) if i not in said)
    return Bracket(folder, side, dated[-1][1] if dated else "", place, room, minute, files)


def _day_of(word: str) -> str:
    """Return the date that a folder is named by as YYYY-MM-DD; "" for another name."""
    found = _DATE.fullmatch(word)
    try:
        return date(*(int(part) for part in found.groups())).isoformat() if found else ""
    except ValueError:
        return ""


def room_and_minute(word: str) -> tuple[str, int | None]:
    """Return the room and the minute of the day of a bracket folder's name: ``coda320_16:56``, ``1349_Kitchen``."""
    found = _ROOM_TIME.fullmatch(word) or _TIME_ROOM.fullmatch(word)
    return (word, None) if found is None else (found["room"] or "", int(found["h"]) * 60 + int(found["m"]))


def pair_brackets(brackets: Iterable[Bracket]) -> tuple[list[Pair], list[Doubt]]:
    """Return each indoor bracket with the sky nearest in time of the same day, place and room.

    A sky may serve several indoor brackets; one that serves none is a session of its own. Without times, the only sky
    of a room is its. An indoor bracket with two skies equally near is a doubt, and in no pair.
    """
    rooms: dict[tuple[str, str, str], list[Bracket]] = {}
    indoor = []
    for bracket in brackets:
        if bracket.side is Side.OUTDOOR:
            rooms.setdefault(bracket.key, []).append(bracket)
        else:
            indoor.append(bracket)
    pairs, doubts, used = [], [], set()
    for bracket in indoor:
        near = _nearest(bracket, rooms.get(bracket.key, []))
        if len(near) > 1:
            paths = tuple(str(b.folder) for b in (bracket, *near))
            doubts.append(Doubt(f"{bracket.name}: {len(near)} outdoor brackets are equally near in time", paths))
        else:
            pairs.append(Pair(bracket, near[0] if near else None))
        used |= set(near)
    for skies in rooms.values():
        pairs += [Pair(None, sky) for sky in skies if sky not in used]
    return pairs, doubts


def _nearest(bracket: Bracket, skies: Sequence[Bracket]) -> list[Bracket]:
    if bracket.minute is None or any(sky.minute is None for sky in skies):
        return list(skies)
    apart = {sky: abs((sky.minute or 0) - bracket.minute) for sky in skies}
    near = min(apart.values(), default=PAIR_LIMIT_MIN + 1)
    return [sky for sky, minutes in apart.items() if minutes == near <= PAIR_LIMIT_MIN]


@dataclass(frozen=True)
class TableRow:
    """What a table says of one indoor bracket; texts as they are, None where a cell is empty."""

    line: int
    day: str
    room: str
    minute: int | None
    luminance_cd_m2: float | None
    illuminance_lx: float | None
    nd_filter: str
    remark: str
    sky_minute: int | None = None

    @property
    def contradicts_itself(self) -> bool:
        """Whether its two times cannot be of one pair: a slip of the pen (Cali-HDR's has one)."""
        times = (self.minute, self.sky_minute)
        return times[0] is not None and times[1] is not None and abs(times[0] - times[1]) > PAIR_LIMIT_MIN


def read_table(path: Path) -> list[TableRow]:
    """Return the rows of a table of brackets (CSV, as Cali-HDR's summary).

    Raises `UsageError`: it cannot be read, a column is missing, or a cell is no date or number; names line and cell.
    """
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.DictReader(file)
            names = list(filter(None, reader.fieldnames or ()))
            if wrong := sorted({name for name in (*COLUMNS, *names) if names.count(name) != 1}):
                raise UsageError(f"columns that it needs once: {', '.join(wrong)}", where=str(path))
            return [_row(number, cells, path) for number, cells in enumerate(reader, 2)]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise UsageError(f"cannot be read: {error}", where=str(path), advice="give a CSV file in UTF-8") from error


def _row(line: int, cells: Mapping[str, str | None], path: Path) -> TableRow:
    text = {name: (value or "").strip() for name, value in cells.items() if name and not isinstance(value, list)}
    day, (_, minute) = _day_of(text["date"]), room_and_minute(text["theta_time"])
    try:
        luminance, lux = (float(text[n]) if text.get(n) else None for n in ("luminance_cd_m2", "illuminance_lux"))
        if not all(0 <= value <= 1e10 for value in (luminance or 0, lux or 0)):
            raise ValueError(line)
    except ValueError as error:
        raise UsageError(f"line {line}: luminance and illuminance are 0 to 1e10", where=str(path)) from error
    if not day:
        raise UsageError(f"line {line}: {text['date']!r} is not a date", where=str(path), advice="write YYYYMMDD")
    remarks = [f"{n.replace('_', ' ')}: {text[n]}" for n in ("natural_light", "orientation") if text.get(n)]
    nd_filter = text.get("nd_filter", "")
    sky = room_and_minute(text.get("fisheye_time", ""))[1]
    return TableRow(line, day, text["scene_name"], minute, luminance, lux, nd_filter, "; ".join(remarks), sky)


def row_of(bracket: Bracket, rows: Sequence[TableRow]) -> TableRow | Doubt | None:
    """Return the row of an indoor bracket: same day and minute, and the same room or the room with its place."""
    names = {plain(bracket.room), plain(bracket.place + bracket.room)}
    found = [
        row
        for row in rows
        if row.day == bracket.day
        and not row.contradicts_itself
        and plain(row.room) in names
        and row.minute is not None
        and bracket.minute is not None
        and abs(row.minute - bracket.minute) <= SAME_MIN
    ]
    exact = [row for row in found if row.minute == bracket.minute] or found
    if len(exact) > 1:
        lines = ", ".join(str(row.line) for row in exact)
        return Doubt(f"{bracket.name}: lines {lines} of the table are equally near", (str(bracket.folder),))
    return exact[0] if exact else None
