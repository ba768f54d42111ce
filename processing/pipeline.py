"""THE table of stages: what is done with a session, in which order, and from what.

Adding a stage is adding a row here, a class in `processing.stages.parameters` and a module in `processing.stages`
(docs/reference/pipeline.md shows one). Functions and models are named as "module:name" and imported only when they are
used, so that this table costs nothing. The options of the command line follow from a stage's parameters.
Whatever can change a stage's result is in its row: the runner makes the fingerprint of it, and lets the stage see no
more of the session than that.
"""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from processing.errors import ParameterError

if TYPE_CHECKING:
    from processing.stages.parameters import Option, StageParameters

ArtifactKind = Literal["picture", "mask", "json", "file"]
Trade = Literal["quality", "max_error", "time_budget"]


@dataclass(frozen=True)
class Artifact:
    """One thing that a stage makes: a picture (EXR), a mask (bool (H, W), PNG), JSON, or a file of its own."""

    name: str
    kind: ArtifactKind
    optional: bool = False
    """Whether the stage may leave it out, saying why."""
    file_name: str = ""
    """Of kind "file"; the others are NAME.exr, NAME.png and NAME.json."""
    model: str = ""
    """Of kind "json": "module:name" of the pydantic model that stages exchange; none: they exchange plain values."""
    fits: str = ""
    """Of what users may give: "module:function" that takes the value and the stage's context and raises a typed error
    where it does not fit what earlier stages made; may return warnings."""


@dataclass(frozen=True)
class Stage:
    """A row of the table."""

    name: str
    version: int
    """Raised whenever the same inputs give another result."""
    title: str
    function: str
    """``run(context: StageContext) -> StageOutput``."""
    needs: tuple[str, ...] = ()
    """Earlier stages whose artifacts it reads."""
    data: tuple[str, ...] = ()
    """Files of the program (within `processing/`) that its result depends on: the shipped network."""
    reads: tuple[str, ...] = ()
    """Fields of the session's manifest that it may see, and "folder": the session's files as they are on disk.
    "relight": what `daylit relight` made of it."""
    makes: tuple[Artifact, ...] = ()
    parameters: str = "processing.stages.parameters:StageParameters"
    skip_rule: str = ""
    """``reason(context) -> str | None``: why there is nothing to do."""
    trades: tuple[Trade, ...] = ()
    """Which of --quality, --max-error and --time-budget change what it does."""
    draft_is_standard: bool = False
    """Whether --quality draft leaves it as it is: what a draft must share with the standard (measure, room)."""

    @property
    def model(self) -> type[StageParameters]:
        """Return the class of its parameters."""
        found: type[StageParameters] = resolve(self.parameters)
        return found

    @property
    def options(self) -> dict[str, Option]:
        """Return its command line options by flag, as its parameters say."""
        from processing.stages.parameters import options_of

        return {option.flag: option for option in options_of(self.model)}


NETWORK = ("segmentation/room_network.onnx", "segmentation/room_network.json")
STILLS = range(1, 13)
STAGED = tuple(f"staged-{k}" for k in range(1, 8))

STAGES: tuple[Stage, ...] = (
    Stage("verify", 1, "check session", "processing.stages.verify:run", reads=("folder",)),
    Stage(
        "merge", 5, "merge brackets", "processing.stages.merge:run", ("verify",),
        reads=("frames", "devices", "rig", "panorama"),
        makes=(
            Artifact("indoor", "picture", True), Artifact("outdoor", "picture", True), Artifact("response", "json"),
        ),
        parameters="processing.stages.parameters:MergeParameters", skip_rule="processing.stages.merge:nothing_to_merge",
        trades=("quality", "max_error"), draft_is_standard=True,
    ),
    Stage(
        "calibrate", 5, "calibrate to cd/m2", "processing.stages.calibrate:run", ("merge",),
        reads=("site", "heading_rad", "target", "readings", "frames", "devices", "rig", "panorama"),
        makes=(
            Artifact("indoor", "picture", True), Artifact("outdoor", "picture", True), Artifact("calibration", "json"),
        ),
        parameters="processing.stages.parameters:CalibrateParameters",
    ),
    Stage(
        "room", 6, "estimate room layout", "processing.stages.room:run", ("calibrate",), NETWORK,
        reads=("camera_height_m", "site", "heading_rad", "frames"),
        makes=(
            Artifact("panorama", "picture", True),
            Artifact("room", "json", True, model="processing.ground.room_model:RoomModel"),
            Artifact("evidence", "file", True, "evidence.npz"),
        ),
        parameters="processing.stages.parameters:RoomParameters", trades=("quality",), draft_is_standard=True,
    ),
    Stage(
        "figures", 3, "compute light figures", "processing.stages.figures:run", ("calibrate", "room"),
        reads=("heading_rad", "camera_height_m", "readings"), makes=(Artifact("light_figures", "json"),),
    ),
    Stage(
        "detect", 12, "detect furniture and sunlight", "processing.stages.detect:run", ("calibrate", "room"), NETWORK,
        reads=("site", "heading_rad", "frames"),
        makes=(
            Artifact("target", "mask", fits="processing.stages.upright:check_mask_size"),
            *(Artifact(name, "mask", True) for name in ("furniture", "tripod", "sunlight", "shadow")),
        ),
        parameters="processing.stages.parameters:DetectParameters",
        skip_rule="processing.stages.detect:nothing_to_go_by", trades=("quality",), draft_is_standard=True,
    ),
    Stage(
        "light", 3, "estimate light without furniture", "processing.stages.light:run", ("calibrate", "room", "detect"),
        reads=("heading_rad",),
        makes=(Artifact("shade", "file", file_name="shade.npz"), Artifact("scene", "file", file_name="scene.npz")),
        parameters="processing.stages.parameters:LightParameters", skip_rule="processing.stages.light:nothing_to_lift",
        trades=("quality",),
    ),
    Stage(
        "remove", 9, "remove furniture", "processing.stages.remove:run", ("calibrate", "room", "detect", "light"),
        makes=(
            Artifact("empty", "picture"), Artifact("filled", "mask"), Artifact("lift", "file", True, "lift.npz"),
            Artifact("surfaces", "file", file_name="surfaces.npz"),
        ),
        parameters="processing.stages.parameters:RemoveParameters",
        skip_rule="processing.stages.remove:nothing_to_remove", trades=("quality",),
    ),
    Stage(
        "materials", 5, "estimate materials", "processing.stages.materials:run",
        ("calibrate", "room", "detect", "light", "remove"), reads=("heading_rad",),
        makes=(Artifact("materials", "json"), Artifact("scene", "file", file_name="scene.npz")),
        parameters="processing.stages.parameters:MaterialsParameters",
        skip_rule="processing.stages.materials:nothing_to_stage", trades=("quality",),
    ),
    Stage(
        "arrange", 6, "arrange furniture", "processing.stages.arrange:run", ("room",), reads=("name",),
        makes=(
            Artifact(
                "arrangement", "json", True, model="processing.layout.arrangement:Arrangements",
                fits="processing.stages.arrange:judged",
            ),
            Artifact("contact-sheet", "file", True, "contact-sheet.png"),
            *(Artifact(f"plan-{k}", "file", True, f"plan-{k}.svg") for k in range(1, 8)),
        ),
        parameters="processing.stages.parameters:ArrangeParameters",
        skip_rule="processing.stages.arrange:nothing_to_arrange",
    ),
    Stage(
        "render", 7, "render staged room", "processing.stages.render:run",
        ("calibrate", "room", "detect", "light", "remove", "materials", "arrange"),
        makes=(
            *(Artifact(name, "picture", True) for name in STAGED),
            *(Artifact(f"{name}-model", "file", True, f"{name}.glb") for name in STAGED), Artifact("staged", "json"),
        ),
        parameters="processing.stages.parameters:RenderParameters",
        skip_rule="processing.stages.render:nothing_to_render", trades=("quality", "max_error", "time_budget"),
    ),
    Stage(
        "stills", 3, "frame stills", "processing.report.stills:run",
        ("calibrate", "room", "remove", "arrange", "render"), reads=("name",),
        makes=(
            Artifact("display", "json"), Artifact("stills", "json"),
            *(Artifact(f"still-{k}", "file", True, f"still-{k}.jpg") for k in STILLS),
            *(Artifact(f"still-{k}-original", "file", True, f"still-{k}-original.jpg") for k in STILLS),
            *(Artifact(f"still-{k}-light", "file", True, f"still-{k}-light.exr") for k in STILLS),
        ),
        parameters="processing.stages.parameters:StillsParameters", skip_rule="processing.report.stills:no_panorama",
    ),
    Stage(
        "report", 7, "write report", "processing.report.stage:run",
        ("verify", "merge", "calibrate", "room", "figures", "detect", "light", "remove", "materials", "arrange",
         "render", "stills"), ("report/static/viewer.js",),
        reads=("name", "site", "frames", "devices", "relight"),
        makes=(Artifact("page", "file", file_name="index.html"), Artifact("lab", "file", file_name="lab.html")),
        parameters="processing.stages.parameters:ReportParameters",
    ),
)  # fmt: skip
"""A row: name, version, title, function, what it needs, files of the program, then by name."""


def resolve(reference: str) -> Any:
    """Import what "module:name" names."""
    module, _, name = reference.partition(":")
    return getattr(importlib.import_module(module), name)


def check_table(stages: tuple[Stage, ...]) -> None:
    """Raise `ValueError` unless names are unique, each stage needs only earlier ones, options name what is."""
    seen: set[str] = set()
    for stage in stages:
        if stage.name in seen:
            raise ValueError(f"two stages are called {stage.name}")
        unknown = set(stage.needs) - seen
        if unknown:
            raise ValueError(f"{stage.name} needs {sorted(unknown)}, which no earlier stage is")
        makes = {artifact.name for artifact in stage.makes}
        answers = {option.artifact for option in stage.options.values() if option.kind == "answer"}
        if answers - makes:
            raise ValueError(f"{stage.name} does not make {sorted(answers - makes)}")
        seen.add(stage.name)
    flags = options(stages)
    for flag, option in flags.items():
        strange = {*option.excludes, *option.beside} - set(flags)
        if strange:
            raise ValueError(f"{flag} excludes or asks for {sorted(strange)}, which no stage has")


def stage_named(name: str, stages: tuple[Stage, ...] = STAGES) -> Stage:
    """Return a row; `ParameterError` lists the names there are."""
    for stage in stages:
        if stage.name == name:
            return stage
    known = ", ".join(stage.name for stage in stages)
    raise ParameterError(f"there is no stage {name!r}", advice=f"stages: {known}")


def selected(until: str | None, stages: tuple[Stage, ...] = STAGES) -> tuple[Stage, ...]:
    """Return the stages of a run in order: all, or ``until`` and what it needs."""
    if until is None:
        return stages
    wanted = {stage_named(until, stages).name}
    for stage in reversed(stages):
        if stage.name in wanted:
            wanted |= set(stage.needs)
    return tuple(stage for stage in stages if stage.name in wanted)


def options(stages: tuple[Stage, ...] = STAGES) -> dict[str, Option]:
    """Return each option of the stages by its flag (stages may share one)."""
    return {flag: option for stage in stages for flag, option in stage.options.items()}


def trades(stages: tuple[Stage, ...] = STAGES) -> frozenset[Trade]:
    """Return what any of the stages can trade."""
    return frozenset(trade for stage in stages for trade in stage.trades)
