"""Boards: where all grain runs one way, a hole is filled with pieces of what is seen, board beside board.

Copies of any outline cut boards lengthwise and across; a floor of them is a patchwork. So the texture is turned until
its grain runs along the rows and divided into boards where edges run all along. Each board goes on with long pieces
of boards that are seen, in its whole width, so that every seam lies where two boards meet. A piece is chosen for how
it agrees with what is seen or laid at its ends and beside it, and from elsewhere than its neighbours.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise

import cv2
import numpy as np
from scipy.ndimage import gaussian_filter1d

from processing.ground.arrays import Doubles, Flags, Floats
from processing.removal.illumination import grey, known_mean

WIDTHS, USUAL_WIDTH = (0.0115, 0.065), 0.028
"""Of the texture's size: widths of boards that are sought, and taken where none shows (chosen: 12 cm in 4 m)."""
FEW = 2  # pieces, under which boards are taken to be of the usual width (chosen)
LEAST_PERIOD = 0.25  # self-correlation of edges from which they have a period (chosen)
DARKENING = 0.7  # of a change's weight where the next row is darker (chosen)
LOOSE = 0.3  # of its width, by which a board may be wider or narrower
LONG_RUN, SHORT_RUN = 8.0, 1.5  # widths: along which edges are averaged; the shortest piece
ODD = 4.0  # robust deviations of tone or colour from which a place is glare, a stain or a thing, and not laid again
LEAST_RUNS, MOST_TIMES, MEAN_LONG, MARK = 6, 30, 3.0, 1.5
"""Pieces, of which short ones are taken too; times that all pieces are laid, from which marks on them are no longer;
widths that a texel's piece is long in the mean, below which neither are: a floor of bricks; median deviations, which is
a mark (chosen; of six real floors of boards one has 2.3, the others 4.1 and more)."""
MOST_PROFILE = 0.1  # tone across a board without marks, so that no floor has the stripes of its one piece (chosen)
WHOLE = 0.97  # of a board's width that must be seen (chosen)
SHADE, SEVERAL = 0.15, 3.0  # widths along and across boards in whose mean several of them change alike (chosen)
JOINT = 0.02  # cost from which a piece begins at a joint, and is not faded in (chosen)
LIVELIEST = 3.0  # times the usual piece's mean square, beyond which a piece is no better (chosen)
TRIES = 14  # times three pieces tried for each place, one of them of its own board
MOST_OFF = 0.15  # tone by which a piece is made brighter or darker to meet what it touches
AGAIN = 0.01  # cost of lying near its like (chosen)
NEAR_BOARDS, NEAR_WIDTHS = 4, 9.0  # boards and widths along them within which the same piece is seen to repeat


@dataclass
class _Floor:
    """A texture turned until boards run along its rows."""

    tone: Floats
    """(H, W, 3): as seen, and as laid."""
    done: Flags
    """(H, W): seen or laid."""
    source: Floats
    """(H, W, 3): what is laid: as seen, without what changes beside each other on several boards."""
    agreed: Floats
    """(H, W), 0..1: how well what is laid agrees with what it touches."""
    boards: list[tuple[int, int]]
    """First row of each board, and the row after the last."""
    width: float
    pieces: list[tuple[int, int, int]]
    """Board, first column and the column after the last of each run of `fit` in a board's whole width."""
    lively: float
    """Mean square of the source's tones in pieces."""
    laid: list[tuple[int, int, int, int]]
    """Board and column, source's board and column, of all that is laid."""
    even: bool = False
    """Whether pieces are even along: then one piece goes on along its board."""


def lay_boards(flat: Floats, known: Flags, hole: Flags, direction: Doubles) -> tuple[Floats, Floats, Flags]:
    """Return tones (H, W, 3) with boards in the ``hole`` (H, W), 0..1 how well they agree, and what is left (H, W).

    ``flat`` (H, W, 3): tones without light, 0 where not ``known`` (H, W);
    ``direction`` (2,): unit, (dx, dy) along the grain.
    """
    move, size = _turned(direction, hole.shape)
    turn, back = partial(cv2.warpAffine, M=move, dsize=size), partial(cv2.warpAffine, M=move, dsize=hole.shape[::-1])
    seen = np.asarray(turn(known.astype(np.float32)) > 0.999)
    lack = (turn(hole.astype(np.float32)) > 0) & ~seen
    tone = np.where(seen[..., None], turn(flat, flags=cv2.INTER_LANCZOS4), 0).astype(np.float32)
    size_px, sure = max(hole.shape), known.astype(np.float32)
    if not seen.any():
        return flat, sure, hole
    floor = _floor(tone, seen, size_px, WIDTHS)
    if len(floor.pieces) < FEW:
        floor = _floor(tone, seen, size_px, (USUAL_WIDTH, USUAL_WIDTH))
    if not floor.pieces:
        return flat, sure, hole
    long = np.array([last - first for _, first, last in floor.pieces]) / floor.width
    if lack.sum() > MOST_TIMES * long.sum() * floor.width**2 or (long**2).sum() < MEAN_LONG * long.sum():
        _without_marks(floor)
    rng = np.random.default_rng(5)
    for board, (top, end) in enumerate(floor.boards):
        for gap in _runs(np.asarray(lack[top:end].any(axis=0))):
            _lay(floor, board, gap, lack, rng)
    linear, sharp = (each | cv2.WARP_INVERSE_MAP for each in (cv2.INTER_LINEAR, cv2.INTER_LANCZOS4))
    offered = hole & (back(floor.done.astype(np.float32), flags=linear) > 0.5)
    sure[offered] = back(floor.agreed, flags=linear)[offered]
    laid = back(floor.tone, flags=sharp)
    return np.where(offered[..., None], laid, flat).astype(np.float32), sure, hole & ~offered


def _floor(tone: Floats, seen: Flags, size: int, widths: tuple[float, float]) -> _Floor:
    """Return what a turned texture (H, W, 3) has of boards; the longest pieces, so that a floor has few joints."""
    boards, width = _boards(grey(tone), seen, size, widths)
    whole = _usual(tone, seen, width)
    found = [
        (board, *run)
        for board, (top, end) in enumerate(boards)
        for run in _runs(np.asarray(whole[top:end].mean(axis=0) > WHOLE))
    ]
    found = sorted(found, key=lambda piece: piece[1] - piece[2])
    least = [(SHORT_RUN if n < LEAST_RUNS else LONG_RUN) * width for n in range(len(found))]
    pieces = [piece for piece, long in zip(found, least, strict=True) if piece[2] - piece[1] >= long]
    # What changes on several boards at the same place is light or shade; what one board has is its own.
    blur = partial(cv2.GaussianBlur, ksize=(0, 0), sigmaX=SHADE * width, sigmaY=SEVERAL * width)
    shade = blur(tone) / np.maximum(blur(seen.astype(np.float32)), 1e-3)[..., None]
    source = np.asarray(tone - shade, np.float32)
    parts = (source[slice(*boards[board]), first:last] for board, first, last in pieces)
    lively = float(np.mean([np.square(part - part.mean(axis=(0, 1))).mean() for part in parts])) if pieces else 1.0
    return _Floor(tone, seen, source, np.zeros(seen.shape, np.float32), boards, width, pieces, max(lively, 1e-9), [])


def _turned(direction: Doubles, shape: tuple[int, ...]) -> tuple[Doubles, tuple[int, int]]:
    """Return the affine map (2, 3) that turns a texture's ``direction`` along its rows, and the size (W, H) then."""
    (cosine, sine), (height, width) = direction, shape
    turn = np.array([[cosine, sine], [-sine, cosine]], np.float64)
    corners = np.array([[0, 0], [width, 0], [0, height], [width, height]]) @ turn.T
    low, high = corners.min(axis=0), corners.max(axis=0)
    wide, tall = np.ceil(high - low).astype(int)
    return np.column_stack([turn, -low]), (int(wide), int(tall))


def _boards(tone: Floats, seen: Flags, size: int, widths: tuple[float, float]) -> tuple[list[tuple[int, int]], float]:
    """Return the rows of boards, and how wide they mostly are: cut where tones (H, W) change all along the rows."""
    usual = max(USUAL_WIDTH * size, 4.0)
    weight, along = seen.astype(np.float32), (round(LONG_RUN / 3 * usual) | 1, 1)
    share = cv2.blur(weight, along)
    mean = cv2.blur(tone * weight, along) / np.maximum(share, 1e-6)
    both = (np.minimum(share[1:], share[:-1]) > 0.5) & seen[1:] & seen[:-1]
    count = np.append(both.sum(axis=1), 0)
    change = np.diff(mean, axis=0)
    # Of a dark gap between boards, always the same side: else it is laid twice here and is missing there.
    change = np.sqrt(np.abs(change)) * np.where(change > 0, 1, DARKENING)
    step = np.append((change * both).sum(axis=1), 0) / np.maximum(count, 1)
    step, given = gaussian_filter1d(step, 1.0), count > usual
    level = gaussian_filter1d(np.where(given, step, 0), usual) / np.maximum(gaussian_filter1d(given * 1.0, usual), 1e-3)
    edge = np.where(given, np.clip(step / np.maximum(level, 1e-6) - 1, -1, 3), 0)
    lags = np.arange(max(5, int(widths[0] * size)), max(8, int(widths[1] * size)))
    usable = lags[lags < len(edge) // 2]
    cut, power = np.minimum(edge, 2), max(float((np.minimum(edge, 2)[given] ** 2).mean()), 1e-6) if given.any() else 1.0
    alike = np.array([(cut[n:] * cut[:-n]).sum() / max((given[n:] & given[:-n]).sum(), 20) for n in usable]) / power
    peak = np.flatnonzero((alike[1:-1] >= alike[:-2]) & (alike[1:-1] > alike[2:]) & (alike[1:-1] > LEAST_PERIOD)) + 1
    width = float(usable[peak[np.argmax(alike[peak] > 0.8 * alike[peak].max())]]) if len(peak) else usual
    cuts = _cuts(edge, width)
    return list(pairwise(cuts)), width


def _cuts(edge: Doubles, width: float) -> list[int]:
    """Return the rows between boards, from first to last, that lie on edges and about a ``width`` apart (best path)."""
    steps = np.arange(max(3, int((1 - LOOSE) * width)), int(np.ceil((1 + LOOSE) * width)) + 1)
    price = 10 * (steps / width - 1) ** 2
    gain = np.append(edge, 0.0)
    best, before = gain.copy(), np.full(len(gain), -1)
    for row in range(int(steps[0]), len(gain)):
        from_rows = row - steps[steps <= row]
        value = best[from_rows] - price[: len(from_rows)]
        if row > steps[-1] or value.max() > 0:
            before[row], best[row] = from_rows[value.argmax()], value.max() + gain[row]
    row = int(len(gain) - 1 - steps[-1] + best[-1 - steps[-1] :].argmax()) if len(gain) > steps[-1] else 0
    cuts = [row]
    while before[row] >= 0:
        row = int(before[row])
        cuts.append(row)
    return sorted({0, *cuts, len(edge)})


def _usual(tone: Floats, seen: Flags, width: float) -> Flags:
    """Return where what is ``seen`` (H, W) is no glare, stain or thing, without the rim of the seen and of those."""
    mean, odd = known_mean(tone, seen, width / 8)[0], np.zeros_like(seen)
    level = grey(mean)
    colour = mean - level[..., None]
    for off in (np.abs(level - np.median(level[seen])), np.abs(colour - np.median(colour[seen], axis=0)).max(axis=-1)):
        odd |= seen & (off > ODD * 1.4826 * float(np.median(off[seen])))
    rim = np.ones((1, 2 * round(width / 4) + 1), np.uint8)
    return np.asarray(cv2.erode((seen & ~odd).astype(np.uint8), rim) > 0)


def _runs(flags: Flags) -> list[tuple[int, int]]:
    """Return the first index, and the one after the last, of each run of set ``flags`` (N,)."""
    ends = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]])))
    return list(zip(ends[::2].tolist(), ends[1::2].tolist(), strict=True))


def _lay(floor: _Floor, board: int, gap: tuple[int, int], lack: Flags, rng: np.random.Generator) -> None:
    """Lay pieces, in place, into the columns of a ``gap`` of a board, where the floor does ``lack`` them (H, W), and
    set how well they agree."""
    (top, end), (place, last) = floor.boards[board], gap
    every = range(len(floor.pieces))
    own = [number for number in every if floor.pieces[number][0] == board]
    while place < last:
        tried = [
            _tried(floor, board, (place, last - place), among, rng) for among in (every, own or every, every) * TRIES
        ]
        cost, source, start, long = min(tried)
        lap = min(round(floor.width / 2) if cost < JOINT else 1, start - floor.pieces[source][1], place)
        whole = slice(place - lap, place + long)
        piece = _piece(floor, source, start - lap, long + lap, end - top)
        part = np.s_[top:end, whole]
        off, _ = _offsets(floor.tone[part] - piece, floor.done[part], floor.width)
        into = lack[part]
        # It fades in over what is laid already; what is seen stays.
        much = np.where(
            floor.done[part], np.linspace(0, 1, long + lap, dtype=np.float32) * (long + lap) / max(lap, 1), 1
        )
        mixed = floor.tone[part] + np.clip(much, 0, 1)[..., None] * (piece + off - floor.tone[part])
        floor.tone[part][into], floor.agreed[part][into] = mixed[into], np.exp(-1.5 * np.sqrt(cost))
        floor.done[part] |= into
        floor.laid.append((board, place, floor.pieces[source][0], start))
        place += long


def _without_marks(floor: _Floor) -> None:
    """Leave but grain along each piece, in place: knots and shade of a few pieces would be seen again and again."""
    for board, first, last in floor.pieces:
        piece = floor.source[slice(*floor.boards[board]), first:last]
        even, mean = np.median(piece, axis=1, keepdims=True), piece.mean(axis=(0, 1))
        even = mean + np.clip(even - mean, -MOST_PROFILE, MOST_PROFILE)
        grain = piece - cv2.blur(piece, (2 * round(floor.width / 4) + 1, 1))
        most = MARK * np.median(np.abs(grain))
        piece[:] = even + np.clip(grain, -most, most)
    floor.even = True


def _piece(floor: _Floor, source: int, start: int, long: int, tall: int) -> Floats:
    """Return (tall, long, 3): a part of a seen board, in another's width."""
    top, end = floor.boards[floor.pieces[source][0]]
    piece = floor.source[top:end, start : start + long]
    return piece if end - top == tall else np.asarray(cv2.resize(piece, (long, tall), interpolation=cv2.INTER_LANCZOS4))


def _offsets(off: Floats, fit: Flags, width: float) -> tuple[Floats, float]:
    """Return what brings a piece (h, w, 3), which is ``off`` where that is known (h, w), near what it touches, (w, 3),
    and the mean square of what it is off by then; 0 where nothing is known."""
    count = fit.sum(axis=0)
    if not count.any():
        return np.zeros(off.shape[1:], np.float32), 0.0
    total = np.where(fit[..., None], off, 0).sum(axis=0)
    share = gaussian_filter1d(count.astype(np.float64), 1.5 * width)[:, None] + 0.05 * len(off)
    found = np.clip(gaussian_filter1d(total, 1.5 * width, axis=0) / share, -MOST_OFF, MOST_OFF).astype(np.float32)
    rest = float(((off - found)[fit] ** 2).mean())
    return found, 3 * rest + float((found**2).mean())


def _tried(
    floor: _Floor, board: int, where: tuple[int, int], among: Sequence[int], rng: np.random.Generator
) -> tuple[float, int, int, int]:
    """Return a piece at random for a place with so many columns left: cost, source (``among`` these), its first column
    and length."""
    (place, left), source = where, among[int(rng.integers(len(among)))]
    other, first, last = floor.pieces[source]
    (top, end), whole = floor.boards[board], last - first
    long = min(left, round(rng.uniform(0.6, 1.0) * whole))
    long = min(left, whole) if left - long < SHORT_RUN * floor.width else long
    start = int(rng.integers(first, last - long + 1))
    rim = round(floor.width)
    before, after = min(rim, start - first, place), min(rim, last - start - long, floor.done.shape[1] - place - long)
    part = np.s_[top:end, place - before : place + long + after]
    piece = _piece(floor, source, start - before, before + long + after, end - top)
    # The calmest piece is the least unlike any place: a floor of such would be dull.
    lively = float(np.square(piece - piece.mean(axis=(0, 1))).mean()) / floor.lively
    cost = _offsets(floor.tone[part] - piece, floor.done[part], floor.width)[1] * 2 / (1 + min(lively, LIVELIEST))
    for a_board, at, from_board, column in floor.laid[-12 * NEAR_BOARDS :]:
        alike = from_board == other and abs(column - at - start + place) < 2 * rim
        near = board - a_board <= NEAR_BOARDS and abs(at - place) < NEAR_WIDTHS * floor.width
        again = from_board == other and a_board == board and abs(column - start) < NEAR_WIDTHS / 2 * floor.width
        cost += AGAIN * (((alike and near) or again) and not floor.even)
    if floor.even and floor.laid and floor.laid[-1][0] == board:
        cost += 10 * AGAIN * (floor.laid[-1][2] != other)
    narrower = (floor.boards[other][1] - floor.boards[other][0]) / (end - top)
    cost += 0.02 * abs(np.log(narrower)) + AGAIN / 5 * (left - long) / max(left, 1)
    return float(cost * rng.uniform(0.8, 1.2)), source, start, long
