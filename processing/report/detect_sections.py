"""Section of the report on what was found in the panorama to be removed."""

from __future__ import annotations

from processing.ground.arrays import Bytes, Flags

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from processing.images import LuminanceImage
from processing.picture_preview import jpeg_bytes, preview_rgb8
from processing.report.data import Picture, Quantity, Section, Table


WIDTH_PX = 1200
TINTS = {
    "furniture": (230, 40, 40),
    "tripod": (220, 0, 220),
    "sunlight": (250, 210, 0),
    "shadow": (40, 90, 240),
}
"""sRGB by mask."""
_NAMES = {
    "furniture": "furniture (red)",
    "tripod": "tripod and equipment (magenta)",
    "sunlight": "direct sunlight (yellow)",
    "shadow": "shadows of furniture (blue)",
    "target": "to be removed, with margin (green line)",
}


def detect_section(image: LuminanceImage, masks: Mapping[str, Flags], facts: Mapping[str, Any]) -> Section:
    """Return the panorama with tinted masks, how much of the sphere each covers, and what was skipped.

    ``masks``: by name, (H, W) each, those that were found; ``facts``: the stage's metrics.
    """
    fitting = {name: mask for name, mask in masks.items() if mask.shape == image.rgb.shape[:2]}
    step = max(1, -(-image.rgb.shape[1] // WIDTH_PX))
    rows = slice(step // 2, None, step)
    shown = tinted(preview_rgb8(image.rgb[rows, rows]), {name: mask[rows, rows] for name, mask in fitting.items()})
    shares = facts.get("shares", {})
    quantities = [
        Quantity(text[0].upper() + text[1:], 100 * shares[name], "% of all directions")
        for name, text in _NAMES.items()
        if name in shares
    ]
    tables = []
    if notes := facts.get("notes"):
        tables.append(Table("What was skipped, dropped or not found", ("note",), tuple((note,) for note in notes)))
    if "evidence" not in facts:
        text = "Given by the user."
    else:
        text = f"Evidence: {facts['evidence']}"
        text += f"; {facts['views_skipped']} views skipped." if facts["views_skipped"] else "."
    picture = Picture("What is to be removed", jpeg_bytes(shown), "panorama with tinted masks", wide=True)
    return Section("Detection", text, tuple(quantities), (picture,), tuple(tables))


def tinted(rgb8: Bytes, masks: Mapping[str, Flags]) -> Bytes:
    """Return a picture with masks in their colours, and a green line around the target."""
    out = rgb8.astype(np.float32)
    for name, colour in TINTS.items():
        if name in masks:
            out[masks[name]] = 0.5 * out[masks[name]] + 0.5 * np.array(colour, np.float32)
    if "target" in masks:
        target = masks["target"]
        inner = target & np.roll(target, 1, 1) & np.roll(target, -1, 1)
        inner[1:] &= target[:-1]
        inner[:-1] &= target[1:]
        out[target & ~inner] = (0, 220, 60)
    return np.asarray(np.clip(out, 0, 255), dtype=np.uint8)
