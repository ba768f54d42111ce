"""What is white in a room, whose light has been on lawn, floor and walls, and how what may be white is shown whiter."""

import math

import numpy as np

from processing.ground.arrays import Doubles, Flags, Floats
from processing.ground.colour import LUMINANCE_WEIGHTS, luminance_cd_m2
from processing.ground.kernels import compiled
from processing.ground.seam import row_solid_angles

CALM, CALM_SPREAD = 0.6, 0.2
"""Share of its distance from grey that is taken from what is nearly grey; spread of its channels over the luminance, at
which half of that is taken. White paint is lit by sky, lawn and floor at once, and one white corrects for one of them.
Chosen on 16 rooms of validation seeds (docs/measurements/render.md)."""
INDOORS = 2.0
"""Level up to which something may be white in the sky's light (from one below on less and less); above is the view.
Chosen by looking."""
MOST_GAIN = 3.0  # of red or blue over green: light farther from white is no light of a room. Chosen: a candle's is 2.6.
OVERHEAD_RAD = math.radians(50)
"""Latitude above which a panorama shows the ceiling. Chosen: of a room 2.4 m high, what is within 0.7 m."""
CEILING_STOPS, CEILING_SHARE = 0.8, 0.8
"""How far from the light's colour a white ceiling may look (red or blue over green), and its share in white. Chosen on
simulated rooms, those of the benchmark's seeds among them: light that has been on brown floors and lawns is up to 0.65
stops from the board's."""
BLUE, LEAST_SKY = 1.1, 0.03
"""Blue over luminance of a blue sky; share of a view's light that is as blue, from which the sky is. By looking."""
_NORM = 6.0  # of the mean of neutral surfaces: Finlayson and Trezzi 2004, Shades of Gray, find 6 best


def white_of(rgb: Floats, board_rgb: Doubles | None, panes: Flags | None) -> tuple[Doubles, str]:
    """Return the light's colour (3,) of luminance 1, and where it is from.

    ``rgb`` (H, W, 3): the panorama, linear, any scale; ``board_rgb`` (3,): colour of the white board, any scale;
    ``panes`` (H, W): where one looks out of a window. A room has no one light: what falls on the ceiling has been on
    floor and lawn before, and by the board's white the ceiling looks yellow. Where board, windows or surfaces allow the
    ceiling to be white, white is mostly its colour.
    """
    white, source = _light(rgb, board_rgb, panes)
    overhead = rgb[: max(1, round((0.5 - OVERHEAD_RAD / math.pi) * len(rgb)))]
    ceiling = _plausible(np.asarray(np.median(overhead.reshape(-1, 3), axis=0), np.float64))
    if source == "given" or ceiling is None:
        return white, source
    apart = np.abs(np.log2((ceiling / ceiling[1]) / (white / white[1]))).max()
    if apart > CEILING_STOPS:
        return white, source
    mixed = ceiling**CEILING_SHARE * white ** (1 - CEILING_SHARE)
    return np.asarray(mixed / (mixed @ np.asarray(LUMINANCE_WEIGHTS))), f"{source} and ceiling"


def _light(rgb: Floats, board_rgb: Doubles | None, panes: Flags | None) -> tuple[Doubles, str]:
    """Return the first colour (3,) that can be a room's light, at luminance 1, and where it is from."""
    if board_rgb is not None and (found := _plausible(board_rgb)) is not None:
        return found, "board"
    if panes is not None and panes.any():
        weight = np.broadcast_to(row_solid_angles(panes.shape), panes.shape)[panes]
        if (found := _plausible(weight @ rgb[panes])) is not None:
            return found, "windows"
    step = max(1, rgb.shape[1] // 512)
    sample = np.asarray(rgb[::step, ::step], np.float64)
    level = luminance_cd_m2(sample)
    inside = sample[level < np.quantile(level, 0.98)]  # lamps and windows are no surfaces
    found = _plausible(np.mean(inside**_NORM, axis=0) ** (1 / _NORM) if inside.size else np.zeros(3))
    return (np.ones(3), "given") if found is None else (found, "surfaces")


def _plausible(rgb: Doubles) -> Doubles | None:
    """Return a colour at luminance 1; None for what is no light of a room."""
    level = float(rgb @ np.asarray(LUMINANCE_WEIGHTS))
    if not (np.isfinite(rgb).all() and level > 0 and rgb.min() > 0):
        return None
    share = rgb / rgb[1]
    return np.asarray(rgb / level) if share.max() < MOST_GAIN and share.min() > 1 / MOST_GAIN else None


def sky_of(view: Doubles, weight: Doubles) -> tuple[float, ...] | None:
    """Return the colour of luminance 1 of what is blue in a view (N, 3), of shares ``weight`` (N,); None: none is."""
    level = luminance_cd_m2(view)
    light, blue = weight * level, (view[:, 2] > BLUE * level) & (view[:, 0] < level)
    if not light[blue].sum() > LEAST_SKY * light.sum():
        return None
    rgb = weight[blue] @ view[blue]
    return tuple(float(v) for v in rgb / (rgb @ np.asarray(LUMINANCE_WEIGHTS)))


@compiled
def calm(light, most):  # type: ignore[no-untyped-def]
    """Bring in place what is nearly grey (H, W, 3) nearer to grey by ``most`` (a share), at the same luminance."""
    red, green, blue = LUMINANCE_WEIGHTS
    for i in range(light.shape[0]):
        for j in range(light.shape[1]):
            r, g, b = light[i, j]
            level = red * r + green * g + blue * b
            spread = (max(r, g, b) - min(r, g, b)) / (CALM_SPREAD * level + 1e-9)
            share = most / (1 + spread**4)
            for c in range(3):
                light[i, j, c] += np.float32((level - light[i, j, c]) * share)


@compiled
def skylit(light, bluer, most):  # type: ignore[no-untyped-def]
    """Bring in place what may be white in the sky's light (H, W, 3) nearer to white by ``most``, at the same luminance.

    ``bluer`` (3,): the sky's colour less white. A colour between both is taken for a white one that the sky lights in
    part; what is bluer than the sky keeps its colour by as much, and so does what is as bright as a view.
    """
    red, green, blue = LUMINANCE_WEIGHTS
    size = bluer[0] ** 2 + bluer[1] ** 2 + bluer[2] ** 2
    for i in range(light.shape[0]):
        for j in range(light.shape[1]):
            r, g, b = light[i, j]
            level = red * r + green * g + blue * b
            if b <= level or level >= INDOORS:
                continue
            r, g, b = r / level - 1, g / level - 1, b / level - 1
            along = (r * bluer[0] + g * bluer[1] + b * bluer[2]) / size
            aside = (r * r + g * g + b * b - along * along * size) / CALM_SPREAD**2
            share = most * level * max(min(along, 2 - along, INDOORS - level, 1.0), 0.0) / (1 + aside * aside)
            for c in range(3):
                light[i, j, c] -= np.float32(share * bluer[c])
