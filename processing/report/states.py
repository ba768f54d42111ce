"""States of one room (as photographed, emptied, staged) as the page's viewer and slider show them.

All states share one display (`processing.pictures.display`): what is brighter in the room is brighter on the page.
"""

import base64
import math
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from processing.errors import ParameterError
from processing.exchange.jpeg_files import STAGED, TEXT, Made, PanoramaTags, jpeg_bytes
from processing.ground.arrays import Bytes, Floats, Indices, UInt16s, bands
from processing.ground.room_model import RoomModel
from processing.ground.threads import behind
from processing.pictures.display import AS_GIVEN, Display, screen
from processing.pictures.false_colour import display_range, false_colour, legend_ticks
from processing.pictures.images import LuminanceImage, luminance_cd_m2
from processing.report.data import Comparison, Scene, Shot, Viewer, ViewerState
from processing.sphere import Equirectangular, Perspective
from processing.sphere.views import Panorama, cut_view


@dataclass(frozen=True)
class Look:
    """How all states of a room are shown."""

    display: Display = AS_GIVEN
    panes: Bytes | None = None
    """(H, W): 1 at a window's reveal and frame, 2 where one looks out of it; None: no windows are known."""
    yaw_rad: float = 0.0
    """Where views look first."""
    label: str = TEXT
    """What the viewer says over staged false colours; empty: pictures have no label."""
    other_yaw_rad: float = math.pi
    """Where the second view looks."""
    room: RoomModel | None = None
    """What the viewer's ruler measures in."""
    original: str = ""
    """Where the unaltered photographs are on the web; empty: not known."""

    def light(self, rgb: Floats, view: Perspective | None = None) -> Floats:
        """Return linear light (H, W, 3) as the film gets it: of a panorama, or of a ``view``'s pixels."""
        if self.panes is None:
            return self.display.light(rgb, around=view is None)
        if view is None:
            seen = cv2.resize(self.panes, (rgb.shape[1], rgb.shape[0]), interpolation=cv2.INTER_NEAREST)
        else:
            seen = (cut_view(Panorama(100 * self.panes), view)[-len(rgb) :] + 50) // 100  # of 8 bits
        return self.display.light(rgb, seen, around=view is None)


def shown(rgb: Floats, look: Look, view: Perspective | None = None) -> Bytes:
    """Return linear light (H, W, 3) as 8-bit sRGB: a panorama, or the lower rows of a ``view``."""
    return screen(look.light(rgb, view))


# How numbers travel in the page: luminance as 16-bit logarithms, and pictures whose 8 bits hold a whole room's range.
#
# Luminance is exact to `LARGEST_ERROR` of its value whatever the range; a picture's 8 bits are finest around its middle
# (steps of 2 % there, 7 % five stops away) and reach 13 stops to either side, so that the page can expose it anew.
# ``encoding.ts`` of the viewer is the other half.

STEP = 0.001  # of the natural logarithm, from a code to the next
LARGEST_ERROR = math.expm1(STEP / 2)  # relative: 0.05 %
LEAST = 1e-6  # cd/m2 of code 1; what is darker is stored as this
NO_VALUE = 0  # codes of values start at 1
_MOST = 65535  # of 16 bits

UNCERTAINTY_LOW, UNCERTAINTY_HIGH = 1e-4, 10.0
"""Relative standard uncertainties of the bytes 1 and 255, evenly spaced in the logarithm; 0: nothing known."""

SHAPE = 0.7  # exponent of a picture's code: v^n / (v^n + middle^n)


def luminance_codes(luminance: npt.ArrayLike) -> UInt16s:
    """Return 16-bit codes of luminance in cd/m2, of any shape; `NO_VALUE` where it is 0 or less, or not finite."""
    values = np.asarray(luminance, dtype=np.float64)
    there = np.isfinite(values) & (values > 0)
    steps = np.rint(np.log(np.where(there, values, LEAST) / LEAST) / STEP) + 1
    return np.asarray(np.where(there, np.clip(steps, 1, _MOST), NO_VALUE), dtype=np.uint16)


def uncertainty_codes(relative: npt.ArrayLike) -> Bytes:
    """Return 8-bit codes of relative standard uncertainties, of their shape (to 2.3 %); 0 where nothing is known."""
    values = np.asarray(relative, dtype=np.float64)
    known = np.isfinite(values) & (values >= 0)
    clipped = np.clip(np.where(known, values, 1.0), UNCERTAINTY_LOW, UNCERTAINTY_HIGH)
    share = np.log(clipped / UNCERTAINTY_LOW) / math.log(UNCERTAINTY_HIGH / UNCERTAINTY_LOW)
    return np.asarray(np.where(known, 1 + np.rint(254 * share), 0), dtype=np.uint8)


def picture_codes(rgb: Floats, middle: float) -> Bytes:
    """Return linear light (H, W, 3) as 8-bit codes of which ``middle`` (> 0, in the picture's units) is the 127th.

    The page gets light back by v = middle (c / (255 - c))^(1 / `SHAPE`).
    """
    out = np.empty(rgb.shape, np.uint8)
    for rows in bands(len(rgb), 32):  # for the processor's cache
        raised = np.power(np.clip(rgb[rows], 0, 1e20) / np.float32(middle), np.float32(SHAPE), dtype=np.float32)
        out[rows] = raised / (1 + raised) * np.float32(255) + np.float32(0.5)
    return out


def packed(codes: UInt16s | Bytes) -> str:
    """Return a map of codes (H, W) as text: row by row differences, bytes apart by weight, zlib, base64."""
    wide = codes.astype(np.int64)
    first = np.concatenate([np.zeros((codes.shape[0], 1), np.int64), wide[:, :-1]], axis=1)
    bits = 8 * codes.dtype.itemsize
    difference = (wide - first + (1 << (bits - 1))) % (1 << bits) - (1 << (bits - 1))
    folded = np.where(difference < 0, -2 * difference - 1, 2 * difference).astype(np.uint32)
    planes = [(folded >> shift & 255).astype(np.uint8).tobytes() for shift in range(bits - 8, -1, -8)]
    return base64.b64encode(zlib.compress(b"".join(planes), 7)).decode("ascii")


MAP_WIDTH_PX = 1024  # of what the probe reads
VIEWER_WIDTHS_PX = ((2, 4096), (5, 3072), (99, 2048))
"""The last of the states whose pictures are so wide, where there are more than two: the page stays one that can be
sent, and one more alternative leaves the pictures before it as they are."""
PANORAMA_WIDTH_PX = 1800  # chosen: a screen's width
VIEW_PX = (1500, 1000)
FIELD_DEG = 95.0  # horizontal: what a photographer's wide lens shows
DROP = 0.12  # by how much of its height a view looks lower than level, as a shifted lens does: uprights stay upright
MIDDLE = 0.5  # on the tone curve, of the middle code of the viewer's pictures
SMALL_PX = 720  # width of a card's picture; chosen
_TALLER = VIEW_PX[1] / VIEW_PX[0] * (1 + 2 * DROP)
_COLOURS = 256  # of 8 bits


@dataclass(frozen=True)
class State:
    """A state of the room."""

    name: str
    read: Callable[[], LuminanceImage]
    """Its panorama, equirectangular; read when it is wanted, so that not all states' are in memory together."""
    made: Made
    file: str = ""
    """Where it is, relative to the session's folder."""
    alt: str = ""


@dataclass(frozen=True)
class Cuts:
    """What the page shows of a state, cut from its picture in one pass."""

    name: str
    staged: bool
    scenes: tuple[Scene, ...]
    """Towards ``look.yaw_rad``, ``look.other_yaw_rad``, and all around, of this state alone."""
    small: bytes
    """JPEG of the first view."""
    viewer: Viewer
    """Of this state alone."""


def cuts_of(state: State, look: Look, wide: int) -> Cuts:
    """Return what is shown of a state; ``wide``: of the viewer's picture, at most."""
    image = state.read()
    whole, small = Panorama(np.ascontiguousarray(image.rgb)), small_direction(look, SMALL_PX)

    def views() -> tuple[tuple[Scene, ...], bytes]:
        scenes = [
            _scene(name, state, look, image, shown(cut_view(whole, view)[-VIEW_PX[1] :], look, view))
            for name, view in (("View 1", _direction(look.yaw_rad)), ("View 2", _direction(look.other_yaw_rad)))
        ]
        around = shown(_panorama(image.rgb, PANORAMA_WIDTH_PX), look)
        scenes.append(_scene("Panorama", state, look, image, around, panorama=True))
        card = shown(cut_view(whole, small)[-small_height_px(SMALL_PX) :], look, small)
        return tuple(scenes), _jpeg(card, state, look, image, panorama=False)

    with behind() as later:
        smaller = later(views)
        all_round = viewer(state, look, wide)
        scenes, first = smaller.result()
    return Cuts(state.name, state.made.state == STAGED, scenes, first, all_round)


def comparison(cuts: Sequence[Cuts]) -> Comparison:
    """Return the states under a slider."""
    scenes = (
        replace(one[0], shots=sum((s.shots for s in one), ())) for one in zip(*(c.scenes for c in cuts), strict=True)
    )
    staged = [one.name for one in cuts if one.staged]
    return Comparison(tuple(scenes), cuts[0].name, staged[0] if staged else cuts[-1].name)


def small_direction(look: Look, width_px: int) -> Perspective:
    """Return the first view at another width; its lower `small_height_px` rows are what is shown."""
    return replace(_direction(look.yaw_rad), width_px=width_px, height_px=round(width_px * _TALLER))


def small_height_px(width_px: int) -> int:
    """Return the height of a view of this width."""
    return width_px * VIEW_PX[1] // VIEW_PX[0]


def viewer(state: State, look: Look, wide: int = VIEWER_WIDTHS_PX[0][1]) -> Viewer:
    """Return a state in the 360-degree viewer: its picture at most ``wide``, and maps of single pixels of its own."""
    image = state.read()
    if not isinstance(image.geometry, Equirectangular) or image.rgb.shape[1] != 2 * image.rgb.shape[0]:
        raise ParameterError("the viewer shows whole panoramas", where=state.name)
    luminance = luminance_cd_m2(_map(image.rgb))
    low, high = display_range(luminance)
    ramp = np.geomspace(low, high, _COLOURS, endpoint=False)[None] * (high / low) ** (0.5 / _COLOURS)
    codes = picture_codes(look.light(_panorama(image.rgb, wide)), MIDDLE)
    share = np.hypot(_map(image.uncertainty).astype(np.float64), image.scale_uncertainty)
    jpeg = _jpeg(codes, state, look, image, panorama=True)
    maps = packed(luminance_codes(luminance)), packed(uncertainty_codes(share)), packed(_map(image.validity))
    map_px, picture_px = (luminance.shape[1], luminance.shape[0]), (image.rgb.shape[1], image.rgb.shape[0])
    found = ViewerState(state.name, jpeg, *maps, map_px, picture_px, state.file, state.made.state == STAGED)
    colours, yaw_deg = false_colour(ramp, low, high).tobytes(), math.degrees(look.yaw_rad)
    r = look.room
    sizes = None if r is None else {"floor": r.floor, "camera_m": r.camera_height_m, "ceiling_m": r.ceiling_height_m}
    ticks = tuple(legend_ticks(low, high, 14))
    return Viewer((found,), MIDDLE, (low, high), ticks, colours, image.unit, yaw_deg, look.label, sizes)


def map_pixels(length: int, most: int) -> Indices:
    """Return which of ``length`` rows or columns a map of at most ``most`` shows, (N,): the middles of its parts."""
    count = min(length, most)
    return ((np.arange(count) + 0.5) * length / count).astype(np.intp)


def _map(values: npt.NDArray[Any]) -> npt.NDArray[Any]:
    rows, columns = values.shape[:2]
    return np.asarray(values[np.ix_(map_pixels(rows, MAP_WIDTH_PX // 2), map_pixels(columns, MAP_WIDTH_PX))])


def _panorama(rgb: Floats, width_px: int) -> Floats:
    width = min(width_px, rgb.shape[1]) // 2 * 2
    if width == rgb.shape[1]:
        return rgb
    return np.asarray(cv2.resize(rgb, (width, width // 2), interpolation=cv2.INTER_AREA), np.float32)


def _direction(yaw_rad: float) -> Perspective:
    px = VIEW_PX[0]
    return Perspective(px, round(px * _TALLER), math.radians(FIELD_DEG), yaw_rad=math.remainder(yaw_rad, 2 * math.pi))


def _scene(name: str, state: State, look: Look, image: LuminanceImage, rgb8: Bytes, *, panorama: bool = False) -> Scene:
    tag = f"{state.name} · {state.made.plate.lower()}" if state.made.plate and look.label else ""
    jpeg = _jpeg(rgb8, state, look, image, panorama=panorama)
    shot = Shot(state.name, jpeg, f"{state.alt or state.name}: {name.lower()}", tag)
    return Scene(name, (shot,), rgb8.shape[1], rgb8.shape[0])


def _jpeg(rgb8: Bytes, state: State, look: Look, image: LuminanceImage, *, panorama: bool) -> bytes:
    made = state.made._replace(original=look.original)
    shown = made.on(rgb8, panorama=panorama) if look.label else rgb8
    tags = PanoramaTags.whole(rgb8.shape[1], rgb8.shape[0]) if panorama else None
    how: dict[str, Any] = {"relative": not image.absolute, "title": state.name, "quality": 82}
    return jpeg_bytes(shown, panorama=tags, made=made, **how)
