"""``daylit inspect``: what a picture says, as a whole and at a place."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click


@click.command()
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--at", metavar="LON,LAT", multiple=True, help="Degrees: right of the centre, up (repeatable).")
@click.option(
    "--radius", type=float, default=1.0, show_default=True, metavar="DEGREES", help="Of what lies around a place."
)
@click.option("--json", "as_json", is_flag=True, help="One JSON object.")
def inspect(file: Path, at: tuple[str, ...], radius: float, *, as_json: bool) -> int:
    """Say what FILE (EXR, Radiance HDR, JPEG, PNG) holds: unit, range, metadata; with --at, the value at a place.

    \b
    Examples:
      daylit inspect sessions/2023-05-19T1554Z_coda-320/stages/calibrate/indoor.exr --at 30,-10
      daylit inspect sky.hdr --at 0,90 --radius 5 --json
    """
    from processing.exchange.inspection import picture_facts, place_facts
    from processing.exchange.opening import open_picture

    picture = open_picture(file)
    places = [place_facts(picture, *_angles(one), radius) for one in at]
    facts = picture_facts(picture)
    if as_json:
        click.echo(json.dumps({"ok": True, "file": file.name, **facts, "places": places}))
        return 0
    for line in (*_lines(facts), *(line for place in places for line in _place_lines(place))):
        click.echo("".join(c if c.isprintable() else "?" for c in line))
    return 0


def _angles(text: str) -> tuple[float, float]:
    from processing.errors import ParameterError

    try:
        lon, lat = (float(part) for part in text.split(","))
    except ValueError:
        raise ParameterError(f"--at {text[:40]}: two numbers, longitude and latitude in degrees") from None
    return lon, lat


def _lines(facts: dict[str, Any]) -> list[str]:
    found = [f"{facts['kind']}, {facts['width_px']} x {facts['height_px']}, {facts['geometry']}"]
    values = {name: value for name, value in facts["range"].items() if value is not None}
    found.append(f"{facts['unit']}: " + ", ".join(f"{name} {value:.4g}" for name, value in values.items()))
    if facts["scale_uncertainty"]:
        found.append(f"uncertainty of the scale: {facts['scale_uncertainty']:.1%}")
    if pixels := facts.get("pixels"):
        found.append("pixels: " + ", ".join(f"{name} {share:.2%}" for name, share in pixels.items() if share))
    for name, value in facts["attributes"].items():
        text = value if isinstance(value, str) else json.dumps(value)
        found.append(f"  {name}: {text if len(text) < 200 else text[:200] + ' ...'}")
    return found


def _place_lines(place: dict[str, Any]) -> list[str]:
    own = place.get("relative_uncertainty")
    sure = "" if own is None else f" ± {own:.1%}"
    state = f", {place['pixel']}" if place.get("pixel", "valid") != "valid" else ""
    where = f"at {place['longitude_deg']:g}, {place['latitude_deg']:g} (column {place['column']}, row {place['row']})"
    found = [f"{where}: {place['value']:.5g}{sure} {place['unit']}{state}"]
    if around := place["around"]:
        found.append(
            f"  within {around['radius_deg']:g} degrees: mean {around['mean']:.5g}, "
            f"standard deviation {around['standard_deviation']:.3g}, "
            f"{around['lowest']:.5g} to {around['highest']:.5g}, {around['pixels']} pixels"
        )
    return found
