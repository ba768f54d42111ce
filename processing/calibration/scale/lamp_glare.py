"""A lens's stray light from a small bright lamp: seen, and hidden from the lens by a card, in a dark room.

The room's own light is the same in both pictures, so that their difference is the lamp and what the lens scatters of it
(the small-occluder method of ISO 9358, with the lamp as the source). Several lamps' places make a sweep.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from processing.calibration.scale.glare_fit import SECTORS, GlareKernel, fit_kernel, hidden_factors
from processing.calibration.scale.veiling_glare import Cells, cells_around, in_cells
from processing.errors import LensError, ParameterError
from processing.ground.arrays import Doubles, Flags, Indices
from processing.pictures.images import RelativeImage, Validity, luminance_cd_m2

ROWS = 48  # of cells; chosen: 3.75 degrees, half the narrowest part's width at half its height
NEAR_RAD = 0.2  # around the lamp, which a card may hide; chosen: 11 degrees
LEAST_CONTRAST = 30.0  # of the lamp's cell over the room's mean; chosen: what it lights is then not the lamp
LEAST_INDEX = 1e-4  # of the lamp's light, evenly spread: less is not measured. Chosen.
MOST_CLIPPED = 0.02  # of what is seen of the lamp; chosen: what clipping hides may be many times as much
MOST_CHANGE = 0.05  # of the room's light between the two; chosen
LEAST_CELLS = 100  # chosen


def kernel_from_lamps(pairs: Sequence[tuple[RelativeImage, RelativeImage]], *, two_lenses: bool) -> GlareKernel:
    """Return the kernel by pairs of one camera's pictures, linear and of one scale: the lamp seen, and hidden.

    ``two_lenses``: a panorama camera, whose lenses scatter each within its half; there the other one shows whether the
    room's light changed meanwhile. Raises `LensError`: no lamp, light that changed, or all clipped; `ParameterError`:
    pictures of different kinds.
    """
    places = [_scattered(*pair, two_lenses) for pair in pairs]
    parts, found, sector = (np.concatenate([place[k] for place in places], axis=-1) for k in range(3))
    # One lamp: what clipping hides of it is taken to be the same wherever it is clipped.
    fit = fit_kernel(parts, found, sector, max((place[3] for place in places), key=len))
    count = len(fit.shares)
    covariance = tuple(row[:count] for row in fit.covariance[:count])
    cells = cells_around(pairs[0][0].geometry, ROWS, two_lenses)
    even = cells.scattered(cells.inside[:, None].astype(np.float64))[:, cells.inside, 0].mean(axis=1)
    index = float(np.array(fit.shares) @ even)
    return replace(fit, covariance=covariance, index=index, hidden=(0.0,) * count, two_lenses=two_lenses)


def _scattered(
    seen: RelativeImage, hidden: RelativeImage, two_lenses: bool
) -> tuple[Doubles, Doubles, Indices, Doubles]:
    """Return parts (2, P, N), light (N,) and sector (N,) of a pair's cells, and the factors that clipping may hide."""
    if seen.geometry != hidden.geometry:
        raise ParameterError("the lamp's two pictures differ in camera or size")
    cells = cells_around(seen.geometry, ROWS, two_lenses)
    both = [luminance_cd_m2(image.rgb) for image in (seen, hidden)]
    clipped = [image.validity == Validity.CLIPPED for image in (seen, hidden)]
    more = both[0] - both[1]
    found = in_cells(np.stack([more, more * clipped[0], clipped[0] | clipped[1], both[1]], axis=-1), cells.shape)
    lamp = int(np.argmax(found[:, 0]))
    near = np.arccos(np.clip(cells.places @ cells.places[lamp], -1, 1)) < NEAR_RAD
    far = cells.inside & ~near
    if found[near, 1].sum() > MOST_CLIPPED * found[near, 0].sum():
        raise LensError(
            "the lamp is clipped in every frame, so its luminance is unknown",
            advice="add shorter exposures, or use a weaker lamp",
        )
    room = float(np.median(found[far, 3]))
    if not found[lamp, 0] > LEAST_CONTRAST * max(room, 1e-30):
        raise LensError("both pictures show the same lamps", advice="use a darker room or a brighter lamp")
    light = np.where(near[:, None], np.maximum(found[:, :2], 0), 0)
    use = far & (found[:, 2] == 0) & _thinned(cells)
    if cells.side is not None:
        other = use & (cells.side != cells.side[lamp])
        change = float(np.median(found[other, 0] / np.maximum(found[other, 3], 1e-30))) if other.any() else 0.0
        if abs(change) > MOST_CHANGE:
            raise LensError(f"the room's light changed by {100 * change:+.0f} % between the lamp's two pictures")
        use &= cells.side == cells.side[lamp]
    if np.count_nonzero(use) < LEAST_CELLS:
        raise LensError("the lamp's pictures are clipped nearly everywhere", advice="use a weaker lamp")
    least = LEAST_INDEX * float(cells.area @ light[:, 0]) / float(cells.area @ cells.inside)
    level, scale = np.maximum(found[use, 0], least), max(float(found[use, 0].mean()), least)
    parts = np.moveaxis(cells.scattered(light), -1, 0)[..., use] / scale
    return parts, level / scale, _sectors(cells, lamp)[use], hidden_factors(light)


def _sectors(cells: Cells, lamp: int) -> Indices:
    """Return the sector (N,) of cells around the lamp's."""
    ahead = cells.places[lamp]
    across = np.cross(ahead, (0.0, 0.0, 1.0) if abs(ahead[2]) < 0.9 else (1.0, 0.0, 0.0))
    across /= np.linalg.norm(across)
    around = np.arctan2(cells.places @ np.cross(ahead, across), cells.places @ across)
    return np.floor((around / (2 * math.pi) + 0.5) * SECTORS).astype(int) % SECTORS


def _thinned(cells: Cells) -> Flags:
    """Return cells (N,) of about one density: those of a panorama crowd at its poles."""
    rows, columns = cells.shape
    share = cells.area.reshape(rows, columns) / max(float(cells.area.max()), 1e-30)
    return np.asarray(np.diff(np.floor(np.cumsum(share, axis=1)), axis=1, prepend=0) > 0).ravel()
