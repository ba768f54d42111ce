"""Irradiance of what a picture sees: gathered at a small size until the error asked for is met, cleaned of noise.

Noise taken out of irradiance pictures by Open Image Denoise, with normals as guides; never out of a photograph."""

import math
import time
from dataclasses import dataclass, field, replace
from importlib.util import find_spec
from typing import Self, TypeAlias

import cv2
import numpy as np

from processing.errors import EngineError, ParameterError
from processing.ground.arrays import Doubles, Flags, Floats
from processing.ground.seam import wrapped
from processing.ground.threads import side_by_side
from processing.light.solver.sight import FIRST_PART, NOTHING, Sight, by_label
from processing.light.solver.sky import skylight
from processing.light.solver.stage import Stage
from processing.light.solver.transport import LightMap, bounced, light_map, links_of
from processing.light.solver.upsample import NEARNESS, Neighbours, Places, upsampled
from processing.pictures.images import LUMINANCE_WEIGHTS

PANE_SHARE, SHOT_SHARE = 0.5, 0.25  # of a pixel's rays for bounces: to each pane, to bright patches
FURNITURE_TIMES, FURNITURE_ROWS, FURNITURE_RAYS, FURNITURE_PX = 4, 1024, 0.75, 3.0
FURNITURE_PASSES = ((1, math.inf), (3, 0.1))
"""Light on furniture that is to be cleaned is gathered at as many times the rows, up to so many, by this share of the
rays, and smoothed along its surfaces over as many pixels, then over three times as many where it is alike (as Dammertz
and others 2010): slats, folds and rims of pillows are narrower than a pixel of the room's, and the denoiser blurs them
(chosen; measured in docs/measurements/render.md)."""
CLEAN_PX = 5  # measured: about as many pixels as cleaning averages over (docs/reference/rendering.md)
FIREFLY_TIMES = 8.0  # over its neighbours and over the other half, from which a pixel shines by chance
LEAN_LEAST, LEAN_RIDGE = 0.3, 0.02
"""Of a thing's mean light the least that its directions say, and what is added to their squares, which keeps flat
things, that face one way, from saying anything. Chosen."""
Lights: TypeAlias = dict[tuple[int, int], LightMap]  # light maps of a stage that are known already, by samples and seed
WRAP = 0.125  # share of a panorama's width that is repeated beyond its seam
EVEN_RAD, EVEN_RANGE, EVEN_FROM_RAD = 0.06, 0.7, 0.1
"""Over which a ratio of two lights is evened out, by how much (natural logarithm, summed over the channels) it may
differ there, and how far from furniture it is evened out fully, less the nearer. Chosen: contact shadows and half
shadows stay (0.9 everywhere took them away: docs/measurements/render.md), blotches of single texels go."""
RIM_PX = 2  # of a surface's end, where light is that of the same number of pixels further in (chosen: of 1, a blind's
# shade on the ceiling beside the wall was left in dots, where the pixels' rows cross the edge)
APART = 20.0  # of such a ratio, between places that have nothing to do with each other


@dataclass(frozen=True)
class Effort:
    """How much work goes into a picture: rays in each round, and when to stop."""

    texel_m: float = 0.1
    """Width of the light map's patches."""
    patch_samples: int = 64
    """Rays from each patch in a round."""
    rows: int = 256
    """Height of the picture in which irradiance is gathered; never more than the picture asked for."""
    pixel_samples: int = 16
    """Rays from each of its pixels in a round."""
    sun_samples: int = 128
    """Rays to the sun's disc from pixels in half shadow."""
    clean: bool = True
    """Whether noise is taken out."""
    cleaning: str = "high"
    """How well: high or fast (`denoise.denoised`; fast takes a fifth of the time, and the rays that it saves gain
    more); surfaces: of relit pictures, plain means along surfaces (`upsample.Neighbours`)."""
    max_error: float | None = None
    """Relative standard error to stop at; None: one round."""
    budget_s: float | None = None
    """CPU seconds of this process after which no other round begins."""
    most_rounds: int = 64

    def __post_init__(self) -> None:
        numbers = (self.patch_samples, self.rows, self.pixel_samples, self.sun_samples, self.most_rounds)
        if min(numbers) < 1 or (self.max_error is not None and not self.max_error > 0):
            raise ParameterError("an effort of nothing", advice="give samples and rows from 1, max_error above 0")

    @property
    def furniture_rows(self) -> int:
        """Height of the picture in which light on furniture is gathered."""
        return min(FURNITURE_TIMES * self.rows, FURNITURE_ROWS)


EFFORTS = {
    "draft": Effort(texel_m=0.15, patch_samples=32, rows=128, pixel_samples=8, sun_samples=16, cleaning="fast"),
    "standard": Effort(),
    "reference": Effort(texel_m=0.05, patch_samples=256, rows=512, pixel_samples=256, sun_samples=512, clean=False),
}


@dataclass(frozen=True)
class Leanings:
    """How light on each piece of furniture depends on where its surface faces: a constant and a vector.

    To first order in the normal, as of irradiance's rotational gradient (Ward and Heckbert 1992), but fitted to all
    that is seen of a part."""

    found: dict[int, Floats]
    """By label (5, 3): the constant, the vector, and the mean light, lx, for each channel."""

    @classmethod
    def fitted(cls, light: Floats, sight: Sight) -> Self:
        """Return what light (H, W, 3), lx, on what is seen says."""
        flat, found = light.reshape(-1, 3), {}
        for label, mine in sight.pixels.items():
            if label < FIRST_PART:
                continue
            normal, mean = sight.normal[mine].astype(np.float64), flat[mine].mean(axis=0, dtype=np.float64)
            middle = normal.mean(axis=0)
            apart = normal - middle
            square = apart.T @ apart / len(mine) + LEAN_RIDGE * np.eye(3)
            vector = np.linalg.solve(square, apart.T @ (flat[mine] - mean) / len(mine))
            found[label] = np.concatenate([[mean - middle @ vector], vector]).astype(np.float32)
            found[label] = np.concatenate([found[label], [mean.astype(np.float32)]])
        return cls(found)

    def of(self, sight: Sight) -> Floats:
        """Return the light (N, 3), lx, that directions say; 1 where nothing is known, above 0."""
        out = np.ones((len(sight.label), 3), np.float32)
        for label, mine in by_label(sight.label, FIRST_PART).items():
            if label in self.found:
                constant, vector, mean = self.found[label][0], self.found[label][1:4], self.found[label][4]
                out[mine] = np.maximum(constant + sight.normal[mine] @ vector, np.maximum(LEAN_LEAST * mean, 1e-9))
        return out


@dataclass(frozen=True)
class Irradiance:
    """Irradiance of a picture's pixels without the sun's own disc."""

    picture: Floats
    """(H, W, 3) lx, 0 where nothing or glass is seen."""
    error: float
    """Relative standard error of luminance (rms over pixels), from two halves that share nothing but the scene."""
    rounds: int
    furniture: tuple[Floats, Sight, Leanings] | None = None
    """The same of furniture in a finer picture, what that sees of it, and what both are in shares of; None:
    ``picture`` has it."""

    def enlarged(
        self, small: Sight, large: Sight, places: Places, *, wraps: bool, before: Floats | None = None
    ) -> tuple[Floats, Flags]:
        """Return this light, after another light ``before`` (H, W, 3), on a larger picture's pixels, as `upsampled`."""
        values = self.picture if before is None else np.concatenate([before, self.picture], axis=2)
        if self.furniture is None:
            return upsampled(values, small, large, wraps=wraps, places=places)
        room = large.label < FIRST_PART
        light, missed = upsampled(values, small, large, wraps=wraps, places=places, among=room)
        share, fine, leanings = self.furniture
        own, alone = upsampled(share, fine, large, wraps=wraps, places=places, among=~room)
        light[:, -3:] += own * leanings.of(large)
        return light, missed | alone


@dataclass
class _Halves:
    """Two sums of rounds."""

    sums: list[Doubles] = field(default_factory=list)
    rounds: int = 0

    def add(self, pictures: list[Doubles]) -> None:
        self.sums = [a + b for a, b in zip(self.sums, pictures, strict=True)] if self.sums else pictures
        self.rounds += 1


def gathered(stage: Stage, light: LightMap, points: Floats, normals: Floats, samples: int, seed: int) -> Doubles:
    """Return the irradiance (N, 3), lx, of places without the sun's own disc: panes, lamps, all bounces.

    ``points`` (N, 3), m; ``normals`` (N, 3); ``samples`` rays from each point for bounces."""
    places = points[:, None, :]
    links = links_of(stage, places, normals, samples, (seed, 21))
    radiosity, shots = stage.albedo * light.rest, max(1, round(samples * SHOT_SHARE))
    out, _ = bounced(stage, links, radiosity, light.bright, (places, normals), shots, (seed, 22))
    return skylight(stage, places, normals, max(1, round(samples * PANE_SHARE)), (seed, 20)) + out


def irradiance_of(
    stage: Stage,
    sight: Sight,
    effort: Effort,
    seed: int,
    *,
    wraps: bool,
    lights: Lights | None = None,
    fine: Sight | None = None,
) -> Irradiance:
    """Return the irradiance of all solid pixels: rounds of two halves each, until the effort's end is reached.

    ``lights`` keeps the stage's light maps for another picture of it; ``fine``: a finer picture's sight for furniture.
    """
    lights = {} if lights is None else lights
    solid = np.flatnonzero(sight.solid)
    halves, start_s = _Halves(), time.process_time()
    while True:
        seeds = [(seed * 1000 + halves.rounds) * 2 + half for half in range(2)]
        halves.add(side_by_side(lambda one: _half(stage, sight, solid, effort, one, lights), seeds))
        noisy = [sight.picture(total / halves.rounds, solid) for total in halves.sums]
        noisy = [without_fireflies(one, other) for one, other in (noisy, noisy[::-1])]
        error = relative_error(noisy[0], noisy[1], sight, blurred=effort.clean)
        spent = effort.budget_s is not None and time.process_time() - start_s >= effort.budget_s
        if effort.max_error is None or error <= effort.max_error or spent or halves.rounds >= effort.most_rounds:
            mean: Floats = (noisy[0] + noisy[1]) * np.float32(0.5)
            if effort.clean:
                mean = cleaned(mean, sight, wraps=wraps, quality=effort.cleaning)
            own = None if fine is None else _on_furniture(stage, fine, effort, halves.rounds, seeds, lights)
            if own is not None and own[1].shape == sight.shape:
                whole = own[0] * own[2].of(own[1]).reshape(*sight.shape, 3)
                mean, own = np.where(own[1].solid.reshape(*sight.shape, 1), whole, mean), None
            return Irradiance(mean, error, halves.rounds, own)


def _half(stage: Stage, sight: Sight, solid: np.ndarray, effort: Effort, seed: int, lights: Lights) -> Doubles:
    samples = max(1, effort.patch_samples // 2)
    light = lights.get((samples, seed)) or light_map(stage, samples, seed)
    lights[samples, seed] = light
    return gathered(stage, light, sight.point[solid], sight.normal[solid], max(1, effort.pixel_samples // 2), seed)


def _on_furniture(
    stage: Stage, sight: Sight, effort: Effort, rounds: int, seeds: list[int], lights: Lights
) -> tuple[Floats, Sight, Leanings]:
    """Return the irradiance (h, w, 3) of furniture in a finer picture, and what that sees of it, the room left out.

    It is in shares of what the surfaces' directions alone say (`Leanings`), and so smoothed and brought to other pixels
    without the loss of creases: cloth was as plain as moulded plastic."""
    at, rays = np.flatnonzero(sight.label >= FIRST_PART), FURNITURE_RAYS * effort.pixel_samples * rounds / 2
    where = sight.point[at], sight.normal[at], max(1, round(rays))

    def half(one: int) -> Floats:
        known = lights[max(1, effort.patch_samples // 2), one]
        return sight.picture(gathered(stage, known, *where, one), at)

    halves = side_by_side(half, seeds)
    mean = np.asarray(sum(without_fireflies(*pair) for pair in (halves, halves[::-1])), np.float32) / np.float32(2)
    own = replace(sight, label=np.where(sight.label >= FIRST_PART, sight.label, NOTHING).astype(np.int32))
    leanings = Leanings.fitted(mean, own)
    mean = np.where(own.solid.reshape(*sight.shape, 1), mean / leanings.of(own).reshape(*sight.shape, 3), 0)
    mean = mean.astype(np.float32)
    reach_m = sight.distance_m * np.float32(FURNITURE_PX * np.pi / sight.shape[0])
    for step, apart in FURNITURE_PASSES:
        mean = Neighbours.of(own, reach_m * np.float32(step / NEARNESS), step).smooth(mean, apart)
    return mean, own.faces, leanings


def without_fireflies(one: Floats, other: Floats) -> Floats:
    """Return irradiance (H, W, 3) without pixels that shine by chance: far above those around and in ``other``.

    Only what both pictures of the same places do not share is dimmed, to `FIREFLY_TIMES` their neighbours' median: what
    is bright of its own shines in both."""
    weights = np.asarray(LUMINANCE_WEIGHTS, np.float32)
    mine, theirs = one @ weights, other @ weights
    limit = FIREFLY_TIMES * np.maximum(cv2.medianBlur(mine, 5), cv2.medianBlur(theirs, 5))
    over = (mine > limit) & (mine > FIREFLY_TIMES * theirs) & (limit > 0)
    if not over.any():
        return one
    gain = np.where(over, np.maximum(limit, theirs) / np.maximum(mine, 1e-30), 1).astype(np.float32)
    return np.asarray(one * gain[..., None], np.float32)


def cleaned(picture: Floats, sight: Sight, *, wraps: bool, quality: str = "high") -> Floats:
    """Return irradiance (H, W, 3) of what pixels see without its noise."""
    nearness = np.where(sight.solid, 1 / (1 + np.where(sight.solid, sight.distance_m, 0)), 0)
    guides = sight.normal.reshape(*sight.shape, 3), nearness.reshape(sight.shape).astype(np.float32)
    return denoised(picture, *guides, wraps=wraps, quality=quality)


def relative_error(one: Floats, other: Floats, sight: Sight, *, blurred: bool) -> float:
    """Return the relative rms error of the mean of two halves (H, W, 3); where it is cleaned, of neighbours' means.

    Cleaning averages over about as many pixels as `CLEAN_PX` squared: measured, see docs/reference/rendering.md."""
    solid = sight.solid.reshape(sight.shape)
    if not solid.any():
        return 0.0
    weights = np.asarray(LUMINANCE_WEIGHTS, np.float32)
    apart, whole = (one - other) @ weights, (one + other) @ weights
    relative = np.where(solid, apart / np.maximum(whole, 1e-12), 0).astype(np.float64)
    if blurred:
        size = (CLEAN_PX, CLEAN_PX)
        share = cv2.boxFilter(solid.astype(np.float64), -1, size, borderType=cv2.BORDER_REPLICATE)
        relative = cv2.boxFilter(relative, -1, size, borderType=cv2.BORDER_REPLICATE) / np.maximum(share, 1e-3)
    return float(np.sqrt(np.mean(relative[solid] ** 2)))


def denoiser_available() -> bool:
    """Return whether the denoiser is installed."""
    return find_spec("pyoidn") is not None


def denoised(irradiance: Floats, normal: Floats, nearness: Floats, *, wraps: bool, quality: str = "high") -> Floats:
    """Return irradiance (H, W, 3) without its noise and with its mean kept; as it is where the denoiser is missing.

    ``normal`` (H, W, 3), zero where nothing is rendered.
    ``nearness`` (H, W), 0..1: 0 where nothing is rendered, larger for nearer surfaces; parts corners of equal normals.
    ``wraps``: the picture is a panorama whose left and right edges meet.
    ``quality``: high, balanced (0.4 of its time) or fast (0.2)."""
    if not denoiser_available() or min(irradiance.shape[:2]) < 16:
        return irradiance
    side = round(WRAP * irradiance.shape[1]) if wraps else 0

    def wider(picture: Floats) -> Floats:
        return np.ascontiguousarray(wrapped(picture, side), np.float32)

    guide = np.repeat(nearness[..., None], 3, axis=2).astype(np.float32)
    # The denoiser expects values about 1.
    scale = np.float32(max(float(irradiance.mean()), 1e-20))
    clean = _clean({"color": wider(irradiance / scale), "albedo": wider(guide), "normal": wider(normal)}, quality)
    clean = np.maximum(clean[:, side : side + irradiance.shape[1]], 0) * scale
    there = nearness > 0
    kept = clean[there].mean(axis=0, dtype=np.float64)
    whole = irradiance[there].mean(axis=0, dtype=np.float64)
    gain = np.where(kept > 0, whole / np.maximum(kept, 1e-30), 1.0)
    return np.asarray(clean * gain, dtype=np.float32)


def _clean(pictures: dict[str, Floats], quality: str) -> Floats:
    """Return what the denoiser makes of a noisy picture and its noiseless guides (H, W, 3).

    `pyoidn.denoise` would keep its working memory until the process ends: half a gigabyte for 512 rows."""
    import pyoidn

    out = np.empty_like(pictures["color"])
    with pyoidn.Device() as device:
        device.commit()
        with pyoidn.Filter(device) as work:
            for name, picture in {**pictures, "output": out}.items():
                work.set_image(name, picture, pyoidn.OIDN_FORMAT_FLOAT3)
            work.set_bool("hdr", True)
            work.set_bool("cleanAux", True)
            work.set_quality(getattr(pyoidn, f"OIDN_QUALITY_{quality.upper()}"))
            work.commit()
            work.execute()
        if error := device.get_error():
            raise EngineError(f"the denoiser failed: {error}")
    return out


def evened(after: Floats, before: Floats, sight: Sight, known: Flags) -> Floats:
    """Return ``after`` (H, W, 3) with the noise of its ratio to ``before`` (H, W, 3) taken out, lx, of a panorama.

    Noise is taken out of each light by itself, and texels near an edge light it by what chance gave them: their ratio
    still has blotches, of 5 to 10 %, which are seen on a plain wall. It is smoothed along each surface of the room,
    where it is ``known`` (H, W), but not over edges (bilateral filter, Tomasi & Manduchi 1998). What is equal stays so.
    """
    label, sigma_px = sight.label.reshape(sight.shape), EVEN_RAD / np.pi * sight.shape[0]
    mine = known & (label >= 0) & (label < FIRST_PART)
    ratio = np.log(np.maximum(after, 1e-9) / np.maximum(before, 1e-9)).clip(-APART / 4, APART / 4)
    pad_px = 2 * math.ceil(sigma_px)
    whose = wrapped(np.where(mine, label, -1).astype(np.float32), pad_px)
    shifted = wrapped(np.where(mine[..., None], ratio, 0).astype(np.float32), pad_px)
    _rims_by_inner(shifted, whose, wrapped((label < FIRST_PART).astype(np.uint8), pad_px) > 0)
    # Values so far apart have no weight in each other's mean.
    smooth = cv2.bilateralFilter(shifted + np.float32(APART) * whose[..., None], -1, EVEN_RANGE, sigma_px)
    far_px = cv2.distanceTransform(wrapped((label < FIRST_PART).astype(np.uint8), pad_px), cv2.DIST_L2, 3)
    share = np.minimum(far_px / (EVEN_FROM_RAD / np.pi * sight.shape[0]), 1)[:, pad_px:-pad_px, None]
    change = np.exp(share * (smooth[:, pad_px:-pad_px] - APART * label[..., None]) + (1 - share) * ratio)
    return np.asarray(np.where(mine[..., None] & (ratio != 0), before * change, after), np.float32)


def _rims_by_inner(ratio: Floats, label: Floats, room: Flags) -> None:
    """Replace a ratio (H, W, 3) where a surface of the ``room`` (H, W) ends at another by what it is further in.

    There the denoiser brings a bright sill's light to the wall below it, to one picture more than to the other. Ends at
    furniture stay: contact shadows are there. ``label`` (H, W) is below 0 where nothing is known."""
    wide = np.ones((2 * RIM_PX + 1,) * 2, np.uint8)
    for one in np.unique(label[label >= 0]):
        own = label == one
        beyond = cv2.dilate((~own & room).astype(np.uint8), wide) > 0
        inner = own & ~beyond
        far, nearest = cv2.distanceTransformWithLabels(
            (~inner).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
        )
        rim, of = own & beyond & (far <= 2 * RIM_PX), np.zeros((nearest.max() + 1, 3), np.float32)
        of[nearest[inner]] = ratio[inner]
        ratio[rim] = of[nearest[rim]]
