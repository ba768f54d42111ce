"""Learned fillers of the user's own, on the planes' rectified textures, where ours are unsure.

The contract is that of the LaMa exports: inputs ``image`` (1, 3, H, W), sRGB 0..1, and ``mask`` (1, 1, H, W), 1 in the
hole; one output (1, 3, H, W) in 0..1 or 0..255, which is found out on loading. H and W are fixed, or multiples of 8.
No network is shipped.
"""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from processing.errors import FillerError
from processing.ground.arrays import Flags, Floats
from processing.ground.colour import srgb_decoded, srgb_encoded
from processing.pictures.images import luminance_cd_m2
from processing.removal.near_periodic_fill import window_around
from processing.removal.plane_fill import FilledPlane
from processing.segmentation.segmenters import open_session

SIZE_PX = 512  # of the longer side, where the network takes any
WHITE = 4.0  # times the median luminance: what the network is shown as white
SURE, UNSURE = 0.65, 0.25  # confidence above which our filling stays, and below which the network's takes its place
LEARNED_CONFIDENCE = 0.5  # of what a user's network fills; chosen, never swept
INVENTED = 0.1  # share of the network's picture from which a texel is no continuation of what is seen
CONTEXT = 0.35  # of the root of the hole's area that the network sees around it
THREADS = 2  # chosen, never swept


class LamaFiller:
    """A LaMa export as ONNX; checked on a grey picture when it is opened."""

    def __init__(self, path: Path, *, bgr: bool = False, threads: int = THREADS) -> None:
        """Load and check; `FillerError` says what does not fit. ``bgr``: the export's channel order."""
        self.path, self.bgr = path, bgr

        def refused(what: str) -> FillerError:
            return FillerError(f"the filling network {what}", where=str(path), advice="give a LaMa export, ONNX")

        self._session = open_session(path, refused, threads=threads)
        inputs = {one.name: one.shape for one in self._session.get_inputs()}
        if set(inputs) != {"image", "mask"} or any(len(shape) != 4 for shape in inputs.values()):
            raise self._misfit(f"its inputs are {inputs}")
        # Height and width that the network takes; 0: any multiple of 8.
        self._size_px = [n if isinstance(n, int) else 0 for n in inputs["image"][2:]]
        self._range = 1.0
        grey = np.full((*(n or 64 for n in self._size_px), 3), 0.5, np.float32)
        mean = float(self._run(grey, np.zeros(grey.shape[:2], bool)).mean())
        if not (0.2 < mean < 0.8 or 50 < mean < 205):
            raise self._misfit(f"a grey picture without a hole comes back with a mean of {mean:.3g}")
        self._range = 1.0 if mean < 1 else 255.0

    def _misfit(self, what: str) -> FillerError:
        text = f"{self.path.name} does not follow the LaMa contract: {what}"
        return FillerError(text, advice="inputs image (1,3,H,W) and mask (1,1,H,W), one output (1,3,H,W)")

    def _run(self, srgb: Floats, hole: Flags) -> Floats:
        """Return (H, W, 3) sRGB 0..1 for sRGB 0..1 of a size that the network takes."""
        picture = srgb[..., ::-1] if self.bgr else srgb
        feed: dict[str, Any] = {
            "image": np.ascontiguousarray(picture.transpose(2, 0, 1)[None], np.float32),
            "mask": hole[None, None].astype(np.float32),
        }
        try:
            found = np.asarray(self._session.run(None, feed)[0], np.float32)
        except Exception as exc:
            raise self._misfit(f"it failed on a picture of {srgb.shape}: {exc}") from exc
        if found.shape != (1, 3, *srgb.shape[:2]) or not np.isfinite(found).all():
            raise self._misfit(f"its output has the shape {found.shape}, or is not finite")
        out = found[0].transpose(1, 2, 0) / self._range
        return np.asarray(out[..., ::-1] if self.bgr else out, np.float32)

    def __call__(self, filled: FilledPlane) -> FilledPlane:
        """Return the plane with the network's filling where ours is unsure."""
        weight = np.clip((SURE - filled.confidence) / (SURE - UNSURE), 0, 1) * filled.hole
        if not (weight > 0.01).any():
            return filled
        window = window_around(filled.hole, 8 + round(CONTEXT * math.sqrt(filled.hole.sum())))
        light, hole = filled.values[window], filled.hole[window]
        seen = filled.texture.known[window]
        among = seen if seen.any() else np.ones_like(seen)
        white = max(WHITE * float(np.median(luminance_cd_m2(light[among]))), 1e-6)
        theirs = white * srgb_decoded(self._fitted(srgb_encoded(np.clip(light / white, 0, 1)), hole | ~(seen | hole)))
        share = cv2.GaussianBlur(weight[window].astype(np.float32), (0, 0), 2.0)[..., None] * hole[..., None]
        # In the logarithm, so that bright places do not win.
        toe = np.float32(0.01 * white)
        mixed = np.exp((1 - share) * np.log(light + toe) + share * np.log(np.maximum(theirs, 0) + toe)) - toe
        values, confidence = filled.values.copy(), filled.confidence.copy()
        values[window] = np.where(hole[..., None], np.maximum(mixed, 0), light)
        ours = confidence[window]
        confidence[window] = np.where(hole, np.maximum(ours, LEARNED_CONFIDENCE * share[..., 0]), ours)
        continued = filled.continued.copy()
        continued[window] &= share[..., 0] < INVENTED
        how = f"{filled.how}; {self.path.stem} where unsure"
        return replace(filled, values=values, confidence=confidence, continued=continued, how=how)

    def _fitted(self, srgb: Floats, hole: Flags) -> Floats:
        """Return the network's picture at the given size."""
        height, width = hole.shape
        scale = min(1.0, SIZE_PX / max(height, width))
        sides = [own or max(8, round(n * scale / 8) * 8) for own, n in zip(self._size_px, hole.shape, strict=True)]
        size = sides[1], sides[0]
        small = np.asarray(cv2.resize(srgb, size, interpolation=cv2.INTER_AREA), np.float32)
        mask = cv2.resize(hole.astype(np.float32), size, interpolation=cv2.INTER_AREA) > 0
        found = np.clip(self._run(small, mask), 0, 1)
        return np.asarray(cv2.resize(found, (width, height), interpolation=cv2.INTER_LINEAR), np.float32)
