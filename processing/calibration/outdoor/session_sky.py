"""A session's outdoor picture in cd/m2: veil, fall-off, filter colour, scale k1 k2, north, geometry, the sun."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal, Protocol

from processing.calibration.optics import OpticsChoice, falloff_of, find_optics, glare_taken_off, lamp_kernel
from processing.calibration.outdoor import outdoor, sun_place
from processing.calibration.outdoor.glass_view import SAME_CAMERA_UNCERTAINTY, not_one_camera, only_the_view
from processing.calibration.outdoor.outdoor import OutdoorOptics, OutdoorView
from processing.calibration.outdoor.sun_disc import Sun, find_sun
from processing.calibration.outdoor.sun_place import North, Place
from processing.calibration.outdoor.sun_repair import repair_sun
from processing.calibration.profile import K2Record, RigProfile, require_k2, states_of
from processing.calibration.profile_records import ResponseRecord
from processing.calibration.scale.glare_fit import GlareKernel
from processing.calibration.scale.luminance import Calibrated, ScaleFactor, combined, given_scale, scaled
from processing.calibration.scale.photometry import READING_KEY, UP, compare_illuminance, illuminance_lx, illuminances
from processing.calibration.scale.veiling_glare import Metered, kernel_modes, unmeasured_modes
from processing.calibration.scale.vignetting import correct_panorama
from processing.errors import ScaleError, SunError
from processing.pictures.images import LuminanceImage, P, RelativeImage, Validity, in_blocks
from processing.pictures.modes import SharedMode, colour_mode, falloff_mode, less_by_sum, modes_of, widened, with_modes
from processing.sphere import Equirectangular, Fisheye, projected_solid_angles
from station.session.session import SessionManifest, Side

NO_K2 = "no scale for the outdoor picture: give a rig profile (--calibration), --k2 or --outdoor-lux"

LUX_METER_UNCERTAINTY = 0.05  # relative, standard, of a reading given by --outdoor-lux
FROM_LUX = "from --outdoor-lux"


class SkyChoice(OpticsChoice, Protocol):
    """What a user may say about the sky (see the parameters of the stage calibrate)."""

    @property
    def k2(self) -> float | None:
        """Takes the place of the profile's."""

    @property
    def outdoor_lux(self) -> float | None:
        """Horizontal illuminance measured outside."""

    @property
    def repair_sun(self) -> Literal["no", "illuminance", "clear-sky"]:
        """Whether, and from what, a clipped sun is replaced."""

    @property
    def outdoor_view(self) -> str:
        """An `OutdoorView`."""

    @property
    def outdoor_top_deg(self) -> float | None:
        """Compass azimuth of the picture's top; None: it is found."""


@dataclass(frozen=True)
class _Sky:
    """The sky picture, corrected, not yet scaled; its sun if it has one."""

    image: list[RelativeImage]  # one, which can be taken out, and let go
    sun: Sun | None
    sun_text: str
    kernel: GlareKernel | None = None
    """Of the glare that was taken off."""


def why_no_scale(
    session: SessionManifest, asked: SkyChoice, profile: RigProfile | None, merged: RelativeImage
) -> str | None:
    """Return why the outdoor picture cannot be scaled, None if it can."""
    if isinstance(merged.geometry, Equirectangular):
        return None if asked.k2 is not None else not_one_camera(session)
    if asked.k2 is not None or asked.outdoor_lux is not None:
        return None
    if profile is None:
        return NO_K2
    return None if profile.k2 is not None else "the rig profile has no k2: give --k2 or --outdoor-lux"


def calibrate_outdoor(
    merged: RelativeImage,
    session: SessionManifest,
    asked: SkyChoice,
    profile: RigProfile | None,
    k1: ScaleFactor,
    responses: Mapping[Side, ResponseRecord] | None = None,
    *,
    draft: bool = False,
) -> Calibrated:
    """Return the sky in cd/m2, north known, in the geometry asked for; energy is kept throughout.

    ``responses``: the curves that the session was merged with, to be those of k2. ``draft``: lens, sun and north are
    found, and the sun is repaired, in the whole picture, which is then made smaller. Raises `ProfileError` for a k2 of
    other settings, `LensError` where no image circle is seen, `ScaleError` where a lux reading gives no scale,
    `SunError` where a repair is asked that cannot be made."""
    if isinstance(merged.geometry, Equirectangular):
        return _through_glass(merged, session, asked, profile, k1)
    k2 = require_k2(profile, states_of(session), session.name) if profile and profile.k2 and asked.k2 is None else None
    optics, facts, warnings = find_optics(merged, session, asked, profile, k2)
    smaller = outdoor.draft_factor(optics.lens, merged.validity.shape[::-1]) if draft else 1
    bare, kernel, veil = bare_light(merged, optics, asked, lamp_kernel(profile, Side.OUTDOOR), step_px=smaller)
    sky = replace(_with_sun(outdoor.correct_colour(bare, optics)), kernel=kernel)
    del merged, bare
    north, north_warnings = _north(sky, session, asked)
    if smaller == 1:
        sky = replace(sky, image=[_turned(sky.image, north, session, asked)])
    drift = session.repeat_drift(Side.OUTDOOR)
    scale, scale_facts = _scale(sky.image[0], asked, k2, combined(k1, ScaleFactor(1.0, drift / math.sqrt(12))), sky.sun)
    factors: dict[str, Any] = {"k1": k1.value, "k2": scale_facts["k2"]}
    factors |= {READING_KEY: (asked.outdoor_lux, LUX_METER_UNCERTAINTY)} if scale_facts["k2_source"] == FROM_LUX else {}
    picture = scaled(sky.image.pop(), scale, side="outdoor", session_id=session.session_id, **factors)
    shared = optics, sky.kernel, (None, k2.light if k2 else 0.0)
    if smaller == 1:
        picture, repair = _repaired(with_shared_modes(picture, *shared), asked, session, sky)
    else:  # only in the whole picture is a clipped sun's disc sharp
        picture, repair = _repaired(picture, asked, session, sky)
        picture = with_shared_modes(_turned([in_blocks(picture, smaller)], north, session, asked), *shared)
    lux, low = illuminances(picture, {"up": UP})
    if sky.sun is not None and sky.sun.clipped and asked.repair_sun == "no":
        low = ["the sun is clipped in the shortest stop: illuminance is a lower bound (see --repair-sun)", *low]
    facts |= scale_facts | {"repeat_drift_frac": drift or None, "veil": veil, "north": _north_facts(north)}
    facts |= {"sun": {"found": sky.sun_text, "repair": repair}, "illuminance_lx": lux}
    warnings += [
        *_other_curves(k2, responses or {}),
        *north_warnings,
        *_unturned(north, session),
        *low,
        *_compared(picture, asked, facts),
    ]
    warnings += [text for text in scale.warnings if text.startswith("k2")]
    return Calibrated(picture, scale, facts, tuple(warnings))


def _other_curves(k2: K2Record | None, responses: Mapping[Side, ResponseRecord]) -> list[str]:
    """Return warnings of cameras merged with another curve than k2 was measured with: each has a scale of its own."""
    return [
        f"{side}: k2 was measured with another response curve than the session was merged with: k2 may not hold"
        for side, digest in (k2.responses.items() if k2 else ())
        if side in responses and responses[side].digest() != digest
    ]


def with_shared_modes(
    picture: LuminanceImage, optics: OutdoorOptics, kernel: GlareKernel | None, lit: tuple[Metered | None, float]
) -> LuminanceImage:
    """Return the picture with what stray light, spectra, fall-off and filter leave uncertain in all pixels alike.

    The last two are in the pixels' own uncertainty already, which sums take as independent. ``lit``: the spot of the
    picture by which its scale was measured, if any, where stray light and fall-off are then 0, and the blueness of the
    light on which the scale holds. Of a picture whose illuminance is a reading they add nothing to that."""
    (measured, light), others = lit, list(modes_of(picture))
    if optics.vignetting and optics.vignetting.relative_uncertainty:
        falloff = falloff_mode(optics.vignetting.relative_uncertainty)
        others.append(falloff.less(falloff.values[1] * math.cos(measured[2])) if measured else falloff)
    if optics.filter and optics.filter.relative_uncertainty:
        others.append(SharedMode("filter colour", "whole", (0.0,), (optics.filter.relative_uncertainty,)))
    stray = kernel_modes(picture, kernel, measured) if kernel else unmeasured_modes(picture, measured)
    left = [*stray, colour_mode(light, indoors=measured is not None)]
    if READING_KEY in picture.attributes:
        weights = projected_solid_angles(picture.geometry, UP) * (picture.validity == Validity.VALID)
        left, others = (less_by_sum(some, picture, weights) for some in (left, others))
    picture = widened(picture, left)
    return replace(picture, attributes=with_modes(picture.attributes, [*others, *left]))


def _through_glass(
    merged: RelativeImage, session: SessionManifest, asked: SkyChoice, profile: RigProfile | None, k1: ScaleFactor
) -> Calibrated:
    """Return the sky of a panorama taken from inside: what the window shows, on the room's own scale.

    Raises `LensError` where the window's view does not stand out from the room."""
    assert isinstance(merged.geometry, Equirectangular)
    falloff, source = falloff_of(session, asked, profile, [], Side.INDOOR)
    image, share = only_the_view(merged if falloff is None else correct_panorama(merged, falloff))
    sky = _with_sun(image)
    # The session's heading is that of the panorama of the room, not of this one.
    north, warnings = _north(sky, session.model_copy(update={"heading_rad": None}), asked)
    heading = session.heading_rad or 0.0
    yaw = math.remainder(north.top_azimuth_rad - heading, 2 * math.pi)
    rows = merged.geometry.height_px
    view = OutdoorView(asked.outdoor_view)
    target = outdoor.outdoor_view(view, rows // 2 if view is OutdoorView.EQUIRECTANGULAR else rows, -heading)
    image = outdoor.project(replace(image, geometry=replace(merged.geometry, yaw_rad=yaw)), target)
    value, doubt = (1.0, SAME_CAMERA_UNCERTAINTY) if asked.k2 is None else (asked.k2, 0.0)
    scale = combined(k1, ScaleFactor(value, doubt, {"k2": doubt}))
    origin = "one camera" if asked.k2 is None else "given"
    picture = scaled(image, scale, side="outdoor", session_id=session.session_id, k1=k1.value, k2=value)
    lux, low = illuminances(picture, {"up": UP})
    facts = {"falloff": source, "k2": value, "k2_source": origin, "north": _north_facts(north), "illuminance_lx": lux}
    facts |= {"k2_relative_uncertainty": doubt} if doubt else {}
    facts |= {"sun": {"found": sky.sun_text, "repair": "not asked"}, "window_share": share}
    text = (
        f"the sky is a panorama from behind the glass: {share:.0%} of all directions show it, the rest is black; its "
        "light has passed the glass, and the illuminance is a lower bound"
    )
    return Calibrated(picture, scale, facts, (text, *warnings, *_unturned(north, session), *low))


def bare_light(
    merged: RelativeImage, optics: OutdoorOptics, asked: OpticsChoice, lamps: GlareKernel | None, *, step_px: int = 1
) -> tuple[RelativeImage, GlareKernel | None, dict[str, Any]]:
    """Return a fisheye picture cut to its circle, without glare and fall-off; the glare's kernel, and what was done.

    ``step_px`` divides the sides of the picture, and then those of the part."""
    lens = optics.lens.fisheye((merged.validity.shape[1], merged.validity.shape[0]))
    image, kernel, veil = glare_taken_off(merged, lens, keep=asked.glare == "keep", lamps=lamps)
    return outdoor.correct_vignetting(outdoor.cut_to_circle(image, lens, step_px), optics), kernel, veil


def _with_sun(image: RelativeImage) -> _Sky:
    try:
        sun = find_sun(image)
    except SunError as error:
        return _Sky([image], None, f"no: {error.args[0] if error.args else error}")
    text = f"yes, {math.degrees(sun.elevation_rad):.2f} degrees high{', clipped' if sun.clipped else ''}"
    return _Sky([image], sun, text)


def _north(sky: _Sky, session: SessionManifest, asked: SkyChoice) -> tuple[North, list[str]]:
    """Return where the picture's top faces: as said, from the sun, or from the panorama's heading."""
    if asked.outdoor_top_deg is not None:
        return sun_place.north_from_heading(math.radians(asked.outdoor_top_deg), math.radians(1.0)), []
    place, moment, why = Place.of(session.site), sun_place.shortest_taken(session, Side.OUTDOOR), ""
    if sky.sun is not None and place is not None and moment is not None:
        try:
            north = sun_place.north_from_sun(sky.image[0], moment, place, sun=sky.sun)
            return north, list(north.warnings)
        except SunError as error:
            why = str(error).split(" | ")[0]
    elif sky.sun is not None:
        why = "the session's site or time is unknown"
    if session.heading_rad is not None:
        # Without a sun the heading is all that there can be; a sun that does not serve is worth a word.
        north = sun_place.north_from_heading(session.heading_rad)
        return north, [f"north is the panorama's heading, not the sun's: {why}"] if why else []
    why = why or "the sun was not found in the picture"
    return sun_place.north_from_heading(0.0, math.pi), [
        f"north is unknown ({why}; no heading): the picture's top is taken as north"
    ]


def _unturned(north: North, session: SessionManifest) -> list[str]:
    """Return that north is known but not the panorama's heading: the two pictures then do not share their +y."""
    if session.heading_rad is not None or north.sigma_rad >= math.pi:
        return []
    return [
        "the panorama's heading is not recorded: the outdoor picture's +y is north, which may not be where the "
        "panorama's centre faces"
    ]


def _turned(given: list[P], north: North, session: SessionManifest, asked: SkyChoice) -> P:
    """Return the picture in the geometry asked for, north on top, in the world whose +y is the panorama's middle."""
    heading = session.heading_rad if session.heading_rad is not None else 0.0
    seen = given[0].geometry
    assert isinstance(seen, Fisheye)
    lens = sun_place.oriented(seen, north, heading)
    rows = max(2, round(2 * lens.radius_px))
    view = OutdoorView(asked.outdoor_view)
    rows = rows // 2 if view is OutdoorView.EQUIRECTANGULAR else rows
    target = outdoor.outdoor_view(view, rows, math.remainder(-heading, 2 * math.pi))
    return outdoor.project(replace(given.pop(), geometry=lens), target)


def _scale(
    image: RelativeImage, asked: SkyChoice, k2: K2Record | None, k1: ScaleFactor, sun: Sun | None
) -> tuple[ScaleFactor, dict[str, Any]]:
    """Return k1 k2 (eq. 2); with neither a profile's k2 nor a given one, the factor that gives the lux measured."""
    if asked.k2 is not None:
        return combined(k1, given_scale("k2", asked.k2)), {"k2": asked.k2, "k2_source": "given"}
    if k2 is not None:
        source = f"rig profile, measured {k2.measured_utc:%Y-%m-%d}"
        found = {"k2": k2.value, "k2_relative_uncertainty": k2.relative_uncertainty, "k2_source": source}
        return combined(k1, ScaleFactor(k2.value, k2.relative_uncertainty)), found
    assert asked.outdoor_lux is not None
    level = illuminance_lx(scaled(image, ScaleFactor(1.0, 0.0)))
    shown = level.value_lx
    if not shown > 0 or (sun is not None and sun.clipped):
        why = "the sun is clipped, and the reading covers sun and sky" if shown > 0 else "the picture is black"
        advice = "give a rig profile (--calibration) or --k2, or leave --outdoor-lux out"
        raise ScaleError(f"--outdoor-lux gives the outdoor picture no scale: {why}", where="outdoor", advice=advice)
    value = asked.outdoor_lux / shown
    # What all pixels share is taken off its modes: of the level plane's light, the reading, nothing but it is in doubt.
    scale = ScaleFactor(value, math.hypot(LUX_METER_UNCERTAINTY, level.pixels_lx / shown, level.doubtful_lx / shown))
    doubt = math.hypot(scale.relative_uncertainty, k1.relative_uncertainty)
    return scale, {"k2": value / k1.value, "k2_relative_uncertainty": doubt, "k2_source": FROM_LUX}


def _repaired(
    picture: LuminanceImage, asked: SkyChoice, session: SessionManifest, sky: _Sky
) -> tuple[LuminanceImage, str]:
    """Return the picture with a clipped sun replaced where that was asked, and what was done."""
    # Asked last: a picture without a clipped sun then does not depend on the answer.
    if sky.sun is None:
        return picture, "nothing to repair: no sun was found"
    if not sky.sun.clipped:
        return picture, "nothing to repair: the sun is not clipped"
    if asked.repair_sun == "no":
        return picture, "not asked"
    if asked.repair_sun == "illuminance":
        if asked.outdoor_lux is None:
            raise SunError("repairing the sun needs a measured illuminance", advice="give --outdoor-lux")
        return repair_sun(picture, horizontal_lx=asked.outdoor_lux)
    place, moment = Place.of(session.site), sun_place.shortest_taken(session, Side.OUTDOOR)
    if place is None or moment is None:
        raise SunError("a clear-sky sun needs site and time", advice="record the site in rig.toml, or give lux")
    return repair_sun(picture, beam=sun_place.clear_beam(moment, place))


def _compared(picture: LuminanceImage, asked: SkyChoice, facts: dict[str, Any]) -> list[str]:
    if asked.outdoor_lux is None or facts["k2_source"] == FROM_LUX:
        return []
    difference, warning = compare_illuminance(illuminance_lx(picture), asked.outdoor_lux)
    facts["measured_outdoor_lux"] = {"value": asked.outdoor_lux, "difference_frac": difference}
    return [warning] if warning else []


def _north_facts(north: North) -> dict[str, Any]:
    return {
        "top_azimuth_deg": math.degrees(north.top_azimuth_rad),
        "uncertainty_deg": math.degrees(north.sigma_rad),
        "source": north.source,
        "elevation_off_deg": None if north.elevation_off_rad is None else math.degrees(north.elevation_off_rad),
    }
