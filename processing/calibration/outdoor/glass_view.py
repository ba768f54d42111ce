"""A sky taken with a panorama camera from inside, close to the window: which directions see outside.

Pano2Pano has such skies: no fisheye lens, no filter, the room all around. What the window shows is brighter than the
room by stops: Otsu's threshold (IEEE Trans. SMC 9, 1979) parts the log luminances, weighted by solid angle.
"""

from dataclasses import replace

import cv2
import numpy as np

from processing.errors import LensError
from processing.ground.arrays import Flags
from processing.pictures.images import RelativeImage, Validity, luminance_cd_m2
from processing.sphere import Equirectangular, solid_angles
from station.session.session import SessionManifest, Side

LEAST_STOPS = 3.0  # chosen: daylight outside is 10 to 1,000 times the luminance of a room; less is no window
LEAST_SHARE = 0.1  # of the largest bright region; chosen: smaller ones are lamps and patches of sunlight
BINS = 256  # chosen: a tenth of a stop over the widest range
SAME_CAMERA_UNCERTAINTY = 0.03  # relative, of k2 = 1 between two brackets of one camera; chosen: two estimated curves


def only_the_view(image: RelativeImage) -> tuple[RelativeImage, float]:
    """Return the panorama with the room marked as outside the field, and the share of the sphere that is left.

    Raises `LensError` where the window's view does not stand out from the room by `LEAST_STOPS`.
    """
    assert isinstance(image.geometry, Equirectangular)
    area = solid_angles(image.geometry)
    luminance = luminance_cd_m2(image.rgb)
    seen = (image.validity != Validity.OUTSIDE) & (luminance > 0)
    stops = np.log2(np.where(seen, luminance, 1.0))
    weights = np.where(seen, area, 0.0)
    if not seen.any() or np.ptp(stops[seen]) < LEAST_STOPS:
        raise _no_view(0.0)
    # The value (N,) of log2 luminance that parts the two classes best, weighted (N,) by solid angle
    counts, edges = np.histogram(stops[seen], BINS, weights=weights[seen])
    below, moment = np.cumsum(counts), np.cumsum(counts * ((edges[:-1] + edges[1:]) / 2))
    with np.errstate(divide="ignore", invalid="ignore"):
        between = (moment[-1] * below / below[-1] - moment) ** 2 / (below * (below[-1] - below))
    bright = seen & (stops > float(edges[1 + int(np.nanargmax(between[:-1]))]))
    apart = np.average(stops[bright], weights=weights[bright]) - np.average(
        stops[seen & ~bright], weights=weights[seen & ~bright]
    )
    if apart < LEAST_STOPS:
        raise _no_view(float(apart))
    view = _largest(bright, weights)
    rgb, uncertainty, validity = image.rgb.copy(), image.uncertainty.copy(), image.validity.copy()
    rgb[~view], uncertainty[~view], validity[~view] = 0, np.inf, Validity.OUTSIDE
    share = float(area[view].sum() / area.sum())
    return replace(image, rgb=rgb, uncertainty=uncertainty, validity=validity), share


def _no_view(stops: float) -> LensError:
    return LensError(
        f"the view through the window is only {stops:.1f} stops brighter than the room",
        likely="taken at night, with curtains drawn, or not towards a window",
        advice="take the sky with the fisheye, or leave it out",
    )


def _largest(bright: Flags, weights: np.ndarray) -> Flags:
    """Return the largest region (H, W) by solid angle and those of `LEAST_SHARE` of it; the seam joins."""
    start = int(np.argmin(bright.sum(axis=0)))
    rolled = np.roll(bright, -start, axis=1).astype(np.uint8)
    count, labels = cv2.connectedComponents(rolled, connectivity=8)
    areas = np.bincount(labels.ravel(), np.roll(weights, -start, axis=1).ravel(), count)
    areas[0] = 0
    return np.asarray(
        np.roll(np.isin(labels, np.flatnonzero(areas >= LEAST_SHARE * areas.max())) & (rolled > 0), start, axis=1)
    )


def not_one_camera(session: SessionManifest) -> str | None:
    """Return why the sky has not the room's scale; None where one camera took both with one setting and no filter."""
    found = []
    for side in (Side.INDOOR, Side.OUTDOOR):
        device = next((d for d in session.devices if d.role == side.value), None)
        settings = {(f.iso, f.f_number) for f in session.pictures(side)}
        found.append((device.model if device else "", device.nd_filter if device else "", settings))
    if found[0] == found[1] and found[0][0] and not found[0][1]:
        return None
    return "the sky panorama is from another camera or other settings than the room's: give --k2"
