"""A room from the evidence of one upright panorama: its floor, its height, and how sure that is.

The boundaries of walls with floor and ceiling (a network's, `BoundaryEvidence`) give each column's distance twice; the
ratio of ceiling to camera height makes them agree. Rooms that may be meant (`hypotheses`) compete by unexplained
columns, pixels of classes that cannot be where the room puts them, and the number of their walls.
"""

import math
from dataclasses import dataclass, field, replace

import numpy as np

from processing.errors import NoRoomError, ParameterError
from processing.ground.arrays import Doubles
from processing.ground.room_model import HIGHEST_M, RoomModel, geometry_problems
from processing.pictures.images import LuminanceImage, RelativeImage
from processing.room.columns import Columns, columns_of
from processing.room.confidence import Diagnostics, check_picture, confidence_of, diagnose, doubts, part_confidences
from processing.room.held import Held
from processing.room.hypotheses import ClassTable, Hypothesis, class_entropy, hypotheses, overhead_share
from processing.room.outline import Outline
from processing.room.refine import Refined, floor_seen, refine, unrefined
from processing.segmentation.evidence import BoundaryEvidence, SceneEvidence
from processing.sphere import Equirectangular

# Floor polygons without what is no wall: corners on top of each other or on a straight line.
SHORTEST_M = 0.06
STRAIGHT_RAD = math.radians(2.0)


def tidied(floor_m: Doubles) -> Doubles | None:
    """Return a polygon (N, 2) without walls shorter than 6 cm and corners of less than 2 degrees; None if none is left.

    A short wall's two corners become the one in their middle.
    """
    corners = [np.asarray(c, dtype=np.float64) for c in floor_m]
    i = 0
    while i < len(corners) > 3:
        following = (i + 1) % len(corners)
        if math.dist(corners[i], corners[following]) < SHORTEST_M:
            corners[i] = (corners[i] + corners[following]) / 2
            del corners[following]
            i = 0
        elif _straight(corners[i - 1], corners[i], corners[following]):
            del corners[i]
            i = 0
        else:
            i += 1
    return np.array(corners) if len(corners) >= 3 else None


def _straight(before: Doubles, corner: Doubles, after: Doubles) -> bool:
    one, other = corner - before, after - corner
    return abs(math.atan2(one[0] * other[1] - one[1] * other[0], float(one @ other))) < STRAIGHT_RAD


EDGE_WEIGHT = 500.0  # squared standard deviations for edges of full strength all along floor or ceiling
REFINED_AT_MOST = {"standard": 6, "reference": 12}
REFINED_WITHIN = 300.0  # cost by which a room may be worse than the best before edges are asked
CLASS_WEIGHT = 800.0  # squared standard deviations for a mean loss of 1 over the sphere
LEAST_OVERHEAD = 0.1  # share of ceiling above 50 degrees below which the picture is taken to be outdoors
GUESSED, LEAST_SEEN = 2.0, 0.125
"""Times its stated uncertainty, that of a floor's end that is not seen, where it is seen in so much of the turn: 3D IoU
of 12 ZInD pictures .602 to .624, of 16 simulated ones .972 to .973, of penn_bed .80 to .87; with 3 no better."""
MOST_KEPT = 24  # hypotheses that are refined further; chosen, never swept


@dataclass(frozen=True)
class RoomEstimate:
    """A room without openings, and how sure it is; ``room.confidence`` is that of the whole."""

    room: RoomModel
    walls: tuple[float, ...]
    """Confidence of each wall, 0..1: seen, and explained by what is seen."""
    ceiling: float
    """Confidence of the ceiling's height."""
    warnings: tuple[str, ...]
    diagnostics: Diagnostics
    manhattan_rad: float
    """The walls' azimuth, as fitted."""
    alternatives: tuple[str, ...] = field(default=())
    """The rooms that came next, in words."""
    skipped: tuple[str, ...] = field(default=())
    """What was not done, and why."""


def estimate_room(
    image: RelativeImage | LuminanceImage,
    evidence: SceneEvidence,
    *,
    camera_height_m: float = 1.6,
    manhattan_rad: float | None = None,
    quality: str = "standard",
    held: Held | None = None,
) -> RoomEstimate:
    """Return the room that an upright panorama shows.

    ``image``: upright, equirectangular; edges are refined in it at its full size.
    ``evidence``: with boundaries.
    ``camera_height_m``: sets the scale.
    ``manhattan_rad``: azimuth of the walls (`processing.room.level.find_upright`); None: estimated from the boundaries.
    ``quality``: ``draft``: no refinement on the picture. ``standard``, ``reference``.
    ``held``: what stays where somebody has placed it; the rest is estimated around it.
    Raises `NoRoomError`: black, cropped, outdoors, or boundaries that no room explains; `ParameterError`: no
    boundaries, a camera height out of range, a picture looking another way than longitude 0.
    """
    if not (math.isfinite(camera_height_m) and 0.1 <= camera_height_m < 20):
        raise ParameterError(f"a camera height of {camera_height_m} m", advice="give 0.1 to 20")
    blank = check_picture(image)
    if isinstance(image.geometry, Equirectangular) and image.geometry.yaw_rad:
        text = f"the picture's middle looks {math.degrees(image.geometry.yaw_rad):.1f} degrees to the side"
        advice = "resample it to Equirectangular(width, height) first, with longitude 0 at the centre"
        raise ParameterError(text, where="room", advice=advice)
    if evidence.boundary is None:
        raise ParameterError("evidence without boundaries", advice="use evidence with boundaries, or --layout-model")
    overhead = overhead_share(evidence)
    if overhead < LEAST_OVERHEAD:
        raise NoRoomError(
            f"only {100 * overhead:.0f} % of the view overhead may be ceiling", likely="the picture was taken outdoors"
        )
    both = columns_of(evidence.boundary), _heard(evidence.boundary, evidence)
    columns, heard = both if held is None else (held.on(both[0]), held.on(both[1]))
    turned = walls_azimuth(heard) if manhattan_rad is None else manhattan_rad
    ranked = ranked_hypotheses(heard, evidence, turned)
    chosen, refined = _chosen(image, evidence, ranked, heard, camera_height_m, (quality, held))
    room = _model(refined.polygon, refined.outline, camera_height_m)
    assert room is not None
    room = room if held is None else held.exact(room)
    loss = ClassTable(evidence).loss(refined.polygon, refined.outline.ratio)
    seen = {"overhead": overhead, "blank": blank, "entropy": class_entropy(evidence)}
    found = diagnose(columns, (ranked, chosen), refined, loss=loss, **seen)
    sure = confidence_of(found)
    note = f"{chosen.name}, {len(refined.polygon)} walls; {refined.edges} of them refined on edges"
    return RoomEstimate(
        room.model_copy(update={"confidence": round(sure, 3), "note": note}),
        *part_confidences(room, columns, sure),
        warnings=doubts(found, sure),
        diagnostics=found,
        manhattan_rad=refined.outline.turned_rad,
        alternatives=tuple(f"{h.name}, {len(h.fit.polygon)} walls, cost {h.total:.0f}" for h in ranked[1:4]),
        skipped=refined.skipped,
    )


def _heard(boundary: BoundaryEvidence, evidence: SceneEvidence) -> Columns:
    """Return columns whose floor counts less where its end at the wall is not seen; the heights' ratio is by these.

    What networks guess behind furniture errs to one side in a whole room: walls would end beyond their floor."""
    azimuth = ((np.arange(len(boundary.floor_rad)) + 0.5) / len(boundary.floor_rad) - 0.5) * (2 * math.pi)
    seen = floor_seen(evidence, azimuth, boundary.floor_rad)
    guessed = GUESSED if seen.mean() > LEAST_SEEN else 1.0
    return columns_of(replace(boundary, floor_sigma_rad=np.where(seen, 1.0, guessed) * boundary.floor_sigma_rad))


def ranked_hypotheses(columns: Columns, evidence: SceneEvidence, turned_rad: float) -> list[Hypothesis]:
    """Return the rooms that may be meant, the best first: by columns, walls and classes together."""
    table = ClassTable(evidence)
    found = hypotheses(columns, turned_rad)[:MOST_KEPT]
    priced = (replace(h, price=h.price + CLASS_WEIGHT * table.loss(h.fit.polygon, h.fit.outline.ratio)) for h in found)
    return sorted(priced, key=lambda h: h.total)


def walls_azimuth(columns: Columns) -> float:
    """Return the direction, modulo a quarter turn, in which most of the walls look, estimated from boundaries alone."""
    inverse = (columns.floor + columns.ceiling / columns.ratio) / 2
    reach = 1 / np.maximum(inverse, 0.05)
    points = np.stack([reach * np.sin(columns.azimuth_rad), reach * np.cos(columns.azimuth_rad)], axis=-1)
    # Chords over seven columns: long enough for noise, short enough for walls.
    chords = np.roll(points, -4, axis=0) - np.roll(points, 3, axis=0)
    length, angle = np.hypot(chords[:, 0], chords[:, 1]), np.arctan2(chords[:, 0], chords[:, 1])
    candidates = np.linspace(-math.pi / 4, math.pi / 4, 181)[1:]
    off = np.abs(np.sin(2 * (angle[None] - candidates[:, None])))
    return float(candidates[(length * np.minimum(off, 0.4)).sum(axis=1).argmin()])


def _chosen(
    image: RelativeImage | LuminanceImage,
    evidence: SceneEvidence,
    ranked: list[Hypothesis],
    columns: Columns,
    camera_height_m: float,
    how: tuple[str, Held | None],
) -> tuple[Hypothesis, Refined]:
    """Return the hypothesis that the picture's edges, too, speak for, and what they make of it."""
    quality, held = how
    standing = [h for h in ranked if _model(h.fit.polygon, h.fit.outline, camera_height_m) is not None]
    if not standing:
        likely = "the picture does not show a room, or the camera stands in a doorway"
        advice = "give the room by hand: daylit room SESSION --edit"
        raise NoRoomError("no room shape fits the boundaries found", likely=likely, advice=advice)
    if quality == "draft":
        return standing[0], unrefined(standing[0].fit, "not at draft quality")
    few = [h for h in standing if h.total <= standing[0].total + REFINED_WITHIN][: REFINED_AT_MOST[quality]]
    tried = []
    for one in few:
        found = refine(image, evidence, one.fit, columns, held)
        # As it was where the edges would make a room that cannot stand.
        stands = _model(found.polygon, found.outline, camera_height_m) is not None
        tried.append((one, found if stands else unrefined(one.fit, "they make no room")))
    return min(tried, key=lambda one: one[0].total - EDGE_WEIGHT * one[1].strength)


def _model(polygon: Doubles, outline: Outline, camera_height_m: float) -> RoomModel | None:
    floor, high_m = tidied(polygon * camera_height_m), round(camera_height_m * (1 + outline.ratio), 4)
    if floor is None or not (np.abs(floor).max() < 100 and high_m <= HIGHEST_M):
        return None
    corners = tuple((round(float(x), 4), round(float(y), 4)) for x, y in floor)
    room = RoomModel(source="estimated", floor=corners, camera_height_m=camera_height_m, ceiling_height_m=high_m)
    return None if geometry_problems(room) else room
