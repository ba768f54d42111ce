"""``daylit figures``: light figures of anybody's HDR picture or fisheye bracket."""

from __future__ import annotations

import csv
import io
import json
import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from station.commands.views import answer, numbers, parameters

if TYPE_CHECKING:
    from processing.figures.glare import Task
    from processing.figures.uncertainty import Figure
    from processing.pictures.images import LuminanceImage

FIELD_SIGMA_RAD = math.radians(1.5)
"""Standard uncertainty of half a lens's field: makers' figures and lens notes of one lens differ by 6 degrees."""
READING_SIGMA = 0.02  # relative standard uncertainty of a luminance meter's reading (LS-160: 2 %)
LYING = "the picture is of the sky: its glare is for somebody lying down, looking at the zenith"


@click.command(params=parameters(__package__, "figures"))
def figures(file: Path, table: Path | None, falsecolour: Path | None, *, as_json: bool, **asked: Any) -> int:
    """Compute lighting figures of FILE: an EXR or Radiance HDR picture, or a folder with a fisheye bracket.

    \b
    Examples:
      daylit figures eye.hdr --view fisheye,equidistant,180 --reading 812@500,420 --csv eye.csv
      daylit figures room.exr --look 0 --look 90 --falsecolour room.png --falsecolour-range 1,10000
      daylit figures bracket --view fisheye,equisolid,180 --cal vignetting.cal
      daylit figures bracket --view fisheye,equisolid,180 --response camera.rsp --cal vignetting.cal --cal factor.cal
    """
    from processing.pictures.panorama import read_tags, to_srgb
    from processing.pictures.writing import write_bytes

    image = _opened(file, asked)
    ends = (limits := asked["falsecolour_range"]) and numbers("--falsecolour-range", limits, 2, "lowest and highest")
    if ends and not (falsecolour and 0 < ends[0] < ends[1]):
        raise click.UsageError(f"--falsecolour-range {limits}: give --falsecolour FILE, and ends above 0 that rise")
    found, why = _figures(image, asked)
    if file.is_dir():
        lens = replace(image.geometry, half_field_rad=image.geometry.half_field_rad - FIELD_SIGMA_RAD)  # type: ignore[arg-type, union-attr]
        for name, one in _figures(replace(image, geometry=lens), asked)[0].items():
            known, off = found[name], one["value"] - found[name]["value"]
            known["uncertainty"] = known["uncertainty"] and math.hypot(known["uncertainty"], off)
        why["movement"] = "what moved between frames is not judged: keep people and doors still, or use daylit process"
    if table is not None:
        rows = csv.writer(out := io.StringIO(newline=""))
        rows.writerow(["figure", "value", "standard_uncertainty", "bound"])
        rows.writerows([name, one["value"], one["uncertainty"], one["bound"]] for name, one in found.items())
        write_bytes(table, out.getvalue().encode())
    if falsecolour is not None:
        from processing.calibration.scale.photometry import luminance_map
        from processing.pictures.false_colour import display_range, false_colour, legend, with_legend
        from processing.pictures.preview import jpeg_bytes, png_bytes

        level = luminance_map(image)
        low, high = ends or display_range(level)
        scale = legend(low, high, image.unit, level.shape[0])
        encoded = png_bytes if falsecolour.suffix.lower() == ".png" else jpeg_bytes
        write_bytes(falsecolour, encoded(with_legend(false_colour(level, low, high), scale)))
    lines = [f"{name:<24} {_said(one)}" for name, one in found.items()]
    left_out = {} if image.absolute else {"glare": f"in {image.unit}; lx, cd/m2, glare need --scale or --reading"}
    some = image.validity[:1, :1, None].repeat(3, axis=2)  # what codes these are is no matter
    if file.is_dir() and any(to_srgb(some, read_tags(path))[1] for path in file.iterdir() if path.is_file()):
        left_out["colour profile"] = "not sRGB's, and not applied: strong colours are somewhat off"
    facts = {"ok": True, "file": file.name, "unit": image.unit, "figures": found, "left_out": left_out}
    left_out |= why
    return answer(facts, [*lines, *(f"{name}: {text}" for name, text in left_out.items())], as_json=as_json)


def _opened(file: Path, asked: dict[str, Any]) -> LuminanceImage:
    """Return the picture in cd/m2: by the frames' settings, a factor, a reading, or as the file says."""
    from processing.errors import ParameterError
    from processing.figures import foreign
    from processing.figures.cal import read_cal
    from processing.sphere import Fisheye

    if asked["scale"] is not None and asked["reading"] is not None:
        raise ParameterError("--scale and --reading both set the scale", advice="give one of them")
    if asked["response"] is not None and not file.is_dir():
        raise ParameterError("--response is a camera's: it needs a folder of frames", advice="leave it out")
    cals = [read_cal(path) for path in asked["cal"]]
    if file.is_dir():
        lens = foreign.view_geometry(asked["view"] or "fisheye,equidistant,180", 2, 1)
        if not isinstance(lens, Fisheye):
            raise ParameterError("a folder of frames needs a fisheye view", advice="--view fisheye,MAPPING,DEGREES")
        response = None if asked["response"] is None else foreign.read_rsp(asked["response"])
        frames = foreign.taken_frames(file)
        image = foreign.merged_bracket(frames, response, lens.mapping, math.degrees(2 * lens.half_field_rad))
    else:
        image = foreign.picture_of(file, asked["view"], stated=asked["scale"] is None)
    image = foreign.applied(image, cals)
    if asked["scale"] is not None:
        return foreign.rescaled(image, asked["scale"], math.inf, f"{file.name}, --scale")
    if asked["reading"] is None:
        return image
    level, _, place = asked["reading"].partition("@")
    column, row = numbers("--reading", place or level, 2, "column and row after the @")
    (luminance_cd_m2,) = numbers("--reading", level, 1, "cd/m2")
    return foreign.by_reading(image, luminance_cd_m2, (column, row), READING_SIGMA)


def _figures(image: LuminanceImage, asked: dict[str, Any]) -> tuple[dict[str, Figure], dict[str, str]]:
    """Return the figures, and what is left out or to be known of them."""
    from processing.errors import ParameterError
    from processing.figures import foreign
    from processing.figures.figures import WIDTH_PX, reduced
    from processing.figures.glare import glare_indices
    from processing.sphere import Fisheye

    task: Task | None = None
    if asked["task"]:
        right, up, across = numbers("--task", asked["task"], 3, "degrees right, up and across")
        task = (right, up, across)
        if not (abs(right) <= 180 and abs(up) <= 90 and 0 < across <= 180):
            raise ParameterError(f"--task {asked['task']}", advice="within ±180, ±90, and above 0 up to 180 degrees")
    fisheye, why = isinstance(image.geometry, Fisheye), dict[str, str]()
    has_glare = fisheye and image.absolute
    if task and not has_glare:
        raise ParameterError("--task needs a fisheye picture in cd/m2", advice="give --view, --scale or --reading")
    if (looks := asked["look"]) and (fisheye or not image.absolute):
        raise ParameterError("--look needs a panorama in cd/m2", advice="a fisheye looks along its axis")
    found = foreign.light_figures(image)
    if has_glare:
        found |= glare_indices(image, task=task)[0]
        why |= {"glare": LYING} if image.attributes.get("side") == "outdoor" else {}
    elif looks:
        seen = glare_indices(reduced(image, WIDTH_PX), [math.radians(at) for at in looks])
        found |= {f"look-{at:g}-{name}": f for at, one in zip(looks, seen, strict=True) for name, f in one.items()}
    elif image.absolute:
        why["glare"] = "a panorama's depends on where somebody looks: give --look DEG"
    boxes = [numbers("--region", text, 4, "pixels: left, top, right, bottom") for text in asked["region"]]
    names = [f"region-{number + 1}" for number in range(len(boxes))]
    return found | foreign.region_figures(image, [(int(a), int(b), int(c), int(d)) for a, b, c, d in boxes], names), why


@click.command(params=parameters(__package__, "certificate"))
def certificate(session: Path, into: Path | None, *, as_json: bool) -> int:
    """Write the certificate of a calibrated SESSION: uncertainty budgets (GUM, k = 2) and ISO/CIE 19476's indices.

    A page (index.html) and the same as JSON (certificate.json). Indices that a session cannot show are named as not
    determined.

    \b
    Examples:
      daylit certificate sessions/2023-05-19T1554Z_coda-320
      daylit certificate sessions/2023-05-19T1554Z_coda-320 --into lab --json
    """
    from processing.errors import ParameterError
    from processing.figures.certificate import certificate as found_of
    from processing.ground.finished import Finished
    from processing.pictures.exr import read_exr
    from processing.pictures.images import LuminanceImage
    from processing.pictures.writing import write_bytes
    from processing.report.page import build_certificate
    from processing.report.stage import session_facts
    from station.session.session import Side
    from station.session.store import load_manifest

    manifest, pictures = load_manifest(session), dict[str, LuminanceImage]()
    if processed := (session / "stages" / "calibrate").is_dir():
        calibrated = Finished(session, "calibrate")
        read = {side: read_exr(calibrated.path(f"{side}.exr")) for side in Side if f"{side}.exr" in calibrated}
        pictures = {side: one for side, one in read.items() if isinstance(one, LuminanceImage) and one.absolute}
    if not pictures:
        advice = f"run daylit process{', with --k1 or a meter reading: its results have no scale' if processed else ''}"
        raise ParameterError("has no picture in cd/m2", where=str(session), advice=advice)
    found = found_of(pictures, calibrated.json("calibration.json"), Finished(session, "merge").facts["metrics"])
    folder = into or session / "certificate"
    folder.mkdir(parents=True, exist_ok=True)
    write_bytes(folder / "index.html", build_certificate(manifest.name, session_facts(manifest), found).encode("utf-8"))
    write_bytes(folder / "certificate.json", json.dumps(found, indent=1).encode("utf-8"))
    page_file = str(folder / "index.html")
    low = {True: "; a lower bound: part of the light is clipped or outside the picture", False: ""}
    said = (f"{b['figure']}: {b['value']:.5g} ± {_two(b['expanded'])} {b['unit']} (k = 2)" for b in found["budgets"])
    lines = [line + low[b["lower_bound"]] for line, b in zip(said, found["budgets"], strict=True)]
    return answer({"ok": True, "page": page_file, **found}, (*lines, page_file), as_json=as_json)


def _said(figure: Figure) -> str:
    off = "unknown" if figure["uncertainty"] is None else _two(figure["uncertainty"])
    bound = {"lower": ", a lower bound: part of it is clipped or unseen", "upper": ", an upper bound: part is clipped"}
    return f"{figure['value']:.5g} ± {off}{bound.get(figure['bound'], '')}"


def _two(value: float) -> str:
    """Return a number to two digits, below a million without an exponent."""
    return f"{float(f'{value:.2g}'):g}"
