"""Completion of a rectified texture by its own repeats: floors of tiles, parquet, planks (the paper's near-periodic
patterns, without minutes of optimisation).

The lattice is found in the known part (`near_periodic_lattice`); light is taken out (`illumination`), the hole is
filled with copies one or more lattice steps away (`near_periodic_fill`), and light is put back. Where the pattern
repeats in one direction only, copies come from along that direction; where it does not repeat, `complete` says so and
gives copies that fit their surroundings.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import cv2
import numpy as np

from processing.ground.arrays import Doubles, Flags, Floats
from processing.removal import near_periodic_lattice as shifts
from processing.removal.boards import lay_boards
from processing.removal.illumination import ToneScale, fit_illumination, grey, local_light
from processing.removal.near_periodic_fill import Weights, blend, met_to_rim, solve_weights, window_around
from processing.removal.near_periodic_lattice import Lattice, Line
from processing.removal.plain import fill_plain

SEARCH_PX = (400, 1200)  # of the longer side of the pictures on which the lattice is sought: first, then
SOLVE_PX = 100_000  # pixels of the window on which copies are chosen
RIM_PX, GRAIN_PX = 6.0, 2.0  # chosen, never swept
PASSES = 3  # of light and copies in turn; chosen, never swept


class Repeat(StrEnum):
    """How a texture repeats."""

    LATTICE = "lattice"
    LINE = "line"
    """Along one direction: planks."""
    NONE = "plain"


BOX = 0.35  # of a cell: the neighbourhood in which it is judged whether a copy fits
LOCAL = 0.02  # of the texture's size: the scale below which a pattern without lattice is separated from light
LOCAL_BOARDS = 0.07  # the same beside boards, each of which has its own tone


@dataclass(frozen=True)
class Completion:
    """A texture without its hole."""

    values: Floats
    """(H, W, 3): the given values, bit for bit, but in the hole."""
    confidence: Floats
    """(H, W), 0..1: in the hole how well the copies agree with their surroundings; 1 where known."""
    repeat: Repeat
    lattice: Lattice | None
    """In the texture's pixels."""


def complete(
    values: Floats, known: Flags, hole: Flags, *, density: Floats | None = None, found: "Analysis | None" = None
) -> Completion:
    """Fill ``hole`` of a texture (H, W, 3), linear light >= 0, from the ``known`` pixels; both masks (H, W).

    ``density`` (H, W): picture pixels a texel; where the picture is fine, fine copies are preferred.

    ``found`` is the result of `analyse`, if it is known already.
    Pixels in neither mask are left as they are. Nothing known: the hole stays 0 with confidence 0.
    """
    known = known & ~hole
    if not hole.any() or known.sum() < 4:
        confidence = np.where(hole, 0, 1).astype(np.float32)
        out = np.where(hole[..., None], 0 if not known.any() else values[known].mean(axis=0), values)
        return Completion(out.astype(np.float32), confidence, Repeat.NONE, None)
    found = found or analyse(values, known)
    lattice, line, left = found.lattice, found.line, hole
    out, confidence = values.copy(), known.astype(np.float32)
    if found.repeat is not Repeat.NONE:
        scale = ToneScale.of(values, known)
        tone = np.where(known[..., None], scale.tone(values), 0).astype(np.float32)
        slow = fit_illumination(tone, known, hole, None if lattice is None else lattice.basis_px)
        # Of a mosaic's small cells, light is separated as where there is no lattice.
        if lattice is None or lattice.cell_px < LOCAL * max(known.shape):
            scale_px = (LOCAL_BOARDS if lattice is None else LOCAL) * max(known.shape)
            slow = slow + local_light(np.where(known[..., None], tone - slow, 0), known, scale_px)
        flat = np.where(known[..., None], tone - slow, 0).astype(np.float32)
        if lattice is not None:
            offsets = shifts.lattice_offsets(lattice, known.shape[:2])
            filled, confidence, left = _Job(flat, known, hole, density).filled(offsets, BOX * lattice.cell_px)
        elif line is not None:
            filled, confidence, left = lay_boards(flat, known, hole, line.direction)
        out[hole] = scale.light((filled + slow)[hole])
    if left.any():
        plain = fill_plain(values, known, hole, level_rows=False)
        out[left], confidence[left] = plain.values[left], plain.confidence[left]
    return Completion(out, confidence, found.repeat, lattice)


@dataclass(frozen=True)
class Analysis:
    """How a texture repeats."""

    lattice: Lattice | None
    """In the texture's pixels."""
    line: Line | None

    @property
    def repeat(self) -> Repeat:
        """Return the kind."""
        return Repeat.LATTICE if self.lattice else Repeat.LINE if self.line else Repeat.NONE


def analyse(values: Floats, known: Flags, least_ncc: float = 0.0, sizes: Sequence[int] = SEARCH_PX) -> Analysis:
    """Return how the known part of a texture (H, W, 3) repeats; a lattice weaker than ``least_ncc`` is none.

    It is sought on a picture of the first of ``sizes``, and where nothing is found on the next one: mosaic, and joints
    between boards.
    """
    tone = np.where(known, grey(ToneScale.of(values, known).tone(values)), 0).astype(np.float32)
    factor = min(1.0, sizes[0] / max(tone.shape))
    small, share = _smaller(tone[..., None], known, factor)
    seen = share > 0.5
    smooth = 0.1 * min(small.shape[:2])
    alike = shifts.self_correlation(shifts.high_passed(small[..., 0], seen, smooth), seen)
    lattice = shifts.find_lattice(alike)
    field, inner = shifts.oriented(shifts.high_passed(small[..., 0], seen, 0.25 * smooth), seen, GRAIN_PX)
    if lattice is None:
        lattice = shifts.find_lattice(shifts.self_correlation(field, inner), shifts.ORIENTED_NCC)
    if lattice is not None and lattice.strength >= least_ncc:
        return Analysis(Lattice(lattice.a_px / factor, lattice.b_px / factor, lattice.strength), None)
    line = shifts.find_line(field, inner)
    if line is not None or len(sizes) == 1:
        return Analysis(None, line)
    finer = analyse(values, known, least_ncc, sizes[1:]).lattice if factor < 1 else None
    return Analysis(finer, None if finer else shifts.find_joints(tone, known))


def _smaller(tone: Floats, known: Flags, factor: float) -> tuple[Floats, Floats]:
    """Return the known pixels' mean (H, W, C) in a picture ``factor`` as large, and the share that is known."""
    if factor >= 1.0:
        return tone, known.astype(np.float32)
    size = tuple(max(2, round(n * factor)) for n in tone.shape[1::-1])
    weight = known.astype(np.float32)
    share = cv2.resize(weight, size, interpolation=cv2.INTER_AREA)
    total = cv2.resize(tone * weight[..., None], size, interpolation=cv2.INTER_AREA).reshape(*share.shape, -1)
    return np.asarray(total / np.maximum(share, 1e-6)[..., None], np.float32), np.asarray(share, np.float32)


@dataclass(frozen=True)
class _Job:
    """What is to be filled from what."""

    tone: Floats
    """(H, W, 3), 0 where not known."""
    known: Flags
    hole: Flags
    density: Floats | None

    def filled(self, offsets: Doubles, box_px: float) -> tuple[Floats, Floats, Flags]:
        """Return tone (H, W, 3), confidence and what is left (H, W); ``offsets`` (N, 2) as (dx, dy)."""
        job, confidence = self, self.known.astype(np.float32)
        for turn in range(PASSES):
            done, tone, sure = job.one_pass(offsets, box_px)
            if not done.any():
                break
            confidence[done] = sure[done] * 0.7**turn
            job = _Job(np.where(done[..., None], tone, job.tone), job.known | done, job.hole & ~done, self.density)
            if not job.hole.any():
                break
        return job.tone, confidence, job.hole

    def one_pass(self, offsets: Doubles, box_px: float) -> tuple[Flags, Floats, Floats]:
        """Return where the hole was filled (H, W), its tone (H, W, 3) and its confidence (H, W)."""
        window = window_around(self.hole, round(max(1.7 * box_px, 2 * RIM_PX)) + 2)
        area = (window[0].stop - window[0].start) * (window[1].stop - window[1].start)
        scale = min(1.0, float(np.sqrt(SOLVE_PX / area)))
        weights = self.solved(offsets, window, scale, box_px)
        mean, offered = blend(self.tone, self.known, weights, window, scale)
        hole = self.hole[window]
        done, filled = np.zeros_like(self.hole), np.zeros_like(self.tone)
        sure = np.zeros(self.hole.shape, np.float32)
        done[window] = hole & offered
        filled[window] = met_to_rim(mean, offered, self.tone[window], self.known[window], hole, RIM_PX)
        cost = cv2.resize(weights.cost, mean.shape[1::-1], interpolation=cv2.INTER_LINEAR)
        sure[window] = np.exp(-1.5 * np.sqrt(np.maximum(cost, 0)))
        return done, filled, sure

    def solved(self, offsets: Doubles, window: tuple[slice, slice], scale: float, box_px: float) -> Weights:
        """Return the weights of copies from ``offsets`` (N, 2), solved on a picture ``scale`` times as large."""
        small, share = _smaller(self.tone, self.known, scale)
        seen = share > 0.99
        lack = _smaller(self.hole[..., None].astype(np.float32), np.ones_like(self.hole), scale)[0][..., 0] > 0
        small = np.where(seen[..., None], small, 0).astype(np.float32)
        rows, columns = (
            slice(int(s.start * scale), min(max(int(s.start * scale) + 2, int(np.ceil(s.stop * scale))), n))
            for s, n in zip(window, seen.shape, strict=True)
        )
        density = None
        if self.density is not None:
            density = np.asarray(cv2.resize(self.density, seen.shape[::-1], interpolation=cv2.INTER_AREA), np.float32)
        given = small, seen, lack & ~seen, offsets * scale, (rows, columns)
        return solve_weights(*given, box_px=max(7, round(box_px * scale)), density=density)


# What of a plane's texture may be copied and learnt from: what looks as the plane looks elsewhere too.
#
# A mask is never quite right: beside it stand the rest of a rug, a chair's foot, a board that nobody took for
# furniture. Copied into the hole they are shards. Such a thing is seen in one place; boards, tiles, grain and wear are
# seen in many. So each texel's look (colour, tone and roughness, the slow light taken out) is sought away from it. How
# unlike is too unlike depends on the texture: a varied floor allows much. A thing ends at an edge; light and shadow,
# which run out, stay: the light's fit needs them.

CELL_M = 0.03  # chosen, never swept
MOST_CELLS = 200  # of the longer side; at 110 a stool's leg was lost in its cell
AWAY_M = 0.6  # from a cell, where its look is sought: what is smaller and alone is a thing
LEAST_CELLS = 600  # known cells, under which it is unknown what is usual
GREY_WEIGHT, ROUGH_WEIGHT = 0.25, 0.1  # against colour: shadows are darker, and yet the plane
USUAL_SHARE = 0.04  # of the known cells that must look so
TOLERANCE, LEAST_TOLERANCE = 2.6, 0.1
"""Times the median cell's distance (rests may be a third of all that is seen); least of it (at 0.18 a mat of a tiled
floor's colour was copied)."""
LEVELS = (4.0, 2.0, 1.0)  # times the tolerance: a white board beside a grey box is found before both
EDGE = 0.7  # of the tolerance: as far as a thing reaches from what is surely odd
SMOOTH_CELLS = 1.2  # chosen, never swept
SAMPLES = 800  # chosen, never swept
ACROSS_CELLS, STEEP = 4, 0.6  # across so many cells, a thing's border shows so much of what its middle differs by
RIM_CELLS = 2  # around what is odd: its edge, its contact shadow
LEAST_CLUMP = 3  # cells of what is left out: fewer are chance
ISLAND = 0.06  # of the largest part that is seen in one piece: smaller ones are islands
MOST_OUT = 0.35  # of the known cells: if more is odd, the plane is odd


def plane_sources(values: Floats, sources: Flags, px_per_m: float) -> Flags:
    """Return those of ``sources`` (H, W) that look as the plane does; ``values`` (H, W, 3) are linear light.

    All of them where too little is seen to judge.
    """
    factor = min(1.0, 1 / (CELL_M * px_per_m), MOST_CELLS / max(sources.shape))
    size = tuple(max(2, round(n * factor)) for n in sources.shape[1::-1])
    share = np.asarray(cv2.resize(sources.astype(np.float32), size, interpolation=cv2.INTER_AREA), np.float32)
    seen = np.asarray(share > 0.3)
    if seen.sum() < LEAST_CELLS:
        return sources
    odd = _odd(_looks(values, sources, share, seen), seen, AWAY_M * px_per_m * factor)
    if odd.sum() > MOST_OUT * seen.sum():
        odd[:] = False
    wide = cv2.dilate(odd.astype(np.uint8), np.ones((2 * RIM_CELLS + 1,) * 2, np.uint8)).astype(bool)
    wide |= cv2.dilate(_islands(seen & ~wide).astype(np.uint8), np.ones((3, 3), np.uint8)).astype(bool)
    if not wide.any():
        return sources
    out = cv2.resize(wide.astype(np.uint8), sources.shape[::-1], interpolation=cv2.INTER_NEAREST).astype(bool)
    return np.asarray(sources & ~out)


def _islands(seen: Flags) -> Flags:
    """Return what is seen between holes, in small parts: mostly shadow and rests of things."""
    _, labels, stats, _ = cv2.connectedComponentsWithStats(seen.astype(np.uint8))
    size = stats[:, cv2.CC_STAT_AREA].astype(np.float64)
    size[0] = 0
    small = size < ISLAND * size.max()
    small[0] = False
    return np.asarray(small[labels])


def _looks(values: Floats, sources: Flags, share: Floats, seen: Flags) -> Floats:
    """Return (H, W, 5) how cells look: colour, tone, roughness, in weighted natural logarithms."""
    tone = ToneScale.of(values, sources).tone(values)
    weight = sources.astype(np.float32)
    mean = _means(tone * weight[..., None], share)
    level = grey(tone)
    spread = _means(level**2 * weight, share) - _means(level * weight, share) ** 2
    rough = 0.5 * np.log(np.maximum(spread, 1e-4))
    # Daylight and lamps fall across one floor: its colour changes slowly, too.
    mean = mean - fit_illumination(np.where(seen[..., None], mean, 0), seen, ~seen, None, bend=4.0)
    shade = grey(mean)
    colour = mean - shade[..., None]
    looks = np.concatenate([colour, GREY_WEIGHT * shade[..., None], ROUGH_WEIGHT * rough[..., None]], axis=-1)
    looks = np.where(seen[..., None], looks, 0).astype(np.float32)
    known = cv2.GaussianBlur(seen.astype(np.float32), (0, 0), SMOOTH_CELLS)
    smooth = cv2.GaussianBlur(looks, (0, 0), SMOOTH_CELLS)
    return np.asarray(smooth / np.maximum(known, 1e-3)[..., None], np.float32)


def _means(picture: Floats, share: Floats) -> Floats:
    small = cv2.resize(picture, share.shape[::-1], interpolation=cv2.INTER_AREA)
    over = np.maximum(share, 1e-3)
    return np.asarray(small / (over if small.ndim == 2 else over[..., None]), np.float32)


def _odd(looks: Floats, seen: Flags, away_px: float) -> Flags:
    """Return the cells whose look is not found elsewhere, in clumps."""
    places = np.argwhere(seen).astype(np.float64)
    chosen = np.random.default_rng(13).permutation(len(places))[:SAMPLES]
    square = _squares(looks[seen], looks[seen][chosen])
    square[_squares(places, places[chosen]) < away_px**2] = np.inf
    rank = max(1, round(USUAL_SHARE * len(chosen)))
    nearest = np.sqrt(np.partition(square, rank, axis=1)[:, rank])
    if not np.isfinite(nearest).all():
        # All that is seen lies together.
        return np.zeros_like(seen)
    tolerance = max(TOLERANCE * float(np.median(nearest)), LEAST_TOLERANCE)
    off = np.zeros(seen.shape)
    off[seen] = nearest
    odd, steep = np.zeros_like(seen), _steepness(looks, seen)
    for level in LEVELS:
        odd |= _things(looks, steep, off / (level * tolerance), seen & ~odd)
    return odd


def _things(looks: Floats, steep: Floats, off: Doubles, seen: Flags) -> Flags:
    """Return the clumps that are off by more than 1 and end at an edge, as far as they are off by `EDGE`."""
    _, labels, stats, _ = cv2.connectedComponentsWithStats(((off > EDGE) & seen).astype(np.uint8))
    found = np.zeros_like(seen)
    for label in np.unique(labels[(off > 1) & seen]):
        clump = labels == label
        if stats[label, cv2.CC_STAT_AREA] >= LEAST_CLUMP and _ends(looks, steep, clump, seen & (labels == 0)):
            found |= clump
    return found


def _ends(looks: Floats, steep: Floats, clump: Flags, usual: Flags) -> bool:
    """Return whether a clump ends at an edge, as things do; light and shadow run out.

    ``steep`` (H, W): how much looks change across `ACROSS_CELLS`. Towards a hole nobody sees how a clump ends: what has
    no other border is a thing."""
    outside = cv2.distanceTransform((~clump).astype(np.uint8), cv2.DIST_L2, 3)
    inside = cv2.distanceTransform(clump.astype(np.uint8), cv2.DIST_L2, 3)
    around = usual & (outside > ACROSS_CELLS) & (outside <= 3 * ACROSS_CELLS)
    border = (outside <= ACROSS_CELLS) & (inside <= ACROSS_CELLS)
    border &= cv2.dilate(around.astype(np.uint8), np.ones((2 * ACROSS_CELLS + 1,) * 2, np.uint8)).astype(bool)
    if not border.any():
        return True
    core = clump & (inside >= 0.7 * inside.max())
    whole = float(np.linalg.norm(looks[core].mean(axis=0) - looks[around].mean(axis=0)))
    return float(np.quantile(steep[border], 0.7)) > STEEP * whole


def _steepness(looks: Floats, seen: Flags) -> Floats:
    """Return (H, W): how much looks change across `ACROSS_CELLS` at most, near each cell."""
    half, found = ACROSS_CELLS // 2, np.zeros(seen.shape, np.float32)
    for axis in (0, 1):
        one, other = np.roll(looks, half, axis), np.roll(looks, -half, axis)
        both = np.roll(seen, half, axis) & np.roll(seen, -half, axis)
        for line in (slice(0, half), slice(-half, None)):
            both[(line, slice(None)) if axis == 0 else (slice(None), line)] = False
        found = np.maximum(found, np.where(both, np.linalg.norm(one - other, axis=-1), 0))
    return np.asarray(cv2.dilate(found, np.ones((ACROSS_CELLS + 1,) * 2, np.uint8)), np.float32)


def _squares(a: Floats | Doubles, b: Floats | Doubles) -> Doubles:
    """Return (N, M): squared distances between rows."""
    found = (a**2).sum(axis=1)[:, None] + (b**2).sum(axis=1)[None] - 2 * a @ b.T
    return np.asarray(np.maximum(found, 0), np.float64)
