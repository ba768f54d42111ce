"""The stage calibrate where one panorama was given: no bracket, no meter; relative units unless the file says more."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from processing.calibration.scale.photometry import PLANES, illuminances
from processing.pictures.images import LuminanceImage
from processing.pictures.panorama import GivenPanorama, read_panorama
from processing.stages.contract import StageContext, StageOutput, StageWarning
from processing.stages.parameters import CalibrateParameters

MUCH_CLIPPED = 0.001
"""Share of all directions."""
NO_SCALE = (
    "one picture, no meter: every luminance is in relative units (100: a photograph's white). Proportions hold as far "
    "as the picture keeps them; nothing is in cd/m2 or lx"
)


def calibrate_panorama(context: StageContext) -> StageOutput:
    """Return the session's panorama as the calibrated picture; it says itself whether it is absolute."""
    asked, record = context.parameters, context.session.panorama
    assert isinstance(asked, CalibrateParameters)
    assert record is not None
    found = read_panorama(context.session_path / record.file, k1=asked.k1)
    attributes = {
        **found.image.attributes,
        "side": "indoor",
        "session_id": context.session.session_id,
        "source": found.source,
        "units": found.image.unit,
    }
    image = replace(found.image, attributes=attributes)
    facts = _facts(found, image)
    return StageOutput(
        artifacts={"indoor": image, "calibration": {"indoor": facts}},
        metrics={"absolute": image.absolute, "units": image.unit, "clipped_share": round(found.clipped_share, 5)},
        warnings=tuple(StageWarning(code="indoor", message=text[:500]) for text in _warnings(found, asked)),
        left_out={"outdoor": "one picture: there is no sky"}
        | ({} if image.absolute else {"scale": "no meter reading, and the file does not say what its values are"}),
    )


def _facts(found: GivenPanorama, image: LuminanceImage) -> dict[str, Any]:
    """Return what the report and others read; without a scale there are neither k1 nor illuminances."""
    absolute = image.absolute
    return {
        "absolute": absolute,
        "units": image.unit,
        "source": found.source,
        "factor": found.factor,
        "clipped_share": found.clipped_share,
        "k1": found.factor if absolute else None,
        "k1_relative_uncertainty": image.scale_uncertainty if absolute else None,
        "k1_parts": {},
        "falloff": "not corrected: one picture",
        "target": {"source": "none: one picture"},
        "meter_cd_m2": None,
        "displayed": None,
        "meter_drift_frac": None,
        "illuminance_lx": illuminances(image, PLANES)[0] if absolute else {},
    }


def _warnings(found: GivenPanorama, asked: CalibrateParameters) -> list[str]:
    told = list(found.notes)
    if not found.image.absolute:
        told.append(NO_SCALE)
    elif asked.k1 is not None:
        told.append("k1 is as given: its uncertainty is not known, and not part of the uncertainties stated")
    if found.clipped_share > MUCH_CLIPPED:
        told.append(
            f"{found.clipped_share:.1%} of all directions are clipped (windows, lamps): their light is a lower bound, "
            "and daylight that comes in there is underestimated"
        )
    return told
