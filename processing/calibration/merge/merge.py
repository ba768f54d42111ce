"""From a bracket to one picture: every pixel the inverse-variance mean of what the frames say, with its uncertainty.

Per pixel and channel: L = sum(w_f x(z_f) / t_f) / sum(w_f), w = 1 / variance by the camera's noise model, including
quantisation and the uncertainties of response curve and times (Robertson, Borman and Stevenson 2003 for the form of
the weights; Granados et al. 2010 for the noise). Frames may come in any order.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import cv2
import numpy as np

from processing.calibration.merge import bracket, modes
from processing.calibration.merge.bracket import Decoded, FrameUse, Merged, MergeReport, Order
from processing.calibration.merge.kernel import RUN_PX, FlatPlanes, Lookup, merge_runs
from processing.calibration.merge.linear import LinearSamples, linear_samples, merge_linear
from processing.calibration.merge.motion import Planes, frame_shifts, settle_ghosts, show_bled, show_deep_colours
from processing.calibration.merge.tables import (
    Consistency,
    MergeTables,
    coding_error,
    frame_consistency,
    linear_curve,
    merge_tables,
)
from processing.calibration.response.curve import NoiseModel, ResponseCurve
from processing.calibration.response.samples import TOP_CODE
from processing.errors import BracketError, ParameterError
from processing.ground.arrays import Bytes, Doubles, Floats, Int64s
from processing.ground.colour import LUMINANCE_WEIGHTS
from processing.ground.threads import side_by_side, threads
from processing.pictures.frames import Codes, FrameSource, JpegFrame
from processing.pictures.images import RelativeImage
from processing.pictures.modes import SharedMode, together, with_modes
from processing.pictures.mosaic import CameraColours, demosaiced
from processing.sphere import Geometry

__all__ = ["MergeOptions", "MergeReport", "Merged", "merge"]

Quality = Literal["draft", "standard", "reference"]
MAX_ERRORS: dict[str, float] = {"draft": 0.10, "standard": 0.02, "reference": 0.0}
WARN_STOPS = 0.05  # chosen: 3.5 % of light; below it light that changes is taken as noise
REFUSE_STOPS = 0.25  # chosen: a wrong dial is a third of a stop
REFUSE_OWN_STOPS = 0.75
"""With the curve of these frames, whose fit has set right wrong times: beyond twice its doubt and theirs, to here."""
WARN_NOISE = 2.0  # of the variance; chosen
MAX_GHOST_SHARE = 0.5  # of the picture; chosen
BAND_PX = 128 * 2048  # pixels a thread takes at a time; chosen
LEAST_WANDER = 0.004  # relative; chosen: below it nothing is left of it in a sum
PROCESSED_CORRELATION = 0.1  # of neighbours' noise; chosen: wells' own has none, demosaicing's and JPEG's .2 to .8
TEXTURE_SHARE = 1.0
"""Of the local contrast: a merged pixel whose samples disagree by less is texture, no ghost. Chosen on still scenes."""
SHARED_SIGMAS = 2.0
"""Of curve and times: samples that disagree by less contradict these, and show no ghost; chosen on still scenes."""
WELL_GAIN_SIGMA = 0.005
"""Relative, of raw wells' gains, which all frames share; chosen: sensors have 0.003 to 0.01 (EMVA 1288 data sheets)."""
LINEAR_BELOW = 0.01  # of full scale in the longest raw frame; chosen: photons still give 6 % of noise there
VOID_CODE = 224
"""Of coded frames, above which a channel is not counted where another is clipped: in frames that are white many times
over, coding leaves codes of 225 to 250 beside edges, which other frames contradict (chosen)."""
JUDGED_CODES = (16, 240)
"""Codes of coded frames that can show movement: nearer the ends coding, its chroma above all, moves them as much."""


@dataclass(frozen=True)
class MergeOptions:
    """How to merge."""

    quality: Quality = "standard"
    max_error: float | None = None
    """By what part a pixel's uncertainty may grow where frames are left out (0: none is); None: by the quality."""
    ghosts: bool = True
    """Whether what moved is shown by one frame each."""
    own_curve: bool = False
    """Whether the curve was recovered from these frames: where it fits them badly that is doubt, no other camera."""
    allow_contradiction: bool = False
    """Whether frames that contradict times or curve by more than `REFUSE_STOPS` are merged all the same."""
    colours: CameraColours | None = None
    """Of raw frames, whose channels are the camera's own; None: they are Rec. 709."""
    workers: int | None = None
    """Threads; None: as many as `ground.threads` says. Results do not depend on it."""

    def error_bound(self) -> float:
        """Return the bound that holds."""
        bound = MAX_ERRORS[self.quality] if self.max_error is None else self.max_error
        if not 0.0 <= bound <= 1.0:
            raise ParameterError(f"max_error is a part of the uncertainty, 0 to 1, not {bound}")
        return bound


def merge(
    frames: Sequence[FrameSource],
    times_s: Sequence[float],
    curve: ResponseCurve | None,
    noise: NoiseModel,
    *,
    geometry: Geometry,
    options: MergeOptions | None = None,
    time_sigma: Sequence[float] | None = None,
    given_s: Sequence[float] | None = None,
) -> Merged:
    """Merge frames of ``times_s`` seconds each; ``curve`` None: their codes are proportional to exposure.

    ``time_sigma``: relative standard uncertainty of each time (none: exact); ``given_s``: the times as the user gave
    them, where the frames have changed them, for messages. Values are exposure in the curve's gauge
    (of full scale for linear frames) a second.

    Raises `ParameterError`: times, options or a curve that cannot be right; `BracketError`: frames that do not fit
    together: sizes, kinds, or what they say about the light; `PictureFileError`: a frame that cannot be decoded; names
    it.
    """
    options = options or MergeOptions()
    order = bracket.check_bracket(frames, times_s, time_sigma, curve, geometry)
    job = _Job(order, curve, noise, options, given_s=tuple(times_s if given_s is None else given_s))
    decoded = bracket.decode_useful(order.frames, job.tables(), job.workers)
    kept = order.only(sorted(decoded.codes))
    codes = [decoded.codes[place] for place in sorted(decoded.codes)]
    return _merged(replace(job, order=kept), codes, decoded, order, geometry)


@dataclass(frozen=True)
class _Job:
    order: Order
    curve: ResponseCurve | None
    noise: NoiseModel
    options: MergeOptions
    correlation: float = 0.0
    processed: bool = False
    wander: float = 0.0
    given_s: tuple[float, ...] = ()

    @property
    def workers(self) -> int:
        asked = self.options.workers
        if asked is not None and asked < 1:
            raise ParameterError(f"workers is a number from 1 up, not {asked}")
        return asked or threads()

    @property
    def coded(self) -> bool:
        """Return whether the frames were processed or demosaiced: by their source, or by its trace in noise."""
        known = self.processed or self.options.colours is not None
        return known or any(isinstance(f, JpegFrame) for f in self.order.frames)

    @property
    def weights(self) -> Doubles:
        """Return what each channel adds to luminance."""
        own, colours = np.array(LUMINANCE_WEIGHTS), self.options.colours
        return own if colours is None else np.asarray(own @ colours.matrix)

    def tables(self) -> MergeTables | None:
        """Return the tables of 8-bit frames; None for 16 bits."""
        if self.order.depth_bits == 16:
            return None
        order = self.order
        return merge_tables(
            self.curve or linear_curve(),
            self.noise,
            order.times_s,
            order.time_sigma,
            self.options.error_bound(),
            TOP_CODE if self.coded else 254,
        )

    def samples(self) -> MergeTables | LinearSamples:
        return self.tables() or linear_samples(self.noise, self.order.times_s, self.order.time_sigma)


def _merged(job: _Job, codes: list[Codes], decoded: Decoded, whole: Order, geometry: Geometry) -> Merged:
    warnings = list(whole.warnings)
    samples = job.samples()
    agreement = frame_consistency(codes, samples)
    warnings += _contradictions(agreement, job)
    if agreement.noise_factor > WARN_NOISE:
        times = math.sqrt(agreement.noise_factor)
        warnings.append(f"noise is {times:.1f} times what the noise model says: the frames' own value is used")
    job = _honest(job, agreement)
    samples = job.samples()
    warnings += [
        f"{job.order.frames[place].name} is shifted against {job.order.frames[place - 1].name} by {right_px:+.1f} px "
        f"across and {down_px:+.1f} px down: was the camera moved?"
        for place, right_px, down_px in frame_shifts(codes, samples)
    ]
    planes, uses = _fuse(codes, samples, job)
    if isinstance(samples, MergeTables) and samples.clip_together:
        show_deep_colours(codes, samples, planes)
    odd, ghost = np.flatnonzero(planes.suspect), None
    modes, more2 = _widen(planes, samples, job)
    if job.options.ghosts:
        ghost = _ghosts(codes, samples, planes, job)
        moved = ghost > 0
        planes.uncertainty[moved] = np.sqrt(np.square(planes.uncertainty[moved]) + more2[moved])
    if job.coded and isinstance(samples, MergeTables):
        show_bled(codes, samples, planes, odd, ghost)
    if colours := job.options.colours:
        light = demosaiced(planes.rgb, colours.cell, LINEAR_BELOW / float(job.order.times_s[0]))
        planes.rgb = np.maximum(light @ colours.matrix.T.astype(np.float32), 0)
    found = bracket.shares(planes.validity, ghost, geometry)
    warnings += found.warnings()
    np.copyto(planes.uncertainty, np.inf, where=planes.validity == 1)
    image = RelativeImage(planes.rgb, planes.uncertainty, planes.validity, geometry, ghost, with_modes({}, modes))
    return Merged(
        image, MergeReport(_uses(whole, decoded, job, uses), tuple(warnings), found, agreement.offset.tolist())
    )


def _honest(job: _Job, agreement: Consistency) -> _Job:
    """Return the job with the noise that these frames show, and with what they disagree by as doubt of their times."""
    factor, noise = agreement.noise_factor, job.noise
    photon, read, codes = (np.array(part) for part in (noise.photon, noise.read, noise.code_variance))
    scaled = NoiseModel(
        tuple(factor * photon), tuple(math.sqrt(factor) * read), tuple(np.maximum(factor * codes, 1 / 12)), noise.black
    )
    order = replace(job.order, time_sigma=np.hypot(job.order.time_sigma, np.abs(agreement.offset) * math.log(2)))
    curve = job.curve
    if curve is not None and agreement.curve_error > 2 * WARN_STOPS:
        # Codes of one pair disagree by so much at most; a curve is wrong by half of it, with either sign.
        curve = replace(curve, sigma_log2=np.hypot(curve.sigma_log2, agreement.curve_error / 4))
    job = replace(job, order=order, curve=curve, noise=scaled, correlation=agreement.correlation)
    return replace(job, processed=agreement.neighbours > PROCESSED_CORRELATION, wander=agreement.wander)


def _contradictions(agreement: Consistency, job: _Job) -> list[str]:
    """Return warnings about frames that contradict each other; refuse where no uncertainty could cover it."""
    apart, bent = float(np.max(np.abs(agreement.offset))), agreement.curve_error / 2
    place = int(np.argmax(np.abs(agreement.offset)))
    named = [
        f"{frame.name} is {offset:+.2f} stops off the other frames: a wrong time ({job.given_s[number]:g} s "
        "given), or the light changed"
        for frame, offset, number in zip(job.order.frames, agreement.offset, job.order.numbers, strict=True)
        if abs(offset) > WARN_STOPS
    ]
    if agreement.curve_error > 2 * WARN_STOPS:
        named.append(
            "the response curve does not fit these frames: codes of a frame pair disagree by "
            f"{agreement.curve_error:.2f} stops"
        )
    if job.options.allow_contradiction:
        return named
    doubt = job.order.time_sigma / math.log(2)
    if job.curve is not None and job.options.own_curve:
        doubt = np.hypot(doubt, np.sqrt(np.mean(np.square(job.curve.sigma_log2[:, slice(*JUDGED_CODES)]))))
    beyond = np.max(np.abs(agreement.firm) - 2 * doubt)
    if apart > REFUSE_STOPS and beyond > (REFUSE_OWN_STOPS if job.options.own_curve else REFUSE_STOPS):
        text = f"the frames contradict each other by {apart:.2f} stops: " + "; ".join(named)
        likely = "a wrong exposure time, another camera's response curve, or light that changed"
        advice = "correct the times or the curve, or leave the frame out"
        raise BracketError(text, where=job.order.frames[place].name, likely=likely, advice=advice)
    if bent > REFUSE_STOPS and not job.options.own_curve:
        text = f"the response curve is not that of these frames: codes of a frame pair disagree by {2 * bent:.2f} stops"
        likely = "another camera's response curve, or another picture style"
        advice = "use this camera's own calibration, or none to recover the curve from the frames"
        raise BracketError(text, where=job.order.frames[place].name, likely=likely, advice=advice)
    return named


def _fuse(codes: Sequence[Codes], samples: MergeTables | LinearSamples, job: _Job) -> tuple[Planes, Doubles]:
    """Return the merged planes, and what part of the picture used each frame."""
    height, width = codes[0].shape[:2]
    pixels, workers = height * width, job.workers
    # The correlation of the channels' noise, and the squared error that all frames share
    shape = (job.correlation, coding_error(job.curve, job.noise) if job.coded and job.curve else 0.0)
    padded = max(pixels, RUN_PX)
    empty: Any = (np.empty(padded, kind) for kind in (np.float32, np.uint8, np.uint8))
    planes = Planes(np.empty((padded, 3), np.float32), *empty)
    flat: list[Any] = [np.ascontiguousarray(frame).reshape(-1, 3) for frame in codes]
    if isinstance(samples, MergeTables):
        # A picture smaller than one run is lengthened by its own pixels.
        flat = [np.resize(frame, (padded, 3)) if pixels < padded else frame for frame in flat]
        uses = _fuse_runs(flat, samples, shape, planes, workers, coded=job.coded)
    else:
        addresses = np.array([frame.ctypes.data for frame in flat], dtype=np.uint64)
        model = (samples.times_s, samples.time_sigma, samples.noise, shape[0], job.weights)
        out = FlatPlanes(planes.rgb, planes.uncertainty, planes.validity, planes.suspect)
        _in_bands(lambda a, b: merge_linear(addresses, np.array([a, b]), *model, out), pixels, BAND_PX, workers)
        uses = np.ones(len(flat))
    flats: Any = (p[:pixels].reshape(height, width) for p in (planes.uncertainty, planes.validity, planes.suspect))
    return Planes(planes.rgb[:pixels].reshape(height, width, 3), *flats), uses


def _fuse_runs(
    flat: Sequence[Codes], tables: MergeTables, shape: tuple[float, float], planes: Planes, workers: int, *, coded: bool
) -> Doubles:
    addresses = np.array([frame.ctypes.data for frame in flat], dtype=np.uint64)
    clip = np.array([int(np.flatnonzero(tables.samples[0, c, :, 1] > 0)[-1]) for c in range(3)])
    void = -1 if tables.clip_together else VOID_CODE if coded else 255
    limits = np.array([tables.any_clipped, tables.all_clipped, tables.rise, void])
    judged = tables.samples
    if coded:
        judged = judged.copy()
        judged[:, :, : JUDGED_CODES[0], 1] = judged[:, :, JUDGED_CODES[1] + 1 :, 1] = 0
    table = Lookup(tables.lanes, judged, tables.saturation, clip, limits, tables.last)
    out = FlatPlanes(planes.rgb, planes.uncertainty, planes.validity, planes.suspect)
    runs = -(-len(flat[0]) // RUN_PX)
    counts: list[Int64s] = []

    def band(first: int, end: int) -> None:
        uses = np.zeros(len(flat), dtype=np.int64)
        counts.append(uses)
        sums = np.empty(12 * RUN_PX, np.float32)
        merge_runs(addresses, np.array([first, end]), table, *shape, out, uses, sums)

    _in_bands(band, runs, BAND_PX // RUN_PX, workers)
    return np.asarray(np.sum(counts, axis=0) / runs)


def _in_bands(work: Callable[[int, int], object], count: int, band: int, workers: int) -> None:
    """Call ``work(first, end)`` over 0..count in threads."""
    side_by_side(lambda first: work(first, min(first + band, count)), range(0, count, band), workers)


def _widen(planes: Planes, samples: MergeTables | LinearSamples, job: _Job) -> tuple[list[SharedMode], Floats]:
    """Return what all pixels share; add it, and what texture hides, to each pixel's uncertainty, in place.

    What is added, squared, is the second array (H, W): what one frame shows has it too. Samples that disagree by what
    the texture around them explains are no longer suspect."""
    if isinstance(samples, MergeTables):
        found = modes.merge_modes(samples, job.curve or linear_curve(), job.order.times_s, job.order.time_sigma)
    else:
        found = modes.linear_modes(samples)
    wander, level = job.wander if job.wander > LEAST_WANDER else 0.0, tuple(found)
    if wander:
        # Two frames differ by the root of two of what each is off by; the spot that sets the scale is off as well.
        found.append(SharedMode("light that changed", "whole", (0.0,), (wander,)))
    u2 = np.empty_like(planes.uncertainty)

    @np.errstate(over="ignore")  # the square of a black pixel's uncertainty is as good as infinite
    def band(first: int, end: int) -> None:
        around, rows = slice(max(first - modes.CONTRAST_REACH_PX, 0), end + modes.CONTRAST_REACH_PX), slice(first, end)
        luminance = np.maximum(planes.rgb[around] @ job.weights.astype(np.float32), 0)
        inner, uncertainty = slice(first - around.start, end - around.start), planes.uncertainty[rows]
        u2[rows] = shared2 = np.square(together(level, luminance[inner])) + np.float32(wander**2)
        if job.options.colours is not None:
            u2[rows] += np.float32(WELL_GAIN_SIGMA**2)
        if job.coded:
            contrast = modes.local_contrast(luminance)
            near = cv2.dilate(contrast, np.ones((modes.NEAR_PX, modes.NEAR_PX), np.uint8))[inner]
            explained = uncertainty <= TEXTURE_SHARE * near
            planes.suspect[rows][explained | (uncertainty < SHARED_SIGMAS * np.sqrt(shared2))] = 0
            # Less what the pixels' own noise shows of contrast.
            u2[rows] += modes.CONTRAST_SHARE**2 * np.maximum(np.square(contrast[inner]) - np.square(uncertainty), 0)
        np.sqrt(np.square(uncertainty) + u2[rows], out=uncertainty)

    _in_bands(band, len(u2), 128, job.workers)
    return found, u2


def _ghosts(codes: Sequence[Codes], samples: MergeTables | LinearSamples, planes: Planes, job: _Job) -> Bytes:
    """Settle what moved; return the ghost map by the caller's frame numbers."""
    odd = float(np.count_nonzero(planes.suspect)) / planes.suspect.size
    if odd > MAX_GHOST_SHARE and not job.options.allow_contradiction:
        text = f"the frames disagree in {100 * odd:.0f} % of the picture"
        where = job.order.frames[0].name
        likely = "frames of different scenes, a camera that moved, or a noise model of another camera"
        raise BracketError(text, where=where, likely=likely, advice="check that the frames belong together")
    ghost = settle_ghosts(codes, samples, planes, processed=job.coded)
    numbers = np.array([0, *(number + 1 for number in job.order.numbers)], dtype=np.uint8)
    return np.asarray(numbers[ghost]) if ghost.any() else ghost


def _uses(whole: Order, decoded: Decoded, job: _Job, uses: Doubles) -> tuple[FrameUse, ...]:
    by_number = dict(zip(job.order.numbers, uses.tolist(), strict=True))
    found = []
    for place, (number, frame) in enumerate(zip(whole.numbers, whole.frames, strict=True)):
        reason = decoded.left_out.get(place, "")
        share = by_number.get(number, 0.0)
        if not reason and share < 1:
            reason = "skipped in pixel runs where it is clipped or adds too little"
        found.append(FrameUse(number, frame.name, float(whole.times_s[place]), number in by_number, share, reason))
    return tuple(sorted(found, key=lambda one: one.number))
