"""The rays of a scene that no other light outdoors changes, kept so that another sky casts none of them.

Irradiance is linear in the light outdoors. For the pixels of a small picture and for all patches the basis keeps which
cell of the sky each ray through a pane reaches with what weight, and which patch each ray into the room meets. Another
sky is then a sum over stored rays; only the sun's own patch, which moves, needs new ones (`relight`).
"""

import hashlib
import zipfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from processing.errors import ParameterError, RelightError
from processing.ground.arrays import Floats, Indices, Vector
from processing.light.scene.scene import Outdoors
from processing.light.solver.irradiance import Effort, cleaned, gathered
from processing.light.solver.sight import Sight, sight_of
from processing.light.solver.sky import SkyRays, sky_rays
from processing.light.solver.stage import Stage
from processing.light.solver.transport import Links, light_map, links_of, patch_points
from processing.sphere import Equirectangular

MOST_BYTES = 1 << 30  # chosen: what a computer of 8 GiB can spare
EFFORT_FIELDS = ("texel_m", "rows", "pixel_samples", "patch_samples", "sun_samples", "clean")
"""That count for a basis, as they stand in its file."""
VERSION = 3  # of the file's format, raised when it changes
BASIS_EFFORTS = {
    "draft": Effort(texel_m=0.15, rows=128, pixel_samples=16, patch_samples=32, sun_samples=16, cleaning="surfaces"),
    "standard": Effort(pixel_samples=32, sun_samples=32, cleaning="surfaces"),
    "reference": Effort(rows=384, pixel_samples=64, patch_samples=128, sun_samples=64, cleaning="fast"),
}
"""How much a basis holds: ``rows`` of its small picture, rays from each pixel and each patch (half, and a quarter, as
many go to the panes); ``sun_samples`` are of every light shown. A basis is one round: it knows no error to stop at. The
learned denoiser costs three times all else in another light and lowers its rms error by a fifth (benchmark relight):
only reference takes it."""


@dataclass(frozen=True)
class LightBasis:
    """The stored rays of one scene seen from one place."""

    effort: Effort
    eye_m: Vector
    pixel: Indices
    """(N,): which pixels of the small panorama see something solid."""
    pixel_sky: SkyRays
    pixel_links: Links
    patch_sky: SkyRays
    patch_links: Links
    fixed: Floats
    """(N, 3) lx: irradiance of the pixels by lamps, bounces included."""
    scene_digest: str


STORED: dict[str, Any] = {"pixel_sky": SkyRays, "pixel_links": Links, "patch_sky": SkyRays, "patch_links": Links}
"""The fields of a basis that hold rays, in their order."""


def basis_of(stage: Stage, eye_m: Vector, *, effort: Effort = BASIS_EFFORTS["standard"], seed: int = 0) -> LightBasis:
    """Return the stored rays of a scene seen from ``eye_m``; the scene's own light outdoors does not matter.

    Raises `RelightError`: it would take more than `MOST_BYTES`; `ParameterError`: fewer than two samples (their
    difference gives the error), or an error or a time to stop at.
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
    lamps = _lamps(stage, sight, pixel, patch_links, effort, seed)
    return LightBasis(effort, eye_m, pixel, sky, links, patch_sky, patch_links, lamps, scene_digest(stage))


def _affordable(stage: Stage, effort: Effort) -> None:
    if min(effort.rows, effort.pixel_samples, effort.patch_samples) < 2:
        raise ParameterError("a basis of nothing", advice="give rows and samples of 2 or more")
    if effort.max_error is not None or effort.budget_s is not None:
        raise ParameterError("a basis is made in one round", advice="leave max_error and budget_s out")
    panes = max(len(stage.scene.panes), 1)
    pixels = 2 * effort.rows**2
    a_pixel = 8 * effort.pixel_samples + 8 * max(4 * panes, effort.pixel_samples // 2) + 40
    a_patch = 8 * effort.patch_samples + 2 * effort.patch_samples * panes
    size = pixels * a_pixel + stage.patches.count * a_patch
    if size > MOST_BYTES:
        text = f"its basis would take {size / 2**30:.1f} GiB"
        advice = "choose a lower quality"
        raise RelightError(text, where="relighting", likely="a very large room, or very many windows", advice=advice)


def _lamps(stage: Stage, sight: Sight, pixel: Indices, links: Links, effort: Effort, seed: int) -> Floats:
    """Return the irradiance (N, 3) of the small picture's pixels by lamps, bounces included."""
    if not stage.exitance.any():
        return np.zeros((len(pixel), 3), np.float32)
    veiled = tuple(replace(p, veil_cd_m2=np.zeros_like(p.veil_cd_m2)) for p in stage.scene.panes)
    dark = stage.under(Outdoors(np.zeros((2, 4, 3), np.float32)), veiled)
    light = light_map(dark, effort.patch_samples, seed, links)
    lit = gathered(dark, light, sight.point[pixel], sight.normal[pixel], effort.pixel_samples, seed)
    picture = sight.picture(lit, pixel)
    if effort.clean:
        picture = cleaned(picture, sight, wraps=True)
    return np.ascontiguousarray(picture.reshape(-1, 3)[pixel])


def scene_digest(stage: Stage) -> str:
    """Return a digest of a scene's triangles, albedo, emission and panes; not of the light outdoors."""
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
        "effort": np.array([getattr(basis.effort, name) for name in EFFORT_FIELDS]),
        "cleaning": np.array(basis.effort.cleaning),
        "pixel": basis.pixel,
        "fixed": basis.fixed,
    }
    for name in STORED:
        arrays |= {f"{name}_{part}": values for part, values in getattr(basis, name)._asdict().items()}
    with path.open("wb") as file:
        np.savez(file, **arrays)  # type: ignore[arg-type]


def read_basis(path: Path) -> LightBasis:
    """Read a basis. Raises `RelightError` for a file that is none, or that another version wrote."""
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as stored:
            found = {name: stored[name] for name in stored.files}
        if int(found["version"]) != VERSION:
            raise ValueError("written by another version of daylit")
        texel_m, *counts = (float(v) for v in found["effort"])
        rows, pixels, patches, sun, clean = (int(v) for v in counts)
        effort = Effort(texel_m, patches, rows, pixels, sun, bool(clean), str(found["cleaning"]))
        rays = {name: kind(*(found[f"{name}_{part}"] for part in kind._fields)) for name, kind in STORED.items()}
        x, y, z = (float(v) for v in found["eye_m"])
        digest = str(found["scene"])
        return LightBasis(effort, (x, y, z), found["pixel"], **rays, fixed=found["fixed"], scene_digest=digest)
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise RelightError(f"not a light basis of daylit: {error}", where=path.name, advice="delete it") from error
