"""A picture as the pixels in which it differs from another."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from processing.errors import PictureFileError
from processing.pictures.exr import write_stage_exr
from processing.pictures.patch import patched, read_shown, write_patch
from tests.processing.pictures.picture_strategies import luminance_image


def test_a_patch_gives_the_picture_again_and_no_patch_the_one_before(tmp_path: Path) -> None:
    before = luminance_image(np.full((8, 16, 3), 40.0, np.float32))
    rgb, doubt, validity = before.rgb.copy(), before.uncertainty.copy(), before.validity.copy()
    rgb[2, 3:7], doubt[2, 3:7], validity[2, 4] = (900.0, 800.0, 700.0), 0.3, 1
    image = replace(before, rgb=rgb, uncertainty=doubt, validity=validity)
    write_patch(tmp_path / "sun.npz", image, before)
    found = patched(before, tmp_path / "sun.npz")
    for name in ("rgb", "uncertainty", "validity"):
        np.testing.assert_array_equal(getattr(found, name), getattr(image, name))
    assert (before.rgb == 40).all(), "the one before is not touched"
    assert patched(before, None) is before
    for write in (True, False):
        mine = replace(before, rgb=before.rgb.copy(), uncertainty=doubt.copy(), validity=validity.copy())
        mine.rgb.setflags(write=write)
        found = patched(mine, tmp_path / "sun.npz", own=True)
        np.testing.assert_array_equal(found.rgb, image.rgb)
        assert (found.rgb is mine.rgb) == write
    other = replace(before, rgb=before.rgb + 1)
    assert patched(other, tmp_path / "sun.npz") is other, "removal has run since"
    (tmp_path / "torn.npz").write_bytes((tmp_path / "sun.npz").read_bytes()[:100])
    with pytest.raises(PictureFileError, match="not a patch"):
        patched(before, tmp_path / "torn.npz")
    small = luminance_image(np.full((4, 8, 3), 40.0, np.float32))
    assert patched(small, tmp_path / "sun.npz") is small
    large = luminance_image(np.full((80, 160, 3), 40.0, np.float32))
    assert patched(large, tmp_path / "sun.npz") is large


def test_an_emptied_room_is_read_with_its_sun_and_others_as_they_are(tmp_path: Path) -> None:
    before = luminance_image(np.full((8, 16, 3), 40.0, np.float32))
    sunny = replace(before, rgb=before.rgb * np.float32(2))
    for stage in ("remove", "render", "materials"):
        (tmp_path / stage).mkdir()
    write_stage_exr(tmp_path / "remove" / "empty.exr", before)
    write_stage_exr(tmp_path / "render" / "staged-1.exr", before)
    assert (read_shown(tmp_path / "remove" / "empty.exr").rgb == 40).all(), "no sun is known"
    write_patch(tmp_path / "materials" / "sun.npz", sunny, before)
    assert (read_shown(tmp_path / "remove" / "empty.exr").rgb == 80).all()
    assert (read_shown(tmp_path / "render" / "staged-1.exr").rgb == 40).all()
