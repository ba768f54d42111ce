"""A session's certificate: what is stated of each light figure by what (GUM, JCGM 100), and its photometric indices.

Each row is one cause, as a relative standard uncertainty of the figure; causes are independent, so that squares add
(GUM 5.1.2). Expanded with k = 2. Indices are those of ISO/CIE 19476 that frames, readings and charts can show; the
others need a laboratory, and are named as not determined.
"""

import math
from collections.abc import Mapping
from itertools import pairwise
from typing import Any

import numpy as np

from processing.calibration.outdoor.session_sky import FROM_LUX, LUX_METER_UNCERTAINTY
from processing.calibration.scale.photometry import UP, illuminance_lx, luminance_map
from processing.ground.arrays import Doubles
from processing.ground.tables import table_of
from processing.pictures.images import LuminanceImage, Validity
from processing.pictures.modes import modes_of, relative_error, shared_errors
from processing.sphere import Fisheye, projected_solid_angles

COVERAGE_FACTOR = 2.0  # k of the GUM for about 95 %
RECTIFICATION = 3e-4
"""Relative, of an illuminance by resampling: the largest of closed forms, the sun's (docs/measurements/sphere.md)."""
DETECTED = 1 / 3  # relative standard uncertainty at the limit of detection: three standard deviations (IUPAC 1978)
BINS_A_STOP = 2  # of luminance, in which the limit is looked for; chosen
_TABLE = table_of("processing.figures", "certificate")
SOURCES, NOT_DETERMINED = _TABLE["sources"], _TABLE["not_determined"]


def certificate(
    pictures: Mapping[str, LuminanceImage], calibration: Mapping[str, Any], merged: Mapping[str, Any]
) -> dict[str, Any]:
    """Return budgets and indices of both sides as plain values.

    ``pictures``: calibrated ones by side; ``calibration``: calibration.json; ``merged``: the merge's metrics by side.
    """
    budgets, indices = [], []
    for side, image in pictures.items():
        facts = calibration[side]
        # The parts of the scale: of k1, and outdoors of k2
        parts = dict(calibration.get("indoor", {}).get("k1_parts") or {})
        parts = {"k1" if name == "given" else name: float(value) for name, value in parts.items()}
        if side == "outdoor":
            sky = calibration["outdoor"]
            parts["k2"] = sky.get("k2_relative_uncertainty", 0.0)
            if moved := sky.get("repeat_drift_frac"):
                parts["drift"] = math.hypot(parts.get("drift", 0.0), moved / math.sqrt(12))
            if sky["k2_source"] == FROM_LUX:  # k1 is in k2 to cancel
                parts = {"lux meter": LUX_METER_UNCERTAINTY}
        eye = side == "indoor" and isinstance(image.geometry, Fisheye)
        budgets.append(_budget(f"{side}, illuminance {'at the eye' if eye else 'on a level plane'}", image, parts))
        indices += _indices(side, image, merged.get(side, {}), facts)
    indices += [{"index": name, "value": None, "why": why} for name, why in NOT_DETERMINED.items()]
    return {"version": 1, "coverage_factor": COVERAGE_FACTOR, "budgets": budgets, "indices": indices}


def _budget(name: str, image: LuminanceImage, scale: Mapping[str, float]) -> dict[str, Any]:
    found = illuminance_lx(image)
    value = max(found.value_lx, 1e-30)
    weights = projected_solid_angles(image.geometry, UP) * (image.validity == Validity.VALID)
    rows = dict(scale)
    # What the picture's scale holds beyond the parts that were stated.
    rest = (found.scale_lx / value) ** 2 - sum(part**2 for part in scale.values())
    if rest > (0.1 * image.scale_uncertainty) ** 2:
        rows["scale, other"] = math.sqrt(rest)
    if found.uncertainty_lx > found.scale_lx:  # no reading of this very light
        rows |= {"noise": found.pixels_lx / value, "clipped and dark": found.doubtful_lx / value}
        rows |= {cause: off / value for cause, off in shared_errors(image, weights).items()}
    rows["rectification"] = RECTIFICATION
    combined = math.hypot(*rows.values())
    lines = [
        {"cause": cause, "type": SOURCES.get(cause, ("B", ""))[0], "relative_uncertainty": off}
        | {"source": SOURCES.get(cause, ("B", "as stated with the picture"))[1]}
        for cause, off in sorted(rows.items(), key=lambda one: -one[1])
    ]
    unit, expanded = "lx" if image.absolute else image.unit, COVERAGE_FACTOR * combined * found.value_lx
    sums = {"combined_relative": combined, "expanded": expanded, "lower_bound": found.lower_bound}
    return {"figure": name, "unit": unit, "value": found.value_lx, "rows": lines, **sums}


def _indices(
    side: str, image: LuminanceImage, merged: Mapping[str, Any], facts: Mapping[str, Any]
) -> list[dict[str, Any]]:
    offsets = [2.0 ** float(stops) - 1 for stops in merged.get("offset_stops", [])]
    steps = [abs((1 + b) / (1 + a) - 1) for a, b in pairwise(offsets)]
    drift = facts.get("meter_drift_frac")
    drift = facts.get("repeat_drift_frac") if drift is None else drift
    own = _own(image)
    found = [
        ("f3 (linearity)", max(map(abs, offsets), default=None), "", "largest deviation of a frame from the merge"),
        ("f11 (change of range)", max(steps, default=None), "", "largest difference of adjacent frames"),
        ("repeatability", _repeatability(image, own), "", "median noise of the brighter half of the valid pixels"),
        ("limit of detection", _detection_limit(image, own), image.unit, "luminance at three standard deviations"),
        ("stability", drift, "", "readings before and after the bracket, or a stop repeated after it"),
        ("spectral mismatch", facts.get("spectral_mismatch"), "", "coloured patches of the rig's chart, rms (not f1')"),
    ]
    return [
        {"index": f"{side}: {name}", "value": value, "unit": unit, "why": why if value is not None else "no data"}
        for name, value, unit, why in found
    ]


def _own(image: LuminanceImage) -> Doubles:
    """Return each pixel's relative uncertainty (H, W) less what pixels share: a repetition has that again."""
    luminance, squares = luminance_map(image), np.square(image.uncertainty, dtype=np.float64)
    for mode in modes_of(image):
        squares -= np.square(relative_error(mode, image, luminance), dtype=np.float64)
    return np.sqrt(np.maximum(squares, 0))


def _repeatability(image: LuminanceImage, own: Doubles) -> float | None:
    level, valid = luminance_map(image), image.validity == Validity.VALID
    bright = valid & (level >= np.median(level[valid])) if valid.any() else valid
    return float(np.median(own[bright])) if bright.any() else None


def _detection_limit(image: LuminanceImage, own: Doubles) -> float | None:
    """Return the luminance that best parts unsure pixels below from sure ones above (`DETECTED`); None: all unsure.

    Few pixels do not count much: a sun's edge is unsure, and bright."""
    level = luminance_map(image)
    seen = (image.validity != Validity.OUTSIDE) & (image.validity != Validity.CLIPPED) & (level > 0)
    if not seen.any():
        return None
    place = np.floor(BINS_A_STOP * np.log2(level[seen])).astype(np.int64)
    unsure = own[seen] > DETECTED
    first = int(place.min())
    above, below = (np.bincount(place[which] - first, minlength=np.ptp(place) + 2) for which in (unsure, ~unsure))
    wrong = above[::-1].cumsum()[::-1] + below.cumsum() - below
    best = int(np.argmin(wrong))
    return None if unsure.all() else float(2.0 ** ((first + best) / BINS_A_STOP))
