"""Pictures in memory. Two types, so that an uncalibrated picture cannot reach rendering by mistake.

All are linear RGB, float32 (H, W, 3), Rec. 709 primaries. A `RelativeImage` has an arbitrary scale; in a
`LuminanceImage` 0.2127 R + 0.7151 G + 0.0722 B is luminance in cd/m2 (Ji et al. 2023, eq. 1 and 2). Values are finite
and not negative everywhere, those of invalid pixels too (the best bound known: the saturation level, or 0).
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import IntEnum
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from processing.ground.arrays import Bytes, Floats
from processing.ground.colour import LUMINANCE_WEIGHTS as LUMINANCE_WEIGHTS
from processing.ground.colour import luminance_cd_m2 as luminance_cd_m2
from processing.sphere import Geometry, in_pixels

ABSOLUTE_UNITS = "cd/m2"
RELATIVE_UNITS = "relative units"


class Validity(IntEnum):
    """What a pixel's value is worth."""

    VALID = 0
    CLIPPED = 1
    """Brighter than every frame can record: the value is a lower bound."""
    DARK = 2
    """Darker than every frame can record: the value is 0 or a poor estimate; its uncertainty says how poor."""
    OUTSIDE = 3
    """Outside the lens's field: no data, value 0."""
    REPAIRED = 4
    """Clipped, and replaced on request (the sun): the value is a model's, not the picture's."""


@dataclass(frozen=True)
class RelativeImage:
    """A merged bracket before calibration: values relative to a scale that is still to be found."""

    rgb: Floats
    """(H, W, 3)."""
    uncertainty: Floats
    """(H, W): relative standard uncertainty of the luminance (1 sigma), 0 < u; inf where nothing is known."""
    validity: Bytes
    """(H, W): `Validity`."""
    geometry: Geometry
    ghost: Bytes | None = None
    """(H, W): 0 where nothing moved, else 1 + index of the frame whose moment is shown there; None: not looked for."""
    attributes: Mapping[str, object] = field(default_factory=dict)

    @property
    def unit(self) -> str:
        """`RELATIVE_UNITS`: the scale is still to be found."""
        return RELATIVE_UNITS

    def luminance(self) -> Floats:
        """Return the luminance of each pixel, (H, W) >= 0, in relative units."""
        return luminance_cd_m2(self.rgb)

    def _repr_html_(self) -> str:
        return _shown(self)


@dataclass(frozen=True)
class LuminanceImage:
    """A picture in cd/m2; where ``absolute`` is false, one that would be if its scale were known."""

    rgb: Floats
    uncertainty: Floats
    """(H, W): relative standard uncertainty of each pixel by itself; the common scale's is ``scale_uncertainty``."""
    validity: Bytes
    geometry: Geometry
    scale_uncertainty: float
    """Relative standard uncertainty of the factor that all pixels share (meter, k1, k2)."""
    ghost: Bytes | None = None
    attributes: Mapping[str, object] = field(default_factory=dict)
    """Provenance as plain JSON values: k1, k2, meter_cd_m2, side, session_id, ..."""
    absolute: bool = True
    """False: nothing gave the scale (a single photograph), so that values are in `RELATIVE_UNITS`, not in cd/m2. All
    that is made from such a picture is of the same kind, and says so."""

    @property
    def unit(self) -> str:
        """What luminances of this picture are in, for people: ``cd/m2`` or `RELATIVE_UNITS`."""
        return ABSOLUTE_UNITS if self.absolute else RELATIVE_UNITS

    def luminance_cd_m2(self) -> Floats:
        """Return the luminance of each pixel, (H, W) >= 0, in ``unit``: cd/m2 where the picture is ``absolute``."""
        return luminance_cd_m2(self.rgb)

    def _repr_html_(self) -> str:
        return _shown(self)


P = TypeVar("P", bound=RelativeImage | LuminanceImage)


def in_blocks(image: P, factor: int) -> P:
    """Return a picture a ``factor`` smaller, that divides its sides: means of blocks, with the worst validity of each.

    What moved is not known of it.
    """
    import cv2

    size = image.rgb.shape[1] // factor, image.rgb.shape[0] // factor
    means = (cv2.resize(one, size, interpolation=cv2.INTER_AREA) for one in (image.rgb, image.uncertainty))
    rgb, uncertainty = (np.asarray(one, np.float32) for one in means)
    geometry, validity = in_pixels(image.geometry, *size), worst_in_blocks(image.validity, factor)
    return replace(image, rgb=rgb, uncertainty=uncertainty, validity=validity, geometry=geometry, ghost=None)


def worst_in_blocks(values: npt.NDArray[Any], factor: int) -> npt.NDArray[Any]:
    """Return the greatest of each block of codes or flags (H, W): (H / factor, W / factor), of their type."""
    height, width = values.shape
    return np.ascontiguousarray(values.reshape(height // factor, factor, width // factor, factor).max(axis=(1, 3)))


def _shown(image: RelativeImage | LuminanceImage) -> str:
    """Return a picture as a notebook shows it: a small preview, size, unit and range."""
    import base64

    from processing.pictures.display import AS_GIVEN
    from processing.pictures.preview import jpeg_bytes

    height, width = image.validity.shape
    step = max(1, width // 800)
    preview = base64.b64encode(jpeg_bytes(AS_GIVEN.exposed(image.rgb).shown(image.rgb[::step, ::step]))).decode("ascii")
    valid = luminance_cd_m2(image.rgb[image.validity == Validity.VALID])
    span = f"{valid.min():.4g} to {valid.max():.4g} {image.unit}" if valid.size else "no valid pixel"
    text = f"{width} x {height}, {type(image.geometry).__name__.lower()}; luminance {span}"
    return f'<figure><img src="data:image/jpeg;base64,{preview}"><figcaption>{text}</figcaption></figure>'
