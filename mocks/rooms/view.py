"""What a ray from the camera sees in a room: texture times baked light, sunlight, gloss, lamps, and the outdoors."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np

from mocks.rooms.light.cube import PLANE_TOLERANCE_M, Cube, Guide, facing_normals
from mocks.rooms.light.geometry import Geometry, Hits
from mocks.rooms.light.light import Baked
from mocks.rooms.light.sunlight import sun_share
from mocks.rooms.model import Material
from mocks.rooms.room import Room
from mocks.rooms.sky.outdoors import Component
from mocks.rooms.sky.sky import Sky
from mocks.rooms.textures.catalogue import pattern
from mocks.worlds.hdr_world import remapped
from mocks.worlds.light import BrightDisc
from processing.ground.arrays import Floats, Indices, Int32s

# Light from the cube's pixels to any direction: interpolated, but never across the edge of a surface.

_SAME_NORMAL = 0.85  # chosen: cosine, 32 degrees


@dataclass(frozen=True)
class Seen:
    """What rays meet: part index, normal (N, 3) and distance of the plane, as in `Guide`."""

    part: Int32s
    normal: Floats
    plane_m: Floats

    def only(self, chosen: Indices) -> Self:
        """Return those with the numbers ``chosen`` (N,)."""
        return type(self)(self.part[chosen], self.normal[chosen], self.plane_m[chosen])


class CubeLookup:
    """Interpolates pictures on the cube. One is made for each room and camera position."""

    def __init__(self, guide: Guide) -> None:
        self._guide = guide
        self.side_px = guide.cube.side_px
        self._part = guide.part.reshape(-1)
        self._normal = guide.normal.reshape(-1, 3)
        self._plane = guide.plane_m.reshape(-1)
        self._purity = guide.purity.reshape(-1)

    @cached_property
    def _uniform(self) -> Int32s:
        """Part of each 2 x 2 block (by its upper left pixel) that lies on one smooth surface, else -2."""
        g = self._guide
        same = g.pure.copy()
        for down, right in ((0, 1), (1, 0), (1, 1)):
            other = (slice(None), slice(down, None), slice(right, None))
            mine = (slice(None), slice(None, self.side_px - down), slice(None, self.side_px - right))
            close = np.abs(g.plane_m[other] - g.plane_m[mine]) < PLANE_TOLERANCE_M
            alike = (g.normal[other] * g.normal[mine]).sum(axis=-1) > 0.98
            ok = (g.part[other] == g.part[mine]) & close & alike & g.pure[other]
            padded = np.zeros_like(same)
            padded[mine] = ok
            same &= padded
        return np.where(same, g.part, -2).astype(np.int32).reshape(-1)

    def at(self, directions: Floats, seen: Seen, pictures: list[Floats]) -> list[Floats]:
        """Return each picture, shape (6, S, S, 3), at directions (N, 3), taken from pixels of the same surface."""
        face, column, row = self._guide.cube.place(directions)
        left, top = np.floor(column).astype(np.int32), np.floor(row).astype(np.int32)
        corner = (face * self.side_px + top) * self.side_px + left
        down = row + np.float32(self.side_px) * face
        out = [remapped(p.reshape(-1, p.shape[2], 3), column, down) for p in pictures]
        odd = np.flatnonzero(self._uniform[corner] != seen.part)
        if odd.size:
            weights, index = self._weights(seen.only(odd), corner[odd], column[odd] - left[odd], row[odd] - top[odd])
            for picture, result in zip(pictures, out, strict=True):
                result[odd] = np.einsum("nk,nkc->nc", weights, picture.reshape(-1, 3)[index])
        return out

    def _weights(self, seen: Seen, corner: Int32s, x: Floats, y: Floats) -> tuple[Floats, Int32s]:
        """Return weights (N, 16) and pixel numbers of the 4 x 4 neighbours: near ones of the same surface."""
        index = np.empty((len(corner), 16), np.int32)
        weights = np.empty((len(corner), 16), np.float32)
        for k in range(16):
            down, right = k // 4 - 1, k % 4 - 1
            pixel = corner + down * self.side_px + right
            index[:, k] = pixel
            part, near = self._part[pixel], np.exp(-1.5 * ((x - right) ** 2 + (y - down) ** 2))
            alike = np.einsum("ij,ij->i", self._normal[pixel], seen.normal)
            apart = np.abs(self._plane[pixel] - seen.plane_m)
            match = (part == seen.part) * np.clip((alike - _SAME_NORMAL) / (1 - _SAME_NORMAL), 0, 1) ** 2
            match = match * self._purity[pixel] ** 8 * (PLANE_TOLERANCE_M / (apart + PLANE_TOLERANCE_M)) ** 2
            # The last terms decide only where no neighbour matches: the part's own side, else it, else alike normals.
            alike = np.maximum(alike, 0)
            spare = (part == seen.part) * (1e-3 * alike**4 + 1e-5) + 1e-6 * alike + 1e-7 * (part >= 0)
            weights[:, k] = near * (match + spare) + 1e-12
        weights /= weights.sum(axis=1, keepdims=True)
        return weights, index


_FRESNEL_0 = 0.04  # of a refractive index of 1.5


@dataclass(frozen=True)
class Surface:
    """What rays (n) meet: arrays over the rays that hit something, whose numbers are ``ray``."""

    ray: Indices
    directions: Floats
    hits: Hits
    part: Int32s
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
        """Return what directions (N, 3) meet, with albedo averaged over ``pixel_rad``."""
        hits = self.geometry.cast(self._eye, directions)
        ray = np.flatnonzero(hits.face >= 0)
        hits = Hits(hits.face[ray], hits.distance_m[ray], hits.weights[ray])
        rays = directions[ray]
        normal = facing_normals(self.geometry, hits, rays)
        part = self.geometry.part_of[hits.face]
        point = self._eye + rays * hits.distance_m[:, None]
        return Surface(ray, rays, hits, part, normal, point, self._albedo(hits, rays, part, pixel_rad))

    def sunlit(self, surface: Surface) -> Floats:
        """Return how much of the sun's disc each surface point sees, (N,), 0..1."""
        if self._disc is None:
            return np.zeros(len(surface.ray), np.float32)
        return sun_share(self.geometry, self.room.panes, self._disc, surface.point, surface.normal)

    def irradiance(self, surface: Surface, components: tuple[str, ...], share: Floats | None = None) -> Floats:
        """Return irradiance (N, 3), lx as RGB, by some components, direct sun included if its ``share`` is given."""
        return self._lit(surface, components, share)[0]

    def radiance(self, directions: Floats, pixel_rad: float, components: tuple[str, ...]) -> Floats:
        """Return radiance (N, 3) by some components of the light; the sun's disc itself is left out."""
        surface = self.surfaces(directions, pixel_rad)
        light, gloss = self._lit(surface, components, self.sunlit(surface) if "sun" in components else None)
        inside = surface.albedo * light * np.float32(1 / np.pi) + gloss
        if "lamps" in components:
            inside += self._glow[surface.part]
        out = np.zeros((len(directions), 3), np.float32)
        out[surface.ray] = inside
        left = np.ones(len(directions), bool)
        left[surface.ray] = False
        if left.any():
            glass = np.array(self.room.glass_transmittance, np.float32)
            out[left] = outdoors(self.room.sky, directions[left], pixel_rad, components) * glass
        return out

    def _lit(self, surface: Surface, components: tuple[str, ...], share: Floats | None) -> tuple[Floats, Floats]:
        """Return irradiance and gloss by some components."""
        plane = np.einsum("ij,ij->i", surface.normal, surface.point - self._eye).astype(np.float32)
        seen = Seen(surface.part, surface.normal, plane)
        light, gloss = self._lookup.at(surface.directions, seen, self._pictures(components))
        gloss *= self._glossy[surface.part, None]
        if share is not None and self._disc is not None:
            lit = np.flatnonzero(share > 0)
            full = np.array(self.room.sky.sun_normal_illuminance_rgb) * np.array(self.room.glass_transmittance)
            strength = np.asarray(share[lit][:, None] * full, dtype=np.float32)
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

    def _highlight(self, surface: Surface, lit: Indices, disc: BrightDisc) -> Floats:
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

    def _albedo(self, hits: Hits, rays: Floats, part: Int32s, pixel_rad: float) -> Floats:
        """Return each ray's albedo: the part's colour, or its texture at the coarseness that a pixel has there."""
        materials = self._materials
        out: Floats = np.array([m.colour for m in materials], np.float32)[self._material_of[part]]
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
    """Return the radiance of sky and land (N, 3) by some components of the light."""
    asked: list[Component] = [name for name in ("sky", "sun") if name in components]
    if not asked:
        return np.zeros(directions.shape, np.float32)
    return sky.radiance(directions, pixel_rad, asked[0] if len(asked) == 1 else None)


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
