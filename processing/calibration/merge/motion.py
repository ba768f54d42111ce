"""What moved between the frames: regions that disagree, each shown as one frame saw it; and frames that shifted.

A region is shown by the frame that exposes most of it well, so that it shows one moment; pixels that this frame
cannot show (clipped or too dark in it) take the nearest frame that can.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from processing.calibration.merge.tables import Samples
from processing.calibration.response.samples import TOP_CODE
from processing.errors import BracketError
from processing.ground.arrays import Bytes, Floats, Indices, Int64s
from processing.pictures.frames import Codes, FrameSource
from processing.pictures.images import LUMINANCE_WEIGHTS, Validity

# Frames that shifted against their neighbours (somebody touched the tripod): phase correlation of small windows. Both
# frames of a pair are turned into logarithms of radiance and clipped to the range that both can show: then they are the
# same picture, whatever the exposures, and what differs is the place.
WINDOW_PX = 256  # chosen: enough detail to correlate
WINDOWS = 3  # across and down; chosen
MIN_AGREEING = 2  # windows that must see one shift; chosen
SPARSE = 16  # pixels between those that rank windows; chosen
MIN_PX = 32  # side of the smallest window; chosen
MIN_DETAIL_STOPS = 0.15  # spread within a window, to correlate at all; chosen
MIN_RESPONSE = 0.12  # of the phase correlation's peak; chosen
MIN_SHIFT_PX = 0.75  # chosen: less blurs no edge
AGREE_PX = 0.75  # between windows; chosen
MIN_SNR2 = 50.0  # of a code that counts; chosen


@dataclass(frozen=True)
class _Range:
    """The range of log2 radiance that two frames of a pair both show, and where their codes lie in it."""

    low: float
    high: float
    codes: Int64s
    longer: Floats
    shorter: Floats
    """log2 radiance of green of ``codes``, cut to the range."""


def frame_shifts(frames: Sequence[Codes], tables: Samples) -> list[tuple[int, float, float]]:
    """Return the shifts between neighbours that are surely there; too little detail counts as none.

    ``frames``: (H, W, 3) codes each. Of a frame: its place, and pixels to the right and down from the one before it.
    """
    found = []
    for place in range(1, len(frames)):
        before, after = frames[place - 1], frames[place]
        both = _range(tables, place)
        if both is None:
            continue
        seen = [s for s in (_shift(before[w], after[w], both) for w in _windows(before, both)) if s]
        if len(seen) < MIN_AGREEING:
            continue
        middle = np.median(seen, axis=0)
        spread = np.median(np.abs(np.array(seen) - middle))
        if np.hypot(*middle) >= MIN_SHIFT_PX and spread <= AGREE_PX:
            found.append((place, float(middle[0]), float(middle[1])))
    return found


def _windows(frame: Codes, both: _Range) -> list[tuple[slice, slice]]:
    """Return the windows of the longer frame with the most detail in the range that both frames show."""
    height, width = frame.shape[:2]
    tall, wide = min(WINDOW_PX, height // 2), min(WINDOW_PX, width // 2)
    if min(tall, wide) < MIN_PX:
        return []
    candidates = []
    for top in np.linspace(0, height - tall, min(4, height // tall)).astype(int):
        for left in np.linspace(0, width - wide, min(6, width // wide)).astype(int):
            window = (slice(top, top + tall), slice(left, left + wide))
            sparse = _looked_up(frame[window][::SPARSE, ::SPARSE, 1], both.codes, both.longer)
            candidates.append((float(np.std(sparse)), top, left, window))
    candidates.sort(reverse=True, key=lambda one: one[:3])
    return [window for detail, _, _, window in candidates[:WINDOWS] if detail > MIN_DETAIL_STOPS]


def _range(tables: Samples, place: int) -> _Range | None:
    """Return the range that the frames before ``place`` and at it share; None where they share none."""
    (longer, _), (shorter, weight) = tables.sample(place - 1, tables.every), tables.sample(place, tables.every)
    good = (weight[:, 1] * shorter[:, 1].astype(np.float64) ** 2 > MIN_SNR2) & (shorter[:, 1] > 0)
    low = float(np.log2(shorter[good, 1].min())) if good.any() else np.inf
    high = float(np.log2(tables.saturation[place - 1, 1]))
    if not low < high:
        return None
    cut = [np.clip(np.log2(np.maximum(v[:, 1], 1e-30)), low, high).astype(np.float32) for v in (longer, shorter)]
    return _Range(low, high, tables.every[:, 1], cut[0], cut[1])


def _looked_up(codes: npt.NDArray[np.unsignedinteger[Any]], known: Int64s, values: Floats) -> Floats:
    if codes.dtype == np.uint8 and len(known) == 256:
        return np.asarray(values[codes])
    return np.asarray(np.interp(codes, known, values), dtype=np.float32)


def _shift(before: Codes, after: Codes, both: _Range) -> tuple[float, float] | None:
    """Return (right, down) between two windows, or None where they hold too little in common."""
    a, b = (_looked_up(f[..., 1], both.codes, log2) for f, log2 in ((before, both.longer), (after, both.shorter)))
    if min(np.std(a), np.std(b)) < MIN_DETAIL_STOPS:
        return None
    hanning = cv2.createHanningWindow((a.shape[1], a.shape[0]), cv2.CV_32F)
    (right, down), response = cv2.phaseCorrelate(a - a.mean(), b - b.mean(), hanning)
    return (float(right), float(down)) if response > MIN_RESPONSE else None


CELLS = (64, 32)  # across and down, whose means are compared; chosen
SHOWN, CLEAR = 0.06, 0.05  # of full scale: clear of black and of white, and between two cells that differ; chosen
PAIRS, LEAST_PAIRS = 20_000, 2_000  # of cells; chosen: of a chart in a frame that is white else, there are 680
OTHER_VIEW = 0.15
"""Of pairs of cells, those that two frames show in opposite order: at most 0.115 in 180 hostile brackets (flicker of
30 %, else 0.063; validation seeds), 0.005 in two real ones and 0.33 where one frame of these is moved by a tenth."""


def check_view(frames: Sequence[FrameSource], codes: Sequence[Codes]) -> None:
    """Refuse frames, (H, W, 3) codes each by time, of different views: what is brighter is so at any exposure.

    Raises `BracketError`, which names the frame that differs from both its neighbours, or the first two that differ.
    """
    every = [cv2.resize(f, CELLS, interpolation=cv2.INTER_AREA)[..., 1].ravel() / np.iinfo(f.dtype).max for f in codes]
    one, other = np.random.default_rng(0).integers(0, len(every[0]), (2, PAIRS))
    differ = []
    for longer, shorter in pairwise(every):
        shown = (longer > SHOWN) & (shorter < 1 - SHOWN)
        a, b = (np.where(np.abs(d) > CLEAR, d, 0) for d in (m[one] - m[other] for m in (longer, shorter)))
        order = a * b * shown[one] * shown[other]
        differ.append(int(np.sum(order < 0)) > OTHER_VIEW * max(int(np.count_nonzero(order)), LEAST_PAIRS))
    if any(differ):
        first = differ.index(True)
        alone = all(differ[first : first + 2]) and first + 2 < len(frames)
        raise BracketError(
            "another view than the frames before and after it" if alone else "show different views",
            where=" and ".join(frame.name for frame in frames[first + alone : first + 2]),
            likely="the camera was moved, or a picture of another bracket is among the frames",
            advice="leave that frame out when importing, or take the bracket again",
        )


NEIGHBOURS_PX = 5  # chosen: larger than noise, smaller than a hand
MIN_NEIGHBOURS = 8  # of 25 odd pixels: noise and coding make single ones
CORE_PX = 5
"""Side of what moved in processed frames; chosen: a hot well spreads over three in demosaicing, over four in coding."""
USABLE = 0.02  # of the best frame's signal to noise squared; chosen
MEASURES_WELL = 0.5  # of the best frame's worth
BLED_FRAC = 0.4  # what pixels of a sun two pixels wide are off by, relative; chosen on hostile rigs
SURELY_CLIPPED = 32.0  # times what saturates a frame; chosen
CHUNK_PX = 1 << 20  # pixels settled at a time, for memory


@dataclass
class Planes:
    """The merged picture while it is made; arrays of (H, W, 3) and (H, W)."""

    rgb: Floats
    uncertainty: Floats
    validity: Bytes
    suspect: Bytes
    """1 odd, 2 surely moved."""


def ghost_regions(suspect: Bytes, core_px: int = 1) -> Bytes:
    """Return 1 where something moved: what is surely odd, and what is odd among many odd neighbours; holes closed.

    Regions that hold no square of ``core_px`` are hot pixels and edges. ``suspect`` and the result: (H, W) uint8.
    """
    odd = (suspect > 0).astype(np.uint8)
    around = cv2.boxFilter(odd, -1, (NEIGHBOURS_PX, NEIGHBOURS_PX), normalize=False, borderType=cv2.BORDER_REFLECT)
    kept = ((suspect == 2) | ((odd == 1) & (around >= MIN_NEIGHBOURS))).astype(np.uint8)
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (NEIGHBOURS_PX, NEIGHBOURS_PX))
    kept = np.asarray(cv2.morphologyEx(kept, cv2.MORPH_CLOSE, disc), dtype=np.uint8)
    core = cv2.erode(kept, np.ones((core_px, core_px), np.uint8))
    count, labels = cv2.connectedComponents(kept, connectivity=8, ltype=cv2.CV_32S)
    moved = np.zeros(count, dtype=np.uint8)
    moved[np.unique(labels[core > 0])] = 1
    return np.asarray(moved[labels] & kept)


def settle_ghosts(frames: Sequence[Codes], tables: Samples, planes: Planes, *, processed: bool = False) -> Bytes:
    """Show regions that moved by one frame each, in place; return 0 or 1 + place of the frame shown, (H, W).

    ``processed``: the frames are no wells' own noise, so that single pixels that disagree have not moved.
    """
    ghost = np.zeros(planes.suspect.shape, dtype=np.uint8)
    if not planes.suspect.any():
        return ghost
    count, labels = cv2.connectedComponents(
        ghost_regions(planes.suspect, CORE_PX if processed else 1), connectivity=8, ltype=cv2.CV_32S
    )
    places = np.flatnonzero(labels)
    names = labels.reshape(-1)[places]
    del labels
    chunks = [slice(at, at + CHUNK_PX) for at in range(0, len(places), CHUNK_PX)]
    merit = np.zeros((len(frames), count))
    for chunk in chunks:
        for f, worth in enumerate(_worth(frames, tables, places[chunk])):
            merit[f] += np.bincount(names[chunk], worth, minlength=count)
    reference = np.argmax(merit, axis=0)
    for chunk in chunks:
        _show(frames, tables, planes, ghost, places[chunk], reference[names[chunk]])
    return ghost


def show_bled(frames: Sequence[Codes], tables: Samples, planes: Planes, odd: Indices, ghost: Bytes | None) -> None:
    """Show what clipped light has bled into by the shortest frame that can, in place.

    Sharpening, demosaicing and coding do that: in long frames a small sun or lamp is dark, in colours of its surround.
    ``odd``: places (n,) whose samples disagree; those that are sure, or of ``ghost`` (H, W), which moved, are left.
    """
    rgb, doubt, validity = planes.rgb.reshape(-1, 3), planes.uncertainty.reshape(-1), planes.validity.reshape(-1)
    bled = odd[(doubt[odd] > BLED_FRAC) & (frames[0].reshape(-1, 3)[odd] > TOP_CODE).any(axis=1)]
    bled = bled if ghost is None else bled[ghost.reshape(-1)[bled] == 0]
    before = rgb[bled], doubt[bled], validity[bled]
    _show(frames, tables, planes, np.empty_like(planes.suspect), bled, np.full(len(bled), len(frames) - 1))
    doubt[bled] = np.hypot(doubt[bled], BLED_FRAC)
    # A hot well is bright in every frame, and clips none: so bright a light would clip the longer ones.
    hot = np.zeros(len(bled), bool)
    for f, frame in enumerate(frames):
        clipped = (frame.reshape(-1, 3)[bled] > TOP_CODE).any(axis=1)
        hot |= (rgb[bled] > SURELY_CLIPPED * tables.saturation[f]).any(axis=1) & ~clipped
    rgb[bled[hot]], doubt[bled[hot]], validity[bled[hot]] = (old[hot] for old in before)


def _worth(frames: Sequence[Codes], tables: Samples, places: Indices) -> Floats:
    """Return how well each frame exposes pixels, (F, n) in 0..1: by its worst channel; 0 where clipped."""
    seen = (tables.sample(f, frame.reshape(-1, 3)[places]) for f, frame in enumerate(frames))
    return np.array([np.min((snr2 := w * v**2) / (snr2 + 400.0), axis=1) for v, w in seen], dtype=np.float32)


def _chosen(worth: Floats, reference: Indices) -> Indices:
    """Return the place (n,) of the frame that shows each pixel; frames run from the longest to the shortest.

    The reference, or the nearest usable frame. A pixel too bright for the reference, a lamp or the sun, takes the
    shortest frame that measures it well: in longer ones its clipped neighbours have bled into it through JPEG's blocks.
    """
    distance = np.abs(np.arange(len(worth))[:, None] - reference[None, :])
    nearest = np.argmin(np.where(worth > USABLE, distance, len(worth) + distance), axis=0)
    well = worth >= MEASURES_WELL * worth.max(axis=0)
    shortest = len(worth) - 1 - np.argmax(well[::-1], axis=0)
    return np.asarray(np.where(nearest > reference, np.maximum(shortest, nearest), nearest), dtype=np.intp)


def _show(
    frames: Sequence[Codes], tables: Samples, planes: Planes, ghost: Bytes, places: Indices, reference: Indices
) -> None:
    """Show pixels as their reference frame saw them, or as the nearest frame that can.

    What no frame can show (a sun clipped in all) keeps its merged value, the bound that the shortest frame gives."""
    worth = _worth(frames, tables, places)
    shown = (worth > USABLE).any(axis=0)
    places, reference, worth = places[shown], reference[shown], worth[:, shown]
    chosen = _chosen(worth, reference)
    v, w = (np.empty((len(places), 3), dtype=np.float32) for _ in range(2))
    for f, frame in enumerate(frames):
        mine = chosen == f
        v[mine], w[mine] = tables.sample(f, frame.reshape(-1, 3)[places[mine]])
    _put(planes, places, v, w)
    ghost.reshape(-1)[places] = chosen.astype(np.uint8) + 1


def _put(planes: Planes, places: Indices, v: Floats, w: Floats) -> None:
    """Show pixels by radiances (n, 3) of weights (n, 3), 0 where clipped, in place."""
    weights = np.array(LUMINANCE_WEIGHTS, dtype=np.float32)
    clipped = np.any(w <= 0, axis=1)
    sigma = np.sqrt(np.sum(weights**2 / np.maximum(w, 1e-30), axis=1))
    u = np.where(clipped, np.inf, sigma / np.maximum(v @ weights, 1e-30)).astype(np.float32)
    planes.rgb.reshape(-1, 3)[places] = v
    planes.uncertainty.reshape(-1)[places] = u
    state = np.where(clipped, Validity.CLIPPED, np.where(u > 0.5, Validity.DARK, Validity.VALID))
    planes.validity.reshape(-1)[places] = state.astype(np.uint8)


def show_deep_colours(frames: Sequence[Codes], tables: Samples, planes: Planes) -> None:
    """Show by the longest frame that clips none of their channels what was taken for clipped, in place.

    Where a clipped channel voids the others, a channel may be black in all frames that count: of a red lamp its blue.
    """
    places = np.flatnonzero(planes.validity == Validity.CLIPPED)
    w = tables.sample(len(frames) - 1, frames[-1].reshape(-1, 3)[places])[1]
    places = places[(w > 0).all(axis=1)]
    v, w = np.empty((2, len(places), 3), np.float32)
    for f in reversed(range(len(frames))):
        found, weight = tables.sample(f, frames[f].reshape(-1, 3)[places])
        clear = (weight > 0).all(axis=1)
        v[clear], w[clear] = found[clear], weight[clear]
    _put(planes, places, v, w)
