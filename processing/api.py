"""What `import daylit` offers: sessions made, processed and read from Python. Heavy libraries are imported where used.

Paths are given as `str`, `pathlib.Path` or `Session`. Errors are the ones of the command line: a `DaylitError` with
code, likely cause and advice.
"""

from __future__ import annotations

import html
import os
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from processing.errors import PlanError
from processing.layout.arrangement import Arrangements
from processing.pictures.images import LuminanceImage, RelativeImage
from processing.running.results import OnEvent, RunReport
from station.session.session import SessionManifest
from station.session.store import load_manifest

if TYPE_CHECKING:
    from processing.layout.plan import FloorPlan

AnyPath = str | os.PathLike[str]
Picture = LuminanceImage | RelativeImage  # a calibrated picture, or one of a merged bracket whose scale is unknown
IN_A_SESSION = ("room.json", "stages/room/room.json")  # where a session's room lies: by hand, or as estimated


@dataclass(frozen=True)
class Session:
    """A session on disk: a room and its sky at one moment, and what was made of them.

    It can be given wherever a path can, and ``/`` leads into it: ``session / "stages" / "calibrate"``.
    """

    path: Path

    @property
    def manifest(self) -> SessionManifest:
        """What was captured (session.json): site, devices, frames, meter readings."""
        return load_manifest(self.path)

    @property
    def stages(self) -> dict[str, str]:
        """What each stage that has run made, by its name: a list of files, or why it had nothing to do."""
        from processing.ground.finished import RESULT_NAME
        from processing.pipeline import STAGES
        from processing.running.results import parse_result

        states = {}
        for stage in STAGES:
            file = self.path / "stages" / stage.name / RESULT_NAME
            if file.is_file():
                result = parse_result(file.read_bytes())
                states[stage.name] = result.skipped or ", ".join(result.artifacts.values()) or "checked"
        return states

    @property
    def choices(self) -> dict[str, Any]:
        """What was chosen for the session, by `process` here or by any command: values and paths by option name."""
        from processing.running.choices import read_choices

        found = read_choices(self.path)
        return {name: found.value(self.path, name) for name in found.chosen}

    def __fspath__(self) -> str:
        return str(self.path)

    def __truediv__(self, name: AnyPath) -> Path:
        return self.path / name

    def _repr_html_(self) -> str:
        """Return a table for a notebook: status, frames and stages."""
        manifest, taken = self.manifest, self.manifest.taken_utc
        rows = {
            "taken": f"{taken:%Y-%m-%d %H:%M} UTC{' (simulated)' * manifest.simulated}" if taken else "unknown",
            "status": ", ".join([manifest.status.value, *manifest.missing]),
            "frames": str(len(manifest.frames)),
            **self.stages,
        }
        cells = (f"<tr><th>{html.escape(k)}</th><td>{html.escape(v)}</td></tr>" for k, v in rows.items())
        return f"<table><caption>{html.escape(self.path.name)}</caption>{''.join(cells)}</table>"


def open_session(path: AnyPath) -> Session:
    """Return the session in a folder.

    Raises `SessionNotFoundError` where there is none, and `SessionError` for a session.json that cannot be right.

    Example
    -------
    >>> session = daylit.open_session("sessions/2023-05-19T1554Z_coda-320")
    >>> len(session.manifest.frames)
    18
    """
    load_manifest(Path(path))
    return Session(Path(path))


def process(
    session: AnyPath,
    until: str | None = None,
    *,
    quality: Literal["draft", "standard", "reference"] | None = None,
    max_error: float | None = None,
    force: Sequence[str] = (),
    dry_run: bool = False,
    forget: Sequence[str] = (),
    on_event: OnEvent | None = None,
    **options: object,
) -> RunReport:
    """Bring the results of a session up to date, as ``daylit process`` does: only what has changed is computed.

    Parameters
    ----------
    session
        Folder of the session; results are written to its folder ``stages``.
    until
        The last stage that is wanted (``"calibrate"``); None: all of them.
    quality, max_error
        How much work is worthwhile, and the relative error that is good enough (0.02 is 2 %). None: as chosen before
        for this session, else ``"standard"``.
    force
        Stages that run although nothing has changed.
    dry_run
        Only report what would run, and why; choose nothing.
    forget
        Names of options that were chosen before and count no longer; ``("all",)``: all of them.
    on_event
        Called with each `RunEvent`: a stage starts, progresses, ends.
    options
        Options of the stages, spelled as on the command line with underscores: ``k1=0.5``, ``outdoor_lux=12_000``,
        ``set="none"``. The session remembers them (`processing.running.choices`): what is not given is as it was
        chosen last, here or on the command line.

    Raises `ParameterError` for options that no stage of the run has, and what a stage raises.

    Example
    -------
    >>> report = daylit.process(session, until="calibrate")
    >>> for stage in report.stages:
    ...     print(stage.stage, stage.action, stage.reason)
    """
    from processing.running.choices import check_known, going_on
    from processing.running.requests import RunRequest
    from processing.running.runner import process as run

    asked = {**options, "quality": quality, "max-error": max_error}
    given = {name.replace("_", "-"): value for name, value in asked.items() if value is not None}
    check_known(given, "daylit.process")
    request = RunRequest(until=until, force=tuple(force), dry_run=dry_run)
    with going_on(Path(session), given, request, by="daylit.process (Python)", forgotten=forget) as found:
        return run(Path(session), found.request, on_event=on_event or (lambda _event: None))


def read_picture(path: AnyPath) -> Picture:
    """Return the picture in the file ``path`` (an EXR that a stage wrote): light with its uncertainty and validity.

    Returns
    -------
    A `LuminanceImage` (calibrated) or a `RelativeImage` (merged, not yet calibrated) with

    ``rgb``: (H, W, 3) float32, linear Rec. 709, >= 0; 0.2127 R + 0.7151 G + 0.0722 B is luminance in ``unit``;
    ``uncertainty``: (H, W) float32, relative standard uncertainty of each pixel's luminance, inf where unknown;
    ``validity``: (H, W) uint8, `Validity`: 0 valid, 1 clipped, 2 dark, 3 outside of the lens's field, 4 repaired;
    ``geometry``: the projection: which pixel shows which direction;
    ``unit``: ``"cd/m2"``, or ``"relative units"`` where nothing gave the scale.

    Raises `PictureFileError` for a file that is damaged or not one of these.

    Example
    -------
    >>> picture = daylit.read_picture(session / "stages" / "calibrate" / "indoor.exr")
    >>> picture.luminance_cd_m2().max(), picture.unit
    (5432.1, 'cd/m2')
    """
    from processing.pictures.exr import read_exr

    return read_exr(Path(path))


def capture(
    room: str,
    into: AnyPath = "sessions",
    *,
    rig: AnyPath | None = None,
    simulate: str | None = None,
    size: Literal["full", "half", "quarter", "small"] = "full",
    rate: float = 1.0,
    on_event: Callable[[Any], None] | None = None,
) -> Session:
    """Capture a session with the instruments of a rig file, or with simulated ones: meter, brackets, meter.

    Parameters
    ----------
    room
        Name of the room; part of the session's folder.
    into
        Folder of sessions.
    rig
        The rig file (TOML); None: the one that ``daylit capture`` finds.
    simulate
        Instead of instruments: the world that simulated ones look at, such as ``"room"`` or ``"living-3"``.
    size, rate
        Of simulated instruments: size of their pictures, and how much faster than life their time runs (a busy
        computer may miss their answers from about 10 on).
    on_event
        Called with each `CaptureEvent`.

    Returns the session; `Session.manifest` says whether it is complete, else what is missing.

    Example
    -------
    >>> session = daylit.capture("try", simulate="room", size="small", rate=4)
    >>> session.manifest.status
    <SessionStatus.COMPLETE: 'complete'>
    """
    from station.capture.capture import Capture, CaptureRequest
    from station.capture.rig import open_named_rig

    with closing(open_named_rig(None if rig is None else Path(rig), simulate, size=size, rate=rate)) as opened:
        job = Capture.new(opened, CaptureRequest(room=room, into=Path(into)))
        for event in job.events():
            if on_event is not None:
                on_event(event)
        path = job.store.path
        job.store.close()
    return Session(path)


def simulate(
    folder: AnyPath,
    sessions: int = 1,
    *,
    use: Literal["bedroom", "living", "dining", "office", "empty"] | None = None,
    size: Literal["full", "half", "quarter", "small"] = "small",
    quality: Literal["draft", "standard", "reference"] = "draft",
    seed: int = 0,
    truth: bool = True,
) -> list[Session]:
    """Capture generated rooms with simulated instruments; those that exist already are kept.

    Parameters
    ----------
    folder
        Of the sessions; their truth (geometry, materials, light without a camera) goes to its folder ``truth``.
    sessions, seed
        How many rooms, drawn from which seed upwards.
    use
        What all rooms are for; None: drawn.
    size, quality
        Of the cameras' pictures, and how much work goes into the rooms' light (minutes for each room).
    truth
        Whether the truth is written.

    Raises `SessionExistsError` where the folder holds a data set made with other parameters, and `SessionError` where
    a session could not be made.

    Example
    -------
    >>> daylit.simulate("rooms", sessions=2, use="bedroom")
    [Session(path=PosixPath('rooms/...')), Session(path=PosixPath('rooms/...'))]
    """
    from station.errors import SessionError
    from station.simulate.plan import DatasetRequest
    from station.simulate.run import simulate as make

    asked = DatasetRequest(Path(folder), sessions=sessions, use=use, size=size, quality=quality, seed=seed, truth=truth)
    summary = make(asked)
    if summary.failed:
        name, error = next(iter(summary.failed.items()))
        raise SessionError(str(error["message"]), where=name)
    return [Session(Path(folder) / name) for name in sorted([*summary.made, *summary.kept])]


def arrange(
    room: AnyPath | FloorPlan,
    items: str = "auto",
    *,
    rules: str = "standard",
    alternatives: int = 3,
    seed: int = 0,
    keep_camera_free: bool = False,
) -> Arrangements:
    """Arrange furniture in a room so that no hard rule is broken, in several ways: the best, then what differs most.

    Parameters
    ----------
    room
        A session, a room.json, a plan.json, or a `FloorPlan`.
    items
        A set (``"bedroom"``, ``"living"``, ``"dining"``, ``"office"``), a list (``"bed, 2 nightstand"``), or
        ``"auto"``: the set of which most pieces fit.
    rules
        Rule set: ``"comfort"``, ``"standard"``, ``"tight"`` or ``"accessible"``.
    alternatives, seed
        How many arrangements, and which draw: the same seed gives the same arrangements.
    keep_camera_free
        Whether the floor around the panorama camera stays empty.

    Returns `Arrangements`: of each piece the place ``t_m`` (x, y, z in metres of the room's frame, z up) and the turn
    ``theta_rad``; what found no place, and why.

    Example
    -------
    >>> found = daylit.arrange("plan.json", "bed, 2 nightstand, desk", rules="tight")
    >>> found.arrangements[0].items[0].t_m
    (1.2, 0.4, 0.0)
    """
    from processing.layout.arrange import arrange as solve
    from processing.layout.assumed import fitting_choice
    from processing.layout.items import SETS, parse_items, set_items

    plan = floor_plan(Path(room), keep_camera_free=keep_camera_free) if isinstance(room, str | os.PathLike) else room
    name = fitting_choice(plan, rules, seed).name if items == "auto" else items
    return solve(plan, set_items(name) if name in SETS else parse_items(name), rules, n=alternatives, seed=seed)


def floor_plan(path: Path, *, keep_camera_free: bool) -> FloorPlan:
    """Return the plan of a plan.json, a room.json, or a session's folder (its room corrected by hand goes first)."""
    from processing.ground.room_model import read_json, read_room
    from processing.layout.plan import from_room_model
    from processing.layout.plan_files import plan_from_mapping

    if path.is_dir():
        for inner in IN_A_SESSION:
            if (path / inner).is_file():
                return from_room_model(read_room(path / inner), keep_camera_free=keep_camera_free, name=path.name)
        advice = f"daylit room {path} --edit, or daylit process {path} --until room"
        raise PlanError("no room yet in this session", where=str(path), advice=advice)
    data = read_json(path, PlanError)
    if isinstance(data, dict) and "floor" in data:
        return from_room_model(read_room(path), keep_camera_free=keep_camera_free, name=path.stem)
    return plan_from_mapping(data, where=path.name)
