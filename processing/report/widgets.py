"""What the page moves: comparisons with a slider, a viewer with a luminance probe, models, cards side by side.

Plain values, made by the sections and shown by ``templates/widgets.html.j2`` with the scripts beside it.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from processing.report.data import Quantity, data_uri


@dataclass(frozen=True)
class Shot:
    """One state of the room in one picture."""

    name: str
    data: bytes
    """JPEG."""
    alt: str
    tag: str = ""
    """What stands on it under the slider, where that is not its name."""

    @property
    def uri(self) -> str:
        """The picture as a data URI."""
        return data_uri(self.data)


@dataclass(frozen=True)
class Scene:
    """One view of the room in several states, all of one size."""

    name: str
    shots: tuple[Shot, ...]
    width_px: int
    height_px: int


@dataclass(frozen=True)
class Comparison:
    """States of the room under a slider."""

    kind: ClassVar[str] = "comparison"
    scripts: ClassVar[tuple[str, ...]] = ("slider.js",)
    scenes: tuple[Scene, ...]
    first: str
    second: str
    """Names of the shots that are compared at first."""


@dataclass(frozen=True)
class ViewerState:
    """One state of the room in the 360-degree viewer, and its numbers."""

    name: str
    jpeg: bytes
    """Codes of `encoding.picture_codes`, 2 : 1."""
    luminance: str
    uncertainty: str
    validity: str
    """Packed maps (`encoding.packed`) of the size ``map_px``."""
    map_px: tuple[int, int]
    """Width and height."""
    picture_px: tuple[int, int]
    """Of the picture on disk, of which each place of the map is one pixel."""
    file: str = ""
    """Where that is, relative to the session's folder."""
    staged: bool = False


@dataclass(frozen=True)
class Viewer:
    """A panorama to look around in, with exposure, false colours and a probe."""

    kind: ClassVar[str] = "viewer"
    scripts: ClassVar[tuple[str, ...]] = ("pannellum.js", "encoding.js", "probe.js", "viewer.js")
    states: tuple[ViewerState, ...]
    middle: float
    """On the tone curve, of the middle code of `encoding.picture_codes`."""
    white: float
    """What the tone curve shows as white, at no change of exposure."""
    range: tuple[float, float]
    """Ends of the false colours."""
    ticks: tuple[float, ...]
    colours: bytes
    """(256, 3) sRGB from low to high."""
    unit: str
    yaw_deg: float = 0.0
    label: str = ""
    """Shown on staged states."""

    @property
    def ramp(self) -> str:
        """The colours as a CSS gradient, from the bottom upwards."""
        stops = [tuple(self.colours[3 * i : 3 * i + 3]) for i in range(0, 256, 15)]
        return f"linear-gradient(to top, {', '.join(f'rgb({r} {g} {b})' for r, g, b in stops)})"

    @property
    def json(self) -> str:
        """All of it for the script, safe within HTML."""
        states = [_plain(state) for state in self.states]
        facts = {
            name: getattr(self, name) for name in ("middle", "white", "range", "ticks", "unit", "yaw_deg", "label")
        }
        return safe_json({**facts, "colours": base64.b64encode(self.colours).decode("ascii"), "states": states})


@dataclass(frozen=True)
class Model:
    """A scene in three dimensions."""

    name: str
    glb: bytes
    alt: str

    @property
    def text(self) -> str:
        """The file in base64."""
        return base64.b64encode(self.glb).decode("ascii")


@dataclass(frozen=True)
class Models:
    """Scenes to turn around, one at a time."""

    kind: ClassVar[str] = "models"
    scripts: ClassVar[tuple[str, ...]] = ("model-viewer-umd.min.js", "model.js")
    models: tuple[Model, ...]
    note: str = ""


@dataclass(frozen=True)
class Card:
    """A picture with a few figures."""

    title: str
    data: bytes
    alt: str
    text: str = ""
    quantities: tuple[Quantity, ...] = ()

    @property
    def uri(self) -> str:
        """The picture as a data URI."""
        return data_uri(self.data)


@dataclass(frozen=True)
class Cards:
    """Pictures side by side: alternatives, times of day."""

    kind: ClassVar[str] = "cards"
    scripts: ClassVar[tuple[str, ...]] = ()
    cards: tuple[Card, ...]


Widget = Comparison | Viewer | Models | Cards


def safe_json(value: object) -> str:
    """Return JSON that cannot end a script element or begin a comment."""
    text = json.dumps(value, ensure_ascii=True, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def _plain(state: ViewerState) -> Mapping[str, Any]:
    names = ("name", "luminance", "uncertainty", "validity", "map_px", "picture_px", "file", "staged")
    return {**{name: getattr(state, name) for name in names}, "jpeg": base64.b64encode(state.jpeg).decode("ascii")}
