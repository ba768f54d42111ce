"""Frames: exact decoding, reduction, damage refused by name, linear kinds."""

from __future__ import annotations

import os
from datetime import datetime
from pathlib import Path

import cv2
import numpy as np
import pytest
import simplejpeg
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from benchmarks.shared_data import DATA
from mocks.instruments.exposures import ShotRequest
from mocks.optics.picture_jobs import RawFrame, mosaic_file
from processing.errors import ParameterError, PictureFileError
from processing.pictures import frames
from processing.pictures.frames import (
    FrameSource,
    array_frame,
    frame_of,
    jpeg_frame,
    lossless_frame,
    same_file,
)
from processing.pictures.mosaic import PEDESTAL


def picture(height: int = 37, width: int = 50, dtype: type = np.uint8) -> np.ndarray:
    rng = np.random.default_rng(1)
    small = rng.uniform(0, np.iinfo(dtype).max, (5, 6, 3)).astype(np.float32)
    return cv2.resize(small, (width, height)).clip(0, np.iinfo(dtype).max).astype(dtype)


def jpeg(height: int = 37, width: int = 50) -> bytes:
    return simplejpeg.encode_jpeg(picture(height, width), quality=95, colorspace="RGB", colorsubsampling="420")


def test_jpeg_is_decoded_exactly_and_reduced_to_rounded_up_sizes() -> None:
    frame = jpeg_frame(jpeg(), "a.jpg")
    assert isinstance(frame, FrameSource)
    assert (frame.size_px, frame.depth_bits, frame.linear) == ((50, 37), 8, False)
    exact = cv2.imdecode(np.frombuffer(jpeg(), np.uint8), cv2.IMREAD_COLOR)[..., ::-1]
    np.testing.assert_array_equal(frame.decode(), exact)
    for reduce in (2, 4, 8):
        small = frame.decode(reduce)
        assert small.shape == (-(-37 // reduce), -(-50 // reduce), 3)
        assert abs(small.astype(float).mean() - exact.mean()) < 6
    with pytest.raises(ParameterError, match="1, 2, 4 or 8"):
        frame.decode(3)


@settings(max_examples=40, deadline=None)
@given(cut=st.integers(0, 2000))
def test_a_jpeg_cut_short_anywhere_is_refused_by_name(cut: int) -> None:
    whole = jpeg()
    with pytest.raises(PictureFileError, match=r"a\.jpg"):
        jpeg_frame(whole[: min(cut, len(whole) - 2)], "a.jpg").decode()


@settings(max_examples=60, deadline=None)
@given(place=st.integers(0, 10_000), value=st.integers(0, 255))
def test_a_changed_byte_gives_a_picture_of_the_right_size_or_a_named_refusal(place: int, value: int) -> None:
    data = bytearray(jpeg())
    data[place % len(data)] = value
    result, fits = "", False
    try:
        frame = jpeg_frame(bytes(data), "a.jpg")
        fits = frame.decode().shape == (frame.size_px[1], frame.size_px[0], 3)
    except PictureFileError as error:
        result = str(error)
    assert fits or "a.jpg" in result


@pytest.mark.shared("damaged/jpeg")
def test_the_damaged_jpegs_are_refused_or_whole() -> None:
    files = [p for p in sorted((DATA / "damaged/jpeg").rglob("*")) if p.is_file()]
    refused = sum(not decodes_whole(path) for path in files)
    assert files
    assert refused >= 0.95 * len(files)


def decodes_whole(path: Path) -> bool:
    """Return whether a file decodes, whole and reduced; anything but the named refusal fails the test."""
    try:
        frame = jpeg_frame(path)
        for reduce in (1, 2, 4, 8):
            frame.decode(reduce)
    except PictureFileError:
        return False
    return True


@pytest.mark.parametrize("ending", [".tif", ".png"])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_lossless_frames_keep_every_code(tmp_path: Path, ending: str, dtype: type) -> None:
    path = tmp_path / f"frame{ending}"
    pixels = picture(dtype=dtype)
    assert cv2.imwrite(str(path), pixels[..., ::-1])
    frame = frame_of(path)
    assert (frame.size_px, frame.depth_bits, frame.linear) == ((50, 37), 8 * pixels.itemsize, dtype is np.uint16)
    np.testing.assert_array_equal(frame.decode(), pixels)
    assert frame.decode(4).shape == (10, 13, 3)
    np.testing.assert_allclose(frame.decode(2)[:18].mean(), pixels[:36].mean(), rtol=0.01)


@pytest.mark.parametrize("ending", [".tif", ".png"])
@pytest.mark.parametrize("part", [0.0, 0.05, 0.3, 0.7, 0.95])
def test_a_lossless_frame_cut_short_is_refused(tmp_path: Path, ending: str, part: float) -> None:
    path = tmp_path / f"frame{ending}"
    rng = np.random.default_rng(0)
    assert cv2.imwrite(str(path), rng.integers(0, 65536, (40, 50, 3)).astype(np.uint16))
    data = path.read_bytes()
    path.write_bytes(data[: int(part * len(data))])
    with pytest.raises(PictureFileError, match="frame"):
        lossless_frame(path).decode()


def test_other_kinds_are_refused_by_name(tmp_path: Path) -> None:
    glass = tmp_path / "glass.png"
    cv2.imwrite(str(glass), np.full((4, 4, 4), 254, np.uint8))
    floats = tmp_path / "float.tif"
    cv2.imwrite(str(floats), np.zeros((4, 4, 3), np.float32))
    for path in (glass, floats, tmp_path / "missing.jpg", tmp_path / "frame.txt"):
        with pytest.raises(PictureFileError, match=path.stem):
            frame_of(path)
    for wrong in (np.zeros((4, 4, 3), np.float32), np.zeros((4, 4), np.uint8), np.zeros((0, 4, 3), np.uint8)):
        with pytest.raises(ParameterError, match="uint8 or uint16"):
            array_frame(wrong, "array")  # type: ignore[arg-type]


@pytest.mark.parametrize("ending", [".tif", ".png"])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_grey_and_opaque_alpha_are_ordinary_pictures(tmp_path: Path, ending: str, dtype: type) -> None:
    pixels, path = picture(dtype=dtype), tmp_path / f"frame{ending}"
    assert cv2.imwrite(str(path), pixels[..., 0])
    np.testing.assert_array_equal(frame_of(path).decode(), np.repeat(pixels[..., :1], 3, axis=2))
    opaque = np.full((*pixels.shape[:2], 1), np.iinfo(dtype).max, dtype)
    assert cv2.imwrite(str(path), np.concatenate([pixels[..., ::-1], opaque], axis=2))
    np.testing.assert_array_equal(frame_of(path).decode(), pixels)


def test_same_file_looks_at_bytes(tmp_path: Path) -> None:
    for name in ("a.jpg", "b.jpg"):
        (tmp_path / name).write_bytes(jpeg())
    a, b, c = jpeg_frame(tmp_path / "a.jpg"), jpeg_frame(tmp_path / "b.jpg"), jpeg_frame(jpeg(36))
    assert same_file(a, b)
    assert not same_file(a, c)


def raw_file(level: float) -> bytes:
    """Return a small DNG of an even grey, ``level`` of full scale."""
    black, white = 512, 16383
    mosaic = np.full((64, 96), round(black + level * (white - black)), dtype=np.uint16)
    taken = datetime(2026, 3, 1, 12, 0, 0)
    request = ShotRequest(1 / 60, 100, 5.6, 6500, 96, 64, taken, 1, "RICOH", "THETA Z1", "1", "3.0")
    return mosaic_file(RawFrame(mosaic, black, white, ((1, 0, 0), (0, 1, 0), (0, 0, 1))), request, cr2=False)


def test_simulated_raw_doubles_with_the_time(tmp_path: Path) -> None:
    levels = []
    for name, level in (("a", 0.1), ("b", 0.2)):
        path = tmp_path / f"{name}.dng"
        path.write_bytes(raw_file(level))
        frame = frame_of(path)
        pixels = frame.decode()
        assert pixels.dtype == np.uint16
        assert frame.linear
        assert pixels.shape == (frame.size_px[1], frame.size_px[0], 3)
        levels.append(pixels[8:-8, 8:-8].astype(float).mean(axis=(0, 1)) - PEDESTAL)
    np.testing.assert_allclose(levels[1] / levels[0], 2.0, rtol=0.01)
    broken = tmp_path / "c.dng"
    broken.write_bytes(os.urandom(4000))
    with pytest.raises(PictureFileError, match="c"):
        frame_of(broken)


def test_a_large_png_is_no_damage(tmp_path: Path) -> None:
    """Of 90 million pixels, where Pillow begins to warn of bombs."""
    Image.new("1", (13_600, 6_800)).save(tmp_path / "p.png")
    assert frames._lossless_size((tmp_path / "p.png").read_bytes(), "p.png") == (13_600, 6_800)
