"""The result: arrangements as data, JSON in and out; what the rendering stage reads.

A piece stands where its local frame (`items.py`: floor middle of its footprint, +y front, z up) is moved by
x' = R_z(theta) x + t, t in metres of the room's frame (docs/reference/coordinates.md).
"""

import json
import math
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from processing.errors import LayoutError
from processing.ground.room_model import read_json
from processing.pictures.writing import write_bytes
from station.session import strict_json

MAX_BYTES = 1 << 26  # chosen: an arrangement takes a few kilobytes

Finite = Annotated[float, Field(allow_inf_nan=False)]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class PlacedItem(_Strict):
    """A piece where it stands."""

    id: str
    category: str
    model: str = ""
    size_m: tuple[Finite, Finite, Finite]
    base_m: Finite = 0.0
    theta_rad: Finite
    t_m: tuple[Finite, Finite, Finite]
    """(x, y, height of its underside)."""
    group: str = ""
    """Id of the piece it is placed with; its own where it stands alone."""
    edge: int | None = None
    """The wall its group stands at."""
    use_zones_m: tuple[tuple[Finite, Finite, Finite, Finite], ...] = ()
    """Floor kept free for its use: x0, x1, y0, y1 in its local frame."""
    pinned: bool = False

    def place(self, x_m: float, y_m: float) -> tuple[float, float]:
        """Return a place of its local frame in the room, metres."""
        c, s = math.cos(self.theta_rad), math.sin(self.theta_rad)
        return self.t_m[0] + x_m * c - y_m * s, self.t_m[1] + x_m * s + y_m * c


class NotPlaced(_Strict):
    """A piece that found no place, and why."""

    id: str
    category: str
    rule: str
    """The hard rule that stops it."""
    obstacle: str = ""
    missing_m: Finite | None = None
    """By how much the widest gap is too narrow, where that is the reason."""
    reason: str


class Arrangement(_Strict):
    """One arrangement that breaks no hard rule."""

    rank: int
    items: tuple[PlacedItem, ...]
    score: Finite
    scores: dict[str, Finite]
    rule_set: str
    meets: tuple[str, ...] = ()
    """All rule sets whose hard rules it meets."""
    not_placed: tuple[NotPlaced, ...] = ()
    differs_by: str = ""
    """How it differs from those ranked before it."""

    @property
    def complete(self) -> bool:
        """Whether all items asked for are placed."""
        return not self.not_placed


class Arrangements(_Strict):
    """What `arrange` gives: the plan, what was asked, and the arrangements: the best, then what differs most."""

    version: Literal[1] = 1
    plan: dict[str, Any]
    rule_set: str
    asked: tuple[str, ...]
    seed: int
    arrangements: tuple[Arrangement, ...]
    notes: tuple[str, ...] = ()

    def write(self, path: Path) -> None:
        """Write the JSON file."""
        write_bytes(path, (self.model_dump_json(indent=1) + "\n").encode("utf-8"))


def read_arrangements(path: Path) -> Arrangements:
    """Read `arrangement.json`; raise `LayoutError` where it is none."""
    try:
        return Arrangements.model_validate_json(json.dumps(read_json(path, LayoutError, MAX_BYTES)))
    except ValidationError as error:
        found = "; ".join(strict_json.faults_of(error)[:3])
        raise LayoutError(f"not a valid arrangement file: {found}", where=path.name) from None
