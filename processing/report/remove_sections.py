"""Section of the report on the emptied room: before and after, and how sure the filling is."""

from __future__ import annotations

from processing.ground.arrays import Flags

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from processing.images import LuminanceImage
from processing.picture_preview import jpeg_bytes, preview_rgb8
from processing.report.data import Picture, Quantity, Section, Table


WIDTH_PX = 1200


def remove_section(before: LuminanceImage, after: LuminanceImage, filled: Flags, facts: Mapping[str, Any]) -> Section:
    """Return the emptied panorama with what was filled and how, in the exposure of the one before.

    ``filled``: (H, W); ``facts``: the stage's metrics.
    """
    step = max(1, -(-after.rgb.shape[1] // WIDTH_PX))
    rows = slice(step // 2, None, step)
    # One picture, so that both get the same exposure.
    both = preview_rgb8(np.concatenate([before.rgb[rows, rows], after.rgb[rows, rows]]))
    outlined = np.split(both, 2)[1].copy()
    mask = filled[rows, rows]
    inner = mask & np.roll(mask, 1, 1) & np.roll(mask, -1, 1)
    inner[1:] &= mask[:-1]
    inner[:-1] &= mask[1:]
    outlined[mask & ~inner] = (0, 220, 60)
    pictures = (Picture("What was filled", jpeg_bytes(outlined), "filled parts outlined in green", wide=True),)
    quantities = (
        Quantity("Filled", 100 * float(facts.get("filled_share", filled.mean())), "% of the picture"),
        Quantity("of it made up", 100 * float(facts.get("synthesised_share", 0.0)), "% of the picture"),
        Quantity("Mean confidence of the filling", float(facts.get("mean_confidence", 0.0)), ""),
    )
    notes = facts.get("notes", [])
    tables = (Table("Surfaces", ("how it was filled",), tuple((note,) for note in notes)),) if notes else ()
    return Section("Emptied room", "Pixels outside the outlines are the captured ones.", quantities, pictures, tables)
