"""Which stops a picture needs, found while decoding: from the middle outwards, ending where nothing can be added.

Once a frame has no clipped pixel, much shorter frames only repeat it with more noise; once a frame is clipped all over,
longer ones are too. Those are not decoded. (Inside a picture, runs of pixels leave frames out by the same rules.)
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from processing.calibration.merge.tables import MergeTables
from processing.ground.arrays import Bytes
from processing.pictures.frames import ArrayFrame, Codes, FrameSource
from processing.pictures.images import RelativeImage, Validity


@dataclass(frozen=True)
class Decoded:
    """The frames that were decoded and are needed, by place in the order of falling times; and why others are not."""

    codes: dict[int, Codes]
    left_out: dict[int, str]


def decode_useful(sources: Sequence[FrameSource], tables: MergeTables | None, workers: int) -> Decoded:
    """Decode frames (sorted from the longest time to the shortest) in threads; the outcome hangs on no timing.

    ``tables`` None: linear frames of 16 bits, which are all decoded.
    """
    if tables is None or all(isinstance(s, ArrayFrame) for s in sources):
        with ThreadPoolExecutor(workers) as pool:
            return Decoded(dict(enumerate(pool.map(lambda s: s.decode(), sources))), {})
    order = middle_out(len(sources))
    found = Decoded({}, {})
    ahead: dict[int, Future[Codes]] = {}
    with ThreadPoolExecutor(workers) as pool:
        for step, place in enumerate(order):
            for nearby in order[step : step + workers]:
                if nearby not in ahead and nearby not in found.left_out:
                    ahead[nearby] = pool.submit(sources[nearby].decode)
            if place in found.left_out:
                if place in ahead:
                    ahead.pop(place).cancel()
                continue
            codes = ahead.pop(place).result()
            found.codes[place] = codes
            _leave_out(found, place, codes, tables, sources)
    for place in found.left_out:
        found.codes.pop(place, None)
    return found


def middle_out(count: int) -> list[int]:
    """Return 0..count-1 from the middle to the ends, shorter frames first."""
    middle = count // 2
    return sorted(range(count), key=lambda place: (abs(place - middle), -place))


def _leave_out(found: Decoded, place: int, codes: Codes, tables: MergeTables, sources: Sequence[FrameSource]) -> None:
    """Note which frames the codes of one make needless."""
    name = sources[place].name
    if int(np.max(codes)) < tables.any_clipped:
        for shorter in range(int(tables.last[place]) + 1, len(sources)):
            found.left_out.setdefault(shorter, f"nothing is clipped in {name}: this one would add too little")
    elif int(np.min(codes)) >= tables.all_clipped:
        # The shortest frame stays: it is the bound.
        for longer in range(min(place + 1, len(sources) - 1)):
            found.left_out.setdefault(longer, f"every pixel is clipped in {name}")


# What the merge did, beside the picture: which frames were used where, and what it noticed.


@dataclass(frozen=True)
class FrameUse:
    """One frame's part."""

    number: int
    """As given by the caller, from 0."""
    name: str
    time_s: float
    decoded: bool
    used_share: float
    """Of the picture's runs of pixels: where its samples were looked up."""
    reason: str
    """Why not everywhere; empty: it was."""


@dataclass(frozen=True)
class Shares:
    """Shares of the picture."""

    clipped: float
    dark: float
    ghost: float

    def warnings(self) -> list[str]:
        """Say so where there is hardly a picture."""
        found = []
        if self.clipped > 0.5:
            found.append(f"{100 * self.clipped:.0f} % of the picture is clipped in every frame: shorter times needed")
        if self.dark > 0.5:
            found.append(f"{100 * self.dark:.0f} % of the picture is dark in every frame: longer times needed")
        return found


@dataclass(frozen=True)
class MergeReport:
    """What the merge did."""

    frames: tuple[FrameUse, ...]
    """In the caller's order, without duplicates."""
    warnings: tuple[str, ...]
    shares: Shares
    offset_stops: list[float]
    """How much brighter each decoded frame is than all together say, from the longest time to the shortest."""


@dataclass(frozen=True)
class Merged:
    """The picture and how it came about."""

    image: RelativeImage
    report: MergeReport


def shares(validity: Bytes, ghost: Bytes | None) -> Shares:
    """Count."""
    size = validity.size
    clipped, dark = (float(np.count_nonzero(validity == state)) / size for state in (Validity.CLIPPED, Validity.DARK))
    return Shares(clipped, dark, 0.0 if ghost is None else float(np.count_nonzero(ghost)) / size)
