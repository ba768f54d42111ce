"""What a filled hole is judged by: PSNR, SSIM, gradient energy, and how alike its texture is whatever its place."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np

from processing.ground.arrays import Bytes, Doubles, Flags

SCALES = 4
DIRECTIONS = 4
AROUND_PX = 12.0
FAINT = 1.0
"""Of 255, squared: energy that nobody sees."""


class Scores(NamedTuple):
    """Of one filled hole; ``seconds`` are CPU seconds, a child's included."""

    psnr_db: float
    ssim: float
    gradient: float
    """Gradient energy over the true one."""
    texture: float
    """Texture distance, see `texture_distance`; 0 is alike."""
    seconds: float


def scored(found: Bytes, truth: Bytes, hole: Flags, seconds: float) -> Scores:
    """Return the scores of a filled 8-bit picture (h, w, 3) in its hole."""
    from skimage.metrics import structural_similarity

    off = (found.astype(np.float64) - truth)[hole]
    psnr = 10 * np.log10(255**2 / max(float(np.mean(off**2)), 1e-9))
    similar = structural_similarity(found, truth, channel_axis=2, full=True)[1].mean(axis=2)[hole].mean()
    ratio = _energy(found, hole) / max(_energy(truth, hole), 1e-9)
    return Scores(float(psnr), float(similar), ratio, texture_distance(found, truth, hole), seconds)


def texture_distance(found: Bytes, truth: Bytes, hole: Flags) -> float:
    """Return the mean difference of texture energy, in natural logarithms, over scales and directions.

    Each of `SCALES` octaves of a pyramid is differentiated in `DIRECTIONS` directions; energies are means over
    `AROUND_PX` pixels, so that where exactly a board's joint lies does not matter, but how rough the place is, how
    coarse, and which way it runs. A blur of everything finer than some pixels is some 2 to 4 off.
    """
    pictures = [_grey(found), _grey(truth)]
    where, total, weights = hole.astype(np.float64), 0.0, 0.0
    for _ in range(SCALES):
        if min(where.shape) < 8 or where.sum() < 1:
            break
        pair = [_energies(one, where) for one in pictures]
        off = np.abs(np.log(pair[0] + FAINT) - np.log(pair[1] + FAINT)).mean(axis=-1)
        total, weights = total + float((off * where).sum() / where.sum()), weights + 1
        pictures = [cv2.pyrDown(one) for one in pictures]
        where = cv2.resize(where, pictures[0].shape[::-1], interpolation=cv2.INTER_AREA)
        where = np.where(where > 0.5, 1.0, 0.0)
    return total / max(weights, 1.0)


def _energies(grey: Doubles, where: Doubles) -> Doubles:
    """Return (h, w, directions): mean squared derivative in each direction around, of the hole's own pixels."""
    dx, dy = (cv2.Sobel(grey, cv2.CV_64F, *order, scale=1 / 8) for order in ((1, 0), (0, 1)))
    share = np.maximum(cv2.GaussianBlur(where, (0, 0), AROUND_PX), 1e-6)
    out = []
    for step in range(DIRECTIONS):
        angle = np.pi * step / DIRECTIONS
        along = (np.cos(angle) * dx + np.sin(angle) * dy) ** 2
        out.append(cv2.GaussianBlur(along * where, (0, 0), AROUND_PX) / share)
    return np.stack(out, axis=-1)


def _grey(picture: Bytes) -> Doubles:
    return cv2.cvtColor(np.ascontiguousarray(picture), cv2.COLOR_BGR2GRAY).astype(np.float64)


def _energy(picture: Bytes, hole: Flags) -> float:
    grey = _grey(picture)
    steps = np.diff(grey, axis=0)[:, :-1] ** 2 + np.diff(grey, axis=1)[:-1] ** 2
    return float(steps[hole[:-1, :-1]].mean())
