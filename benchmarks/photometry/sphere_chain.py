"""The outdoor chain (fall-off, tint, geometry) by daylit and by Radiance's `pcomb | pinterp`, on one made sky."""

from __future__ import annotations

import importlib.util
import math
import subprocess
import tempfile
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from benchmarks.paired import compare
from benchmarks.photometry.sphere_light import sun_picture
from processing.calibration.optics import OutdoorOptics
from processing.calibration.outdoor.lens import ImageCircle, LensModel
from processing.calibration.outdoor.nd_filter import NdFilter
from processing.calibration.outdoor.outdoor import (
    OutdoorView,
    correct_colour,
    correct_vignetting,
    cut_to_circle,
    outdoor_view,
    project,
)
from processing.calibration.scale.vignetting import published_vignetting
from processing.ground.arrays import Floats
from processing.pictures.exr import write_stage_exr
from processing.pictures.images import RelativeImage, Validity, luminance_cd_m2
from processing.sphere import Fisheye, Geometry, LensMapping, directions, projected_solid_angles

UP = (0.0, 0.0, 1.0)
TINT = ((1.04, -0.02, 0.01), (0.0, 0.98, 0.01), (0.02, -0.03, 1.12))
SUN = np.array([0.5, 0.5, math.sqrt(0.5)])
NEAR_SUN = math.cos(math.radians(2))
WINDOW_LINES = 63
"""On each side of a line, that pcomb holds: all that a pixel may move up or down."""
MOVED = 0.0415
"""Of the radius: furthest that a pixel lies apart in an equisolid and an equidistant picture of a hemisphere."""
# pcomb: from an equidistant picture's pixel to the equisolid one's; fall-off there, then the tint undone.
CAL = """
R : xmax/2; ax = x - (xmax-1)/2; ay = y - (ymax-1)/2; rho = sqrt(ax*ax+ay*ay)/R;
k = if(.0001-rho, 1.1107207, 1.41421356*sin(rho*.78539816)/rho); q = if(1-rho, rho*k, 1);
dx = ax*(k-1); dy = ay*(k-1); inside = if(1-rho, 1, 0); v = 1{falloff};
c1 = ri(1,dx,dy)/v; c2 = gi(1,dx,dy)/v; c3 = bi(1,dx,dy)/v;
ro = inside*({matrix[0][0]}*c1+({matrix[1][0]})*c2+({matrix[2][0]})*c3);
go = inside*({matrix[0][1]}*c1+({matrix[1][1]})*c2+({matrix[2][1]})*c3);
bo = inside*({matrix[0][2]}*c1+({matrix[1][2]})*c2+({matrix[2][2]})*c3);
"""


def _sky(geometry: Geometry) -> Floats:
    """Return radiance (H, W, 3) of a blue sky with soft clouds and the sun's disc, each pixel's mean."""
    ways, inside = directions(geometry)
    x, y, z = (ways[..., k].astype(np.float64) for k in range(3))
    cloud = np.clip(0.5 + 0.25 * (np.sin(9 * x + 4 * z) + np.sin(11 * y - 5 * x) * np.cos(7 * z)), 0, 1)
    glow = 1 / (1.02 - np.clip(ways @ SUN, -1, 1))
    blue = np.stack([2500 + 60 * glow, 4200 + 70 * glow, 8200 + 80 * glow], axis=-1)
    sky = (1 - cloud[..., None]) * blue + cloud[..., None] * np.array([21000.0, 21000.0, 21500.0])
    return np.asarray(sky * inside[..., None] + sun_picture(geometry, SUN)[..., None], np.float32)


def outdoor_chain(size_px: int, *, pairs: int) -> dict[str, dict[str, float]]:
    """Return errors of both against the sky itself in per cent, and our CPU and wall time over theirs.

    Ours starts from the merged picture and ends with the stage's file, with uncertainty and validity; theirs reads and
    writes Radiance pictures of 4 bytes a pixel. Raises RuntimeError where pyradiance is not installed.
    """
    if (found := importlib.util.find_spec("pyradiance")) is None or found.origin is None:
        raise RuntimeError("pyradiance is not installed (pip install daylit[bench])")
    tools, lens = Path(found.origin).parent / "bin", _lens(size_px)
    target, optics = outdoor_view(OutdoorView.HEMISPHERICAL, size_px), OutdoorOptics(*_parts(lens))
    assert optics.filter is not None
    assert optics.vignetting is not None
    taken = _sky(lens.fisheye()) @ np.array(optics.filter.tint, np.float32)
    taken *= optics.vignetting.map(lens.fisheye())[..., None]
    true = _sky(target)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        merged = _merged(taken, lens.fisheye())
        cv2.imwrite(str(folder / "in.hdr"), taken[..., ::-1])
        done: dict[str, RelativeImage] = {}

        def ours() -> None:
            cut = cut_to_circle(merged, lens.fisheye())
            done["ours"] = project(correct_colour(correct_vignetting(cut, optics), optics), target)
            write_stage_exr(folder / "ours.exr", done["ours"])

        def theirs() -> None:
            subprocess.run(_commands(tools, folder, size_px, optics), shell=True, check=True, timeout=600)

        cost = compare(ours, theirs, pairs=pairs)
        shown = cv2.imread(str(folder / "out.hdr"), cv2.IMREAD_ANYDEPTH | cv2.IMREAD_COLOR)
        assert shown is not None
        rival = np.asarray(shown[..., ::-1], np.float32)
    return {
        "ours": _errors(done["ours"].rgb, true, target) | {"cpu_s": round(cost.ours.cpu_s, 3)},
        "pcomb_pinterp": _errors(rival, true, target)
        | {"cpu_s": round(cost.rival.cpu_s, 3)}
        | cost.metrics("pcomb_pinterp"),
    }


def _lens(size_px: int) -> LensModel:
    if MOVED * size_px / 2 > WINDOW_LINES:
        raise ValueError(f"pcomb cannot move pixels of {size_px} x {size_px} so far")
    middle = size_px / 2
    return LensModel(LensMapping.EQUISOLID, ImageCircle((middle, middle), middle, (size_px, size_px)))


def _parts(lens: LensModel) -> tuple[Any, ...]:
    return lens, published_vignetting("canon_8mm_f5_6"), NdFilter.of_matrix(TINT)


def _merged(rgb: Floats, lens: Fisheye) -> RelativeImage:
    _, inside = directions(lens)
    validity = np.where(inside, np.uint8(Validity.VALID), np.uint8(Validity.OUTSIDE))
    return RelativeImage(rgb, np.full(rgb.shape[:2], 0.02, np.float32), validity, lens)


def _commands(tools: Path, folder: Path, size_px: int, optics: OutdoorOptics) -> str:
    """Return the shell line: scale, fall-off, tint and an equidistant picture by pcomb, the hemisphere by pinterp."""
    falloff = optics.vignetting
    assert falloff is not None
    assert optics.filter is not None
    terms = "".join(f"+({c})*q^{p}" for c, p in zip(falloff.coefficients, falloff.powers, strict=True))
    matrix = np.linalg.inv(np.array(optics.filter.tint))
    (folder / "chain.cal").write_text(CAL.format(falloff=terms, matrix=matrix.tolist()), "utf-8")
    view = "-vp 0 0 0 -vd 0 0 1 -vu 0 1 0 -vv 180 -vh 180"
    return (
        f"cd {folder} && {tools}/pcomb -h -w -f chain.cal in.hdr | {tools}/getinfo -a 'VIEW= -vta {view}' > flat.hdr "
        f"&& {tools}/pinterp -vth {view} -x {size_px} -y {size_px} flat.hdr 1 > out.hdr"
    )


def _errors(rgb: Floats, true: Floats, target: Geometry) -> dict[str, float]:
    """Return the median and 99th percentile of pixels off the sun, and the level illuminance's error; per cent."""
    ways, inside = directions(target)
    away = inside & (ways @ SUN < NEAR_SUN) & (ways[..., 2] > math.sin(math.radians(1)))
    shown, light = luminance_cd_m2(rgb), luminance_cd_m2(true)
    off = 100 * np.abs(shown[away] / light[away] - 1)
    level = projected_solid_angles(target, UP)
    lux = float(np.vdot(shown.astype(np.float64), level) / np.vdot(light.astype(np.float64), level) - 1)
    return {
        "median_err_pct": round(float(np.median(off)), 4),
        "p99_err_pct": round(float(np.quantile(off, 0.99)), 3),
        "lux_err_pct": round(100 * lux, 3),
    }
