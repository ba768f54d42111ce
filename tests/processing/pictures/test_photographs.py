"""Ordinary pictures of every kind that people have: read as what they show, or refused with what to do."""

from __future__ import annotations

import struct
import sys
import zlib
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import tifffile
from PIL import Image, ImageCms
from PIL.PngImagePlugin import PngInfo

import daylit
from processing.errors import PanoramaError, PictureFileError
from processing.pictures import photographs
from processing.pictures.frames import lossless_frame
from processing.pictures.panorama import WHITE, read_panorama, read_tags
from processing.pictures.photographs import read_codes
from processing.running.panorama_session import panorama_session
from station.session.verify import verify_session
from tests.processing.pictures.test_picture_panorama import ELEMENTS

SIZE = (128, 64)


def ramp() -> np.ndarray:
    """Return a smooth coloured picture (64, 128, 3), so that lossy formats keep it."""
    x, y = np.meshgrid(np.linspace(60, 200, SIZE[0]), np.linspace(0.7, 1.0, SIZE[1]))
    return np.stack([x * y, x * y * 0.9, 220 - x * y * 0.8], axis=2).astype(np.uint8)


def save(path: Path, mode: str = "RGB", **options: Any) -> Path:
    image = Image.fromarray(ramp())
    if mode == "opaque":
        image.putalpha(255)
    elif mode == "glass":
        image.putalpha(Image.linear_gradient("L").resize(SIZE))
    elif mode == "palette":
        image = image.quantize(256)
    elif mode != "RGB":
        image = image.convert(mode)
    image.save(path, **options)
    return path


def light(rgb: np.ndarray) -> np.ndarray:
    x = rgb / 255.0
    return np.where(x <= 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** 2.4) * WHITE


@pytest.mark.parametrize(
    ("name", "mode", "options", "off_codes"),
    [
        ("p.png", "RGB", {}, 0),
        ("p.png", "opaque", {}, 0),
        ("p.png", "palette", {}, 6),
        ("p.tif", "RGB", {"compression": "tiff_lzw"}, 0),
        ("p.tiff", "opaque", {}, 0),
        ("p.webp", "RGB", {"lossless": True}, 0),
        ("p.webp", "opaque", {"quality": 95}, 6),
        ("p.avif", "RGB", {"quality": 95}, 6),
        ("p.avif", "opaque", {"quality": 95}, 6),
        ("p.jpg", "CMYK", {"quality": 98}, 8),
        ("p.tif", "CMYK", {}, 1),
    ],
)
def test_each_kind_shows_what_it_shows(
    tmp_path: Path, name: str, mode: str, options: dict[str, Any], off_codes: int
) -> None:
    found = read_panorama(save(tmp_path / name, mode, **options))
    slope = np.abs(light(ramp() + 1.0) - light(ramp())) + 1e-6
    off = np.abs(found.image.rgb - light(ramp())) / slope
    assert np.quantile(off, 0.95) <= off_codes + 0.1
    if mode == "CMYK":
        assert any("colours are approximate" in note for note in found.notes)


@pytest.mark.parametrize("name", ["p.png", "p.jpg", "p.tif", "p.webp"])
def test_grey_is_grey(tmp_path: Path, name: str) -> None:
    rgb = read_panorama(save(tmp_path / name, "L")).image.rgb
    np.testing.assert_array_equal(rgb[..., 0], rgb[..., 2])
    assert rgb.std() > 0


def test_a_phones_heic(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    heif = pytest.importorskip("pillow_heif", reason="the extra heic is not installed")
    heif.register_heif_opener()
    path = save(tmp_path / "IMG_0001.HEIC", quality=95)
    found = read_panorama(path)
    assert np.median(np.abs(found.image.rgb - light(ramp()))) < 1.0
    monkeypatch.setitem(sys.modules, "pillow_heif", None)
    with pytest.raises(PictureFileError, match="optional part") as caught:
        read_panorama(path)
    assert "JPEG" in str(caught.value.advice)


def test_four_colours_with_a_profile_are_converted(tmp_path: Path) -> None:
    profile = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    found = read_panorama(save(tmp_path / "p.jpg", "CMYK", icc_profile=profile))
    assert any("without a readable profile" in note for note in found.notes), "not one for four colours"


@pytest.mark.parametrize("name", ["p.png", "p.tif", "p.webp", "p.avif"])
def test_transparency_is_refused_with_what_to_do(tmp_path: Path, name: str) -> None:
    with pytest.raises(PictureFileError, match="transparent") as caught:
        read_panorama(save(tmp_path / name, "glass"))
    assert "flatten" in str(caught.value.advice)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_decimal_numbers_in_a_tiff_are_light(tmp_path: Path, dtype: type) -> None:
    path, truth = tmp_path / "p.tif", ramp().astype(dtype) ** 2
    assert cv2.imwrite(str(path), truth[..., ::-1])
    found = read_panorama(path, k1=2.0)
    np.testing.assert_allclose(found.image.rgb, 2 * truth, rtol=1e-6)
    assert "linear" in found.source
    assert cv2.imwrite(str(path), truth[..., 1])
    np.testing.assert_allclose(read_panorama(path, k1=2.0).image.rgb, 2 * truth[..., 1:2].repeat(3, 2), rtol=1e-6)
    truth[5, 5] = -1
    assert cv2.imwrite(str(path), truth)
    with pytest.raises(PictureFileError, match="impossible light"):
        read_panorama(path)


@pytest.mark.parametrize("part", [0.05, 0.3, 0.8, 0.999])
def test_a_tiff_of_decimal_numbers_cut_short_is_refused(tmp_path: Path, part: float) -> None:
    path = tmp_path / "p.tif"
    Image.fromarray(ramp()[..., 0].astype(np.float32)).save(path)  # its directory comes first
    path.write_bytes(path.read_bytes()[: int(part * path.stat().st_size)])
    with pytest.raises(PictureFileError, match="damaged"):
        read_panorama(path)


def test_a_lab_tiff_shows_the_colours_it_means(tmp_path: Path) -> None:
    srgb, lab = ImageCms.createProfile("sRGB"), ImageCms.createProfile("LAB")
    turned = ImageCms.profileToProfile(Image.fromarray(ramp()), srgb, lab, outputMode="LAB")
    assert turned is not None
    turned.save(tmp_path / "p.tif")
    codes, notes, _ = read_codes(tmp_path / "p.tif")
    assert np.abs(codes.astype(int) - ramp()).mean() < 2
    assert any("converted from" in note for note in notes)
    with pytest.raises(PictureFileError, match="LAB"):
        lossless_frame(tmp_path / "p.tif")


@pytest.mark.parametrize("name", ["p.png", "p.tif", "p.webp", "p.avif", "p.jpg", "p.heic"])
@pytest.mark.parametrize("part", [0.0, 0.3, 0.8])
def test_damaged_files_are_refused_by_name(tmp_path: Path, name: str, part: float) -> None:
    if name == "p.heic":
        pytest.importorskip("pillow_heif", reason="the extra heic is not installed").register_heif_opener()
    path = save(tmp_path / name)
    data = path.read_bytes()
    path.write_bytes(data[: int(part * len(data))])
    with pytest.raises(PictureFileError, match=name):
        read_panorama(path)


def test_a_file_of_another_kind_than_its_name_says(tmp_path: Path) -> None:
    path = save(tmp_path / "p.png")
    path.rename(tmp_path / "p.webp")
    with pytest.raises(PictureFileError, match="not what its name suggests"):
        read_panorama(tmp_path / "p.webp")
    with pytest.raises(PanoramaError, match="gif") as caught:
        read_panorama(tmp_path / "p.gif")
    assert "GIF saved as PNG" in str(caught.value.advice)


def test_several_pictures_in_one_file(tmp_path: Path) -> None:
    first = Image.fromarray(ramp())
    first.save(tmp_path / "p.tif", save_all=True, append_images=[Image.new("RGB", SIZE)])
    assert any("the first is used" in note for note in read_panorama(tmp_path / "p.tif").notes)


@pytest.mark.parametrize("name", ["room.webp", "room.tiff", "room.avif"])
def test_a_session_keeps_the_file_as_it_is(tmp_path: Path, name: str) -> None:
    path = save(tmp_path / name)
    session = panorama_session(path, tmp_path / "sessions")
    (given,) = (session / "given").iterdir()
    assert given.read_bytes() == path.read_bytes()
    assert not verify_session(session).problems
    assert panorama_session(path, tmp_path / "sessions") == session
    assert daylit.main(["verify", str(session)]) == 0


def test_the_largest_panoramas_are_opened_and_larger_ones_are_named(tmp_path: Path) -> None:
    """Of 180 million pixels, beyond which Pillow's own limit would call them bombs, and of 202."""
    (large, larger), tags = (tmp_path / "a.png", tmp_path / "b.png"), ELEMENTS.format(whole=40_000)
    info = PngInfo()
    info.add_itxt("XML:com.adobe.xmp", tags)
    Image.new("1", (19_000, 9_500)).save(large, pnginfo=info)
    assert read_tags(large).gpano["FullPanoWidthPixels"] == "40000"
    assert photographs._opened(large, "png").size == (19_000, 9_500)
    Image.new("1", (20_100, 10_050)).save(larger)
    with pytest.raises(PictureFileError, match="20100 x 10050"):
        read_codes(larger)


@pytest.mark.parametrize("curve", [16, 18])
def test_hdr_videos_curves_are_not_taken_for_srgb(tmp_path: Path, curve: int) -> None:
    pytest.importorskip("pillow_heif", reason="the extra heic is not installed").register_heif_opener()
    bt2020 = {"color_primaries": 9, "transfer_characteristics": curve, "matrix_coefficients": 9}
    Image.fromarray(np.full((64, 128, 3), 120, np.uint8)).save(tmp_path / "p.heic", save_nclx_profile=True, **bt2020)
    with pytest.raises(PictureFileError, match="PQ or HLG"):
        read_codes(tmp_path / "p.heic")


@pytest.mark.parametrize("curve", [8, 16, 18])
def test_tone_curves_that_an_avif_states_are_not_taken_for_srgb(tmp_path: Path, curve: int) -> None:
    data = bytearray(save(tmp_path / "p.avif", quality=95).read_bytes())
    at = data.index(b"colrnclx") + 10
    assert data[at : at + 2] == b"\0\r", "sRGB"
    read_codes(tmp_path / "p.avif")
    data[at : at + 2] = bytes((0, curve))
    (tmp_path / "p.avif").write_bytes(data)
    with pytest.raises(PictureFileError, match="linear" if curve == 8 else "PQ or HLG"):
        read_codes(tmp_path / "p.avif")


def chunked(path: Path, **chunks: bytes) -> Path:
    """Return a PNG with further chunks before its own."""
    data = path.read_bytes()
    every = ((name.encode(), own) for name, own in chunks.items())
    more = b"".join(
        struct.pack(">I", len(own)) + name + own + struct.pack(">I", zlib.crc32(name + own)) for name, own in every
    )
    path.write_bytes(data[:33] + more + data[33:])
    return path


@pytest.mark.parametrize(
    ("chunks", "why"),
    [
        ({"cICP": bytes((9, 16, 0, 1))}, "PQ or HLG"),
        ({"cICP": bytes((1, 18, 0, 1))}, "PQ or HLG"),
        ({"cICP": bytes((1, 8, 0, 1)), "sRGB": b"\0"}, "linear"),
        ({"gAMA": struct.pack(">I", 100_000)}, "gamma 1"),
        ({"gAMA": struct.pack(">I", 55_556)}, "gamma 0.556"),
        ({"gAMA": struct.pack(">I", 45_455)}, ""),
        ({"gAMA": struct.pack(">I", 100_000), "sRGB": b"\0"}, ""),
        ({"gAMA": struct.pack(">I", 100_000), "cICP": bytes((1, 13, 0, 1))}, ""),
    ],
    ids=str,
)
def test_tone_curves_that_a_png_states_are_not_taken_for_srgb(
    tmp_path: Path, chunks: dict[str, bytes], why: str
) -> None:
    path = chunked(save(tmp_path / "p.png"), **chunks)
    if why:
        with pytest.raises(PictureFileError, match=why) as caught:
            read_panorama(path)
        assert "sRGB" in str(caught.value.advice)
    else:
        np.testing.assert_allclose(read_panorama(path).image.rgb, light(ramp()), rtol=1e-5)


def test_decimal_tiffs_have_tags_and_transparency_too(tmp_path: Path) -> None:
    path, rgba = tmp_path / "p.tif", np.full((64, 128, 4), 0.5, np.float32)
    rgba[..., 3] = 1
    tifffile.imwrite(path, rgba, photometric="rgb", extrasamples=["unassalpha"])
    assert read_panorama(path, k1=2.0).image.rgb.max() == 1.0
    rgba[10:20, 30:40] = 0
    tifffile.imwrite(path, rgba, photometric="rgb", extrasamples=["unassalpha"])
    with pytest.raises(PictureFileError, match="transparent"):
        read_panorama(path)
    tifffile.imwrite(path, rgba[..., :3], photometric="rgb", extratags=[(274, "H", 1, 3, True)])
    with pytest.raises(PanoramaError, match="must be rotated"):
        read_panorama(path)
    cropped = ELEMENTS.format(whole=256).encode()
    tifffile.imwrite(path, rgba[..., :3], photometric="rgb", extratags=[(700, "B", len(cropped), cropped, True)])
    with pytest.raises(PanoramaError, match="cropped"):
        read_panorama(path)
