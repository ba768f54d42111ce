"""Views of a panorama against py360convert and against bare `cv2.remap`: time, and error of the way there and back.

The truth is a sum of waves sin(k . direction + phase) with |k| up to a bound, which is band-limited on the sphere and
known exactly in every direction.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import count

import cv2
import numpy as np
import py360convert

from benchmarks.paired import Comparison, compare
from benchmarks.photometry.sphere_light import cube_views
from processing.sphere import Equirectangular, Geometry, Perspective, directions, pixels
from processing.sphere.views import covering_views, cut_view, stitch_views, view_at

PANORAMA = Equirectangular(6720, 3360)
VIEW_PX, FOV_DEG = 1024, 90
LOOKS_DEG = ((0, 0), (180, 10), (-100, -35), (45, 60))
"""Longitude and latitude; the second looks across the seam, the last at a pole."""
WAVES, BAND = 24, 40.0
NEW_DEG = 0.37
"""Turned by so much, a view is one whose map nobody has."""


@dataclass(frozen=True)
class Speed:
    """What views cost, ours over the rival's; maps are there already but in ``first_views``."""

    py360convert: Comparison
    remap: Comparison
    """Bare remap with float32 maps, as one would write it."""
    remap_fixed: Comparison
    """Bare remap with fixed-point maps."""
    remap_float: Comparison
    """The same panorama in float32."""
    first_views: Comparison
    """Against py360convert on views that neither has seen: both make their maps."""


def waves(geometry: Geometry, seed: int, band: float = BAND) -> np.ndarray:
    """Return the band-limited truth at pixel centres, float64 (H, W), standard deviation about 1."""
    rng = np.random.default_rng([seed, 9])
    k = rng.normal(size=(WAVES, 3))
    k *= (band * rng.uniform(0.1, 1, WAVES) / np.linalg.norm(k, axis=1))[:, None]
    phase = rng.uniform(0, 2 * math.pi, WAVES)
    d, _ = directions(geometry)
    total = np.zeros(d.shape[:2])
    for wave, start in zip(k, phase, strict=True):
        total += np.sin(d @ wave + start)
    return total * math.sqrt(2 / WAVES)


def look(theta_deg: float, phi_deg: float) -> Perspective:
    """Return the view that is timed."""
    return view_at(
        fov_rad=math.radians(FOV_DEG),
        theta_rad=math.radians(theta_deg),
        phi_rad=math.radians(phi_deg),
        height_px=VIEW_PX,
        width_px=VIEW_PX,
    )


def speed(*, pairs: int, repeats: int) -> Speed:
    """Cut four views of 1024 x 1024 out of 6720 x 3360, in turn with rivals, ``repeats`` times (not py360convert)."""
    picture = np.random.default_rng(0).integers(0, 256, (PANORAMA.height_px, PANORAMA.width_px, 3), dtype=np.uint8)
    light = picture.astype(np.float32)
    maps = [_plain_maps(PANORAMA, look(*at)) for at in LOOKS_DEG]
    fixed = [cv2.convertMaps(*m, cv2.CV_16SC2) for m in maps]
    mine, theirs = count(1), count(1)
    few = max(3, pairs // 2)
    return Speed(
        py360convert=compare(lambda: _ours(picture, repeats), lambda: _py360_views(picture), pairs=few),
        remap=compare(lambda: _ours(picture, repeats), lambda: _bare(picture, maps, repeats), pairs=pairs),
        remap_fixed=compare(lambda: _ours(picture, repeats), lambda: _bare(picture, fixed, repeats), pairs=pairs),
        remap_float=compare(lambda: _ours(light, repeats), lambda: _bare(light, maps, repeats), pairs=pairs),
        first_views=compare(
            lambda: _ours(picture, 1, NEW_DEG * next(mine)),
            lambda: _py360_views(picture, NEW_DEG * next(theirs)),
            pairs=few,
        ),
    )


def _ours(picture: np.ndarray, repeats: int, turn_deg: float = 0.0) -> None:
    for _ in range(repeats):
        for theta, phi in LOOKS_DEG:
            cut_view(picture, look(theta + turn_deg, phi))


def _bare(picture: np.ndarray, maps: list, repeats: int) -> None:
    for _ in range(repeats):
        for one in maps:
            cv2.remap(picture, *one, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)


def _py360_views(picture: np.ndarray, turn_deg: float = 0.0) -> None:
    for theta, phi in LOOKS_DEG:
        py360convert.e2p(picture, FOV_DEG, theta + turn_deg, phi, (VIEW_PX, VIEW_PX))


def _plain_maps(panorama: Equirectangular, view: Perspective) -> tuple[np.ndarray, np.ndarray]:
    x, y, _ = pixels(panorama, directions(view)[0])
    return (x - 0.5).astype(np.float32), (y - 0.5).astype(np.float32)


def round_trips(width_px: int, face_px: int, seed: int) -> dict[str, float]:
    """Return the rms error of panorama to six faces and back, over the picture's own rms, by method."""
    panorama = Equirectangular(width_px, width_px // 2)
    truth = waves(panorama, seed)
    picture = truth.astype(np.float32)
    found = {
        "ours, linear": _there_and_back(picture, panorama, cube_views(face_px)),
        "py360convert, bilinear": _py360(picture, face_px, "bilinear"),
        "py360convert, bicubic": _py360(picture, face_px, "bicubic"),
        "plain cv2.remap": _plain_round_trip(picture, panorama, face_px),
    }
    return {name: float(np.sqrt(np.mean((back - truth) ** 2) / np.mean(truth**2))) for name, back in found.items()}


def overlapping_round_trip(width_px: int, size_px: int, seed: int) -> float:
    """Return the same of 14 overlapping views."""
    panorama = Equirectangular(width_px, width_px // 2)
    truth = waves(panorama, seed)
    views = covering_views(size_px=size_px, fov_rad=math.radians(90))
    back = _there_and_back(truth.astype(np.float32), panorama, views)
    return float(np.sqrt(np.mean((back - truth) ** 2) / np.mean(truth**2)))


def _there_and_back(picture: np.ndarray, panorama: Equirectangular, views: tuple[Perspective, ...]) -> np.ndarray:
    return stitch_views([cut_view(picture, view) for view in views], views, panorama)[0]


def _py360(picture: np.ndarray, face_px: int, mode: str) -> np.ndarray:
    faces = py360convert.e2c(picture, face_px, mode=mode, cube_format="dice")
    return py360convert.c2e(faces, *picture.shape[:2], mode=mode, cube_format="dice")


def _plain_round_trip(picture: np.ndarray, panorama: Equirectangular, face_px: int) -> np.ndarray:
    """Do what one would write first: linear remap, border pixels repeated, each pixel from the face it lies on."""
    out = np.zeros_like(picture)
    d, _ = directions(panorama)
    for view in cube_views(face_px):
        face = cv2.remap(picture, *_plain_maps(panorama, view), cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        x, y, seen = pixels(view, d)
        place = (x - 0.5).astype(np.float32), (y - 0.5).astype(np.float32)
        back = cv2.remap(face, *place, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        out[seen] = back[seen]
    return out
