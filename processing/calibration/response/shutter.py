"""How long a shutter really opens: the powers of two behind the times engraved on dials.

1/60 s stands for 2^-6 s and 13 s for 2^(11/3) s; taken as written they are up to 0.09 stop off. Which of both a camera
means is in its row of `CAMERA_RULES`, or follows from the bracket itself, whose frames overlap.
"""

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

import numpy as np

from processing.errors import ParameterError
from processing.ground.arrays import Doubles, Int64s
from processing.ground.tables import table_of

RULE_SIGMA_STOPS = 0.02  # how far a shutter may be from its rule: 1.4 %
LONGEST_DIAL_S = 30.0  # of dials in stops, halves or thirds; really 32 s
WRONG_STOPS = 0.12
"""A time that is off by more is none of a shutter's tolerance but a wrong entry: a third of a stop is the next dial."""
_CLEAR_CHI2 = 100.0
"""Gain in chi2 that a wrong time must explain: patches are many, the curve is smooth, small misfits are certain."""
_DECISIVE_CHI2 = 10.0  # chosen: odds of 150 to 1
_TOLERANCES_STOPS = (RULE_SIGMA_STOPS, 0.05, 0.1, 0.17, 0.3)  # chosen: of good shutters to worn ones
_SCATTERED = 5.0  # natural log of the odds that a scatter needs, 150 to 1; chosen
SLOPPY_STOPS = 0.67
"""Of single times, by a shutter that is off in most frames; chosen: four times a bad one's sixth of a stop."""
_STIFF = 1e3  # chosen: holds what frames cannot show
_LITTLE = 0.05  # of the largest information on a time; chosen
_SAME_STOPS = 1e-6  # rounding error
_LEAST_FRAMES = 4  # of one bracket: two or three frames fit any times with a curve to match


class ShutterRule(StrEnum):
    """What true time stands behind a nominal one."""

    NOMINAL = "nominal"
    """The time as written."""
    THIRDS = "thirds"
    """2^(k/3) s: cameras that step in thirds of a stop or in whole stops."""
    HALVES = "halves"
    """2^(k/2) s: cameras set to half stops (1/45, 1/90, 0.7 s)."""


def camera_rule(model: str) -> ShutterRule | None:
    """Return the rule of a camera model as EXIF names it, or None where `shutter.toml` does not have it."""
    rule = table_of(__package__, "shutter")["rules"].get(model.strip().lower())
    return None if rule is None else ShutterRule(rule)


def true_time_s(nominal_s: float, rule: ShutterRule) -> float:
    """Return the time behind a nominal one; above `LONGEST_DIAL_S` that itself, as no dial has it: it was counted.

    Raises `ParameterError`: a time that is not a positive number.
    """
    if not (math.isfinite(nominal_s) and nominal_s > 0):
        raise ParameterError(f"{nominal_s} is not an exposure time", advice="give seconds above 0")
    steps = {ShutterRule.NOMINAL: 0, ShutterRule.THIRDS: 3, ShutterRule.HALVES: 2}[rule] * (nominal_s <= LONGEST_DIAL_S)
    return float(nominal_s) if steps == 0 else float(2.0 ** (round(steps * math.log2(nominal_s)) / steps))


@dataclass(frozen=True)
class TimeEvidence:
    """What patches say about the log2 times, the curve and the patches' light eliminated.

    Changing the log2 times by d (stops) changes chi2 by ``d @ matrix @ d - 2 right @ d``.
    """

    matrix: Doubles
    right: Doubles
    bracket_of_frame: Int64s

    def gain(self, change: Doubles) -> float:
        """Return by how much chi2 falls with a change of the log2 times. ``change``: (F,) stops."""
        return float(2 * self.right @ change - change @ self.matrix @ change)


@dataclass(frozen=True)
class TimeEstimate:
    """Times estimated from the frames themselves."""

    times_s: tuple[float, ...]
    sigma: tuple[float, ...]
    """Relative standard uncertainty; 0 for each bracket's middle time, to which the others are relative."""
    rule: ShutterRule
    chi2: dict[ShutterRule, float]
    """Of each rule, more than that of the best."""
    decided: bool
    """Whether the frames distinguish the rules; where not, ``rule`` is the prior one."""
    off_rule: bool
    """Whether the shutter scatters by more than its tolerance; then all times are the estimated ones."""


def estimate_times(
    evidence: TimeEvidence,
    times_s: Sequence[float],
    *,
    fitted: Doubles | None = None,
    known: Sequence[int] = (),
    prior: ShutterRule = ShutterRule.NOMINAL,
) -> TimeEstimate:
    """Choose the rule that the frames fit best; leave it where they clearly say so.

    ``times_s`` are nominal; ``fitted``: log2 of the times that the evidence is about, if others; ``known``: frames
    whose time is not by any rule, and stays as fitted. ``fitted``: (F,) log2 of seconds.
    """
    now = np.log2(np.asarray(times_s, dtype=np.float64)) if fitted is None else fitted
    by_rule = {rule: np.log2([true_time_s(t, rule) for t in times_s]) - now for rule in ShutterRule}
    for change in by_rule.values():
        change[list(known)] = 0.0
    chi2 = {rule: -evidence.gain(change) for rule, change in by_rule.items()}
    best = min(chi2, key=lambda rule: chi2[rule])
    # Rules that give these frames the same times are one.
    others = [r for r in ShutterRule if np.abs(by_rule[r] - by_rule[best]).max() > _SAME_STOPS]
    decided = bool(others) and min(chi2[r] for r in others) - chi2[best] > _DECISIVE_CHI2
    decided &= bool(np.bincount(evidence.bracket_of_frame).max() >= _LEAST_FRAMES)
    rule = best if decided and chi2[prior] - chi2[best] > _DECISIVE_CHI2 else prior
    extra, covariance, _ = _off_rule(evidence, by_rule[rule], now, np.full(len(now), RULE_SIGMA_STOPS))
    total, doubt = now + by_rule[rule], extra  # what the frames would change and is not changed
    if scatter := _scatter(evidence, now, by_rule.values()):
        change, (extra, covariance, _), tolerance = scatter
        total = now + change + extra
        # The slope that scattered times have by chance
        doubt = tolerance / max(float(np.linalg.norm(now - now.mean())), 1.0) * (now - np.median(now))
    sigma = np.hypot(np.sqrt(np.diag(covariance)), doubt) * math.log(2.0)
    return TimeEstimate(
        tuple(float(t) for t in np.exp2(total)),
        tuple(float(s) for s in sigma),
        rule,
        {name: round(value - chi2[best], 3) for name, value in chi2.items()},
        decided,
        scatter is not None,
    )


class _OffRule(NamedTuple):
    """How far times are off their rule, in stops."""

    extra: Doubles
    covariance: Doubles
    likely: float
    """Logarithm of the likelihood of rule and tolerance, the times integrated out (restricted maximum likelihood)."""


def _scatter(
    evidence: TimeEvidence, now: Doubles, rules: Collection[Doubles]
) -> tuple[Doubles, _OffRule, float] | None:
    """Return the rule's change, what times are off it, and the scatter in stops of a shutter that clearly scatters.

    Changes by the ``rules`` (F,) are all tried: what scatters may look like any. One time that is off by any amount is
    an entry's fault, and no shutter's. Two or three frames of a bracket that say something fit any times with a curve.
    """
    count = len(now)
    if np.bincount(evidence.bracket_of_frame, np.diag(evidence.matrix) > 0).max() < _LEAST_FRAMES:
        return None
    tried = [(c, _off_rule(evidence, c, now, np.full(count, t)), t) for c in rules for t in _TOLERANCES_STOPS]
    best = max(tried, key=lambda one: one[1].likely)
    ones = np.where(np.eye(count, dtype=bool), SLOPPY_STOPS, RULE_SIGMA_STOPS)
    single = max(_off_rule(evidence, change, now, one).likely for change in rules for one in ones)
    within = max(one.likely for _, one, t in tried if t == RULE_SIGMA_STOPS)
    apart = np.abs(best[1].extra - np.median(best[1].extra)).max()
    return best if best[1].likely - max(single, within) > _SCATTERED and apart < SLOPPY_STOPS else None


def _off_rule(evidence: TimeEvidence, change: Doubles, now: Doubles, tolerance: Doubles) -> _OffRule:
    """Return the most probable further change under each time's tolerance (F,) in stops, middle frames fixed."""
    count = len(now)
    free, every = np.ones(count, dtype=bool), np.diag(tolerance**-2.0)
    for bracket in np.unique(evidence.bracket_of_frame):
        mine = np.flatnonzero(evidence.bracket_of_frame == bracket)
        free[mine[np.argsort(now[mine])[mine.size // 2]]] = False
        # The middle one may be off as well: then all others are so against it.
        part = tolerance[mine] ** -2.0
        every[np.ix_(mine, mine)] -= np.outer(part, part) / part.sum()
    extra, covariance = np.zeros(count), np.zeros((count, count))
    if not free.any():
        return _OffRule(extra, covariance, evidence.gain(change) / 2)
    right = (evidence.right - evidence.matrix @ change)[free]
    inside = np.ix_(free, free)
    # All times to a common power with the curve stretched to fit look the same: that much is the rule's to say.
    # A frame that shows little counts little here, or it would make up for the stretch of all others.
    known = np.diag(evidence.matrix) / max(_LITTLE * float(np.diag(evidence.matrix).max()), 1e-300)
    known = np.where(tolerance > tolerance.min(), 0.0, np.clip(known, 1e-9, 1.0))
    stretch = (known * (now + change - np.average(now + change, weights=known)))[free]
    stiff = _STIFF * max(float(np.diag(evidence.matrix).max()), 1.0)
    prior = every[inside] + stiff * np.outer(stretch, stretch)
    whole = evidence.matrix[inside] + prior
    covariance[inside] = np.linalg.inv(whole)
    extra[free] = covariance[inside] @ right
    likely = right @ extra[free] - np.linalg.slogdet(whole)[1] + np.linalg.slogdet(prior)[1]
    return _OffRule(extra, covariance, (evidence.gain(change) + float(likely)) / 2)


def refine_times(evidence: TimeEvidence, frames: Sequence[int]) -> Doubles:
    """Return the most probable change (stops) of the times of some frames, the others held; 0 for those.

    Of shape (F,), within 2 stops.
    """
    change = np.zeros(len(evidence.right))
    chosen = list(frames)
    if chosen:
        matrix = evidence.matrix[np.ix_(chosen, chosen)]
        matrix = matrix + np.eye(len(chosen)) * (1e-9 * np.trace(matrix) + 1e-9)
        change[chosen] = np.linalg.solve(matrix, evidence.right[chosen])
    return np.clip(change, -2.0, 2.0)


def find_wrong_time(evidence: TimeEvidence, known: Collection[int] = ()) -> tuple[int, float] | None:
    """Return the frame whose time contradicts all others most, and by how many stops it is off; None if none does.

    Frames in ``known`` are not named again. Among fewer than four frames that say anything and are not in ``known``
    a wrong time looks like another curve.
    """
    own = np.diag(evidence.matrix)
    able = (own > 0) & ~np.isin(np.arange(len(own)), list(known))
    able &= (np.bincount(evidence.bracket_of_frame, able) >= _LEAST_FRAMES)[evidence.bracket_of_frame]
    if not able.any():
        return None
    change = np.where(able, evidence.right / np.where(own > 0, own, 1.0), 0.0)
    gain = change * evidence.right
    frame = int(np.argmax(gain))
    if gain[frame] < _CLEAR_CHI2 or abs(change[frame]) < WRONG_STOPS:
        return None
    return frame, float(change[frame])
