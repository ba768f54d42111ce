"""Masks as PNG: there and back, from drawing programs, and what is no mask."""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from processing.errors import PictureFileError
from processing.exchange.inspection import open_picture
from processing.pictures.preview import read_mask, write_mask
from processing.pipeline import Artifact
from processing.running.artifacts import Shelf, load, save


def mask() -> np.ndarray:  # type: ignore[type-arg]
    return np.random.default_rng(0).random((9, 17)) > 0.5


def test_there_and_back_in_eight_bits(tmp_path: Path) -> None:
    write_mask(tmp_path / "m.png", mask())
    np.testing.assert_array_equal(read_mask(tmp_path / "m.png"), mask())
    with Image.open(tmp_path / "m.png") as file:
        assert (file.mode, file.getextrema()) == ("L", (0, 255))


@pytest.mark.parametrize("mode", ["1", "L", "RGB", "RGBA", "P", "LA", "I;16"])
def test_what_drawing_programs_write(tmp_path: Path, mode: str) -> None:
    grey = Image.fromarray(mask().astype(np.uint8) * 255)
    if mode == "I;16":
        grey = Image.fromarray(mask().astype(np.uint16) * 65535)
    else:
        grey = grey.convert(mode)
    grey.save(tmp_path / "m.png")
    np.testing.assert_array_equal(read_mask(tmp_path / "m.png"), mask())


@pytest.mark.parametrize("name", ["m.png", "m.tif"])
def test_sixteen_bits_are_half_bright_from_half_of_their_white(tmp_path: Path, name: str) -> None:
    """300 of 65535 is black, though 8 bits would show it white."""
    Image.fromarray(np.array([[0, 300, 32767, 32768, 65535]], np.uint16)).save(tmp_path / name)
    np.testing.assert_array_equal(read_mask(tmp_path / name), [[False, False, False, True, True]])


@pytest.mark.parametrize(("kind", "mode"), [(np.int32, "I"), (np.float32, "F")])
def test_values_without_a_known_white_are_refused(tmp_path: Path, kind: type, mode: str) -> None:
    Image.fromarray(mask().astype(kind)).save(tmp_path / "m.tif")
    with pytest.raises(PictureFileError, match=f"of the kind {mode}"):
        read_mask(tmp_path / "m.tif")


def early(path: Path, kind: str, rows: int = 40) -> None:
    """Write a picture of so many rows whose data end well-formed after half of them."""
    codes = np.random.default_rng(4).integers(0, 256, (rows, 64), np.uint8)
    Image.fromarray(codes).save(data := io.BytesIO(), kind)
    whole = data.getvalue()
    if kind == "JPEG":
        path.write_bytes(whole[: len(whole) // 2] + b"\xff\xd9")
        return
    lines = zlib.compress(b"".join(b"\0" + row.tobytes() for row in codes[: rows // 2]))
    at = whole.index(b"IDAT") - 4
    chunk = b"IDAT" + lines
    end = b"\0\0\0\0IEND\xae\x42\x60\x82"
    path.write_bytes(whole[:at] + struct.pack(">I", len(lines)) + chunk + struct.pack(">I", zlib.crc32(chunk)) + end)


@pytest.mark.parametrize("kind", ["PNG", "JPEG"])
@pytest.mark.parametrize("read", [read_mask, open_picture])
def test_a_picture_that_ends_early_but_well_formed_is_refused(
    tmp_path: Path, kind: str, read: Callable[[Path], object]
) -> None:
    """Pillow shows what there is, and the rest black."""
    early(tmp_path / "m.pic", kind)
    with pytest.raises(PictureFileError, match=r"m\.pic"):
        read(tmp_path / "m.pic")


def test_transparent_is_not_marked(tmp_path: Path) -> None:
    rgba = np.full((4, 8, 4), 255, np.uint8)
    rgba[:, 4:, 3] = 0
    Image.fromarray(rgba).save(tmp_path / "m.png")
    np.testing.assert_array_equal(read_mask(tmp_path / "m.png")[0], [True] * 4 + [False] * 4)


@pytest.mark.parametrize("data", [b"", b"\x89PNG\r\n\x1a\n", b"no picture at all", b"\x89PNG\r\n\x1a\n" + b"\0" * 50])
def test_what_is_no_mask_is_refused(tmp_path: Path, data: bytes) -> None:
    (tmp_path / "m.png").write_bytes(data)
    with pytest.raises(PictureFileError, match=r"m\.png"):
        read_mask(tmp_path / "m.png")


def test_what_is_no_picture_is_said_without_the_programs_own_names(tmp_path: Path) -> None:
    (tmp_path / "m.png").write_text("root:x:0:0")
    with pytest.raises(PictureFileError) as caught:
        read_mask(tmp_path / "m.png")
    assert caught.value.message == "is not a readable mask: cannot identify image file"


def test_cut_short_and_missing(tmp_path: Path) -> None:
    write_mask(tmp_path / "m.png", np.random.default_rng(1).random((64, 128)) > 0.5)
    whole = (tmp_path / "m.png").read_bytes()
    (tmp_path / "m.png").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(PictureFileError):
        read_mask(tmp_path / "m.png")
    with pytest.raises(PictureFileError, match="cannot be read"):
        read_mask(tmp_path / "none.png")
    with pytest.raises(PictureFileError, match="bool"):
        write_mask(tmp_path / "m.png", np.zeros((4, 8), np.uint8))  # type: ignore[arg-type]


def test_masks_are_handed_on_as_they_read_back_and_cannot_be_changed(tmp_path: Path) -> None:
    artifact = Artifact("target", "mask")
    np.testing.assert_array_equal(save(artifact, mask(), tmp_path), load(artifact, tmp_path / "target.png"))
    shelf = Shelf(lambda _stage, _name: None)
    shelf.put("detect", "target", mask())
    held = shelf.get("detect", "target")
    assert isinstance(held, np.ndarray)
    with pytest.raises(ValueError, match="read-only"):
        held[0, 0] = True
