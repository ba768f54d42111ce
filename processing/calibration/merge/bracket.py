"""The frames of a merge: whether they can be one bracket, which of them are needed, and what was made of each.

Which stops a picture needs is found while decoding, from the middle outwards: once a frame has no clipped pixel, much
shorter frames only repeat it with more noise; once a frame is clipped all over, longer ones are too. Those are not
decoded. (Inside a picture, runs of pixels leave frames out by the same rules.)
"""

from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from processing.calibration.merge.tables import MergeTables
from processing.calibration.response.curve import ResponseCurve
from processing.calibration.response.samples import TIME_RANGE_S
from processing.errors import BracketError, ParameterError
from processing.ground.arrays import Bytes, Doubles
from processing.pictures.frames import ArrayFrame, Codes, FrameSource, same_file
from processing.pictures.images import RelativeImage, Validity
from processing.sphere import Fisheye, Geometry

MAX_FRAMES = 64  # chosen: several times the nine of a session


@dataclass(frozen=True)
class Order:
    """Frames from the longest time to the shortest."""

    frames: tuple[FrameSource, ...]
    times_s: Doubles
    time_sigma: Doubles
    numbers: tuple[int, ...]
    """Place of each in the caller's sequence."""
    depth_bits: int
    warnings: tuple[str, ...] = ()

    def only(self, places: Sequence[int]) -> Self:
        """Return the frames at some places."""
        return replace(
            self,
            frames=tuple(self.frames[p] for p in places),
            times_s=self.times_s[list(places)],
            time_sigma=self.time_sigma[list(places)],
            numbers=tuple(self.numbers[p] for p in places),
        )


def check_bracket(
    frames: Sequence[FrameSource],
    times_s: Sequence[float],
    time_sigma: Sequence[float] | None,
    curve: ResponseCurve | None,
    geometry: Geometry,
) -> Order:
    """Return the frames in order, without duplicates, or raise naming what does not fit."""
    times = _times(times_s, len(frames))
    sigma = np.zeros(len(frames)) if time_sigma is None else np.asarray(time_sigma, dtype=np.float64)
    if sigma.shape != times.shape or not np.all(np.isfinite(sigma) & (sigma >= 0)):
        raise ParameterError("time_sigma needs one number from 0 up for each frame")
    depth = _alike(frames, geometry)
    _curve_fits(frames, depth, curve)
    # Stable: frames of one time keep the caller's order.
    places = [int(p) for p in np.argsort(-times, kind="stable")]
    order = Order(tuple(frames[p] for p in places), times[places], sigma[places], tuple(places), depth)
    return _without_duplicates(order)


def _times(times_s: Sequence[float], count: int) -> Doubles:
    if not 1 <= count <= MAX_FRAMES:
        raise BracketError(f"a bracket has 1 to {MAX_FRAMES} frames, not {count}")
    times = np.asarray(times_s, dtype=np.float64)
    if times.shape != (count,):
        raise ParameterError(f"{count} frames need {count} times, not {times.size}")
    low, high = TIME_RANGE_S
    if not np.all((times >= low) & (times <= high)):
        raise ParameterError(f"exposure times are {low:g} to {high:g} seconds, not {list(times_s)}")
    return times


def _alike(frames: Sequence[FrameSource], geometry: Geometry) -> int:
    first = frames[0]
    for frame in frames:
        if frame.size_px != first.size_px or frame.depth_bits != first.depth_bits or frame.linear != first.linear:
            text = f"it is {_kind(frame)}, {first.name} is {_kind(first)}"
            raise BracketError(text, where=frame.name, likely="frames of different brackets or settings")
    if first.size_px != (geometry.width_px, geometry.height_px):
        raise BracketError(
            f"frames of {first.size_px[0]} x {first.size_px[1]} pixels do not fit a geometry of "
            f"{geometry.width_px} x {geometry.height_px}",
            where=first.name,
        )
    return first.depth_bits


def _kind(frame: FrameSource) -> str:
    width, height = frame.size_px
    return f"{width} x {height}, {frame.depth_bits} bits, {'linear' if frame.linear else 'with a response curve'}"


def _curve_fits(frames: Sequence[FrameSource], depth: int, curve: ResponseCurve | None) -> None:
    if curve is None:
        if not frames[0].linear:
            raise ParameterError(
                "frames that are not linear need a response curve", where=frames[0].name, advice="recover one first"
            )
        return
    if frames[0].linear or depth != 8:
        raise ParameterError(
            "linear frames take no response curve", where=frames[0].name, likely="raw and JPEG frames are mixed up"
        )
    if curve.log2_exposure.shape != (3, 256) or curve.sigma_log2.shape != (3, 256):
        raise ParameterError(f"the curve of 8-bit frames is (3, 256), not {curve.log2_exposure.shape}")
    if not np.all(np.isfinite(curve.log2_exposure)) or not np.all(np.diff(curve.log2_exposure, axis=1) > 0):
        raise ParameterError("the response curve must be finite and rise strictly with the code")
    if not np.all(np.isfinite(curve.sigma_log2) & (curve.sigma_log2 >= 0)):
        raise ParameterError("the response curve's uncertainty is finite and not negative")
    if not all(0 <= low < high <= 254 for low, high in zip(curve.low, curve.high, strict=True)):
        raise ParameterError(f"the curve's ends {curve.low} to {curve.high} are not codes of 0 to 254")


def _without_duplicates(order: Order) -> Order:
    """Leave out frames that are copies of another: counted twice, their noise would seem smaller than it is."""
    kept, warnings = [0], []
    for place in range(1, len(order.frames)):
        twin = next((k for k in kept if _same(order.frames[k], order.frames[place])), None)
        if twin is None:
            kept.append(place)
            continue
        named = f"{order.frames[place].name} (number {order.numbers[place]})"
        if order.times_s[place] != order.times_s[twin]:
            text = f"it is the same picture as {order.frames[twin].name}, but with another exposure time"
            raise BracketError(text, where=named, likely="a copied file, or times in the wrong order")
        warnings.append(f"{named} is the same picture as {order.frames[twin].name}: left out")
    return replace(order.only(kept), warnings=tuple(warnings))


def _same(a: FrameSource, b: FrameSource) -> bool:
    """Return whether two frames are one picture; frames that are clipped or black all over may be alike by right."""
    if isinstance(a, ArrayFrame) and isinstance(b, ArrayFrame):
        sparse = (slice(None, None, 61), slice(None, None, 61))
        alike = np.array_equal(a.array[sparse], b.array[sparse]) and np.array_equal(a.array, b.array)
        return bool(alike) and _tells(a.array)
    return same_file(a, b) and _tells(a.decode(8))


def _tells(codes: Codes) -> bool:
    """Return whether anything is neither clipped nor black."""
    full = np.iinfo(codes.dtype).max
    return bool(np.any((codes > full // 64) & (codes < full - full // 32)))


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
            found.left_out.setdefault(shorter, f"nothing is clipped in {name}: this frame adds too little")
    elif int(np.min(codes)) >= tables.all_clipped:
        # The shortest frame stays: it is the bound.
        for longer in range(min(place + 1, len(sources) - 1)):
            found.left_out.setdefault(longer, f"every pixel is clipped in {name}")


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
    """Shares of the picture; of a fisheye's, of what lies within its circle."""

    clipped: float
    dark: float
    ghost: float

    def warnings(self) -> list[str]:
        """Say so where there is hardly a picture."""
        found = []
        if self.clipped > 0.5:
            found.append(f"{100 * self.clipped:.0f} % of the picture is clipped in every frame: use shorter exposures")
        if self.dark > 0.5:
            found.append(f"{100 * self.dark:.0f} % of the picture is dark in every frame: use longer exposures")
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


def shares(validity: Bytes, ghost: Bytes | None, geometry: Geometry) -> Shares:
    """Count. ``validity`` and ``ghost``: (H, W) uint8, `Validity` codes and frame numbers."""
    planes = validity, np.zeros((0,), np.uint8) if ghost is None else ghost
    if isinstance(geometry, Fisheye):
        across, down = geometry.offsets_px()
        seen = np.add(down**2, across**2, dtype=np.float32) < geometry.radius_px**2
        planes = validity[seen], planes[1][seen] if planes[1].size else planes[1]
    of = max(planes[0].size, 1)
    counts = (np.count_nonzero(part) for part in (planes[0] == Validity.CLIPPED, planes[0] == Validity.DARK, planes[1]))
    return Shares(*(float(count) / of for count in counts))
