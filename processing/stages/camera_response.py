"""Which response curve, noise and times hold for a bracket: the profile's, checked on the bracket, or its own."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from processing.errors import ResponseError
from processing.stages.brackets import SideBracket, coarse, decoded
from processing.stages.contract import StageWarning

if TYPE_CHECKING:
    from processing.calibration.profile import CameraProfile, RigProfile
    from processing.calibration.response.curve import NoiseModel, ResponseCurve
    from processing.ground.arrays import Bytes
    from processing.pictures.frames import FrameSource

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
    residuals: dict[str, Any]
    """What remains by code: see `code_residuals`."""
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
            "residuals": self.residuals,
            "curve": ResponseRecord.of(self.curve).model_dump(mode="json"),
            "noise": NoiseRecord.of(self.noise).model_dump(mode="json"),
        }


def camera_response(bracket: SideBracket, profile: RigProfile | None) -> tuple[CameraResponse, tuple[FrameSource, ...]]:
    """Return the profile's response where it has this camera's, else one recovered from the bracket; and the frames.

    The frames are in memory already where all of them were looked at. Raises `ResponseError` where no response can
    be had.
    """
    camera = profile.cameras.get(bracket.side) if profile else None
    if profile and camera and camera.response:
        return _from_profile(bracket, profile, camera), bracket.frames
    from processing.pictures.frames import array_frame

    codes = decoded(bracket.frames)
    held = tuple(array_frame(code, frame.name) for code, frame in zip(codes, bracket.frames, strict=True))
    return _recovered(bracket, codes), held


def _recovered(bracket: SideBracket, codes: Sequence[Bytes]) -> CameraResponse:
    """Recover the response from the bracket; its times too, unless the camera's rule is known."""
    from processing.calibration.response.response import recover_response
    from processing.calibration.response.samples import Bracket8
    from processing.calibration.response.shutter import camera_rule, true_time_s

    rule = camera_rule(bracket.device.model) if bracket.device else None
    times_s = [true_time_s(nominal, rule) for nominal in bracket.nominal_s] if rule else bracket.nominal_s
    fit = recover_response([Bracket8(codes, times_s, bracket.nominal_s)], estimate_times=rule is None)
    times_source = f"rule of the camera: {rule}" if rule else "estimated"
    warnings = _warnings("response", bracket, fit.warnings)
    left = code_residuals(codes, fit.times_s, fit.curve)
    return CameraResponse(
        fit.curve, fit.noise, fit.times_s, fit.time_sigma, "recovered", times_source, {}, left, warnings
    )


def _from_profile(bracket: SideBracket, profile: RigProfile, camera: CameraProfile) -> CameraResponse:
    """Take the profile's curve; warn where the bracket or its settings contradict it."""
    from processing.calibration.profile import profile_matches
    from processing.calibration.response.response import check_response, estimate_noise
    from processing.calibration.response.samples import Bracket8

    assert camera.response
    curve = camera.response.curve()
    times_s, time_sigma = profile_times(camera, bracket.nominal_s)
    if camera.noise:
        noise = camera.noise.model()
    else:
        noise = estimate_noise([Bracket8(decoded(bracket.frames), times_s)], curve)
    warnings = _warnings("profile", bracket, profile_matches(profile, bracket.side, bracket.device, bracket.records))
    check: dict[str, Any] = {}
    small = decoded(bracket.frames, coarse(bracket.frames))
    try:
        checked = check_response(curve, noise, Bracket8(small, times_s))
    except ResponseError as error:
        warnings += _warnings("unchecked", bracket, [f"the profile's response cannot be checked: {error.message}"])
    else:
        check = {name: getattr(checked, name) for name in ("drifted", "drift_stops", "sigma_stops", "noise_ratio")}
        warnings += _warnings(DRIFTED if checked.drifted else "response", bracket, checked.warnings)
    left = code_residuals(small, times_s, curve)
    return CameraResponse(curve, noise, times_s, time_sigma, "profile", "profile", check, left, warnings)


def code_residuals(codes: Sequence[Bytes], times_s: Sequence[float], curve: ResponseCurve) -> dict[str, Any]:
    """Return what frames say of a patch's light apart from one another, by code: lists for response.json.

    ``codes``: (H, W, 3) uint8 of each frame. The lists: ``rms_stops`` (3, bins) over ``codes`` (bins,), None where no
    patch has such a code; empty where there are none.
    """
    from processing.calibration.response.response import residuals_by_code
    from processing.calibration.response.samples import Bracket8, take_samples

    try:
        found = residuals_by_code(take_samples([Bracket8(codes, times_s)]), curve)
    except ResponseError:
        return {}
    rms = [
        [float((m * m + s * s) ** 0.5) if n else None for m, s, n in zip(means, spreads, counts, strict=True)]
        for means, spreads, counts in zip(found.mean_stops, found.spread_stops, found.count, strict=True)
    ]
    return {"codes": [float(code) for code in found.codes], "rms_stops": rms}


def _warnings(code: str, bracket: SideBracket, texts: Iterable[str]) -> tuple[StageWarning, ...]:
    side = bracket.side.value
    named = (text if text.startswith(f"{side}:") else f"{side}: {text}" for text in texts)
    return tuple(StageWarning(code=code, message=text[:500]) for text in named)


def profile_times(camera: CameraProfile, nominal_s: Sequence[float]) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return true times and their relative uncertainties: as measured where the profile has them, else by its rule."""
    import math

    from processing.calibration.response.shutter import RULE_SIGMA_STOPS, ShutterRule, true_time_s

    measured = {round(math.log2(time.nominal_s), 3): time for time in camera.shutter.times}
    times, sigmas = [], []
    for nominal in nominal_s:
        known = measured.get(round(math.log2(nominal), 3))
        times.append(known.true_s if known else true_time_s(nominal, ShutterRule(camera.shutter.rule)))
        sigmas.append((known.sigma_stops if known else RULE_SIGMA_STOPS) * math.log(2))
    return tuple(times), tuple(sigmas)
