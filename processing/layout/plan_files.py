"""Floor plans from `plan.json`; docs/reference/arrangement.md lists the keys."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from processing.errors import PlanError
from processing.ground.room_model import read_json
from processing.layout.plan import HEAD_M, HEIGHT_M, SILL_M, Door, FloorPlan, Hung, Window, make_plan

MAX_BYTES = 4_000_000  # chosen: beyond any plan
MAX_CORNERS = 2000  # chosen: beyond any room
TO_THE_FLOOR = ("balcony", "terrace", "garden")
"""Windows that lead there are taken to reach the floor where no sill is given."""


def read_plan(path: Path) -> FloorPlan:
    """Read one plan; raise `PlanError` for a file that is absent, too large, no JSON, or no plan."""
    return plan_from_mapping(read_json(path, PlanError, MAX_BYTES), where=path.name)


def plan_from_mapping(data: object, *, where: str) -> FloorPlan:
    """Return the plan of a JSON object: polygon, openings, and what else is given."""
    if not isinstance(data, Mapping) or "polygon" not in data:
        raise PlanError("not an object with a 'polygon'", where=where)
    polygon, openings = data["polygon"], data.get("openings", [])
    holes, keep_free = data.get("holes", []), data.get("keep_free", [])
    for key, value in (("polygon", polygon), ("openings", openings), ("holes", holes), ("keep_free", keep_free)):
        if not isinstance(value, Sequence) or isinstance(value, str) or len(value) > MAX_CORNERS:
            raise PlanError(f"'{key}' is not a list of at most {MAX_CORNERS}", where=where)
    doors, windows, notes = _openings(openings, where)
    return make_plan(
        polygon,
        holes=holes,
        ceiling_height_m=_number(data, "height_m", where, HEIGHT_M),
        doors=doors,
        windows=windows,
        keep_free=[_point(point, where) for point in keep_free],
        name=str(data.get("id", where)),
        notes=notes,
    )


def plan_to_mapping(plan: FloorPlan) -> dict[str, Any]:
    """Return the JSON object that `plan_from_mapping` reads."""

    def listed(kind: str, o: Door | Window, **more: str | float) -> dict[str, Any]:
        return {"kind": kind, "edge": o.edge, "t0": o.start_m, "t1": o.end_m, **more, "to": o.name}

    doors = [listed("door", d, hinge=d.hinge, swing=d.swing) for d in plan.doors]
    windows = [listed("window", w, sill=w.sill_m, head=w.head_m) for w in plan.windows]
    hung = [listed("hung", w, sill=w.sill_m, head=w.head_m) for w in plan.hung]
    return {
        "id": plan.name,
        "polygon": plan.corners.tolist(),
        "holes": [hole.tolist() for hole in plan.holes],
        "height_m": plan.ceiling_height_m,
        "openings": [*doors, *windows, *hung],
        "keep_free": [list(point) for point in plan.keep_free],
    }


def _openings(items: Sequence[Any], where: str) -> tuple[list[Door], list[Window], list[str]]:
    doors, windows, notes = list[Door](), list[Window](), list[str]()
    for number, item in enumerate(items):
        at = f"{where}, opening {number}"
        if not isinstance(item, Mapping) or item.get("kind") not in ("door", "window", "opening", "hung"):
            raise PlanError("its 'kind' is neither door nor window nor opening nor hung", where=at)
        edge = item.get("edge")
        if isinstance(edge, bool) or not isinstance(edge, int):
            raise PlanError("its 'edge' is not a whole number", where=at)
        start_m, end_m = _number(item, "t0", at), _number(item, "t1", at)
        if item["kind"] == "hung":
            low_m, high_m = _number(item, "sill", at), _number(item, "head", at)
            windows.append(Hung(edge, start_m, end_m, low_m, high_m, str(item.get("to") or "")))
        elif item["kind"] == "window":
            windows.append(_window(item, edge, start_m, end_m, notes, at))
        else:
            doors.append(_door(item, edge, start_m, end_m, at))
    return doors, windows, notes


def _door(item: Mapping[str, Any], edge: int, start_m: float, end_m: float, where: str) -> Door:
    hinge = item.get("hinge", "unknown")
    swing = item.get("swing", "sliding" if item["kind"] == "opening" else "unknown")
    if hinge not in ("left", "right", "unknown"):
        raise PlanError("its 'hinge' is neither left nor right nor unknown", where=where)
    if swing not in ("in", "out", "sliding", "unknown"):
        raise PlanError("its 'swing' is neither in nor out nor sliding nor unknown", where=where)
    return Door(edge, start_m, end_m, hinge, swing, str(item.get("to") or ""))


def _window(item: Mapping[str, Any], edge: int, start_m: float, end_m: float, notes: list[str], where: str) -> Window:
    to = str(item.get("to") or "")
    sill_m = 0.0 if any(word in to for word in TO_THE_FLOOR) else SILL_M
    if item.get("sill") is None:
        notes.append(f"window on edge {edge}: sill not given, taken as {sill_m:g} m")
    return Window(edge, start_m, end_m, _number(item, "sill", where, sill_m), _number(item, "head", where, HEAD_M), to)


def _number(data: Mapping[str, Any], key: str, where: str, default: float | None = None) -> float:
    value = data.get(key)
    if value is None and default is not None:
        return default
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise PlanError(f"its '{key}' is not a finite number", where=where)
    return float(value)


def _point(value: Any, where: str) -> tuple[float, float]:
    try:
        x, y = (float(v) for v in value)
    except (TypeError, ValueError):
        raise PlanError("a point of 'keep_free' is not a pair of numbers", where=where) from None
    return x, y
