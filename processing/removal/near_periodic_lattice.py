"""The lattice of a near-periodic texture: two shifts that bring it onto itself, found from its self-correlation."""

import math
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt
from scipy import fft

from processing.ground.arrays import Doubles, Flags, Floats
from processing.removal.illumination import known_mean

# How well a texture fits itself when shifted: normalised cross-correlation of the known pixels, by FFT.
#
# The masked form of Padfield (2012): each shift's means and variances are those of the pixels known in both.

MIN_OVERLAP = 0.12  # of the known pixels that a shift must bring onto known ones
LATTICE_NCC = 0.52
"""Mean NCC at the eight nearest nodes from which there is a lattice: true patterns have 0.59 to 0.96, carpet and
laminate 0.05 to 0.14 (measured), a real carpet with patches of sun 0.45."""
PEAK_NCC = 0.13  # at a node from which its place counts when the lattice is refined
LEAST_PX = 4.0  # of a step; chosen
CANDIDATES = 48  # peaks that pairs are made of; chosen, never swept
LONGEST = 0.45  # of a step against the texture's size: a pattern must be seen to repeat
ORIENTED_NCC = 0.52
"""The same, of which way the grain runs: herringbone has 0.71 to 0.75, planks, laminate and carpet none (measured)."""
NODE_REACH = 5  # nodes of the lattice each way; chosen, never swept


@dataclass(frozen=True)
class SelfCorrelation:
    """NCC by shift; ``ncc[cy + dy, cx + dx]`` is that of (dx, dy), NaN where too little overlaps."""

    ncc: Doubles
    centre: tuple[int, int]
    """(cy, cx)."""

    def at(self, shifts: npt.ArrayLike) -> Doubles:
        """Return the NCC, bilinear, at shifts of shape (..., 2), as (dx, dy) in pixels; NaN outside."""
        s = np.asarray(shifts, np.float64)
        x, y = s[..., 0] + self.centre[1], s[..., 1] + self.centre[0]
        height, width = self.ncc.shape
        inside = (x >= 0) & (y >= 0) & (x <= width - 1.001) & (y <= height - 1.001)
        x, y = np.where(inside, x, 0), np.where(inside, y, 0)
        i, j = y.astype(np.intp), x.astype(np.intp)
        fy, fx = y - i, x - j
        n = self.ncc
        top = n[i, j] * (1 - fx) + n[i, j + 1] * fx
        low = n[i + 1, j] * (1 - fx) + n[i + 1, j + 1] * fx
        return np.asarray(np.where(inside, top * (1 - fy) + low * fy, np.nan))


def high_passed(tone: Floats, known: Flags, sigma_px: float) -> Floats:
    """Return (H, W): the tone less its weighted local mean; 0 where unknown."""
    return np.where(known, tone - known_mean(tone, known, sigma_px)[0], 0).astype(np.float32)


def oriented(tone: Floats, known: Flags, sigma_px: float) -> tuple[Floats, Flags]:
    """Return (H, W, 2) which way edges and grain run (cosine and sine of twice the angle), and where that is known.

    Blocks laid crosswise repeat in it where their tones do not: herringbone.
    """
    inner = cv2.erode(known.astype(np.uint8), np.ones((3, 3), np.uint8), borderType=cv2.BORDER_REPLICATE).astype(bool)
    smooth = cv2.GaussianBlur(tone, (0, 0), 0.7)
    gx = np.where(inner, cv2.Sobel(smooth, cv2.CV_32F, 1, 0), 0)
    gy = np.where(inner, cv2.Sobel(smooth, cv2.CV_32F, 0, 1), 0)
    # The root keeps a few strong edges from outweighing all grain.
    size = np.sqrt(np.hypot(gx, gy)) + 1e-12
    parts = np.stack([gx * gx - gy * gy, 2 * gx * gy], axis=-1) / (size**3)[..., None]
    strength = cv2.GaussianBlur(np.where(inner, size, 0).astype(np.float32), (0, 0), sigma_px)
    field = cv2.GaussianBlur(parts.astype(np.float32), (0, 0), sigma_px) / np.maximum(strength, 1e-9)[..., None]
    return np.asarray(np.where(inner[..., None], field, 0), np.float32), inner


def self_correlation(picture: Floats, known: Flags) -> SelfCorrelation:
    """Return the masked NCC of a picture (H, W) or (H, W, C) with itself for all shifts up to 3/4 of its size."""
    height, width = picture.shape[:2]
    size = [fft.next_fast_len(2 * n - 1, real=True) for n in (height, width)]
    fm = fft.rfft2(known.astype(np.float64), s=size)
    count = _back(np.conj(fm) * fm, size)
    n = np.maximum(count, 1)
    covariance, here, there = (np.zeros(size) for _ in range(3))
    for channel in np.moveaxis(picture.reshape(height, width, -1), -1, 0):
        value = np.where(known, channel, 0).astype(np.float64)
        fv, fs = fft.rfft2(value, s=size), fft.rfft2(value * value, s=size)
        sum_here, sum_there = _back(np.conj(fv) * fm, size), _back(np.conj(fm) * fv, size)
        covariance += _back(np.conj(fv) * fv, size) - sum_here * sum_there / n
        here += _back(np.conj(fs) * fm, size) - sum_here**2 / n
        there += _back(np.conj(fm) * fs, size) - sum_there**2 / n
    scale = np.sqrt(np.maximum(here, 0) * np.maximum(there, 0))
    usable = (count > MIN_OVERLAP * max(int(known.sum()), 1)) & (scale > 1e-9 * max(float(here.max()), 1e-12))
    ncc = np.where(usable, covariance / np.where(usable, scale, 1), np.nan)
    reach_y, reach_x = (3 * height) // 4, (3 * width) // 4
    rows, columns = np.arange(-reach_y, reach_y + 1), np.arange(-reach_x, reach_x + 1)
    return SelfCorrelation(np.clip(ncc[np.ix_(rows % size[0], columns % size[1])], -1, 1), (reach_y, reach_x))


def _back(spectrum: npt.NDArray[np.complex128], size: list[int]) -> Doubles:
    return np.asarray(fft.irfft2(spectrum, s=size))


@dataclass(frozen=True)
class Lattice:
    """Shifts (x, y) in pixels that bring the pattern onto itself."""

    a_px: Doubles
    b_px: Doubles
    strength: float
    """Mean NCC at the eight nodes nearest to zero."""

    @property
    def basis_px(self) -> Doubles:
        """Return both shifts, of shape (2, 2), one a row."""
        return np.stack([self.a_px, self.b_px])

    @property
    def cell_px(self) -> float:
        """Return the side of a square as large as a cell."""
        return float(np.sqrt(abs(np.linalg.det(self.basis_px))))

    def nodes(self, reach: int) -> Doubles:
        """Return (N, 2): all combinations of up to ``reach`` of both vectors but zero."""
        i, j = np.meshgrid(np.arange(-reach, reach + 1), np.arange(-reach, reach + 1), indexing="ij")
        keep = (i != 0) | (j != 0)
        return np.asarray(i[keep][:, None] * self.a_px + j[keep][:, None] * self.b_px)


def peaks(correlation: SelfCorrelation, *, least: float = 0.15, count: int = CANDIDATES) -> tuple[Doubles, Doubles]:
    """Return shifts (N, 2) of local maxima with dy > 0, or dy = 0 < dx, strongest first, and their NCC."""
    ncc = np.nan_to_num(correlation.ncc, nan=-1.0).astype(np.float32)
    reach = 7
    local = cv2.dilate(ncc, np.ones((reach, reach), np.uint8))
    cy, cx = correlation.centre
    y, x = np.nonzero((ncc >= local) & (ncc > least))
    dy, dx = y - cy, x - cx
    half = ((dy > 0) | ((dy == 0) & (dx > 0))) & (np.hypot(dx, dy) > LEAST_PX)
    dx, dy, y, x = dx[half], dy[half], y[half], x[half]
    value = ncc[y, x].astype(np.float64)
    # The least NCC on the way from zero to each shift: a true period climbs out of a valley.
    t = np.linspace(0.1, 0.9, 33)
    on_x = np.clip(np.rint(cx + dx[:, None] * t).astype(np.intp), 0, ncc.shape[1] - 1)
    on_y = np.clip(np.rint(cy + dy[:, None] * t).astype(np.intp), 0, ncc.shape[0] - 1)
    prominence = value - ncc[on_y, on_x].min(axis=1).astype(np.float64)
    order = np.argsort(-(value + 0.5 * prominence))[:count]
    return np.stack([dx, dy], axis=-1)[order].astype(np.float64), value[order]


def find_lattice(correlation: SelfCorrelation, least: float = LATTICE_NCC) -> Lattice | None:
    """Return the lattice whose nodes explain the correlation best, or None where the best is below ``least``."""
    shifts, values = peaks(correlation)
    if len(shifts) < 2:
        return None
    first, second = np.triu_indices(len(shifts), 1)
    a, b = shifts[first], shifts[second]
    cross = np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
    wide = cross > 0.2 * np.hypot(*a.T) * np.hypot(*b.T)
    limit = LONGEST * np.array([4 / 3 * correlation.centre[1], 4 / 3 * correlation.centre[0]])
    wide &= (np.abs(a) < limit).all(axis=1) & (np.abs(b) < limit).all(axis=1)
    a, b = a[wide], b[wide]
    if not len(a):
        return None
    for best in np.argsort(-_scores(correlation, a, b, 0.6 * float(values[0])))[:4]:
        lattice = _measured(correlation, *_refined(correlation, *reduced(a[best], b[best])))
        # Of two neighbouring pixels that are alike a basis may be refined to next to nothing.
        if lattice is not None and lattice.strength >= least and np.hypot(*lattice.basis_px.T).min() > LEAST_PX:
            return lattice
    return None


def _scores(correlation: SelfCorrelation, a: Doubles, b: Doubles, bar: float) -> Doubles:
    """Return, per pair, the NCC above ``bar`` summed over its nodes: sparse lattices have few, wrong ones have low."""
    grid = np.arange(-NODE_REACH, NODE_REACH + 1)
    i, j = (g.ravel() for g in np.meshgrid(grid, grid))
    half = (j > 0) | ((j == 0) & (i > 0))
    nodes = i[half][None, :, None] * a[:, None, :] + j[half][None, :, None] * b[:, None, :]
    ncc = correlation.at(nodes)
    # Far nodes are measured from fewer pixels, and drift off a basis that is rounded to whole pixels.
    distance = np.asarray(np.hypot(nodes[..., 0], nodes[..., 1]), np.float64)
    weight = 1.0 / (1.0 + distance / max(correlation.centre))
    return np.asarray(np.nansum((ncc - bar) * weight, axis=1))


def reduced(a: Doubles, b: Doubles) -> tuple[Doubles, Doubles]:
    """Return the shortest basis of the same lattice (Gauss reduction)."""
    a, b = np.asarray(a, np.float64), np.asarray(b, np.float64)
    for _ in range(64):
        if a @ a > b @ b:
            a, b = b, a
        step = np.rint(float(a @ b) / max(float(a @ a), 1e-12))
        if step == 0:
            break
        b = b - step * a
    return a, b


def _refined(correlation: SelfCorrelation, a: Doubles, b: Doubles) -> tuple[Doubles, Doubles]:
    """Return the basis fitted by least squares to the peaks next to its nodes, from the nearest nodes outwards."""
    basis = np.stack([a, b])
    for reach in (1, 2, 3, 4):
        grid = np.arange(-reach, reach + 1)
        combos = np.stack([g.ravel() for g in np.meshgrid(grid, grid)], axis=-1)
        combos = combos[(combos[:, 1] > 0) | ((combos[:, 1] == 0) & (combos[:, 0] > 0))]
        found = [peak_near(correlation, combo @ basis) for combo in combos]
        ok = np.array([f is not None and f[1] > PEAK_NCC for f in found])
        if ok.sum() < 2 or np.linalg.matrix_rank(combos[ok]) < 2:
            continue
        places = np.array([f[0] for f, use in zip(found, ok, strict=True) if use and f is not None])
        weight = np.sqrt([f[1] for f, use in zip(found, ok, strict=True) if use and f is not None])[:, None]
        basis = np.linalg.lstsq(combos[ok] * weight, places * weight, rcond=None)[0]
    return basis[0], basis[1]


def peak_near(correlation: SelfCorrelation, shift: Doubles, radius: int = 3) -> tuple[Doubles, float] | None:
    """Return sub-pixel place and value of the greatest NCC near a shift, both of shape (2,); None where unknown."""
    x, y = (round(float(v)) for v in (shift[0] + correlation.centre[1], shift[1] + correlation.centre[0]))
    height, width = correlation.ncc.shape
    if not (radius < x < width - radius - 1 and radius < y < height - radius - 1):
        return None
    window = correlation.ncc[y - radius : y + radius + 1, x - radius : x + radius + 1]
    if not np.isfinite(window).all():
        return None
    i, j = (int(v) for v in np.unravel_index(int(np.argmax(window)), window.shape))
    n = correlation.ncc[y - radius + i - 1 : y - radius + i + 2, x - radius + j - 1 : x - radius + j + 2]
    if not np.isfinite(n).all():
        return None
    fine = np.array([_vertex(n[1, 0], n[1, 1], n[1, 2]), _vertex(n[0, 1], n[1, 1], n[2, 1])])
    place = np.array([x - radius + j - correlation.centre[1], y - radius + i - correlation.centre[0]]) + fine
    return place, float(n[1, 1])


def _vertex(left: float, middle: float, right: float) -> float:
    """Return where a parabola through three neighbours has its top, within half a step."""
    bend = left - 2 * middle + right
    return float(np.clip(0.5 * (left - right) / bend, -0.5, 0.5)) if bend < -1e-12 else 0.0


def _measured(correlation: SelfCorrelation, a: Doubles, b: Doubles) -> Lattice | None:
    a, b = reduced(a, b)
    values = [peak[1] for node in Lattice(a, b, 0.0).nodes(1) if (peak := peak_near(correlation, node, 2)) is not None]
    return None if len(values) < 4 else Lattice(a, b, float(np.mean(values)))


# Shifts from which a hole may be filled, and the direction of what repeats in none.

MOST = 64  # offsets that are tried
LINE_SHARE = 0.6  # of the grain that must run one way


@dataclass(frozen=True)
class Line:
    """A direction along which a texture resembles itself: that of planks."""

    direction: Doubles
    """(2,), unit."""
    strength: float
    """0..1: how much of the grain runs that way."""


def lattice_offsets(lattice: Lattice, shape: tuple[int, int]) -> Doubles:
    """Return the nodes (N, 2) within a texture's size, nearest first: what is near has like light and like wear."""
    height, width = shape
    shortest = max(np.linalg.norm(lattice.basis_px, axis=1).min(), 1.0)
    nodes = lattice.nodes(min(40, int(np.ceil(1.1 * np.hypot(height, width) / shortest))))
    nodes = nodes[(np.abs(nodes[:, 0]) < 0.9 * width) & (np.abs(nodes[:, 1]) < 0.9 * height)]
    nodes = nodes[np.argsort(np.hypot(*nodes.T))]
    if len(nodes) <= MOST:
        return np.asarray(nodes, np.float64)
    # Far nodes matter only for what near ones cannot reach: keep the near half, thin out the rest evenly.
    far = nodes[MOST // 2 :]
    return np.concatenate([nodes[: MOST // 2], far[np.linspace(0, len(far) - 1, MOST // 2).astype(np.intp)]])


def find_line(field: Floats, known: Flags) -> Line | None:
    """Return the direction of nearly all grain, or None; ``field`` (H, W, 2), ``known`` (H, W): see `oriented`."""
    if not known.any():
        return None
    # Edges lie across the gradient, hence the sign.
    cosine, sine = (-field[known]).mean(axis=0)
    strength = float(np.hypot(cosine, sine)) / max(float(np.hypot(*field[known].T).mean()), 1e-9)
    if strength < LINE_SHARE:
        return None
    half = 0.5 * np.arctan2(sine, cosine)
    return Line(np.array([np.cos(half), np.sin(half)]), strength)


# Joints between boards are finer than the grain that a small picture shows, and few: soft light, blur and a strip of
# the next room's boards outweigh them. But an edge that is averaged along itself stays, and nothing else does.

EDGE_PX, RUN, RUN_KNOWN = (400, 800), 0.12, 0.85
"""Of the longer side of the pictures on which directions are searched, then judged; of that side, along which edges are
averaged; of such a run, that must be known (chosen)."""
TURN_RAD, APART_RAD, FURTHER = math.radians(3), math.radians(15), 4
"""Between directions; how far from the best another one is no longer the same; every how many of the search are judged
against it (chosen)."""
STRIPS, FEW_PX = 5, 400  # across a direction, in the middle one of which edges must stay: a cable is one edge (chosen)
LEAST_STAYS, LEAST_AHEAD = 0.3, 3.8
"""Share of edges' energy that stays along boards, and times that of any other direction: boards in seven real rooms
have 0.4 and 5.5 at least, carpets and large tiles in five 2.6 times at most; generated floors are farther apart."""


def find_joints(tone: Floats, known: Flags) -> Line | None:
    """Return the direction of joints between boards in tones (H, W), where ``known`` (H, W); None where there are none.

    That is the one along which averaged edges keep most of their energy, if no other one keeps nearly as much."""
    turns, pictures = np.arange(0, math.pi, TURN_RAD), [_edges(tone, known, size) for size in EDGE_PX]
    coarse = np.array([_staying(*pictures[0], turn) for turn in turns])
    near = turns[coarse.argmax()] + TURN_RAD * np.arange(-1, 2) / 2
    fine = [_staying(*pictures[1], turn) for turn in near]
    best, most = float(near[int(np.argmax(fine))]), max(fine)
    if most < LEAST_STAYS:
        return None
    apart = np.abs((turns - best + math.pi / 2) % math.pi - math.pi / 2) > APART_RAD
    others = {*turns[apart][::FURTHER].tolist(), float(turns[apart][coarse[apart].argmax()])}
    if most < LEAST_AHEAD * max(_staying(*pictures[1], turn) for turn in others):
        return None
    return Line(np.array([math.cos(best), math.sin(best)]), min(most, 1.0))


def _edges(tone: Floats, known: Flags, longest_px: int) -> tuple[Floats, int]:
    """Return the gradient of tones (H, W) at a working size, none too strong, and 1 where it is known (h, w, 3), as far
    as it is; and how many pixels a run has."""
    factor = min(1.0, longest_px / max(tone.shape))
    size = tuple(max(8, round(n * factor)) for n in tone.shape[::-1])
    share = cv2.resize(known.astype(np.float32), size, interpolation=cv2.INTER_AREA)
    total, seen = cv2.resize(np.where(known, tone, 0), size, interpolation=cv2.INTER_AREA), share > 0.5
    mean = np.asarray(total / np.maximum(share, 1e-6), np.float32)
    small = cv2.GaussianBlur(high_passed(mean, seen, 6.0), (0, 0), 1.0)
    inner = cv2.erode(seen.astype(np.uint8), np.ones((7, 7), np.uint8)).astype(np.float32)
    edges = np.stack([cv2.Sobel(small, cv2.CV_32F, 1, 0), cv2.Sobel(small, cv2.CV_32F, 0, 1), inner], axis=-1)
    length = np.hypot(edges[..., 0], edges[..., 1])
    most = 4 * float(np.median(length[inner > 0])) if inner.any() else 0.0
    edges[..., :2] *= (inner * np.minimum(1, most / np.maximum(length, 1e-9)))[..., None]
    x, y, wide, high = cv2.boundingRect(inner.astype(np.uint8))
    return np.ascontiguousarray(edges[y : y + high, x : x + wide], np.float32), round(RUN * max(size)) | 1


def _staying(edges: Floats, run_px: int, turn: float) -> float:
    """Return the share of the energy of `_edges` that stays when they are averaged along a direction (rad)."""
    (height, width), cosine, sine = edges.shape[:2], math.cos(turn), math.sin(turn)
    if min(height, width) < 2:
        return 0.0
    size = math.ceil(math.hypot(height, width))
    move = cv2.getRotationMatrix2D((width / 2, height / 2), math.degrees(turn), 1.0)
    move[:, 2] += (size - width) / 2, (size - height) / 2
    x, y, share = cv2.split(cv2.warpAffine(edges, move, (size, size)))
    mean, run = (cv2.blur(one, (run_px, 1)) for one in (cosine * y - sine * x, share))
    fit = ((share > 0.5) & (run > RUN_KNOWN)).astype(np.float32)
    count = fit.sum(axis=1, dtype=np.float64)
    if count.sum() < FEW_PX:
        return 0.0
    strip = np.minimum(np.cumsum(count) * STRIPS / count.sum(), STRIPS - 1).astype(np.intp)
    averaged = mean / np.maximum(run, np.float32(RUN_KNOWN))
    stays, energy = (np.einsum("ij,ij,ij->i", fit, one, one, dtype=np.float64) for one in (averaged, np.hypot(x, y)))
    kept, had = (np.bincount(strip, one, STRIPS) for one in (stays, energy / 2))
    return float(np.median(kept / np.maximum(had, 1e-12)))
