"""A network for ordinary pictures, used on the whole sphere: views out, classes back (Ji et al. 2023, eq. 3, fig. 3).

First a few wide views show where floor and furniture are; only there, finer views follow. What comes back is class
probabilities, each view weighted by the distance to its border and by the solid angle of its pixels (stretched corners
count less). Class numbers are never interpolated: they have become probabilities before.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from processing.errors import ParameterError
from processing.ground.arrays import Bytes, Floats
from processing.ground.seam import resized
from processing.pictures.images import LuminanceImage, RelativeImage
from processing.pictures.preview import preview_rgb8
from processing.segmentation.evidence import SceneClass, SceneEvidence
from processing.segmentation.segmenters import Segmenter
from processing.sphere import Equirectangular, Perspective
from processing.sphere.resampling import resample
from processing.sphere.views import Panorama, cut_view, stitch_views, view_at, view_ring

COARSE_FOV_RAD = math.radians(110)
COARSE_WORTH = 0.02  # of a wide view beside a fine one of the same place
EVIDENT = 0.3  # probability from which floor or furniture is evidence
LEAST_SHARE = 0.02  # of a view's pixels that must show such evidence
FUSED_ROWS = 256  # 0.7 degrees a pixel, as networks for ordinary pictures resolve views of 90 degrees
KNOWN = 0.5  # probability of the likeliest class from which a place counts as known


@dataclass(frozen=True)
class ViewPlan:
    """Which views are cut, in rings of square ones around the vertical."""

    fov_rad: float = math.radians(90)
    rings: tuple[tuple[int, float], ...] = ((8, 0.0), (6, math.radians(-35)), (4, math.radians(60)), (1, -math.pi / 2))
    """Count and latitude of each ring."""
    size_px: int | None = None
    """None, and of networks of one size only: as the network likes best."""
    skip: bool = True
    """Whether views without floor or furniture are left to the first, coarse pass."""


def segment_around(
    image: LuminanceImage | RelativeImage | Bytes,
    segmenter: Segmenter,
    *,
    plan: ViewPlan = ViewPlan(),
    first: SceneEvidence | None = None,
    rows: int = 512,
) -> SceneEvidence:
    """Return evidence (rows, 2 rows) of an upright panorama from a network for perspective pictures.

    ``image``: equirectangular, upright; linear light, or sRGB uint8 (H, W, 3).
    ``first``: evidence that is known already and takes the place of the coarse pass.
    Raises `ParameterError`: a picture that is no whole panorama; `SegmenterError`: what the network cannot do.
    """
    panorama = Panorama(_srgb(image))
    size_px = segmenter.size_px if plan.size_px is None or segmenter.fixed_size else plan.size_px
    target = Equirectangular(2 * rows, rows)
    views = [
        view
        for count, pitch_rad in plan.rings
        for view in view_ring(count, size_px=size_px, fov_rad=plan.fov_rad, pitch_rad=pitch_rad)
    ]
    segmented: list[tuple[Perspective, Floats, float]] = []
    coarse = first.probabilities if first else None
    # To a network of one size wide views cost as much as fine ones, as many as they could save.
    if plan.skip and first is None and not segmenter.fixed_size:
        half_px = max(size_px // 2, 64)
        ends = [
            view_at(fov_rad=COARSE_FOV_RAD, theta_rad=0.0, phi_rad=phi, height_px=half_px, width_px=half_px)
            for phi in (math.pi / 2, -math.pi / 2)
        ]
        wide_views = [*view_ring(4, size_px=half_px, fov_rad=COARSE_FOV_RAD), *ends]
        segmented = [(v, segmenter.probabilities(cut_view(panorama, v)), COARSE_WORTH) for v in wide_views]
        coarse = _stitched(segmented, target, None)
    chosen = [v for v in views if coarse is None or _worth_a_look(coarse, v)] if plan.skip else views
    segmented += [(view, segmenter.probabilities(cut_view(panorama, view)), 1.0) for view in chosen]
    skipped = len(views) - len(chosen)
    rest = first.source if first else f"{len(segmented) - len(chosen)} wide views"
    note = f"{skipped} of {len(views)} views show neither floor nor furniture and were covered by {rest}"
    return SceneEvidence(
        probabilities=np.ascontiguousarray(_stitched(segmented, target, first)),
        source=segmenter.name,
        boundary=first.boundary if first else None,
        views_used=len(segmented),
        views_skipped=skipped,
        notes=(note,) if skipped else (),
        reach=first.reach if first else None,
        skirting=first.skirting if first else None,
        own=first.probabilities if first else None,
    )


FUSED_VIEWS = ViewPlan(rings=((8, 0.0), (6, math.radians(-35))), skip=False)
"""Where furniture and windows are: what lies above and straight below is left to our own network, which sees it whole.

Five real rooms with hand masks: furniture IoU 0.73 by the other network alone, 0.76 fused, 0.58 ours.
"""


def fused(own: SceneEvidence, image: LuminanceImage | RelativeImage | Bytes, segmenter: Segmenter) -> SceneEvidence:
    """Return the mean of our evidence and of another network's through views, of shape (8, 256, 512); boundaries: ours.

    Two networks that were trained on other pictures fail on other things. Raises what `segment_around` does.
    """
    other = segment_around(image, segmenter, plan=FUSED_VIEWS, first=own, rows=FUSED_ROWS)
    shape = (other.probabilities.shape[1], other.probabilities.shape[2])
    ours = resized(np.ascontiguousarray(own.probabilities.transpose(1, 2, 0)), shape).transpose(2, 0, 1)
    return replace(
        other,
        probabilities=np.ascontiguousarray((ours + other.probabilities) / 2, dtype=np.float32),
        source=f"{own.source}, fused with {other.source}",
        views_used=own.views_used + other.views_used,
        notes=(*own.notes, *other.notes),
        networks=2,
    )


def _srgb(image: LuminanceImage | RelativeImage | Bytes) -> Bytes:
    if isinstance(image, np.ndarray):
        if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3:
            raise ParameterError(f"a picture {image.dtype} {image.shape}", advice="give uint8 (H, W, 3)")
        return image
    if not isinstance(image.geometry, Equirectangular):
        raise ParameterError("views are cut from whole panoramas", advice="give an equirectangular picture")
    return preview_rgb8(image.rgb)


def _worth_a_look(coarse: Floats, view: Perspective) -> bool:
    """Return whether a view may show floor or furniture, as far as coarse probabilities (8, H, W) show."""
    small = view_at(fov_rad=view.fov_x_rad, theta_rad=view.yaw_rad, phi_rad=view.pitch_rad, height_px=32, width_px=32)
    seen = cut_view(np.ascontiguousarray(coarse.transpose(1, 2, 0)), small)
    shown = np.maximum(seen[..., SceneClass.FLOOR], seen[..., SceneClass.FURNITURE]) >= EVIDENT
    # A network that knows no floor leaves it open; below the horizon one must look.
    open_below = (seen.max(axis=2) < KNOWN) & (view.pitch_rad < 0)
    return bool((shown | open_below).mean() >= LEAST_SHARE)


def _stitched(
    segmented: Sequence[tuple[Perspective, Floats, float]], target: Equirectangular, first: SceneEvidence | None
) -> Floats:
    """Return (8, H, W); where no view sees, what was known first, else uniform."""
    rest = np.full((target.height_px, target.width_px, len(SceneClass)), 1 / len(SceneClass), dtype=np.float32)
    if first is not None:
        known = np.ascontiguousarray(first.probabilities.transpose(1, 2, 0))
        rest, _ = resample(known, Equirectangular(known.shape[1], known.shape[0]), target, method="bilinear")
    if segmented:
        # Each view with the network's output as its picture.
        views = [replace(view, width_px=found.shape[1], height_px=found.shape[0]) for view, found, _ in segmented]
        weights = [worth * _solid_angle_share(view) for view, (_, _, worth) in zip(views, segmented, strict=True)]
        mixed, coverage = stitch_views([found for _, found, _ in segmented], views, target, weights=weights)
        rest = np.where(coverage[..., None] > 0, mixed, rest)
    rest /= np.maximum(rest.sum(axis=2, keepdims=True), 1e-6)
    return np.asarray(rest.transpose(2, 0, 1), dtype=np.float32)


def _solid_angle_share(view: Perspective) -> Floats:
    """Return each pixel's solid angle over that of the middle one: cos^3 of the angle from the axis."""
    x = (np.arange(view.width_px) + 0.5 - view.width_px / 2) / view.focal_px
    y = (np.arange(view.height_px) + 0.5 - view.height_px / 2) / view.focal_px
    return np.asarray((1 + x[None, :] ** 2 + y[:, None] ** 2) ** -1.5, dtype=np.float32)
