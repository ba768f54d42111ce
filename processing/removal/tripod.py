"""The photographer's things: the tripod is found at the nadir, not assumed; the meter board where evidence shows it.

Four signs: the network's evidence, colours that the floor around does not have, what is thin and far darker than what
is beside it (legs), and a disc without any detail (what cameras and stitchers put over the nadir). Whatever they mark
must hang together with the nadir, or the evidence must be strong.
"""

import math
from dataclasses import dataclass

import cv2
import numpy as np

from processing.ground.arrays import AnyArray, Bytes, Flags, Floats, Indices
from processing.ground.board import MOST_LATITUDE_RAD
from processing.ground.known_board import board_around
from processing.ground.seam import components, row_latitudes, wrapped
from processing.removal.edges import colour_distance, cut_picture, snapped
from processing.segmentation.evidence import SceneClass

# The surroundings of the nadir seen straight from above, without the panorama's stretching: there and back.

REACH_RAD = math.radians(50)
SIZE_PX = 320  # side of the nadir picture: 0.31 degrees a pixel
CORE_RAD = math.radians(4)  # what is found must reach this near to the nadir
FULL_RAD, NONE_RAD = math.radians(22), math.radians(42)
"""Strange colours count fully within the first angle, not at all beyond the second."""
RING_RAD = (math.radians(26), math.radians(49))  # where the floor's colours are learned
OUTLIER = 12.0  # squared distance from the floor's colours (in standard deviations) that is as likely tripod as floor
RIM_PX = 12  # of a nadir picture, 3.7 degrees: around what is at the nadir, where feet of a tripod may show (chosen)
LEG_PX = 15  # of a nadir picture, 4.7 degrees: what is narrower may be a leg
DARKER = (2.5, 5.0)
"""How many times darker than beside it a leg may be, and surely is: gaps of a floor's boards are less, or fainter."""
PALER = 1.8  # how many times brighter than beside it a foot's cap is: a floor's boards differ less (chosen)
LEAST_DISC_RAD = math.radians(4)
FLAT = 0.25  # of the detail in the ring: a disc with less has been painted over
STRONG = 0.6  # mean probability of a part away from the nadir, from which evidence alone makes it the photographer's
LEAST_RING_PX = 500  # of floor around the nadir; chosen, never swept


def radius_map() -> Floats:
    """Return each pixel's angle (rad) from the nadir, of a nadir picture's shape (`SIZE_PX`, `SIZE_PX`)."""
    at = (np.arange(SIZE_PX) + 0.5 - SIZE_PX / 2) * (2 * REACH_RAD / SIZE_PX)
    return np.asarray(np.hypot(at[None, :], at[:, None]), dtype=np.float32)


def nadir_picture(picture: AnyArray, *, nearest: bool = False) -> AnyArray:
    """Return what lies within `REACH_RAD` of the nadir of a panorama (H, W) or (H, W, C): equidistant, ahead up."""
    height, width = picture.shape[:2]
    at = (np.arange(SIZE_PX) + 0.5 - SIZE_PX / 2) * (2 * REACH_RAD / SIZE_PX)
    longitude = np.arctan2(at[None, :], -at[:, None])
    latitude = radius_map() - math.pi / 2
    pad = 2
    wide: AnyArray = wrapped(picture, pad)
    x = ((longitude / (2 * math.pi) + 0.5) * width - 0.5 + pad).astype(np.float32)
    y = ((0.5 - latitude / math.pi) * height - 0.5).astype(np.float32)
    how = cv2.INTER_NEAREST if nearest else cv2.INTER_LINEAR
    found = cv2.remap(wide, x, np.minimum(y, np.float32(height - 1)), how, borderMode=cv2.BORDER_REPLICATE)
    return found.reshape(SIZE_PX, SIZE_PX, *picture.shape[2:])


def onto_panorama(share: Floats, shape: tuple[int, int]) -> Floats:
    """Return a nadir picture (`SIZE_PX`, `SIZE_PX`) on a panorama (H, W); 0 beyond `REACH_RAD`."""
    height, width = shape
    radius = row_latitudes(height) + math.pi / 2
    rows = np.flatnonzero(radius < REACH_RAD)
    out = np.zeros(shape, np.float32)
    if not rows.size:
        return out
    longitude = ((np.arange(width) + 0.5) / width - 0.5) * (2 * math.pi)
    scale = SIZE_PX / (2 * REACH_RAD)
    x = radius[rows, None] * np.sin(longitude) * scale + SIZE_PX / 2 - 0.5
    y = -radius[rows, None] * np.cos(longitude) * scale + SIZE_PX / 2 - 0.5
    out[rows] = cv2.remap(share, x.astype(np.float32), y.astype(np.float32), cv2.INTER_LINEAR)
    return out


@dataclass(frozen=True)
class TripodFound:
    """Masks (H, W) at working size."""

    mask: Flags
    """All of it."""
    at_nadir: bool
    disc_rad: float
    """Radius of a painted-over disc, 0 where there is none."""
    boards: int
    """Parts away from the nadir: the meter board and its stand."""


def find_tripod(probabilities: Floats, rgb8: Bytes, floor: Flags) -> TripodFound:
    """Return tripod and board of an upright panorama: evidence (8, H, W), sRGB (H, W, 3), floor region (H, W)."""
    evidence = probabilities[SceneClass.TRIPOD]
    disc_rad = painted_disc(rgb8)
    near, found = _at_nadir(probabilities, rgb8, floor, disc_rad)
    away = _boards(evidence, rgb8, near)
    return TripodFound(near | away[0], found, disc_rad, away[1])


def _at_nadir(probabilities: Floats, rgb8: Bytes, floor: Flags, disc_rad: float) -> tuple[Flags, bool]:
    radius = radius_map()
    picture = np.asarray(nadir_picture(rgb8), np.uint8)
    evidence = np.asarray(nadir_picture(probabilities[SceneClass.TRIPOD]), np.float32)
    furniture = np.asarray(nadir_picture(probabilities[SceneClass.FURNITURE]), np.float32)
    ring = (radius > RING_RAD[0]) & (radius < RING_RAD[1]) & (furniture < 0.3) & (evidence < 0.3)
    ring &= np.asarray(nadir_picture(floor.astype(np.uint8), nearest=True), bool)
    reach = np.clip((NONE_RAD - radius) / (NONE_RAD - FULL_RAD), 0, 1)
    strange = thin_and_dark(picture) * reach
    if ring.sum() >= LEAST_RING_PX:
        strange = np.maximum(strange, strangeness(picture, ring) * reach)
    prior = 1 - (1 - evidence) * (1 - strange * (furniture < 0.5))
    prior = np.where(radius < disc_rad, 1.0, prior)
    prior = np.where(radius >= REACH_RAD, 0.0, prior).astype(np.float32)
    share = np.maximum(cut_picture(prior, picture), (prior > 0.8).astype(np.float32))
    _, labels = cv2.connectedComponents((share > 0.5).astype(np.uint8), connectivity=8)
    touching = np.unique(labels[(radius < max(CORE_RAD, disc_rad)) & (labels > 0)])
    kept = np.isin(labels, touching) & (labels > 0)
    if not kept.any() or float(prior[kept].mean()) < 0.5:
        return np.zeros(floor.shape, bool), False
    # Feet that show beyond a painted disc or a plate are seen alone: strange colours and pale spots at its rim.
    rim = cv2.dilate(kept.astype(np.uint8), np.ones((2 * RIM_PX + 1,) * 2, np.uint8)).astype(bool)
    # What is narrower than `LEG_PX` and `PALER` times as bright as what is beside it, (H, W), and its edge
    light = np.log((cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY).astype(np.float32) / 255) ** 2.2 + 1e-3)
    brush = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (LEG_PX, LEG_PX))
    paler = (cv2.morphologyEx(light, cv2.MORPH_TOPHAT, brush) > math.log(PALER)).astype(np.uint8)
    feet = rim & ((strange > 0.5) | np.asarray(cv2.dilate(paler, np.ones((3, 3), np.uint8)), bool)) & (furniture < 0.5)
    whole = cv2.morphologyEx((kept | feet).astype(np.uint8), cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8))
    return onto_panorama(whole.astype(np.float32), (floor.shape[0], floor.shape[1])) > 0.5, True


def strangeness(rgb8: Bytes, known: Flags) -> Floats:
    """Return (H, W) in 0..1: how unlike the colours of the known pixels each pixel is; a half at `OUTLIER`."""
    away = colour_distance(rgb8, known)
    return (1 / (1 + np.exp(-np.clip((away - OUTLIER) / 3, -30, 30)))).astype(np.float32)


def thin_and_dark(rgb8: Bytes) -> Floats:
    """Return (H, W) in 0..1: how surely each pixel is narrower than `LEG_PX` and darker than what is beside it."""
    encoded = cv2.cvtColor(rgb8, cv2.COLOR_RGB2GRAY).astype(np.float32)
    light = np.log((encoded / 255) ** 2.2 + 1e-3)
    darker = cv2.morphologyEx(light, cv2.MORPH_BLACKHAT, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (LEG_PX, LEG_PX)))
    low, high = np.log(DARKER)
    return np.asarray(np.clip((darker - low) / (high - low), 0, 1), np.float32)


def painted_disc(rgb8: Bytes) -> float:
    """Return the radius (rad) of a disc without detail at the nadir of a panorama (H, W, 3), 0 where there is none."""
    light = cv2.cvtColor(np.asarray(nadir_picture(rgb8), np.uint8), cv2.COLOR_RGB2GRAY).astype(np.float32)
    mean = cv2.boxFilter(light, -1, (5, 5))
    spread = np.sqrt(np.maximum(cv2.boxFilter(light * light, -1, (5, 5)) - mean * mean, 0))
    rings = (radius_map() / math.radians(1)).astype(np.int32)
    detail = np.array([float(np.median(spread[rings == ring])) for ring in range(int(math.degrees(REACH_RAD)))])
    usual = float(np.median(detail[int(math.degrees(RING_RAD[0])) :]))
    if usual < 0.5:
        return 0.0
    flat = detail < FLAT * usual
    end = int(np.argmin(flat)) if not flat.all() else 0
    return math.radians(end) if math.radians(end) >= LEAST_DISC_RAD else 0.0


def _boards(evidence: Floats, rgb8: Bytes, near: Flags) -> tuple[Flags, int]:
    """Return parts that strong evidence alone shows, away from what was found at the nadir, and their number."""
    if not (evidence > 0.5).any():
        return np.zeros(near.shape, bool), 0
    count, labels = components(snapped(evidence, rgb8) > 0.5)
    sums = np.bincount(labels.ravel(), evidence.ravel(), count + 1)
    strong = sums >= STRONG * np.maximum(np.bincount(labels.ravel(), minlength=count + 1), 1)
    strong[0] = False
    strong[np.unique(labels[near])] = False
    return strong[labels], int(strong.sum())


# The meter's board at the place where a session says that the meter looked, and its stand: no network need guess.
#
# The stand is what is thin, hangs together with the board's lower edge, and reaches down from there. A sheet on a wall
# or on furniture has no stand.

THIN_RAD = math.radians(3.5)  # what is narrower may be a pole or a leg; what is wider is left to other evidence
STAND_STOPS, POLE_STOPS = 0.35, 0.12  # by which a leg, and a pole over its length, differs from what is beside it
TEXTURE_SHARE, TEXTURE_TIMES = 0.75, 2.5
"""What this share of a row beside the stand does not exceed is texture; a stand differs by this many times as much."""
TIP_SHARE = 0.7  # of both, from which a leg goes on to its tip (chosen)
POLE_REACH, POLE_RAD = 0.1, math.radians(3)
"""Of the board's width, how far from its middle a pole is looked for; over which length it is averaged."""
REACH = 0.4  # of the board's width, to either side of its middle: how far legs spread
LEAST_POLE_RAD = math.radians(4)  # below the board, from which it stands on something of its own


def meter_board(luminance: Floats, target: tuple[float, float], tint: Floats | None = None) -> tuple[Flags, bool]:
    """Return the mask (H, W) of board and stand in an upright panorama, and whether there is a stand.

    ``luminance`` (H, W) float32, any scale; W = 2 H. What is not finite or not above zero is no part of a board.
    ``target``: where the meter looked: longitude and latitude in rad.
    ``tint`` (H, W) float32, log2 of blue over red: separates the board from what is as bright behind it.

    Nothing is marked where no board is seen at the target (a wall was measured, the target lies beyond 60 degrees).
    """
    height, width = luminance.shape
    nothing = np.zeros((height, width), bool)
    if not all(map(math.isfinite, target)) or abs(target[1]) > MOST_LATITUDE_RAD:
        return nothing, False
    middle, row = width // 2, min(int((0.5 - target[1] / math.pi) * height), height - 1)
    shift = middle - int((target[0] / (2 * math.pi) + 0.5) * width)
    known = np.isfinite(luminance) & (luminance > 0)
    level = np.log2(np.where(known, luminance, np.float32(1e-6))).astype(np.float32)
    level = np.roll(level, shift, axis=1)
    if tint is not None:
        tint = np.asarray(cv2.medianBlur(np.roll(tint, shift, axis=1), 3), np.float32)
    board = board_around(np.asarray(cv2.medianBlur(level, 3), np.float32), (row, middle), tint)
    if board is None:
        return nothing, False
    stand = _stand(level, board)
    return np.roll(board | stand, -shift, axis=1), bool(stand.any())


def _stand(level: Floats, board: Flags) -> Flags:
    """Return what is thin, unlike what is beside it, and hangs from the board's lower edge."""
    height = level.shape[0]
    rows, columns = np.nonzero(board)
    low, left, right = int(rows.max()), int(columns.min()), int(columns.max())
    window, narrow = np.zeros_like(board), np.zeros_like(board)
    for mask, share in ((window, REACH), (narrow, POLE_REACH)):
        reach = max(2, round(share * (right - left)))
        mask[low - 2 :, (left + right) // 2 - reach : (left + right) // 2 + reach + 1] = True
    wide = 2 * (right - left)
    beside = np.r_[max(0, left - wide) : left, right : min(level.shape[1], right + wide)]
    brush = max(3, round(THIN_RAD / math.pi * height)) | 1
    long = max(3, round(POLE_RAD / math.pi * height)) | 1
    poles = _unlike(np.asarray(cv2.blur(level, (1, long)), np.float32), (brush, 1))
    legs = np.maximum(_unlike(level, (brush, 1)), _unlike(level, (brush, brush)))
    pole = (poles > np.maximum(POLE_STOPS, _usual(poles, beside))) & narrow
    leg = legs / np.maximum(STAND_STOPS, _usual(legs, beside))
    found = np.zeros_like(board)
    found[low : low + 4] = narrow[low : low + 4]
    # Legs thin out towards their tips: what hangs on is followed where it is fainter.
    for least in (1.0, TIP_SHARE):
        seen = ((pole | ((leg > least) & window)) & ~board).astype(np.uint8)
        thin = np.asarray(cv2.morphologyEx(seen, cv2.MORPH_CLOSE, np.ones((5, 3), np.uint8)), np.uint8)
        _, labels = cv2.connectedComponents(thin, connectivity=8)
        hanging = np.unique(labels[found])
        found = np.isin(labels, hanging[hanging > 0])
    depth = (int(np.nonzero(found)[0].max()) - low) * math.pi / height if found.any() else 0.0
    if depth < LEAST_POLE_RAD:
        return np.zeros_like(board)
    return np.asarray(cv2.dilate(found.astype(np.uint8), np.ones((3, 3), np.uint8)), bool)


def _usual(unlike: Floats, beside: Indices) -> Floats:
    """Return (H, 1): by how much a stand must differ from what is beside it; a carpet's texture does not."""
    texture = np.quantile(unlike[:, beside], TEXTURE_SHARE, axis=1).astype(np.float32)[:, None]
    return np.asarray(TEXTURE_TIMES * cv2.blur(texture, (1, 9)), np.float32)


def _unlike(level: Floats, brush: tuple[int, int]) -> Floats:
    """Return by how much each place is darker or brighter than what lies a brush's width away on both sides."""
    shape = cv2.getStructuringElement(cv2.MORPH_RECT, brush)
    hats = [cv2.morphologyEx(level, how, shape) for how in (cv2.MORPH_BLACKHAT, cv2.MORPH_TOPHAT)]
    return np.asarray(np.maximum(*hats), np.float32)
