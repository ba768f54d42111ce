"""What stands between the sky and the outdoor picture: from the rig profile, published data, and the picture itself."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from processing.calibration.image_circle import ImageCircle, find_image_circle
from processing.calibration.lens import LensModel
from processing.calibration.nd_filter import NdFilter
from processing.calibration.outdoor import OutdoorOptics
from processing.calibration.profile import K2Record, RigProfile
from processing.calibration.veiling_glare import veil_from_surround
from processing.calibration.vignetting import Vignetting, published_vignetting
from processing.errors import LensError
from processing.images import RelativeImage
from processing.sphere import LensMapping
from processing.stages.calibrate_parameters import CalibrateParameters
from station.session import SessionManifest, Side

LENS_MAPPINGS = {"canon_5d2": LensMapping.EQUISOLID}
"""Of the paper's outdoor lens (EF 8-15 mm at 8 mm); others are equidistant until calibrated."""
PUBLISHED_FALLOFF = {"canon_5d2": (("canon_8mm_f5_6", 5.6), ("canon_8mm_f8", 8.0), ("canon_8mm_f11", 11.0))}
OTHER_APERTURE_UNCERTAINTY = 0.03
"""Relative, of a fall-off published for another aperture: f/8 and f/11 differ by that much."""
SURE_SUPPORT = 0.5
"""Share of rays on which the circle's edge must be seen, to trust it more than the rig file's."""
VEIL_MAX_UNCERTAINTY = 0.5


def find_optics(
    merged: RelativeImage,
    session: SessionManifest,
    asked: CalibrateParameters,
    profile: RigProfile | None,
    k2: K2Record | None,
) -> tuple[OutdoorOptics, dict[str, Any], list[str]]:
    """Return the optics, where each part is from, and warnings."""
    camera = profile.cameras.get(Side.OUTDOOR) if profile else None
    warnings: list[str] = []
    if camera and camera.lens:
        lens, lens_source = camera.lens.lens(), "the rig profile's"
    else:
        lens, lens_source = _lens(merged, session, asked)
    falloff, falloff_source = _falloff(session, asked, profile, warnings)
    tint, tint_source = _filter(session, profile, k2, warnings)
    if k2 is not None and falloff is not None and "vignetting" not in k2.corrections:
        warnings.append(
            "k2 was measured without correcting the fall-off: it is off by the fall-off at the chart's place"
        )
    circle = lens.circle.scaled((merged.rgb.shape[1], merged.rgb.shape[0]))
    facts = {
        "lens": {
            "mapping": str(lens.mapping),
            "field_deg": math.degrees(2 * lens.half_field_rad),
            "source": lens_source,
        },
        "image_circle": {"centre_px": list(circle.centre_px), "radius_px": circle.radius_px},
        "falloff": falloff_source,
        "nd_colour": tint_source,
    }
    return OutdoorOptics(lens, falloff, tint), facts, warnings


def veil_taken_off(
    merged: RelativeImage, lens: LensModel, asked: CalibrateParameters
) -> tuple[RelativeImage, dict[str, Any]]:
    """Return the picture less the veil seen around the image circle, and what was found; unchanged where unsure."""
    circle = lens.circle.scaled((merged.rgb.shape[1], merged.rgb.shape[0]))
    if asked.glare == "keep":
        return merged, {"taken_off": False, "why": "as asked"}
    try:
        veil = veil_from_surround(merged.rgb, merged.validity, circle.centre_px, circle.radius_px)
    except LensError as error:
        return merged, {"taken_off": False, "why": str(error).split(" | ")[0]}
    found = {"index": veil.index, "uncertainty": veil.uncertainty}
    if veil.uncertainty > VEIL_MAX_UNCERTAINTY:
        return merged, found | {"taken_off": False, "why": "the surround is too uneven to tell"}
    light = merged.rgb - np.array(veil.veil_rgb, dtype=np.float32)
    return replace(merged, rgb=np.maximum(light, np.float32(0))), found | {"taken_off": True}


def _lens(merged: RelativeImage, session: SessionManifest, asked: CalibrateParameters) -> tuple[LensModel, str]:
    circle, source = _circle(merged, session)
    mapping = LENS_MAPPINGS.get(_kind(session), LensMapping.EQUIDISTANT)
    lens = LensModel(mapping, circle, math.radians(asked.outdoor_field_deg) / 2, source=source)
    return lens, f"{mapping} by the kind of camera, field as asked or usual; image circle {source}"


def _circle(merged: RelativeImage, session: SessionManifest) -> tuple[ImageCircle, str]:
    """Return the image circle as the picture shows it, or as the rig file has it where the picture is not sure."""
    height, width = merged.rgb.shape[:2]
    recorded = (session.rig.get("outdoor") or {}).get("image_circle")
    try:
        found = find_image_circle(merged.rgb)
        if found.support >= SURE_SUPPORT or not recorded:
            return found, "found in the picture"
    except LensError:
        if not recorded:
            raise
    column, row, radius = (float(v) for v in recorded)
    return ImageCircle((column * width, row * height), radius * width, (width, height)), "of the rig file"


def _falloff(
    session: SessionManifest, asked: CalibrateParameters, profile: RigProfile | None, warnings: list[str]
) -> tuple[Vignetting | None, str]:
    if asked.falloff == "off":
        return None, "not corrected, as asked"
    camera = profile.cameras.get(Side.OUTDOOR) if profile else None
    if camera and camera.vignetting:
        return camera.vignetting.vignetting(), "the rig profile's"
    known = PUBLISHED_FALLOFF.get(_kind(session), ())
    f_numbers = [f.f_number for f in session.frames if f.side is Side.OUTDOOR and f.f_number]
    if not known or not f_numbers:
        warnings.append("the outdoor lens's fall-off is not known and not corrected: measure it (daylit rig calibrate)")
        return None, "not corrected: none is known for this lens"
    name, nearest = min(known, key=lambda one: abs(math.log(one[1] / f_numbers[0])))
    found = published_vignetting(name)
    if abs(nearest / f_numbers[0] - 1) > 0.05:
        found = replace(found, relative_uncertainty=OTHER_APERTURE_UNCERTAINTY)
        warnings.append(f"fall-off at f/{f_numbers[0]:g} is not known: that at f/{nearest:g} was used")
    return found, f"published: {found.source}"


def _filter(
    session: SessionManifest, profile: RigProfile | None, k2: K2Record | None, warnings: list[str]
) -> tuple[NdFilter | None, str]:
    """Return the filter's tint; where a k2 is used, what was done for it is done again."""
    camera = profile.cameras.get(Side.OUTDOOR) if profile else None
    has_filter = any(d.nd_filter for d in session.devices if d.role == "outdoor")
    if camera is None or camera.nd is None:
        if has_filter:
            warnings.append("the ND filter's colour is not known and not corrected (daylit rig calibrate --nd)")
        return None, "not corrected: no measured filter" if has_filter else "no filter recorded"
    if k2 is not None and "nd" not in k2.corrections:
        warnings.append("k2 was measured without the filter's colour correction, so it is not made here either")
        return None, "not corrected: k2 was measured without it"
    return camera.nd.nd_filter(), "the rig profile's"


def _kind(session: SessionManifest) -> str:
    return next((device.kind for device in session.devices if device.role == "outdoor"), "")
