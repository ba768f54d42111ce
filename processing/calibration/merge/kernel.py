"""The merge's inner loops over 8-bit frames: one pass over all frames, 128 pixels at a time.

For each run of pixels the smallest and largest code of every frame say which frames can add something there; only
their samples are looked up and added. A run in which a shorter frame is brighter than a longer one, and pixels whose
samples disagree, are looked at again with all frames (`suspicion`).
"""

# mypy: disable-error-code="no-untyped-def,attr-defined"
from __future__ import annotations

from functools import partial
from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir  # type: ignore[import-untyped]
from numba import carray, types
from numba.extending import intrinsic

from processing.ground import kernels
from processing.ground.arrays import Bytes, Floats, Indices, Int64s
from processing.ground.colour import LUMINANCE_WEIGHTS

# Not nnan and ninf: infinities are an honest uncertainty. Sums may be reordered and products fused.
FAST_MATH = {"reassoc", "contract", "arcp", "nsz"}


compiled, inner = (partial(made, fastmath=FAST_MATH) for made in (kernels.compiled, kernels.inner))


def _pointer(of: types.Type, bits: ir.Type) -> Any:
    def build(_typing: Any, _address: Any) -> Any:
        def code(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
            return builder.inttoptr(args[0], bits.as_pointer())

        return types.CPointer(of)(types.uint64), code  # type: ignore[no-untyped-call]

    return intrinsic(build)


def _four_floats(*, add: bool) -> Any:
    vector = ir.VectorType(ir.FloatType(), 4)

    def build(_typing: Any, _target: Any, _source: Any) -> Any:
        def code(context: Any, builder: Any, _signature: Any, args: Any) -> Any:
            target, source = (builder.inttoptr(a, vector.as_pointer()) for a in args)
            value = builder.load(source, align=4)
            if add:
                value = builder.fadd(builder.load(target, align=4), value)
            builder.store(value, target, align=4)
            return context.get_dummy_value()

        return types.void(types.uint64, types.uint64), code

    return intrinsic(build)


bytes_at = _pointer(types.uint8, ir.IntType(8))
"""``bytes_at(address)``: for ``numba.carray``; a tuple of arrays would compile anew for every number of frames."""
floats_at = _pointer(types.float32, ir.FloatType())
set_four = _four_floats(add=False)  # ``set_four(target, source)``: copies four float32 between addresses, as a vector
add_four = _four_floats(add=True)
"""``add_four(target, source)``: adds four float32 to what is at ``target``: numba does not find this by itself."""


RUN_PX = 128  # pixels judged together; chosen: a run's sums stay in the first cache
RUN = 3 * RUN_PX  # codes a run


class Lookup(NamedTuple):
    """What the loops look up for frames sorted from the longest time to the shortest; see `MergeTables`."""

    lanes: Floats
    """(F, 3, 256, 4): w, w v, w v2, 0 of each code."""
    samples: Floats
    """(F, 3, 256, 2): v and w of each code, by which disagreement is judged; w = 0: the code shows none."""
    saturation: Floats
    """(F, 3): radiance at the last code that is not clipped."""
    clip: Indices
    """(3,): the last code of each channel that is not clipped."""
    limits: Int64s
    """(4,): code from which any channel is clipped, from which all are, the rise that is not noise, and the code above
    which a channel is void where another is clipped: -1 of cameras with a colour matrix behind the wells; coding leaves
    those near white anywhere (coloured specks along what is bright); 255: all count."""
    last: Int64s
    """(F,): where frame k is unclipped, frames after ``last[k]`` are left out."""


class FlatPlanes(NamedTuple):
    """The merged picture as the loops write it, N pixels in a row."""

    rgb: Floats
    """(N, 3) radiance in exposures a second."""
    uncertainty: Floats
    """(N,): relative standard uncertainty of luminance."""
    validity: Bytes
    """(N,): `Validity`."""
    suspect: Bytes
    """(N,): 0 fine, 1 odd, 2 surely something moved."""


_ENTRY = np.uint64(16)  # bytes: four float32
_PIXEL = np.uint64(48)  # bytes: three entries
_CHANNEL = np.uint64(256 * 16)  # bytes: 256 entries
_FRAME = np.uint64(3 * 256 * 16)  # bytes: three channels
_TWICE = np.uint64(32)  # bytes: two entries
TRIGGER_CHI2 = 26.0
"""Of a pixel's sums: one in 100,000 of two frames by chance (3 degrees of freedom). Then all frames are looked at."""
CLIPPED_SNR2 = np.float32(1e-3)  # between a bound's `TRACE_SNR2` and any measurement's; chosen
DARK_UNCERTAINTY = np.float32(0.5)  # relative; chosen: more is no value
_R, _G, _B = (np.float32(weight) for weight in LUMINANCE_WEIGHTS)
_ONE, _TINY = np.float32(1.0), np.float32(1e-30)  # of the type of the sums
VALID, CLIPPED, DARK = np.uint8(0), np.uint8(1), np.uint8(2)  # `Validity`, as the loops write it


@inner
def scan(addresses, offset, low, high, rise):
    """Fill the smallest and largest code of each frame in a run, and how much brighter than the longer frame it is.

    ``addresses``: (F,) uint64 of the frames' bytes; ``offset``: bytes to the run; ``low``, ``high``, ``rise``: (F,).
    """
    before = carray(bytes_at(addresses[0] + offset), RUN)
    for f in range(addresses.shape[0]):
        frame = carray(bytes_at(addresses[f] + offset), RUN)
        least, most, rises = np.uint8(255), np.uint8(0), np.uint8(0)
        for i in range(RUN):
            code, earlier = frame[i], before[i]
            least = min(least, code)
            most = max(most, code)
            rises = max(rises, np.uint8(max(code, earlier) - earlier))
        before = frame
        low[f], high[f], rise[f] = least, most, rises


@inner
def accumulate(addresses, offset, first, end, lanes_at, sums_at):
    """Sum the table entries of frames first..end-1 over a run: 12 floats a pixel at ``sums_at``.

    ``addresses``: (F,) uint64; ``lanes_at``: address of `Lookup.lanes` (F, 3, 256, 4).
    """
    for f in range(first, end):
        frame = carray(bytes_at(addresses[f] + offset), RUN)
        red = lanes_at + np.uint64(f) * _FRAME
        green = red + _CHANNEL
        blue = green + _CHANNEL
        if f == first:
            for i in range(RUN_PX):
                at = sums_at + _PIXEL * np.uint64(i)
                set_four(at, red + _ENTRY * np.uint64(frame[3 * i]))
                set_four(at + _ENTRY, green + _ENTRY * np.uint64(frame[3 * i + 1]))
                set_four(at + _TWICE, blue + _ENTRY * np.uint64(frame[3 * i + 2]))
        else:
            for i in range(RUN_PX):
                at = sums_at + _PIXEL * np.uint64(i)
                add_four(at, red + _ENTRY * np.uint64(frame[3 * i]))
                add_four(at + _ENTRY, green + _ENTRY * np.uint64(frame[3 * i + 1]))
                add_four(at + _TWICE, blue + _ENTRY * np.uint64(frame[3 * i + 2]))


@inner
def accumulate_clear(addresses, offset, first, end, table, sums_at):
    """Sum as `accumulate` does, without what is void beside a clipped channel; of the shortest frame all count.

    ``addresses``: (F,) uint64.
    """
    above = table.limits[3]
    lanes_at = np.uint64(table.lanes.ctypes.data)
    carray(floats_at(sums_at), 12 * RUN_PX)[:] = 0
    for f in range(first, end):
        frame = carray(bytes_at(addresses[f] + offset), RUN)
        red = lanes_at + np.uint64(f) * _FRAME
        for i in range(RUN_PX):
            r, g, b = frame[3 * i], frame[3 * i + 1], frame[3 * i + 2]
            every = f == addresses.shape[0] - 1 or not (r > table.clip[0] or g > table.clip[1] or b > table.clip[2])
            at = sums_at + _PIXEL * np.uint64(i)
            if every or r <= above:
                add_four(at, red + _ENTRY * np.uint64(r))
            if every or g <= above:
                add_four(at + _ENTRY, red + _CHANNEL + _ENTRY * np.uint64(g))
            if every or b <= above:
                add_four(at + _TWICE, red + _CHANNEL + _CHANNEL + _ENTRY * np.uint64(b))


@inner
def resolve(sums_at, start, shared, common, trigger, out):
    """Turn a run's sums into means, relative uncertainty of luminance and validity; return how many disagree.

    ``sums_at``: address of the sums, of shape (`RUN_PX`, 3, 4). ``shared``: correlation of the channels' noise.
    ``common``: squared relative error that all frames share. ``trigger``: chi-squared from which samples disagree.
    """
    rgb, uncertainty, validity, suspect = out
    apart = _ONE - shared
    s = carray(floats_at(sums_at), 12 * RUN_PX)
    disagreeing = 0
    for i in range(RUN_PX):
        k, p = 12 * i, start + i
        w0, w1, w2 = s[k], s[k + 4], s[k + 8]
        i0, i1, i2 = _ONE / max(w0, _TINY), _ONE / max(w1, _TINY), _ONE / max(w2, _TINY)
        # Means and chi-squared of the three channels, from the sums of w, w v and w v2.
        m0, m1, m2 = s[k + 1] * i0, s[k + 5] * i1, s[k + 9] * i2
        chi2 = (s[k + 2] - s[k + 1] * m0) + (s[k + 6] - s[k + 5] * m1) + (s[k + 10] - s[k + 9] * m2)
        rgb[p, 0], rgb[p, 1], rgb[p, 2] = m0, m1, m2
        # Variance of luminance: of independent channels, and of channels whose noise is one, mixed by ``shared``.
        y = _R * m0 + _G * m1 + _B * m2
        variance = _R * _R * i0 + _G * _G * i1 + _B * _B * i2
        if shared > 0:
            together = _R * np.sqrt(i0) + _G * np.sqrt(i1) + _B * np.sqrt(i2)
            variance = apart * variance + shared * together * together
        u = np.sqrt(variance / max(y * y, _TINY) + common)
        uncertainty[p] = u
        known = min(w0 * m0 * m0, w1 * m1 * m1, w2 * m2 * m2)
        state = DARK if u > DARK_UNCERTAINTY else VALID
        validity[p] = CLIPPED if known < CLIPPED_SNR2 else state
        odd = chi2 > trigger
        suspect[p] = np.uint8(odd)
        disagreeing += odd
    return disagreeing


@inner
def suspicion(addresses, pixel, table):
    """Return chi-squared of all frames at a pixel and its degrees of freedom: dark samples and bounds count too.

    ``addresses``: (F,) uint64 of the frames' codes (N, 3) uint8.
    """
    chi2, freedom = 0.0, 0
    for c in range(3):
        total = sum_v = sum_vv = bound = 0.0
        used = 0
        for f in range(addresses.shape[0]):
            codes = carray(bytes_at(addresses[f] + np.uint64(3 * pixel)), 3)
            code = codes[c]
            if table.limits[3] < 0 and (
                codes[0] > table.clip[0] or codes[1] > table.clip[1] or codes[2] > table.clip[2]
            ):
                continue
            if code > table.clip[c]:
                bound = max(bound, float(table.saturation[f, c]))
                continue
            v, w = float(table.samples[f, c, code, 0]), float(table.samples[f, c, code, 1])
            if w <= 0.0:
                continue
            total, sum_v, sum_vv = total + w, sum_v + w * v, sum_vv + w * v * v
            used += 1
        if used:
            mean = sum_v / total
            chi2 += sum_vv - sum_v * mean
            freedom += used - 1
            # A clipped frame says 'at least': 5 % of grace, for the last codes' own uncertainty.
            excess = 0.95 * bound - mean
            if excess > 0.0:
                chi2 += excess * excess * min(total, 400.0 / max(mean * mean, 1e-30))
                freedom += 1
    return chi2, freedom


@inner
def chi2_limit(freedom, shared):
    """Return what chance exceeds once in 100,000, and half as much again, since noise is not quite Gaussian.

    Where channels share their noise (``shared`` is its correlation), deviations come in threes. Both scalars; the limit
    has the shape of ``freedom``.
    """
    return 1.5 * (freedom + (1.0 + 2.0 * shared) * (6.0 * np.sqrt(2.0 * freedom) + 8.0))


@inner
def judge_run(addresses, start, every, table, shared, out):
    """Judge the suspect pixels of a run (``every``: all its pixels): 0 fine, 1 odd, 2 surely something moved.

    ``addresses``: (F,) uint64 of the frames' codes (N, 3) uint8.
    """
    uncertainty, suspect = out.uncertainty, out.suspect
    for p in range(start, start + RUN_PX):
        if not every and suspect[p] == 0:
            continue
        chi2, freedom = suspicion(addresses, p, table)
        limit = chi2_limit(freedom, shared)
        suspect[p] = 0
        if freedom > 0 and chi2 > limit:
            suspect[p] = 2 if chi2 > 4.0 * limit else 1
            # Samples that disagree: the spread among them is the uncertainty (Birge's ratio).
            uncertainty[p] *= np.float32(np.sqrt(chi2 / freedom))


@compiled
def merge_runs(addresses, runs, table, shared, common, out, uses, sums):
    """Merge runs ``runs[0]..runs[1]-1`` of 8-bit frames into ``out``.

    ``addresses``: (F,) uint64, of each frame's codes (N, 3) uint8, from the longest time to the shortest; ``table``:
    a `Lookup`; ``shared``: correlation of the channels' noise, 0..1; ``common``: squared relative error that all frames
    share; ``out``: `FlatPlanes` of at least `RUN_PX` pixels (the last run begins earlier, so that it is whole);
    ``uses``: (F,) int64, raised by the number of runs that took each frame; ``sums``: scratch of shape (12 `RUN_PX`,)
    float32 for this call; the caller's, since what is used by its address only would be freed.
    """
    count, pixels = addresses.shape[0], out.validity.shape[0]
    low, high, rise = np.empty(count, np.uint8), np.empty(count, np.uint8), np.empty(count, np.uint8)
    together, trigger = np.float32(shared), np.float32(TRIGGER_CHI2 * (1.0 + 2.0 * shared))
    floor = np.float32(common)
    sums_at, lanes_at = np.uint64(sums.ctypes.data), np.uint64(table.lanes.ctypes.data)
    any_clipped, all_clipped, most_rise = table.limits[0], table.limits[1], table.limits[2]
    for run in range(runs[0], runs[1]):
        start = min(run * RUN_PX, pixels - RUN_PX)
        offset = np.uint64(3 * start)
        scan(addresses, offset, low, high, rise)
        # Frames clipped all over the run add nothing; of those after the first unclipped one, only what improves it.
        first = 0
        while first < count - 1 and low[first] >= all_clipped:
            first += 1
        whole = first
        while whole < count - 1 and high[whole] >= any_clipped:
            whole += 1
        end = table.last[whole] + 1
        moved, beside_white = False, table.limits[3] < 0
        for f in range(count):
            moved |= rise[f] > most_rise
            uses[f] += first <= f < end
            beside_white |= (
                table.limits[3] < 255 and first <= f < end and high[f] >= any_clipped and low[f] < all_clipped
            )
        if beside_white:
            accumulate_clear(addresses, offset, first, end, table, sums_at)
        else:
            accumulate(addresses, offset, first, end, lanes_at, sums_at)
        odd = resolve(sums_at, start, together, floor, trigger, out)
        if moved or odd:
            judge_run(addresses, start, moved, table, shared, out)
