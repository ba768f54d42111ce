"""Which shifted copies of a texture fill which pixels of a hole: expectation maximisation over one label a pixel.

A copy agrees with a place as far as it agrees with the surroundings within a box: known pixels count fully, guessed
ones less. The next guess is the copies' weighted mean. Solved on a picture small enough; `near_periodic_blend` then
takes the weights to the full one.
"""

import math
from dataclasses import dataclass

import cv2
import numpy as np

from processing.ground.arrays import Doubles, Flags, Floats, Indices
from processing.removal.illumination import blurred, spread

GUESS_WEIGHT = 0.25  # of filled pixels against known ones when copies are compared
ROUNDS = 4  # of expectation and maximisation; chosen, never swept
COARSE_PENALTY = 1.0  # chosen, never swept
USUAL_PX = 40_000  # pixels of which a shift's usual difference is known; chosen, never swept
USUAL_SHARE = 1.5  # of a box's pixels that a copy's usual difference counts for
LEAST_COMPARED = 50  # known pixels from which a copy has a usual difference
PRUNE = 0.002  # share of the hole that a copy must serve after the first round to stay


@dataclass(frozen=True)
class Weights:
    """How much each copy gives to each pixel of a window; ``share`` sums to 1 where any copy offers something."""

    share: Floats
    """(N, H, W)."""
    best: Indices
    """(H, W): index of the copy that agrees best."""
    cost: Floats
    """(H, W): mean squared tone difference of the best copy to its surroundings."""
    offsets: Doubles
    """(N, 2) as (dx, dy)."""


def shifted(
    tone: Floats, known: Flags, offset: Doubles, window: tuple[slice, slice], *, cubic: bool
) -> tuple[Floats, Flags]:
    """Return what the pixels of a window get from (dx, dy) away, (H, W, C), and where that is known."""
    rows, columns = window
    size = (columns.stop - columns.start, rows.stop - rows.start)
    move = np.array([[1, 0, columns.start + offset[0]], [0, 1, rows.start + offset[1]]], np.float64)
    linear = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP if cubic else linear
    copy = cv2.warpAffine(tone, move, size, flags=flags, borderMode=cv2.BORDER_CONSTANT, borderValue=0)
    share = cv2.warpAffine(known.astype(np.float32), move, size, flags=linear, borderValue=0)
    return np.asarray(copy.reshape(size[1], size[0], -1), np.float32), np.asarray(share > 0.999)


def solve_weights(
    tone: Floats,
    known: Flags,
    hole: Flags,
    offsets: Doubles,
    window: tuple[slice, slice],
    *,
    box_px: int,
    density: Floats | None = None,
) -> Weights:
    """Return which copies fill the window's hole; ``tone`` (H, W, C) must be 0 where not known.

    ``density`` (H, W): how finely the picture that the texture comes from saw it; copies that were seen less finely
    than their place count as worse.
    """
    inner = np.ones((3, 3), np.uint8)
    reach = cv2.erode(known.astype(np.uint8), inner, borderType=cv2.BORDER_REPLICATE).astype(bool)
    copies, offered = (
        list(part) for part in zip(*(shifted(tone, reach, o, window, cubic=False) for o in offsets), strict=True)
    )
    here, lack = known[window], hole[window]
    useful = [n for n, some in enumerate(offered) if (some & lack).any()] or [0]
    copies, offered, offsets = [copies[n] for n in useful], [offered[n] for n in useful], offsets[useful]
    any_copy = np.any(offered, axis=0)
    penalty = _penalties(density, known, offsets, window)
    usual = _usual_costs(tone, known, offsets)
    guess = _first_guess(tone[window], here, copies, offered)
    for turn in range(ROUNDS):
        size = max(3, round(box_px * (1.6 - 0.6 * turn / (ROUNDS - 1)))) | 1
        cost = _costs(guess, here, lack, copies, offered, size, usual)
        if penalty is not None:
            cost *= penalty
        share, least = _shares(cost)
        guess = np.where((lack & any_copy)[..., None], _mean(copies, share), guess).astype(np.float32)
        if turn == 0 and len(copies) > 8:
            served = share[:, lack].mean(axis=1)
            keep = np.flatnonzero(served >= min(PRUNE, float(np.sort(served)[-8])))
            lost = any_copy & ~np.any([offered[n] for n in keep], axis=0) & lack
            if not lost.any():
                copies, offered, offsets = [copies[n] for n in keep], [offered[n] for n in keep], offsets[keep]
                penalty, usual = None if penalty is None else penalty[keep], usual[keep]
    return Weights(share, np.argmin(cost, axis=0), least, offsets)


def _penalties(density: Floats | None, known: Flags, offsets: Doubles, window: tuple[slice, slice]) -> Floats | None:
    """Return (N, H, W) >= 1: by how much a copy's cost rises for being seen less finely than its place."""
    if density is None:
        return None
    fine = np.log(np.maximum(density, 1e-3)).astype(np.float32)[..., None]
    here = fine[window][..., 0]
    lacks = [np.maximum(here - shifted(fine, known, o, window, cubic=False)[0][..., 0], 0) for o in offsets]
    return np.asarray(1 + COARSE_PENALTY * np.stack(lacks) ** 2, np.float32)


def _first_guess(tone: Floats, known: Flags, copies: list[Floats], offered: list[Flags]) -> Floats:
    count = np.sum(offered, axis=0, dtype=np.float32)
    shown = (np.where(some[..., None], copy, 0) for copy, some in zip(copies, offered, strict=True))
    total = sum(shown, np.zeros_like(tone))
    mean = total / np.maximum(count, 1)[..., None]
    flat = tone[known].mean(axis=0) if known.any() else np.zeros(tone.shape[2], np.float32)
    any_copy = np.asarray(count > 0)[..., None]
    return np.asarray(np.where(known[..., None], tone, np.where(any_copy, mean, flat)), np.float32)


def _usual_costs(tone: Floats, known: Flags, offsets: Doubles) -> Floats:
    """Return (N,): each shift's mean squared difference over all pixels that are known here and there.

    Rows of panes or tiles may differ more than the panes of one row: copies from along the row are then the better
    ones in the middle of a hole too, where nothing known is near enough to compare."""
    step = max(1, round(math.sqrt(known.size / USUAL_PX)))
    small, seen = np.ascontiguousarray(tone[::step, ::step]), np.ascontiguousarray(known[::step, ::step])
    whole = (slice(0, seen.shape[0]), slice(0, seen.shape[1]))
    found = np.full(len(offsets), np.nan, np.float32)
    for index, offset in enumerate(offsets):
        copy, some = shifted(small, seen, offset / step, whole, cubic=False)
        both = seen & some
        if both.sum() >= LEAST_COMPARED:
            off = copy[both] - small[both]
            found[index] = np.einsum("nc,nc->n", off, off).mean()
    worst = float(np.nanmax(found)) if np.isfinite(found).any() else 0.0
    return np.where(np.isfinite(found), found, np.float32(worst)).astype(np.float32)


def _costs(
    guess: Floats, known: Flags, hole: Flags, copies: list[Floats], offered: list[Flags], size: int, usual: Floats
) -> Floats:
    """Return (N, H, W): the mean squared difference between each copy and the guess in a box; inf where not offered.

    What it ``usual``ly is (N,) counts as so many pixels more."""
    prior = np.float32(USUAL_SHARE * size**2)
    trust = np.where(known, 1.0, np.where(hole, GUESS_WEIGHT, 0.0)).astype(np.float32)
    cost = np.empty((len(copies), *known.shape), np.float32)
    for index, (copy, some) in enumerate(zip(copies, offered, strict=True)):
        weight = trust * some
        off = copy - guess
        error = np.einsum("hwc,hwc->hw", off, off) * weight
        total = cv2.boxFilter(error, -1, (size, size), normalize=False, borderType=cv2.BORDER_CONSTANT)
        count = cv2.boxFilter(weight, -1, (size, size), normalize=False, borderType=cv2.BORDER_CONSTANT)
        cost[index] = np.where(some, (total + prior * usual[index]) / np.maximum(count + prior, 1e-6), np.inf)
    return cost


def _shares(cost: Floats) -> tuple[Floats, Floats]:
    """Return each copy's share by how far its cost lies above the least one, and the least cost."""
    least = cost.min(axis=0)
    least = np.where(np.isfinite(least), least, np.float32(1e6))
    scale = np.maximum(least, 1e-5) + 1e-6
    share = np.exp(-np.minimum((np.minimum(cost, np.float32(2e6)) - least) / scale, 60))
    share[~np.isfinite(cost)] = 0
    return np.asarray(share / np.maximum(share.sum(axis=0), 1e-12), np.float32), np.asarray(least, np.float32)


def _mean(copies: list[Floats], share: Floats) -> Floats:
    return sum((copy * one[..., None] for copy, one in zip(copies, share, strict=True)), np.zeros_like(copies[0]))


# The filled hole at full size: the copies' weighted mean, with the fine detail of the best one, met to the rim.

MIN_SHARE = 0.01  # chosen, never swept
DETAIL_PX, LIVELY = 2.0, 0.45  # how fine detail is, and how much of it is the best copy's alone
LARGEST_STEP = 0.3  # tone by which the rim may pull a filling


def blend(
    tone: Floats, known: Flags, weights: Weights, window: tuple[slice, slice], scale: float
) -> tuple[Floats, Flags]:
    """Return the window's copies blended (H, W, C), and where any copy offers something.

    ``weights`` are those of a picture ``scale`` (<= 1) times as large. The best copy's seams are feathered.
    """
    # Cubic interpolation takes two pixels all round.
    inner = cv2.erode(known.astype(np.uint8), np.ones((5, 5), np.uint8), borderType=cv2.BORDER_REPLICATE).astype(bool)
    rows, columns = window
    size = (columns.stop - columns.start, rows.stop - rows.start)
    mean = np.zeros((size[1], size[0], tone.shape[2]), np.float32)
    sharp = np.zeros_like(mean)
    total, sharp_total = np.zeros(mean.shape[:2], np.float32), np.zeros(mean.shape[:2], np.float32)
    for index, offset in enumerate(weights.offsets):
        chosen = (weights.best == index).astype(np.float32)
        share = _enlarged(weights.share[index], size)
        hard = cv2.GaussianBlur(_enlarged(chosen, size), (0, 0), 1.0)
        given = (share > MIN_SHARE) | (hard > MIN_SHARE)
        if not given.any():
            continue
        part = window_around(given)
        down, across = (slice(s.start + p.start, s.start + p.stop) for s, p in zip(window, part, strict=True))
        copy, some = shifted(tone, inner, offset / scale, (down, across), cubic=True)
        for weight, into, whole in ((share, mean, total), (hard, sharp, sharp_total)):
            own = weight[part] * some
            into[part] += copy * own[..., None]
            whole[part] += own
    offered = total > 1e-3
    mean /= np.maximum(total, 1e-6)[..., None]
    sharp = np.where((sharp_total > 1e-3)[..., None], sharp / np.maximum(sharp_total, 1e-6)[..., None], mean)
    # Where nothing is offered there is no change either: its blur would reach over.
    change = np.where(offered[..., None], sharp - mean, 0).astype(np.float32)
    detail = change - blurred(change, DETAIL_PX)
    return np.asarray(mean + np.float32(LIVELY) * detail, np.float32), offered


def _enlarged(small: Floats, size: tuple[int, int]) -> Floats:
    if small.shape == (size[1], size[0]):
        return small
    return np.asarray(cv2.resize(small, size, interpolation=cv2.INTER_LINEAR), np.float32)


def window_around(flags: Flags, margin_px: int = 0) -> tuple[slice, slice]:
    """Return the rows and columns of the bounding box of what is set in (H, W), and a margin; something must be."""
    ends = [np.flatnonzero(flags.any(axis=axis))[[0, -1]].tolist() for axis in (1, 0)]
    rows, columns = (
        slice(max(0, a - margin_px), min(n, b + margin_px + 1)) for (a, b), n in zip(ends, flags.shape, strict=True)
    )
    return rows, columns


def met_to_rim(filled: Floats, offered: Flags, tone: Floats, known: Flags, hole: Flags, rim_px: float) -> Floats:
    """Return the filling (H, W, C) moved by a membrane so that it meets the tones around the hole without a step."""
    width = max(1, round(rim_px))
    ring = cv2.dilate(hole.astype(np.uint8), np.ones((2 * width + 1,) * 2, np.uint8)).astype(bool) & known & offered
    if not ring.any():
        return filled
    weight = ring.astype(np.float32)
    sigma = max(rim_px / 2, 0.5)
    share = blurred(weight, sigma)
    step = blurred(np.where(ring[..., None], tone - filled, 0).astype(np.float32), sigma)
    bounded = np.clip(step / np.maximum(share, 1e-6)[..., None], -LARGEST_STEP, LARGEST_STEP).astype(np.float32)
    return np.asarray(filled + spread(bounded, ring & (share > 1e-3)), np.float32)
