"""One camera from its brackets in rig sessions: shutter rule, response curve, noise, lens, fall-off, filter."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime
from functools import partial
from pathlib import Path

import numpy as np

from processing.calibration import profile_records
from processing.calibration.merge.merge import MergeOptions
from processing.calibration.optics import LENS_MAPPINGS, circle_seen, stated_circle
from processing.calibration.outdoor.lens import Circle, LensModel
from processing.calibration.outdoor.nd_filter import NdFilter, fit_nd_filter
from processing.calibration.outdoor.outdoor import OutdoorOptics, correct_colour, correct_vignetting, with_lens
from processing.calibration.profile import CameraProfile, CameraState, RigProfile, camera_state
from processing.calibration.response.response import ResponseFit, recover_response
from processing.calibration.response.samples import Bracket8
from processing.calibration.response.shutter import ShutterRule, camera_rule
from processing.calibration.scale.chart import find_chart_around
from processing.calibration.scale.chart_patches import FoundChart
from processing.calibration.scale.glare_fit import GlareKernel
from processing.calibration.scale.lamp_glare import kernel_from_lamps
from processing.calibration.scale.veiling_glare import without_glare
from processing.calibration.scale.vignetting import Vignetting, correct_panorama, fit_flat, fit_turned
from processing.errors import BracketError, LensError, ParameterError, ProfileError, ResponseError
from processing.ground.arrays import Doubles
from processing.pictures.images import RelativeImage
from processing.sphere import Equirectangular, Geometry, LensMapping
from processing.stages.brackets import SideBracket, decoded, side_bracket
from processing.stages.merge import merged_bracket
from station.session.session import MeterTarget, ReadingRecord, Side
from station.session.store import load_manifest


@dataclass(frozen=True, kw_only=True)
class SessionSide(SideBracket):
    """What one camera took in one session."""

    path: Path
    session_id: str
    created_utc: datetime
    state: CameraState
    target: MeterTarget | None
    readings: tuple[ReadingRecord, ...]
    circle_frac: Circle | None
    """The image circle that the rig file states: centre and radius as fractions of width, height and width."""

    def true_times_s(self, shutter: profile_records.ShutterRecord) -> tuple[float, ...]:
        """Return the times that the frames were open."""
        return tuple(shutter.true_s(nominal) for nominal in self.nominal_s)

    def bracket(self, times_s: Sequence[float]) -> Bracket8:
        """Return the decoded frames (uint8 RGB) with their times."""
        return Bracket8(decoded(self.frames), times_s, names=[frame.name for frame in self.frames])


def read_side(path: Path, side: Side, *, raw: bool = False) -> SessionSide | None:
    """Return one camera's bracket of a session, of JPEGs or of raw files; None where it took none.

    Raises `SessionError`: no session there, or one that cannot be read; `BracketError`: fewer than two frames, frames
    of different settings, or raw files that cannot be used.
    """
    manifest, path = load_manifest(path), path.resolve()
    if not any(frame.side is side and frame.is_raw is raw for frame in manifest.frames):
        return None
    # By names that say which of the rig's sessions they belong to
    named = (frame.model_copy(update={"file": f"{path.name}/{frame.file}"}) for frame in manifest.frames)
    manifest = manifest.model_copy(update={"frames": tuple(named)})
    bracket = side_bracket(manifest, path.parent, side, "raw" if raw else "jpeg")
    if bracket is None or len(bracket.records) < 2:
        raise BracketError(f"only one {side} frame", where=str(path), advice="capture a bracket of several times")
    return SessionSide(
        **vars(bracket),
        path=path,
        session_id=manifest.session_id,
        created_utc=manifest.created_utc,
        state=camera_state(bracket.device, manifest.pictures(side)),
        target=manifest.target,
        readings=manifest.readings,
        circle_frac=stated_circle(manifest.rig) if side is Side.OUTDOOR else None,
    )


def outdoor_lens(side: SessionSide, half_field_rad: float) -> LensModel:
    """Return the fisheye: its circle as the frames show it, else as the rig file states it; the mapping by its camera.

    Raises `LensError`: no circle is seen, and none is stated.
    """
    circle, source = circle_seen(decoded(side.frames), side.size_px, side.circle_frac)
    mapping = LENS_MAPPINGS.get(kind := side.device.kind if side.device else "", LensMapping.EQUIDISTANT)
    known = str(mapping) if kind in LENS_MAPPINGS else f"{mapping} (assumed)"
    return LensModel(mapping, circle, half_field_rad, source=f"{known}; image circle {source}")


_RULES = (ShutterRule.THIRDS, ShutterRule.NOMINAL, ShutterRule.HALVES)
_LEAST_DENSITY = 0.05  # of a filter that sessions with and without it show; chosen: the weakest made is ND 0.15
_CODES = 0.7  # that a patch's mean may be off; chosen on the charts of eight hostile rigs
_CLEAR_RATIO = 0.8  # of the residuals of two rules: nearer to 1 the frames do not distinguish them


@dataclass(frozen=True)
class CameraFit:
    """What is known of one camera so far."""

    side: Side
    response: ResponseFit | None
    """None: of its raw files, which have none."""
    shutter: profile_records.ShutterRecord
    lens: LensModel | None = None
    """Of the outdoor camera."""
    vignetting: Vignetting | None = None
    filter: NdFilter | None = None
    glare: GlareKernel | None = None
    sessions: tuple[str, ...] = ()
    warnings: tuple[str, ...] = field(default_factory=tuple)

    def merged(self, taken: SessionSide) -> RelativeImage:
        """Return a session's bracket merged as the stage does it, in this camera's geometry, nothing corrected.

        Frames that the curve does not fit well are no other camera's here: their doubt is stated.
        """
        geometry: Geometry = self.lens.fisheye(taken.size_px) if self.lens else Equirectangular(*taken.size_px)
        now = taken.created_utc
        profile = RigProfile(created_utc=now, cameras={self.side: self.profile(taken, now)})
        return merged_bracket(taken, profile, geometry, MergeOptions(own_curve=True))[1].image

    def corrected(self, image: RelativeImage) -> RelativeImage:
        """Return a merged picture with fall-off and the filter's tint undone, in its own geometry."""
        if self.lens is None:
            return image if self.vignetting is None else correct_panorama(image, self.vignetting)
        optics = OutdoorOptics(self.lens, self.vignetting, self.filter)
        return correct_colour(correct_vignetting(with_lens(image, optics), optics), optics)

    def profile(self, chart: SessionSide, now: datetime) -> CameraProfile:
        """Return the camera's part of the profile."""
        return CameraProfile(
            side=self.side,
            state=chart.state,
            created_utc=now,
            sessions=self.sessions,
            response=profile_records.ResponseRecord.of(self.response.curve) if self.response else None,
            noise=profile_records.NoiseRecord.of(self.response.noise) if self.response else None,
            shutter=self.shutter,
            vignetting=profile_records.VignettingRecord.of(self.vignetting) if self.vignetting else None,
            lens=profile_records.LensRecord.of(self.lens) if self.lens else None,
            nd=profile_records.NdRecord.of(self.filter) if self.filter else None,
            glare=profile_records.GlareRecord.of(self.glare) if self.glare else None,
        )


def fit_camera(
    takes: Sequence[SessionSide], circle_of: SessionSide, half_field_rad: float, rule: ShutterRule | None = None
) -> CameraFit:
    """Return response, noise and shutter rule of the camera that took ``takes``; the lens of an outdoor one.

    ``rule`` None: the camera model's, else the one under which the curve fits best.

    Raises `ResponseError`: the frames of all sessions together give no curve.
    """
    rule = rule or camera_rule(takes[0].state.model)
    response, rule, doubts = _best_rule(takes, (rule,) if rule else _RULES)
    return CameraFit(
        side=takes[0].side,
        response=response,
        shutter=profile_records.ShutterRecord(rule=rule, scatter_stops=response.scatter_stops),
        lens=outdoor_lens(circle_of, half_field_rad) if circle_of.side is Side.OUTDOOR else None,
        sessions=tuple(t.session_id for t in takes),
        warnings=(*doubts, *(f"{takes[0].side}: {w}" for w in response.warnings)),
    )


def with_falloff(camera: CameraFit, takes: Sequence[SessionSide]) -> CameraFit:
    """Return the camera with the fall-off that pictures show: outdoors of an evenly lit field, indoors of one room.

    Indoors the camera was turned between them, and stray light that is known is taken off before.
    """
    pictures = [camera.merged(taken) for taken in takes]
    if camera.lens is None:
        found = fit_turned([without_glare(one, camera.glare) if camera.glare else one for one in pictures])
    else:
        found = fit_flat([picture.rgb for picture in pictures], camera.lens.fisheye(takes[0].size_px))
    return replace(camera, vignetting=replace(found, f_number=takes[0].state.f_number))


def with_filter(camera: CameraFit, filtered: SessionSide, plain: SessionSide) -> CameraFit:
    """Return the camera with the filter that the chart with and without it shows.

    Raises `ParameterError`: the two sessions are one, or exchanged.
    """
    (dim, dim_u), (full, full_u) = (_patches(camera, taken) for taken in (filtered, plain))
    found = fit_nd_filter(dim, full, np.hypot(dim_u, full_u), source="chart with and without the filter")
    if found.density < _LEAST_DENSITY:
        text = f"{filtered.path.name} shows {found.transmittance:.2g} times the light that {plain.path.name} does"
        likely = "the two sessions are swapped, or one session was given twice"
        raise ParameterError(text, where="--nd", likely=likely, advice="--nd WITH WITHOUT")
    return with_tint(camera, found)


def with_lamps(camera: CameraFit, pairs: Sequence[tuple[SessionSide, SessionSide]]) -> CameraFit:
    """Return the camera with the stray light that a lamp, seen and then hidden, shows; at one place or several.

    A pair that shows none, such as a lamp that only the other camera sees, is left out with a warning.
    """
    fit, doubts = partial(kernel_from_lamps, two_lenses=camera.lens is None), []
    good, found = [], None
    for seen, hidden in pairs:
        pictures = camera.merged(seen), camera.merged(hidden)
        try:
            found = fit([pictures])
            good.append(pictures)
        except LensError as error:
            advice = f"; what to do: {error.advice}" if error.advice else ""
            doubts.append(f"{camera.side}: {seen.path.name} is not used for stray light: {error.message}{advice}")
    glare = fit(good) if len(good) > 1 else found
    return replace(camera, glare=glare, warnings=(*camera.warnings, *doubts))


def with_tint(camera: CameraFit, found: NdFilter) -> CameraFit:
    """Return the camera with a filter that a chart shows, with a warning where that leaves a sky uncertain."""
    text = f"{camera.side}: {found.doubt}: photograph the chart by daylight or a white lamp, with exposures up to 30 s"
    return replace(camera, filter=found, warnings=(*camera.warnings, *([text] if found.doubt else ())))


def channel_doubt(camera: CameraFit, taken: SessionSide, chart: FoundChart) -> Doubles:
    """Return the relative uncertainty, of shape (24, 3), of patches by photons and codes (of JPEGs' longest frame)."""
    rgb = np.maximum(chart.rgb, 1e-30)
    found = chart.uncertainty[:, None] * np.sqrt(np.maximum(chart.luminance[:, None] / rgb, 1))
    if camera.response is None:
        return np.asarray(found)
    shown = np.log2(rgb * max(taken.true_times_s(camera.shutter)))
    curves = zip(shown.T, camera.response.curve.log2_exposure, strict=True)
    a_code = np.stack([np.interp(light, log2, np.gradient(log2)) for light, log2 in curves], axis=1)
    return np.hypot(found, _CODES * math.log(2) * a_code)


def _patches(camera: CameraFit, taken: SessionSide) -> tuple[Doubles, Doubles]:
    """Return the chart's patches (24, 3) at equal exposure, not finite where clipped or dark; and their uncertainty."""
    image = replace(camera, filter=None).corrected(camera.merged(taken))
    chart = find_chart_around(image).chart
    state = taken.state
    if state.iso is None or state.f_number is None:
        text = "ISO and f-number are needed to compare pictures with and without the filter"
        raise ProfileError(text, where=str(taken.path), advice="use sessions whose frames record them")
    rgb = chart.rgb / (state.iso / state.f_number**2)
    rgb[~chart.usable] = np.nan
    return np.asarray(rgb), channel_doubt(camera, taken, chart)


def _best_rule(
    takes: Sequence[SessionSide], rules: Sequence[ShutterRule]
) -> tuple[ResponseFit, ShutterRule, list[str]]:
    """Return the fit and rule that calls the fewest times wrong, then whose curve leaves the least residual.

    And a doubt where that is hardly less than another's."""
    tried: list[tuple[int, float, int, ResponseFit, ShutterRule]] = []
    failed: ResponseError | None = None
    for number, rule in enumerate(rules):
        shutter = profile_records.ShutterRecord(rule=rule)
        try:
            fit = recover_response([take.bracket(take.true_times_s(shutter)) for take in takes])
        except ResponseError as error:
            failed = error
            continue
        tried.append((len(fit.wrong_times), fit.curve.residual_stops, number, fit, rule))
    if not tried:
        assert failed is not None
        raise failed
    tried.sort(key=lambda one: one[:3])
    wrong, residual, _, fit, rule = tried[0]
    doubt = [
        f"{takes[0].side}: the frames do not show whether shutter times are {rule} or {one[4]} "
        f"(residuals {residual:.4f} and {one[1]:.4f} stops): {rule} is used"
        for one in tried[1:]
        if one[0] == wrong and residual > _CLEAR_RATIO * one[1]
    ]
    return fit, rule, doubt
