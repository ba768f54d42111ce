"""The whole of ``daylit rig calibrate``: both cameras, k2 between them, and the pictures that let a person check."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime
from functools import partial
from importlib.metadata import version
from pathlib import Path

import cv2
import numpy as np

from processing.calibration.merge.tables import linear_curve
from processing.calibration.outdoor.nd_filter import NdFilter, fit_nd_filter
from processing.calibration.profile import Correction, K2Record, PatchRecord, RigProfile
from processing.calibration.profile_records import ResponseRecord
from processing.calibration.response.shutter import ShutterRule
from processing.calibration.scale import chart_patches
from processing.calibration.scale.chart import ChartView, chart_at, cut, find_chart_around, scale_from_charts
from processing.calibration.scale.luminance import Spot
from processing.calibration.scale.vignetting import published_vignetting
from processing.errors import ChartError, LensError, ParameterError, ProcessingError
from processing.ground.arrays import Bytes, Doubles
from processing.pictures.modes import blueness, modes_of
from processing.rig.camera_fit import (
    CameraFit,
    SessionSide,
    channel_doubt,
    fit_camera,
    read_side,
    with_falloff,
    with_filter,
    with_lamps,
    with_tint,
)
from processing.sphere import Perspective
from station.session.session import Side

_INDOOR_DATA = ("theta_z1",)  # published fall-offs that belong to the indoor camera


@dataclass(frozen=True)
class RigRequest:
    """What to calibrate from.

    ``chart``: the session in which both cameras see the chart (k2). ``sessions``: more brackets of either camera, for
    response and noise only; without any the chart has to do. ``nd``: the outdoor camera's chart with and without the
    filter (the latter is used for its response too). ``lamps``: pairs in the dark, a lamp seen and hidden by a card.
    ``flats``: the outdoor camera before an evenly lit field; ``turned``: one room, the panorama camera turned between.
    """

    chart: Path
    sessions: tuple[Path, ...] = ()
    flats: tuple[Path, ...] = ()
    nd: tuple[Path, Path] | None = None
    lens_data: tuple[str, ...] = ()
    corners: Mapping[Side, Sequence[float]] = field(default_factory=dict)
    rules: Mapping[Side, ShutterRule] = field(default_factory=dict)
    half_field_rad: float = math.pi / 2
    lamps: tuple[tuple[Path, Path], ...] = ()
    turned: tuple[Path, ...] = ()


@dataclass(frozen=True)
class RigResult:
    """The profile, and what it was seen in."""

    profile: RigProfile
    views: Mapping[Side, ChartView]
    cameras: Mapping[Side, CameraFit]


def calibrate_rig(request: RigRequest, now: datetime, report: Callable[[str], None] = lambda _text: None) -> RigResult:
    """Return the rig's profile; ``report`` is called with what is being done.

    Where the chart session has raw files, all is done by them too: the profile's part ``raw``, or a warning.

    Raises `ChartError`: the chart was not found in one camera's picture (name its corners); `ResponseError`: a camera's
    frames give no curve; `ParameterError`: sessions without the frames that are needed.
    """
    charts = {side: taken for side in Side if (taken := read_side(request.chart, side)) is not None}
    if not charts:
        raise ParameterError("the chart session has no frames", where=str(request.chart))
    for side, corners in request.corners.items():
        if side in charts:
            chart_patches.check_corners(np.reshape(corners, (-1, 2)), charts[side].size_px)
    _require_use(request, charts)
    cameras = {}
    for side, taken in charts.items():
        report(f"{side}: fitting response, noise and shutter times")
        cameras[side] = _camera(request, side, taken)
    report("merging the chart bracket and locating the chart")
    result, part = _result(request, charts, cameras, now), None
    warnings = list(result.profile.warnings)
    try:
        raws = {side: taken for side in charts if (taken := read_side(request.chart, side, raw=True))}
        for side in raws:
            report(f"{side}: the same for raw files")
            bare = replace(cameras[side], response=None, filter=None, warnings=())
            cameras[side] = _optics(request, bare, raw=True)
        part = _result(request, charts | raws, cameras, now).profile if raws else None
        warnings += [f"by raw files: {text}"[:500] for text in (part.warnings if part else ()) if text not in warnings]
    except ProcessingError as error:
        warnings.append(f"the profile covers JPEGs only: {error}"[:500])
    return replace(result, profile=result.profile.model_copy(update={"raw": part, "warnings": tuple(warnings)}))


def _result(
    request: RigRequest, charts: Mapping[Side, SessionSide], fits: Mapping[Side, CameraFit], now: datetime
) -> RigResult:
    """Return the profile of cameras whose optics are known, by the chart in both."""
    cameras = dict(fits)
    views = {side: _chart_view(fits[side], taken, request.corners.get(side)) for side, taken in charts.items()}
    if len(charts) == 2 and cameras[Side.OUTDOOR].filter is None:
        camera = cameras[Side.OUTDOOR]
        try:
            doubts = (channel_doubt(fits[side], charts[side], views[side].chart) for side in Side)
            found, views[Side.OUTDOOR] = one_colour(views[Side.INDOOR].chart, views[Side.OUTDOOR], np.hypot(*doubts))
            cameras[Side.OUTDOOR] = with_tint(camera, found)
        except LensError as error:
            text = f"outdoor colours are not matched to the indoor camera: {error.message}"
            cameras[Side.OUTDOOR] = replace(camera, warnings=(*camera.warnings, text))
    k2 = _k2(cameras, views, charts) if len(charts) == 2 else None
    warnings = [w for camera in cameras.values() for w in camera.warnings]
    if k2 is None:
        warnings.append(f"no k2: the chart session has frames of the {next(iter(charts))} camera only")
    profile = RigProfile(
        created_utc=now,
        software={"daylit": version("daylit")},
        cameras={side: camera.profile(charts[side], now) for side, camera in cameras.items()},
        k2=k2[0] if k2 else None,
        warnings=tuple(text[:500] for text in (*warnings, *(k2[1] if k2 else ()))),
        frames={side: "raw" if taken.linear else "jpeg" for side, taken in charts.items()},
    )
    return RigResult(profile, views, cameras)


def _require_use(request: RigRequest, charts: Mapping[Side, SessionSide]) -> None:
    """Refuse what no camera of the chart session would use, and lens data that nobody has published."""
    for name in request.lens_data:
        published_vignetting(name)
    for side in request.corners.keys() - charts:
        raise ParameterError(f"the chart session has no frames of the {side} camera", where=f"--corners {side}")
    for seen, hidden in request.lamps:
        if not any(read_side(seen, side) and read_side(hidden, side) for side in charts):
            raise ParameterError("no camera of the chart session took both pictures", where=f"--lamp {seen} {hidden}")
    used = {"flat": (request.flats, Side.OUTDOOR, 1), "turned": (request.turned, Side.INDOOR, 2)}
    for name, (paths, side, least) in used.items():
        if paths and sum(read_side(path, side) is not None for path in paths) < least:
            raise ParameterError(
                f"frames of the {side} camera in {least} or more are needed", where=f"--{name} {paths[0]}"
            )


def _camera(request: RigRequest, side: Side, chart: SessionSide) -> CameraFit:
    """Return everything about one camera that the sessions show."""
    paths = (*request.sessions, *(request.nd or ())[1:]) if side is Side.OUTDOOR else request.sessions
    # Even fields and a chart behind a dark filter show few codes: a curve from them would be worse, not better.
    varied = [taken for path in paths if (taken := read_side(path, side))]
    camera = fit_camera(_same_camera(chart, varied), chart, request.half_field_rad, request.rules.get(side))
    for name in request.lens_data:
        if (name in _INDOOR_DATA) == (side is Side.INDOOR):
            camera = replace(camera, vignetting=published_vignetting(name))
    return _optics(request, camera)


def _optics(request: RigRequest, camera: CameraFit, *, raw: bool = False) -> CameraFit:
    """Return the camera with what flats, filter and lamps show; by raw files where these have them, else as it is."""
    side, read = camera.side, partial(read_side, side=camera.side, raw=raw)
    lamps = [(read(seen), read(hidden)) for seen, hidden in request.lamps]
    if pairs := [(seen, hidden) for seen, hidden in lamps if seen is not None and hidden is not None]:
        camera = with_lamps(camera, pairs)
    fields, least = (request.flats, 1) if side is Side.OUTDOOR else (request.turned, 2)
    if len(takes := [taken for path in fields if (taken := read(path)) is not None]) >= least:
        camera = with_falloff(camera, takes)
    if request.nd and side is Side.OUTDOOR:
        filtered, plain = (read(path) for path in request.nd)
        if filtered is not None and plain is not None:
            camera = with_filter(camera, filtered, plain)
        elif not raw:
            raise ParameterError("the session has no outdoor frames", where="--nd", advice="--nd WITH WITHOUT")
    return camera


def _same_camera(chart: SessionSide, others: Sequence[SessionSide]) -> list[SessionSide]:
    """Return the sessions, each once (the chart's where there are none); another camera or white balance is refused.

    Aperture, filter and ISO do not change a response curve enough to matter."""
    found: dict[str, SessionSide] = {}
    for other in others:
        differ = [
            name
            for name in ("model", "serial", "color_temperature_k")
            if getattr(other.state, name) and getattr(chart.state, name) not in (None, "", getattr(other.state, name))
        ]
        if differ:
            raise ParameterError(
                f"another {', '.join(differ)} than in the chart session", where=str(other.path), advice="leave it out"
            )
        found.setdefault(other.session_id, other)
    return list(found.values()) or [chart]


def _chart_view(camera: CameraFit, taken: SessionSide, corners: Sequence[float] | None) -> ChartView:
    """Return the chart, found before the filter's tint is undone: an unsure one would hide it."""
    merged = camera.merged(taken)
    image, towards = replace(camera, filter=None).corrected(merged), None
    try:
        if camera.side is Side.INDOOR and taken.target is not None:
            towards = Spot(taken.target.longitude_rad, taken.target.latitude_rad).direction()
        seen = find_chart_around(image, towards) if corners is None else chart_at(image, corners)
    except ChartError as error:
        error.where = f"{taken.path} ({camera.side}){': ' + error.where if error.where else ''}"
        raise
    if camera.filter is None:
        return seen
    geometry = seen.view.geometry
    assert isinstance(geometry, Perspective)
    view = cut(camera.corrected(merged), geometry)
    return ChartView(view, chart_patches.read_chart(view, seen.chart.corners_px, seen.chart.how))


def one_colour(inside: chart_patches.FoundChart, seen: ChartView, doubt: Doubles) -> tuple[NdFilter, ChartView]:
    """Return what brings the outdoor camera's chart to the indoor's colours (filter, sensor, white), and its view then.

    Luminance of white is left to k2, of which the filter's density is a part here. ``doubt``: of both charts' patches,
    relative, of shape (24,) or (24, 3).

    Raises `LensError`: fewer than six patches are usable in both, or they hold too few colours.
    """
    good = inside.usable & seen.chart.usable
    found = fit_nd_filter(seen.chart.rgb[good], inside.rgb[good], doubt[good], source="the chart in both cameras")
    chart = replace(seen.chart, rgb=np.asarray(seen.chart.rgb @ found.correction))
    view = replace(seen.view, rgb=found.correct(seen.view.rgb))
    return replace(found, density=0.0), ChartView(view, chart)


def _k2(
    cameras: Mapping[Side, CameraFit], views: Mapping[Side, ChartView], charts: Mapping[Side, SessionSide]
) -> tuple[K2Record, tuple[str, ...]]:
    indoor, outdoor = cameras[Side.INDOOR], cameras[Side.OUTDOOR]
    inside, outside = (
        (views[side].chart, [mode for mode in modes_of(views[side].view) if mode.kind == "level"]) for side in Side
    )
    tint_frac = outdoor.filter.relative_uncertainty if outdoor.filter else 0.0
    found = scale_from_charts(inside[0], outside[0], shared=(inside[1], outside[1]), colour_frac=tint_frac)
    done: dict[Correction, object]
    done = {"panorama": indoor.vignetting, "vignetting": outdoor.vignetting, "nd": outdoor.filter}
    chart = charts[Side.INDOOR]
    record = K2Record(
        value=found.scale.value,
        relative_uncertainty=found.scale.relative_uncertainty,
        measured_utc=chart.created_utc,
        session=chart.session_id,
        indoor=chart.state,
        outdoor=charts[Side.OUTDOOR].state,
        white_ratio=found.white_ratio,
        n_patches=sum(p.fitted for p in found.patches),
        residual_stops=found.residual_stops,
        patches=tuple(PatchRecord.model_validate(p, from_attributes=True) for p in found.patches),
        light=float(blueness(views[Side.INDOOR].chart.rgb[chart_patches.WHITE])),
        corrections=tuple(name for name, what in done.items() if what is not None),
        responses={
            side: ResponseRecord.of(camera.response.curve if camera.response else linear_curve()).digest()
            for side, camera in cameras.items()
        },
    )
    return record, found.scale.warnings


_CORNER = np.array(((-1, -1), (1, -1), (1, 1), (-1, 1))) * chart_patches.WINDOW / 2


def chart_png(found: ChartView) -> bytes:
    """Return a PNG by which a person can check the chart.

    White stands at 90 %; the windows that were averaged are outlined, the white patch's in red.
    """
    picture = _shown(found)
    mapping = chart_patches.homography(found.chart.corners_px)
    width = max(1, picture.shape[1] // 600)
    middles = chart_patches.chart_points(mapping, 0.0, 1)[:, 0]
    for number in range(24):
        window = np.array((number % 6 + 0.5, number // 6 + 0.5)) + _CORNER
        outline = np.rint(cv2.perspectiveTransform(window[:, None], mapping)).astype(np.int32)
        colour = (0, 0, 255) if number == chart_patches.WHITE else (0, 255, 0)
        cv2.polylines(picture, [outline], True, colour, width, cv2.LINE_AA)
    x, y = middles[chart_patches.WHITE]
    cv2.putText(picture, "white", (int(x), int(y)), cv2.FONT_HERSHEY_SIMPLEX, 0.4 * width, (0, 0, 255), width)
    done, data = cv2.imencode(".png", picture)
    assert done
    return bytes(data)


def _shown(found: ChartView) -> Bytes:
    """Return the view in 8 bits, blue first as cv2 wants it."""
    white = max(float(found.chart.rgb[chart_patches.WHITE].mean()), 1e-30)
    values = 0.9 * np.clip(found.view.rgb / np.float32(white), 0, 1 / 0.9)
    return np.ascontiguousarray((255 * values ** (1 / 2.2))[..., ::-1].astype(np.uint8))
