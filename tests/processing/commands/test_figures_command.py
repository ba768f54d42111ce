"""`daylit figures`: whose units the figures are in, and what is said of values, files and options that cannot be."""

from __future__ import annotations

import csv
import errno
import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from PIL import Image
from PIL.TiffImagePlugin import IFDRational

from daylit import main
from processing.calibration.scale.photometry import illuminance_lx
from processing.errors import BracketError
from processing.figures import foreign
from processing.figures.foreign import taken_frames
from processing.figures.uncertainty import QUANTILES
from processing.ground.colour import srgb_of_linear
from processing.pictures.exr import write_exr
from processing.pictures.images import Validity
from processing.pictures.radiance import write_radiance_hdr
from processing.sphere import Fisheye, LensMapping, Perspective, directions
from station.session import durable
from tests.processing.pictures.picture_strategies import luminance_image
from tests.processing.pictures.test_picture_panorama import ADOBE_XYZ, profile

FISHEYE = ("--view", "fisheye,equidistant,180")


def exr(path: Path, *, level: float = 40.0, size: tuple[int, int] = (32, 64), white: float | None = None) -> str:
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    header |= {} if white is None else {"whiteLuminance": white}
    OpenEXR.File(header, {"RGB": np.full((*size, 3), level, np.float32)}).write(str(path))
    return str(path)


def said(capsys: pytest.CaptureFixture[str], *words: str) -> tuple[int, dict]:
    """Run with --json; standard error stays empty: neither warnings nor crash reports."""
    code = main(["figures", *words, "--json"])
    streams = capsys.readouterr()
    assert not streams.err

    def refuse(name: str) -> float:
        raise AssertionError(f"{name} is no JSON")

    return code, json.loads(streams.out, parse_constant=refuse)


def error(capsys: pytest.CaptureFixture[str], *words: str) -> dict:
    code, answer = said(capsys, *words)
    assert code in (2, 5, 6)
    return answer["error"]


def test_a_picture_without_a_scale_is_in_relative_units(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = exr(tmp_path / "plain.exr", size=(32, 32))
    code, found = said(capsys, path, *FISHEYE)
    assert (code, found["unit"]) == (0, "relative units")
    # No name may promise lx or cd/m2, and glare depends on the scale.
    assert set(found["figures"]) == {"illuminance", "picture-mean", *(f"picture-{n}" for n in QUANTILES)}
    assert found["figures"]["picture-mean"]["value"] == pytest.approx(40)
    assert "--scale" in found["left_out"]["glare"]
    assert main(["figures", path, *FISHEYE]) == 0
    text = capsys.readouterr().out
    assert "cd_m2" not in text
    assert "_lx" not in text
    assert "in relative units; lx, cd/m2, glare need --scale or --reading" in text


@pytest.mark.parametrize("words", [("--scale", "2"), ("--reading", "80@16,16")])
def test_a_scale_makes_it_absolute(tmp_path: Path, capsys: pytest.CaptureFixture[str], words: tuple[str, ...]) -> None:
    code, found = said(capsys, exr(tmp_path / "plain.exr", size=(32, 32)), *FISHEYE, *words)
    assert (code, found["unit"], found["left_out"]) == (0, "cd/m2", {})
    assert found["figures"]["picture-mean_cd_m2"]["value"] == pytest.approx(80)
    assert {"illuminance_lx", "dgp", "ugr"} <= set(found["figures"])


def test_a_scale_is_of_the_files_own_values(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Neither times whiteLuminance nor times Radiance's 179."""
    rows = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 4 +X 8\n" + bytes((127, 127, 127, 129)) * 32
    (tmp_path / "p.hdr").write_bytes(rows)
    for path in (str(tmp_path / "p.hdr"), exr(tmp_path / "p.exr", level=1.0, white=80.0)):
        _, found = said(capsys, path, "--scale", "2.5")
        assert found["figures"]["picture-mean_cd_m2"]["value"] == pytest.approx(2.5, rel=0.01)


def test_a_factor_without_an_uncertainty_leaves_it_unknown(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, table = exr(tmp_path / "plain.exr", size=(32, 32)), tmp_path / "t.csv"
    _, found = said(capsys, path, *FISHEYE, "--scale", "2", "--csv", str(table))
    assert {one["uncertainty"] for one in found["figures"].values()} == {None}
    assert {row["standard_uncertainty"] for row in csv.DictReader(table.read_text("utf-8").splitlines())} == {""}
    assert main(["figures", path, *FISHEYE, "--scale", "2"]) == 0
    assert "± unknown" in capsys.readouterr().out
    _, read = said(capsys, path, *FISHEYE, "--reading", "80@16,16")
    assert read["figures"]["dgp"]["uncertainty"] > 0


def test_a_full_disk_leaves_the_table_that_was_there(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def write_all(fd: int, data: bytes | memoryview) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    (table := tmp_path / "t.csv").write_text("before")
    path = exr(tmp_path / "plain.exr")
    monkeypatch.setattr(durable, "write_all", write_all)
    assert error(capsys, path, "--csv", str(table))["code"] == "RES-001"
    assert table.read_text() == "before"
    assert {one.name for one in tmp_path.iterdir()} == {"plain.exr", "t.csv"}


def test_clipped_light_is_said_to_be_a_bound(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    image = luminance_image(np.full((32, 32, 3), 3000, np.float32), Fisheye(32, 32, LensMapping.EQUIDISTANT, 16))
    validity = image.validity.copy()
    validity[10:14, 14:18] = Validity.CLIPPED
    write_exr(tmp_path / "own.exr", replace(image, validity=validity))
    table = tmp_path / "t.csv"
    _, found = said(capsys, str(tmp_path / "own.exr"), "--region", "0,20,32,32", "--csv", str(table))
    bounds = {name: one["bound"] for name, one in found["figures"].items()}
    assert bounds["illuminance_lx"] == bounds["dgp"] == bounds["picture-mean_cd_m2"] == "lower"
    assert bounds["vcp_pct"] == "upper"
    assert bounds["region-1-mean_cd_m2"] is None
    assert {row["figure"]: row["bound"] or None for row in csv.DictReader(table.read_text().splitlines())} == bounds
    assert main(["figures", str(tmp_path / "own.exr")]) == 0
    assert "a lower bound" in capsys.readouterr().out


def test_a_file_that_states_its_scale_is_absolute(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    _, found = said(capsys, exr(tmp_path / "white.exr", white=3.0))
    assert found["unit"] == "cd/m2"
    assert found["figures"]["picture-mean_cd_m2"]["value"] == pytest.approx(120)


def test_our_own_files_stay_what_they_are(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    image = luminance_image(np.full((32, 64, 3), 40, np.float32))
    for absolute, unit in ((True, "cd/m2"), (False, "relative units")):
        write_radiance_hdr(tmp_path / "own.hdr", replace(image, absolute=absolute))
        write_exr(tmp_path / "own.exr", replace(image, absolute=absolute))
        for name in ("own.hdr", "own.exr"):
            assert said(capsys, str(tmp_path / name))[1]["unit"] == unit, name


def test_radiance_files_of_others_follow_its_convention(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 4 +X 8\n" + bytes((127, 127, 127, 128)) * 32
    (tmp_path / "other.hdr").write_bytes(rows)
    _, found = said(capsys, str(tmp_path / "other.hdr"))
    assert found["unit"] == "cd/m2"
    assert found["figures"]["picture-mean_cd_m2"]["value"] == pytest.approx(127.5 / 256 * 179)


def test_tables_go_where_there_is_a_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, table, colours = exr(tmp_path / "p.exr"), tmp_path / "t.csv", tmp_path / "t.png"
    assert said(capsys, path, "--csv", str(table), "--falsecolour", str(colours))[0] == 0
    assert next(csv.reader(table.read_text("utf-8").splitlines())) == [
        "figure",
        "value",
        "standard_uncertainty",
        "bound",
    ]
    assert colours.read_bytes().startswith(b"\x89PNG")
    for option, name in (("--csv", "x.csv"), ("--falsecolour", "x.png")):
        found = error(capsys, path, option, str(tmp_path / "no" / name))
        assert found["code"] == "RES-002"
        assert "folder does not exist" in found["likely"]


def test_a_falsecolour_scale_may_be_given(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Two pictures of one scale can be compared; an end that cannot be, or no picture to draw, is refused."""
    path, drawn = exr(tmp_path / "p.exr", white=1.0), []
    assert said(capsys, path, "--falsecolour", str(tmp_path / "x.jpg"))[0] == 0
    assert (tmp_path / "x.jpg").read_bytes()[:2] == bytes.fromhex("ffd8")
    assert ".png or .jpg" in error(capsys, path, "--falsecolour", str(tmp_path / "x.tif"))["message"]
    for ends in ((), ("--falsecolour-range", "1,1000"), ("--falsecolour-range", "10,100")):
        assert said(capsys, path, "--falsecolour", str(tmp_path / "x.png"), *ends)[0] == 0
        drawn.append((tmp_path / "x.png").read_bytes())
    assert len(set(drawn)) == 3
    for ends in ("100,10", "0,10"):
        found = error(capsys, path, "--falsecolour", str(tmp_path / "x.png"), "--falsecolour-range", ends)
        assert "--falsecolour-range" in found["message"]
    assert "--falsecolour FILE" in error(capsys, path, "--falsecolour-range", "1,10")["message"]


def test_a_panoramas_glare_is_where_somebody_looks(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    light = np.full((64, 128, 3), 50, np.float32)
    light[20:30, 90:102] = 8000  # a window to the right
    write_exr(tmp_path / "p.exr", luminance_image(light))
    path = str(tmp_path / "p.exr")
    assert "--look" in said(capsys, path)[1]["left_out"]["glare"]
    _, found = said(capsys, path, "--look", "90", "--look", "-90")
    window, wall = ({k: found["figures"][f"look-{at}-{k}"]["value"] for k in ("dgp", "ugr", "dgi")} for at in (90, -90))
    assert window["dgp"] > 0.3 > wall["dgp"]
    assert window["ugr"] > 10
    assert "glare" not in found["left_out"]
    for words in ((exr(tmp_path / "relative.exr"),), (exr(tmp_path / "f.exr", size=(32, 32), white=1.0), *FISHEYE)):
        assert "--look" in error(capsys, *words, "--look", "0")["message"]


def test_glare_of_a_sky_is_for_somebody_lying_down(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    image = luminance_image(np.full((32, 32, 3), 3000, np.float32), Fisheye(32, 32, LensMapping.EQUIDISTANT, 16))
    for side, lying in (("outdoor", True), ("indoor", False)):
        write_exr(tmp_path / "own.exr", replace(image, attributes={"side": side}))
        _, found = said(capsys, str(tmp_path / "own.exr"))
        assert ("lying down" in found["left_out"].get("glare", "")) == lying
        assert "dgp" in found["figures"]


def test_a_bracket_is_as_unsure_as_its_lens_field(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A disc off the axis is nearer to it, and smaller, where the field is taken narrower by 3 degrees."""
    geometry = Fisheye(200, 200, LensMapping.EQUIDISTANT, 100)
    rays, seen = directions(geometry)
    level = np.where(rays @ np.array([0.7, 0, 0.714]) > 0.95, 5000.0, 0.0) * seen
    image = luminance_image(np.repeat(level[..., None], 3, axis=2), geometry)
    image = replace(image, validity=np.where(seen, image.validity, np.uint8(Validity.OUTSIDE)))
    monkeypatch.setattr(foreign, "merged_bracket", lambda *_: image)
    _, found = said(capsys, str(frames(tmp_path / "frames")), "--view", "fisheye,equidistant,180")
    narrower = replace(image, geometry=replace(geometry, half_field_rad=math.radians(88.5)))
    known, other = illuminance_lx(image), illuminance_lx(narrower)
    stated = found["figures"]["illuminance_lx"]
    expected = math.hypot(known.uncertainty_lx, other.value_lx - known.value_lx)
    assert abs(other.value_lx - known.value_lx) > 0.005 * known.value_lx
    assert stated["value"] == pytest.approx(known.value_lx)
    assert stated["uncertainty"] == pytest.approx(expected, rel=1e-4)
    assert "moved" in found["left_out"]["movement"]


def test_a_black_picture_has_false_colours(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = exr(tmp_path / "black.exr", level=0.0)
    assert said(capsys, path, "--falsecolour", str(tmp_path / "x.png"))[0] == 0


@pytest.mark.parametrize("view", ["fisheye,foo,180", "fisheye,equisolid,nan", "fisheye,equisolid", "panorama"])
def test_a_brackets_view_is_checked_before_it_is_merged(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], view: str
) -> None:
    found = error(capsys, str(tmp_path), "--view", view)
    assert found["code"] in ("USE-004", "CAL-006")
    assert "bracket" not in found["message"] or view == "panorama"


@pytest.mark.parametrize("scale", ["nan", "inf"])
def test_a_scale_that_is_no_number_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str], scale: str) -> None:
    assert "--scale" in error(capsys, exr(tmp_path / "p.exr"), "--scale", scale)["message"]


@pytest.mark.parametrize("task", ["0,0,1e9", "0,0,0", "200,0,10", "0,-91,10"])
def test_a_task_zone_lies_on_the_sphere(tmp_path: Path, capsys: pytest.CaptureFixture[str], task: str) -> None:
    path = exr(tmp_path / "p.exr", size=(32, 32), white=1.0)
    assert said(capsys, path, *FISHEYE, "--task", "0,0,20")[0] == 0
    assert "--task" in error(capsys, path, *FISHEYE, "--task", task)["message"]


def test_a_task_without_glare_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    panorama = exr(tmp_path / "p.exr", white=1.0)
    relative = exr(tmp_path / "f.exr", size=(32, 32))
    for words in ((panorama,), (relative, *FISHEYE)):
        assert "--task" in error(capsys, *words, "--task", "0,0,20")["message"]


def test_a_region_is_what_lies_inside(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = exr(tmp_path / "p.exr")
    _, found = said(capsys, path, "--region", "-5,-5,10,10")
    assert found["figures"]["region-1-mean"]["value"] == pytest.approx(40)
    assert found["figures"]["region-1-p05"]["value"] == pytest.approx(40)
    assert "region-1-p95" in found["figures"]
    assert "is empty" in error(capsys, path, "--region", "-5,-5,0,0")["message"]


@pytest.mark.parametrize(
    ("level", "white", "words"),
    [
        (3e38, None, ()),
        (40.0, 3e38, ()),
        (1e-40, None, ()),
        (40.0, None, ("--scale", "1e300")),
        (40.0, None, ("--scale", "1e-300")),
    ],
)
def test_light_beyond_numbers_names_the_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], level: float, white: float | None, words: tuple[str, ...]
) -> None:
    found = error(capsys, exr(tmp_path / "far.exr", level=level, white=white), *words)
    assert found["code"] == "PIC-001"
    assert "far.exr" in found["where"]


def test_large_values_have_a_mean(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    _, found = said(capsys, exr(tmp_path / "p.exr", level=9e35))
    assert found["figures"]["picture-mean"]["value"] == pytest.approx(9e35)
    assert all(math.isfinite(one["value"]) for one in found["figures"].values())


def test_factors_of_a_lens_may_not_carry_it_too_far(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    cal = tmp_path / "far.cal"
    cal.write_text("".join(f"{c}o={'9' * 38}*{c}i(1);" for c in "rgb"))
    path = exr(tmp_path / "p.exr", size=(32, 32))
    assert error(capsys, path, *FISHEYE, "--cal", str(cal))["where"] == "--cal"


def test_options_that_would_do_nothing_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, response = exr(tmp_path / "p.exr", size=(32, 32)), tmp_path / "camera.rsp"
    response.write_text("2 0.9 0.05 0.001\n" * 3)
    assert "both" in error(capsys, path, *FISHEYE, "--scale", "2", "--reading", "80@16,16")["message"]
    assert "folder" in error(capsys, path, *FISHEYE, "--response", str(response))["message"]


def test_a_view_of_another_kind_is_no_panorama(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A picture of rpict that happens to be twice as wide as high."""
    image = luminance_image(np.full((32, 64, 3), 30.0))
    write_radiance_hdr(tmp_path / "p.hdr", replace(image, geometry=Perspective(64, 32, 1.2)))
    assert "-vtv" in error(capsys, str(tmp_path / "p.hdr"))["message"]
    assert said(capsys, str(tmp_path / "p.hdr"), "--view", "panorama")[0] == 0


def frames(folder: Path, **said_of_last: object) -> Path:
    """Return a folder of three frames with settings in EXIF, of which the last has others."""
    folder.mkdir()
    for k in range(3):
        exif, more = Image.Exif(), said_of_last if k == 2 else {}
        exif[0x0110], exif[0x0112] = more.get("model", "Cam"), more.get("orientation", 6)
        times = {0x829A: IFDRational(1, 4**k), 0x829D: IFDRational(28, 10), 0x8827: more.get("iso", 100)}
        exif.get_ifd(0x8769).update(times)
        Image.new("RGB", (64, 32), (9 * k,) * 3).save(folder / f"{k}.jpg", exif=exif)
    (folder / "._0.jpg").write_bytes(b"of the system")
    return folder


def test_only_the_time_differs_within_a_bracket(tmp_path: Path) -> None:
    found = taken_frames(frames(tmp_path / "good", orientation=1))
    assert [(one.time_s, one.f_number, one.iso, one.turns) for one in found] == [
        (1.0, 2.8, 100.0, 3),
        (0.25, 2.8, 100.0, 3),
        (0.0625, 2.8, 100.0, 0),
    ]
    for number, said in enumerate(({"iso": 400}, {"model": "Another"})):
        with pytest.raises(BracketError, match=f"different {next(iter(said))}"):
            taken_frames(frames(tmp_path / f"bad{number}", **said))


def test_a_speed_beyond_its_field_is_not_known(tmp_path: Path) -> None:
    with pytest.raises(BracketError, match=r"2\.jpg.*no time, aperture or speed"):
        taken_frames(frames(tmp_path / "fast", iso=65535))


def test_frames_in_other_colours_are_noted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """As the import does: their numbers are taken as sRGB."""
    x, y = np.meshgrid(np.linspace(-1.2, 1.2, 240), np.linspace(-1.2, 1.2, 240))
    cells = np.repeat(np.repeat(2 ** np.random.default_rng(5).uniform(0, 9, (20, 20)), 12, 0), 12, 1)
    profiles = {"srgb": None, "adobe": None, "profile": profile("Adobe RGB (1998)", ADOBE_XYZ, 2.2)}
    for name, own in profiles.items():
        (tmp_path / name).mkdir()
        for k in range(7):
            shown = srgb_of_linear(np.minimum(np.where(np.hypot(x, y) < 1, cells, 0) * 4.0**-k * 0.02, 1))
            exif = Image.Exif()
            exif.get_ifd(0x8769).update({0x829A: IFDRational(1, 4**k), 0x829D: IFDRational(28, 10), 0x8827: 100})
            if name == "adobe":
                exif.get_ifd(0x8769)[0xA005] = {1: "R03"}
            Image.fromarray(shown).convert("RGB").save(
                tmp_path / name / f"{k}.jpg", exif=exif, quality=97, icc_profile=own
            )
    for name in ("adobe", "profile"):
        code, answer = said(capsys, str(tmp_path / name), "--view", "fisheye,equidistant,180")
        assert code == 0
        assert "not sRGB's" in answer["left_out"]["colour profile"]
    left_out = said(capsys, str(tmp_path / "srgb"), "--view", "fisheye,equidistant,180")[1]["left_out"]
    assert left_out.keys() == {"movement"}
