"""A camera's response curve and noise from one bracket or several, and whether those of its profile still hold."""

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace

import numpy as np

from processing.calibration.response.bracket_fit import ChannelFit, DaylitFit, check_enough, fit_daylit
from processing.calibration.response.curve import (
    CodeNoise,
    FineCurve,
    NoiseModel,
    PatchNoise,
    ResponseCurve,
    fit_noise,
    three,
)
from processing.calibration.response.fit import spline_basis, weigh
from processing.calibration.response.prior import (
    FEW_CODES,
    LEAST_CODES,
    CurvePrior,
    drift_prior,
    published_prior,
    tied_prior,
)
from processing.calibration.response.samples import CHANNELS, Bracket8, Samples, take_samples
from processing.calibration.response.shutter import RULE_SIGMA_STOPS, ShutterRule
from processing.errors import ResponseError
from processing.ground.arrays import Doubles, Int64s

WHITE_CODE, MIDDLE_CODE = 255, 128
"""A bracket gives the curve of each channel but for a factor. We choose exposure 1 at code 255, where the curve is
continued by a few codes: cameras balance their channels so that a saturated sensor comes out white. Of the gauges
measured on simulated cameras whose channels have tone curves of their own it keeps colours best
(docs/reference/calibration.md). Where the frames come nowhere near white the gauge is code 128."""
LEAST_HIGH = 235
"""Code that the frames must reach in all channels for the white gauge; chosen: 20 codes of extrapolation at most."""
_PIXELS = 9  # of each patch, all, to estimate the noise of single pixels
_ROUNDING = 1 / 12  # squared codes: the variance of rounding to whole codes
MODEL_CODES = 0.25
"""Of the standard deviation of one pixel's coding: how far a smooth curve may be from the camera's mean code (kinks of
the tone curve, coders that drop what is small). Measured on published curves left out of the prior."""
INFLATION = 1.2
"""Of the fit's own uncertainty: no camera's curve is drawn from the published ones. Measured on the same curves:
without it 2 sigmas cover 80 % of the codes."""
MODES = 6  # of a channel's curve; chosen: 99 % of its variance
BIN_CODES = 8  # codes a bin of the residuals; chosen
FIRST, LAST = 20, 235  # codes over which two curves are compared; chosen: clear of black and of white
LEAST_DRIFT_STOPS = 0.02  # a drift below is of no consequence: 1.4 % of light
CLIP_CELLS, CLIP_PATCHES = 16, 20  # of the code, and patches of either kind that a cell needs; chosen
CLIP_STOPS, CLIP_SIGMAS, CLIP_SHARE = 0.02, 4.0, 0.2
"""Stops and standard deviations by which the two kinds are apart in such a share of what can be compared; chosen on
simulated cameras with and without a 5D Mark II's matrix, as what follows."""
CLIP_CURVE = 0.5
"""Of what the clear samples leave uncertain of the curve, by which the kinds may be apart; chosen: with 1 a Canon T2i's
matrix is missed, with 0.3 films without one are taken to have it."""
CLIP_MANY, CLIP_KNOWN = 0.05, 0.05
"""Share of all samples that bends the curve, and what share of them must be comparable to be believed: under warm light
0.03 are at most, on a film's frames that show it 0.07."""
LEAST_SCATTER_STOPS = 0.01  # of a shutter; chosen: half the tolerance, however well it kept to it in a few sessions
_SIGNIFICANT = 3.0  # standard deviations that a drift must exceed; chosen


@dataclass(frozen=True)
class ResponseFit:
    """What a bracket says of its camera."""

    curve: ResponseCurve
    noise: NoiseModel
    """Of single pixels, in the curve's gauge."""
    times_s: tuple[float, ...]
    """Of all frames of all brackets, in order: as given, or estimated."""
    time_sigma: tuple[float, ...]
    """Relative standard uncertainty of each time; 0 where it was taken as given."""
    warnings: tuple[str, ...] = ()
    wrong_times: dict[int, float] = field(default_factory=dict)
    """Frame: stops by which the time given for it is off."""
    scatter_stops: float = RULE_SIGMA_STOPS
    """Standard deviation of the frames' times about their rule, as far as the frames show it."""


def recover_response(
    brackets: Sequence[Bracket8], *, estimate_times: bool = False, prior: CurvePrior | None = None
) -> ResponseFit:
    """Return curve and noise of the camera that took ``brackets``; ``prior`` None: that of any camera.

    ``estimate_times``: times are nominal; the rule behind them is chosen by what the frames say. A frame whose time
    contradicts all others gets the time that they imply, with a warning.

    Raises `ResponseError`: frames from which no curve can be recovered; `BracketError`: frames that are no bracket.
    """
    samples = take_samples(brackets)
    samples, fit, together = _fitted(samples, None if prior is None else [prior] * 3, free_times=estimate_times)
    channels = fit.channels
    low, high = zip(*((one.low, one.high) for one in channels), strict=True)
    gauge = WHITE_CODE if min(high) >= LEAST_HIGH else MIDDLE_CODE
    sigma = np.stack([curve_sigma(one, MIDDLE_CODE) for one in channels])
    sizes = np.concatenate([np.abs(fit.weighed.residual[fit.kept]) for fit in channels])
    curve = ResponseCurve(
        np.stack([one.log2 - one.log2[gauge] for one in channels]),
        sigma,
        three(low),
        three(high),
        gauge_code=gauge,
        sigma_code=MIDDLE_CODE,
        balance_sigma=three(sigma[:, gauge].tolist()),
        n_samples=sum(data.n_samples for data in samples.channels),
        residual_stops=1.4826 * float(np.median(sizes)) if sizes.size else 0.0,
        modes=_curve_modes(channels),
        clip_together=together,
        held_out=tuple(one.held_out for one in channels),
        prior_strength=tuple(one.solution.strength for one in channels),
    )
    times = tuple(float(t) for t in np.exp2(fit.log2_times))
    return ResponseFit(
        curve,
        _noise_model([one.noise.pixel for one in channels], [float(np.exp2(-one.log2[gauge])) for one in channels]),
        times,
        fit.estimate.sigma if estimate_times else tuple(0.0 for _ in times),
        _warnings(samples, fit, gauge, free_times=estimate_times),
        fit.wrong_times,
        _scatter_stops(samples, fit),
    )


def _scatter_stops(samples: Samples, fit: DaylitFit) -> float:
    """Return by how much the shutter scatters about the times given, or may: what frames leave open counts too."""
    if fit.estimate.off_rule:
        return float(np.std(np.log2(fit.estimate.times_s) - samples.log2_times))
    known = [sigma for sigma in fit.estimate.sigma if sigma > 0]
    return max(float(np.median(known)) / math.log(2.0), LEAST_SCATTER_STOPS) if known else RULE_SIGMA_STOPS


def _fitted(
    samples: Samples, priors: Sequence[CurvePrior] | None, *, free_times: bool
) -> tuple[Samples, DaylitFit, bool]:
    """Return the samples that count, their fit, and whether those with any clipped channel are left out."""
    red, green, blue = (data.only(data.clear) for data in samples.channels)
    clear = replace(samples, channels=(red, green, blue))
    priors = priors or [published_prior()] * 3
    # Where too little is clear of the end, a curve that some samples bend is better than none.
    with suppress(ResponseError):
        few = [replace(prior, least_codes=FEW_CODES) for prior in priors]
        fit = fit_daylit(clear, free_times=free_times, priors=few)
        if clip_together(samples, fit):
            return clear, _tied(clear, fit, priors, free_times=free_times), True
    return samples, fit_daylit(samples, free_times=free_times, priors=priors), False


def _tied(samples: Samples, fit: DaylitFit, priors: Sequence[CurvePrior], *, free_times: bool) -> DaylitFit:
    """Return the fit with channels that are not seen near white held to the one that is seen farthest up.

    Under coloured light the weaker channels' upper codes are seen only where another channel is clipped. What is unsure
    of the one is so of those held to it, together."""
    best = max(fit.channels, key=lambda one: one.high)
    if best.high - best.low < LEAST_CODES:
        raise ResponseError("no channel shows enough codes where no other is clipped", where="response")
    short = [one.high < min(LEAST_HIGH, best.high) for one in fit.channels]
    if not any(short):
        return fit
    held = [tied_prior(best.log2) if tie else prior for tie, prior in zip(short, priors, strict=True)]
    fit = fit_daylit(samples, free_times=free_times, priors=held)
    doubt = np.concatenate([_own_modes(best), best.left_out])
    red, green, blue = (
        replace(one, high=best.high if tie else one.high, left_out=np.concatenate([one.left_out, tie * doubt]))
        for tie, one in zip(short, fit.channels, strict=True)
    )
    return replace(fit, channels=(red, green, blue))


def clip_together(samples: Samples, fit: DaylitFit) -> bool:
    """Return whether a channel's codes may be others where another channel is clipped: the camera mixes its channels.

    Cameras bring their own colours to sRGB by a matrix after their wells have saturated. Samples with a clipped channel
    must agree with ``fit``, to those without, about the light of the same patches, as far as it knows the curve there;
    where they are many and too few can be compared, they are not believed.
    """
    rows, every = [], 0
    for data, one in zip(samples.channels, fit.channels, strict=True):
        seen = weigh(data, FineCurve.of(one.log2), fit.log2_times, one.noise)
        weight = np.where(data.clear, seen.weight, 0.0)
        total = np.maximum(np.add.reduceat(weight, data.starts), 1e-300)
        light = (np.add.reduceat(weight * seen.residual, data.starts) / total)[data.sample]
        share = weight / total[data.sample]  # of a sample in its own patch's light, which is no comparison
        off = (seen.residual - light) / np.maximum(1 - share, 1e-3)
        known = (seen.weight > 0) & (total[data.sample] > weight) & (data.mean >= one.low) & (data.mean <= one.high)
        cell = data.frame * CLIP_CELLS + (seen.predicted * (CLIP_CELLS / 256)).astype(np.int64)
        every += int(np.count_nonzero(~data.clear))
        curve = CLIP_CURVE * curve_sigma(one, MIDDLE_CODE)[256 // CLIP_CELLS // 2 :: 256 // CLIP_CELLS]
        for k in np.unique(cell[known & ~data.clear]):
            part = off[known & ~data.clear & (cell == k)]
            beside = off[known & data.clear & (data.frame == k // CLIP_CELLS)]
            if min(part.size, beside.size) >= CLIP_PATCHES:
                middle = float(np.median(part))
                chance = 1.253 * 1.4826 * float(np.median(np.abs(part - middle))) / part.size**0.5  # of a median
                doubt = math.hypot(CLIP_SIGMAS * chance, curve[k % CLIP_CELLS])
                rows.append((abs(middle - float(np.median(beside))), doubt, part.size))
    apart, doubts, count = np.array(rows or [(0.0, 0.0, 0)]).T
    clear = (apart > CLIP_STOPS) & (apart > doubts)
    many = every > CLIP_MANY * sum(data.mean.size for data in samples.channels)
    return bool((many and count.sum() < CLIP_KNOWN * every) or count[clear].sum() > CLIP_SHARE * count.sum())


def estimate_noise(brackets: Sequence[Bracket8], curve: ResponseCurve) -> NoiseModel:
    """Return photon, read and code noise (of coding too: JPEG) of single pixels under a known curve.

    Raises `ResponseError`: too few patches; `BracketError`: frames that are no bracket.
    """
    samples = take_samples(brackets)
    for data, name in zip(samples.channels, CHANNELS, strict=True):
        check_enough(data, name)
    found = [
        fit_noise(data, FineCurve.of(log2), samples.log2_times, least_code_variance=_ROUNDING, pixels=_PIXELS)
        for data, log2 in zip(samples.channels, curve.log2_exposure, strict=True)
    ]
    return _noise_model([one or CodeNoise(0.0, 0.0, 1.0) for one in found])


def _noise_model(channels: Sequence[CodeNoise], gauge: Sequence[float] = (1.0, 1.0, 1.0)) -> NoiseModel:
    """Return the channels' noise; ``gauge``: their exposures in the curve's unit over those in their own."""
    return NoiseModel(
        three([by * one.photon for by, one in zip(gauge, channels, strict=True)]),
        three([by * one.read2**0.5 for by, one in zip(gauge, channels, strict=True)]),
        three([one.code for one in channels]),
    )


def _warnings(samples: Samples, fit: DaylitFit, gauge: int, *, free_times: bool) -> tuple[str, ...]:
    """Say what is odd about the frames."""
    found = [f"{samples.names[j]} is the same picture as an earlier one: left out" for j in samples.duplicates]
    for j, stops in fit.wrong_times.items():
        found.append(
            f"{samples.names[j]}: its time {samples.given_s[j]:.6g} s contradicts the other frames by {stops:+.2f} "
            f"stops; {np.exp2(fit.log2_times[j]):.6g} s is used"
        )
    estimate = fit.estimate
    if free_times and estimate.off_rule:
        off = _scatter_stops(samples, fit)
        found.append(f"the shutter scatters about its times by {off:.2f} stops: all are estimated from the frames")
    if not free_times and estimate.decided and estimate.rule is not ShutterRule.NOMINAL:
        chi2 = estimate.chi2[ShutterRule.NOMINAL]
        found.append(f"the frames fit the shutter rule '{estimate.rule}' better than the times given (chi2 {chi2:.0f})")
    if gauge != WHITE_CODE:
        found.append("no frame comes near white: the channels are balanced at code 128, and colours are less sure")
    return tuple(found)


def curve_sigma(fit: ChannelFit, gauge: int) -> Doubles:
    """Return the standard uncertainty in stops, shape (256,), 0 at the gauge code: of fit and model."""
    rows = spline_basis().codes - spline_basis().codes[gauge]
    covered = np.einsum("zi,ij,zj->z", rows, fit.solution.covariance, rows)
    covered = np.maximum(covered, 0.0) * INFLATION**2 * max(fit.held_out, fit.solution.scale2, 1.0)
    slope = np.gradient(fit.log2)
    model = (MODEL_CODES * slope) ** 2 * fit.noise.pixel.code
    sigma = np.sqrt(covered + model + model[gauge])
    sigma = np.hypot(sigma, np.sqrt(np.square(fit.left_out - fit.left_out[:, gauge : gauge + 1]).sum(axis=0)))
    sigma[gauge] = 0.0
    return np.asarray(sigma)


def _curve_modes(channels: Sequence[ChannelFit]) -> Doubles:
    """Return the largest independent errors (M, 3, 256) of the curves in stops, 0 at the middle code.

    Of each channel's fit by itself; and of all channels together what one frame decides."""
    found = [np.eye(3)[c][:, None] * alone for c, fit in enumerate(channels) for alone in _own_modes(fit)]
    return np.array([*found, *np.stack([fit.left_out for fit in channels], axis=1)])


def _own_modes(fit: ChannelFit) -> Doubles:
    """Return the largest independent errors of a channel's fit by itself in stops, of shape (`MODES`, 256)."""
    rows = spline_basis().codes - spline_basis().codes[MIDDLE_CODE]
    scale = INFLATION**2 * max(fit.held_out, fit.solution.scale2, 1.0)
    size, ways = np.linalg.eigh(scale * fit.solution.covariance)
    alone = (rows @ (ways * np.sqrt(np.maximum(size, 0)))).T
    largest = np.argsort(-np.square(alone[:, FIRST : LAST + 1]).sum(axis=1))[:MODES]
    return np.asarray(alone[largest])


@dataclass(frozen=True)
class CodeResiduals:
    """Residuals in stops by code: what a patch's light is in one frame less what its other frames say."""

    codes: Doubles
    """(32,) middle of each bin of 8 codes."""
    mean_stops: Doubles
    """(3, 32): 0 for a right curve; NaN never: 0 where `count` is 0."""
    spread_stops: Doubles
    """(3, 32) robust standard deviation of one patch."""
    count: Int64s
    """(3, 32) patches."""


def residuals_by_code(samples: Samples, curve: ResponseCurve) -> CodeResiduals:
    """Return the residuals of samples under a curve."""
    n_bins = 256 // BIN_CODES
    mean, spread = np.zeros((3, n_bins)), np.zeros((3, n_bins))
    count = np.zeros((3, n_bins), dtype=np.int64)
    for c, data in enumerate(samples.channels):
        if data.n_samples == 0:
            continue
        found = weigh(data, FineCurve.of(curve.log2_exposure[c]), samples.log2_times, PatchNoise())
        used = found.weight > 0
        bins = np.minimum(found.predicted[used] / BIN_CODES, n_bins - 1).astype(np.int64)
        residual = found.residual[used]
        count[c] = np.bincount(bins, minlength=n_bins)
        for b in np.flatnonzero(count[c]):
            mine = residual[bins == b]
            mean[c, b] = np.median(mine)
            spread[c, b] = 1.4826 * np.median(np.abs(mine - mean[c, b]))
    return CodeResiduals((np.arange(n_bins, dtype=np.float64) + 0.5) * BIN_CODES, mean, spread, count)


@dataclass(frozen=True)
class ResponseCheck:
    """The difference of a session's own curve from the profile's over codes 20..235, free of its mean."""

    drift_stops: float
    """Root mean square difference of the channel that differs most."""
    sigma_stops: float
    """Root mean square of the uncertainty that both curves state."""
    drifted: bool
    noise_ratio: float
    """Relative noise of the session's pixels at middle codes over the profile's: settings or light may differ."""
    warnings: tuple[str, ...] = ()


def check_response(curve: ResponseCurve, noise: NoiseModel, bracket: Bracket8) -> ResponseCheck:
    """Compare a session's own curve and noise with its camera's profile; frames decoded at 1/8 of their size will do.

    The session's curve is fitted as a smooth change of the profile's, so that codes which the session does not show
    add nothing.

    Raises `ResponseError`: frames with too few patches or codes; `BracketError`: frames that are no bracket.
    """
    samples = take_samples([bracket])
    fit = fit_daylit(samples, free_times=False, priors=[drift_prior(known) for known in curve.log2_exposure])
    drifts, sigmas, ratios = [], [], []
    for c, own in enumerate(fit.channels):
        seen = np.arange(max(FIRST, own.low, curve.low[c]), min(LAST, own.high, curve.high[c]) + 1)
        change = (own.log2 - curve.log2_exposure[c])[seen]
        change = change - change.mean()
        sigma = np.hypot(curve_sigma(own, int(seen[len(seen) // 2])), curve.sigma_log2[c])[seen]
        drifts.append(float(np.sqrt((change**2).mean())))
        sigmas.append(float(np.sqrt((sigma**2).mean())))
        # The ratio of relative standard deviations at code 128
        x = float(curve.exposure[c, 128])
        slope = float(curve.log2_slope[c, 128] * np.log(2.0))
        now = own.noise.pixel.photon / x + own.noise.pixel.code * slope**2
        then = noise.photon[c] / x + noise.code_variance[c] * slope**2
        ratios.append(float(np.sqrt(now / max(then, 1e-12))))
    worst = int(np.argmax([d / s for d, s in zip(drifts, sigmas, strict=True)]))
    drift, sigma_ = drifts[worst], sigmas[worst]
    drifted = drift > max(LEAST_DRIFT_STOPS, _SIGNIFICANT * sigma_)
    warnings = (f"the camera's response drifted by {drift:.3f} stops (uncertainty {sigma_:.3f})",) if drifted else ()
    return ResponseCheck(drift, sigma_, drifted, float(np.median(ratios)), warnings)
