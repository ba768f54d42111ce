"""Pictures of a scene under another light outdoors, from stored rays (`relight_basis`), far cheaper than a render.

Irradiance of a small picture: the sky and all bounces are sums over stored rays; the sun's patch is found anew, and a
few shots at it carry its first bounce. It is smoothed along surfaces by fixed weights, brought to the full size, and
texture, direct sun and glass are worked out for every pixel.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
import numpy.typing as npt

from processing.errors import NoBalanceError, RelightError
from processing.ground.arrays import Doubles, Flags, Floats
from processing.light.scene.scene import Outdoors, Pane
from processing.light.solver.kernels import random
from processing.light.solver.relight_basis import RADIUS_PX, LightBasis, SkyRays, scene_digest, sky_values
from processing.light.solver.relight_kernels import (
    add_bounced,
    add_shots,
    add_sky,
    aim,
    relative_apart,
    settle_onwards,
    smooth,
)
from processing.light.solver.relight_steps import Steps
from processing.light.solver.relight_sun import may_see_sun, sun_on_picture, sun_on_places
from processing.light.solver.sight import Sight, albedo_of, emission_of, seen_outdoors, sight_of
from processing.light.solver.stage import Stage
from processing.light.solver.transport import MOST_BOUNCES, BrightPatches, Links, patch_points
from processing.pictures.images import LUMINANCE_WEIGHTS
from processing.sphere import Equirectangular

MOST = 0.7
"""Of a row or a column, from which on what is covered runs along it."""
BAR_M = 0.12
"""As wide as a bar in the middle of a window may be; what is wider and does not hang from its top is outdoors."""
DRAWN = 0.85
"""Of what is seen before the sky: covered as much, all of it is a drawn blind or curtain."""


def panes_for_sun(panes: tuple[Pane, ...], eye_height_m: float) -> tuple[Pane, ...]:
    """Return the panes with what shades the sun: ``clear`` of the same size, 0 or 1."""
    return tuple(replace(pane, clear=clear_of_sun(pane, eye_height_m)) for pane in panes)


def clear_of_sun(pane: Pane, eye_height_m: float) -> Floats:
    """Return which cells of a pane (h, w) let the sun in, 0 or 1; ``eye_height_m``: from where it was looked through.

    A pane of a single cell is left as it is: nothing is known of where its covering is.
    """
    if pane.clear.size == 1:
        return pane.clear
    covered = pane.clear < 0.5
    rows, columns = covered.shape
    high_m, wide_m = (float(np.linalg.norm(v)) for v in (pane.up_m, pane.across_m))
    height = pane.corner_m[2] + pane.up_m[2] * (1 - (np.arange(rows) + 0.5) / rows)
    sky = height > eye_height_m
    if sky.mean() < 0.2:
        sky = np.ones(rows, bool)
    if covered[sky].mean() >= DRAWN:
        return np.where(covered, np.float32(0), np.float32(1))
    upright = covered[sky].mean(axis=0) >= MOST
    level = covered.mean(axis=1) >= MOST
    hung = np.logical_and.accumulate(level)
    bars = _thin(level & ~hung, BAR_M * rows / max(high_m, 1e-9))
    curtains = np.logical_and.accumulate(upright) | np.logical_and.accumulate(upright[::-1])[::-1]
    posts = _thin(upright & ~curtains, 2 * BAR_M * columns / max(wide_m, 1e-9))
    shut = (hung | bars)[:, None] | (curtains | posts)[None, :]
    return np.where(shut, np.float32(0), np.float32(1))


def _thin(told: Flags, most: float) -> Flags:
    """Return the runs of true values that are at most so long (at least one is always thin)."""
    out = np.zeros_like(told)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], told, [False]]).astype(np.int8)))
    for start, end in zip(edges[::2], edges[1::2], strict=True):
        if end - start <= max(most, 1.0):
            out[start:end] = True
    return out


GOALS = 4096
"""Places on the sun's patch that shots are aimed at."""
PATCH_SHOTS, PIXEL_SHOTS = 4, 2
SUN_PLACES = 16
"""Places on each patch that are asked whether the sun reaches them."""
SETTLED = 1e-4
"""Of all light: how much may still be to come when bounces end."""


@dataclass(frozen=True)
class Relit:
    """A panorama under another light."""

    rgb: Floats
    """(H, 2 H, 3) cd/m2; the sun's disc itself is not drawn."""
    irradiance: Floats
    """(H, 2 H, 3) lx, sun included; 0 where nothing solid is seen."""
    sun: Floats
    """(H, 2 H, 3) lx: of which by the sun's own disc."""
    error: float
    """Relative standard error of irradiance without the sun's own disc (rms), from two halves of the rays."""


class RelightView:
    """A scene seen from one place, ready to be shown under any light outdoors."""

    def __init__(self, stage: Stage, basis: LightBasis, rows: int) -> None:
        """``rows``: height of the pictures. Raises `RelightError` where the basis is of another scene."""
        if basis.scene_digest != scene_digest(stage):
            raise RelightError("the basis is of another scene", where="relighting", advice="make it anew")
        self.stage, self.basis = stage, basis
        self.geometry = Equirectangular(2 * rows, rows)
        small = basis.effort.rows
        self.small = sight_of(stage, Equirectangular(2 * small, small), basis.eye_m)
        self.full = self.small if rows == small else sight_of(stage, self.geometry, basis.eye_m)
        self.albedo = albedo_of(stage, self.full)
        self.emission = emission_of(stage, self.full)
        self._places = patch_points(stage, SUN_PLACES, (0, 85))
        self._steps = None if self.full is self.small else Steps.of(self.small, self.full)
        self._colours = np.array([*(p.transmittance for p in stage.scene.panes), (1.0, 1.0, 1.0)], np.float32)
        pixel = basis.pixel
        self._points, self._normals = self.small.point[pixel], self.small.normal[pixel]
        row, column = np.divmod(pixel, 2 * small)
        # Neighbours aim at places far apart: together they cover the whole patch of sun.
        self._shift = (row * 0.7548776662466927 + column * 0.5698402909980532) % 1.0

    def relit(self, outdoors: Outdoors, *, veils: Floats | None = None, seed: int = 0) -> Relit:
        """Return the picture under another light.

        ``veils`` (panes,): by what each pane's covering (curtain, blind) is brighter than the scene has it.
        """
        panes = self.stage.scene.panes
        if veils is not None:
            panes = tuple(
                replace(p, veil_cd_m2=p.veil_cd_m2 * np.float32(v)) for p, v in zip(panes, veils, strict=True)
            )
        stage = replace(self.stage, scene=replace(self.stage.scene, outdoors=outdoors, panes=panes))
        stage.__dict__["albedo"] = self.stage.albedo
        sunny = replace(stage, scene=replace(stage.scene, panes=panes_for_sun(panes, self.basis.eye_m[2])))
        small, error = self._irradiance(stage, sunny, seed)
        full = self.full
        sky = small.reshape(-1, 3) if self._steps is None else self._steps.apply(small)
        sun = sun_on_picture(sunny, full.point, full.normal, full.shape, self.basis.effort.sun_samples, seed)
        whole = sky + sun
        rgb = self.albedo * whole * np.float32(1 / np.pi) + self.emission
        glass = np.flatnonzero(full.pane >= 0)
        if len(glass):
            rgb[glass] = seen_outdoors(stage, _part(full, glass))
        shape = (*full.shape, 3)
        return Relit(rgb.reshape(shape), whole.reshape(shape), sun.reshape(shape), error)

    def _irradiance(self, stage: Stage, sunny: Stage, seed: int) -> tuple[Floats, float]:
        basis = self.basis
        values = sky_values(stage.scene.outdoors, stage.scene.panes)
        radiosity, bright = self._patches(stage, sunny, values, seed)
        count = len(basis.pixel)
        light, apart = basis.fixed.copy(), np.zeros(count, np.float32)
        _add(basis.pixel_sky, self._colours, values, light, apart)
        goals = None if bright is None else _Goals.of(stage, bright, (seed, 86))
        _bounced(basis.pixel_links, radiosity, bright, PIXEL_SHOTS, light, apart)
        if goals is not None:
            with_links = PIXEL_SHOTS, basis.pixel_links.patch
            goals.shoot(stage, self._points, self._normals, self._shift, with_links, light, apart)
        flat = np.zeros((2 * basis.effort.rows**2, 4), np.float32)
        flat[basis.pixel, :3], flat[basis.pixel, 3] = light, apart
        picture = flat.reshape(*self.small.shape, 4)
        out = np.zeros_like(picture)
        around = np.concatenate([picture[:, -RADIUS_PX:], picture, picture[:, :RADIUS_PX]], axis=1)
        smooth(around, basis.near, RADIUS_PX, out)
        error = relative_apart(out.reshape(-1, 4), basis.pixel, np.asarray(LUMINANCE_WEIGHTS))
        return np.ascontiguousarray(out[..., :3]), float(np.sqrt(error))

    def _patches(self, stage: Stage, sunny: Stage, values: Floats, seed: int) -> tuple[Floats, BrightPatches | None]:
        """Return the radiosity of patches (n, 3) but for the sun's own, and what the sun gives off there."""
        basis, normals = self.basis, stage.patches.normal
        first, apart = np.zeros((len(normals), 3), np.float32), np.zeros(len(normals), np.float32)
        _add(basis.patch_sky, self._colours, values, first, apart)
        bright = BrightPatches.of(stage, stage.albedo * self._sun_on_patches(sunny))
        if bright is not None:
            middles = np.ascontiguousarray(self._places[:, 0])
            _bounced(basis.patch_links, np.zeros_like(first), bright, PATCH_SHOTS, first, apart)
            shift = random((seed, 87), len(normals), 1)[:, 0]
            goals = _Goals.of(stage, bright, (seed, 88))
            goals.shoot(stage, middles, normals, shift, (PATCH_SHOTS, basis.patch_links.patch), first, apart)
        settled = first.astype(np.float64)
        if not settle_onwards(basis.patch_links.patch, stage.albedo, first, settled, MOST_BOUNCES, SETTLED):
            raise NoBalanceError(
                "light is given off but not absorbed",
                where="relighting",
                advice="give some surface an albedo below 1, or an opening",
            )
        return (stage.albedo * settled).astype(np.float32), bright

    def _sun_on_patches(self, stage: Stage) -> Doubles:
        normals, out = stage.patches.normal, np.zeros((stage.patches.count, 3))
        sun = stage.scene.outdoors.sun
        if sun is None:
            return out
        towards = normals @ np.asarray(sun.direction, np.float32) > 0
        asked = np.flatnonzero(towards & (stage.patches.area_m2 > 0))
        near = np.zeros(len(asked), bool)
        for k in range(self._places.shape[1]):
            todo = np.flatnonzero(~near)
            near[todo] = may_see_sun(stage, sun, self._places[asked[todo], k], normals[asked[todo]])
        chosen = asked[near]
        if not len(chosen):
            return out
        places = np.ascontiguousarray(self._places[chosen]).reshape(-1, 3)
        each = np.repeat(normals[chosen], self._places.shape[1], axis=0)
        light = sun_on_places(stage, places, each, 1, np.zeros((len(places), 2)))
        out[chosen] = light.reshape(len(chosen), -1, 3).mean(axis=1)
        return out


def _part(sight: Sight, chosen: npt.NDArray[np.int64]) -> Sight:
    """Return some pixels of a sight, in one row."""
    every = len(sight.label)
    values = {field.name: getattr(sight, field.name) for field in fields(sight)}
    parts = {k: v[chosen] for k, v in values.items() if isinstance(v, np.ndarray) and len(v) == every}
    return replace(sight, shape=(1, len(chosen)), **parts)


def _add(rays: SkyRays, colours: Floats, values: Floats, out: Floats, apart: Floats) -> None:
    add_sky(rays.first, rays.cell, rays.tint, rays.weight, colours, values, out, apart)


def _bounced(
    links: Links, radiosity: Floats, bright: BrightPatches | None, shots: int, out: Floats, apart: Floats
) -> None:
    table, glow = np.zeros((len(radiosity), 4), np.float32), np.zeros((1, 3), np.float32)
    table[:, :3] = radiosity
    if bright is not None:
        table[:, 3], glow = bright.chance, bright.radiosity.astype(np.float32)
    add_bounced(links.patch, links.density, table, glow, shots, out, apart)


@dataclass(frozen=True)
class _Goals:
    """Places on what the sun lights, spread by their light."""

    places: Floats
    normals: Floats
    light: Floats
    chance: Floats

    @classmethod
    def of(cls, stage: Stage, bright: BrightPatches, key: tuple[int, ...]) -> _Goals:
        goal = (np.arange(GOALS) + 0.5) / GOALS
        patch = bright.patch[np.minimum(np.searchsorted(bright.upto, goal), len(bright.patch) - 1)]
        return cls(
            stage.patches.places(patch, key),
            stage.patches.normal[patch],
            bright.radiosity[patch].astype(np.float32),
            bright.chance[patch].astype(np.float32),
        )

    def shoot(
        self,
        stage: Stage,
        points: Floats,
        normals: Floats,
        shift: Doubles,
        counts: tuple[int, npt.NDArray[np.int32]],
        out: Floats,
        apart: Floats,
    ) -> None:
        """Add what shots from points (n, 3) at these places bring; ``counts``: shots, and the links they go with."""
        shots, samples = counts[0], counts[1].shape[1]
        most = len(points) * shots
        origins, rays = np.empty((2, most, 3), np.float32)
        chosen, point = np.empty((2, most), np.int32)
        used = aim(points, normals, shift, self.places, self.normals, shots, origins, rays, chosen, point)
        rays, chosen, point = rays[:used], chosen[:used], point[:used]
        seen = stage.tracer.free(origins[:used], rays)
        add_shots(normals, self.normals, self.light, self.chance, chosen, point, rays, seen, shots, samples, out, apart)


__all__ = ["RelightView", "Relit"]
