"""Our method: curve, noise and shutter times from the same patches, in turn, until they agree."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from processing.calibration.response import shutter
from processing.calibration.response.curve import FineCurve, PatchNoise, fit_noise
from processing.calibration.response.fit import (
    FIRST_CODE,
    LAST_CODE,
    N_BASIS,
    Solution,
    Weighed,
    dispersion,
    equations,
    solve,
    spline_basis,
    weigh,
)
from processing.calibration.response.prior import LEAST_CODES, CurvePrior, published_prior
from processing.calibration.response.samples import CHANNELS, PATCH_PX, ChannelSamples, Samples
from processing.calibration.response.shutter import TimeEstimate, TimeEvidence
from processing.errors import ResponseError
from processing.ground.arrays import Doubles, Flags

_QUICK_PATCHES = 1000  # how many patches the first rounds use: they need only come near
_MOST_WRONG = 3  # frames of a bracket; chosen
_CLEAR_OF_BLACK = 12.0  # codes; chosen: above cut-off noise
_LEAST_CLEAR_PATCHES = 60  # patches (of all channels) clear of black that a frame must show before its time is doubted
_SAME_TIME = 0.1  # stops; chosen: less is one dial
_LEAST_RISING = 0.5  # of the pairs of frames; chosen
_WIDEST_STOPS = 4.5  # chosen: two frames' ranges must overlap
_REFINE = 3  # rounds; chosen
_QUICK_ROUNDS = 3  # chosen
_MIDDLE = 128  # code
_MOST_ROUNDS, _SETTLED_STOPS = 8, 1e-3  # chosen: most brackets settle within four rounds
_BOUNDED = 3.0  # standard deviations, Huber's bound in the first rounds; chosen
_OUTLIER = 5.0  # standard deviations beyond which a patch has moved
_LEAST_SAMPLES = 40  # patches; chosen: more than unknowns
_LEAST_NEAR = 5  # patches within two codes; chosen
_LEAST_SLOPE = 1e-4  # stops a code, so that curves rise strictly
_PIXEL_LEAST, _MEAN_LEAST = 1 / 12, 0.005  # squared codes: rounding; of means it averages out


@dataclass(frozen=True)
class ChannelFit:
    """One channel's curve and what it rests on."""

    log2: Doubles
    """(256,) stops, strictly increasing; 0 at code 255, which is extrapolated."""
    coefficients: Doubles
    noise: PatchNoise
    solution: Solution
    low: int
    high: int
    weighed: Weighed
    kept: Flags
    """(n,) observations of patches that did not move."""
    left_out: Doubles = field(default_factory=lambda: np.zeros((0, 256)))
    """(frames, 256) stops: what leaving out each frame moves, 0 at code 128; then what else channels have together."""
    held_out: float = 1.0
    """Chi-squared a degree of freedom of patches that the curve was not fitted to."""


@dataclass(frozen=True)
class DaylitFit:
    """All channels, and the times that they agree on."""

    channels: tuple[ChannelFit, ChannelFit, ChannelFit]
    log2_times: Doubles
    evidence: TimeEvidence
    wrong_times: dict[int, float]
    """Frame: stops by which its given time is off."""
    estimate: TimeEstimate


def fit_daylit(samples: Samples, *, free_times: bool, priors: Sequence[CurvePrior] | None = None) -> DaylitFit:
    """Fit all channels under their ``priors``, or under that of any camera.

    A frame whose time contradicts all others gets the time that they imply. With ``free_times`` the rule behind nominal
    times is chosen too.

    Raises `ResponseError`: too few patches that are seen well in two frames, or all of nearly the same code.
    """
    for data, name in zip(samples.channels, CHANNELS, strict=True):
        check_enough(data, name)
    check_order(samples)
    priors = priors or [published_prior()] * 3
    given = samples.log2_times
    times, wrong = given.copy(), dict[int, float]()
    nominal = tuple(float(t) for t in np.exp2(given))
    fits, evidence = _quick(samples, times, priors)
    for _ in range(_REFINE if free_times else 0):
        estimate = shutter.estimate_times(evidence, nominal, fitted=times)
        if not estimate.off_rule:
            break
        times = np.log2(np.array(estimate.times_s))
        fits, evidence = _quick(samples, times, priors)
    while len(wrong) < _MOST_WRONG and (found := shutter.find_wrong_time(evidence, wrong)) is not None:
        wrong[found[0]] = 0.0
        times[found[0]] += found[1]
        for _ in range(_REFINE):
            fits, evidence = _quick(samples, times, priors)
            times += shutter.refine_times(evidence, tuple(wrong))
    check_consistent(samples, evidence, wrong, times - given, sloppy=shutter.SLOPPY_STOPS if free_times else 0.0)
    estimate = shutter.estimate_times(evidence, nominal, fitted=times, known=tuple(wrong))
    if free_times:
        times = np.log2(np.array(estimate.times_s))
    for number in range(3):
        fits = [_settled(data, times, priors[c], fits[c], c) for c, data in enumerate(samples.channels)]
        evidence = _evidence(fits, samples.channels, samples)
        estimate = shutter.estimate_times(evidence, nominal, fitted=times, known=tuple(wrong))
        if number == 2 or not (wrong or (free_times and estimate.off_rule)):
            break
        times = np.log2(np.array(estimate.times_s)) if free_times else times
        times = times + shutter.refine_times(evidence, tuple(wrong))
    wrong = {frame: float(times[frame] - given[frame]) for frame in wrong}
    return DaylitFit((fits[0], fits[1], fits[2]), times, evidence, wrong, estimate)


def _quick(samples: Samples, times: Doubles, priors: Sequence[CurvePrior]) -> tuple[list[ChannelFit], TimeEvidence]:
    """Return rough fits to some of the patches, and what they say about the times."""
    fits, parts = [], [every.part(_QUICK_PATCHES) for every in samples.channels]
    for c, data in enumerate(parts):
        found = fit_round(data, times, priors[c], None, c, times_too=False)
        for number in range(_QUICK_ROUNDS):
            found = fit_round(data, times, priors[c], found, c, times_too=number == _QUICK_ROUNDS - 1)
        fits.append(found)
    return fits, _evidence(fits, parts, samples)


def _settled(data: ChannelSamples, times: Doubles, prior: CurvePrior, before: ChannelFit, channel: int) -> ChannelFit:
    """Return the fit of all patches once it no longer changes; curve and noise hang on each other."""
    found = before
    for _ in range(_MOST_ROUNDS):
        last, found = found, fit_round(data, times, prior, found, channel, final=True, times_too=False)
        change = (found.log2 - found.log2[128]) - (last.log2 - last.log2[128])
        if np.abs(change[found.low : found.high]).max() < _SETTLED_STOPS:
            break
    found = fit_round(data, times, prior, found, channel, final=True)
    return replace(found, left_out=_frames_left_out(data.part(_QUICK_PATCHES), times, prior, found))


def _frames_left_out(data: ChannelSamples, times: Doubles, prior: CurvePrior, fit: ChannelFit) -> Doubles:
    """Return the change of the curve (F, 256) in stops when each frame is left out, as the jackknife takes it.

    What moves a whole frame alike (its time, clouds, tone mapping, coding) is no noise of patches: it shows only so."""
    fine = FineCurve.of(fit.log2)
    found = weigh(data, fine, times, fit.noise)
    weight, _ = _robust(data, found, final=True)
    fixed = replace(prior, candidates=tuple(c for c in prior.candidates if c[:2] == fit.solution.strength))
    rows = spline_basis().codes - spline_basis().codes[_MIDDLE]
    changes = []
    for frame in range(len(times)):
        kept = np.where(data.frame == frame, 0.0, weight)
        seen = np.add.reduceat((kept > 0).astype(np.float64), data.starts)[data.sample]
        eq = equations(data, fine, times, found, np.where(seen > 1, kept, 0.0), times=False)
        changes.append(solve(eq, fit.coefficients, fixed).change)
    apart = np.array(changes) - np.mean(changes, axis=0)
    return np.asarray(((len(times) - 1) / len(times)) ** 0.5 * apart @ rows.T)


def _evidence(fits: Sequence[ChannelFit], data: Sequence[ChannelSamples], samples: Samples) -> TimeEvidence:
    scales = [max(fit.solution.scale2, 1.0) for fit in fits]
    matrix = np.sum([fit.solution.time_matrix / s for fit, s in zip(fits, scales, strict=True)], axis=0)
    right = np.sum([fit.solution.time_right / s for fit, s in zip(fits, scales, strict=True)], axis=0)
    # Which frames show enough patches clear of black to say anything of their times. Near black the cut-off noise and
    # a JPEG's coding shift codes by what many stops of time would: a frame that is all but black, a few patches
    # around the sun apart, would seem to have another time.
    n_frames = len(samples.log2_times)
    count = np.zeros(n_frames)
    for fit, seen in zip(fits, data, strict=True):
        clear = (fit.weighed.weight > 0) & (fit.weighed.predicted >= _CLEAR_OF_BLACK)
        count += np.bincount(seen.frame[clear], minlength=n_frames)
    silent = ~np.asarray(count >= _LEAST_CLEAR_PATCHES)
    matrix[silent], matrix[:, silent], right[silent] = 0.0, 0.0, 0.0
    return TimeEvidence(matrix, right, samples.bracket_of_frame)


def fit_round(
    data: ChannelSamples,
    log2_times: Doubles,
    prior: CurvePrior,
    before: ChannelFit | None,
    channel: int,
    *,
    final: bool = False,
    times_too: bool = True,
) -> ChannelFit:
    """Improve a channel's fit (or begin one) by one solution; ``final``: patches that moved are left out.

    ``log2_times``: (F,) log2 of seconds.
    """
    basis = spline_basis()
    start, coefficients = (prior.start, np.zeros(N_BASIS)) if before is None else (before.log2, before.coefficients)
    fine, noise = FineCurve.of(start), PatchNoise()
    if before is not None:
        mean = fit_noise(data, fine, log2_times, least_code_variance=_MEAN_LEAST)
        pixel = fit_noise(data, fine, log2_times, least_code_variance=_PIXEL_LEAST, pixels=5 if final else 1)
        noise = PatchNoise(mean or before.noise.mean, pixel or before.noise.pixel)
    found = weigh(data, fine, log2_times, noise)
    weight, kept = _robust(data, found, final=final)
    if final:
        weight = weight / dispersion(data, found, weight)
    low, high = support(found.predicted[weight > 0], CHANNELS[channel], prior.least_codes)
    # Of a patch's nine pixels: noise that processing has spread over them is not averaged out by them.
    alone = min(1.0, noise.pixel.code / (PATCH_PX**2 * noise.mean.code))
    solution = solve(equations(data, fine, log2_times, found, weight, times=times_too), coefficients, prior, alone)
    held = 1.0
    if final and times_too:
        held = _held_out(data, fine, log2_times, (found, weight), coefficients, prior)
    coefficients = coefficients + solution.change
    slope = np.maximum(np.diff(prior.start + basis.codes @ coefficients), _LEAST_SLOPE)
    log2 = np.concatenate([[0.0], np.cumsum(slope)])
    used = kept & (found.weight > 0)
    return ChannelFit(log2 - log2[255], coefficients, noise, solution, low, high, found, used, held_out=held)


def _held_out(
    data: ChannelSamples,
    fine: FineCurve,
    log2_times: Doubles,
    seen: tuple[Weighed, Doubles],
    coefficients: Doubles,
    prior: CurvePrior,
) -> float:
    """Return chi-squared a degree of freedom of each half of the patches under the curve of the other half."""
    found, weight = seen
    odd = data.sample % 2 == 1
    halves = [equations(data, fine, log2_times, found, np.where(odd == k, weight, 0.0), times=False) for k in (0, 1)]
    misfit = [b.misfit(solve(a, coefficients, prior).change) for a, b in (halves, halves[::-1])]
    return sum(misfit) / max(sum(half.count for half in halves), 1.0)


def check_consistent(
    samples: Samples, evidence: TimeEvidence, wrong: dict[int, float], off: Doubles, sloppy: float
) -> None:
    """Refuse frames of which so many contradict their times that none can be believed.

    ``off``: (F,) stops by which times were changed so far; ``sloppy``: up to so many it is the shutter, and all times
    are estimated.
    """
    more = shutter.find_wrong_time(evidence)
    if more is None and len(wrong) <= len(off) / 3:
        return
    if max(np.abs(off).max(), 0.0 if more is None else abs(off[more[0]] + more[1])) <= sloppy:
        return
    named = [samples.names[frame] for frame in sorted({*wrong, *([more[0]] if more else [])})]
    text = f"the frames and their times contradict each other ({', '.join(named)} most)"
    likely = "times in another order than the frames, frames of several scenes, or light that changed"
    raise ResponseError(text, where="response", likely=likely, advice="check that each frame has its own time")


def check_order(samples: Samples) -> None:
    """Refuse frames that do not grow brighter with their times, or are all too far apart to give a curve."""
    gaps = [
        np.diff(np.unique(samples.log2_times[samples.bracket_of_frame == bracket]))
        for bracket in np.unique(samples.bracket_of_frame)
    ]
    steps = np.concatenate(gaps)
    steps = steps[steps > _SAME_TIME]
    if not steps.size and len(samples.log2_times) > 1:
        text = "all frames have one exposure time"
        likely = "times that were not read, or a burst instead of a bracket"
        raise ResponseError(text, where="response", likely=likely, advice="give each frame its own time")
    if steps.size and steps.min() > _WIDEST_STOPS:
        text = f"all frames are {steps.min():.1f} stops apart or more"
        advice = f"give frames at most {_WIDEST_STOPS:g} stops apart, or use a profile's curve"
        raise ResponseError(text, where="response", likely="a bracket with most of its stops missing", advice=advice)
    data = samples.channels[1]
    if data.n_samples == 0:
        return
    order = np.lexsort((samples.log2_times[data.frame], data.sample))
    same = np.diff(data.sample[order]) == 0
    longer = np.diff(samples.log2_times[data.frame[order]]) > _SAME_TIME
    rises = np.diff(data.mean[order])[same & longer]
    if rises.size >= _LEAST_SAMPLES and float(np.mean(rises > 0)) < _LEAST_RISING:
        text = "frames do not grow brighter with their exposure times"
        likely = "times in another order than the frames, or one picture several times"
        raise ResponseError(text, where="response", likely=likely, advice="check that each frame has its own time")


def check_enough(data: ChannelSamples, name: str) -> None:
    """Refuse samples from which no curve can be recovered."""
    if data.n_samples >= _LEAST_SAMPLES:
        return
    text = f"only {data.n_samples} patches are seen neither clipped nor dark in two frames"
    likely = "one frame, all frames clipped or all dark, or stops too far apart"
    advice = "give a bracket of at least three exposures, at most four stops apart, of a scene with light and shade"
    raise ResponseError(text, where=f"response, {name}", likely=likely, advice=advice)


def _robust(data: ChannelSamples, found: Weighed, *, final: bool) -> tuple[Doubles, Flags]:
    """Return weights without the patches that moved; in the first rounds the curve or a time may be what is off."""
    used = found.weight > 0
    if not used.any():
        return found.weight, used
    size = np.abs(found.standard)
    scale = max(1.4826 * float(np.median(size[used])), 1.0)
    worst = np.maximum.reduceat(size, data.starts)[data.sample] / scale
    if not final:
        return found.weight * np.minimum(1.0, _BOUNDED / np.maximum(worst, _BOUNDED)), used
    still = worst <= _OUTLIER
    return np.where(still, found.weight, 0.0), still


def support(predicted: Doubles, name: str, least_codes: int = LEAST_CODES) -> tuple[int, int]:
    """Return the lowest and highest code near which the data say enough. ``predicted``: (N,) codes, 0..255."""
    count = np.bincount(np.clip(np.rint(predicted), 0, 255).astype(np.int64), minlength=256)
    seen = np.flatnonzero(np.convolve(count, np.ones(5), mode="same") >= _LEAST_NEAR)
    if seen.size < least_codes:
        text = f"the frames show only {seen.size} different codes"
        likely = "a scene that is even all over, or in which little is smooth, or a bracket of few exposures"
        advice = "use a bracket of a scene with light and shade, or a profile's curve"
        raise ResponseError(text, where=f"response, {name}", likely=likely, advice=advice)
    return int(max(seen[0], np.ceil(FIRST_CODE))), int(min(seen[-1], np.floor(LAST_CODE)))
