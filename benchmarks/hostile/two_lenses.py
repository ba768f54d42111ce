"""Raw files of a panorama camera against its JPEGs: two lenses side by side, placed, tied and stitched by ours.

Three real HDR scenes, seen by two fisheyes whose projection is in no family of the estimator's (r = sin(0.42 theta)),
with centres, axes and rolls of their own, 4 % apart in exposure and 30 % darker at a right angle; wells, jitter of the
shutter and processing of a hostile camera with a published curve. The JPEG panorama has the lenses' difference as well,
blended at its seam. Errors: median |log2| of luminance after a common scale; `place`, degrees between what the fitted
lens and the true one see, within 85 degrees of its axis and at its rim (88 to 92 degrees); coverage of the stated 95 %
interval, the seam's and the stray light's modes included.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial

import cv2
import numpy as np

from benchmarks.hostile.merging import merged_pictures, merged_raws
from benchmarks.hostile.worlds import (
    LENS_BLUR_PX,
    MATRIX_5D2,
    TIMES_S,
    Curves,
    HostileBracket,
    HostileCamera,
    HostileWorld,
    hostile_bracket,
)
from benchmarks.kept_rows import Row, fresh
from mocks.optics.lenses import TwoFisheyes
from processing.calibration.merge.lens_pair import LensPair, stitched
from processing.calibration.merge.lens_places import clearest, place_lenses
from processing.calibration.response.response import recover_response
from processing.calibration.response.samples import Bracket8
from processing.calibration.scale.veiling_glare import unmeasured_modes
from processing.ground.arrays import Floats
from processing.pictures.images import LuminanceImage, RelativeImage, luminance_cd_m2
from processing.pictures.modes import SEAM_KEY, seam_mode, widened
from processing.sphere import Equirectangular, point_directions

SIDE_PX = 1.06  # of a lens's picture, over the panorama's height
SECOND = 0.04  # by which the lenses differ
SCALE_SIGMA = 0.005
WHITE_S = 5.0


def two_lens_figures(curves: Curves, scenes: list[Floats], seed: int, kept: Row = fresh) -> dict[str, float]:
    """Return errors and coverage of raw files, stitched by us, and of the JPEG panoramas beside them.

    ``kept``: where a scene's row is kept.
    """
    irradiance, shown = curves
    rows: dict[str, list[float]] = {}
    for k, scene in enumerate(scenes):
        parts = {"matrix": MATRIX_5D2, "mosaic": True, "denoise": True, "sharpen": 0.3, "prnu": 0.004}
        curve = shown[(seed + 5 * k + 2) % len(shown)]
        camera = HostileCamera(irradiance, curve, jpeg=("opencv", 93, "4:2:2"), seed=seed + k, **parts)  # type: ignore[arg-type]
        for key, value in kept(f"two lenses {k}", partial(_one, camera, scene, seed + k)).items():
            rows.setdefault(key, []).append(value)
    worst = ("rim_deg", "place_deg")
    return {f"theta_{key}": float((max if key in worst else np.median)(values)) for key, values in rows.items()}


def two_lens_bracket(camera: HostileCamera, scene: Floats, optics: TwoFisheyes, seed: int) -> HostileBracket:
    """Return a bracket of a panorama camera: its JPEGs of ``scene`` (H, 2 H, 3), and the DNGs with both lenses."""
    world = HostileWorld("two lenses", camera, jitter_stops=0.05, lenses=optics.gains[1] / optics.gains[0] - 1)
    bracket = hostile_bracket(world, scene, WHITE_S, seed)
    rng, side = np.random.default_rng((seed, 11)), round(SIDE_PX * len(scene)) // 2 * 2
    seen = optics.picture(cv2.GaussianBlur(scene, (0, 0), LENS_BLUR_PX), side)
    files = []
    for number, time_s in enumerate(TIMES_S):
        true_s = time_s * 2.0 ** (0.05 * rng.standard_normal())
        files.append(camera.raw(np.asarray(seen * np.float32(true_s / WHITE_S)), number))
    return replace(bracket, raw=tuple(files))


def merged_raw(bracket: HostileBracket) -> tuple[RelativeImage, LensPair]:
    """Return what the product makes of the raw files."""
    merged, files, codes = merged_raws(bracket)
    best = clearest(codes, bracket.frames)
    pair = place_lenses(codes[best], files[best].colours, bracket.frames[best])
    height, width = bracket.frames[0].shape[:2]
    return stitched(merged, pair, Equirectangular(width, height)).image, pair


def misplaced_deg(pair: LensPair, optics: TwoFisheyes) -> tuple[float, float]:
    """Return the median angle, of the worse lens, between what fitted and true lens see: within 85 degrees, at 90."""
    side = pair.lenses[0].geometry.height_px
    found = []
    for number, lens in enumerate(pair.lenses):
        rays, theta, _ = optics.directions(number, side)
        y, x = np.mgrid[:side, :side] + 0.5
        local, seen = point_directions(lens.geometry, x + number * side, y)
        apart = np.degrees(2 * np.arcsin(np.minimum(np.linalg.norm(local @ lens.axes - rays, axis=-1) / 2, 1)))
        inner, rim = theta < math.radians(85), np.abs(theta - math.pi / 2) < math.radians(2)
        found.append([float(np.median(apart[seen & part])) for part in (inner, rim)])
    worst = np.max(found, axis=0)
    return float(worst[0]), float(worst[1])


def _one(camera: HostileCamera, scene: Floats, seed: int) -> dict[str, float]:
    optics = TwoFisheyes(gains=(1.0, 1 + SECOND))
    bracket = two_lens_bracket(camera, scene, optics, seed)
    raw, pair = merged_raw(bracket)
    fit = recover_response([Bracket8(bracket.frames, bracket.nominal_s)], estimate_times=True)
    jpeg = merged_pictures(bracket.frames, raw.geometry, fit)
    place, rim = misplaced_deg(pair, optics)
    error, cover = error_of(raw, bracket)
    other, other_cover = error_of(jpeg, bracket)
    return {
        "raw_err_stops": error,
        "jpeg_err_stops": other,
        "raw_gain": other / error,
        "raw_cover95_pct": cover,
        "jpeg_cover95_pct": other_cover,
        "place_deg": place,
        "rim_deg": rim,
        "second_stops_off": abs(pair.to_dict()["second_stops"] - math.log2(1 + SECOND)),
        "seam_sigma": pair.seam_sigma,
    }


def error_of(image: RelativeImage, bracket: HostileBracket) -> tuple[float, float]:
    """Return the median error in stops after a common scale, and the coverage of the 95 % interval, per cent."""
    shown, truth = luminance_cd_m2(image.rgb), luminance_cd_m2(bracket.radiance)
    good = (image.validity == 0) & (truth > 0)
    scale = np.float32(np.exp(np.median(np.log(truth[good] / np.maximum(shown[good], 1e-9)))))
    picture = LuminanceImage(
        *(image.rgb * scale, image.uncertainty, image.validity, image.geometry, SCALE_SIGMA),
        attributes=image.attributes,
    )
    tied = image.attributes.get(SEAM_KEY)
    seam = seam_mode(None, tied) if isinstance(tied, float) else seam_mode(None)
    picture = widened(picture, [*unmeasured_modes(picture), seam])
    ratio = shown[good] * scale / truth[good]
    off, stops = np.abs(ratio - 1), np.abs(np.log2(np.maximum(ratio, 1e-9)))
    sigma = np.hypot(picture.uncertainty[good], SCALE_SIGMA)
    return float(np.median(stops)), 100 * float(np.mean(off <= 1.96 * sigma))
