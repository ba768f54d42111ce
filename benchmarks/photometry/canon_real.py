"""The real bracket of a Canon 5D Mark II with an 8 mm fisheye through our chain, beside the map published with it.

Published with the bracket: the camera's response polynomial, the crop of the image circle, the fall-off at f/5.6, the
mapping (equisolid), a photometric factor of 1.18, and the finished equidistant map, whose header says 900.936 lx.

Absolute scale: hdrgen takes a code's exposure (1 at code 255) times 87 N^2 / (t ISO) as cd/m2 (K = 87), written over
179 into Radiance's unit. The factor 1.18 multiplies that; the ND factors are not in use. So a merged value (exposure a
second in a gauge of 1 at code 255) times 87 x 5.6^2 / 100 x 1.18 is cd/m2. The gauge is the published curve's.
"""

from __future__ import annotations

import math
import re
import subprocess
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
from scipy.optimize import minimize

from benchmarks.shared_data import DATA
from processing.calibration.merge.merge import MergeOptions, merge
from processing.calibration.outdoor.lens import ImageCircle, LensModel, find_image_circle
from processing.calibration.outdoor.outdoor import (
    OutdoorOptics,
    OutdoorView,
    correct_vignetting,
    outdoor_view,
    project,
    with_lens,
)
from processing.calibration.response.curve import NoiseModel, ResponseCurve
from processing.calibration.response.response import estimate_noise, recover_response
from processing.calibration.response.samples import Bracket8
from processing.calibration.response.shutter import ShutterRule, true_time_s
from processing.calibration.scale.photometry import illuminance_lx
from processing.calibration.scale.vignetting import published_vignetting
from processing.ground.arrays import Doubles
from processing.pictures.frames import array_frame, jpeg_frame
from processing.pictures.images import LuminanceImage, RelativeImage, luminance_cd_m2
from processing.pictures.radiance import RADIANCE_WEIGHTS, read_radiance_hdr, write_radiance_hdr
from processing.sphere import Fisheye, LensMapping, directions, solid_angles
from processing.sphere.resampling import resample

FOLDER = DATA / "brackets" / "canon5d2_8mm_bracket"
NOMINAL_S = (13.0, 3.2, 0.8, 0.2, 0.05, 0.0125, 1 / 320, 0.0008, 0.0002)
PUBLISHED_LUX = 900.936
F_NUMBER, ISO, HDRGEN_K, PHOTOMETRIC_FACTOR = 5.6, 100, 87.0, 1.18
SCALE = HDRGEN_K * F_NUMBER**2 / ISO * PHOTOMETRIC_FACTOR
FULL_SIZE = (5616, 3744)
DIAMETER, LEFT, DOWN = 3612, 1019, 74
MAP_PX = 1000
REFERENCE_CIRCLE = ImageCircle((2839.1, 1847.9), 1836.3, FULL_SIZE)
"""What the reference map was really cropped to (`found_crop`): 1.7 % wider than its notes say."""


@dataclass(frozen=True)
class CanonBracket:
    """Frames, reduced alike, with true times."""

    frames: tuple[npt.NDArray[np.uint8], ...]
    times_s: tuple[float, ...]

    @property
    def size_px(self) -> tuple[int, int]:
        height, width = self.frames[0].shape[:2]
        return width, height


def read_bracket(reduce: int) -> CanonBracket:
    """Return the nine frames, every side divided by ``reduce`` (averages of codes)."""
    if not FOLDER.is_dir():
        raise FileNotFoundError(f"no shared bracket at {FOLDER.name}")
    size = FULL_SIZE[0] // reduce, FULL_SIZE[1] // reduce
    frames = []
    for path in sorted(FOLDER.glob("*.JPG")):
        codes = jpeg_frame(path).decode()
        frames.append(np.asarray(cv2.resize(codes, size, interpolation=cv2.INTER_AREA), dtype=np.uint8))
    return CanonBracket(tuple(frames), tuple(true_time_s(t, ShutterRule.THIRDS) for t in NOMINAL_S))


def published_curve() -> ResponseCurve:
    """Return the polynomials of the file: exposure over that of code 255, by the code over 255."""
    text = (FOLDER / "response_function_files" / "Response_function.rsp").read_text("ascii")
    rows = [[float(v) for v in line.split()[1:]] for line in text.splitlines() if line.strip()]
    exposure = np.array([np.polyval(row, np.arange(256) / 255) for row in rows])
    zero, name = np.zeros((3, 256)), "published polynomial"
    return ResponseCurve(np.log2(exposure), zero, (5, 5, 5), (250, 250, 250), 255, method=name)


def published_circle(size_px: tuple[int, int]) -> ImageCircle:
    """Return the image circle of ImageLensInformation.txt (offsets from the lower left corner)."""
    radius = DIAMETER / 2
    full = ImageCircle((LEFT + radius, FULL_SIZE[1] - DOWN - radius), radius, FULL_SIZE)
    return full.scaled(size_px)


def merged(bracket: CanonBracket, curve: ResponseCurve, noise: NoiseModel) -> RelativeImage:
    """Return the bracket merged, in the published lens's geometry."""
    geometry = lens_of(published_circle(bracket.size_px)).fisheye()
    frames = [array_frame(frame, f"frame {i}") for i, frame in enumerate(bracket.frames)]
    # Some codes of the published polynomial disagree with the frames by a third of a stop: the merge would refuse it.
    options = MergeOptions(ghosts=False, allow_contradiction=True)
    return merge(frames, bracket.times_s, curve, noise, geometry=geometry, options=options).image


def lens_of(circle: ImageCircle) -> LensModel:
    """Return the published lens in an image circle (its edge taken as 90 degrees, as the published chain does)."""
    return LensModel(LensMapping.EQUISOLID, circle)


def luminance_map(image: RelativeImage, circle: ImageCircle, size_px: int = MAP_PX) -> LuminanceImage:
    """Return our chain's map: fall-off at f/5.6, equisolid to equidistant, cd/m2."""
    optics = OutdoorOptics(lens_of(circle), published_vignetting("canon_8mm_f5_6"))
    done = project(correct_vignetting(with_lens(image, optics), optics), outdoor_view(OutdoorView.EQUIDISTANT, size_px))
    return LuminanceImage(done.rgb * np.float32(SCALE), done.uncertainty, done.validity, done.geometry, 0.05)


def reference_map() -> npt.NDArray[np.float32]:
    """Return the published map's luminance in cd/m2 (1000, 1000), by Radiance's weights."""
    picture = read_radiance_hdr(FOLDER / "pipeline-output-1000x1000.hdr")
    return np.asarray(picture.rgb @ np.array(RADIANCE_WEIGHTS, dtype=np.float32), dtype=np.float32)


def map_differences(ours: LuminanceImage, reference: npt.NDArray[np.float32]) -> dict[str, float]:
    """Return median and 95th percentile of |difference| in per cent inside 0.95 of the field, and the median ratio."""
    equidistant = ours.geometry
    height = ours.rgb.shape[0]
    factor = reference.shape[0] // height
    shape = (height, factor, height, factor)
    other = reference.reshape(shape).mean(axis=(1, 3))
    ways, _ = directions(equidistant)
    inside = (np.arccos(np.clip(ways[..., 2], -1, 1)) < 0.95 * math.pi / 2) & (other > 0.5) & (ours.validity == 0)
    ratio = luminance_cd_m2(ours.rgb)[inside] / other[inside]
    off = 100 * np.abs(ratio - 1)
    return {
        "p50": float(np.percentile(off, 50)),
        "p95": float(np.percentile(off, 95)),
        "median_ratio": float(np.median(ratio)),
    }


def found_crop(image: RelativeImage, reference: npt.NDArray[np.float32]) -> ImageCircle:
    """Return the circle for which our map lies best on the reference: the crop that it was really made with."""
    start = published_circle((image.rgb.shape[1], image.rgb.shape[0]))
    size = 250
    other = reference.reshape(size, 4, size, 4).mean(axis=(1, 3))
    target = outdoor_view(OutdoorView.EQUIDISTANT, size)
    falloff = published_vignetting("canon_8mm_f5_6").map(target)  # type: ignore[arg-type]
    light = luminance_cd_m2(image.rgb) * np.float32(SCALE)
    ways, _ = directions(target)
    inside = (np.arccos(np.clip(ways[..., 2], -1, 1)) < 0.95 * math.pi / 2) & (other > 0.5)

    def circle_of(moved: Doubles) -> ImageCircle:
        unit = start.radius_px / 100
        centre = (start.centre_px[0] + moved[0] * unit, start.centre_px[1] + moved[1] * unit)
        return ImageCircle(centre, start.radius_px + moved[2] * unit, start.size_px)

    def misfit(moved: Doubles) -> float:
        picture, _ = resample(light, lens_of(circle_of(moved)).fisheye(), target, method="bilinear")
        off = np.log2(np.maximum(picture / falloff, 0.5) / np.maximum(other, 0.5))[inside]
        return float(np.mean(np.minimum(np.abs(off - np.median(off)), 0.5)))

    corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.5]]
    options = {"initial_simplex": corners, "xatol": 0.01, "fatol": 1e-5, "maxfev": 90}
    return circle_of(minimize(misfit, corners[0], method="Nelder-Mead", options=options).x)


def evalglare_lx(image: LuminanceImage) -> float:
    """Return what Radiance's evalglare finds in our Radiance picture."""
    import pyradiance

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "map.hdr"
        write_radiance_hdr(path, image)
        tool = Path(pyradiance.__file__).parent / "bin" / "evalglare"
        answer = subprocess.run([str(tool), "-V", str(path)], capture_output=True, text=True, check=False)
    found = re.search(r"[0-9.]+(?:e[+-]?[0-9]+)?", answer.stdout)
    if not found:
        raise RuntimeError(f"evalglare gave no illuminance: {answer.stderr.strip()}")
    return float(found[0])


def response_difference(ours: ResponseCurve, theirs: ResponseCurve) -> float:
    """Return the rms difference of two curves in stops over codes 5..250, each channel's gauge left free."""
    codes = slice(5, 251)
    off = ours.log2_exposure[:, codes] - theirs.log2_exposure[:, codes]
    return float(np.sqrt(np.mean((off - off.mean(axis=1, keepdims=True)) ** 2)))


def tied(curve: ResponseCurve, published: ResponseCurve) -> ResponseCurve:
    """Return our curve in the published one's gauge: the same mean of log exposure over codes 30..220.

    The factor 1.18 was measured with the published curve; a curve of its own gives exposure but for a factor.
    """
    codes = slice(30, 221)
    off = (published.log2_exposure - curve.log2_exposure)[:, codes].mean(axis=1, keepdims=True)
    return replace(curve, log2_exposure=curve.log2_exposure + off)


def own_image(bracket: CanonBracket) -> tuple[RelativeImage, ResponseCurve]:
    """Return the bracket merged with the curve recovered from it, in the published gauge, and that curve."""
    eight_bit = [Bracket8(bracket.frames, bracket.times_s)]
    curve = tied(recover_response(eight_bit).curve, published_curve())
    return merged(bracket, curve, estimate_noise(eight_bit, curve)), curve


def published_image(bracket: CanonBracket) -> RelativeImage:
    """Return the bracket merged with the published curve."""
    curve = published_curve()
    return merged(bracket, curve, estimate_noise([Bracket8(bracket.frames, bracket.times_s)], curve))


def canon_real(*, quick: bool) -> dict[str, float]:
    """Return all figures of the real bracket; quick: frames at a sixth of their size, else at half."""
    bracket = read_bracket(6 if quick else 2)
    (image, curve), by_published = own_image(bracket), published_image(bracket)
    circle, reference = published_circle(bracket.size_px), reference_map()
    seen, really = find_image_circle(list(bracket.frames)), found_crop(by_published, reference)
    maps = {
        "canon_stated_circle": luminance_map(image, circle),
        "canon_found_circle": luminance_map(image, seen),
        "canon_registered": luminance_map(image, really),
        "canon_published_curve": luminance_map(by_published, circle),
        "canon_published_curve_registered": luminance_map(by_published, really),
    }
    figures: dict[str, float] = {}
    for name, one in maps.items():
        lux, off = illuminance_lx(one).value_lx, map_differences(one, reference)
        figures |= {f"{name}_lux": lux, f"{name}_lux_err_pct": 100 * (lux / PUBLISHED_LUX - 1)}
        figures |= {f"{name}_map_p50_pct": off["p50"], f"{name}_map_p95_pct": off["p95"]}
    return figures | {
        "canon_evalglare_diff_pct": 100
        * (evalglare_lx(maps["canon_stated_circle"]) / figures["canon_stated_circle_lux"] - 1),
        "canon_reference_by_our_sum_lux": _summed_lx(reference),
        "canon_response_rms_stops": response_difference(curve, published_curve()),
        "canon_reference_radius_ratio": really.radius_px / circle.radius_px,
        "canon_reference_shift_px": math.dist(really.centre_px, circle.centre_px) * FULL_SIZE[0] / bracket.size_px[0],
        "canon_found_radius_ratio": seen.radius_px / circle.radius_px,
    }


def _summed_lx(luminance: npt.NDArray[np.float32]) -> float:
    """Return the illuminance that the reference map's pixels give by our sums."""
    geometry = outdoor_view(OutdoorView.EQUIDISTANT, luminance.shape[0])
    assert isinstance(geometry, Fisheye)
    ways, _ = directions(geometry)
    return float(np.sum(luminance * solid_angles(geometry) * ways[..., 2]))
