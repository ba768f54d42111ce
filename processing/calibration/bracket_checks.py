"""Can these frames be one bracket? Sizes, kinds, times, duplicates; and their order."""

from __future__ import annotations

from processing.ground.arrays import Doubles

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from processing.calibration.response_curve import ResponseCurve
from processing.errors import BracketError, ParameterError
from processing.frames import ArrayFrame, Codes, FrameSource, same_file
from processing.sphere import Geometry

MAX_FRAMES = 64


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

    def only(self, places: Sequence[int]) -> Order:
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
    if not np.all(np.isfinite(times) & (times > 0)):
        raise ParameterError(f"exposure times are seconds above 0, not {list(times_s)}")
    return times


def _alike(frames: Sequence[FrameSource], geometry: Geometry) -> int:
    first = frames[0]
    for frame in frames:
        if frame.size_px != first.size_px or frame.depth_bits != first.depth_bits or frame.linear != first.linear:
            raise BracketError(
                f"it is {_kind(frame)}, {first.name} is {_kind(first)}",
                where=frame.name,
                likely="frames of different brackets or settings",
            )
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
            "linear frames take no response curve", where=frames[0].name, likely="raw and JPEG frames mixed up"
        )
    if curve.log2_exposure.shape != (3, 256) or curve.sigma_log2.shape != (3, 256):
        raise ParameterError(f"the curve of 8-bit frames is (3, 256), not {curve.log2_exposure.shape}")
    if not np.all(np.isfinite(curve.log2_exposure)) or not np.all(np.diff(curve.log2_exposure, axis=1) > 0):
        raise ParameterError("the response curve must be finite and rise strictly with the code")
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
            raise BracketError(
                f"it is the same picture as {order.frames[twin].name}, but another time is given for it",
                where=named,
                likely="a copied file, or times in the wrong order",
            )
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
