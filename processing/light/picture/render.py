"""Pictures of a scene in cd/m2: ``global``, full light transport from the light outdoors.

Only irradiance is sampled, at a small size; texture, direct sun, glass and edges are worked out for every pixel. So the
cost hardly grows with the picture's size."""

from dataclasses import dataclass, replace

import numpy as np

from processing.ground.arrays import Floats, Vector, bands
from processing.light.scene.scene import Scene
from processing.light.solver.irradiance import EFFORTS, Effort, Irradiance, gathered, irradiance_of
from processing.light.solver.sight import Sight, albedo_of, emission_of, seen_outdoors, sight_along, sight_of
from processing.light.solver.stage import Stage
from processing.light.solver.sun import sun_of
from processing.light.solver.transport import light_map
from processing.light.solver.upsample import Places
from processing.sphere import Equirectangular, Fisheye, Geometry, Perspective, directions

ROWS_AT_ONCE_PX = 1 << 19


@dataclass(frozen=True)
class Rendered:
    """A rendered picture."""

    rgb: Floats
    """(H, W, 3) cd/m2; the sun's disc itself is not drawn."""
    error: float
    """Relative standard error of irradiance, estimated from two halves."""
    rounds: int


def render(
    scene: Scene | Stage,
    geometry: Equirectangular | Perspective,
    eye_m: Vector,
    *,
    effort: Effort = EFFORTS["standard"],
    seed: int = 0,
) -> Rendered:
    """Return a picture of a scene from ``eye_m``; the same seed gives the same picture.

    Raises `NoBalanceError`: light is given off but never absorbed."""
    stage = scene if isinstance(scene, Stage) else Stage.of(scene, effort.texel_m)
    wraps = isinstance(geometry, Equirectangular)
    small = sight_of(stage, small_geometry(geometry, effort.rows), eye_m)
    found = irradiance_of(stage, small, effort, seed, wraps=wraps, fine=finer(stage, geometry, eye_m, effort))
    rgb = shaded(stage, small, found, geometry, eye_m, effort=effort, seed=seed)
    return Rendered(rgb, found.error, found.rounds)


def finer(stage: Stage, geometry: Geometry, eye_m: Vector, effort: Effort) -> Sight | None:
    """Return what the picture sees in which light on furniture is gathered; None: the room's is as good."""
    if not (effort.clean and stage.scene.parts):
        return None
    return sight_of(stage, small_geometry(geometry, effort.furniture_rows), eye_m)


def small_geometry(geometry: Geometry, rows: int) -> Geometry:
    """Return a picture's geometry at about ``rows`` rows, never more than it has."""
    rows = min(rows, geometry.height_px)
    columns = max(1, round(geometry.width_px * rows / geometry.height_px))
    return geometry if isinstance(geometry, Fisheye) else replace(geometry, width_px=columns, height_px=rows)


def shaded(
    stage: Stage, small: Sight, found: Irradiance, geometry: Geometry, eye_m: Vector, *, effort: Effort, seed: int
) -> Floats:
    """Return the picture (H, W, 3) of a scene whose irradiance is known at a small size."""
    high, wide = geometry.height_px, geometry.width_px
    out = np.empty((high, wide, 3), np.float32)
    if (high, wide) == small.shape:
        return _radiance(stage, small, found.picture.reshape(-1, 3), effort, seed).reshape(high, wide, 3)
    # In bands of whole rows, so that a large picture needs little memory; a band's rows keep their place.
    for rows in bands(high, max(1, ROWS_AT_ONCE_PX // wide)):
        rays, _ = directions(geometry, rows)
        flat = np.ascontiguousarray(rays.reshape(-1, 3), dtype=np.float32)
        large = sight_along(stage, flat, eye_m, (rows.stop - rows.start, wide))
        places = Places.whole(large.shape, rows.start, high)
        light, gaps = found.enlarged(small, large, places, wraps=isinstance(geometry, Equirectangular))
        chosen = np.flatnonzero(gaps & large.solid)  # no small pixel shows them
        if len(chosen):
            known, where = light_map(stage, effort.patch_samples, seed), (large.point[chosen], large.normal[chosen])
            light[chosen] = gathered(stage, known, *where, 4 * effort.pixel_samples, seed)
        out[rows] = _radiance(stage, large, light, effort, seed + rows.start).reshape(-1, wide, 3)
    return out


def _radiance(stage: Stage, sight: Sight, light: Floats, effort: Effort, seed: int) -> Floats:
    """Return the radiance (N, 3) of pixels with this irradiance, sun added."""
    whole = light + sun_of(stage, sight, effort.sun_samples, seed)
    seen = albedo_of(stage, sight) * whole * np.float32(1 / np.pi) + emission_of(stage, sight)
    return np.asarray(seen + seen_outdoors(stage, sight), dtype=np.float32)
