"""How sure a room is: what was odd on the way to it, as one probability.

The probability is that of a 3D IoU of at least 0.85 with the true room, by a logistic fit on a few diagnostics
(docs/reference/room.md says on which rooms; `python -m benchmarks room` measures it on others).
"""

import math
from dataclasses import asdict, dataclass

import numpy as np
import shapely

from processing.errors import NoRoomError
from processing.ground.arrays import Doubles
from processing.ground.room_model import RoomModel
from processing.pictures.images import LuminanceImage, RelativeImage, Validity, luminance_cd_m2
from processing.room.columns import Columns
from processing.room.hypotheses import CAP, Hypothesis, residuals
from processing.room.refine import Refined
from processing.sphere import Equirectangular
from processing.surfaces.maps import wall_ranges

# What can be seen without any network: whether a picture is a whole, lit panorama.
LARGEST_BLANK = 0.3  # share of the sphere without data or detail from which a picture is refused
STEP_ROWS = 256  # rows that are looked at; chosen, never swept
RIVAL_WITHIN = 60.0  # cost by which another room may be worse and still be a rival
COEFFICIENTS = {"log2_sigma": -0.49, "ratio_spread": -11.8, "rival": -11.3, "log2_loss": -0.54, "entropy": -4.5}
INTERCEPT = 2.7
"""Ridge logistic fit on 237 pictures: simulated rooms of validation seeds (cameras in doorways, mirrors, closets,
tilted, dark and cropped ones among them) and the real ones that may be looked at (docs/reference/room.md)."""
LARGEST_SPREAD = 0.2  # clamps the fit's feature; chosen, never swept
LEAST_SIGMA_DEG, LEAST_LOSS = 0.25, 0.01
LEAST, MOST = 0.02, 0.98
AT_LENS = 0.05
"""Distance of the nearest wall, in camera heights, below which nothing is trusted. With 0.25 cameras in doorways (35 of
248 pictures of validation seeds) were trusted at 0.16 and right at 0.40: 0.136 -> 0.122 squared error of all."""
FULLY_EXPLAINED = 0.75  # of a wall's columns: noise leaves no wall without any residual
HALF_RIGHT_DEG = 5.0
"""Uncertainty of its boundaries with which a wall is right (6 %) as often as not, as it is with its square: on 195
walls of 40 pictures of validation seeds; in doubtful rooms it parts right from wrong walls with .94 under the curve."""
UNSEEN = 0.3  # of the room's confidence, for a wall of which no column is seen


def check_picture(image: RelativeImage | LuminanceImage) -> float:
    """Return the share (0..1) of the sphere without data, or black: what is wrong with a panorama but may be borne.

    Raises `NoRoomError`: not equirectangular, not twice as wide as high (cropped), black, or blank over much of the
    sphere.
    """
    geometry = image.geometry
    if not isinstance(geometry, Equirectangular):
        raise NoRoomError("the picture is not equirectangular", advice="give a whole panorama")
    if abs(geometry.width_px / geometry.height_px - 2) > 0.02 or geometry.height_px < 16:
        size = f"{geometry.width_px} x {geometry.height_px} px"
        text = f"the picture is {size}; a whole panorama is twice as wide as high"
        advice = "pad it to 2:1 centred on the horizon, or export the whole panorama"
        raise NoRoomError(text, likely="it is cropped", advice=advice)
    step = max(1, geometry.height_px // STEP_ROWS)
    small, data = luminance_cd_m2(image.rgb[::step, ::step]), image.validity[::step, ::step] != Validity.OUTSIDE
    bright = small[small > 0]
    dim, lit = (np.quantile(bright, share) if bright.size else np.float32(1) for share in (0.1, 0.9))
    if float(np.log2(lit / max(float(dim), 1e-30))) < 0.05:
        raise NoRoomError("the picture is black or uniform", advice="check exposure and lens cap")
    # The share of the sphere without data, black, or in nearly black rows that reach a pole
    rows = small.shape[0]
    even = small.max(axis=1) <= 1e-3 * np.median(small[small > 0])
    reach = np.zeros(rows, bool)
    # A row or two at a pole are even in any panorama.
    for order in (np.arange(rows), np.arange(rows)[::-1]):
        run = int(np.argmin(even[order])) if not even.all() else rows
        if run > rows // 32:
            reach[order[:run]] = True
    dark = (small <= 0) | ~data | reach[:, None]
    weight = np.cos((0.5 - (np.arange(rows) + 0.5) / rows) * math.pi)
    blank = float((dark.mean(axis=1) * weight).sum() / weight.sum())
    if blank > LARGEST_BLANK:
        text = f"{100 * blank:.0f} % of the sphere show nothing"
        likely = "the panorama is cropped at top or bottom, or mostly black"
        raise NoRoomError(text, likely=likely, advice="give a whole panorama")
    return blank


@dataclass(frozen=True)
class Diagnostics:
    """What confidence is computed from; none needs the truth."""

    misfit: float
    """Root mean square of capped residuals of both boundaries, in standard deviations."""
    unexplained: float
    """Share of columns that no wall explains."""
    sigma_deg: float
    """Mean uncertainty of the boundaries as the network states it, with its factor (`columns.ERRING_TOGETHER`)."""
    ratio_spread: float
    """How far floor and ceiling disagree about distances, relative."""
    rival: float
    """1 - IoU of the floor with the most different room that fits nearly as well."""
    loss: float
    """Mean -log share of classes where the room puts them."""
    entropy: float
    """Of the classes, mean over the sphere, natural: 0 where the network is sure of every place, 2.1 at most."""
    overhead: float
    """Share of ceiling above 50 degrees."""
    blank: float
    """Share of the sphere that shows nothing."""
    nearest: float
    """Distance of the nearest wall, in camera heights: in a doorway it is small."""
    edges: float
    """Share of azimuths at which an edge of floor or ceiling was found in the picture."""
    corners: float
    """Number of walls."""

    def values(self) -> dict[str, float]:
        """Return name and value of each, rounded."""
        return {name: round(float(value), 4) for name, value in asdict(self).items()}


def diagnose(
    columns: Columns, among: tuple[list[Hypothesis], Hypothesis], refined: Refined, **seen: float
) -> Diagnostics:
    """Return the diagnostics of the room chosen; ``among``: all hypotheses, the best first, and that one.

    ``seen``: the loss, entropy, overhead and blank of `Diagnostics`, which other evidence gives.
    """
    found = np.minimum(np.abs(residuals(refined.polygon, refined.outline.ratio, columns)), CAP)
    return Diagnostics(
        misfit=float(np.sqrt((found**2).mean())),
        unexplained=float((found >= CAP).any(axis=0).mean()),
        sigma_deg=float(_sigmas_deg(columns).mean()),
        ratio_spread=columns.ratio_spread,
        rival=_rival(*among, refined.polygon),
        nearest=float(shapely.LinearRing(refined.polygon).distance(shapely.Point(0, 0))),
        edges=(refined.floor_share + refined.ceiling_share) / 2,
        corners=float(len(refined.polygon)),
        **seen,
    )


def _sigmas_deg(columns: Columns) -> Doubles:
    """Return each column's uncertainty (N,): the mean of floor's and ceiling's."""
    floor, ceiling = columns.floor_sigma / (1 + columns.floor**2), columns.ceiling_sigma / (1 + columns.ceiling**2)
    return np.asarray(np.degrees(floor + ceiling) / 2)


def _rival(ranked: list[Hypothesis], chosen: Hypothesis, polygon: Doubles) -> float:
    """Return 1 - IoU with the most different room that costs hardly more than the chosen one."""
    floor, most = shapely.make_valid(shapely.Polygon(polygon)), 0.0
    for hypothesis in ranked:
        if hypothesis.total > chosen.total + RIVAL_WITHIN:
            break
        other = shapely.Polygon(hypothesis.fit.polygon)
        if other.is_valid:
            most = max(most, 1 - floor.intersection(other).area / floor.union(other).area)
    return float(most)


def confidence_of(found: Diagnostics) -> float:
    """Return the probability, 0.02..0.98, that the room is right (3D IoU of 0.85 or more)."""
    values = {
        "log2_sigma": math.log2(max(found.sigma_deg, LEAST_SIGMA_DEG)),
        "ratio_spread": min(found.ratio_spread, LARGEST_SPREAD),
        "rival": found.rival,
        "log2_loss": math.log2(max(found.loss, LEAST_LOSS)),
        "entropy": found.entropy,
    }
    score = INTERCEPT + sum(weight * values[name] for name, weight in COEFFICIENTS.items())
    sure = 1 / (1 + math.exp(-max(-30.0, min(30.0, score))))
    # What no simulated room shows: parts missing, no ceiling, a wall at the lens
    sure *= (1 - min(1.0, found.blank / 0.3)) * min(1.0, found.overhead / 0.5) * min(1.0, found.nearest / AT_LENS)
    return float(np.clip(sure, LEAST, MOST))


def doubts(found: Diagnostics, sure: float) -> tuple[str, ...]:
    """Return in words what makes a room doubtful; nothing for a sure one."""
    every = (
        (found.blank > 0.05, f"{100 * found.blank:.0f} % of the sphere show nothing: cropped?"),
        (found.overhead < 0.5, "little ceiling is visible overhead: outdoors, or an open roof?"),
        (found.nearest < 0.25, "a wall is very near the camera: does it stand in a doorway?"),
        (found.unexplained > 0.25, f"no wall explains {found.unexplained:.0%} of directions: open doors or mirrors?"),
        (found.ratio_spread > 0.15, "floor and ceiling disagree on distances: camera not level, or several heights?"),
        (found.rival > 0.15, "another room fits nearly as well"),
        (sure < 0.5, f"the room's shape is doubtful (confidence {sure:.2f}): check it, daylit room SESSION --edit"),
    )
    return tuple(text for doubted, text in every if doubted)


def part_confidences(room: RoomModel, columns: Columns, sure: float) -> tuple[tuple[float, ...], float]:
    """Return each wall's confidence and the ceiling's: by how well the network sees their boundaries, less where the
    wall does not explain them, or floor and ceiling disagree; `UNSEEN` of the room's, ``sure``, for an unseen wall."""
    polygon = np.asarray(room.floor) / room.camera_height_m
    _, wall = wall_ranges(polygon, columns.azimuth_rad)
    ratio = room.ceiling_height_m / room.camera_height_m - 1
    explained = 1 - (np.minimum(np.abs(residuals(polygon, ratio, columns)), CAP) / CAP).mean(axis=0)
    right = 1 / (1 + (_sigmas_deg(columns) / HALF_RIGHT_DEG) ** 2)
    shares = np.array([right, np.minimum(explained / FULLY_EXPLAINED, 1)])
    seen = [shares[:, wall == number] for number in range(len(polygon))]
    walls = (float(own.mean(axis=1).prod()) if own.size else UNSEEN * sure for own in seen)
    ceiling = float(right.mean()) * math.exp(-((columns.ratio_spread / 0.3) ** 2))
    return tuple(round(one, 3) for one in walls), round(ceiling, 3)
