"""The rays of a scene that no other light outdoors changes, kept so that another sky casts none of them.

Irradiance is linear in the light outdoors. For the pixels of a small picture and for all patches the basis keeps which
cell of the sky each ray through a pane reaches with what weight, and which patch each ray into the room meets. Another
sky is then a sum over stored rays; only the sun's own patch, which moves, needs new ones (`relight`).
"""

from __future__ import annotations

import hashlib
import zipfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from processing.errors import ParameterError, RelightError
from processing.ground.arrays import Doubles, Floats
from processing.light.scene.patches import PANE
from processing.light.scene.scene import Outdoors, Pane, Vector
from processing.light.solver.irradiance import Effort, cleaned, gathered
from processing.light.solver.kernels import Key, pane_rays, random
from processing.light.solver.lightmap import relit as light_of
from processing.light.solver.relight_kernels import likeness
from processing.light.solver.sight import Sight, sight_of
from processing.light.solver.stage import RAYS_AT_ONCE, Stage
from processing.light.solver.transport import Links, links_of, patch_points
from processing.sphere import Equirectangular
from processing.sphere.resampling import resample

SKY_ROWS = 128
"""The sky's cells are 1.4 degrees wide; rays meet them at random, so that this blurs and does not bias."""
SKY_CELLS = 2 * SKY_ROWS * SKY_ROWS
MOST_BYTES = 1 << 30
EFFORT_FIELDS = ("texel_m", "rows", "pixel_samples", "patch_samples", "sun_samples", "clean")
"""That count for a basis, as they stand in its file."""
RADIUS_PX = 3
NEARNESS = 0.2
"""Of the harmonic mean distance of what a place sees: over this much of it, irradiance hardly changes (Ward 1988)."""
VERSION = 2


BASIS_EFFORTS = {
    "draft": Effort(texel_m=0.15, rows=128, pixel_samples=16, patch_samples=32, sun_samples=16),
    "standard": Effort(pixel_samples=32, sun_samples=32),
    "reference": Effort(rows=384, pixel_samples=64, patch_samples=128, sun_samples=64),
}
"""How much a basis holds: ``rows`` of its small picture, rays from each pixel and each patch (half, and a quarter, as
many go to the panes); ``sun_samples`` are of every light shown. A basis is one round: it knows no error to stop at."""


@dataclass(frozen=True)
class SkyRays:
    """Rays of n points that reach the sky or what covers a pane."""

    first: npt.NDArray[np.int64]
    """(n + 1,)."""
    cell: npt.NDArray[np.uint16]
    """(k,): of the sky's cells, row by row; from `SKY_CELLS` on what covers each pane."""
    tint: npt.NDArray[np.uint16]
    """(k,): the pane whose glass colours the light; the number of panes: nothing does."""
    weight: Floats
    """(k,): irradiance by radiance."""


@dataclass(frozen=True)
class LightBasis:
    """The stored rays of one scene seen from one place."""

    effort: Effort
    eye_m: Vector
    pixel: npt.NDArray[np.int64]
    """(n,): which pixels of the small panorama see something solid."""
    near: npt.NDArray[np.uint8]
    """(rows, 2 rows, (2 `RADIUS_PX` + 1)²): what neighbours tell of a pixel (`likeness`)."""
    pixel_sky: SkyRays
    pixel_links: Links
    patch_sky: SkyRays
    patch_links: Links
    fixed: Floats
    """(n, 3): irradiance of the pixels by lamps, bounces included."""
    scene_digest: str

    @property
    def bytes(self) -> int:
        """Return how much memory it takes."""
        arrays: list[npt.NDArray[Any]] = [self.pixel, self.near, self.fixed]
        for sky in (self.pixel_sky, self.patch_sky):
            arrays += [sky.first, sky.cell, sky.tint, sky.weight]
        for links in (self.pixel_links, self.patch_links):
            arrays += [links.patch, links.density]
        return sum(a.nbytes for a in arrays)


def basis_of(stage: Stage, eye_m: Vector, *, effort: Effort = BASIS_EFFORTS["standard"], seed: int = 0) -> LightBasis:
    """Return the stored rays of a scene seen from ``eye_m``; the scene's own light outdoors does not matter.

    Raises
    ------
    RelightError
        It would take more than `MOST_BYTES`.
    ParameterError
        Fewer than two samples (their difference tells the error), or an error or a time to stop at.
    """
    _affordable(stage, effort)
    sight = sight_of(stage, Equirectangular(2 * effort.rows, effort.rows), eye_m)
    pixel = np.flatnonzero(sight.solid)
    points, normals = sight.point[pixel][:, None, :], sight.normal[pixel]
    links = links_of(stage, points, normals, effort.pixel_samples, (seed, 80))
    each = max(4, round(effort.pixel_samples / 2 / max(len(stage.scene.panes), 1)))
    sky = sky_rays(stage, points, normals, each, (seed, 81))
    few = max(4, effort.patch_samples // 4)
    places = patch_points(stage, effort.patch_samples, (seed, 82))
    patch_links = links_of(stage, places, stage.patches.normal, effort.patch_samples, (seed, 83))
    patch_sky = sky_rays(stage, places[:, :few], stage.patches.normal, few, (seed, 84))
    return LightBasis(
        effort,
        eye_m,
        pixel,
        _nearness(sight, pixel, links),
        sky,
        links,
        patch_sky,
        patch_links,
        _lamps(stage, sight, pixel, patch_links, effort, seed),
        scene_digest(stage),
    )


def _affordable(stage: Stage, effort: Effort) -> None:
    if min(effort.rows, effort.pixel_samples, effort.patch_samples) < 2:
        raise ParameterError("a basis of nothing", advice="give rows and samples of 2 or more")
    if effort.max_error is not None or effort.budget_s is not None:
        raise ParameterError("a basis is made in one round", advice="leave max_error and budget_s out")
    panes = max(len(stage.scene.panes), 1)
    pixels = 2 * effort.rows**2
    a_pixel = 8 * effort.pixel_samples + 8 * max(4 * panes, effort.pixel_samples // 2) + (2 * RADIUS_PX + 1) ** 2 + 40
    a_patch = 8 * effort.patch_samples + 2 * effort.patch_samples * panes
    size = pixels * a_pixel + stage.patches.count * a_patch
    if size > MOST_BYTES:
        raise RelightError(
            f"its basis would take {size / 2**30:.1f} GiB",
            where="relighting",
            likely="a very large room, or very many windows",
            advice="ask for less quality",
        )


def sky_rays(stage: Stage, points: Floats, normals: Floats, samples: int, key: Key) -> SkyRays:
    """Return where ``samples`` rays from each point (n, k, 3) to each pane end; k = 1 or ``samples``."""
    point, cell, tint, weight = [], [], [], []
    at_once = max(1, RAYS_AT_ONCE // samples)
    for number, pane in enumerate(stage.scene.panes):
        shifts = random((*key, number), len(normals), 2)
        for start in range(0, len(normals), at_once):
            part = slice(start, start + at_once)
            for found in _pane_rays(stage, number, pane, (points[part], normals[part], shifts[part]), samples):
                point.append(found[0] + start)
                cell.append(found[1])
                tint.append(np.full(len(found[0]), found[3], np.uint16))
                weight.append(found[2])
    whole = np.concatenate(point) if point else np.empty(0, np.int64)
    order = np.argsort(whole, kind="stable")
    first = np.searchsorted(whole[order], np.arange(len(normals) + 1))
    if not len(whole):
        return SkyRays(first, np.empty(0, np.uint16), np.empty(0, np.uint16), np.empty(0, np.float32))
    return SkyRays(first, np.concatenate(cell)[order], np.concatenate(tint)[order], np.concatenate(weight)[order])


def _pane_rays(
    stage: Stage, number: int, pane: Pane, at: tuple[Floats, Floats, Doubles], samples: int
) -> list[tuple[npt.NDArray[np.int64], npt.NDArray[np.uint16], Floats, int]]:
    """Return (point, cell, weight, tint) of rays that reach a pane: those of the sky, and those of what covers it."""
    points, normals, shifts = at
    shape = (len(normals), samples)
    origins, rays = np.empty((*shape, 3), np.float32), np.empty((*shape, 3), np.float32)
    weight = np.empty(shape, np.float32)
    pane_rays(points, normals, shifts, 0, samples, pane.corner_m, pane.across_m, pane.up_m, origins, rays, weight)
    useful = np.flatnonzero(weight.ravel() > 0)
    starts, ahead = origins.reshape(-1, 3)[useful], rays.reshape(-1, 3)[useful]
    hits = stage.tracer.cast(starts, ahead)
    p = stage.patches
    through = (hits.triangle >= 0) & (p.owner[hits.triangle] == PANE) & (p.item[hits.triangle] == number)
    useful, ahead = useful[through], ahead[through]
    row, column = pane.cells(starts[through] + hits.distance_m[through, None] * ahead)
    clear = pane.clear[row, column]
    share = weight.ravel()[useful] / samples
    found = []
    lit = clear > 0
    if lit.any():
        # Glass lets through less at an angle; its colour hardly changes with it: the pane's own is multiplied later.
        dimmed = pane.through(ahead[lit]).mean(axis=1) / max(float(np.mean(pane.transmittance)), 1e-9)
        reaches = ((share * clear)[lit] * dimmed).astype(np.float32)
        found.append((useful[lit] // samples, sky_cell(ahead[lit]), reaches, number))
    mean = veil_means(pane)
    veil = pane.veil_cd_m2[row, column].mean(axis=1) / max(float(mean.mean()), 1e-20)
    covered = veil > 0
    if covered.any():
        cell = np.full(int(covered.sum()), SKY_CELLS + number, np.uint16)
        none = len(stage.scene.panes)
        found.append((useful[covered] // samples, cell, (share * veil)[covered].astype(np.float32), none))
    return found


def sky_cell(rays: Floats) -> npt.NDArray[np.uint16]:
    """Return the sky's cell (n,) in the direction of rays (n, 3)."""
    column = ((np.arctan2(rays[:, 0], rays[:, 1]) / (2 * np.pi) + 0.5) * 2 * SKY_ROWS).astype(np.int64) % (2 * SKY_ROWS)
    row = ((0.5 - np.arcsin(np.clip(rays[:, 2], -1, 1)) / np.pi) * SKY_ROWS).astype(np.int64).clip(0, SKY_ROWS - 1)
    return np.asarray(row * 2 * SKY_ROWS + column, dtype=np.uint16)


def veil_means(pane: Pane) -> Doubles:
    """Return the mean radiance (3,) of what covers a pane."""
    return np.asarray(pane.veil_cd_m2.reshape(-1, 3).mean(axis=0, dtype=np.float64))


def sky_values(outdoors: Outdoors, panes: tuple[Pane, ...]) -> Floats:
    """Return the radiance of the sky's cells and of what covers each pane: (cells, 3)."""
    rgb = outdoors.rgb
    if rgb.shape[0] != SKY_ROWS:
        source = Equirectangular(rgb.shape[1], rgb.shape[0])
        rgb, _ = resample(np.ascontiguousarray(rgb), source, Equirectangular(2 * SKY_ROWS, SKY_ROWS))
    veils = [veil_means(pane)[None, :] for pane in panes]
    return np.concatenate([rgb.reshape(-1, 3), *veils]).astype(np.float32)


def _nearness(sight: Sight, pixel: npt.NDArray[np.int64], links: Links) -> npt.NDArray[np.uint8]:
    rows, columns = sight.shape
    # density = cos cos' / (pi r2): its mean's root is about one over the harmonic mean distance.
    near = np.zeros(rows * columns, np.float32)
    near[pixel] = NEARNESS / np.sqrt(np.maximum(np.median(links.density, axis=1) * np.pi * 4, 1e-4))
    weights = np.zeros((rows, columns, (2 * RADIUS_PX + 1) ** 2), np.uint8)
    likeness(
        *(sight.label.reshape(sight.shape), sight.normal.reshape(rows, columns, 3)),
        *(sight.point.reshape(rows, columns, 3), near.reshape(sight.shape), RADIUS_PX, True, weights),
    )
    return weights


def _lamps(stage: Stage, sight: Sight, pixel: npt.NDArray[np.int64], links: Links, effort: Effort, seed: int) -> Floats:
    if not stage.exitance.any():
        return np.zeros((len(pixel), 3), np.float32)
    veiled = tuple(replace(p, veil_cd_m2=np.zeros_like(p.veil_cd_m2)) for p in stage.scene.panes)
    night = replace(stage.scene, panes=veiled, outdoors=Outdoors(np.zeros((2, 4, 3), np.float32)))
    dark = replace(stage, scene=night)
    light = light_of(dark, links, effort.patch_samples, seed)
    found = gathered(dark, light, sight.point[pixel], sight.normal[pixel], effort.pixel_samples, seed)
    picture = np.zeros((len(sight.label), 3), np.float32)
    picture[pixel] = found
    if effort.clean:
        picture = cleaned(picture.reshape(*sight.shape, 3), sight, wraps=True).reshape(-1, 3)
    return np.ascontiguousarray(picture[pixel])


def scene_digest(stage: Stage) -> str:
    """Return what tells one scene from another: its triangles, albedo, emission and panes; not the light outdoors."""
    digest = hashlib.sha256()
    p = stage.patches
    for array in (p.triangles, p.owner, p.item, stage.albedo, stage.exitance):
        digest.update(np.ascontiguousarray(array).tobytes())
    for pane in stage.scene.panes:
        digest.update(np.asarray([*pane.transmittance, pane.sheets]).tobytes())
        digest.update(np.ascontiguousarray(pane.clear).tobytes())
        digest.update(np.ascontiguousarray(pane.veil_cd_m2).tobytes())
    return digest.hexdigest()


def write_basis(path: Path, basis: LightBasis) -> None:
    """Write a basis; it is large and not compressed."""
    arrays: dict[str, npt.NDArray[Any]] = {
        "version": np.array(VERSION),
        "scene": np.array(basis.scene_digest),
        "eye_m": np.array(basis.eye_m),
        "effort": np.array(_numbers(basis.effort)),
        "pixel": basis.pixel,
        "near": basis.near,
        "fixed": basis.fixed,
    }
    for name, sky in (("pixel_sky", basis.pixel_sky), ("patch_sky", basis.patch_sky)):
        arrays |= {f"{name}_{part}": getattr(sky, part) for part in ("first", "cell", "tint", "weight")}
    for name, links in (("pixel_links", basis.pixel_links), ("patch_links", basis.patch_links)):
        arrays |= {f"{name}_patch": links.patch, f"{name}_density": links.density}
    with path.open("wb") as file:
        np.savez(file, **arrays)  # type: ignore[arg-type]


def _numbers(effort: Effort) -> list[float]:
    return [getattr(effort, name) for name in EFFORT_FIELDS]


def read_basis(path: Path) -> LightBasis:
    """Read a basis. Raises `RelightError` for a file that is none, or that another version wrote."""
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as stored:
            found = {name: stored[name] for name in stored.files}
        if int(found["version"]) != VERSION:
            raise ValueError("written by another version")
        texel_m, *counts = (float(v) for v in found["effort"])
        rows, pixels, patches, sun, clean = (int(v) for v in counts)
        effort = Effort(texel_m, patches, rows, pixels, sun, bool(clean))
        skies = [
            SkyRays(*(found[f"{name}_{part}"] for part in ("first", "cell", "tint", "weight")))
            for name in ("pixel_sky", "patch_sky")
        ]
        links = [Links(found[f"{n}_patch"], found[f"{n}_density"]) for n in ("pixel_links", "patch_links")]
        x, y, z = (float(v) for v in found["eye_m"])
        return LightBasis(
            *(effort, (x, y, z), found["pixel"], found["near"], skies[0], links[0], skies[1], links[1]),
            *(found["fixed"], str(found["scene"])),
        )
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise RelightError(
            f"not a basis of this program: {error}", where=path.name, advice="delete the file"
        ) from error


__all__ = ["BASIS_EFFORTS", "LightBasis", "SkyRays", "basis_of", "read_basis", "write_basis"]
