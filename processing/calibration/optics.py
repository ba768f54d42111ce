"""What stands before the cameras of a session: from the rig profile, published data, and the picture itself."""

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any, Literal, Protocol

from processing.calibration.outdoor.lens import Circle, ImageCircle, LensModel, find_image_circle
from processing.calibration.outdoor.nd_filter import NdFilter
from processing.calibration.outdoor.outdoor import OutdoorOptics
from processing.calibration.outdoor.sky_colour import tint_of_sky
from processing.calibration.profile import Correction, K2Record, RigProfile
from processing.calibration.scale.glare_fit import GlareKernel
from processing.calibration.scale.veiling_glare import kernel_from_surround, without_glare
from processing.calibration.scale.vignetting import Vignetting, published_vignetting
from processing.errors import LensError
from processing.ground.arrays import AnyArray
from processing.pictures.images import RelativeImage
from processing.sphere import Fisheye, LensMapping
from station.session.session import SessionManifest, Side

LENS_MAPPINGS = {"canon_5d2": LensMapping.EQUISOLID}
"""Of the paper's outdoor lens (EF 8-15 mm at 8 mm); others are assumed to be equidistant: none is measured."""
EYE_LENS = "equisolid,180"  # mapping and degrees of a fisheye at the eye, until it is said: of most circular ones
PUBLISHED_FALLOFF = {
    "theta_z1": (("theta_z1", 5.6),),
    "canon_5d2": (("canon_8mm_f5_6", 5.6), ("canon_8mm_f8", 8.0), ("canon_8mm_f11", 11.0)),
}
"""By kind of camera, with the aperture of each."""
OTHER_APERTURE_UNCERTAINTY = 0.03  # relative, of a fall-off published for another aperture (f/8 and f/11)
SURE_SUPPORT = 0.5  # share of rays on which the circle's edge must be seen, to trust it more than the rig file's
GLARE_MAX_MISFIT = 0.7  # chosen: half of the light's variance is then not the kernel's
GLARE_MAX_INDEX = 0.3  # veiling glare indices of lenses are below 0.1: more is other light on the sensor
LAMPS = "lamps in the dark, of the rig profile"
_CORRECTED: dict[Correction, str] = {
    "panorama": "the panorama's vignetting",
    "vignetting": "the outdoor lens's vignetting",
    "nd": "the filter's colour",
}


class OpticsChoice(Protocol):
    """What a user may say about the optics (see the parameters of the stage calibrate)."""

    @property
    def falloff(self) -> Literal["auto", "off"]:
        """Off: fall-off is not corrected."""

    @property
    def glare(self) -> Literal["auto", "keep"]:
        """Keep: the veil seen around the image circle stays."""

    @property
    def outdoor_field_deg(self) -> float:
        """Whole field of the outdoor lens, where no lens calibration says it."""

    @property
    def eye_lens(self) -> str | None:
        """Mapping and whole field in degrees of a fisheye at the eye, likewise."""


def falloff_of(
    session: SessionManifest, asked: OpticsChoice, profile: RigProfile | None, warnings: list[str], side: Side
) -> tuple[Vignetting | None, str]:
    """Return the fall-off that is corrected in a side's pictures (None: none is), and where it is from."""
    if asked.falloff == "off":
        return None, "correction switched off"
    camera = profile.cameras.get(side) if profile else None
    f_numbers = [f.f_number for f in session.frames if f.side is side and f.f_number]
    if camera and camera.vignetting:
        found = camera.vignetting.vignetting()
        at = found.f_number or (f_numbers[0] if f_numbers else 1.0)
        return _for_aperture(found, at, f_numbers, warnings), "from the rig profile"
    known = PUBLISHED_FALLOFF.get(_kind(session, side), ())
    if not known or (len(known) > 1 and not f_numbers):
        warnings.append(f"the {side} lens's vignetting is unknown and not corrected: measure it (daylit rig calibrate)")
        return None, "not corrected: unknown for this lens"
    name, nearest = min(known, key=lambda one: abs(math.log(one[1] / (f_numbers or [1.0])[0])))
    found = _for_aperture(published_vignetting(name), nearest, f_numbers, warnings)
    return found, f"published: {found.source}"


def find_optics(
    image: RelativeImage,
    session: SessionManifest,
    asked: OpticsChoice,
    profile: RigProfile | None,
    k2: K2Record | None,
    side: Side = Side.OUTDOOR,
) -> tuple[OutdoorOptics, dict[str, Any], list[str]]:
    """Return the optics, where each part is from, and warnings; ``side`` indoor: of a fisheye at the eye."""
    camera = profile.cameras.get(side) if profile else None
    warnings: list[str] = []
    if camera and camera.lens:
        lens, lens_source = camera.lens.lens(), "from the rig profile"
    else:
        lens, lens_source = _lens(image, session, asked, side, warnings)
    circle = lens.circle.scaled((image.rgb.shape[1], image.rgb.shape[0]))
    falloff, falloff_source = falloff_of(session, asked, profile, warnings, side)
    if side is Side.OUTDOOR:
        if _kind(session, side) not in LENS_MAPPINGS and lens.polynomial == ():
            warnings.append(f"the outdoor lens's mapping ({lens.mapping}) is assumed: angles may be 4 degrees off")
        measured = camera is not None and camera.nd is not None
        of_sky = None
        if not measured and k2 is None:
            with suppress(LensError):  # the sky shows no filter, or too little of it is seen
                of_sky = tint_of_sky(image, circle)
        tint, tint_source = _filter(session, profile, k2, of_sky, warnings)
    else:
        tint, tint_source = None, "no filter"
    if k2 is not None:
        panorama = falloff_of(session, asked, profile, [], Side.INDOOR)[0]
        warnings += corrections_unlike(k2, {"panorama": panorama, "vignetting": falloff, "nd": tint})
    field_deg = math.degrees(2 * lens.half_field_rad)
    facts = {
        "lens": {"mapping": str(lens.mapping), "field_deg": field_deg, "source": lens_source},
        "image_circle": {"centre_px": list(circle.centre_px), "radius_px": circle.radius_px},
        "falloff": falloff_source,
        "nd_colour": tint_source,
    }
    return OutdoorOptics(lens, falloff, tint), facts, warnings


def corrections_unlike(k2: K2Record, done: dict[Correction, object]) -> list[str]:
    """Return in words which corrections are made here but were not for k2, or the other way round; None: not made."""
    found = []
    for name, what in done.items():
        if (what is not None) == (name in k2.corrections):
            continue
        ways = ("with", "not applied now") if what is None else ("without", "applied now")
        off = "colours are" if name == "nd" else "outdoor values are"
        found.append(
            f"k2 was measured {ways[0]} correction of {_CORRECTED[name]}, which is {ways[1]}: {off} off by "
            "its value at the chart (and at the meter's target)"
        )
    return found


def glare_facts(kernel: GlareKernel, source: str) -> dict[str, Any]:
    """Return what reports say of a kernel."""
    return {"index": kernel.index, "uncertainty": kernel.misfit, "shares": list(kernel.shares), "source": source}


def lamp_kernel(profile: RigProfile | None, side: Side) -> GlareKernel | None:
    """Return the stray light that lamps have shown of a side's camera; None: the profile has none."""
    camera = profile.cameras.get(side) if profile else None
    return camera.glare.kernel() if camera and camera.glare else None


def glare_taken_off(
    merged: RelativeImage, lens: Fisheye, *, keep: bool = False, lamps: GlareKernel | None = None
) -> tuple[RelativeImage, GlareKernel | None, dict[str, Any]]:
    """Return the picture less the glare seen around the image circle (else ``lamps``'), its kernel, what was found.

    Unchanged, without a kernel, where it is to be kept, not seen or unsure. Its light came from the picture itself:
    what is left is raised so that the mean over the field stays. k1 and k2 are measured on targets about as bright as
    their rooms, with as much glare gained as light lost.
    """
    if keep:
        return merged, None, {"taken_off": False, "why": "as asked"}
    why, found = "", dict[str, Any]()
    try:
        kernel = kernel_from_surround(merged.rgb, merged.validity, lens)
        found = glare_facts(kernel, "surround of the image circle")
        if kernel.misfit > GLARE_MAX_MISFIT or kernel.index > GLARE_MAX_INDEX:
            why = "the surround is too uneven or too bright to measure"
    except LensError as error:
        why = str(error).split(" | ")[0]
    if why and lamps is None:
        return merged, None, found | {"taken_off": False, "why": why}
    if why and lamps is not None:
        kernel, found = lamps, glare_facts(lamps, LAMPS)
    return without_glare(replace(merged, geometry=lens), kernel), kernel, found | {"taken_off": True}


def _lens(
    merged: RelativeImage, session: SessionManifest, asked: OpticsChoice, side: Side, warnings: list[str]
) -> tuple[LensModel, str]:
    height, width = merged.validity.shape
    circle, source = circle_seen(merged.rgb, (width, height), stated_circle(session.rig, side))
    mapping, field_deg = LENS_MAPPINGS.get(_kind(session, side), LensMapping.EQUIDISTANT), asked.outdoor_field_deg
    how = "by the kind of camera, field as asked or usual"
    if side is Side.INDOOR:
        name, _, degrees = (asked.eye_lens or EYE_LENS).partition(",")
        mapping, field_deg, how = LensMapping(name), float(degrees), "as asked" if asked.eye_lens else "assumed"
        if not asked.eye_lens:
            warnings.append(f"the lens at the eye is taken as {EYE_LENS} degrees: if it is another, say so: --eye-lens")
    lens = LensModel(mapping, circle, math.radians(field_deg) / 2, source=source)
    return lens, f"{mapping} {how}; image circle {source}"


def circle_seen(
    pictures: AnyArray | Sequence[AnyArray], size_px: tuple[int, int], stated: Circle | None
) -> tuple[ImageCircle, str]:
    """Return the image circle as pictures show it (see `find_image_circle`), or as stated where they are not sure."""
    try:
        found = find_image_circle(pictures)
        if found.support >= SURE_SUPPORT or not stated:
            return found, "found in the picture"
    except LensError:
        if not stated:
            raise
    (column, row, radius), (width, height) = stated, size_px
    circle = ImageCircle((column * width, row * height), radius * width, size_px, support=0.0)
    return circle, "of the rig file"


def stated_circle(rig: dict[str, object], side: Side = Side.OUTDOOR) -> Circle | None:
    """Return the image circle that the rig file gave, as fractions (x of width, y of height, radius of width)."""
    table = rig.get(side.value)
    circle = table.get("image_circle") if isinstance(table, dict) else None
    if isinstance(circle, list | tuple) and len(circle) == 3 and all(isinstance(v, int | float) for v in circle):
        x, y, radius = (float(v) for v in circle)
        if -1 < x < 2 and -1 < y < 2 and 0 < radius <= 2:
            return x, y, radius
    return None


def _for_aperture(found: Vignetting, known_at: float, f_numbers: list[float], warnings: list[str]) -> Vignetting:
    """Return a fall-off with the doubt, and a warning, that it needs if it is of another aperture than the frames'."""
    if not f_numbers or abs(known_at / f_numbers[0] - 1) <= 0.05:
        return found
    warnings.append(f"vignetting at f/{f_numbers[0]:g} is unknown: that at f/{known_at:g} was used")
    return replace(found, relative_uncertainty=max(found.relative_uncertainty, OTHER_APERTURE_UNCERTAINTY))


def _filter(
    session: SessionManifest,
    profile: RigProfile | None,
    k2: K2Record | None,
    of_sky: NdFilter | None,
    warnings: list[str],
) -> tuple[NdFilter | None, str]:
    """Return the filter's tint, else the sky's; where a k2 is used, what was done for it is done again."""
    camera = profile.cameras.get(Side.OUTDOOR) if profile else None
    has_filter = any(d.nd_filter for d in session.devices if d.role == "outdoor")
    if camera is None or camera.nd is None:
        if of_sky is not None:
            return of_sky, of_sky.source
        if has_filter:
            warnings.append("the ND filter's colour is unknown and not corrected (daylit rig calibrate --nd)")
        return None, "not corrected: no measured filter" if has_filter else "no filter recorded"
    if k2 is not None and "nd" not in k2.corrections:
        # Not made here either, so that it is as it was for k2.
        warnings.append("k2 was measured without the filter's colour correction, so it is not applied here either")
        return None, "not corrected: k2 was measured without it"
    found = camera.nd.nd_filter()
    warnings += [found.doubt] if found.doubt else []
    return found, "from the rig profile"


def _kind(session: SessionManifest, side: Side) -> str:
    return next((device.kind for device in session.devices if device.role == side.value), "")
