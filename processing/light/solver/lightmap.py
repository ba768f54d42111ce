"""The irradiance of every patch: direct light from outside, lamps and sunlit patches, and all bounces."""

from __future__ import annotations

from dataclasses import dataclass

from processing.errors import ParameterError
from processing.ground.arrays import Doubles, Floats
from processing.light.solver.daylight import skylight, sunlight
from processing.light.solver.stage import Stage
from processing.light.solver.transport import BrightPatches, Links, from_bright, links_of, patch_points, settle

SKY_SHARE, SUN_SHARE, SHOT_SHARE = 0.25, 0.25, 0.25
"""Of the rays spent on bounces: to each pane, to the sun, to what it lights."""


@dataclass(frozen=True)
class LightMap:
    """Irradiance (patches, 3) in lx, RGB: means over each patch."""

    sun: Doubles
    """By the sun's own disc."""
    rest: Doubles
    """All else: sky, lamps, bounces."""
    bright: BrightPatches | None
    """What the sun lights and lamps, with its radiosity."""
    links: Links

    @property
    def total(self) -> Doubles:
        """Return sun and rest."""
        return self.sun + self.rest


def light_map(stage: Stage, samples: int = 64, seed: int = 0) -> LightMap:
    """Return the light of all patches of a scene; ``samples`` rays from each patch gather the bounces.

    Deterministic: the same scene, samples and seed give the same light, bit by bit.
    """
    if not 1 <= samples <= 1 << 20:
        raise ParameterError(f"{samples} samples", advice="give 1 to 1,048,576", samples=True)
    normals = stage.patches.normal
    points = patch_points(stage, samples, (seed, 0))
    links = links_of(stage, points, normals, samples, (seed, 1))
    return relit(stage, links, samples, seed)


def relit(stage: Stage, links: Links, samples: int, seed: int = 0) -> LightMap:
    """Return the light of a scene whose bounces' rays are known already: of another sky or other albedo."""
    normals = stage.patches.normal

    def few(share: float) -> int:
        return max(1, round(samples * share))

    def spread(count: int, purpose: int) -> Floats:
        return patch_points(stage, count, (seed, purpose))

    sky = skylight(stage, spread(few(SKY_SHARE), 2), normals, few(SKY_SHARE), (seed, 3))
    sun = sunlight(stage, spread(few(SUN_SHARE), 4), normals, few(SUN_SHARE), (seed, 5))
    bright = BrightPatches.of(stage, stage.albedo * sun + stage.exitance)
    if bright is not None:
        shots = few(SHOT_SHARE)
        sky += from_bright(stage, bright, spread(shots, 6), normals, links, shots, (seed, 7))
    return LightMap(sun, settle(stage, links, sky, stage.albedo), bright, links)
