"""Section of the report on light at the camera: illuminance around, glare, luminance of the room's parts."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from processing.errors import ParameterError
from processing.report.data import Picture, Quantity, Section, Table, number_text
from processing.report.plots import empty_figure, svg_bytes

# The rose of light: how much falls on upright planes, by the direction they face.


def illuminance_rose(values: Sequence[float], unit: str) -> bytes:
    """Return an SVG of values (0 or more) evenly around from straight ahead, clockwise as seen from above."""
    if not values or not all(math.isfinite(value) and value >= 0 for value in values):
        raise ParameterError("a rose shows one value or more, all finite and from 0")
    figure = empty_figure(4.6, 4.6)
    axes: Any = figure.add_subplot(projection="polar")
    axes.set_theta_zero_location("N")
    axes.set_theta_direction(-1)
    angles = 2 * np.pi * np.arange(len(values)) / len(values)
    axes.bar(angles, values, width=0.92 * 2 * np.pi / len(values), color="#2f5d50", alpha=0.85, linewidth=0)
    axes.set_xticks(np.pi / 2 * np.arange(4), ("ahead", "right", "back", "left"))
    axes.set_ylim(0, max(values) * 1.05 or 1.0)
    axes.tick_params(axis="y", labelsize=8, colors="#5c6269")
    axes.set_rlabel_position(22.5)
    axes.spines["polar"].set_visible(False)
    axes.grid(linewidth=0.4, alpha=0.6)
    axes.set_title(unit, fontsize=9, color="#5c6269", loc="right")
    return svg_bytes(figure)


_AROUND = ("ahead", "ahead right", "right", "back right", "back", "back left", "left", "ahead left")
_COMPASS = ("N", "NE", "E", "SE", "S", "SW", "W", "NW")


def light_figures_section(figures: Mapping[str, Any]) -> Section:
    """Return the figures of the stage of that name: illuminances with uncertainties, glare, statistics."""
    camera, units = figures["camera"], figures["units"]
    unit = units["illuminance"]
    quantities = [
        _quantity("On a level plane at the camera", camera["level_up"], unit),
        Quantity("Cylindrical", _tidy(camera["cylindrical"]), unit, note="mean of all upright planes"),
    ]
    if outdoor := figures.get("outdoor"):
        quantities.append(_quantity("On level ground outdoors", outdoor["level_up"], unit))
    if (ratio := figures.get("level_ratio")) is not None:
        note = "under an overcast sky the daylight factor"
        quantities.append(Quantity("Inside over outside", _tidy(100 * ratio), "%", note=note))
    worst = _worst_glare(camera["directions"])
    if worst is not None:
        look, name = worst
        text = f"{look['glare']['told']}, looking {name}"
        quantities.append(Quantity("Highest glare probability (DGP)", round(look["glare"]["dgp"], 3), "", note=text))
    rose = illuminance_rose([look["vertical"]["value"] for look in camera["directions"]], unit)
    pictures = (Picture("Illuminance on upright planes", rose, "rose of illuminance by direction of view"),)
    text = f"At the camera, {camera['height_m']:.2f} m above the floor. Uncertainties include the common scale."
    if not figures["absolute"]:
        text += " The scale of the light is not known: values are relative, and glare is not told."
    tables = [_directions_table(camera["directions"], unit), *_meter_table(figures.get("meter"))]
    tables.append(_surface_table(figures["surfaces"], units["luminance"]))
    return Section("Light and glare", text, tuple(quantities), pictures, tuple(tables))


def _quantity(name: str, value: Mapping[str, Any], unit: str) -> Quantity:
    note = "a lower bound: part of the light is clipped or unseen" if value["lower_bound"] else ""
    return Quantity(name, value["value"], unit, value["uncertainty"], note)


def _worst_glare(directions: Sequence[Mapping[str, Any]]) -> tuple[Mapping[str, Any], str] | None:
    told = [(look, _name(look, k)) for k, look in enumerate(directions) if "glare" in look]
    return max(told, key=lambda one: one[0]["glare"]["dgp"]) if told else None


def _name(look: Mapping[str, Any], number: int) -> str:
    name = _AROUND[number % len(_AROUND)]
    if look["compass_deg"] is None:
        return name
    return f"{name} ({_COMPASS[round(look['compass_deg'] / 45) % 8]}, {look['compass_deg']:.0f}°)"


def _directions_table(directions: Sequence[Mapping[str, Any]], unit: str) -> Table:
    glare = any("glare" in look for look in directions)
    head = ("looking", f"illuminance at the eye ({unit})", *(("DGP", "glare", "sources") if glare else ()))
    rows = []
    for k, look in enumerate(directions):
        light = look["vertical"]
        row = [_name(look, k), number_text(light["value"], light["uncertainty"]) + (" or more" * light["lower_bound"])]
        if glare:
            found = look["glare"]
            row += [f"{found['dgp']:.3f}", found["told"] + (", little light" * found["faint"]), str(found["sources"])]
        rows.append(tuple(row))
    return Table("By direction of view", head, tuple(rows))


def _meter_table(meter: Mapping[str, Any] | None) -> list[Table]:
    if not meter:
        return []
    readings = ", ".join(number_text(value) for value in meter["readings_cd_m2"])
    difference = meter["difference_frac"]
    kind = "agree by construction: k1 is from these readings" if meter["sets_scale"] else "a check: k1 was given"
    row = (f"{readings} cd/m²", f"{number_text(meter['picture_cd_m2'])} cd/m²")
    apart = "" if difference is None else f"{100 * difference:+.2f} %"
    return [Table("Meter and picture", ("meter", "picture there", "apart", "what it says"), ((*row, apart, kind),))]


def _surface_table(surfaces: Sequence[Mapping[str, Any]], unit: str) -> Table:
    head = ("part", f"mean ({unit})", "5 %", "median", "95 %", "highest", "clipped")
    names = ("mean", "p05", "median", "p95", "highest")
    rows = tuple(
        (str(one["name"]), *(number_text(_tidy(one[name])) for name in names), f"{100 * one['clipped_share']:.2g} %")
        for one in surfaces
    )
    return Table("Luminance of the room's parts", head, rows)


def _tidy(value: float) -> float:
    """Return a value to three digits: what has no uncertainty beside it should not look as if it were exact."""
    return round(value, 2 - math.floor(math.log10(abs(value)))) if value and math.isfinite(value) else value
