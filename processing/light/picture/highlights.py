"""What the eye sees mirrored: highlights of lacquer, leather, glass and metal, and furniture in a glossy floor.

Furniture's materials are those of glTF: a base that is matte, and above it a microfacet mirror (GGX; Walter and others
2007) whose width is the roughness squared; metals mirror in their own colour and have no matte light. Directions are
drawn by what of the facets the eye sees (Heitz 2018). What they meet is the photograph where they meet the room that
the camera sees, the light map elsewhere, the sky behind panes; the sun is a light of its own, joined by its
reflectance, as its disc would never be met by chance.

What is mirrored in a staged picture, at a small size: on furniture, and in a glossy floor with and without it."""

from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np

from processing.ground.arrays import Doubles, Floats, Vector
from processing.ground.kernels import compiled, inner
from processing.ground.seam import wrapped
from processing.ground.threads import side_by_side
from processing.light.picture.render import small_geometry
from processing.light.scene.scene import Material
from processing.light.solver.irradiance import denoised
from processing.light.solver.kernels import FIRST, FURNITURE, PANE, SECOND, STEP_OFF_M, Key, random
from processing.light.solver.sight import FIRST_PART, GLASS, Sight, looked_up, sight_of
from processing.light.solver.stage import Stage, in_parts, part_albedo
from processing.light.solver.sun import sun_of
from processing.light.solver.transport import LightMap
from processing.sphere import Equirectangular

HEAD_ON = 0.04  # reflectance of all that is no metal, seen head on (n = 1.5)
MATTE_FROM = 0.8  # roughness from which a surface is matte to the eye: cloth, plaster, raw clay
LEAST_WIDTH = 0.02  # of the microfacets' slopes; a perfect mirror is one of 0
SHARP = 0.01  # width up to which a metal is a looking glass, imaged at the full size of the picture; chosen
FLOOR_WIDTH = 0.06  # of a varnished or tiled floor's, where its gloss was measured but not its roughness
SAME_PLACE = 0.03  # relative difference of distances within which the camera sees the place itself


@dataclass(frozen=True)
class Surroundings:
    """What mirrored rays meet: a stage with its light, and a photograph of its room from one eye."""

    stage: Stage
    light: LightMap
    photograph: Floats
    """(H, 2 H, 3): of the room that is mirrored, without furniture."""
    seen: Sight
    """What a panorama's pixels see in the bare room; it may be smaller."""
    gain: Doubles
    """(P, 3): by which furniture changes the light of the room's patches."""
    eye_m: Vector

    def radiance(self, origins: Floats, rays: Floats, *, imaged: bool = False) -> tuple[Floats, np.ndarray]:
        """Return what rays (N, 3) bring (N, 3) cd/m2, and which of them end on furniture.

        ``imaged``: a window is shown as the photograph shows it, where it does: a pane's own cells are far coarser."""
        stage, p = self.stage, self.stage.patches
        hits = stage.tracer.cast(origins, rays)
        patch, _ = stage.met(origins, rays, hits)
        met = np.maximum(patch, 0)
        glow = (stage.albedo * self.light.total + stage.exitance) / np.pi
        out = np.where((patch >= 0)[:, None], glow[met], 0).astype(np.float32)
        far = np.where(np.isfinite(hits.distance_m), hits.distance_m, 0).astype(np.float32)
        place = origins + far[:, None] * rays
        hit = np.maximum(hits.triangle, 0)
        chosen = np.flatnonzero((patch >= 0) & (p.owner[hit] >= 0))
        shown, sure = self._shown(place[chosen], p.owner[hit[chosen]])
        out[chosen[sure]] = shown[sure] * self.gain[met[chosen[sure]]]
        pieces = np.flatnonzero((patch >= 0) & (p.owner[hit] == FURNITURE))
        lit = self._even[met[pieces]] / np.pi
        for number in np.unique(p.part[hit[pieces]]):
            mine = np.flatnonzero(p.part[hit[pieces]] == number)
            at = pieces[mine]
            out[at] = part_albedo(stage.scene.parts[number], p.face[hit[at]], place[at]) * lit[mine]
            out[at] += np.float32(stage.scene.parts[number].material.emission_cd_m2)
        glass = (hits.triangle >= 0) & (p.owner[hit] == PANE)
        for number, pane in enumerate(stage.scene.panes):
            mine = np.flatnonzero(glass & (p.item[hit] == number))
            row, column = pane.cells(place[mine])
            sky = looked_up(stage.scene.outdoors.rgb, rays[mine]) * pane.through(rays[mine])
            out[mine] = pane.clear[row, column, None] * sky + pane.veil_cd_m2[row, column]
        if imaged:
            mine = np.flatnonzero(glass)
            shown, sure = self._shown(place[mine], np.full(len(mine), GLASS))
            out[mine[sure]] = shown[sure]
        return out, (patch >= 0) & (p.owner[hit] < 0)

    @cached_property
    def _even(self) -> Doubles:
        """(P, 3): irradiance of furniture's patches, the mean over a side of a part: single patches are triangles."""
        p, total = self.stage.patches, self.light.total
        mine = np.flatnonzero(p.owner == FURNITURE)
        of, first = np.unique(p.item[mine], return_index=True)
        facing = np.rint(p.normal[of]).astype(int) @ (9, 3, 1)
        _, side = np.unique(np.stack([p.part[mine[first]], facing]), axis=1, return_inverse=True)
        area = np.maximum(p.area_m2[of], 1e-12)
        whole = np.bincount(side, area)
        out = np.array(total)
        for k in range(3):
            out[of, k] = (np.bincount(side, area * total[of, k]) / whole)[side]
        return out

    def _shown(self, places: Floats, owner: np.ndarray) -> tuple[Floats, np.ndarray]:
        """Return what the photograph shows of places (N, 3) on surfaces (N,), and where it shows them indeed."""
        way = places - np.asarray(self.eye_m, np.float32)
        far = np.maximum(np.linalg.norm(way, axis=1), 1e-6)
        way = (way / far[:, None]).astype(np.float32)
        x, y = np.arctan2(way[:, 0], way[:, 1]) / (2 * np.pi) + 0.5, 0.5 - np.arcsin(np.clip(way[:, 2], -1, 1)) / np.pi
        pixel, shown = (
            (y * rows).astype(int).clip(0, rows - 1) * columns + (x * columns).astype(int) % columns
            for rows, columns in (self.seen.shape, self.photograph.shape[:2])
        )
        same = (self.seen.label[pixel] == owner) & (np.abs(self.seen.distance_m[pixel] - far) < SAME_PLACE * far)
        return self.photograph.reshape(-1, 3)[shown], same


def is_glossy(material: Material) -> bool:
    """Return whether a material has highlights that the eye can see."""
    return material.roughness < MATTE_FROM or material.metallic > 0.1


def matte_share(stage: Stage, sight: Sight) -> Floats:
    """Return which share (N, 1) of furniture's matte light leaves it beside what it mirrors; 1 for the rest."""
    out = np.ones((len(sight.label), 1), np.float32)
    facing = np.clip(-np.einsum("ij,ij->i", sight.rays, sight.normal), 0, 1)
    for number, part in enumerate(stage.scene.parts):
        material, mine = part.material, sight.pixels.get(FIRST_PART + number)
        if mine is not None and is_glossy(material):
            rim = max(1 - material.roughness, HEAD_ON) - HEAD_ON
            mirrored = HEAD_ON + rim * (1 - facing[mine]) ** 5
            out[mine, 0] = (1 - material.metallic) * (1 - mirrored)
    return out


def is_looking_glass(material: Material) -> bool:
    """Return whether a material mirrors the room as an image."""
    return material.metallic > 0.5 and material.roughness**2 < SHARP


def furniture_highlights(
    around: Surroundings, sight: Sight, sun: Floats, samples: int, key: Key, least_width: float = LEAST_WIDTH
) -> Floats:
    """Return what furniture's pixels mirror (N, 3) cd/m2; ``sun`` (N, 3): the sun's direct irradiance there."""
    out = np.zeros((len(sight.label), 3), np.float32)
    outdoors, parts, pixels = around.stage.scene.outdoors.sun, around.stage.scene.parts, sight.pixels

    def one(number: int) -> None:
        part, mine = parts[number], pixels.get(FIRST_PART + number)
        if mine is None or not is_glossy(part.material):
            return
        # A looking glass with its facets would sparkle: of a dozen rays one meets a window
        sharp = least_width == 0 and is_looking_glass(part.material)
        width = 0.0 if sharp else max(part.material.roughness**2, least_width)
        # The reflectance (3,) of a material seen head on
        colour = np.asarray(part.material.colour, np.float64)
        if part.material.texture is not None:
            colour = colour * cv2.mean(part.material.texture)[:3]
        tint = np.asarray(HEAD_ON * (1 - part.material.metallic) + colour * part.material.metallic)
        own = (*key, number) if least_width else ()  # single pixels draw alike: a rod of brass was strung with beads
        out[mine] = mirrored_light(around, sight, mine, width, tint, samples, own)[0]
        if outdoors is not None:
            lit = mine[sun[mine].any(axis=1)]
            out[lit] += _sun_glint(sight, lit, sun[lit], np.asarray(outdoors.direction), max(width, LEAST_WIDTH), tint)

    side_by_side(one, range(len(parts)), 2 if least_width else 1)  # those of single pixels are one band's of several
    return out


def mirrored_light(
    around: Surroundings, sight: Sight, pixels: np.ndarray, width: float, head_on: Doubles, samples: int, key: Key
) -> tuple[Floats, np.ndarray]:
    """Return what pixels (K,) mirror (K, 3), and the share (K,) of it that comes from furniture (by count of rays).

    ``key``: of chance; none: all pixels draw alike."""
    shift = random(key, len(sight.label), 2)[pixels] if key else np.zeros((len(pixels), 2))
    out = np.empty((len(pixels), 3), np.float32)
    share = np.empty(len(pixels))
    for part in in_parts(len(pixels), 2 * samples):
        chosen = pixels[part]
        count = len(chosen)
        rays = np.empty((count, samples, 3), np.float32)
        weight = np.empty((count, samples, 2), np.float32)
        facet_rays(sight.rays[chosen], sight.normal[chosen], shift[part], samples, width, rays, weight)
        origins = np.repeat(sight.point[chosen] + np.float32(STEP_OFF_M) * sight.normal[chosen], samples, axis=0)
        light, furniture = around.radiance(origins, rays.reshape(-1, 3), imaged=width == 0)
        light = light.reshape(count, samples, 3)
        whole = weight[..., :1] * head_on.astype(np.float32) + weight[..., 1:] * (1 - head_on).astype(np.float32)
        out[part] = (whole * light).mean(axis=1)
        share[part] = furniture.reshape(count, samples).mean(axis=1)
    return out, share


def _sun_glint(sight: Sight, at: np.ndarray, sun: Floats, towards: Doubles, width: float, head_on: Doubles) -> Floats:
    """Return the sun's highlight (K, 3): its irradiance times the facets' reflectance towards the eye."""
    view, normal = -sight.rays[at].astype(np.float64), sight.normal[at].astype(np.float64)
    half = view + towards
    half /= np.maximum(np.linalg.norm(half, axis=1, keepdims=True), 1e-12)
    nv = np.clip((view * normal).sum(axis=1), 1e-3, 1)
    nl = np.clip(normal @ towards, 1e-3, 1)
    nh = np.clip((half * normal).sum(axis=1), 0, 1)
    vh = np.clip((half * view).sum(axis=1), 0, 1)
    a2 = width**2
    facets = a2 / (np.pi * (nh**2 * (a2 - 1) + 1) ** 2)
    shade_v = nl * np.sqrt(nv**2 * (1 - a2) + a2)
    shade_l = nv * np.sqrt(nl**2 * (1 - a2) + a2)
    fresnel = head_on + (1 - head_on) * ((1 - vh) ** 5)[:, None]
    return np.asarray(sun * fresnel * (facets * 0.5 / (shade_v + shade_l))[:, None], dtype=np.float32)


@inner
def _facet(x, y, z, u, w):  # type: ignore[no-untyped-def]
    """Return a place (3) on the half sphere that a direction (x, y, z) sees, even over what it sees of it."""
    flat = (x * x + y * y) ** 0.5
    px, py = (-y / flat, x / flat) if flat > 1e-6 else (1.0, 0.0)
    qx, qy, qz = -z * py, z * px, x * py - y * px
    radius, angle = u**0.5, 6.283185307179586 * w
    first, second = radius * np.cos(angle), radius * np.sin(angle)
    mix = 0.5 * (1.0 + z)
    second = (1.0 - mix) * max(1.0 - first * first, 0.0) ** 0.5 + mix * second
    third = max(1.0 - first * first - second * second, 0.0) ** 0.5
    return first * px + second * qx + third * x, first * py + second * qy + third * y, second * qz + third * z


@compiled
def facet_rays(rays, normals, shifts, samples, width, out, weight):  # type: ignore[no-untyped-def]
    """Fill mirrored directions (N, samples, 3) of eye rays (N, 3), and their weights (N, samples, 2).

    A ray's light counts (weight 0) x reflectance head on + (weight 1) x (1 - that). Facets are drawn by what of them
    the eye sees: Heitz (2018), "Sampling the GGX distribution of visible normals". Rays into the surface weigh 0."""
    frame = np.empty((3, 3))
    for i in range(rays.shape[0]):
        x, y, z = normals[i, 0], normals[i, 1], normals[i, 2]
        sign = 1.0 if z >= 0 else -1.0
        a = -1.0 / (sign + z)
        frame[0, 0], frame[0, 1], frame[0, 2] = 1.0 + sign * x * x * a, sign * x * y * a, -sign * x
        frame[1, 0], frame[1, 1], frame[1, 2] = x * y * a, sign + y * y * a, -y
        frame[2, 0], frame[2, 1], frame[2, 2] = x, y, z
        view = np.empty(3)
        for c in range(3):
            view[c] = -(rays[i, 0] * frame[c, 0] + rays[i, 1] * frame[c, 1] + rays[i, 2] * frame[c, 2])
        view[2] = max(view[2], 1e-3)
        hx, hy, hz = width * view[0], width * view[1], view[2]
        length = (hx * hx + hy * hy + hz * hz) ** 0.5
        for s in range(samples):
            u = (shifts[i, 0] + (s + 1) * FIRST) % 1.0
            w = (shifts[i, 1] + (s + 1) * SECOND) % 1.0
            mx, my, mz = _facet(hx / length, hy / length, hz / length, u, w)
            mx, my, mz = width * mx, width * my, max(mz, 1e-6)
            size = (mx * mx + my * my + mz * mz) ** 0.5
            mx, my, mz = mx / size, my / size, mz / size
            along = view[0] * mx + view[1] * my + view[2] * mz
            lx, ly, lz = 2 * along * mx - view[0], 2 * along * my - view[1], 2 * along * mz - view[2]
            for c in range(3):
                out[i, s, c] = lx * frame[0, c] + ly * frame[1, c] + lz * frame[2, c]
            spread = width * width * (lx * lx + ly * ly) / max(lz * lz, 1e-12)
            seen = 2.0 / (1.0 + (1.0 + spread) ** 0.5) if lz > 1e-4 else 0.0
            weight[i, s, 0] = seen
            weight[i, s, 1] = seen * max(1.0 - along, 0.0) ** 5  # Schlick: F = F0 + (1 - F0) (1 - cos)^5


MOST_ROWS = 512  # of mirror images: 0.35 degrees a row; chosen, never swept
FLOOR_BLUR_PX = 1.5
"""About the width of a varnished floor's mirror images at `MOST_ROWS` rows; it takes the noise of few rays away too."""
MOST_GAIN = 4.0  # two stops; chosen, never swept
GAIN_BLUR = 1.5  # patches; chosen by looking
FURNITURE_RAYS, FLOOR_RAYS, FEW_RAYS = 48, 24, 16  # from each small pixel; of what none sees, from a large one


@dataclass(frozen=True)
class Mirrors:
    """Mirrored light of a small picture's pixels."""

    sight: Sight
    around: Surroundings
    furniture: Floats
    """(H, W, 3) cd/m2."""
    floor_before: Floats
    """(H, W, 3): what the floor mirrors without furniture, 0 where it is matte."""
    floor_after: Floats

    floors: tuple[int, ...]
    """Numbers of the surfaces that mirror."""
    metals: tuple[int, ...]
    """Labels of parts of metal, mirrors among them: a small picture would blur the image that they show."""

    @cached_property
    def all_three(self) -> Floats:
        """(H, W, 9): the floor's before and after and furniture's, brought to a large picture in one go."""
        return np.concatenate([self.floor_before, self.floor_after, self.furniture], axis=2)


def mirrors_of(
    bare: Stage, full: Stage, lights: tuple[LightMap, LightMap], photo: Floats, eye_m: Vector, *, seed: int, clean: bool
) -> Mirrors | None:
    """Return what furniture and floor mirror; None where nothing does.

    ``bare``, ``full``: the room without and with furniture; of its light maps (``lights``) likewise.
    ``photo`` (H, 2 H, 3): of the room without furniture."""
    floors = [k for k, surface in enumerate(bare.scene.surfaces) if surface.gloss > 0]
    if not floors and not any(is_glossy(part.material) for part in full.scene.parts):
        return None
    geometry = small_geometry(Equirectangular(photo.shape[1], photo.shape[0]), MOST_ROWS)
    assert isinstance(geometry, Equirectangular)
    size = (geometry.width_px, geometry.height_px)
    shown = photo
    if shown.shape[:2] != size[::-1]:
        shown = np.asarray(cv2.resize(photo, size, interpolation=cv2.INTER_AREA), np.float32)
    sight, empty = sight_of(full, geometry, eye_m), sight_of(bare, geometry, eye_m)
    before = Surroundings(bare, lights[0], shown, empty, np.ones((bare.patches.count, 3)), eye_m)
    after = Surroundings(full, lights[1], shown, empty, _gain(full, lights), eye_m)
    found = furniture_highlights(
        after, sight, sun_of(full, sight, 16, seed, sight.label >= FIRST_PART), FURNITURE_RAYS, (seed, 90)
    )
    old, new = np.zeros_like(found), np.zeros_like(found)
    for floor in floors:
        mine = np.flatnonzero(sight.label == floor)
        gloss = np.float32(bare.scene.surfaces[floor].gloss)
        for out, around in ((old, before), (new, after)):
            light, _ = mirrored_light(around, sight, mine, FLOOR_WIDTH, np.full(3, HEAD_ON), FLOOR_RAYS, (seed, 91))
            out[mine] = gloss * light
    there = np.isin(sight.label, floors).reshape(sight.shape)
    old, new = (_blurred(light.reshape(*sight.shape, 3), there) for light in (old, new))
    picture = found.reshape(*sight.shape, 3)
    if clean:
        picture = _cleaned(picture, sight)
    metals = [FIRST_PART + k for k, part in enumerate(full.scene.parts) if part.material.metallic > 0.5]
    return Mirrors(sight.faces, replace(after, photograph=photo), picture, old, new, tuple(floors), tuple(metals))


def _gain(full: Stage, lights: tuple[LightMap, LightMap]) -> Doubles:
    """Return by how much furniture changes the light of the room's patches (P, 3); 1 for its own.

    Evened out over each surface: single patches are noisy, and a looking glass would show them as tiles."""
    out = np.ones((full.patches.count, 3))
    before, after = lights[0].total, lights[1].total
    shared = len(before)
    known = before > 0
    ratio = np.where(known, after[:shared] / np.where(known, before, 1), 1)
    out[:shared] = np.clip(ratio, 0, MOST_GAIN)
    for columns, rows, first in full.patches.grids:
        mine = slice(first, first + columns * rows)
        grid = cv2.medianBlur(out[mine].reshape(rows, columns, 3).astype(np.float32), 5)
        out[mine] = cv2.GaussianBlur(grid, (0, 0), GAIN_BLUR).reshape(-1, 3)
    return out


def _blurred(picture: Floats, there: np.ndarray) -> Floats:
    """Return a floor's mirrored light blurred as its roughness blurs it: alike in both pictures, so that what furniture
    leaves alone stays alike."""
    side = 4 * round(FLOOR_BLUR_PX)
    weight = cv2.GaussianBlur(wrapped(there.astype(np.float32), side), (0, 0), FLOOR_BLUR_PX)
    light = wrapped(picture * there[..., None], side)
    mean = cv2.GaussianBlur(light, (0, 0), FLOOR_BLUR_PX) / np.maximum(weight, 1e-6)[..., None]
    return np.where(there[..., None], mean[:, side : side + picture.shape[1]], 0).astype(np.float32)


def _cleaned(picture: Floats, sight: Sight) -> Floats:
    there = (sight.label >= FIRST_PART).reshape(sight.shape)
    if not (picture > 0).any():
        return picture
    distance = np.where(there, np.where(np.isfinite(sight.distance_m), sight.distance_m, 0).reshape(sight.shape), 0)
    near = np.where(there, 1 / (1 + distance), 0).astype(np.float32)
    normal = sight.normal.reshape(*sight.shape, 3) * there[..., None]
    return denoised(picture, normal.astype(np.float32), near, wraps=True, quality="fast") * there[..., None]
