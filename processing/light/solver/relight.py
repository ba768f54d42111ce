"""Pictures of a scene under another light outdoors, from stored rays (`basis`), far cheaper than a render.

Irradiance of a small picture: the sky and all bounces are sums over stored rays; the sun's patch is found anew, and a
few shots at it carry its first bounce. Its noise is taken out, it is brought to the full size, and texture, direct sun
and glass are worked out for every pixel.
"""

from dataclasses import dataclass, replace

import numpy as np

from processing.errors import RelightError
from processing.ground.arrays import Floats
from processing.light.scene.scene import Outdoors
from processing.light.solver.basis import LightBasis, scene_digest
from processing.light.solver.irradiance import cleaned, denoiser_available, relative_error
from processing.light.solver.sight import albedo_of, emission_of, seen_outdoors, sight_of
from processing.light.solver.sky import add_sky, sky_values
from processing.light.solver.stage import Stage
from processing.light.solver.sun import sun_of, sunlight
from processing.light.solver.transport import bounced, patch_points, settled
from processing.light.solver.upsample import Neighbours, Places, Steps
from processing.sphere import Equirectangular, Perspective

PATCH_SHOTS, PIXEL_SHOTS = 4, 2  # at what the sun lights; chosen (benchmark relight)
SUN_PLACES = 16  # places on each patch from which the sun is looked for
FINE = 64  # to a small picture's pixel: so exactly it is known where a view's pixels lie in it


@dataclass(frozen=True)
class Relit:
    """A panorama, or a view (H, W, 3), under another light."""

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

    def __init__(self, stage: Stage, basis: LightBasis, shown: int | Perspective) -> None:
        """``shown``: height of the panorama, or a view. Raises `RelightError` where the basis is of another scene."""
        if basis.scene_digest != scene_digest(stage):
            raise RelightError("the basis belongs to another scene", where="relighting", advice="rebuild it")
        self.stage, self.basis = stage, basis
        self.geometry = Equirectangular(2 * shown, shown) if isinstance(shown, int) else shown
        small = basis.effort.rows
        self.small = sight_of(stage, Equirectangular(2 * small, small), basis.eye_m)
        self.full = self.small if shown == small else sight_of(stage, self.geometry, basis.eye_m)
        fine = np.pi / shown if isinstance(shown, int) else 1 / shown.focal_px
        self.albedo = albedo_of(stage, self.full, float(fine))
        self.emission = emission_of(stage, self.full)
        self._places = patch_points(stage, SUN_PLACES, (0, 85))
        self._steps = None
        if self.full is not self.small:
            whole = isinstance(shown, int)
            places = Places.whole(self.full.shape) if whole else Places.along(self.full.rays, FINE * small)
            self._steps = Steps.of(self.small, self.full, self.full.solid, places, wraps=True, any_solid=True)
        self._colours = np.array([*(p.transmittance for p in stage.scene.panes), (1.0, 1.0, 1.0)], np.float32)
        pixel = basis.pixel
        self._neighbours = None
        if basis.effort.clean and (basis.effort.cleaning == "surfaces" or not denoiser_available()):
            # density = cos cos' / (pi r2): its mean's root is about one over the harmonic mean distance.
            distance_m = np.zeros(len(self.small.label), np.float32)
            distance_m[pixel] = 1 / np.sqrt(np.maximum(np.median(basis.pixel_links.density, axis=1) * np.pi * 4, 1e-4))
            self._neighbours = Neighbours.of(self.small, distance_m)
        self._points, self._normals = self.small.point[pixel][:, None], self.small.normal[pixel]

    def relit(self, outdoors: Outdoors, *, veils: Floats | None = None, seed: int = 0) -> Relit:
        """Return the picture under another light.

        ``veils`` (P,): by what factor the covering of each of P panes (curtain, blind) is brighter than the scene's.
        """
        panes = self.stage.scene.panes
        if veils is not None:
            both = zip(panes, veils, strict=True)
            panes = tuple(replace(p, veil_cd_m2=p.veil_cd_m2 * np.float32(v)) for p, v in both)
        stage = self.stage.under(outdoors, panes)
        small, error = self._irradiance(stage, seed)
        full = self.full
        sky = small.reshape(-1, 3) if self._steps is None else self._steps.apply(small)
        sun = sun_of(stage, full, self.basis.effort.sun_samples, seed)
        light = sky + sun
        rgb = self.albedo * light * np.float32(1 / np.pi) + self.emission
        glass = np.flatnonzero(full.pane >= 0)
        if len(glass):
            rgb[glass] = seen_outdoors(stage, full.some(glass))
        shape = (*full.shape, 3)
        return Relit(rgb.reshape(shape), light.reshape(shape), sun.reshape(shape), error)

    def _irradiance(self, stage: Stage, seed: int) -> tuple[Floats, float]:
        """Return the small picture's irradiance (H, 2 H, 3) without the sun's own disc, and its relative error."""
        basis = self.basis
        values = sky_values(stage.scene.outdoors, stage.scene.panes)
        # The light of all patches but for lamps, which the basis holds
        first = np.zeros((stage.patches.count, 3), np.float32)
        add_sky(self.basis.patch_sky, self._colours, values, first, np.zeros(len(first), np.float32))
        sun = sunlight(stage, self._places, stage.patches.normal, SUN_PLACES, (seed, 87))
        given = first.astype(np.float64), sun, np.zeros_like(sun)
        light = settled(stage, self.basis.patch_links, given, self._places, PATCH_SHOTS, (seed, 88))
        out, apart = basis.fixed.copy(), np.zeros(len(basis.pixel), np.float32)
        add_sky(basis.pixel_sky, self._colours, values, out, apart)
        places, radiosity = (self._points, self._normals), stage.albedo * light.rest
        more, more_apart = bounced(stage, basis.pixel_links, radiosity, light.bright, places, PIXEL_SHOTS, (seed, 86))
        out += more
        # Two halves of the rays, as far apart in every channel as they are in green.
        half = (apart + more_apart)[:, None]
        pictures = np.zeros((3, len(self.small.label), 3), np.float32)
        pictures[:, basis.pixel] = out, out + half, out - half
        mean, one, other = pictures.reshape(3, *self.small.shape, 3)
        error = relative_error(one, other, self.small, blurred=basis.effort.clean)
        if self._neighbours is not None:
            mean = self._neighbours.smooth(mean)
        elif basis.effort.clean:
            mean = cleaned(mean, self.small, wraps=True, quality=basis.effort.cleaning)
        return mean, error
