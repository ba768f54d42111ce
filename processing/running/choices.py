"""What was chosen for a session: options that its commands go on with, kept in its choices.toml.

The session owns them: `daylit process`, the Python API, `daylit batch`, `relight`, `view-from` and whatever shows a
session read and set them here. An option given now goes over the one chosen before, and takes its place. What was
chosen before that stays in the file (`Choices.past`) with its time and command, so that nothing is lost by trying.

Files that are given (a rig profile, a mask) are copied into the session's folder `choices`, named by their digest, so
that a moved session still has them; a file that lies in the session already (room.json) is named where it is, and so
are networks, folders, and files of more than `COPIED_BYTES`.
"""

import hashlib
import math
import os
import re
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from datetime import datetime
from pathlib import Path, PurePosixPath
from typing import Annotated, Any, NamedTuple

import tomli_w
from pydantic import AwareDatetime, BaseModel, ConfigDict, Field, ValidationError

import processing.pipeline
from drivers.clock import Clock, SystemClock
from drivers.errors import DaylitError
from processing.calibration.outdoor.sun_place import Place, zone_named
from processing.errors import ChoicesError, ParameterError, PictureFileError, ProfileError, RoomError
from processing.pipeline import options, selected
from processing.running.requests import RunRequest, planned
from processing.running.result_store import STAGES
from processing.stages.contract import Quality
from processing.stages.parameters import WORDS, Option
from station.commands.views import numbers
from station.errors import SchemaTooNewError, UsageError
from station.session import strict_json
from station.session.durable import SessionLock
from station.session.folder import Folder, file_sha256, open_session, write_file
from station.session.session import SafeText
from station.session.store import load_manifest

FILE, FOLDER, LOCK = "choices.toml", "choices", ".choices.lock"
HEAD = "# Options saved with this session by daylit's commands; show them with `daylit choices SESSION`.\n"
SCHEMA = 1  # of the file; a higher one is refused
COPIED_BYTES = 32 << 20  # up to which a file is copied into the session (chosen: a painted mask has a tenth)
NETWORKS = (".onnx", ".tflite")
"""Named where they are: large, of the computer rather than of the session, and often with files beside them."""
MOST_PAST = 100  # former choices that are kept (chosen)
MAX_FILE_BYTES = 1 << 20  # of choices.toml (chosen: with a long past it has a fiftieth)
LOCK_S = 10.0  # for which a writer waits for another; a write takes milliseconds (chosen)
TRADES: dict[str, type] = {"quality": str, "max-error": float, "time-budget": float}
"""What a run takes beside the options of stages."""
TRADED = {"quality": "quality", "max-error": "max_error", "time-budget": "time_budget_s"}
PLACES: dict[str, type] = {"site": str, "heading": float, "zone": str}
"""What `daylit relight` takes where the session does not say, and the zone of a batch's table."""
Name = Annotated[str, Field(pattern=r"^[a-z][a-z0-9-]{0,60}$")]


class Choice(BaseModel):
    """One thing that was chosen: a ``value``, or the ``file`` (or folder) that was given."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    value: bool | int | float | str | None = None
    file: str | None = None
    """Within the session, with ``/`` between; elsewhere its whole path."""
    sha256: str = ""
    """Of a file that was copied."""
    given: str = ""
    """Where a file that was copied came from, as seen from the session."""
    at: AwareDatetime
    by: SafeText
    """The command."""


class Former(Choice):
    """What was chosen before, until when."""

    name: Name
    until: AwareDatetime


class Choices(BaseModel):
    """All choices of a session by the option's name without its dashes: ``camera-height``."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    schema_version: int = SCHEMA
    chosen: dict[Name, Choice] = {}
    past: tuple[Former, ...] = ()
    """The oldest first, the last `MOST_PAST`."""

    def value(self, session: Path, name: str) -> Any:
        """Return what was chosen, a file or folder as its path; None where nothing was.

        Raises `ChoicesError` for a file that is not there any more.
        """
        choice = self.chosen.get(name)
        if choice is None or choice.file is None:
            return None if choice is None else choice.value
        path = session / choice.file
        if not path.exists():
            text = f"{name}: {choice.file} no longer exists (saved {choice.at:%Y-%m-%d} by {choice.by})"
            advice = f"give --{name} again, or forget it: daylit choices {session} --forget {name}"
            raise ChoicesError(text, where=str(session / FILE), advice=advice)
        return path


def known() -> dict[str, type]:
    """Return the names that can be chosen, with the type of their values (`Path`: a file or folder)."""
    return {flag[2:]: o.type if o.kind == "parameter" else Path for flag, o in options().items()} | TRADES | PLACES


def check_known(names: Iterable[str], where: str) -> None:
    """Raise `ParameterError` for names that are none."""
    if unknown := sorted(set(names) - set(known())):
        raise ParameterError(f"no such option: --{unknown[0]}", where=where, advice="daylit process --help")


def read_choices(session: Path) -> Choices:
    """Return what was chosen for a session; nothing where there is no file.

    Raises `ChoicesError` for a file that cannot be right, and `SchemaTooNewError` for one of a newer daylit; both are
    left as they are.
    """
    with open_session(session) as root:
        return _read(root)


def remember(session: Path, given: Mapping[str, object], *, by: str, clock: Clock | None = None) -> Choices:
    """Choose each name's value or file (None: leave it); return all choices. What is chosen already keeps its time.

    ``by`` names the command. Safe beside other writers; whoever reads sees the old choices or the new. Raises
    `ParameterError` for a name that is none and `SessionLockedError` where another writer does not end.
    """
    kinds = known()
    check_known(given, str(session))
    if given.get("zone") is not None:
        zone_named(str(given["zone"]))
    if given.get("site") is not None:
        Place(*numbers("--site", str(given["site"]), 2, "LATITUDE,LONGITUDE in degrees, say 40.44,-79.94"))

    def changed(root: Folder, old: Choices, now: datetime) -> Choices:
        made = {name: _choice(root, (name, kinds[name]), v, now, by) for name, v in given.items() if v is not None}
        return _over(old, {n: one for n, one in made.items() if _what(one) != _what(old.chosen.get(n))}, now)

    return _edit(session, changed, clock)


def check_values(session: Path, given: Mapping[str, str]) -> None:
    """Refuse, with `ParameterError`, what is typed for a stage and no run of the session could go on with."""
    kinds, of_stages = known(), {*TRADES, *(flag.removeprefix("--") for flag in options())}
    typed = {n: v if kinds[n] is Path else _typed(kinds[n], v, n) for n, v in given.items() if n in of_stages}
    planned(_merged(session, read_choices(session), typed, RunRequest()).request, processing.pipeline.STAGES)


def go_on_with(session: Path, given: Mapping[str, Any]) -> dict[str, Any]:
    """Return each name with the value that is given, or where that is None with what was chosen."""
    choices = read_choices(session)
    return {name: choices.value(session, name) if value is None else value for name, value in given.items()}


def forget(session: Path, names: Sequence[str], *, clock: Clock | None = None) -> Choices:
    """Choose no longer: the names, or ``all``; return what is left. `ParameterError` for what was not chosen."""
    return _edit(session, lambda _root, old, now: _without(session, old, names, now), clock)


def _without(session: Path, old: Choices, names: Sequence[str], now: datetime) -> Choices:
    gone = set(old.chosen) if "all" in names else {name.removeprefix("--") for name in names}
    if strange := sorted(gone - set(old.chosen)):
        advice = f"saved options: {', '.join(sorted(old.chosen)) or 'none'}"
        raise ParameterError(f"--forget {strange[0]}: no such saved option", where=str(session), advice=advice)
    return _over(old, dict.fromkeys(gone), now)


def _what(choice: Choice | None) -> Any:
    return choice and (choice.value, choice.file)


def _over(old: Choices, new: Mapping[str, Choice | None], now: datetime) -> Choices:
    """Return choices with some replaced (None: dropped); what they were goes to the past."""
    replaced = [(name, old.chosen[name]) for name in sorted(new) if name in old.chosen]
    past = (*old.past, *(Former(**one.model_dump(), name=name, until=now) for name, one in replaced))
    chosen = {name: one for name, one in {**old.chosen, **new}.items() if one is not None}
    return Choices(chosen=dict(sorted(chosen.items())), past=past[-MOST_PAST:])


def _choice(root: Folder, of: tuple[str, type], value: object, at: datetime, by: str) -> Choice:
    name, kind = of
    if kind is not Path or str(value) in WORDS:
        return Choice(value=str(value) if kind is Path else _typed(kind, value, name), at=at, by=by)
    path, session = Path(str(value)).resolve(), root.path.resolve()
    if not path.exists():
        raise ParameterError(f"no such file: {path.name}", where=str(path))
    if path.is_relative_to(session) and (inner := path.relative_to(session)).parts[:1] != (STAGES,):
        return Choice(file=inner.as_posix(), at=at, by=by)
    if not path.is_file() or path.suffix.lower() in NETWORKS or path.stat().st_size > COPIED_BYTES:
        return Choice(file=str(path), at=at, by=by)
    data = path.read_bytes()
    digest = hashlib.sha256(data).hexdigest()
    suffix = re.fullmatch(r"[.]\w{1,9}", path.suffix)
    name = digest[:16] + (suffix[0].lower() if suffix else "")
    root.make_sub(FOLDER)
    with root.sub(FOLDER) as folder:
        if folder.read_file(name, COPIED_BYTES) != data:
            write_file(folder, name, data)
    given = Path(os.path.relpath(path, session)).as_posix()
    return Choice(file=f"{FOLDER}/{name}", sha256=digest, given=given, at=at, by=by)


def _typed(kind: type, value: object, name: str) -> bool | float | str:
    """Return a value, or what was typed of one, as what it is to be; ``name`` is said of what it cannot be."""
    word = str(value).strip().lower()
    try:
        found = kind(value) if kind is not bool else {"true": True, "yes": True, "false": False, "no": False}[word]
        if not math.isfinite(float(found) if kind is not str else 0):
            raise ValueError(word)
    except (ValueError, TypeError, KeyError):
        what = {bool: "yes or no", int: "a whole number", float: "a finite number"}[kind]
        raise ParameterError(f"{name}={str(value)[:60]}: not {what}") from None
    assert isinstance(found, bool | float | int | str)
    return found


def _edit(session: Path, changed: Callable[[Folder, Choices, datetime], Choices], clock: Clock | None) -> Choices:
    """Read, change and write, alone; write nothing where nothing changes."""
    now = (clock or SystemClock()).utc_now()
    load_manifest(session)
    with open_session(session) as root, SessionLock(root, LOCK, wait_s=LOCK_S):
        old = _read(root)
        new = changed(root, old, now)
        if new != old:
            text = tomli_w.dumps(new.model_dump(exclude_defaults=True) | {"schema_version": SCHEMA})
            write_file(root, FILE, f"{HEAD}{text}".encode())
            _tidy(root, new)
    return new


def _tidy(root: Folder, choices: Choices) -> None:
    """Remove copies that no choice names, now or in the past, and what a killed writer left."""
    if root.lstat(FOLDER) is None:
        return
    named = {one.file for one in (*choices.chosen.values(), *choices.past)}
    with root.sub(FOLDER) as folder:
        for name in folder.names():
            if f"{FOLDER}/{name}" not in named:
                folder.remove(name)


def _read(root: Folder) -> Choices:
    raw, where = root.read_file(FILE, MAX_FILE_BYTES), str(root.path / FILE)
    if raw is None:
        return Choices()
    advice = "correct it, or move it away and give the options again; it was not changed"
    try:
        found = tomllib.loads(raw.decode("utf-8-sig"))
        version = found.get("schema_version")
        if isinstance(version, int) and version > SCHEMA:
            text = f"is of version {version}, this version of daylit supports {SCHEMA}"
            raise SchemaTooNewError(text, where=where, advice="update daylit")
        choices = Choices.model_validate(found)
    except ValidationError as error:
        raise ChoicesError(strict_json.faults_of(error)[0], where=where, advice=advice) from error
    except (ValueError, RecursionError) as error:
        raise ChoicesError(f"is not TOML: {str(error)[:200]}", where=where, advice=advice) from error
    for name, one in choices.chosen.items():
        if (one.value is None) == (one.file is None) or ".." in PurePosixPath(one.file or "").parts:
            raise ChoicesError(f"chosen.{name}: neither a value nor a file's path", where=where, advice=advice)
    return choices


# A run goes on with what was chosen.


class GoingOn(NamedTuple):
    """A run that goes on with what was chosen."""

    request: RunRequest
    kept: dict[str, str]
    """What it goes on with, by name, in words."""
    notes: tuple[str, ...]
    """What was chosen and is not used, or has changed since."""


def with_options(run: RunRequest, given: Mapping[str, object]) -> RunRequest:
    """Return a request with values by name: of the stages' options, and `TRADES`."""
    own = {f"--{name}": value for name, value in given.items() if name not in TRADES}
    traded: Any = {TRADED[name]: value for name, value in given.items() if name in TRADES}
    if (quality := traded.get("quality", run.quality)) not in list(Quality):
        raise ParameterError(f"no such quality: {str(quality)[:40]!r}", advice=f"one of {', '.join(Quality)}")
    return replace(run, **(traded | {"quality": Quality(quality), "options": own}))


@contextmanager
def going_on(
    session: Path,
    given: Mapping[str, object],
    run: RunRequest,
    *,
    by: str,
    forgotten: Sequence[str] = (),
    clock: Clock | None = None,
) -> Iterator[GoingOn]:
    """Give the request of a run: what is given now over what was chosen before; it is then what is chosen.

    ``given``: values by name, of stages' options and `TRADES`; ``run``: the rest (until, force ...). A dry run chooses
    nothing; what ends the run as a `UsageError`, or is a file that is refused, is chosen no longer. ``forgotten``: what
    is dropped first.
    """
    load_manifest(session)
    before = read_choices(session)
    if forgotten and run.dry_run:
        before = _without(session, before, forgotten, (clock or SystemClock()).utc_now())
    elif forgotten:
        before = forget(session, forgotten, clock=clock)
    found = _merged(session, before, given, run)
    try:
        planned(found.request, processing.pipeline.STAGES)
    except ParameterError as error:
        if found.kept:
            kept = f"saved options: {', '.join(found.kept)} (daylit choices {session})"
            error.advice = "; ".join(filter(None, (error.advice, kept)))
        raise
    after = before if run.dry_run or not given else remember(session, given, by=by, clock=clock)
    try:
        yield found
    except DaylitError as error:
        new = [name for name in given if after.chosen.get(name) != before.chosen.get(name)]
        refused = isinstance(error, UsageError | PictureFileError | ProfileError | RoomError)
        if new and (refused or error.where in map(str, given.values())):

            def as_before(_root: Folder, old: Choices, now: datetime) -> Choices:
                same = [n for n in new if old.chosen.get(n) == after.chosen.get(n)]  # others were chosen since
                return _over(old, {n: before.chosen.get(n) for n in same}, now)

            _edit(session, as_before, clock)
        raise


def _merged(session: Path, before: Choices, given: Mapping[str, object], run: RunRequest) -> GoingOn:
    plan = selected(run.until, processing.pipeline.STAGES)
    of_run, of_stages, traded = options(plan), options(), {t.replace("_", "-") for s in plan for t in s.trades}
    active, aside = _active(before, given, of_stages)
    values = dict(given)
    for name in active:
        if f"--{name}" in of_run or name in traded:
            values[name] = before.value(session, name)
    notes = [f"not used: --{name}: {why}" for name, why in aside.items()]
    notes += [note for name in active if name in values and (note := _renewed(session, name, before.chosen[name]))]
    kept = {name: shown(before.chosen[name]) for name in active if name in values}
    return GoingOn(with_options(run, values), kept, tuple(notes))


def _active(old: Choices, given: Mapping[str, object], known: Mapping[str, Option]) -> tuple[list[str], dict[str, str]]:
    """Return the names of former choices that still count, and why the others do not: the newest goes first."""
    taken, aside = list(given), {}
    for name in sorted(old.chosen.keys() - given.keys(), key=lambda n: (-old.chosen[n].at.timestamp(), n)):
        option = known.get(f"--{name}")
        rivals = [t for t in taken if option and _exclude(name, t, known)]
        if rivals:
            aside[name] = f"--{rivals[0]} was given since and replaces it"
        elif option is None and name not in TRADES and name not in PLACES:
            aside[name] = "this version of daylit has no such option"
        else:
            taken.append(name)
    for name in [n for n in taken if n not in given and f"--{n}" in known]:
        without = [o[2:] for o in known[f"--{name}"].beside if o[2:] not in taken or o[2:] in given]
        if without:
            aside[name] = f"it was for another --{without[0]}"
    names = [n for n in taken if n not in given and n not in aside and n not in PLACES]
    return sorted(names), dict(sorted(aside.items()))


def _exclude(one: str, other: str, of_stages: Mapping[str, Option]) -> bool:
    pairs = ((f"--{one}", f"--{other}"), (f"--{other}", f"--{one}"))
    return any(b in of_stages[a].excludes for a, b in pairs if a in of_stages)


def _renewed(session: Path, name: str, choice: Choice) -> str:
    """Return a note where the file that was given is another by now."""
    path = session / choice.given
    same = not choice.given or not path.is_file() or path.stat().st_size > COPIED_BYTES
    if same or file_sha256(path) == choice.sha256:
        return ""
    return f"--{name}: {path.name} has changed since it was saved; give it again to use the new content"


def shown(choice: Choice) -> str:
    """Return what was chosen, in a few words."""
    return str(choice.value) if choice.file is None else PurePosixPath(choice.given or choice.file).name
