"""Panoramas of training rooms: geometry once a camera, several looks (colours and light) from it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from mocks.rooms.light.geometry import Geometry
from mocks.rooms.model import ADE20K, Material, Part, Role
from mocks.rooms.truth import equirectangular
from processing.ground.arrays import Doubles, Floats, Int8s, Int16s
from processing.ground.mesh import Mesh
from processing.segmentation.evidence import SceneClass
from training.rooms.beyond import Home, other_room, outdoors
from training.rooms.house import Portal
from training.rooms.light import Gathered, Panes, Points, Spread, coarse, gather, smoothed, spread_of, sunlit
from training.rooms.paints import Coats, Tile, draw_coats
from training.rooms.soup import Soup

ROWS = 256
"""Of the fine picture; the network's is half as large."""
_PIXEL_RAD = np.pi / ROWS


@dataclass
class Stage:
    """A room ready for rays."""

    soup: Soup
    panes: Panes
    portals: list[Portal] = field(default_factory=list)
    mirrors: list[int] = field(default_factory=list)
    lamps: list[tuple[float, float, float]] = field(default_factory=list)

    def __post_init__(self) -> None:
        triangles, self.labels, self.paint_of = self.soup.joined()
        count = len(triangles)
        vertices = triangles.reshape(-1, 3).astype(np.float64)
        faces = np.arange(3 * count, dtype=np.int32).reshape(-1, 3)
        mesh = Mesh(vertices, np.zeros_like(vertices), np.zeros((3 * count, 2)), faces)
        self.geometry = Geometry([Part(mesh, Material("any", (0.5, 0.5, 0.5)), "any", ADE20K["wall"], Role.SHELL)])


@dataclass(frozen=True)
class Seen:
    """What a camera sees, fine (H, W, ...)."""

    eye: Doubles
    rays: Floats
    """Where they end up, after mirrors."""
    start: Floats
    label: Int8s
    paint: Int16s
    """-1 where the outdoors is seen."""
    reach_m: Floats
    points: Points
    few: Points
    light: Gathered
    spread: Spread


def see(rng: np.random.Generator, stage: Stage, place: tuple[float, float], eye_m: float) -> Seen:
    """Cast a camera's rays and gather light."""
    eye = np.array([*place, eye_m])
    rays = equirectangular(ROWS)
    shape = rays.shape[:2]
    flat = rays.reshape(-1, 3).copy()
    start = np.broadcast_to(eye.astype(np.float32), flat.shape).copy()
    hits = stage.geometry.cast(start, flat)
    face, reach = hits.face.copy(), hits.distance_m.copy()
    label = np.where(face < 0, np.int8(SceneClass.WINDOW), stage.labels[face])
    paint = np.where(face < 0, np.int16(-1), stage.paint_of[face])
    mirrored = np.flatnonzero(np.isin(paint, stage.mirrors))
    if mirrored.size:
        normal = stage.geometry.face_normals[face[mirrored]]
        into = flat[mirrored]
        start[mirrored] += into * reach[mirrored, None] - into * np.float32(1e-3)
        flat[mirrored] = into - 2 * np.einsum("ij,ij->i", into, normal)[:, None] * normal
        again = stage.geometry.cast(start[mirrored], flat[mirrored])
        face[mirrored], reach[mirrored] = again.face, again.distance_m
        paint[mirrored] = np.where(again.face < 0, np.int16(-1), stage.paint_of[again.face])
    normal = stage.geometry.face_normals[face].copy()
    normal *= -np.sign(np.einsum("ij,ij->i", normal, flat))[:, None]
    solid = (face >= 0) & ~np.isin(paint, [p.paint for p in stage.portals])
    normal[~solid] = 0
    distance = np.where(face >= 0, reach, 0)
    points = Points(
        (start + flat * distance[:, None]).reshape(*shape, 3), normal.reshape(*shape, 3), solid.reshape(shape)
    )
    few = coarse(points)
    light = gather(rng, stage.geometry, few, stage.panes, stage.lamps)
    return Seen(
        eye, flat.reshape(*shape, 3), start.reshape(*shape, 3), label.reshape(shape), paint.reshape(shape),
        distance.reshape(shape), points, few, light, spread_of(points, few),
    )  # fmt: skip


def radiance(rng: np.random.Generator, stage: Stage, seen: Seen, tiles: list[Tile]) -> Floats:
    """Return one look (H, W, 3), linear, arbitrary scale."""
    coats = draw_coats(rng, stage.soup.paints, tiles)
    light, window = _light(rng, stage, seen, coats)
    albedo = _albedo(seen, coats, tiles)
    paint = np.maximum(seen.paint, 0)
    out = albedo * light + coats.emission[paint][..., None] * np.float32(rng.uniform(2, 12) * light.mean())
    out = _glossy(stage, seen, coats, out, window)
    flat = out.reshape(-1, 3)
    away = np.flatnonzero(seen.paint.reshape(-1) < 0)
    flat[away] = outdoors(rng, seen.rays.reshape(-1, 3)[away]) * window
    level = float(np.median(light)) * rng.uniform(0.4, 2.5)
    home = _home(stage, coats, tiles) if rng.random() < 0.65 else None
    for portal in stage.portals:
        mine = np.flatnonzero(seen.paint.reshape(-1) == portal.paint)
        if mine.size:
            # A mirrored camera sees the other room from its own place: near enough.
            flat[mine] = other_room(portal, seen.eye, seen.rays.reshape(-1, 3)[mine], home) * np.float32(level)
    return out


def _home(stage: Stage, coats: Coats, tiles: list[Tile]) -> Home | None:
    """Return this room's own floor, wall and ceiling, for the rooms beyond; None for a room without them."""
    first = {paint.kind: number for number, paint in reversed(list(enumerate(stage.soup.paints)))}
    if not {"floor", "wall", "ceiling"} <= set(first):
        return None
    number = first["floor"]

    def floor(place: Floats) -> Floats:
        out = np.repeat(coats.albedo[number][None], len(place), axis=0)
        if coats.tile[number] >= 0:
            footprint = np.full(len(place), 0.05, np.float32)
            out = out * _relative(coats, tiles, number, place, footprint)
        return np.asarray(np.minimum(out, 0.95), dtype=np.float32)

    return Home(coats.albedo[first["wall"]], coats.albedo[first["ceiling"]], floor)


def _relative(coats: Coats, tiles: list[Tile], number: int, uv: Floats, footprint_m: Floats) -> Floats:
    """Return the factors (N, 3) by which a paint's texture changes its albedo at places (N, 2), metres."""
    c, s = np.cos(coats.turn[number]), np.sin(coats.turn[number])
    turned = np.stack([uv[:, 0] * c - uv[:, 1] * s, uv[:, 0] * s + uv[:, 1] * c], axis=1) / coats.scale[number]
    relative = tiles[coats.tile[number]].at(turned.astype(np.float32), footprint_m / coats.scale[number])
    return np.asarray(np.maximum(1 + (relative - 1) * coats.contrast[number], 0.05), dtype=np.float32)


def _light(rng: np.random.Generator, stage: Stage, seen: Seen, coats: Coats) -> tuple[Floats, float]:
    """Return light on every fine pixel (H, W, 3), mean about 1, and the windows' radiance on the same scale."""
    gathered = seen.light
    sky, lamps = gathered.sky, gathered.lamps
    has_sky, has_lamps = bool(sky.any()), bool(lamps.any())
    use_lamps = has_lamps and (rng.random() < 0.45 or not has_sky)
    tint = 1 + 0.25 * rng.normal(size=3) * np.array([1.0, 0.2, -1.0])
    direct = np.zeros((*sky.shape, 3), np.float32)
    share = rng.uniform(0.3, 1.0) if has_sky else 0.0
    if has_sky:
        direct += (sky * (share / max(float(sky.mean()), 1e-6)))[..., None] * _positive(1 + 0.08 * rng.normal(size=3))
    if use_lamps:
        direct += (lamps * ((1 - 0.8 * share) / max(float(lamps.mean()), 1e-6)))[..., None] * _positive(tint)
    # What the surroundings give back: their colour times the mean light, less where they are close.
    face = gathered.bounce_face
    colour = np.where((face >= 0)[..., None], coats.albedo[stage.paint_of[face]], np.float32(0.2)).mean(axis=2)
    fill = np.exp(rng.uniform(-1.2, 0.7)) if direct.any() else 1.0
    level = float(direct.mean()) if direct.any() else 1.0
    soft = colour * gathered.open_share[..., None] * np.float32(fill * max(level, 0.2))
    total = seen.spread.of(smoothed(seen.few, (direct + soft).astype(np.float32), reach=3))
    window = share / max(float(sky.mean()), 1e-6) * np.exp(rng.uniform(-0.5, 1.5)) if has_sky else rng.uniform(1, 20)
    if stage.panes and rng.random() < 0.5:
        total += _sun(rng, stage, seen, float(rng.uniform(1.5, 15.0)) * level)
    return total.astype(np.float32), float(np.clip(window, 0.3, 60))


def _positive(values: Doubles) -> Floats:
    return np.maximum(values, 0.25).astype(np.float32)


def _sun(rng: np.random.Generator, stage: Stage, seen: Seen, strength: float) -> Floats:
    _, u, v = stage.panes[int(rng.integers(len(stage.panes)))]
    outward = np.cross(u, v)
    azimuth = np.arctan2(outward[0], outward[1]) + rng.uniform(-1.2, 1.2)
    height = rng.uniform(0.12, 1.0)
    ray = np.array([np.sin(azimuth) * np.cos(height), np.cos(azimuth) * np.cos(height), np.sin(height)], np.float32)
    colour = np.array([1.0, 0.95, 0.85]) * strength
    return sunlit(stage.geometry, seen.points, ray)[..., None] * colour.astype(np.float32)


def _albedo(seen: Seen, coats: Coats, tiles: list[Tile]) -> Floats:
    paint = np.maximum(seen.paint, 0).reshape(-1)
    out = coats.albedo[paint]
    place, normal = seen.points.place.reshape(-1, 3), seen.points.normal.reshape(-1, 3)
    footprint = seen.reach_m.reshape(-1) * np.float32(_PIXEL_RAD)
    used = np.bincount(paint, minlength=len(coats.tile)) > 0
    for number in np.flatnonzero(used & (coats.tile >= 0)):
        mine = np.flatnonzero((paint == number) & (seen.paint.reshape(-1) >= 0))
        if not mine.size:
            continue
        p, n = place[mine], np.abs(normal[mine])
        flat = n[:, 2] > 0.7
        # On upright faces the horizontal axis is the one that runs along the face.
        along = np.where(n[:, 0] > n[:, 1], p[:, 1], p[:, 0])
        uv = np.stack([np.where(flat, p[:, 0], along), np.where(flat, p[:, 1], p[:, 2])], axis=1)
        out[mine] *= _relative(coats, tiles, int(number), uv, footprint[mine])
    return np.minimum(out, 0.95).reshape(*seen.paint.shape, 3)


def _glossy(stage: Stage, seen: Seen, coats: Coats, out: Floats, window: float) -> Floats:
    """Add mirrored light on glossy paints: bright windows and the colours of what stands there."""
    gloss = np.where(seen.paint >= 0, coats.gloss[np.maximum(seen.paint, 0)], 0).reshape(-1)
    mine = np.flatnonzero((gloss > 0) & seen.points.solid.reshape(-1))
    if not mine.size:
        return out
    rays, normal = seen.rays.reshape(-1, 3)[mine], seen.points.normal.reshape(-1, 3)[mine]
    cosine = -np.einsum("ij,ij->i", rays, normal)
    away = rays + 2 * cosine[:, None] * normal
    start = seen.points.place.reshape(-1, 3)[mine] + normal * np.float32(2e-3)
    hits = stage.geometry.cast(start, away.astype(np.float32))
    mean = out.reshape(-1, 3).mean(axis=0)
    shown = np.where((hits.face >= 0)[:, None], coats.albedo[stage.paint_of[hits.face]] * 2 * mean, np.float32(window))
    share = gloss[mine] + (0.6 - gloss[mine]) * (1 - np.clip(cosine, 0, 1)) ** 5
    flat = out.reshape(-1, 3).copy()
    flat[mine] += share[:, None] * (shown - flat[mine] * 0.5)
    return flat.reshape(out.shape)
