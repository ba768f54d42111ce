"""What screens show of a session's pictures, kept while nothing that they are shown by changes."""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image

from processing.pictures.exr import write_stage_exr
from processing.pictures.patch import write_patch
from processing.running.screens import picture_jpeg
from tests.processing.pictures.picture_strategies import luminance_image


def test_a_picture_is_made_again_where_the_sun_in_it_is_known_since(tmp_path: Path) -> None:
    """The emptied room was looked at before its materials were estimated: its own file stays as it is."""
    before = luminance_image(np.full((32, 64, 3), 0.125, np.float32))
    for stage in ("remove", "materials"):
        (tmp_path / "stages" / stage).mkdir(parents=True)
    write_stage_exr(tmp_path / "stages" / "remove" / "empty.exr", before)

    def middle() -> int:
        return int(np.asarray(Image.open(io.BytesIO(picture_jpeg(tmp_path, "Emptied", 64))))[16, 32, 0])

    dim = middle()
    assert middle() == dim
    sunny = replace(before, rgb=before.rgb * np.float32(4))
    write_patch(tmp_path / "stages" / "materials" / "sun.npz", sunny, before)
    assert middle() > dim + 30
