"""The light in a room, baked around the camera: irradiance on whatever each direction meets, by component.

Six square pictures hold the irradiance (lx, RGB) of the surface that each pixel sees. Direct sunlight is left out, as
it has sharp edges and is added ray by ray; lamps' own glow and the view outside are not in it either. Noise is removed
with Open Image Denoise, guided by clean normals and distances.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Literal

import cv2
import numpy as np

from mocks.rooms.light.cube import Cube, Guide
from mocks.rooms.light.geometry import Geometry
from mocks.rooms.light.sunlight import enters, outward, sun_patches, sun_share
from mocks.rooms.light.transport import Lighting, Sampling, load_scene, render_cube
from mocks.rooms.room import Room
from mocks.rooms.sky.sky import Sky
from processing.ground.arrays import Flags, Floats

ENVIRONMENT_ROWS = 128  # chosen: 1.4 degrees; the sun is apart
_LEAST_ALBEDO = 0.01  # chosen: keeps the division of light by albedo finite


@dataclass(frozen=True)
class Quality:
    """Size and samples of the baked pictures."""

    face_px: int
    samples: int


QUALITIES: Mapping[str, Quality] = {
    "sketch": Quality(48, 8),
    "draft": Quality(96, 16),
    "standard": Quality(128, 48),
    "reference": Quality(192, 256),
}


@dataclass(frozen=True)
class Baked:
    """One component: irradiance (lx, RGB) and gloss (cd/m2, RGB: what glossy surfaces add), (6, S, S, 3)."""

    irradiance: Floats
    gloss: Floats | None


def components(room: Room) -> tuple[str, ...]:
    """Return the names of what gives light in a room: what gives none needs no work."""
    daylight = ("sky",) if room.panes else ()
    sunlight = ("sun",) if room.panes and room.sky.disc() is not None else ()
    return (*daylight, *sunlight, *(("lamps",) if room.lamps_on else ()))


def lightings(room: Room) -> dict[str, Lighting]:
    """Return the light of each component."""
    glass = np.array(room.glass_transmittance, np.float32)
    names, disc, found = components(room), room.sky.disc(), {}
    if "sky" in names:
        found["sky"] = Lighting(environment_rgb=_entering(room, _outside(room.sky, "sky")) * glass)
    if "sun" in names:
        # What the sun lights outside; and the sun itself, where it shines on a pane.
        land = _entering(room, _outside(room.sky, "sun")) * glass
        red, green, blue = (float(v) for v in room.sky.sun_normal_illuminance_rgb * glass)
        direct = (disc.direction, (red, green, blue)) if disc is not None and enters(room.panes, disc) else None
        found["sun"] = Lighting(environment_rgb=land, sun=direct)
    if "lamps" in names:
        found["lamps"] = Lighting(lamps=True)
    return found


@lru_cache(maxsize=4)
def _outside(sky: Sky, component: Literal["sky", "sun"]) -> Floats:
    return sky.environment(ENVIRONMENT_ROWS, component)


def _entering(room: Room, environment_rgb: Floats) -> Floats:
    """Return the map without what lies behind every window's wall: no sample is spent on light that cannot enter."""
    rows = environment_rgb.shape[0]
    longitude = (np.arange(2 * rows) + 0.5) * (np.pi / rows) - np.pi
    latitude = np.pi / 2 - (np.arange(rows) + 0.5)[:, None] * (np.pi / rows)
    flat = np.cos(latitude)
    rays = np.stack(np.broadcast_arrays(flat * np.sin(longitude), flat * np.cos(longitude), np.sin(latitude)), axis=-1)
    # Two pixels beyond the wall's plane, as the renderer interpolates.
    seen = np.max([rays @ outward(pane) for pane in room.panes], axis=0) > -2 * np.pi / rows
    return np.asarray(environment_rgb * seen[..., None], dtype=np.float32)


def bake(room: Room, geometry: Geometry, lighting: Lighting, quality: Quality, seed: int = 0) -> Baked:
    """Return one component's light; glossy surfaces cost a second picture of the faces that show any."""
    cube = Cube(quality.face_px)
    guide = Guide.of(geometry, np.array(room.eye, np.float32), cube)
    sunny = lighting.sun is not None
    if lighting.sun is not None:
        lighting = replace(lighting, sun=None, patches=sun_patches(geometry, room.panes, *lighting.sun))
    sampling = Sampling(cube, quality.samples, seed)
    matte, spoilt = _whole(render_cube(load_scene(geometry.parts, lighting, glossy=False), room.eye, sampling))
    # The pixels that see several surfaces, of parts that fill other pixels wholly; and the nearly black
    out: Flags = guide.albedo.min(axis=-1) < _LEAST_ALBEDO
    for face in range(6):
        out[face] |= ~guide.pure[face] & np.isin(guide.part[face], np.unique(guide.part[face][guide.pure[face]]))
    unusable = _unusable(room, geometry, guide, beam=sunny, lamps=lighting.lamps) | out | spoilt
    # By the pixel's mean albedo: right even where a pixel sees a white skirting and a dark floor.
    noisy: Floats = matte / np.maximum(guide.albedo / np.float32(np.pi), np.float32(_LEAST_ALBEDO / np.pi))
    irradiance = denoised(_filled(noisy, guide, unusable), guide)
    # A bar too thin for any pixel's middle finds its light in the pixels that look outside.
    for face in range(6):
        inside = guide.part[face] >= 0
        irradiance[face][~inside] = _spread(irradiance[face], inside, ~inside)
    glossy = np.array([p.material.roughness is not None for p in geometry.parts] + [False])[guide.part]
    faces = [face for face in range(6) if glossy[face].any()]
    if not faces:
        return Baked(irradiance, None)
    few = replace(sampling, samples=max(4, sampling.samples // 2), seed=seed + 1)
    shiny, spoilt = _whole(render_cube(load_scene(geometry.parts, lighting, glossy=True), room.eye, few, faces))
    unusable |= spoilt
    # Each is denoised by itself: the denoiser takes no negative light, and would brighten a noisy difference.
    clean = denoised(_filled(shiny, guide, unusable), guide) - denoised(_filled(matte, guide, unusable), guide)
    return Baked(irradiance, np.maximum(np.where(glossy[..., None], clean, 0), 0))


def _whole(picture: Floats) -> tuple[Floats, Flags]:
    """Return a picture with 0 for what is not finite, and where that was: by denoising, one would spoil all."""
    spoilt: Flags = np.asarray(~np.isfinite(picture).all(axis=-1))
    picture[spoilt] = 0
    return picture, spoilt


def denoised(picture: Floats, guide: Guide) -> Floats:
    """Return a picture, shape (6, S, S, 3), without its noise."""
    import pyoidn

    out = np.empty_like(picture)
    near = 1 / (1 + guide.distance_m)
    for face in range(6):
        clues = np.repeat(near[face][..., None], 3, axis=2)
        out[face] = pyoidn.denoise(picture[face], albedo=clues, normal=guide.normal[face], hdr=True)
    # The denoised picture with the noisy one's mean: the denoiser swallows 1 to 5 % in rare bright paths
    clean = _seamless(out, guide)
    inside = guide.part >= 0
    kept, whole = clean[inside].sum(axis=0, dtype=np.float64), picture[inside].sum(axis=0, dtype=np.float64)
    if not (kept > 0).all():
        return clean
    return np.asarray(clean * (whole / kept), dtype=np.float32)


def _seamless(picture: Floats, guide: Guide) -> Floats:
    """Fade the faces into one another where their borders overlap, so that none ends in a step."""
    cube = guide.cube
    rays = cube.directions().reshape(-1, 3)
    part = guide.part.reshape(-1)
    total, weights = np.zeros(rays.shape, np.float32), np.zeros(len(rays), np.float32)
    for face in range(6):
        column, row, weight = cube.place_in(face, rays)
        seen = np.flatnonzero(weight > 0)
        down = np.clip(np.rint(row[seen]), 0, cube.side_px - 1).astype(int)
        right = np.clip(np.rint(column[seen]), 0, cube.side_px - 1).astype(int)
        share = weight[seen] * (guide.part[face][down, right] == part[seen])
        total[seen] += picture[face][down, right] * share[:, None]
        weights[seen] += share
    kept = weights < 1e-3
    total[kept], weights[kept] = picture.reshape(-1, 3)[kept], 1
    return np.asarray((total / weights[:, None]).reshape(picture.shape), dtype=np.float32)


def _unusable(room: Room, geometry: Geometry, guide: Guide, *, beam: bool, lamps: bool) -> Flags:
    """Return the pixels near what the renderer's camera does not see: the sun's patches, and what glows."""
    glows = np.array([any(p.material.emission_cd_m2) for p in geometry.parts] + [False])
    bad = np.zeros(guide.part.shape, bool)
    if lamps:
        bad |= glows[guide.part]
    disc = room.sky.disc()
    if beam and disc is not None:
        rays = guide.cube.directions().reshape(-1, 3)
        points = np.array(room.eye, np.float32) + rays * guide.distance_m.reshape(-1, 1)
        share = sun_share(geometry, room.panes, disc, points, guide.normal.reshape(-1, 3))
        bad |= share.reshape(guide.part.shape) > 0
    kernel = np.ones((5, 5), np.uint8)
    return np.stack([cv2.dilate(face.astype(np.uint8), kernel) > 0 for face in bad]) | (guide.part < 0)


def _filled(picture: Floats, guide: Guide, unusable: Flags) -> Floats:
    """Replace unusable pixels by their nearest usable neighbours' mean on the same part."""
    out = picture.copy()
    out[unusable] = 0
    for face in range(6):
        inside = guide.part[face] >= 0
        for part in np.unique(guide.part[face][unusable[face] & inside]):
            mine = guide.part[face] == part
            if not (mine & ~unusable[face]).any():
                mine = inside
            holes = (guide.part[face] == part) & unusable[face]
            out[face][holes] = _spread(picture[face], mine & ~unusable[face], holes)
    return out


def _spread(picture: Floats, known: Flags, holes: Flags) -> Floats:
    values = np.zeros((int(holes.sum()), 3), np.float32)
    todo = np.ones(len(values), bool)
    weight = known.astype(np.float32)
    light = picture * weight[..., None]
    for sigma in (1.5, 3.0, 6.0, 12.0, 24.0, 48.0):
        if not todo.any():
            break
        total = cv2.GaussianBlur(weight, (0, 0), sigma)[holes]
        mean = cv2.GaussianBlur(light, (0, 0), sigma)[holes]
        ready = todo & (total > 0.02)
        values[ready] = mean[ready] / total[ready, None]
        todo &= ~ready
    if todo.any() and known.any():
        values[todo] = picture[known].mean(axis=0)
    return values
