"""Brackets of PNGs and TIFFs: film scans and other programs' exports become sessions, damage is refused by name."""

from __future__ import annotations

import io
import json
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
import tifffile
from PIL import Image

import daylit
from processing.pictures.exr import read_exr
from station.errors import FrameRejectedError
from station.frames.check import FrameChecker
from station.session.session import Side
from station.session.store import load_manifest
from tests.station.frames.pictures import exif, jpeg, pixels, scene

STOPS_S = (4.0, 1.0, 1 / 4, 1 / 15, 1 / 60, 1 / 250)


@pytest.fixture(scope="module")
def checker() -> Iterator[FrameChecker]:
    with FrameChecker() as worker:
        yield worker


def picture(time_s: float, ending: str, *, with_exif: bool = True, **options: object) -> bytes:
    block = exif(time_s) if with_exif else None
    buffer = io.BytesIO()
    image = Image.fromarray(pixels(time_s))
    if ending == ".png":
        image.save(buffer, "PNG", **({"exif": block.tobytes()} if block else {}), **options)
    else:
        image.save(buffer, "TIFF", compression="tiff_lzw", **options)
    return buffer.getvalue()


def invoke(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, dict]:
    capsys.readouterr()
    code = daylit.main([*arguments, "--json"])
    return code, json.loads(capsys.readouterr().out)


@pytest.mark.parametrize(("ending", "options"), [(".png", []), (".tif", ["--shutter", "4,1,1/4,1/15,1/60,1/250"])])
def test_a_bracket_is_imported_verified_and_merged(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], ending: str, options: list[str]
) -> None:
    room = tmp_path / "scans"
    room.mkdir()
    for i, time_s in enumerate(STOPS_S):
        (room / f"scan{i}{ending}").write_bytes(picture(time_s, ending))
    code, answer = invoke(capsys, "import", "film", "--indoor", str(room), "--into", str(tmp_path / "s"), *options)
    assert (code, answer["frames"]) == (0, 6)
    session = Path(answer["session"])
    manifest = load_manifest(session)
    assert {f.format for f in manifest.frames} == {"png" if ending == ".png" else "tiff"}
    assert [f.camera_s for f in manifest.frames] == pytest.approx(STOPS_S)
    assert {Path(f.file).suffix for f in manifest.frames} == {ending}
    assert daylit.main(["verify", str(session), "--look"]) == 0
    assert daylit.main(["process", str(session), "--until", "merge"]) in (0, None)
    assert not manifest.bracket.raw_sides
    assert manifest.missing_stops(Side.INDOOR) == ()


def test_where_there_are_jpegs_the_others_are_left_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    room = tmp_path / "room"
    room.mkdir()
    for i, time_s in enumerate(STOPS_S):
        (room / f"{i}.jpg").write_bytes(jpeg(time_s))
    (room / "0.png").write_bytes(picture(4.0, ".png"))
    code, answer = invoke(capsys, "import", "r", "--indoor", str(room), "--into", str(tmp_path / "s"))
    assert (code, answer["ignored"]) == (0, ["indoor/0.png"])


def test_facts_of_a_png(checker: FrameChecker, tmp_path: Path) -> None:
    path = tmp_path / "a.png"
    path.write_bytes(picture(0.25, ".png"))
    facts = checker.inspect(path)
    assert (facts.width_px, facts.height_px, facts.exif.exposure_s, facts.exif.iso) == (160, 120, 0.25, 100)
    assert facts.mean_frac == pytest.approx(pixels(0.25).mean() / 255, abs=1e-6)


@pytest.mark.parametrize("ending", [".png", ".tif"])
@pytest.mark.parametrize("part", [0.0, 0.1, 0.5, 0.9, 0.999])
def test_a_file_cut_short_is_refused(checker: FrameChecker, tmp_path: Path, ending: str, part: float) -> None:
    data = picture(0.25, ending)
    path = tmp_path / f"a{ending}"
    path.write_bytes(data[: int(part * len(data))])
    with pytest.raises(FrameRejectedError):
        checker.inspect(path)


def test_every_flipped_byte_of_a_png_is_seen(checker: FrameChecker, tmp_path: Path) -> None:
    data, path = bytearray(picture(0.25, ".png")), tmp_path / "a.png"
    for at in np.random.default_rng(3).integers(0, len(data), 60):
        data[at] ^= 0x10
        path.write_bytes(data)
        with pytest.raises(FrameRejectedError):
            checker.inspect(path)
        data[at] ^= 0x10
    path.write_bytes(data)
    assert checker.inspect(path).width_px == 160


@pytest.mark.parametrize("ending", [pytest.param(".png", marks=pytest.mark.long), ".tif"])
def test_sixteen_bits_are_merged_at_eight_and_said_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], ending: str
) -> None:
    merged = []
    for deep in (False, True):
        room, options = tmp_path / f"{deep}", ["--shutter", "4,1,1/4,1/15,1/60,1/250"]
        room.mkdir()
        for i, time_s in enumerate(STOPS_S):
            codes = pixels(time_s)[..., ::-1].astype(np.uint16)
            # 100 more of 65,535 round to the same code.
            saved = np.minimum(codes * 257.0 + 100, 65535).astype(np.uint16) if deep else codes.astype(np.uint8)
            assert cv2.imwrite(str(room / f"{i}{ending}"), saved)
        code, answer = invoke(
            capsys, "import", "film", "--indoor", str(room), "--into", str(tmp_path / f"s{deep}"), *options
        )
        assert (code, answer["frames"]) == (0, 6)
        assert any("16 bits per channel" in one for one in answer["warnings"]) is deep
        assert daylit.main(["verify", answer["session"], "--look"]) == 0
        assert daylit.main(["process", answer["session"], "--until", "merge"]) in (0, None)
        image = read_exr(Path(answer["session"]) / "stages" / "merge" / "indoor.exr")
        merged.append(image.rgb)
    np.testing.assert_array_equal(*merged)


def test_sixteen_bits_that_are_light_itself_have_a_straight_line_for_a_curve(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    room, light = tmp_path / "linear", scene()
    room.mkdir()
    for i, time_s in enumerate(STOPS_S):
        saved = np.rint(65535 * np.clip(light * time_s, 0, 1)).astype(np.uint16)
        assert cv2.imwrite(str(room / f"{i}.tif"), saved[..., ::-1])
    _, answer = invoke(
        capsys, *("import", "developed", "--indoor", str(room), "--into", str(tmp_path / "s"), "--shutter"),
        "4,1,1/4,1/15,1/60,1/250",
    )  # fmt: skip
    assert daylit.main(["process", answer["session"], "--until", "merge"]) in (0, None)
    image = read_exr(Path(answer["session"]) / "stages" / "merge" / "indoor.exr")
    off = np.log2(image.rgb / light)[image.validity == 0]
    assert np.quantile(np.abs(off - np.median(off)), 0.95) < 0.05


@pytest.mark.parametrize("ending", [".png", ".tif"])
def test_other_files_are_refused_with_the_reason(checker: FrameChecker, tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"a{ending}"
    if ending == ".tif":
        for wrong, said in ((Image.new("LAB", (60, 40)), "RGB"), (Image.new("CMYK", (60, 40)), "RGB")):
            wrong.save(path)
            with pytest.raises(FrameRejectedError, match=said) as caught:
                checker.inspect(path)
            assert caught.value.details["reason"] == "unsupported"
        assert cv2.imwrite(str(path), np.ones((40, 60, 3), np.float32))
        with pytest.raises(FrameRejectedError, match="float32"):
            checker.inspect(path)
    path.write_bytes(jpeg(0.25))
    with pytest.raises(FrameRejectedError):
        checker.inspect(path)


@pytest.mark.parametrize("options", [{"planarconfig": "separate"}, {"photometric": "miniswhite"}])
def test_a_deep_tiff_that_the_decoder_misreads_is_refused(
    checker: FrameChecker, tmp_path: Path, options: dict[str, str]
) -> None:
    """Its channels one after the other, or 0 for white: in 8 bits OpenCV turns both, in 16 neither."""
    codes, path = pixels(0.25), tmp_path / "a.tif"
    shown = np.moveaxis(codes, 2, 0) if "planarconfig" in options else 255 - codes[..., 0]
    tifffile.imwrite(path, shown, **{"photometric": "rgb", **options})
    assert checker.inspect(path).mean_frac == pytest.approx(
        (codes if "planarconfig" in options else codes[..., 0]).mean() / 255, abs=1e-6
    )
    tifffile.imwrite(path, shown.astype(np.uint16) * 257, **{"photometric": "rgb", **options})
    with pytest.raises(FrameRejectedError, match="one after the other") as caught:
        checker.inspect(path)
    assert caught.value.details["reason"] == "unsupported"
