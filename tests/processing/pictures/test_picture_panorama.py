"""Panoramas of anyone's: what is read as light, what says its scale, and what is refused by name."""

from __future__ import annotations

import struct
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import OpenEXR
import pytest
import tifffile
from PIL import Image, ImageCms

from processing.errors import PanoramaError, PictureFileError
from processing.ground.colour import linear_of_srgb
from processing.pictures.exr import write_exr
from processing.pictures.images import RelativeImage, Validity
from processing.pictures.panorama import MIDDLE, WHITE, read_panorama, read_tags
from processing.pictures.radiance import encode_rows, to_rgbe, write_radiance_hdr
from processing.sphere import Fisheye, LensMapping, Perspective
from tests.processing.pictures.picture_strategies import luminance_image

HEIGHT, WIDTH = 64, 128


def grey(level: int = 188) -> np.ndarray:
    return np.full((HEIGHT, WIDTH, 3), level, np.uint8)


def saved(path: Path, rgb: np.ndarray, **options: object) -> Path:
    Image.fromarray(rgb).save(path, **options)
    return path


def test_a_photograph_goes_through_the_inverse_of_srgb(tmp_path: Path) -> None:
    found = read_panorama(saved(tmp_path / "p.png", grey()))
    # Code 188 of 255 is half of white's light (0.5029).
    np.testing.assert_allclose(found.image.rgb, 0.5029 * WHITE, rtol=1e-3)
    assert not found.image.absolute
    assert found.factor == WHITE
    assert (found.image.validity == Validity.VALID).all()


def test_the_curve_is_exact_at_its_ends_and_its_knee() -> None:
    codes = np.array([0, 1, 10, 11, 255], np.uint8)
    np.testing.assert_allclose(linear_of_srgb(codes), [0, 1 / 255 / 12.92, 10 / 255 / 12.92, 0.0033465, 1], rtol=1e-4)
    assert linear_of_srgb(np.array([65535], np.uint16))[0] == 1


def test_sixteen_bits_are_read_as_such(tmp_path: Path) -> None:
    path = tmp_path / "p.png"
    assert cv2.imwrite(str(path), np.full((HEIGHT, WIDTH, 3), 188 * 257 + 100, np.uint16))
    found = read_panorama(path)
    assert found.source.startswith("16-bit PNG")
    exact = (((188 * 257 + 100) / 65535 + 0.055) / 1.055) ** 2.4 * WHITE
    np.testing.assert_allclose(found.image.rgb, exact, rtol=1e-5)


def test_a_clipped_window_is_a_lower_bound_and_reported(tmp_path: Path) -> None:
    rgb = grey(100)
    rgb[24:40, 50:70] = 255
    rgb[:4] = 0
    found = read_panorama(saved(tmp_path / "p.png", rgb))
    assert (found.image.validity[24:40, 50:70] == Validity.CLIPPED).all()
    assert (found.image.validity[:4] == Validity.DARK).all()
    # 16 rows about the horizon of 64, 20 columns of 128: sin(pi / 8) x 20 / 128.
    assert found.clipped_share == pytest.approx(np.sin(np.pi / 8) * 20 / 128, rel=1e-3)


def test_k1_makes_it_absolute(tmp_path: Path) -> None:
    found = read_panorama(saved(tmp_path / "p.png", grey(255)), k1=250.0)
    assert found.image.absolute
    np.testing.assert_allclose(found.image.rgb, 250.0)


@pytest.mark.parametrize("ending", ["exr", "hdr"])
def test_k1_is_of_the_files_own_values(tmp_path: Path, ending: str) -> None:
    """Neither times whiteLuminance nor times Radiance's 179."""
    path, ones = tmp_path / f"p.{ending}", np.ones((HEIGHT, WIDTH, 3), np.float32)
    if ending == "exr":
        OpenEXR.File({"whiteLuminance": 80.0}, {"RGB": ones}).write(str(path))
    else:
        head = f"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\nEXPOSURE=2\n\n-Y {HEIGHT} +X {WIDTH}\n".encode()
        path.write_bytes(head + encode_rows(to_rgbe(2 * ones)))
    found = read_panorama(path, k1=2.5)
    assert (found.image.absolute, found.factor) == (True, 2.5)
    np.testing.assert_allclose(found.image.rgb, 2.5, rtol=0.01)


def test_light_without_a_scale_gets_a_middle(tmp_path: Path) -> None:
    path = tmp_path / "p.exr"
    rgb = np.full((HEIGHT, WIDTH, 3), 0.37, np.float32)
    with OpenEXR.File({"compression": OpenEXR.ZIP_COMPRESSION}, {"RGB": rgb}) as file:
        file.write(str(path))
    found = read_panorama(path)
    assert not found.image.absolute
    np.testing.assert_allclose(found.image.rgb, MIDDLE, rtol=1e-5)
    assert found.factor == pytest.approx(MIDDLE / 0.37)


def test_white_luminance_of_an_exr_is_its_scale(tmp_path: Path) -> None:
    path = tmp_path / "p.exr"
    rgb = np.full((HEIGHT, WIDTH, 3), 2.0, np.float32)
    with OpenEXR.File({"compression": OpenEXR.ZIP_COMPRESSION, "whiteLuminance": 80.0}, {"RGB": rgb}) as file:
        file.write(str(path))
    found = read_panorama(path)
    assert found.image.absolute
    np.testing.assert_allclose(found.image.rgb, 160.0)


@pytest.mark.parametrize("absolute", [True, False])
@pytest.mark.parametrize("ending", ["exr", "hdr"])
def test_our_own_pictures_keep_their_scale(tmp_path: Path, ending: str, absolute: bool) -> None:
    image = luminance_image(np.full((HEIGHT, WIDTH, 3), 30.0), absolute=absolute)
    path = tmp_path / f"p.{ending}"
    (write_exr if ending == "exr" else write_radiance_hdr)(path, image)
    found = read_panorama(path)
    assert found.image.absolute is absolute
    np.testing.assert_allclose(found.image.rgb, 30.0 if absolute else MIDDLE, rtol=0.01)


def test_a_merged_bracket_is_relative_and_a_fisheye_is_no_panorama(tmp_path: Path) -> None:
    image = luminance_image(np.full((HEIGHT, WIDTH, 3), 30.0))
    path = tmp_path / "p.exr"
    write_exr(path, RelativeImage(image.rgb, image.uncertainty, image.validity, image.geometry))
    assert not read_panorama(path).image.absolute
    lens = Fisheye(WIDTH, HEIGHT, LensMapping.EQUIDISTANT, HEIGHT / 2, np.pi / 2)
    write_exr(path, replace(image, geometry=lens))
    with pytest.raises(PanoramaError, match="fisheye"):
        read_panorama(path)


@pytest.mark.parametrize(
    ("width", "height", "why"),
    [
        (128, 128, "stereo pair"),
        (160, 120, "ordinary photograph, or a cube map"),
        (180, 120, "ordinary photograph, or a part"),
        (400, 100, "strip"),
        (64, 32, "64 x 32"),
    ],
)
def test_other_shapes_are_refused_with_what_they_may_be(tmp_path: Path, width: int, height: int, why: str) -> None:
    with pytest.raises(PanoramaError, match=why):
        read_panorama(saved(tmp_path / "p.png", np.full((height, width, 3), 90, np.uint8)))


def test_two_fisheye_circles_are_refused(tmp_path: Path) -> None:
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH]
    inside = np.hypot((x % HEIGHT) - 31.5, y - 31.5) < 32
    with pytest.raises(PanoramaError, match="fisheye circles"):
        read_panorama(saved(tmp_path / "p.png", np.where(inside[..., None], grey(150), grey(0))))
    assert read_panorama(saved(tmp_path / "black.png", grey(0))).image.rgb.max() == 0


def packet(**tags: object) -> bytes:
    inner = " ".join(f'GPano:{name}="{value}"' for name, value in tags.items())
    head = '<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'
    space = 'xmlns:GPano="http://ns.google.com/photos/1.0/panorama/"'
    return f"{head}<rdf:Description {space} {inner}/></rdf:RDF></x:xmpmeta>".encode()


def test_tags_declare_projections_and_parts(tmp_path: Path) -> None:
    path = tmp_path / "p.jpg"
    with pytest.raises(PanoramaError, match="cylindrical"):
        read_panorama(saved(path, grey(), xmp=packet(ProjectionType="cylindrical")))
    part = packet(
        ProjectionType="equirectangular", FullPanoHeightPixels=HEIGHT * 2, CroppedAreaImageHeightPixels=HEIGHT
    )
    with pytest.raises(PanoramaError, match="64 of 128 pixels of height"):
        read_panorama(saved(path, grey(), xmp=part))
    exif = Image.Exif()
    exif[274] = 6
    with pytest.raises(PanoramaError, match="rotated"):
        read_panorama(saved(path, grey(), exif=exif))
    whole = packet(ProjectionType="equirectangular", FullPanoWidthPixels=WIDTH, CroppedAreaImageWidthPixels=WIDTH)
    assert read_panorama(saved(path, grey(), xmp=whole)).image.rgb.shape == (HEIGHT, WIDTH, 3)


def test_another_colour_profile_is_converted_or_reported(tmp_path: Path) -> None:
    lab = ImageCms.ImageCmsProfile(ImageCms.createProfile("LAB")).tobytes()
    found = read_panorama(saved(tmp_path / "lab.jpg", grey(), icc_profile=lab))
    assert "assumed to be sRGB" in found.notes[0]
    srgb = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    assert read_panorama(saved(tmp_path / "srgb.jpg", grey(), icc_profile=srgb)).notes == ()
    broken = read_panorama(saved(tmp_path / "broken.jpg", grey(), icc_profile=b"no profile at all"))
    assert "cannot be read" in broken.notes[0]


@pytest.mark.parametrize(("level", "k1"), [(1e-40, None), (0.4, 1e300), (0.4, 1e-300)])
def test_light_beyond_numbers_blames_the_file(tmp_path: Path, level: float, k1: float | None) -> None:
    path = tmp_path / "far.exr"
    with OpenEXR.File({}, {"RGB": np.full((HEIGHT, WIDTH, 3), level, np.float32)}) as file:
        file.write(str(path))
    with pytest.raises(PictureFileError) as caught:
        read_panorama(path, k1=k1)
    assert caught.value.where == str(path)
    assert "k1" not in str(caught.value)


def test_damage_and_other_files_are_named(tmp_path: Path) -> None:
    whole = saved(tmp_path / "p.jpg", grey()).read_bytes()
    (tmp_path / "cut.jpg").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(PictureFileError, match=r"cut\.jpg"):
        read_panorama(tmp_path / "cut.jpg")
    (tmp_path / "p.exr").write_bytes(b"nothing")
    with pytest.raises(PictureFileError):
        read_panorama(tmp_path / "p.exr")
    with pytest.raises(PanoramaError, match="gif"):
        read_panorama(tmp_path / "p.gif")


ELEMENTS = """<rdf:RDF><rdf:Description xmlns:GPano="http://ns.google.com/photos/1.0/panorama/">
  <GPano:ProjectionType>equirectangular</GPano:ProjectionType>
  <GPano:UsePanoramaViewer>True</GPano:UsePanoramaViewer>
  <GPano:CroppedAreaImageWidthPixels>128</GPano:CroppedAreaImageWidthPixels>
  <GPano:FullPanoWidthPixels>{whole}</GPano:FullPanoWidthPixels>
</rdf:Description></rdf:RDF>"""


def test_tags_written_as_elements_are_read(tmp_path: Path) -> None:
    """As the Theta and many programs write them: what stands between two elements is no value."""
    path = saved(tmp_path / "p.jpg", grey(), xmp=ELEMENTS.format(whole=WIDTH).encode())
    assert read_tags(path).gpano["ProjectionType"] == "equirectangular"
    assert read_panorama(path).image.rgb.shape == (HEIGHT, WIDTH, 3)
    with pytest.raises(PanoramaError, match="128 of 256"):
        read_panorama(saved(path, grey(), xmp=ELEMENTS.format(whole=2 * WIDTH).encode()))


SRGB_XYZ = np.array([[0.4361, 0.3851, 0.1431], [0.2225, 0.7169, 0.0606], [0.0139, 0.0971, 0.7142]])
ADOBE_XYZ = np.array([[0.6098, 0.2052, 0.1492], [0.3111, 0.6257, 0.0632], [0.0195, 0.0609, 0.7449]])


def profile(name: str, xyz: np.ndarray, gamma: float) -> bytes:
    """Return an ICC profile of three primaries (columns: their XYZ under D50) and a power for a curve."""

    def fixed(*values: float) -> bytes:
        return b"".join(struct.pack(">i", round(v * 65536)) for v in values)

    def tag_of(values: np.ndarray) -> bytes:
        return b"XYZ \0\0\0\0" + fixed(*values)

    text = name.encode() + b"\0"
    curve = b"curv\0\0\0\0" + struct.pack(">IH", 1, round(gamma * 256)) + b"\0\0"
    tags = {b"desc": b"desc\0\0\0\0" + struct.pack(">I", len(text)) + text + bytes(78), b"wtpt": tag_of(D50)}
    tags |= {of + b"XYZ": tag_of(column) for of, column in zip((b"r", b"g", b"b"), xyz.T, strict=True)}
    tags |= {of + b"TRC": curve for of in (b"r", b"g", b"b")}
    table, body = struct.pack(">I", len(tags)), b""
    for key, value in tags.items():
        table += key + struct.pack(">II", 132 + 12 * len(tags) + len(body), len(value))
        body += value + bytes(-len(value) % 4)
    head = b"lcms" + struct.pack(">I", 0x02100000) + b"mntrRGB XYZ " + bytes(12) + b"acsp" + bytes(28) + fixed(*D50)
    whole = head.ljust(124, b"\0") + table + body
    return struct.pack(">I", len(whole) + 4) + whole


D50 = np.array([0.9642, 1.0, 0.8249])


def test_adobe_rgb_that_only_exif_says_is_noted(tmp_path: Path) -> None:
    block = Image.Exif()
    block.get_ifd(0x8769)[0xA005] = {1: "R03"}
    assert any("Adobe RGB" in note for note in read_panorama(saved(tmp_path / "p.jpg", grey(), exif=block)).notes)
    assert not read_panorama(saved(tmp_path / "p.jpg", grey())).notes


@pytest.mark.parametrize(
    ("name", "xyz", "gamma"),
    [("Linear sRGB", SRGB_XYZ, 1.0), ("Adobe RGB (1998)", ADOBE_XYZ, 2.2), ("sRGB of nobody", ADOBE_XYZ, 2.2)],
)
@pytest.mark.parametrize("bits", [8, 16])
def test_a_profile_is_taken_by_what_it_does_not_by_its_name(
    tmp_path: Path, name: str, xyz: np.ndarray, gamma: float, bits: int
) -> None:
    light = np.array([0.5, 0.3, 0.2])
    own = np.linalg.solve(xyz, SRGB_XYZ @ light) ** (1 / gamma)
    codes = np.rint(own * (2**bits - 1)).astype(np.uint8 if bits == 8 else np.uint16)
    path = tmp_path / "p.tif"
    rgb = np.broadcast_to(codes, (HEIGHT, WIDTH, 3))
    tifffile.imwrite(path, rgb, photometric="rgb", iccprofile=profile(name, xyz, gamma))
    found = read_panorama(path)
    np.testing.assert_allclose(found.image.rgb[0, 0], WHITE * light, rtol=0.02)
    assert found.notes == (f"converted from {name!r} to sRGB",)


@pytest.mark.parametrize("dtype", [np.uint16, np.float32])
@pytest.mark.parametrize("options", [{"planarconfig": "separate"}, {"photometric": "miniswhite"}])
def test_a_tiff_of_planes_or_of_white_as_0_is_refused(tmp_path: Path, dtype: type, options: dict[str, str]) -> None:
    """OpenCV takes no notice of either in more than 8 bits; in 8 bits it does."""
    planes, path = "planarconfig" in options, tmp_path / "p.tif"
    values = np.linspace(20, 60, WIDTH, dtype=dtype) * np.ones((3, HEIGHT, 1) if planes else (HEIGHT, 1), dtype)
    tifffile.imwrite(path, values, **{"photometric": "rgb", **options})
    with pytest.raises(PictureFileError, match="one after the other"):
        read_panorama(path)
    codes = values.astype(np.uint8)
    tifffile.imwrite(path, codes, **{"photometric": "rgb", **options})
    shown = codes[0] if planes else 255 - codes
    np.testing.assert_allclose(read_panorama(path).image.rgb[..., 0], WHITE * linear_of_srgb(shown), rtol=1e-5)


def test_infinite_light_is_not_taken_for_circles(tmp_path: Path) -> None:
    rgb = np.full((HEIGHT, WIDTH, 3), 0.4, np.float32)
    rgb[5, 6] = np.inf
    tifffile.imwrite(tmp_path / "p.tif", rgb, photometric="rgb")
    with pytest.raises(PictureFileError, match="impossible light"):
        read_panorama(tmp_path / "p.tif")


def test_a_radiance_view_is_no_panorama(tmp_path: Path) -> None:
    image = luminance_image(np.full((HEIGHT, WIDTH, 3), 30.0))
    write_radiance_hdr(tmp_path / "p.hdr", replace(image, geometry=Perspective(WIDTH, HEIGHT, 1.2)))
    with pytest.raises(PanoramaError, match="-vtv"):
        read_panorama(tmp_path / "p.hdr")
