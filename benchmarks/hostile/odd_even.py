"""Real brackets cut in two: odd frames merged beside even ones, whose difference should be as large as both state.

Curve, noise and times are of the whole bracket, as a camera's profile has them, so that errors of the curve are in both
halves and count for little: it is the independent part of the uncertainty that is judged. Dark surrounds, of which
neither half states more than that it is dark, are left out.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from PIL import Image

from benchmarks.hostile.merging import merged_pictures
from benchmarks.shared_data import DATA
from processing.calibration.merge.modes import local_contrast
from processing.calibration.response.response import recover_response
from processing.calibration.response.samples import Bracket8
from processing.ground.arrays import Bytes
from processing.sphere import Equirectangular

BRACKETS = {
    "canon": ("canon5d2_8mm_bracket", (13, 3.2, 0.8, 1 / 5, 1 / 20, 1 / 80, 1 / 320, 1 / 1250, 1 / 5000)),
    "room": ("room_t2i", (2, 1 / 2, 1 / 8, 1 / 30, 1 / 125, 1 / 1000, 1 / 4000)),
}
"""Folders of ../shared/data/brackets, and the times (s) that their files state, longest first."""
LEAST_PX = 1200  # of a frame's width, which is reduced by a whole factor
KNOWN = 0.1  # relative uncertainty of both halves, up to which a pixel is judged


def odd_even_figures(smooth: float, textured: float) -> dict[str, float]:
    """Return how often both halves of each bracket agree within 95 %, all and by local contrast (log luminance)."""
    found: dict[str, float] = {}
    for name, (folder, times_s) in BRACKETS.items():
        frames = _frames(folder)
        fit = recover_response([Bracket8(frames, times_s)], estimate_times=True)
        geometry = Equirectangular(frames[0].shape[1], frames[0].shape[0])
        halves = (replace(fit, times_s=fit.times_s[k::2], time_sigma=fit.time_sigma[k::2]) for k in (0, 1))
        odd, even = (merged_pictures(frames[k::2], geometry, half) for k, half in enumerate(halves))
        good = (odd.validity == 0) & (even.validity == 0) & (np.maximum(odd.uncertainty, even.uncertainty) < KNOWN)
        apart = np.abs(np.log(odd.luminance()[good] / even.luminance()[good]))
        within = apart < 1.96 * np.hypot(odd.uncertainty, even.uncertainty)[good]
        contrast = local_contrast(even.luminance().astype(np.float32))[good]
        for kind, part in (("", good[good]), ("_smooth", contrast < smooth), ("_textured", contrast > textured)):
            found[f"odd_even_{name}{kind}_cover95_pct"] = 100 * float(within[part].mean())
    return found


def _frames(folder: str) -> list[Bytes]:
    """Return a bracket's frames (H, 2 H, 3), the brightest first."""
    frames = []
    for path in sorted((DATA / "brackets" / folder).glob("*.[jJ][pP][gG]")):
        with Image.open(path) as picture:
            frame = np.asarray(picture.convert("RGB").reduce(max(1, picture.width // LEAST_PX)))
        wide = min(frame.shape[1], 2 * frame.shape[0]) // 2 * 2
        frames.append(np.ascontiguousarray(frame[: wide // 2, :wide]))
    return sorted(frames, key=lambda frame: -float(frame.mean()))
