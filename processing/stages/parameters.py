"""What a user may say to each stage: its parameters, and the command line options that set them.

A parameter is written once, as a field: its name, type, limits and default are what pydantic checks, its description is
the help of ``daylit process``, and its option is ``--`` and its name without the unit (`margin_deg`: ``--margin``).
A stage's parameters stand here, apart from its code, because they are needed to see whether the code has to run at
all; nothing but pydantic is imported.
"""

import math
import re
import types
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self, Union, get_args, get_origin

from pydantic import BaseModel, ConfigDict, Field, PrivateAttr, field_validator, model_validator
from pydantic.fields import FieldInfo

OptionKind = Literal["parameter", "file", "folder", "answer"]
MOST_STAGED = 7  # alternatives: as many as the paper shows
MOST_DROP = 0.3  # of a frame that is aimed by hand: what shift lenses do (chosen)
WIDEST_MM, LONGEST_MM = 12.0, 50.0  # chosen: wider is no picture of a room, longer shows single pixels of a panorama
WORDS = ("own", "fuse")  # what --segmenter takes beside a file
NO_SUCH = "no such alternative"  # why an artifact of an alternative that was not requested is left out
_UNIT = re.compile(r"_(deg|m)$")
_AIM = "Add stills of your own first: YAW,LENS[,DROP];… (degrees, mm, fraction of the height)."
_LABEL = "Leave the visible label off staged and emptied pictures (their metadata still declare it)."
_ORIGINALS = "Web address of the unaltered originals: altered pictures get a QR code that leads there."


class StageParameters(BaseModel):
    """Base of every stage's parameters: frozen, no unknown keys, no NaN or infinity. Every field has a default."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, defer_build=True)
    derived: ClassVar[tuple[str, ...]] = ()
    """Properties that count themselves, not the fields they are made of."""
    _note: Callable[[str], None] | None = PrivateAttr(None)

    def noting(self, note: Callable[[str], None]) -> Self:
        """Return the parameters as a stage gets them: ``note(name)`` learns which it reads (paths count by content)."""
        copied = self.model_copy()
        copied._note = note  # noqa: SLF001 (its own)
        return copied

    def __getattribute__(self, name: str) -> Any:
        get = super().__getattribute__
        model = get("__class__")
        field = model.__pydantic_fields__.get(name)
        if field is None and name not in model.derived:
            return get(name)
        private = get("__pydantic_private__")
        note = private["_note"] if private else None
        if note is None:
            return get(name)
        if field is not None:
            if not field.exclude:
                note(name)
            return get(name)
        private["_note"] = None
        try:
            note(name)
            return get(name)
        finally:
            private["_note"] = note


@dataclass(frozen=True)
class Option:
    """The command line option of one parameter, e.g. ``--k1``.

    ``parameter``: a value. ``file``, ``folder``: a path that the stage reads; its content counts, not its name.
    ``answer``: a file that takes the place of the artifact ``artifact``; the stage then does not run.
    """

    flag: str
    kind: OptionKind
    name: str
    """Of the parameter."""
    help: str
    type: type = str
    """float, int, str or bool (a switch) of a value."""
    choices: tuple[str, ...] = ()
    artifact: str = ""
    excludes: tuple[str, ...] = ()
    """Flags that would do nothing beside this one: a run that asks for both is refused."""
    beside: tuple[str, ...] = ()
    """Flags without which this one would do nothing."""
    installed: bool = False
    """Of a file: own, fuse and nothing stand for the installed model's file, or for none
    (`processing.segmentation.installed`)."""


@cache
def options_of(model: type[StageParameters]) -> tuple[Option, ...]:
    """Return the options of a stage's parameters, in their order."""
    return tuple(_option(name, field) for name, field in model.model_fields.items())


def _option(name: str, field: FieldInfo) -> Option:
    how: dict[str, Any] = dict(field.json_schema_extra) if isinstance(field.json_schema_extra, dict) else {}
    flag = how.pop("flag", "--" + _UNIT.sub("", name).replace("_", "-"))
    kind = how.pop("kind", "parameter")
    value, choices = _value_type(field.annotation)
    text = field.description or name
    if kind == "parameter" and field.default is not None and value is not bool:
        default = f"{field.default:g}" if value is float else field.default
        text = f"{text} (default: {default})."
    frozen: dict[str, Any] = {key: tuple(each) if isinstance(each, list) else each for key, each in how.items()}
    return Option(flag, kind, name, text, value, choices, **frozen)


def _value_type(annotation: Any) -> tuple[type, tuple[str, ...]]:
    """Return a field's plain type and choices: float of ``Positive | None``, str and its words of a Literal."""
    if get_origin(annotation) is Annotated:
        return _value_type(get_args(annotation)[0])
    if get_origin(annotation) in (Union, types.UnionType):
        return _value_type(next(part for part in get_args(annotation) if part is not type(None)))
    if get_origin(annotation) is Literal:
        return str, tuple(map(str, get_args(annotation)))
    return annotation, ()


def path_field(kind: OptionKind, text: str, **how: Any) -> Any:
    """Return a field that is a path, if given: the content of the file counts for the result, not its name.

    ``how``: ``artifact``, ``excludes`` and ``beside`` of `Option`.
    """
    return Field(None, description=text, exclude=True, json_schema_extra={"kind": kind, **how})


Positive = Annotated[float, Field(ge=1e-12, le=1e12)]
Profile = Annotated[Path | None, path_field("file", "Rig profile written by `daylit rig calibrate`.")]
Seed = Annotated[int, Field(ge=0, lt=2**63, description="Random seed of arrangements and rendering")]
FurnitureFolder = Annotated[
    Path | None, path_field("folder", "Folder of your own furniture models (glTF, OBJ, 3D-FUTURE).")
]


class MergeParameters(StageParameters):
    """Of the stage merge."""

    calibration: Profile = None
    side: Literal["both", "indoor", "outdoor"] = Field("both", description="Brackets to merge")
    frames: Literal["auto", "raw", "jpeg"] = Field("auto", description="auto: raw frames where the profile covers them")


class CalibrateParameters(StageParameters):
    """What a user may say about the scale, the lens and the sky."""

    calibration: Profile = None
    k1: Positive | None = Field(None, description="Scale of the indoor picture (eq. 1), instead of meter and target.")
    k2: Positive | None = Field(None, description="Ratio between the cameras (eq. 2), instead of the rig profile's.")
    target: str | None = Field(
        None,
        description="Where the meter pointed in the panorama: LON,LAT in degrees. Default: as recorded, else the "
        "detected target board.",
    )
    outdoor_lux: Positive | None = Field(
        None, description="Horizontal illuminance measured outdoors, lx: checks k2, or sets the scale without one."
    )
    repair_sun: Literal["no", "illuminance", "clear-sky"] = Field(
        "no", description="Restore a clipped sun from measured illuminance or a clear-sky model"
    )
    outdoor_view: Literal["hemispherical", "equidistant", "equirectangular"] = Field(
        "equidistant", description="Projection of the calibrated sky"
    )
    outdoor_field_deg: float = Field(
        180.0,
        gt=60,
        le=250,
        description="Field of view of the outdoor image circle, degrees, without a lens calibration",
    )
    outdoor_top_deg: float | None = Field(
        None, description="Compass azimuth of the outdoor picture's top, degrees. Default: from the sun or the heading."
    )
    eye_lens: str | None = Field(
        None,
        pattern=r"^(equidistant|equisolid|stereographic|orthographic),[1-9]\d{0,2}(\.\d+)?$",
        description="MAPPING,DEGREES of a fisheye at the eye, if no lens calibration has it (else equisolid,180).",
    )
    falloff: Literal["auto", "off"] = Field(
        "auto", description="Correct vignetting; auto: from the profile, else from published lens data"
    )
    glare: Literal["auto", "keep"] = Field(
        "auto", description="Veiling glare of the lens (from around the image circle, or lamp tests); auto: subtract it"
    )

    @field_validator("target")
    @classmethod
    def _two_angles(cls, value: str | None) -> str | None:
        if value is not None:
            cls.angles_rad(value)
        return value

    @staticmethod
    def angles_rad(value: str) -> tuple[float, float]:
        """Return longitude and latitude in radians of "LON,LAT" in degrees; `ValueError` where it is no direction."""
        try:
            longitude, latitude = (float(part) for part in value.split(","))
        except ValueError:
            raise ValueError(f"{value!r} is not LON,LAT in degrees") from None
        if not (abs(longitude) <= 180 and abs(latitude) <= 90):
            raise ValueError(f"{value!r}: longitude is -180 to 180, latitude -90 to 90 degrees")
        return math.radians(longitude), math.radians(latitude)


class RoomParameters(StageParameters):
    """What a user may say about the room."""

    room: Path | None = path_field(
        "file", "Room from `daylit room`, instead of an estimated one.", excludes=["--camera-height", "--layout-model"]
    )
    segmenter: Path | None = path_field(
        "file",
        "Network that labels furniture and windows: own (the built-in one), fuse (built-in plus one from "
        "`daylit models`; the default if installed), or a file of your own (ONNX, TFLite).",
        installed=True,
    )
    segmenter_contract: Path | None = path_field(
        "file", "JSON description of your network's inputs and outputs.", beside=["--segmenter"]
    )
    layout_model: Path | None = path_field("file", "Layout network to use: HorizonNet, LED2-Net or LGT-Net as ONNX.")
    camera_height_m: Annotated[float, Field(ge=0.1, lt=20)] | None = Field(
        None, description="Height of the panorama camera's lens, metres; sets the room's scale. Default: the session's."
    )
    level: Literal["auto", "off"] = Field("auto", description="Level a tilted panorama")

    @model_validator(mode="after")
    def _contract_of_a_file(self) -> Self:
        if (self.segmenter_contract is None) == (self.segmenter is not None and str(self.segmenter) not in WORDS):
            raise ValueError("--segmenter FILE and --segmenter-contract belong together; own and fuse have none")
        return self


class DetectParameters(StageParameters):
    """What a user may say about masks."""

    mask: Path | None = path_field(
        "answer",
        "Mask of what to remove (white), instead of detecting it.",
        artifact="target",
        excludes=["--margin", "--sunlight", "--keep-sunlight", "--mask-add", "--mask-keep", "--mask-sunlight"],
    )
    mask_add: Path | None = path_field("file", "Mask of what else to remove (white), besides what is detected.")
    mask_keep: Path | None = path_field("file", "Mask of what to keep (white), whatever is detected.")
    mask_sunlight: Path | None = path_field("file", "Mask of direct sunlight (white), whatever is detected.")
    margin_deg: float = Field(0.6, ge=0, le=10, description="Grow the removal mask beyond what was detected, degrees")
    sunlight: Literal["auto", "off"] = Field("auto", description="Detect and remove direct sunlight")


class _InTheRoom(StageParameters):
    """Whether a stage that hangs on the room's shape goes on where that is doubtful."""

    doubtful_room: bool = Field(
        False, description="Empty and stage even if the room's shape is doubtful (confidence below 0.3)."
    )


class LightParameters(_InTheRoom):
    """What a user may say about the light that old furniture takes."""

    shade: Literal["lift", "keep"] = Field("lift", description="Lift or keep the shading that removed furniture cast")


class RemoveParameters(_InTheRoom):
    """What a user may say about removal."""

    trusted_walls: bool = Field(False, description="In a doubtful room, remove only what touches trusted walls.")
    keep_sunlight: bool = Field(False, description="Leave patches of direct sunlight in place (rules out relighting).")
    filler: Path | None = path_field("file", "Inpainting network to use: a LaMa export (ONNX).")
    filler_channels: Literal["rgb", "bgr"] = Field(
        "rgb", description="Channel order of --filler", json_schema_extra={"beside": ["--filler"]}
    )


class _Furnished(_InTheRoom):
    """Which furniture is wanted, for the stages that need to know."""

    derived = ("wanted",)

    set: Literal["bedroom", "living", "dining", "office", "auto", "none"] = Field("auto", description="Furniture set")
    items: str | None = Field(
        None,
        description='List of furniture, instead of a set: "bed, 2 nightstand".',
        json_schema_extra={"excludes": ["--set"]},
    )

    @property
    def wanted(self) -> bool:
        """Whether the room is to be furnished."""
        return self.items is not None or self.set != "none"


class MaterialsParameters(_Furnished):
    """What a user may say about what the room is made of, and whether it is to be staged at all."""

    reveal_m: Annotated[float, Field(ge=0, le=2)] | None = Field(
        None, description="Depth of the window reveals, metres. Default: a typical one."
    )


class ArrangeParameters(_Furnished):
    """What is to stand in the room."""

    arrangement: Path | None = path_field("answer", "arrangement.json from `daylit arrange`.", artifact="arrangement")
    pin: str | None = Field(None, description='Place pieces by hand, ITEM=X,Y,DEGREES: "sofa=0.2,1.5,90; desk=1,0,0".')
    furniture: FurnitureFolder = None
    rules: Literal["comfort", "standard", "tight", "accessible"] = Field("standard", description="Rule set")
    alternatives: int = Field(3, ge=1, le=MOST_STAGED, description=f"Number of arrangements, 1 to {MOST_STAGED}")
    seed: Seed = 0

    @model_validator(mode="after")
    def _lists_are_read_before_stages_run(self) -> Self:
        if self.items is not None and self.furniture is None:
            from processing.layout.items import parse_items

            parse_items(self.items)
        if self.pin:
            from processing.layout.given_places import parse_pins

            parse_pins(self.pin)
        return self


class RenderParameters(StageParameters):
    """How furniture is put into the picture."""

    method: Literal["differential", "global"] = Field(
        "differential",
        description="differential: change the photograph where furniture changes its light; global: render everything",
    )
    furniture: FurnitureFolder = None
    style: Literal["scandinavian", "mid-century", "classic", "industrial"] | None = Field(
        None, description="Furniture style. Default: each in turn."
    )
    styling: Literal["none", "light", "full"] = Field(
        "full", description="Add decor: light adds curtains, rugs, art and lamps; full also small objects and plants"
    )
    lamps: Literal["off", "on"] = Field("off", description="Switch on the added lamps (lumens in staged.json)")
    seed: Seed = 0


class ReportParameters(StageParameters):
    """What a user may say about the page."""

    no_staged_label: bool = Field(False, description=_LABEL)
    original_url: str | None = Field(None, pattern=r"^https?://[!-~]{3,300}$", description=_ORIGINALS)


class DayParameters(ReportParameters):
    """What the day must know of the furniture, and what a user may say about its pictures."""

    furniture: FurnitureFolder = None


class StillsParameters(ReportParameters):
    """What a user may say about stills."""

    aim: str | None = Field(
        None, pattern=r"^(-?(\d+\.?\d*|\.\d+)(,(\d+\.?\d*|\.\d+)){1,2}(;|$)){1,6}$", description=_AIM
    )

    @field_validator("aim")
    @classmethod
    def _makes_pictures(cls, value: str | None) -> str | None:
        for one in filter(None, (value or "").split(";")):
            lens_mm, drop = [*map(float, one.split(",")[1:]), 0.0][:2]
            if not WIDEST_MM <= lens_mm <= LONGEST_MM or drop > MOST_DROP:
                ends = f"a lens has {WIDEST_MM:g} to {LONGEST_MM:g} mm, a drop is 0 to {MOST_DROP:g}"
                raise ValueError(f"{one}: not a valid framing: {ends}")
        return value
