"""Which response curve, noise and times hold for a bracket: the profile's, checked on the bracket, or its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from processing.stages.contract import StageWarning

if TYPE_CHECKING:
    from processing.calibration.noise import NoiseModel
    from processing.calibration.profile import CameraProfile, RigProfile
    from processing.calibration.response_curve import ResponseCurve
    from processing.calibration.response_samples import Codes as Codes8
    from processing.stages.brackets import SideBracket

DRIFTED = "drifted"


@dataclass(frozen=True)
class CameraResponse:
    """What a merge needs of the camera, and where it comes from."""

    curve: ResponseCurve
    noise: NoiseModel
    times_s: tuple[float, ...]
    time_sigma: tuple[float, ...]
    """Relative standard uncertainty of each time."""
    source: str
    """"profile" or "recovered"."""
    times_source: str
    """"profile" (its shutter rule or measured times), the camera model's rule, or "estimated" from the bracket."""
    check: dict[str, Any]
    """How the profile's curve fits this bracket; empty for a recovered one."""
    warnings: tuple[StageWarning, ...] = ()

    def to_dict(self, bracket: SideBracket) -> dict[str, Any]:
        """Return the side's part of response.json."""
        from processing.calibration.profile_records import NoiseRecord, ResponseRecord

        rows = zip(bracket.records, self.times_s, self.time_sigma, strict=True)
        return {
            "source": self.source,
            "times_source": self.times_source,
            "times": [
                {"file": record.file, "nominal_s": record.camera_s, "time_s": time_s, "relative_uncertainty": sigma}
                for record, time_s, sigma in rows
            ],
            "check": self.check,
            "curve": ResponseRecord.of(self.curve).model_dump(mode="json"),
            "noise": NoiseRecord.of(self.noise).model_dump(mode="json"),
        }


def camera_response(
    bracket: SideBracket, codes: Sequence[Codes8], profile: RigProfile | None, method: str
) -> CameraResponse:
    """Return the profile's response where it has this camera's, else the one that the bracket tells.

    Raises `ResponseError` where neither can be had.
    """
    camera = profile.cameras.get(bracket.side) if profile else None
    if profile and camera and camera.response and camera.noise:
        return _from_profile(bracket, codes, profile, camera)
    return _recovered(bracket, codes, method)


def _recovered(bracket: SideBracket, codes: Sequence[Codes8], method: str) -> CameraResponse:
    """Take what the bracket tells; its times too, unless the camera's rule is known."""
    from processing.calibration.response import Bracket8, recover_response
    from processing.calibration.shutter import camera_rule, true_time_s

    rule = camera_rule(bracket.device.model) if bracket.device else None
    times_s = [true_time_s(nominal, rule) for nominal in bracket.nominal_s] if rule else bracket.nominal_s
    estimate = rule is None and method == "daylit"
    fit = recover_response([Bracket8(codes, times_s)], method, estimate_times=estimate)
    warnings = tuple(StageWarning(code="response", message=f"{bracket.side}: {text}"[:500]) for text in fit.warnings)
    times_source = f"rule of the camera: {rule}" if rule else "estimated" if estimate else "nominal"
    return CameraResponse(fit.curve, fit.noise, fit.times_s, fit.time_sigma, "recovered", times_source, {}, warnings)


def _from_profile(
    bracket: SideBracket, codes: Sequence[Codes8], profile: RigProfile, camera: CameraProfile
) -> CameraResponse:
    """Take the profile's curve; warn where the bracket or its settings contradict it."""
    from processing.calibration.profile import profile_matches
    from processing.calibration.response import Bracket8, check_response

    assert camera.response
    assert camera.noise
    curve, noise = camera.response.curve(), camera.noise.model()
    times_s, time_sigma = profile_times(camera, bracket.nominal_s)
    told = check_response(curve, noise, Bracket8(codes, times_s))
    warnings = [
        StageWarning(code="profile", message=text[:500])
        for text in profile_matches(profile, bracket.side, bracket.device, bracket.records)
    ]
    if told.drifted:
        text = f"{bracket.side}: the response curve is off by {told.drift_stops:.3f} stop from the profile's"
        warnings.append(StageWarning(code=DRIFTED, message=f"{text}: calibrate the rig anew"))
    check = {
        "drifted": bool(told.drifted),
        "drift_stops": float(told.drift_stops),
        "sigma_stops": float(told.sigma_stops),
    }
    return CameraResponse(curve, noise, times_s, time_sigma, "profile", "profile", check, tuple(warnings))


def profile_times(camera: CameraProfile, nominal_s: Sequence[float]) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return true times and their relative uncertainties: as measured where the profile has them, else by its rule."""
    import math

    from processing.calibration.shutter import RULE_SIGMA_STOPS, ShutterRule, true_time_s

    measured = {round(math.log2(time.nominal_s), 3): time for time in camera.shutter.times}
    times, sigmas = [], []
    for nominal in nominal_s:
        known = measured.get(round(math.log2(nominal), 3))
        times.append(known.true_s if known else true_time_s(nominal, ShutterRule(camera.shutter.rule)))
        sigmas.append((known.sigma_stops if known else RULE_SIGMA_STOPS) * math.log(2))
    return tuple(times), tuple(sigmas)
