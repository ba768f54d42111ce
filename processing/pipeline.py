"""THE table of stages: what is done with a session, in which order, from what, and with which options.

Adding a stage is adding a row here and a module in `processing.stages` (docs/pipeline.md shows one). Functions and
parameter models are named as "module:name" and imported only when they are used, so that this table costs nothing.
Whatever can change a stage's result is in its row: the runner makes the fingerprint of it, and lets the stage see no
more of the session than that.
"""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from typing import Any, Literal

from processing.errors import ParameterError

ArtifactKind = Literal["picture", "mask", "json", "file"]
OptionKind = Literal["parameter", "file", "folder", "answer"]
ValueType = Literal["float", "int", "str", "flag"]
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
    check: str = ""
    """Of what users may give: "module:function" that takes the value and raises a typed error."""
    fits: str = ""
    """The same of the value and the stage's context: whether it fits what earlier stages made; may return warnings."""


@dataclass(frozen=True)
class Option:
    """A command line option of a stage, e.g. ``--k1``.

    ``parameter``: sets the parameter ``name``. ``file``, ``folder``: handed to the stage as ``context.files[name]``.
    ``answer``: a file that takes the place of the artifact ``name``; the stage then does not run.
    """

    flag: str
    kind: OptionKind
    name: str
    help: str
    type: ValueType = "float"
    """Of parameters."""
    excludes: tuple[str, ...] = ()
    """Flags that would do nothing beside this one: a run that asks for both is refused."""
    beside: tuple[str, ...] = ()
    """Flags without which this one would do nothing."""


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
    parameters: str = "processing.stages.contract:StageParameters"
    skip_rule: str = ""
    """``reason(context) -> str | None``: why there is nothing to do."""
    trades: tuple[Trade, ...] = ()
    """Which of --quality, --max-error and --time-budget change what it does."""
    options: tuple[Option, ...] = ()


NETWORK = ("segmentation/room_network.onnx", "segmentation/room_network.json")
SET = Option("--set", "parameter", "set", "Furniture: bedroom, living, dining, office, auto (default), none.", "str")
ITEMS = Option("--items", "parameter", "items", 'A list of furniture instead: "bed, 2 nightstand".', "str")
SEED = Option("--seed", "parameter", "seed", "Other arrangements, another draw.", "int")
FURNITURE = Option("--furniture", "folder", "furniture", "Folder of models (glTF, OBJ, 3D-FUTURE) to furnish with.")
STAGED = tuple(f"staged-{k}" for k in range(1, 8))
CALIBRATION = Option("--calibration", "file", "calibration", "Rig profile of `daylit rig calibrate`.")

STAGES: tuple[Stage, ...] = (
    Stage(
        name="verify",
        version=1,
        title="check the session",
        function="processing.stages.verify:run",
        reads=("folder",),
    ),
    Stage(
        name="merge",
        version=1,
        title="merge the brackets",
        function="processing.stages.merge:run",
        needs=("verify",),
        reads=("frames", "devices", "rig", "panorama"),
        makes=(
            Artifact("indoor", "picture", optional=True),
            Artifact("outdoor", "picture", optional=True),
            Artifact("response", "json"),
        ),
        parameters="processing.stages.parameters:MergeParameters",
        skip_rule="processing.stages.merge:nothing_to_merge",
        trades=("quality", "max_error"),
        options=(
            CALIBRATION,
            Option("--side", "parameter", "side", "Merge only indoor or outdoor.", "str"),
        ),
    ),
    Stage(
        name="calibrate",
        version=2,
        title="scale to cd/m2",
        function="processing.stages.calibrate:run",
        needs=("merge",),
        reads=("site", "heading_rad", "target", "readings", "frames", "devices", "rig", "panorama"),
        makes=(
            Artifact("indoor", "picture"),
            Artifact("outdoor", "picture", optional=True),
            Artifact("calibration", "json"),
        ),
        parameters="processing.stages.parameters:CalibrateParameters",
        options=(
            CALIBRATION,
            Option("--k1", "parameter", "k1", "Scale of the indoor picture, instead of meter and target."),
            Option("--k2", "parameter", "k2", "Scale between the cameras, instead of the rig profile's."),
            Option("--target", "parameter", "target", "LON,LAT (degrees) where the meter looked.", "str"),
            Option("--outdoor-lux", "parameter", "outdoor_lux", "Horizontal illuminance measured outside."),
            Option("--repair-sun", "parameter", "repair_sun", "A clipped sun: no, illuminance or clear-sky.", "str"),
            Option(
                "--outdoor-view", "parameter", "outdoor_view", "equidistant, hemispherical, equirectangular.", "str"
            ),
            Option("--outdoor-field", "parameter", "outdoor_field_deg", "Degrees within the outdoor image circle."),
            Option("--outdoor-top", "parameter", "outdoor_top_deg", "Compass azimuth of the outdoor picture's top."),
            Option("--falloff", "parameter", "falloff", "Vignetting correction: auto or off.", "str"),
            Option("--glare", "parameter", "glare", "Veil around the outdoor image circle: auto or keep.", "str"),
        ),
    ),
    Stage(
        name="room",
        version=4,
        title="tell the room",
        function="processing.stages.room:run",
        data=NETWORK,
        needs=("calibrate",),
        reads=("camera_height_m", "site", "heading_rad", "frames"),
        makes=(
            Artifact("panorama", "picture", optional=True),
            Artifact("room", "json", optional=True, check="processing.ground.room_model:check_room"),
            Artifact("evidence", "file", optional=True, file_name="evidence.npz"),
        ),
        parameters="processing.stages.parameters:RoomParameters",
        trades=("quality",),
        options=(
            Option(
                "--room",
                "file",
                "room",
                "Room of `daylit room`, instead of one told from the panorama.",
                excludes=("--camera-height", "--layout-model"),
            ),
            Option("--layout-model", "file", "layout_model", "ONNX of HorizonNet, LED2-Net or LGT-Net."),
            Option("--camera-height", "parameter", "camera_height_m", "Of the panorama camera, metres: the scale."),
            Option("--level", "parameter", "level", "A tilted panorama: auto makes it upright, off leaves it.", "str"),
        ),
    ),
    Stage(
        name="figures",
        version=2,
        title="tell the light",
        function="processing.stages.figures:run",
        needs=("calibrate", "room"),
        reads=("heading_rad", "camera_height_m", "readings"),
        makes=(Artifact("light_figures", "json"),),
    ),
    Stage(
        name="detect",
        version=5,
        title="find what is to be removed",
        function="processing.stages.detect:run",
        data=NETWORK,
        needs=("calibrate", "room"),
        reads=("site", "heading_rad", "frames"),
        makes=(
            Artifact("target", "mask", fits="processing.stages.upright:check_mask_size"),
            Artifact("furniture", "mask", optional=True),
            Artifact("tripod", "mask", optional=True),
            Artifact("sunlight", "mask", optional=True),
            Artifact("shadow", "mask", optional=True),
        ),
        parameters="processing.stages.parameters:DetectParameters",
        skip_rule="processing.stages.detect:nothing_to_go_by",
        trades=("quality",),
        options=(
            Option(
                "--mask",
                "answer",
                "target",
                "Picture: white is to be removed; instead of detection.",
                excludes=("--segmenter", "--segmenter-contract", "--margin", "--sunlight", "--keep-sunlight"),
            ),
            Option(
                "--segmenter",
                "file",
                "segmenter",
                "Network for segmentation of your own, ONNX or tflite.",
                beside=("--segmenter-contract",),
            ),
            Option(
                "--segmenter-contract",
                "file",
                "segmenter_contract",
                "JSON that says how to use it.",
                beside=("--segmenter",),
            ),
            Option("--margin", "parameter", "margin_deg", "Degrees by which the target reaches over what is found."),
            Option("--sunlight", "parameter", "sunlight", "auto; off: direct sunlight is not removed.", "str"),
        ),
    ),
    Stage(
        name="remove",
        version=4,
        title="empty the room",
        function="processing.stages.remove:run",
        needs=("calibrate", "room", "detect"),
        makes=(
            Artifact("empty", "picture"),
            Artifact("filled", "mask"),
            Artifact("surfaces", "file", file_name="surfaces.npz"),
        ),
        parameters="processing.stages.parameters:RemoveParameters",
        skip_rule="processing.stages.remove:nothing_to_remove",
        trades=("quality",),
        options=(
            Option("--keep-sunlight", "parameter", "keep_sunlight", "Leave direct sunlight where it is.", "flag"),
            Option("--filler", "file", "filler", "Filling network of your own: a LaMa export, ONNX."),
            Option(
                "--filler-channels",
                "parameter",
                "filler_channels",
                "Of --filler: rgb (default) or bgr.",
                "str",
                beside=("--filler",),
            ),
        ),
    ),
    Stage(
        name="materials",
        version=2,
        title="tell what surfaces reflect",
        function="processing.stages.materials:run",
        needs=("calibrate", "room", "detect", "remove"),
        reads=("heading_rad",),
        makes=(Artifact("materials", "json"), Artifact("scene", "file", file_name="scene.npz")),
        parameters="processing.stages.parameters:MaterialsParameters",
        skip_rule="processing.stages.materials:nothing_to_stage",
        trades=("quality",),
        options=(
            SET,
            ITEMS,
            Option("--reveal", "parameter", "reveal_m", "Depth of the windows' niches, metres."),
        ),
    ),
    Stage(
        name="arrange",
        version=2,
        title="arrange furniture",
        function="processing.stages.arrange:run",
        needs=("room",),
        reads=("name",),
        makes=(
            Artifact(
                "arrangement",
                "json",
                optional=True,
                check="processing.stages.arrange:check_arrangement",
                fits="processing.stages.arrange_judged:judged",
            ),
            Artifact("contact-sheet", "file", optional=True, file_name="contact-sheet.png"),
            *(Artifact(f"plan-{k}", "file", optional=True, file_name=f"plan-{k}.svg") for k in range(1, 8)),
        ),
        parameters="processing.stages.parameters:ArrangeParameters",
        skip_rule="processing.stages.arrange:nothing_to_arrange",
        options=(
            Option("--arrangement", "answer", "arrangement", "arrangement.json of `daylit arrange`, instead."),
            SET,
            ITEMS,
            FURNITURE,
            Option("--rules", "parameter", "rules", "comfort, standard (default), tight, accessible.", "str"),
            Option("--alternatives", "parameter", "alternatives", "How many, 1 to 7; default 3.", "int"),
            SEED,
        ),
    ),
    Stage(
        name="render",
        version=2,
        title="put furniture into the picture",
        function="processing.stages.render:run",
        needs=("calibrate", "room", "detect", "remove", "materials", "arrange"),
        makes=(
            *(Artifact(name, "picture", optional=True) for name in STAGED),
            *(Artifact(f"{name}-model", "file", optional=True, file_name=f"{name}.glb") for name in STAGED),
            Artifact("staged", "json"),
        ),
        parameters="processing.stages.parameters:RenderParameters",
        skip_rule="processing.stages.render:nothing_to_render",
        trades=("quality", "max_error", "time_budget"),
        options=(
            Option("--method", "parameter", "method", "differential (default), global, ibl.", "str"),
            FURNITURE,
            Option("--style", "parameter", "style", "Of the built-in furniture; default: another for each.", "str"),
            SEED,
        ),
    ),
    Stage(
        name="report",
        version=5,
        title="write the report",
        function="processing.report.stage:run",
        needs=("verify", "merge", "calibrate", "room", "figures", "detect", "remove", "materials", "arrange", "render"),
        reads=("name", "site", "frames", "devices", "relight"),
        makes=(Artifact("page", "file", file_name="index.html"),),
        parameters="processing.stages.parameters:ReportParameters",
        options=(
            Option(
                "--no-staged-label", "parameter", "no_staged_label", "Staged pictures without visible label.", "flag"
            ),
        ),
    ),
)


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
        answers = {option.name for option in stage.options if option.kind == "answer"}
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
    return {option.flag: option for stage in stages for option in stage.options}


def trades(stages: tuple[Stage, ...] = STAGES) -> frozenset[Trade]:
    """Return what any of the stages can trade."""
    return frozenset(trade for stage in stages for trade in stage.trades)
