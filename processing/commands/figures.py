"""``daylit figures``: light figures of anybody's HDR picture or fisheye bracket."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from station.commands.views import numbers

if TYPE_CHECKING:
    from processing.figures.indices import Task
    from processing.pictures.images import LuminanceImage

READING_SIGMA = 0.02
"""Relative standard uncertainty of a luminance meter's reading (LS-160: 2 %)."""


@click.command()
@click.argument("file", type=click.Path(path_type=Path, exists=True))
@click.option("--view", help="panorama, or fisheye,MAPPING,DEGREES; without it as the file says.")
@click.option("--scale", type=click.FloatRange(min=0, min_open=True), help="cd/m2 of one unit of the file.")
@click.option("--reading", metavar="L@X,Y", help="A meter's cd/m2 at a column and row.")
@click.option("--cal", type=click.Path(path_type=Path, exists=True), multiple=True, help="A .cal file (repeatable).")
@click.option("--response", type=click.Path(path_type=Path, exists=True), help="hdrgen's .rsp, for a folder of frames.")
@click.option("--task", metavar="RIGHT,UP,ACROSS", help="Task zone in degrees: glare is 5 times its luminance.")
@click.option("--region", metavar="X0,Y0,X1,Y1", multiple=True, help="Statistics of a part, in pixels (repeatable).")
@click.option("--csv", "table", type=click.Path(path_type=Path, dir_okay=False), help="Write the figures as a table.")
@click.option(
    "--falsecolour", type=click.Path(path_type=Path, dir_okay=False), help="Write luminance as colours (PNG)."
)
@click.option("--json", "as_json", is_flag=True, help="One JSON object.")
def figures(file: Path, table: Path | None, falsecolour: Path | None, *, as_json: bool, **asked: Any) -> int:
    """Say how much light FILE shows: an EXR or Radiance HDR picture, or a folder with a fisheye's bracket.

    \b
    Examples:
      daylit figures eye.hdr --view fisheye,equidistant,180 --reading 812@500,420 --csv eye.csv
      daylit figures bracket --view fisheye,equisolid,180 --response camera.rsp --cal vignetting.cal --cal factor.cal
    """
    image = _opened(file, asked)
    found = _figures(image, asked)
    if table is not None:
        with table.open("w", newline="", encoding="utf-8") as out:
            rows = csv.writer(out)
            rows.writerow(["figure", "value", "standard_uncertainty"])
            rows.writerows([name, one["value"], one["uncertainty"]] for name, one in found.items())
    if falsecolour is not None:
        from processing.figures.parts import write_falsecolour

        write_falsecolour(falsecolour, image)
    if as_json:
        click.echo(json.dumps({"ok": True, "file": file.name, "unit": image.unit, "figures": found}))
        return 0
    for name, one in found.items():
        click.echo(f"{name:<24} {one['value']:.5g} ± {one['uncertainty']:.2g}")
    return 0


def _opened(file: Path, asked: dict[str, Any]) -> LuminanceImage:
    """Return the picture in cd/m2: by the frames' settings, a factor, a reading, or as the file says."""
    from processing.errors import ParameterError
    from processing.figures import foreign, parts

    cals = [foreign.read_cal(path) for path in asked["cal"]]
    if file.is_dir():
        words = (asked["view"] or "fisheye,equidistant,180").split(",")
        if len(words) != 3 or words[0] != "fisheye":
            raise ParameterError("a folder of frames is a fisheye's bracket", advice="--view fisheye,MAPPING,DEGREES")
        response = None if asked["response"] is None else foreign.read_rsp(asked["response"])
        frames = parts.taken_frames(file)
        [degrees] = numbers("--view", words[2], 1, "degrees")
        image = foreign.merged_bracket(frames, response, words[1], degrees)
    else:
        image = parts.picture_of(file, asked["view"])
    image = foreign.applied(image, cals)
    if asked["scale"] is not None:
        return parts.rescaled(image, asked["scale"], 0.0)
    if asked["reading"] is None:
        return image
    level, _, place = asked["reading"].partition("@")
    column, row = numbers("--reading", place, 2, "column and row after the @")
    (luminance_cd_m2,) = numbers("--reading", level, 1, "cd/m2")
    return parts.by_reading(image, luminance_cd_m2, (column, row), READING_SIGMA)


def _figures(image: LuminanceImage, asked: dict[str, Any]) -> dict[str, dict[str, float]]:
    from processing.figures import parts
    from processing.figures.indices import glare_indices
    from processing.sphere import Fisheye

    task: Task | None = None
    if asked["task"]:
        right, up, across = numbers("--task", asked["task"], 3, "degrees right, up and across")
        task = (right, up, across)
    found = parts.light_figures(image)
    if isinstance(image.geometry, Fisheye) and image.absolute:
        found |= glare_indices(image, task=task)
    for number, text in enumerate(asked["region"]):
        x0, y0, x1, y1 = (int(v) for v in numbers("--region", text, 4, "pixels: left, top, right, bottom"))
        found |= parts.region_figures(image, (x0, y0, x1, y1), f"region-{number + 1}")
    return found
