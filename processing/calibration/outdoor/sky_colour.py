"""A filter's colour from the sky behind it, where no rig has measured it: skies have the colours of daylight.

Any part of the sky lies near the locus of daylight (CIE 15), wherever on it. What a filter does to red and to blue
moves all of it off: across the locus as far as it shows, along it as far as skies are rarely bluer or yellower.
"""

import math

import numpy as np

from processing.calibration.outdoor.lens import ImageCircle
from processing.calibration.outdoor.nd_filter import NdFilter
from processing.errors import LensError
from processing.ground.arrays import Doubles
from processing.ground.colour import LUMINANCE_WEIGHTS
from processing.pictures.images import RelativeImage, Validity

UPPER = 0.7  # of the circle's radius: what lies lower may be houses; chosen
MIREDS = (40.0, 222.0)  # of the locus: 25,000 to 4500 K
USUAL_MIRED, MIRED_SIGMA = 95.0, 40.0  # mean of the upper sky, clear (50 to 110) or overcast (130 to 165); chosen
ALIKE = 20  # independent parts of a sky; chosen
NEAR = 0.01  # of log red over green: skies are no nearer to the locus; chosen
MOST = 1.5  # of log blue over green, that a filter moves; chosen
LEAST_PX = 400  # chosen
SIGMAS = 2.0  # that a filter moves red or blue, at least; chosen
ENOUGH_PX = 100  # of a radius: every so many pixels are looked at; chosen
SOURCE = "the sky's own colours, brought to the locus of daylight (no rig has measured the filter)"


def tint_of_sky(image: RelativeImage, circle: ImageCircle) -> NdFilter | None:
    """Return the filter that a sky (H, W) seen through it shows: factors of red and blue, with their doubt.

    None where no filter at all is as likely.

    Raises `LensError` where too little of the sky is valid.
    """
    part = (slice(None, None, max(int(circle.radius_px / ENOUGH_PX), 1)),) * 2
    rgb, validity = image.rgb[part], image.validity[part]
    y, x = (np.arange(side)[part[0]] + 0.5 for side in image.validity.shape)
    upper = np.hypot(x - circle.centre_px[0], y[:, None] - circle.centre_px[1]) < UPPER * circle.radius_px
    seen = rgb[upper & (validity == Validity.VALID) & (rgb.min(axis=2) > 0)].astype(np.float64)
    if len(seen) < LEAST_PX:
        raise LensError("too little sky is visible to find the filter's colour", advice="daylit rig calibrate --nd")
    red, blue = np.log(seen[:, 0] / seen[:, 1]), np.log(seen[:, 2] / seen[:, 1])
    moves, found = np.linspace(-MOST, MOST, 151), []
    mireds, locus_red, locus_blue = _locus()
    for move in moves:
        mired = np.interp(move - blue, -locus_blue, mireds)
        off = red - np.interp(mired, mireds, locus_red)
        middle = float(np.median(off))
        # Blue beyond the locus's ends counts as off it.
        beyond = blue - move - np.clip(blue - move, locus_blue[-1], locus_blue[0])
        scatter = 1.4826 * float(np.median(np.abs(off - middle) + np.abs(beyond)))
        unusual = (float(mired.mean()) - USUAL_MIRED) / MIRED_SIGMA
        found.append((middle, -0.5 * unusual**2 - 0.5 * ALIKE * math.log(scatter**2 + NEAR**2)))
    shifts, likely = np.array(found).T
    weights = np.exp(likely - likely.max())
    weights /= weights.sum()
    both = np.stack([shifts, np.zeros_like(moves), moves], axis=1)
    mean = weights @ both
    sigma = np.sqrt(weights @ np.square(both - mean))
    if (np.abs(mean) <= SIGMAS * sigma).all():
        return None
    level = (seen.mean(axis=0) * np.exp(-both)) @ np.array(LUMINANCE_WEIGHTS)
    level *= np.exp(both) @ np.array(LUMINANCE_WEIGHTS)  # the luminance of white stays
    doubt = math.sqrt(float(weights @ (level - weights @ level) ** 2)) / float(weights @ level)
    source = f"{SOURCE}; red is good to {sigma[0]:.0%}, blue to {sigma[2]:.0%}"
    return NdFilter.of_matrix(np.diag(np.exp(mean)), relative_uncertainty=doubt, source=source)


def _locus() -> tuple[Doubles, Doubles, Doubles]:
    """Return mireds (N,), rising, and log red and blue over green of daylight there in linear Rec. 709."""
    import colour

    mireds = np.linspace(*MIREDS, 200)
    xy = colour.temperature.CCT_to_xy_CIE_D(1e6 / mireds)
    rgb = colour.xy_to_XYZ(xy) @ np.linalg.inv(colour.RGB_COLOURSPACES["ITU-R BT.709"].matrix_RGB_to_XYZ).T
    return mireds, np.log(rgb[:, 0] / rgb[:, 1]), np.log(rgb[:, 2] / rgb[:, 1])
