"""Light through lens and filter: from a world to what falls on the sensor, band by band of rows.

The *image* of a world is radiance times fall-off times filter, in cd/m2-like units, for every pixel: all stops of
a bracket are exposed from the same image.
"""

from dataclasses import dataclass, field

import numpy as np

from mocks.optics.lenses import EquirectangularLens, EquisolidFisheye, Lens, Size
from mocks.optics.sensor import Exposure, Sensor, ToneCurve
from mocks.worlds.light import BrightDisc, Site, Vector, World, luminance_cd_m2, spread_over_disc
from processing.ground.arrays import Flags, Floats

# Neighbours that differ by more than this ratio lie on an edge and are sampled more finely.
_EDGE_RATIO = 1.10
_EDGE_GRID = 4  # chosen: 16 samples a pixel at edges
_DISC_GRID = 16  # chosen: the same for the sun's disc
_FIELD_SAMPLES = 256  # chosen: its area to 0.4 %


@dataclass(frozen=True)
class Filter:
    """A filter before the lens: ``rgb @ tint`` times 10^-density. A tint's row sums have luminance 1 for white."""

    density: float = 0.0
    tint: tuple[Vector, Vector, Vector] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))

    def apply(self, radiance: Floats) -> Floats:
        """Return the filtered light, shape (..., 3) as ``radiance`` (cd/m2); what a tint would make negative is 0."""
        if self == Filter():
            return radiance.copy()
        matrix = np.array(self.tint, dtype=np.float32) * np.float32(10**-self.density)
        return np.asarray(np.maximum(np.einsum("...i,ij->...j", radiance, matrix), 0), dtype=np.float32)


# The inverse of a published colour correction for an ND 3.0 filter, scaled to keep the luminance of white.
ND3_TINT = ((1.05618, 0.00433, -0.01406), (-0.04703, 0.84897, 0.03381), (0.14560, 0.15684, 0.42393))


@dataclass(frozen=True)
class CameraOptics:
    """Everything between the world and the JPEG of one camera.

    ``glare`` is the share of light that a lens and its filter scatter evenly over its sensor, the surround of an image
    circle included. No measurement of our two lenses is published; 0.5 % is assumed, the good end of what veiling
    glare indices (ISO 9358) of camera lenses are.
    """

    name: str
    site: Site
    lens: Lens
    sensor: Sensor
    filter: Filter = field(default_factory=Filter)
    glare: float = 0.0
    jpeg_quality: int = 93
    full_size: Size = (6720, 3360)
    full_samples: int = 1
    usual_settings: Exposure = field(default_factory=lambda: Exposure(1.0, 100, 5.6))

    @property
    def key(self) -> str:
        """Return all parameters as text."""
        return repr(self)

    def samples_per_side(self, size: Size) -> int:
        """Return how many samples a side each pixel gets: small pictures need more, their pixels are large."""
        return int(min(4, max(self.full_samples, round(self.full_size[0] / size[0]))))


THETA_Z1 = CameraOptics(
    name="theta_z1",
    site=Site.INDOOR,
    lens=EquirectangularLens(),
    sensor=Sensor(
        full_well_e=15000.0,
        read_noise_e=4.0,
        tone=(ToneCurve(contrast=0.30), ToneCurve(contrast=0.35), ToneCurve(contrast=0.40)),
    ),
    glare=0.005,
)
CANON_5D2 = CameraOptics(
    name="canon_5d2",
    site=Site.OUTDOOR,
    lens=EquisolidFisheye(),
    sensor=Sensor(
        full_well_e=60000.0,
        read_noise_e=12.0,
        native_balance=(0.48, 1.0, 0.72),
        tone=(ToneCurve(2.3, contrast=0.45), ToneCurve(2.3, contrast=0.42), ToneCurve(2.3, contrast=0.40)),
        raw_black=1024,
    ),
    filter=Filter(density=3.0, tint=ND3_TINT),
    glare=0.005,
    jpeg_quality=95,
    full_size=(5616, 3744),
    usual_settings=Exposure(1.0, 200, 16.0),
)


@dataclass(frozen=True)
class _Scene:
    """What is looked at, through what, at what size; and which component of the light."""

    world: World
    optics: CameraOptics
    size: Size
    component: int | None

    def radiance(self, x: Floats, y: Floats, pixel_rad: float) -> Floats:
        """Return the radiance (broadcast shape of ``x``, ``y``; 3; cd/m2) at picture points, 0 outside the field."""
        directions, seen = self.optics.lens.directions(x, y, self.size)
        if seen.all():
            return self.world.radiance(self.optics.site, directions, pixel_rad, self.component)
        out = np.zeros(directions.shape, dtype=np.float32)
        if seen.any():
            out[seen] = self.world.radiance(self.optics.site, directions[seen], pixel_rad, self.component)
        return out


def image_rows(world: World, optics: CameraOptics, size: Size, rows: range, component: int | None = None) -> Floats:
    """Return rows of the image (H, W, 3), cd/m2 on the sensor, at time 0, of one component or all, without glare."""
    x, y = centres(size, rows)
    filtered = optics.filter.apply(scene_rows(world, optics, size, rows, component))
    filtered *= optics.lens.falloff(x, y, size)[..., None]
    return filtered


def scene_rows(world: World, optics: CameraOptics, size: Size, rows: range, component: int | None = None) -> Floats:
    """Return rows of scene radiance (H, W, 3), cd/m2, as the pixels average it, bright discs with exact energy."""
    scene = _Scene(world, optics, size, component)
    above, below = max(rows.start - 1, 0), min(rows.stop + 1, size[1])
    coarse = _grid_sampled(scene, range(above, below))
    edges = _edges(coarse)
    first = rows.start - above
    light = np.ascontiguousarray(coarse[first : first + len(rows)])
    _refine(light, edges[first : first + len(rows)], scene, rows.start)
    for disc in world.discs(optics.site):
        if component not in (None, disc.component):
            continue
        near = optics.lens.rows_near(disc.direction, _disc_reach_rad(optics, disc, size), size)
        if near.start < rows.stop and rows.start < near.stop:
            _add_disc(light, rows, disc, scene)
    return light


def centres(size: Size, rows: range) -> tuple[Floats, Floats]:
    """Return the pixel centres of rows of a picture, in pixels: x of shape (W,) and y of shape (H, 1)."""
    x = np.arange(size[0], dtype=np.float32) + np.float32(0.5)
    y = np.arange(rows.start, rows.stop, dtype=np.float32)[:, None] + np.float32(0.5)
    return x, y


def _grid_sampled(scene: _Scene, rows: range) -> Floats:
    count = scene.optics.samples_per_side(scene.size)
    x, y = centres(scene.size, rows)
    total = np.zeros((len(rows), scene.size[0], 3), dtype=np.float32)
    pixel_rad = scene.optics.lens.pixel_rad(scene.size) / count
    for row_step in range(count):
        for column_step in range(count):
            dx, dy = (column_step + 0.5) / count - 0.5, (row_step + 0.5) / count - 0.5
            total += scene.radiance(x + dx, y + dy, pixel_rad)
    return total / np.float32(count * count)


def _edges(light: Floats) -> Flags:
    """Return the pixels that differ much from a neighbour to the right or below, and those neighbours."""
    level = np.log(luminance_cd_m2(light) + np.float32(1e-3))
    limit = np.log(_EDGE_RATIO)
    edges = np.zeros(level.shape, dtype=bool)
    across = np.abs(np.diff(level, axis=1)) > limit
    edges[:, :-1] |= across
    edges[:, 1:] |= across
    down = np.abs(np.diff(level, axis=0)) > limit
    edges[:-1] |= down
    edges[1:] |= down
    return edges


def _refine(light: Floats, edges: Flags, scene: _Scene, first_row: int) -> None:
    """Sample the pixels on edges again, on a fine grid."""
    row, column = np.nonzero(edges)
    if row.size == 0:
        return
    x = column.astype(np.float32) + np.float32(0.5)
    y = (row + first_row).astype(np.float32) + np.float32(0.5)
    total = np.zeros((row.size, 3), dtype=np.float32)
    pixel_rad = scene.optics.lens.pixel_rad(scene.size) / _EDGE_GRID
    for step in range(_EDGE_GRID * _EDGE_GRID):
        dx = (step % _EDGE_GRID + 0.5) / _EDGE_GRID - 0.5
        dy = (step // _EDGE_GRID + 0.5) / _EDGE_GRID - 0.5
        total += scene.radiance(x + dx, y + dy, pixel_rad)
    light[row, column] = total / np.float32(_EDGE_GRID**2)


def _add_disc(light: Floats, rows: range, disc: BrightDisc, scene: _Scene) -> None:
    """Add a bright disc: coverage by subsamples, then scaled so that the pixels hold exactly its solid angle."""
    world, optics, size = scene.world, scene.optics, scene.size
    x, y = _disc_pixels(optics, disc, size)
    if x.size == 0:
        return
    count = _DISC_GRID
    covered = np.zeros(x.size, dtype=np.float32)
    visible = np.zeros(x.size, dtype=np.float32)
    for step in range(count * count):
        dx, dy = (step % count + 0.5) / count - 0.5, (step // count + 0.5) / count - 0.5
        directions, seen = optics.lens.directions(x + dx, y + dy, size)
        hit = np.flatnonzero(disc.covers(directions) & seen)
        covered[hit] += 1
        visible[hit] += world.open_sky(optics.site, directions[hit])
    solid_angle = optics.lens.solid_angle_sr(x, y, size)
    # Pixels on the edge of the field whose middle sees nothing are as large as their neighbours.
    solid_angle[solid_angle == 0] = solid_angle.max()
    held = float((covered * solid_angle).sum())
    if held == 0:
        return
    # Of the disc's solid angle, the part that lies in the lens's field
    points = spread_over_disc(disc.direction, disc.radius_rad, _FIELD_SAMPLES)
    within = [optics.lens.pixel_of((float(px), float(py), float(pz)), size) is not None for px, py, pz in points]
    share = visible * np.float32(disc.solid_angle_sr * sum(within) / len(within) / held)
    mine = (y > rows.start) & (y < rows.stop) & (share > 0)
    row, column = (y[mine] - 0.5 - rows.start).astype(int), (x[mine] - 0.5).astype(int)
    light[row, column] += share[mine, None] * np.array(disc.radiance_rgb, dtype=np.float32)


def _disc_pixels(optics: CameraOptics, disc: BrightDisc, size: Size) -> tuple[Floats, Floats]:
    """Return the centres of all pixels that may touch the disc."""
    reach = _disc_reach_rad(optics, disc, size)
    rows = optics.lens.rows_near(disc.direction, reach, size)
    if len(rows) == 0:
        return np.zeros(0, np.float32), np.zeros(0, np.float32)
    x, y = centres(size, rows)
    near = np.zeros((len(rows), size[0]), dtype=bool)
    for dx, dy in ((0.0, 0.0), (-0.5, -0.5), (0.5, -0.5), (-0.5, 0.5), (0.5, 0.5)):
        directions, seen = optics.lens.directions(x + dx, y + dy, size)
        near |= seen & (directions @ np.array(disc.direction, dtype=np.float32) > np.cos(reach))
    row, column = np.nonzero(near)
    return x[column], y[row, 0]


def _disc_reach_rad(optics: CameraOptics, disc: BrightDisc, size: Size) -> float:
    return disc.radius_rad + 2 * optics.lens.pixel_rad(size)
