"""The chart room: a closed room under constant electric light, in which both cameras see the same colour chart.

The ratio of the two cameras' values for its white patch is k2 (Ji, Sawyer, Narasimhan 2023, section 3). The chart hangs
on the wall ahead; for the fisheye, whose axis points up, the whole room is turned so that it hangs before that axis.
"""

import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from mocks.worlds.light import LightDrift, OneLight, Site, Vector, luminance_cd_m2, unit
from processing.ground.arrays import Floats, Indices
from processing.ground.colour import RGB_OF_XYZ, srgb_decoded
from processing.ground.tables import table_of

PATCHES: list[tuple[str, list[int]]] = list(table_of(__package__, "chart").items())
"""Names and published sRGB values (8 bits) of the Macbeth / X-Rite ColorChecker, row by row, six a row."""

WHITE = 18  # index of the white patch
_COLUMNS, _ROWS = 6, 4
_PITCH_M, _PATCH_M = 0.11, 0.10
_BOARD_CENTRE_M, _BOARD_M = (0.62, 0.0), 0.30
"""Of the white board beside the chart: x and z of its middle, and its side."""
_FRAME_M = 0.02  # chosen
_FRAME_ALBEDO, _BOARD_ALBEDO = 0.035, 0.92

# The room's box, camera at the origin (1.6 m over the floor, 1 m before the wall with the chart).
_LOW = np.array((-2.0, -2.8, -1.6), dtype=np.float32)
_HIGH = np.array((2.0, 1.0, 1.0), dtype=np.float32)
# Lamp and walls: chosen, a plausible small room.
_LAMP = np.array((0.0, -0.4, 1.0), dtype=np.float32)
_LAMP_M = 0.6  # chosen
_ALBEDO = {"wall": (0.62, 0.60, 0.56), "floor": (0.26, 0.22, 0.18), "ceiling": (0.80, 0.80, 0.79)}
_FACES = ("wall", "wall", "wall", "wall", "floor", "ceiling")
"""By number: low x, high x, low y, high y (with the chart), low z, high z (with the lamp)."""
_CHART_FACE, _CEILING = 3, 5
_LAMP_KELVIN = (4000, 3000, 6500, 2700, 5000)


@dataclass(frozen=True)
class ChartRoom(OneLight):
    """The room with the chart. ``seed`` chooses the lamp's colour: white (4000 K) for 0, warm (3000 K) for 1 ...

    The photographic lamp on the ceiling lights by the law of a small plane source, ``L A cos cos / r2``; what walls
    give back is the same everywhere, as in an integrating sphere. It is bright, so that the chart shows through the
    outdoor camera's ND 3.0 as well.
    """

    seed: int = 0
    lamp_cd_m2: float = 60_000.0
    drift: LightDrift = field(default_factory=LightDrift)

    @property
    def key(self) -> str:
        """Return the parameters as text."""
        return f"v1 {self!r}"

    @property
    def lamp_kelvin(self) -> int:
        """Colour temperature of the lamp."""
        return _LAMP_KELVIN[self.seed % len(_LAMP_KELVIN)]

    @property
    def board_direction(self) -> Vector:
        """Direction from the panorama camera to the middle of the white patch, where the meter looks."""
        return unit(self.patch_directions(Site.INDOOR)[WHITE])

    def patch_directions(self, site: Site) -> Floats:
        """Return the unit directions, shape (24, 3), from a camera to the middles of the patches."""
        row, column = np.divmod(np.arange(len(PATCHES)), _COLUMNS)
        x, z = (column - (_COLUMNS - 1) / 2) * _PITCH_M, ((_ROWS - 1) / 2 - row) * _PITCH_M
        points = np.stack([x, np.full(x.shape, _HIGH[1]), z], axis=-1)
        return _turned((points / np.linalg.norm(points, axis=1, keepdims=True)).astype(np.float32), site)

    @property
    def patch_luminances_cd_m2(self) -> Floats:
        """Luminances, shape (24,), cd/m2, of the patches' middles at time 0, the same for both cameras."""
        return luminance_cd_m2(self.radiance(Site.INDOOR, self.patch_directions(Site.INDOOR)))

    def radiance(self, site: Site, directions: Floats, pixel_rad: float = 0.0, component: int | None = None) -> Floats:
        """Return the radiance of walls, chart and lamp: cd/m2, of the shape of ``directions`` (..., 3)."""
        way = _turned(np.asarray(directions, dtype=np.float32).reshape(-1, 3), site)
        face, point = _wall_met(way)
        light = self._illuminance_lx(face, point) / np.float32(math.pi)
        out = _albedo(face, point) * light[:, None] * self._lamp_rgb
        in_lamp = (face == _CEILING) & (np.abs(point[:, :2] - _LAMP[:2]) < _LAMP_M / 2).all(axis=1)
        out[in_lamp] = np.float32(self.lamp_cd_m2) * self._lamp_rgb
        return out.reshape(directions.shape)

    def open_sky(self, site: Site, directions: Floats) -> Floats:
        """Return 0 for each direction, shape (...): the room is closed."""
        return np.zeros(directions.shape[:-1], dtype=np.float32)

    @cached_property
    def _lamp_rgb(self) -> Floats:
        """The lamp's colour at luminance 1."""
        # Linear Rec. 709 of a black body (Kim et al. 2002 fit of the Planckian locus, 2222 to 25000 K).
        t = 1000 / self.lamp_kelvin
        if self.lamp_kelvin <= 4000:
            x = -0.2661239 * t**3 - 0.2343589 * t**2 + 0.8776956 * t + 0.179910
            y = -0.9549476 * x**3 - 1.37418593 * x**2 + 2.09137015 * x - 0.16748867
        else:
            x = -3.0258469 * t**3 + 2.1070379 * t**2 + 0.2226347 * t + 0.240390
            y = 3.0817580 * x**3 - 5.87338670 * x**2 + 3.75112997 * x - 0.37001483
        rgb = np.asarray(np.array(RGB_OF_XYZ) @ np.array([x / y, 1.0, (1 - x - y) / y]), dtype=np.float32)
        return np.asarray(rgb / luminance_cd_m2(rgb), dtype=np.float32)

    def _illuminance_lx(self, face: Indices, point: Floats) -> Floats:
        """Return direct light, ``L A cos cos / r2``, and the even light of all bounces."""
        area_m2 = _LAMP_M**2
        away = point - _LAMP
        r2 = np.einsum("ij,ij->i", away, away)
        planes = np.stack([_LOW - _LAMP, _HIGH - _LAMP], axis=1).ravel()
        # Both cosines are a distance over r: down from the lamp, and out of the surface to the lamp.
        cosines = np.maximum(-away[:, 2], 0) * np.abs(planes[face]) / np.maximum(r2, 1e-6)
        direct = np.float32(self.lamp_cd_m2 * area_m2) * cosines / np.maximum(r2, 1e-6)
        return np.asarray(direct + np.float32(_bounced_lx(math.pi * self.lamp_cd_m2 * area_m2)), dtype=np.float32)


def _turned(directions: Floats, site: Site) -> Floats:
    """Return directions between world and room: the same indoors; outdoors the chart (y) lies at the zenith (z).

    The turn is its own inverse: right becomes left, ahead and up change places."""
    return directions if site is Site.INDOOR else directions[:, [0, 2, 1]] * np.array((-1, 1, 1), dtype=np.float32)


def _wall_met(way: Floats) -> tuple[Indices, Floats]:
    """Return the face that each direction meets, and where."""
    ends = np.where(way > 0, _HIGH, _LOW)
    with np.errstate(divide="ignore"):
        reach = np.where(way != 0, ends / way, np.float32(np.inf))
    axis = reach.argmin(axis=1)
    nearest = np.take_along_axis(reach, axis[:, None], axis=1)
    face = 2 * axis + (np.take_along_axis(way, axis[:, None], axis=1)[:, 0] > 0)
    return face, way * nearest


def _albedo(face: Indices, point: Floats) -> Floats:
    out = np.array([_ALBEDO[name] for name in _FACES], dtype=np.float32)[face]
    ahead = np.flatnonzero(face == _CHART_FACE)
    x, z = point[ahead, 0], point[ahead, 2]
    wide, high = _COLUMNS * _PITCH_M / 2, _ROWS * _PITCH_M / 2
    out[ahead[(np.abs(x) < wide + _FRAME_M) & (np.abs(z) < high + _FRAME_M)]] = _FRAME_ALBEDO
    board = np.maximum(np.abs(x - _BOARD_CENTRE_M[0]), np.abs(z - _BOARD_CENTRE_M[1])) < _BOARD_M / 2
    out[ahead[board]] = _BOARD_ALBEDO
    column, row = (x + wide) / _PITCH_M, (high - z) / _PITCH_M
    margin = (1 - _PATCH_M / _PITCH_M) / 2
    on_patch = (np.minimum(column % 1, row % 1) > margin) & (np.maximum(column % 1, row % 1) < 1 - margin)
    on_patch &= (np.abs(x) < wide) & (np.abs(z) < high)
    number = row[on_patch].astype(int) * _COLUMNS + column[on_patch].astype(int)
    out[ahead[on_patch]] = patch_albedos()[number]
    return out


def patch_albedos() -> Floats:
    """Return the patches' linear Rec. 709 reflectances, shape (24, 3), from their sRGB values (IEC 61966-2-1)."""
    return srgb_decoded(np.array([rgb for _, rgb in PATCHES]) / 255).astype(np.float32)


def _bounced_lx(flux_lm: float) -> float:
    """Return the indirect illuminance of a closed room, by the integrating sphere's formula."""
    sides = _HIGH - _LOW
    areas = np.repeat(sides.prod() / sides, 2)
    albedos = luminance_cd_m2(np.array([_ALBEDO[name] for name in _FACES], dtype=np.float32))
    mean = float(np.average(albedos, weights=areas))
    return flux_lm * mean / (1 - mean) / float(areas.sum())
