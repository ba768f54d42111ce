"""`daylit inspect` on every kind of picture: values, uncertainty, what lies around, metadata, refusals."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import daylit
from processing.errors import ParameterError, PictureFileError
from processing.exchange.inspection import CODE_UNIT, open_picture, picture_facts, place_facts
from processing.exchange.jpeg_files import Made, PanoramaTags, write_jpeg
from processing.pictures.exr import write_exr
from processing.pictures.images import LuminanceImage, RelativeImage, Validity
from processing.pictures.radiance import write_radiance_hdr
from processing.sphere import Equirectangular, Fisheye, LensMapping


def calibrated(rows: int = 32, **more) -> LuminanceImage:
    """Luminance is 100 on the left half, 300 on the right; the right lower corner is clipped."""
    level = np.full((rows, 2 * rows), 100.0, np.float32)
    level[:, rows:] = 300.0
    validity = np.zeros(level.shape, np.uint8)
    validity[-1, -1] = Validity.CLIPPED
    rgb = np.repeat(level[..., None], 3, axis=2)
    uncertainty = np.full(level.shape, 0.03, np.float32)
    return LuminanceImage(
        rgb, uncertainty, validity, Equirectangular(2 * rows, rows), 0.04, attributes={"k1": 2.5}, **more
    )


def test_an_exr_of_ours(tmp_path: Path) -> None:
    write_exr(tmp_path / "a.exr", calibrated())
    picture = open_picture(tmp_path / "a.exr")
    facts = picture_facts(picture)
    assert (facts["unit"], facts["width_px"], facts["attributes"]["k1"]) == ("cd/m2", 64, 2.5)
    assert facts["range"]["lowest"] == pytest.approx(100, rel=1e-5)
    assert facts["pixels"]["clipped"] == pytest.approx(1 / 2048)
    place = place_facts(picture, 90, 10, 20)
    assert place["value"] == pytest.approx(300, rel=1e-5)
    assert place["relative_uncertainty"] == pytest.approx(0.05, rel=1e-5)
    assert place["pixel"] == "valid"
    assert place["around"]["standard_deviation"] == pytest.approx(0, abs=1e-3)
    middle = place_facts(picture, 0, 0, 30)["around"]
    assert middle["mean"] == pytest.approx(200, rel=1e-3)
    assert middle["standard_deviation"] == pytest.approx(100, rel=1e-3)
    assert (middle["lowest"], middle["highest"]) == pytest.approx((100, 300), rel=1e-5)


def test_median_and_mean_of_a_panorama_are_by_solid_angle(tmp_path: Path) -> None:
    """A belt 40 degrees up and down is 44 % of the pixels, yet 64 % of the sphere."""
    image = calibrated(360)
    image.rgb[:], image.rgb[100:260] = 100.0, 1000.0
    write_exr(tmp_path / "a.exr", image)
    shown = picture_facts(open_picture(tmp_path / "a.exr"))["range"]
    assert shown["mean"] == pytest.approx(100 + 900 * math.sin(math.radians(40)), rel=1e-3)
    assert shown["median"] == pytest.approx(1000, rel=1e-3)


def test_seam_poles_and_too_small_a_radius(tmp_path: Path) -> None:
    write_exr(tmp_path / "a.exr", calibrated())
    picture = open_picture(tmp_path / "a.exr")
    assert place_facts(picture, 180, 0)["value"] == place_facts(picture, -180, 0)["value"]
    assert place_facts(picture, 270, 0)["value"] == place_facts(picture, -90, 0)["value"]
    seam = place_facts(picture, 180, 0, 20)["around"]
    assert (seam["lowest"], seam["highest"]) == pytest.approx((100, 300), rel=1e-5)
    assert place_facts(picture, 17, 90)["row"] == 0
    assert place_facts(picture, 17, -90)["row"] == 31
    assert place_facts(picture, 0, 0, 0.01)["around"] is None
    for wrong in ((0, 91), (361, 0), (math.nan, 0)):
        with pytest.raises(ParameterError):
            place_facts(picture, *wrong)
    with pytest.raises(ParameterError):
        place_facts(picture, 0, 0, 0)


def test_relative_pictures_say_so(tmp_path: Path) -> None:
    image = calibrated()
    write_exr(tmp_path / "a.exr", replace(image, absolute=False))
    assert open_picture(tmp_path / "a.exr").unit == "relative units"
    merged = RelativeImage(image.rgb, image.uncertainty, image.validity, image.geometry)
    write_exr(tmp_path / "m.exr", merged)
    assert "before calibration" in open_picture(tmp_path / "m.exr").kind
    write_radiance_hdr(tmp_path / "a.hdr", replace(image, absolute=False))
    assert open_picture(tmp_path / "a.hdr").unit == "relative units"


def test_a_sky_has_only_what_its_lens_saw(tmp_path: Path) -> None:
    geometry = Fisheye(64, 64, LensMapping.EQUIDISTANT, 32)
    level = np.full((64, 64), 5000.0, np.float32)
    y, x = np.mgrid[:64, :64] + 0.5
    validity = np.where(np.hypot(x - 32, y - 32) > 32, Validity.OUTSIDE, Validity.VALID).astype(np.uint8)
    image = LuminanceImage(
        np.repeat(np.where(validity, 0, level)[..., None], 3, 2).astype(np.float32),
        np.where(validity, np.inf, 0.1).astype(np.float32),
        validity,
        geometry,
        0.0,
    )
    write_exr(tmp_path / "sky.exr", image)
    write_radiance_hdr(tmp_path / "sky.hdr", image)
    for name in ("sky.exr", "sky.hdr"):
        picture = open_picture(tmp_path / name)
        assert place_facts(picture, 0, 90, 5)["value"] == pytest.approx(5000, rel=0.01)
        with pytest.raises(ParameterError, match="does not show"):
            place_facts(picture, 0, -30)


def test_codes_are_not_called_light(tmp_path: Path) -> None:
    codes = np.full((32, 64, 3), (200, 100, 60), np.uint8)
    write_jpeg(tmp_path / "a.jpg", codes, panorama=PanoramaTags.whole(64, 32), made=Made.of("staged-1"), relative=True)
    picture = open_picture(tmp_path / "a.jpg")
    assert picture.unit == CODE_UNIT
    assert picture.attributes["edited"] is picture.attributes["staged"] is True
    write_jpeg(tmp_path / "b.jpg", codes, made=Made.of("empty"))
    emptied = open_picture(tmp_path / "b.jpg").attributes
    assert (emptied["edited"], emptied["staged"]) == (True, False)
    assert picture.attributes["units"] == "relative"
    assert picture.attributes["GPano:ProjectionType"] == "equirectangular"
    assert place_facts(picture, 0, 0)["value"] == pytest.approx(120, abs=2)


def test_other_shapes_have_no_directions(tmp_path: Path) -> None:
    write_jpeg(tmp_path / "a.jpg", np.zeros((30, 40, 3), np.uint8))
    picture = open_picture(tmp_path / "a.jpg")
    assert picture_facts(picture)["geometry"] == "not known"
    with pytest.raises(ParameterError, match="does not state its projection"):
        place_facts(picture, 0, 0)


@pytest.mark.parametrize(
    "data", [b"", b"GIF89a", b"\xff\xd8\xff", b"\x89PNG\r\n\x1a\n", b"#?RADIANCE", b"\x76\x2f\x31\x01"]
)
def test_damage_is_a_named_error(tmp_path: Path, data: bytes) -> None:
    (tmp_path / "x").write_bytes(data)
    with pytest.raises(PictureFileError):
        open_picture(tmp_path / "x")
    with pytest.raises(PictureFileError):
        open_picture(tmp_path / "none")


def test_as_a_user_meets_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = str(tmp_path / "a.exr")
    write_exr(Path(path), calibrated())
    assert daylit.main(["inspect", path, "--at", "90,0", "--at", "-90,0"]) == 0
    result = capsys.readouterr().out
    assert "at 90, 0 (column 48, row 16): 300 ± 5.0% cd/m2" in result
    assert "uncertainty of the scale: 4.0%" in result
    assert daylit.main(["inspect", path, "--at", "180,-89", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["places"][0]["unit"] == "cd/m2"
    assert daylit.main(["inspect", path, "--at", "x"]) == 2


def test_grey_of_sixteen_bits_is_not_cut_off(tmp_path: Path) -> None:
    """As classes and instances of simulated rooms are written."""
    Image.fromarray(np.full((32, 64), 100 * 257, np.uint16)).save(tmp_path / "p.png")
    np.testing.assert_allclose(open_picture(tmp_path / "p.png").rgb, 100.0)
