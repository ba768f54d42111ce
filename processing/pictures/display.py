"""How a room's pictures are shown: balanced, exposed, the view outside kept, on a film curve; measured values stay.

One `Display` belongs to a room and serves all its states, so that before and after compare. Light goes to the screen in
six steps: adaptation to the screen's white and exposure (one matrix); whites that a blue sky lights become whiter; the
window pull, as a photographer blends in a darker exposure; large highlights are lowered and keep their texture; what is
nearly white becomes whiter; and `film`, which rolls highlights off. ``panorama.ts`` of the viewer has the same film, on
light that has been through the others.
"""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from functools import cache
from typing import Any, Self, cast

import cv2
import numpy as np
import numpy.typing as npt

from processing.errors import ParameterError
from processing.ground.arrays import Bytes, Doubles, Flags, Floats
from processing.ground.colour import LUMINANCE_WEIGHTS, RGB_OF_XYZ, XYZ_OF_RGB, luminance_cd_m2, srgb_decoded
from processing.ground.seam import row_solid_angles, wrapped
from processing.ground.threads import side_by_side
from processing.pictures.whites import CALM, calm, sky_of, skylit, white_of

BRADFORD = ((0.8951, 0.2664, -0.1614), (-0.7502, 1.7135, 0.0367), (0.0389, -0.0685, 1.0296))
"""CIE XYZ to cone responses (Lam 1985), as ICC profiles use it."""
SPOT_RAD = math.radians(0.7)  # of the white board, averaged for its colour: the smallest is twice as wide. Chosen
BRIGHT_SHARE, BRIGHT_LEVEL = 0.75, 0.52
"""Three quarters of the room, windows apart, are darker than this level of the film: light walls are then light, and
not white. Chosen by looking at simulated and real rooms."""
VIEW_SHARE, VIEW_LEVEL = 0.8, 0.65  # the same of what is seen through panes: brighter, lawns are pale. By looking
MOST_PULL_STOPS = 6.0  # a photographer's darkest exposure under the room's. Chosen.
LEAST_VIEW = 0.9  # of the film, from which something in a pane is the view: not the room's light walls. Chosen.
VIEW_GREEN = 1.25  # green over red from which something in a pane is the view however dark: shaded leaves. By looking
DAYLIGHT_SHARE = 0.8  # of the camera's own white in that of the view. By looking: 1 turns lawns yellow.
HIGHLIGHT_STOPS, HIGHLIGHT_EPS = 0.2, 0.2
"""Of a large highlight the most above 1, and the strength of its edges (squared stops). Chosen by looking."""
TOE, TOE_END, KNEE = 0.3, 0.15, 0.55
"""Of the film: by what share the darkest is shown darker, half of it where; above the knee it rolls off. By looking."""
BAR_STEP, BAR_EVEN, BAR_SET_OFF, BAR_WIDE, STRIP_WIDE = 0.15, 0.8, 0.6, 4, 10
"""Of a bar: steps of log level within a quarter of a degree, the share of its height without larger ones, the share of
its edges with such, and its width in radii of what edges follow: two degrees; how far a pane goes on beyond its
estimate, in the same. Chosen by looking at five rooms."""
PLATEAU = 0.28  # under which nothing within the view is lowered, so that shadows out there do not turn black. Chosen
_REACH_RAD, _EDGE_EPS, _EDGE_SHARE = math.radians(0.5), 0.02, 0.25
"""Within which a pane's edge follows the picture's (half a frame's width at 4 m), how strong an edge counts (squared
stops), and up to which share there is none. Chosen by looking: a wider soft zone makes frames milky and green."""
EDGE_CODE, EDGE_CODES, EDGE_PX = 205, 45, 0.8
"""How bright one side of an edge is, by how much brighter than the other, and by how far it is evened out, from which
it would show stairs. Chosen by looking."""
HALVED_PX = 8  # chosen: of a panorama of 6720 by 3360 pixels one in 2,000 differs by more than 3 codes
_TABLED_ROWS, _FILTERED_ROWS = 32, 256  # at a time, for the processor's cache; for memory


@dataclass(frozen=True)
class Display:
    """How pictures of one room are shown."""

    matrix: tuple[float, ...]
    """(9,): from the picture's linear RGB to that of the film, row by row: white balance and exposure."""
    pull: float
    """Factor of what is seen through panes, 1 or less."""
    source: str
    """What is taken for white: "board", "windows", "surfaces", each of them also "and ceiling"; "given": as it was."""
    views: tuple[int, ...] | None = None
    """Of the room's openings those that show a view in the photograph; None: all."""
    sky: tuple[float, ...] | None = None
    """(3,): colour of the sky seen through panes, balanced, of luminance 1; None: no blue one is seen."""

    @property
    def exposure(self) -> float:
        """From the picture's luminance to the film's, of white light."""
        return float(np.asarray(LUMINANCE_WEIGHTS) @ np.reshape(self.matrix, (3, 3)) @ self.white)

    @property
    def white(self) -> Doubles:
        """RGB of shape (3,) and luminance 1 that is shown as white, in the picture's colours."""
        rgb = np.linalg.solve(np.reshape(self.matrix, (3, 3)), np.ones(3))
        return np.asarray(rgb / (rgb @ np.asarray(LUMINANCE_WEIGHTS)))

    @property
    def said(self) -> str:
        """Where the white is from, for people."""
        first, _, ceiling = self.source.partition(" and ")
        words = {
            "board": "the white board beside the meter",
            "windows": "the light of the windows",
            "surfaces": "the room's bright surfaces, assumed neutral",
        }.get(first, "the camera, as in the given picture")
        return f"{words}, and the ceiling, which it renders white" if ceiling else words

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return asdict(self)

    @classmethod
    def read(cls, facts: Mapping[str, Any]) -> Self:
        """Return what `to_dict` gave; raise `ParameterError` for anything else."""
        try:
            views = facts.get("views")
            given = float(facts["pull"]), str(facts["source"]), None if views is None else tuple(map(int, views))
            sky = facts.get("sky")
            found = cls(tuple(map(float, facts["matrix"])), *given, None if sky is None else tuple(map(float, sky)))
        except (AttributeError, KeyError, TypeError, ValueError) as error:
            raise ParameterError("not display parameters", advice="process the session again") from error
        if len(found.matrix) != 9 or not 0 < found.pull <= 1 or not np.isfinite((*found.matrix, *(sky or ()))).all():
            raise ParameterError("a display's matrix has 9 numbers, its pull is above 0 and at most 1")
        if found.sky is not None and (len(found.sky) != 3 or found.sky[2] <= 1):
            raise ParameterError("a display's sky has 3 numbers, of which the last is above 1")
        return found

    def light(self, rgb: Floats, panes: npt.NDArray[Any] | None = None, *, around: bool = True) -> Floats:
        """Return linear RGB (H, W, 3) as the film gets it, float32 >= 0; see `screen`.

        ``panes`` (H, W): where one looks out of a window, bool or 2; 1: at its reveal or frame. ``around``: whether it
        is a whole panorama, whose left edge goes on at the right.
        """
        out, reach = self.balanced(rgb), max(2, round(_REACH_RAD / math.pi * len(rgb)) if around else len(rgb) // 150)
        glass = None if panes is None or self.pull == 1 or not panes.any() else _glass(out, panes, reach)
        if self.sky is not None:
            bluer = np.asarray(self.sky, np.float32) - 1
            seen = out[glass] if glass is not None else None  # a road is as blue by the room's white
            side_by_side(
                lambda top: skylit(out[top : top + _TABLED_ROWS], bluer, CALM), range(0, len(rgb), _TABLED_ROWS)
            )
            if glass is not None:
                out[glass] = seen
        if panes is not None and glass is not None:
            _pull(
                out,
                (panes, glass),
                self.pull,
                self.balanced(np.ones((1, 1, 3), np.float32))[0, 0],
                reach,
                around=around,
            )
        _lower_highlights(out, reach, around=around)
        side_by_side(lambda top: calm(out[top : top + _TABLED_ROWS], CALM), range(0, len(rgb), _TABLED_ROWS))
        return out

    def balanced(self, rgb: Floats) -> Floats:
        """Return linear RGB (H, W, 3) white-balanced and exposed alone, float32 >= 0: in proportion to the light."""
        out = np.asarray(cv2.transform(rgb, np.reshape(np.asarray(self.matrix, np.float32), (3, 3))), np.float32)
        return np.maximum(out, 0, out=out)

    def shown(self, rgb: Floats, panes: npt.NDArray[Any] | None = None, *, around: bool = True) -> Bytes:
        """Return linear RGB (H, W, 3) in the picture's unit as sRGB codes; see `light`."""
        return screen(self.light(rgb, panes, around=around))

    def brighter(self, factor: float) -> Self:
        """Return the display at another exposure: a room at another hour."""
        return replace(self, matrix=tuple(factor * v for v in self.matrix))

    def exposed(self, rgb: Floats) -> Self:
        """Return the same white with exposure by another picture (H, W, 3), linear: the room at another hour, a sky."""
        step = max(1, rgb.shape[1] // 1024)
        level = luminance_cd_m2(self.balanced(np.ascontiguousarray(rgb[step // 2 :: step, step // 2 :: step])))
        seen = level[level > 0]
        bright = float(np.quantile(seen, BRIGHT_SHARE)) if seen.size else 0.0
        return self.brighter(BRIGHT_LEVEL / bright) if bright > 0 else self


def film(light: Floats) -> Floats:
    """Return what the film shows, 0 to 1, of light of any shape: shadows a little deeper, highlights rolled off.

    The roll-off t / (1 + t) goes on with the same slope and never reaches white (Reinhard et al. 2002, eq. 3).
    """
    toed = light * (1 - np.float32(TOE) / (1 + np.minimum(light / np.float32(TOE_END), np.float32(1e6)) ** 2))
    above = np.maximum(toed - np.float32(KNEE), 0) / np.float32(1 - KNEE)
    return np.asarray(np.minimum(toed, np.float32(KNEE)) + np.float32(1 - KNEE) * above / (1 + above), np.float32)


def screen(light: Floats) -> Bytes:
    """Return sRGB codes of `Display.light`'s values, any shape; NaN is black.

    By a table of float32's sign, exponent and upper 13 bits of mantissa: a third of the curves' time, and one code in a
    thousand is off by one from exact rounding.
    """
    out, codes = np.empty(light.shape, np.uint8), _codes()
    for top in range(0, len(light), _TABLED_ROWS):
        part = np.ascontiguousarray(light[top : top + _TABLED_ROWS], np.float32)
        np.take(codes, np.maximum(part.view(np.int32), 0) >> 10, out=out[top : top + _TABLED_ROWS], mode="clip")
    return out


def developed(light: Floats) -> Bytes:
    """Return a still (H, W, 3) as `screen`, its bright edges evened out: one pixel in a hundred changes.

    A pixel on an edge has the mean of both sides' light; the film shows the brighter: sun had stairs and red rims.
    """
    codes = screen(light)
    most, least = (work(codes, np.ones((3, 3), np.uint8)) for work in (cv2.dilate, cv2.erode))
    edge = np.any((most >= EDGE_CODE) & (most - least >= EDGE_CODES), axis=2, keepdims=True)
    return np.where(edge, cv2.GaussianBlur(codes, (0, 0), EDGE_PX), codes).astype(np.uint8)


@cache
def _codes() -> Bytes:
    light = (np.arange((0x7F800000 >> 10) + 1, dtype=np.uint32) << 10).view(np.float32)  # to infinity; then comes NaN
    steps = srgb_decoded((np.arange(255) + 0.5) / 255).astype(np.float32)
    first = np.searchsorted(film(np.minimum(light, np.float32(1e30))), steps)
    return np.append(np.repeat(np.arange(256), np.diff(first, prepend=0, append=len(light))), 0).astype(np.uint8)


AS_GIVEN = Display((1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0), 1.0, "given")
"""Nothing balanced, nothing pulled; `Display.exposed` makes it the display of a picture of which nothing is known."""


def display_of(
    rgb: Floats, *, board_rgb: Doubles | None = None, panes: npt.NDArray[Any] | None = None, balanced: bool = False
) -> Display:
    """Return how a room is shown, from its panorama (H, W, 3), linear, any scale.

    ``board_rgb``: colour (3,) of the white board (`spot_colour`), any scale.
    ``panes`` (H, W): see `Display.light`; None where no windows are known.
    ``balanced``: the picture is a camera's own, with white as it should be.
    """
    white, source = (
        (np.ones(3), "given") if balanced else white_of(rgb, board_rgb, None if panes is None else panes > 0)
    )
    step = max(1, rgb.shape[1] // 1024)
    sample = rgb[step // 2 :: step, step // 2 :: step]
    weight = np.broadcast_to(row_solid_angles(sample.shape[:2]), sample.shape[:2])
    # The matrix (3, 3) that shows light of a colour (3,) as the screen's white (von Kries in Bradford's)
    xyz, cone = np.asarray(XYZ_OF_RGB), np.asarray(BRADFORD)
    gain = (cone @ xyz @ np.ones(3)) / (cone @ xyz @ white)
    adapted = np.asarray(np.asarray(RGB_OF_XYZ) @ np.linalg.inv(cone) @ np.diag(gain) @ cone @ xyz)
    level = luminance_cd_m2(np.maximum(sample @ adapted.T.astype(np.float32), 0))
    outside = np.zeros(level.shape, bool) if panes is None else panes[step // 2 :: step, step // 2 :: step] > 0
    bright = _weighted_quantile(level[~outside], weight[~outside], BRIGHT_SHARE)
    exposure = BRIGHT_LEVEL / bright if bright > 0 else 1.0
    outside = outside & (level * exposure > LEAST_VIEW)
    view = _weighted_quantile(level[outside], weight[outside], VIEW_SHARE) * exposure
    pull = float(np.clip(VIEW_LEVEL / view, 2.0**-MOST_PULL_STOPS, 1.0)) if view > 0 else 1.0
    sky = sky_of(sample[outside] @ adapted.T, weight[outside])
    return Display(tuple(float(v) for v in (exposure * adapted).ravel()), pull, source, sky=sky)


def spot_colour(rgb: Floats, longitude_rad: float, latitude_rad: float) -> Doubles:
    """Return the median colour (3,) of a panorama (H, W, 3) about a direction: an edge within it changes nothing."""
    rows, columns = rgb.shape[:2]
    row, column = (0.5 - latitude_rad / math.pi) * rows, (longitude_rad / (2 * math.pi) + 0.5) * columns
    reach = max(1.0, SPOT_RAD / math.pi * rows)
    wide = reach / max(math.cos(latitude_rad), 0.2)
    some = np.arange(math.floor(row - reach), math.ceil(row + reach) + 1).clip(0, rows - 1)
    others = np.arange(math.floor(column - wide), math.ceil(column + wide) + 1) % columns
    return np.asarray(np.median(rgb[np.ix_(some, others)].reshape(-1, 3), axis=0), np.float64)


def _weighted_quantile(values: Floats, weight: npt.NDArray[np.floating], share: float) -> float:
    if not values.size:
        return 0.0
    order = np.argsort(values, kind="stable")
    total = np.cumsum(weight[order], dtype=np.float64)
    return float(values[order[np.searchsorted(total, share * total[-1])]])


def _guided(light: Floats, given: Floats | None, reach: int, eps: float, *, around: bool) -> Floats:
    """Return what is ``given`` (H, W), smooth but for the edges of light in stops, (H, W) or (H, W, 3): He et al. 2013.

    ``given`` None: the light (H, W) itself, in stops. Only what is near something above 0 is worked out, the rest is 0.
    Where it reaches far its coefficients are those of half the size (He and Sun 2015)."""
    wide, scale = light.shape[1], 0.5 if reach >= HALVED_PX else 1.0
    beyond, mode = round(2 * reach / scale) + 8, cast(Any, "wrap" if around else "clip")
    out, (there, least) = np.zeros(light.shape[:2], np.float32), (light, 1) if given is None else (given, 0)
    pad = beyond if around else 0
    for top in range(0, len(out), _FILTERED_ROWS):
        first = max(0, top - beyond)
        rows = slice(first, top + _FILTERED_ROWS + beyond)
        near: Any = wrapped(np.asarray((there[rows] > least).any(axis=0))[None], pad).astype(np.uint8)
        near = cv2.dilate(near, np.ones((1, 2 * beyond + 1), np.uint8))[0, pad : pad + wide]
        ends = np.flatnonzero(np.diff(near, prepend=0, append=0)).reshape(-1, 2)
        for left, right in zip(ends[:, 0] // 2 * 2, np.minimum(ends[:, 1] + ends[:, 1] % 2, wide), strict=True):
            columns = np.arange(left - beyond, right + beyond)
            edges = np.log2(np.maximum(light[rows].take(columns, 1, mode=mode), np.float32(1e-3)))
            values = edges if given is None else given[rows].take(columns, 1, mode=mode)
            found = np.asarray(cv2.ximgproc.guidedFilter(edges, values, reach, eps, scale=scale), np.float32)
            out[top : top + _FILTERED_ROWS, left:right] = found[top - first :, beyond:-beyond][:_FILTERED_ROWS]
    return out


def _lower_highlights(light: Floats, reach: int, *, around: bool) -> None:
    """Lower in place what is brighter than 1 as a whole (H, W, 3), all channels alike: details keep their contrast."""
    tone = _guided(luminance_cd_m2(light), None, reach, HIGHLIGHT_EPS, around=around)
    for top in range(0, len(tone), _TABLED_ROWS):
        base = np.maximum(tone[top : top + _TABLED_ROWS, :, None], 0)
        if base.any():
            light[top : top + _TABLED_ROWS] *= np.exp2(-base * base / (HIGHLIGHT_STOPS + base))


def _glass(light: Floats, panes: npt.NDArray[Any], reach: int) -> Flags:
    """Return the glass (H, W) of ``panes`` (H, W), out to where the picture has an upright edge if none is at a side.

    Openings are estimated: a strip of the view beside one stayed as bright as it is."""
    glass = panes if panes.dtype == bool else panes > 1
    found, lag, most = glass.astype(np.uint8), max(reach // 2, 1), STRIP_WIDE * reach
    for left, top, wide, high, _ in cv2.connectedComponentsWithStats(found)[2][1:]:
        for end, step in ((left, -1), (left + wide - 1, 1)):
            at = end + step * np.arange(-2 * lag, most + lag)
            rows = top + np.flatnonzero(glass[top : top + high, end])
            if at.min() < 0 or at.max() >= glass.shape[1] or not len(rows):
                continue
            tone = np.log(np.maximum(luminance_cd_m2(light[np.ix_(rows, at)]), np.float32(1e-3)))
            edge = (np.abs(tone[:, lag:] - tone[:, :-lag]) > BAR_STEP).mean(axis=0) > BAR_SET_OFF
            if not edge[: 3 * lag].any() and edge.any():
                found[np.ix_(rows, at[2 * lag : lag + int(edge.argmax())])] = 1
    return found > 0


def _without_bars(view: npt.NDArray[Any], glass: npt.NDArray[Any], level: Floats, reach: int) -> None:
    """Take upright bars and frames out of a ``view`` (H, W) through ``glass`` (H, W) in place.

    In daylight they are as bright and as green as what is behind them, but narrow, even from top to bottom, and set off
    from it on both sides."""
    lag = max(reach // 2, 1)
    for left, top, wide, high, _ in cv2.connectedComponentsWithStats(glass.astype(np.uint8))[2][1:]:
        box = np.s_[top : top + high, left : left + wide]
        tone, pane = np.log(np.maximum(level[box], np.float32(1e-3))), glass[box]
        down, along = (
            ((np.abs(a - b) < BAR_STEP) & both).sum(axis=0) / np.maximum(both.sum(axis=0), 1)
            for a, b, both in (
                (tone[lag:], tone[:-lag], pane[lag:] & pane[:-lag]),
                (tone[:, lag:], tone[:, :-lag], pane[:, lag:] & pane[:, :-lag]),
            )
        )
        set_off = np.concatenate([np.ones(lag), 1 - along, np.ones(lag)])  # of a column from the one ``lag`` before it
        for first, last in np.flatnonzero(np.diff(down > BAR_EVEN, prepend=False, append=False)).reshape(-1, 2):
            ends = (set_off[max(one - lag // 2, 0) : one + lag + 1].max() for one in (first, last))
            if last - first <= BAR_WIDE * reach and min(ends) > BAR_SET_OFF:
                view[box][:, first:last] = 0


def _pull(
    light: Floats, windows: tuple[npt.NDArray[Any], Flags], pull: float, cast: Floats, reach: int, *, around: bool
) -> None:
    """Lower in place what is seen through ``windows``, panes and their glass, all of a view alike, and balance it.

    By the white of a room, whose light has been on floors and walls, trees are turquoise: ``cast`` (3,) is daylight's.
    A pane's mask is an estimate: of it counts what is nearer to the view's level than to the room's, and its edge
    follows the picture's, in all its colours (guided filter, He et al. 2013). Bars and furniture before a pane thus
    stay. Of a window's reveal and frame each channel is lowered by half of its stops above the film's knee,
    by half the view's at most: white paint beside a view is white, though lit by sky and lawn, with a form.
    """
    rows = np.flatnonzero(windows[0].any(axis=1))
    top, bottom = max(0, rows[0] // 2 * 2 - 4 * reach), min(len(light), rows[-1] // 2 * 2 + 4 * reach + 2)
    part = light[top:bottom]
    level = luminance_cd_m2(part)
    least = max(LEAST_VIEW, math.sqrt(BRIGHT_LEVEL * VIEW_LEVEL / pull))
    view = (level > least) | (part[..., 1] > VIEW_GREEN * part[..., 0])
    panes, glass = (one[top:bottom] for one in windows)
    closed = cv2.morphologyEx((glass & view).astype(np.uint8), cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
    beyond = cv2.floodFill(cv2.copyMakeBorder(closed, 1, 1, 1, 1, cv2.BORDER_CONSTANT), None, (0, 0), 1)[1]
    closed[beyond[1:-1, 1:-1] == 0] = 1  # shade amid a view is part of it: bars reach the pane's edge
    _without_bars(closed, glass, level, reach)
    frame = np.zeros_like(glass) if panes.dtype == bool else (panes > 0) & (closed == 0)
    soft = (_guided(part, np.asarray(one, np.float32), reach, _EDGE_EPS, around=around) for one in (closed, frame))
    shares = [np.clip((one - _EDGE_SHARE) / (1 - 2 * _EDGE_SHARE), 0, 1) for one in soft]
    balanced = (luminance_cd_m2(cast) / cast) ** DAYLIGHT_SHARE
    for row in range(len(part)):  # memory: three powers a pixel; where nothing is pulled, none
        columns = np.flatnonzero((shares[0][row] > 0) | (shares[1][row] > 0))
        seen, pane, beside = level[row, columns], shares[0][row, columns], shares[1][row, columns]
        lowered = np.hypot(np.minimum(seen, np.float32(PLATEAU)), seen * np.float32(pull))
        lowered = np.minimum(lowered, seen) / np.maximum(seen, np.float32(1e-6))
        half = np.sqrt(np.clip(np.float32(KNEE) / np.maximum(part[row, columns], np.float32(1e-6)), pull, 1))
        part[row, columns] *= (lowered[:, None] * balanced) ** pane[:, None] * half ** (beside * (1 - pane))[:, None]
