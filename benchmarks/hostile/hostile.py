"""Merging and light figures in worlds that share no code with the estimators (`benchmarks.hostile.worlds`).

Twenty worlds, each with a published real curve drawn at random (the shipped prior of curves was fitted to all of them:
`dorf` judges by curves that no prior has seen), in three real HDR scenes of 768 x 384: nine frames,
curve and times estimated from them, scale by a spot reading good to 1.2 %, as a session's indoor side is made.
Coverage is the share of valid pixels within 1.96 stated standard uncertainties of the truth, with all that is stated
(own, shared, scale); smooth: the local standard deviation of log luminance is below 3 %, textured: above 10 %.
`lens_known_*`: the same without what is stated for stray light and for two lenses, in worlds that have none of it.
Illuminance: five planes through the camera. Rival: the better of OpenCV's Debevec and Robertson by median error, on the
same spot, both with an exact reading. `drawn_*`: both against the light that the lens draws, which is all that frames
show; `drawn_err_stops` of worlds with a halo: that light's own median error, which a perfect merge has.
A bracket that is refused counts as refused, not as covered. Cameras with a mosaic and a matrix have raw files beside
their JPEGs: the same wells, merged as `daylit process` merges them. Stray light: `glare`; raw files of a panorama
camera, of two lenses side by side: `two_lenses`; rigs that see spectra: `spectra`; whole rigs of hostile cameras,
with their k1, k2, room and sky: `rigs`; hard films, by command: `film`.
A full run keeps a row for each bracket, lens, rig and film (`benchmarks.kept_rows`): one that was interrupted goes on
where it stopped. A row's key holds a digest of the code that it measures (`CODE`): change that, and it is made anew.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from benchmarks.hostile.film import film_figures
from benchmarks.hostile.glare import lamp_kernel, stray_light_figures
from benchmarks.hostile.merging import merged_pictures, merged_raws
from benchmarks.hostile.odd_even import odd_even_figures
from benchmarks.hostile.rigs import rig_figures
from benchmarks.hostile.spectra import spectral_figures
from benchmarks.hostile.two_lenses import two_lens_figures
from benchmarks.hostile.worlds import (
    Curves,
    HostileBracket,
    HostileWorld,
    hostile_bracket,
    hostile_worlds,
    through_lens,
)
from benchmarks.kept_rows import Row, Rows
from benchmarks.seeds import seeds
from benchmarks.shared_data import DATA
from mocks.worlds.hdr_world import read_equirect
from processing.calibration.merge.modes import local_contrast
from processing.calibration.response.response import ResponseFit, recover_response
from processing.calibration.response.samples import Bracket8
from processing.calibration.scale.glare_fit import GlareKernel
from processing.calibration.scale.luminance import ScaleFactor, scaled
from processing.calibration.scale.photometry import PLANES, illuminance_lx
from processing.calibration.scale.veiling_glare import kernel_modes, unmeasured_modes, without_glare
from processing.errors import ProcessingError
from processing.figures.uncertainty import light_figure
from processing.ground.arrays import Doubles, Flags, Floats
from processing.pictures.images import LuminanceImage, RelativeImage, luminance_cd_m2
from processing.pictures.modes import modes_of, relative_error, seam_mode, widened
from processing.sphere import Equirectangular
from training.response_prior import published_curves

CODE = {
    "ours": (
        "benchmarks/hostile/*.py",
        "benchmarks/photometry/rig.py",
        "benchmarks/sessions.py",
        "mocks/optics/*.py",
        "mocks/worlds/*.py",
        "processing/calibration/**/*.*",
        "processing/figures/*.py",
        "processing/pictures/*.py",
        "processing/rig/*.py",
        "processing/sphere/*.py",
        "processing/stages/calibrate.py",
        "processing/stages/merge.py",
    )
}
"""What rows depend on: the cameras, and what merges, scales and sums up their frames."""
SIZE, QUICK_SIZE = (768, 384), (384, 192)
SCENES = ("panoramas/hdr/lebombo_1k.hdr", "panoramas/hdr/adams_place_bridge_1k.hdr", "sky/rooitou_park_1k.hdr")
QUICK_WORLDS = (1, 7, 9, 16)
RIGS, QUICK_RIGS = 60, 6
CAMERA_RIGS, QUICK_CAMERA_RIGS = 6, 1
RIG_DIVISOR = 8
"""By which full pictures are divided: small, for a rig takes some 60 frames."""
METER_SIGMA = 0.012
SMOOTH, TEXTURED = 0.03, 0.10
SPOT_PX = 5
WHITE_PERCENTILE, WHITE_S = 60.0, 0.05
"""The light at this percentile saturates in this time: all nine frames then show something."""


@dataclass
class Score:
    """What became of one bracket; shares are 0..1, errors in stops."""

    name: str
    cover: float = 0.0
    smooth: float = 0.0
    textured: float = 0.0
    lux: list[bool] = field(default_factory=list)
    cover68: float = 0.0
    median: float = np.inf
    p95: float = np.inf
    bias: float = np.inf
    rival: float = np.inf
    lens_known: float = 0.0
    drawn: float = np.inf
    drawn_rival: float = np.inf
    drawn_err: float = np.inf
    ghost: float | None = None
    refused: str = ""


def run(*, quick: bool, seed: int) -> dict[str, Any]:
    """Return metrics; see the module's docstring."""
    kept = Rows("hostile", seed, CODE, keep=not quick)
    [number] = seeds("test", 1, seed)
    worlds = hostile_worlds(published_cameras(), number)
    chosen = [worlds[k] for k in QUICK_WORLDS] if quick else worlds
    scenes = [scene_of(name, QUICK_SIZE if quick else SIZE) for name in (SCENES[:1] if quick else SCENES)]
    cases = [
        (world, scene, number + 1000 * worlds.index(world) + k) for world in chosen for k, scene in enumerate(scenes)
    ]
    scores = [_kept_score(kept.row, *case) for case in cases]
    developed = [case[0].camera.mosaic and case[0].camera.matrix is not None for case in cases]
    raws = [(scores[k], _kept_score(kept.row, *case, raw=True)) for k, case in enumerate(cases) if developed[k]]
    halos = [_kept_score(kept.row, *case, lamps=True) for case in cases if case[0].halo]
    by_world = [[s for s in scores if s.name == world.name] for world in chosen]
    done = [s for s in scores if not s.refused]
    covers = [float(np.mean([s.cover for s in group])) for group in by_world]
    gains = [float(np.median([0.0 if s.refused else s.rival / s.median for s in group])) for group in by_world]
    drawn = [float(np.median([0.0 if s.refused else s.drawn_rival / s.drawn for s in group])) for group in by_world]
    known = [float(np.mean([s.lens_known for s in group])) for group in by_world]
    flared = [s for s, case in zip(scores, cases, strict=True) if case[0].halo and not s.refused]
    wanted = QUICK_CAMERA_RIGS if quick else CAMERA_RIGS
    draws = seeds("test", CAMERA_RIGS, seed)
    of_rigs, rig_notes = rig_figures(published_cameras(), draws, RIG_DIVISOR, wanted, kept.row)
    metrics = {
        "worlds": len(chosen),
        "scenes": len(scenes),
        "refused": len(scores) - len(done),
        "worst_cover95_pct": 100 * min(covers),
        "median_cover95_pct": 100 * float(np.median(covers)),
        "smooth_cover95_pct": 100 * float(np.mean([s.smooth for s in done])),
        "textured_cover95_pct": 100 * float(np.mean([s.textured for s in done])),
        **by_contrast(by_world),
        "lux_cover95_pct": 100 * float(np.mean([ok for s in scores for ok in (s.lux or [False])])),
        "lens_known_median_cover95_pct": 100 * float(np.median(known)),
        "lens_known_mean_cover95_pct": 100 * float(np.mean(known)),
        "worlds_better_than_opencv": sum(gain > 1 for gain in gains),
        "drawn_worlds_better_than_opencv": sum(gain > 1 for gain in drawn),
        "median_gain_over_opencv": float(np.median(gains)),
        "false_ghost_pct": 100 * float(np.mean([s.ghost for s in done if s.ghost is not None])),
        "median_err_stops": float(np.median([s.median for s in done])),
        "p95_err_stops": float(np.median([s.p95 for s in done])),
        "cover68_pct": 100 * float(np.mean([s.cover68 for s in done])),
        "decade_bias_stops": float(np.median([s.bias for s in done])),
        **_raw_metrics(raws),
        **({"drawn_err_stops": float(np.median([s.drawn_err for s in flared]))} if flared else {}),
        **({"halo_lamps_cover95_pct": 100 * _least(halos, "cover")} if halos else {}),
        **stray_light_figures(published_cameras(), scenes, number, kept.row),
        **two_lens_figures(published_cameras(), scenes, number, kept.row),
        **kept.row("spectra", lambda: spectral_figures(QUICK_RIGS if quick else RIGS, number)),
        **kept.row("odd and even", lambda: odd_even_figures(SMOOTH, TEXTURED)),
        **of_rigs,
        **kept.row("film", lambda: film_figures(published_cameras(), scenes[0], number)),
    }
    notes = [
        f"{world.name}: cover {100 * cover:.1f} %, gain {gain:.2f}, lux "
        f"{sum(sum(s.lux) for s in group)}/{sum(len(s.lux) for s in group)}"
        + "".join(f"; refused: {s.refused}" for s in group if s.refused)
        for world, cover, gain, group in zip(chosen, covers, gains, by_world, strict=True)
    ]
    rounded = {key: round(value, 4) for key, value in metrics.items()}
    return {"metrics": rounded, "notes": [*notes, *rig_notes]}


def _kept_score(row: Row, world: HostileWorld, scene: Floats, seed: int, **kind: bool) -> Score:
    """Return `scored`, of which a row is kept; a case's ``seed`` is its own."""
    key = " ".join([world.name, str(seed), str(scene.shape[1]), *kind])
    return Score(**row(key, lambda: asdict(scored(world, scene, seed, **kind))))


def published_cameras() -> Curves:
    """Return the published curves, three in a row a camera's."""
    _, irradiance, brightness = published_curves(DATA / "curves")
    rising = np.maximum.accumulate(brightness, axis=1)
    shown = (rising - rising[:, :1]) / (rising[:, -1:] - rising[:, :1])
    return irradiance, [shown[3 * k : 3 * k + 3] for k in range(len(shown) // 3)]


def _raw_metrics(raws: list[tuple[Score, Score]]) -> dict[str, float]:
    """Return the figures of raw files, and the JPEGs' error over theirs where both were merged."""
    done = [raw for _, raw in raws if not raw.refused] or [Score("none", lux=[False])]
    gains = [jpeg.median / raw.median for jpeg, raw in raws if not jpeg.refused and not raw.refused]
    return {
        "raw_refused": sum(bool(raw.refused) for _, raw in raws),
        "raw_gain_over_jpeg": float(np.median(gains)) if gains else 0.0,
        "raw_least_gain_over_jpeg": min(gains, default=0.0),
        "raw_worst_cover95_pct": 100 * min(s.cover for s in done),
        "raw_smooth_cover95_pct": 100 * float(np.mean([s.smooth for s in done])),
        "raw_textured_cover95_pct": 100 * float(np.mean([s.textured for s in done])),
        "raw_lux_cover95_pct": 100 * float(np.mean([ok for s in done for ok in s.lux])),
    }


def by_contrast(by_world: list[list[Score]]) -> dict[str, float]:
    """Return coverage of smooth and of textured places, per cent: of the worst world, and the worlds' median.

    A world counts with the brackets of it that were merged and have such places.
    """
    found = {}
    for kind in ("smooth", "textured"):
        values = [[getattr(s, kind) for s in group if not s.refused] for group in by_world]
        means = [np.nanmean(some) for some in values if np.isfinite(some).any()]
        found[f"{kind}_worst_cover95_pct"] = 100 * float(min(means))
        found[f"{kind}_median_cover95_pct"] = 100 * float(np.median(means))
    return found


def scene_of(name: str, size: tuple[int, int]) -> Floats:
    light = cv2.resize(read_equirect(DATA / name), size, interpolation=cv2.INTER_AREA)
    return np.asarray(light / np.percentile(luminance_cd_m2(light), WHITE_PERCENTILE) * 100, dtype=np.float32)


def _least(scores: list[Score], figure: str) -> float:
    """Return the least mean of a figure over worlds."""
    names = {score.name for score in scores}
    return min(float(np.mean([getattr(s, figure) for s in scores if s.name == name])) for name in names)


def scored(world: HostileWorld, scene: Floats, seed: int, *, raw: bool = False, lamps: bool = False) -> Score:
    """Return what becomes of a world's bracket of a scene (H, 2 H, 3); ``raw``: its DNGs; ``lamps``: with a kernel."""
    bracket = hostile_bracket(world, scene, 100 * WHITE_S, seed, raw=raw)
    truth = luminance_cd_m2(bracket.radiance).astype(np.float64)
    score = Score(world.name)
    spot = _spot(truth)
    reading = float(truth[spot].mean() * (1 + METER_SIGMA * np.random.default_rng((seed, 9)).standard_normal()))
    try:
        kernel = None
        if raw:
            merged = merged_raws(bracket)[0].image
        else:
            fit = recover_response([Bracket8(bracket.frames, bracket.nominal_s)], estimate_times=True)
            merged = _coded(bracket, fit)
            if lamps:
                steady = replace(world, jitter_stops=0.0)
                kernel = lamp_kernel(steady, Equirectangular(*truth.shape[::-1]), fit, seed)
        image = _measured(merged, spot, reading, kernel)
    except ProcessingError as error:
        score.refused = error.message[:160]
        return score
    shown = image.luminance_cd_m2().astype(np.float64)
    good = (image.validity == 0) & (truth > 0)
    exactly = float(truth[spot].mean()) / reading
    sigmas = np.abs(shown / np.maximum(truth, 1e-9) - 1) / np.hypot(image.uncertainty, image.scale_uncertainty)
    contrast = local_contrast(truth.astype(np.float32))
    score.cover, score.smooth, score.textured = (
        float(np.mean(sigmas[good & part] <= 1.96)) for part in (good, contrast < SMOOTH, contrast > TEXTURED)
    )
    score.cover68 = float(np.mean(sigmas[good] <= 1))
    score.lens_known = float(np.mean((sigmas * _over_lens_known(image, world))[good] <= 1.96))
    stops = np.log2(np.maximum(shown * exactly, 1e-9)[good] / truth[good])
    score.median, score.p95 = (float(np.quantile(np.abs(stops), share)) for share in (0.5, 0.95))
    score.bias = _decade_bias(stops, truth[good])
    if not raw and not lamps:
        rivals = [one * exactly for one in _rivals(bracket, spot, reading)]
        light = luminance_cd_m2(through_lens(bracket.radiance, world)).astype(np.float64)
        drawn = light * (truth[spot].mean() / light[spot].mean())
        score.rival, score.drawn_rival = (min(_median_stops(x, y, good) for x in rivals) for y in (truth, drawn))
        score.drawn, score.drawn_err = _median_stops(shown * exactly, drawn, good), _median_stops(drawn, truth, good)
    ones = np.ones_like(image.uncertainty)
    exact = LuminanceImage(bracket.radiance, ones * 1e-6, np.zeros_like(image.validity), image.geometry, 0.0)
    for plane in PLANES.values():
        found, true = illuminance_lx(image, plane), illuminance_lx(exact, plane).value_lx
        # A lower bound, said to be one as in the product's figures, is right below the truth.
        bound = light_figure(found)["bound"] == "lower" and true > found.value_lx
        score.lux.append(bound or abs(found.value_lx - true) <= 1.96 * found.uncertainty_lx)
    if not bracket.moving and world.camera.jpeg is not None and image.ghost is not None:
        score.ghost = float(np.count_nonzero(image.ghost)) / image.ghost.size
    return score


def _over_lens_known(image: LuminanceImage, world: HostileWorld) -> Doubles:
    """Return the stated uncertainty (H, W) over what it were if it were known which faults the world's lens has not."""
    level, own = image.luminance_cd_m2(), np.minimum(image.uncertainty, np.float32(1e6))
    stated2 = np.square(own, dtype=np.float64) + image.scale_uncertainty**2
    less2 = np.zeros_like(stated2)
    for mode in modes_of(image):
        if (mode.name.startswith("stray") and not world.halo) or (mode.kind == "seam" and not world.lenses):
            less2 += np.square(relative_error(mode, image, level))
    return np.asarray(np.sqrt(stated2 / np.maximum(stated2 - less2, 1e-12)))


def _coded(bracket: HostileBracket, fit: ResponseFit) -> RelativeImage:
    """Merge the pictures as the product does without a profile."""
    height, width = bracket.frames[0].shape[:2]
    return merged_pictures(bracket.frames, Equirectangular(width, height), fit, given_s=bracket.nominal_s)


def _measured(merged: RelativeImage, spot: Flags, reading: float, kernel: GlareKernel | None = None) -> LuminanceImage:
    """Return the picture as the product makes a session's indoor one; ``kernel``: the rig's, by lamps."""
    merged = merged if kernel is None else without_glare(merged, kernel)
    displayed = float(merged.luminance()[spot].mean(dtype=np.float64))
    picture = scaled(merged, ScaleFactor(reading / displayed, METER_SIGMA, measured=reading))
    row, column = (np.flatnonzero(spot.any(axis=axis)).mean() + 0.5 for axis in (1, 0))
    place = (column / spot.shape[1] * 2 * np.pi - np.pi, np.pi / 2 - row / spot.shape[0] * np.pi)
    known = (reading, *place)
    stray = unmeasured_modes(picture, known) if kernel is None else kernel_modes(picture, kernel, known)
    return widened(picture, [*stray, seam_mode(place[0])])


def _spot(truth: Doubles) -> Flags:
    """Return five by five pixels that are even and of middle brightness."""
    contrast = cv2.blur(local_contrast(truth.astype(np.float32)), (SPOT_PX, SPOT_PX))
    middle = np.abs(np.log(cv2.blur(truth, (SPOT_PX, SPOT_PX)) / np.median(truth))) < 0.7
    margin = np.zeros_like(middle)
    margin[20:-20, 20:-20] = True
    row, column = np.unravel_index(np.argmin(np.where(middle & margin, contrast, np.inf)), truth.shape)
    found = np.zeros(truth.shape, bool)
    found[row - SPOT_PX // 2 : row + SPOT_PX // 2 + 1, column - SPOT_PX // 2 : column + SPOT_PX // 2 + 1] = True
    return found


def _decade_bias(stops: Doubles, truth: Doubles) -> float:
    """Return the largest median error of a decade of luminance, free of the whole picture's.

    Decades that hold less than a hundredth of the pixels are left out.
    """
    decade, free = np.floor(np.log10(truth)), stops - np.median(stops)
    parts = [free[decade == one] for one in np.unique(decade)]
    return max(abs(float(np.median(part))) for part in parts if 100 * part.size >= stops.size)


def _median_stops(shown: npt.NDArray[np.floating], truth: Doubles, good: Flags) -> float:
    return float(np.median(np.abs(np.log2(np.maximum(shown[good], 1e-9) / truth[good]))))


def _rivals(bracket: HostileBracket, spot: Flags, reading: float) -> list[Doubles]:
    times = np.array(bracket.nominal_s, dtype=np.float32)
    frames = list(bracket.frames)
    small = [np.ascontiguousarray(frame[::4, ::4]) for frame in frames]
    found = []
    for calibrate, way in (
        (cv2.createCalibrateDebevec(70, 10.0), cv2.createMergeDebevec()),
        (cv2.createCalibrateRobertson(), cv2.createMergeRobertson()),
    ):
        light = luminance_cd_m2(np.nan_to_num(way.process(frames, times, calibrate.process(small, times))))
        found.append(np.asarray(light * (reading / max(float(light[spot].mean()), 1e-12)), dtype=np.float64))
    return found
