"""What a ray from the camera sees in a room: texture times baked light, sunlight, gloss, lamps, and the outdoors."""

from __future__ import annotations

from processing.ground.arrays import Floats

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mocks.light import BrightDisc
from mocks.rooms.cube import Cube
from mocks.rooms.geometry import Geometry, Hits
from mocks.rooms.guide import Guide, facing_normals
from mocks.rooms.light import Baked
from mocks.rooms.lookup import CubeLookup, Seen
from mocks.rooms.model import Material
from mocks.rooms.room import Room
from mocks.rooms.sky import Sky
from mocks.rooms.sunlight import sun_share
from mocks.rooms.textures import pattern

_FRESNEL_0 = 0.04


@dataclass(frozen=True)
class Surface:
    """What rays (n) meet: arrays over the rays that hit something, whose numbers are ``ray``."""

    ray: npt.NDArray[np.intp]
    directions: Floats
    hits: Hits
    part: npt.NDArray[np.int32]
    normal: Floats
    point: Floats
    albedo: Floats


class RoomView:
    """Radiance from the room's camera position. Cheap to call, costly to make (ray-tracing tables)."""

    def __init__(self, room: Room, geometry: Geometry, baked: Mapping[str, Baked], face_px: int) -> None:
        self.room = room
        self.geometry = geometry
        self.baked = baked
        self._eye = np.array(room.eye, np.float32)
        self._disc = room.sky.disc()
        self._sums: dict[tuple[str, ...], list[Floats]] = {}
        self._lookup = CubeLookup(Guide.of(geometry, self._eye, Cube(face_px)))
        self._glossy = np.array([part.material.roughness is not None for part in geometry.parts])
        self._materials = list(dict.fromkeys(part.material for part in geometry.parts))
        self._material_of = np.array([self._materials.index(part.material) for part in geometry.parts])
        self._rough = np.array([part.material.roughness or 0.0 for part in geometry.parts], np.float32)
        self._glow = np.array([part.material.emission_cd_m2 for part in geometry.parts], np.float32)

    def surfaces(self, directions: Floats, pixel_rad: float = 0.0) -> Surface:
        """Return what directions (n, 3) meet, with albedo averaged over ``pixel_rad``."""
        hits = self.geometry.cast(self._eye, directions)
        ray = np.flatnonzero(hits.face >= 0)
        hits = Hits(hits.face[ray], hits.distance_m[ray], hits.weights[ray])
        rays = directions[ray]
        normal = facing_normals(self.geometry, hits, rays)
        part = self.geometry.part_of[hits.face]
        point = self._eye + rays * hits.distance_m[:, None]
        return Surface(ray, rays, hits, part, normal, point, self._albedo(hits, rays, part, pixel_rad))

    def sunlit(self, surface: Surface) -> Floats:
        """Return how much of the sun's disc each surface point sees, 0..1."""
        if self._disc is None:
            return np.zeros(len(surface.ray), np.float32)
        return sun_share(self.geometry, self.room.panes, self._disc, surface.point, surface.normal)

    def irradiance(self, surface: Surface, components: tuple[str, ...], share: Floats | None = None) -> Floats:
        """Return irradiance (lx, RGB) by some components, direct sun included if its ``share`` is given."""
        return self._lit(surface, components, share)[0]

    def radiance(self, directions: Floats, pixel_rad: float, components: tuple[str, ...]) -> Floats:
        """Return radiance (n, 3) by some components of the light; the sun's disc itself is left out."""
        surface = self.surfaces(directions, pixel_rad)
        share = self.sunlit(surface) if "sun" in components else None
        light, gloss = self._lit(surface, components, share)
        inside = surface.albedo * light * np.float32(1 / np.pi) + gloss
        if "lamps" in components:
            inside += self._glow[surface.part]
        out = np.zeros((len(directions), 3), np.float32)
        out[surface.ray] = inside
        left = np.ones(len(directions), bool)
        left[surface.ray] = False
        if left.any():
            out[left] = self._outdoors(directions[left], pixel_rad, components)
        return out

    def _outdoors(self, directions: Floats, pixel_rad: float, components: tuple[str, ...]) -> Floats:
        glass = np.array(self.room.glass_transmittance, np.float32)
        return np.asarray(outdoors(self.room.sky, directions, pixel_rad, components) * glass, dtype=np.float32)

    def _lit(self, surface: Surface, components: tuple[str, ...], share: Floats | None) -> tuple[Floats, Floats]:
        """Return irradiance and gloss by some components."""
        plane = np.einsum("ij,ij->i", surface.normal, surface.point - self._eye).astype(np.float32)
        seen = Seen(surface.part, surface.normal, plane)
        light, gloss = self._lookup.at(surface.directions, seen, self._pictures(components))
        gloss *= self._glossy[surface.part, None]
        if share is not None and self._disc is not None:
            lit = np.flatnonzero(share > 0)
            strength = self._sun_light(share[lit])
            cosine = np.maximum(surface.normal[lit] @ np.array(self._disc.direction, np.float32), 0)
            light[lit] += strength * cosine[:, None]
            gloss[lit] += strength * self._highlight(surface, lit, self._disc)[:, None]
        return light, gloss

    def _pictures(self, components: tuple[str, ...]) -> list[Floats]:
        """Return the sum of the components' irradiance, and of their gloss."""
        if components not in self._sums:
            side = self._lookup.side_px
            light, gloss = np.zeros((2, 6, side, side, 3), np.float32)
            for baked in (self.baked[name] for name in components if name in self.baked):
                light += baked.irradiance
                if baked.gloss is not None:
                    gloss += baked.gloss
            self._sums[components] = [light, gloss]
        return self._sums[components]

    def _sun_light(self, share: Floats) -> Floats:
        """Return illuminance (lx, RGB) on planes facing the sun, behind the glass."""
        full = np.array(self.room.sky.sun_normal_illuminance_rgb) * np.array(self.room.glass_transmittance)
        return np.asarray(share[:, None] * full, dtype=np.float32)

    def _highlight(self, surface: Surface, lit: npt.NDArray[np.intp], disc: BrightDisc) -> Floats:
        """Return the gloss of glossy surfaces times the cosine, per illuminance: GGX with Schlick's Fresnel term."""
        rough = self._rough[surface.part[lit]]
        normal, view = surface.normal[lit], -surface.directions[lit]
        light = np.array(disc.direction, np.float32)
        half = view + light
        half /= np.linalg.norm(half, axis=1, keepdims=True)
        a2 = np.maximum(rough, 0.05) ** 4
        nh, nv = np.einsum("ij,ij->i", normal, half), np.einsum("ij,ij->i", normal, view)
        nl, vh = np.maximum(normal @ light, 0), np.einsum("ij,ij->i", view, half)
        spread = a2 / (np.pi * (nh**2 * (a2 - 1) + 1) ** 2)
        fresnel = _FRESNEL_0 + (1 - _FRESNEL_0) * (1 - np.clip(vh, 0, 1)) ** 5
        shade = 1 / (nl * np.sqrt(a2 + (1 - a2) * nv**2) + nv * np.sqrt(a2 + (1 - a2) * nl**2) + 1e-9)
        return np.asarray(np.where(rough > 0, spread * fresnel * shade * nl / 2, 0), dtype=np.float32)

    def _albedo(self, hits: Hits, rays: Floats, part: npt.NDArray[np.int32], pixel_rad: float) -> Floats:
        """Return each ray's albedo: the part's colour, or its texture at the coarseness that a pixel has there."""
        materials = self._materials
        colours = np.array([m.colour for m in materials], np.float32)
        out: Floats = colours[self._material_of[part]]
        cosine = np.abs(np.einsum("ij,ij->i", rays, self.geometry.face_normals[hits.face]))
        footprint_m = hits.distance_m * np.float32(pixel_rad) / np.sqrt(np.maximum(cosine, 0.02))
        for number, material in enumerate(materials):
            if material.texture is None:
                continue
            mine = np.flatnonzero(self._material_of[part] == number)
            if mine.size:
                few = Hits(hits.face[mine], hits.distance_m[mine], hits.weights[mine])
                out[mine] = _sampled(material, self.geometry.texture_uv(few), footprint_m[mine])
        return out


def outdoors(sky: Sky, directions: Floats, pixel_rad: float, components: tuple[str, ...]) -> Floats:
    """Return the radiance of sky and land (n, 3) by some components of the light."""
    if "sky" in components and "sun" in components:
        return sky.radiance(directions, pixel_rad)
    if "sky" in components:
        return sky.radiance(directions, pixel_rad, "sky")
    if "sun" in components:
        return sky.radiance(directions, pixel_rad, "sun")
    return np.zeros(directions.shape, np.float32)


def _sampled(material: Material, uv_m: Floats, footprint_m: Floats) -> Floats:
    """Return the texture at places in metres, each at the halving that fits its footprint."""
    assert material.texture is not None
    texture, size_m = pattern(material.texture)
    rows, columns = texture.shape
    column = (uv_m[:, 0] / size_m[0] % 1.0) * columns - 0.5
    row = (uv_m[:, 1] / size_m[1] % 1.0) * rows - 0.5
    finest = size_m[0] / columns
    level = np.clip(np.round(np.log2(np.maximum(footprint_m / finest, 1))), 0, len(texture.levels) - 1).astype(int)
    out = np.empty((len(uv_m), 3), np.float32)
    for one in np.unique(level):
        mine = np.flatnonzero(level == one)
        out[mine] = texture.sample(column[mine], row[mine], int(one))
    return out
