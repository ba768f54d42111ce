"""Raw files: a bracket of them beside or without JPEGs, by the command, against the light behind it."""

from __future__ import annotations

import io
import json
import struct
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

import daylit
from benchmarks.hostile.worlds import MATRIX_5D2, TIMES_S, HostileBracket, HostileCamera, HostileWorld, hostile_bracket
from processing.errors import PictureFileError
from processing.pictures.exr import read_exr
from processing.pictures.frames import RawFrame
from processing.pictures.images import RelativeImage, luminance_cd_m2
from processing.pictures.mosaic import saturation
from station.session.store import load_manifest
from tests.station.frames.pictures import exif

SIZE = (384, 192)


def light() -> np.ndarray:
    """A wall of patches and edges from 1 to 20,000, with a little colour (H, W, 3)."""
    rng = np.random.default_rng(3)
    parts = np.exp(rng.uniform(0, np.log(20_000), (12, 24, 1))) * rng.uniform(0.7, 1.3, (12, 24, 3))
    return np.repeat(np.repeat(parts, 16, axis=0), 16, axis=1).astype(np.float32)


def makers_camera() -> HostileCamera:
    codes = np.linspace(0, 1, 256)
    return HostileCamera(
        codes,
        np.stack([codes ** (1 / g) for g in (2.0, 2.2, 2.3)]),
        prnu=0.004,
        hot_share=0.0005,
        matrix=MATRIX_5D2,
        mosaic=True,
        denoise=True,
        sharpen=0.3,
        jpeg=("opencv", 93, "4:2:2"),
        seed=7,
    )


@pytest.fixture(scope="module")
def bracket() -> HostileBracket:
    return hostile_bracket(
        HostileWorld("a camera", makers_camera(), jitter_stops=0.05), light(), 20.0, 900_004, raw=True
    )


def folder(bracket: HostileBracket, into: Path, *kinds: str) -> Path:
    """Write what a card holds: .jpg, .dng or both of each frame."""
    into.mkdir()
    for k, time_s in enumerate(TIMES_S):
        if "dng" in kinds:
            (into / f"img{k}.dng").write_bytes(bracket.raw[k])
        if "jpg" in kinds:
            buffer = io.BytesIO()
            Image.fromarray(bracket.frames[k]).save(buffer, "JPEG", quality=95, exif=exif(time_s))
            (into / f"img{k}.jpg").write_bytes(buffer.getvalue())
    return into


def merged(capsys: pytest.CaptureFixture[str], at: Path, *options: str) -> tuple[RelativeImage, dict, Path]:
    def call(*arguments: str) -> dict:
        capsys.readouterr()
        assert daylit.main([*arguments, "--json"]) in (0, None), capsys.readouterr()
        found: dict = json.loads(capsys.readouterr().out)
        return found

    session = Path(call("import", "raw", "--indoor", str(at), "--into", str(at.parent / "s"))["session"])
    call("process", str(session), "--until", "merge", *options)
    image = read_exr(session / "stages/merge/indoor.exr")
    assert isinstance(image, RelativeImage)
    result = json.loads((session / "stages/merge/result.json").read_text())
    return image, result, session


def stops_off(image: RelativeImage, bracket: HostileBracket) -> tuple[np.ndarray, np.ndarray]:
    """Return the difference from the truth where pixels are valid, free of the scale, and their uncertainty."""
    good = image.validity == 0
    assert good.mean() > 0.98
    off = np.log2(luminance_cd_m2(image.rgb)[good] / luminance_cd_m2(bracket.radiance)[good])
    return off - np.median(off), np.asarray(image.uncertainty[good]) / np.log(2)


def test_raw_files_come_first_and_are_nearer_the_truth(
    bracket: HostileBracket, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    both = folder(bracket, tmp_path / "card", "jpg", "dng")
    raw, result, session = merged(capsys, both)
    assert result["metrics"]["indoor"]["response_source"] == "linear"
    off, sigma = stops_off(raw, bracket)
    jpeg, result, _ = merged(capsys, both, "--frames", "jpeg")
    assert result["metrics"]["indoor"]["response_source"] == "recovered"
    assert np.median(np.abs(off)) < np.median(np.abs(stops_off(jpeg, bracket)[0])) / 1.7
    assert np.mean(np.abs(off) < 1.96 * sigma) > 0.9
    # Colours: the camera's matrix is undone.
    tint = raw.rgb / bracket.radiance
    assert np.median(np.abs(tint / np.median(tint) - 1), axis=(0, 1)).max() < 0.02
    assert load_manifest(session).bracket.raw_sides == ("indoor",)


def recoloured(dng: bytes, *, singular: bool) -> bytes:
    """Return a DNG with another colour matrix: its first row twice, or its rows exchanged."""
    entry = dng.index(struct.pack("<HHI", 50721, 10, 9))
    (at,) = struct.unpack_from("<I", dng, entry + 8)
    rows = [dng[at + 24 * k : at + 24 * (k + 1)] for k in range(3)]
    return dng[:at] + rows[0] + (rows[0] + rows[2] if singular else rows[2] + rows[1]) + dng[at + 72 :]


@pytest.mark.parametrize(("singular", "why"), [(True, "colours are unknown"), (False, "not those of the first")])
def test_raw_files_of_other_or_impossible_colours_leave_the_jpegs(
    bracket: HostileBracket, tmp_path: Path, capsys: pytest.CaptureFixture[str], *, singular: bool, why: str
) -> None:
    some = range(len(TIMES_S)) if singular else (4,)
    raw = tuple(recoloured(one, singular=singular) if k in some else one for k, one in enumerate(bracket.raw))
    _, result, session = merged(capsys, folder(replace(bracket, raw=raw), tmp_path / "card", "jpg", "dng"))
    assert result["metrics"]["indoor"]["response_source"] == "recovered"
    assert why in result["left_out"]["indoor raw files"]
    assert daylit.main(["process", str(session), "--until", "merge", "--frames", "raw"]) != 0


def test_raw_files_alone_are_a_session(
    bracket: HostileBracket, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    image, _, session = merged(capsys, folder(bracket, tmp_path / "card", "dng"))
    manifest = load_manifest(session)
    assert {f.format for f in manifest.frames} == {"dng"}
    assert (manifest.frames[0].width_px, manifest.frames[0].height_px) == SIZE
    assert [f.camera_s for f in manifest.frames] == pytest.approx(TIMES_S)
    assert manifest.missing_stops(manifest.frames[0].side) == ()
    assert np.median(np.abs(stops_off(image, bracket)[0])) < 0.01
    assert daylit.main(["verify", str(session), "--look"]) == 0


def test_raw_files_of_another_size_leave_the_jpegs(
    bracket: HostileBracket, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    small = HostileBracket(
        tuple(np.ascontiguousarray(f[::2, ::2]) for f in bracket.frames), TIMES_S, bracket.radiance, False, bracket.raw
    )
    card = folder(small, tmp_path / "card", "jpg", "dng")
    _, result, session = merged(capsys, card)
    assert "192 x 96" in result["left_out"]["indoor raw files"]
    assert daylit.main(["process", str(session), "--until", "merge", "--frames", "raw"]) != 0
    assert "192 x 96" in capsys.readouterr().err


def test_a_raw_file_that_breaks_leaves_the_jpegs_and_says_so(
    bracket: HostileBracket, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    decode = RawFrame.decode

    def broken(frame: RawFrame, reduce: int = 1) -> np.ndarray:
        if frame.name.endswith("03_1-15s.dng"):
            raise PictureFileError("it is damaged", where=frame.name)
        return decode(frame, reduce)

    monkeypatch.setattr(RawFrame, "decode", broken)
    _, result, session = merged(capsys, folder(bracket, tmp_path / "card", "jpg", "dng"))
    assert result["metrics"]["indoor"]["response_source"] == "recovered"
    assert len(result["metrics"]["indoor"]["frames"]) == len(TIMES_S)
    assert "03_1-15s.dng" in result["left_out"]["indoor raw files"]
    assert any("from JPEGs" in w["message"] and "03_1-15s.dng" in w["message"] for w in result["warnings"])
    assert daylit.main(["process", str(session), "--until", "merge", "--frames", "raw"]) != 0
    assert "03_1-15s.dng" in capsys.readouterr().err


def restated(dng: bytes, share: float) -> bytes:
    """Return a DNG that states a white level of which its wells saturate at this share."""
    entry = dng.index(struct.pack("<HHI", 50717, 3, 1)) + 8
    black = dng.index(struct.pack("<HHI", 50714, 3, 1)) + 8
    (white,), (level,) = (struct.unpack_from("<H", dng, at) for at in (entry, black))
    return dng[:entry] + struct.pack("<H", round(level + (white - level) / share)) + dng[entry + 2 :]


def test_wells_that_saturate_below_the_stated_white_level_are_found(
    bracket: HostileBracket, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """As some speeds of cameras do: the light is the same, and so is its unit's meaning."""
    plain, _, _ = merged(capsys, folder(bracket, tmp_path / "card", "dng"))
    (tmp_path / "other").mkdir()
    raw = tuple(restated(one, 0.81) for one in bracket.raw)
    found, result, _ = merged(capsys, folder(replace(bracket, raw=raw), tmp_path / "other" / "card", "dng"))
    assert not any("against its time" in one["message"] for one in result["warnings"])
    assert found.validity.mean() == pytest.approx(plain.validity.mean(), abs=0.002)
    good = (found.validity == 0) & (plain.validity == 0)
    ratio = luminance_cd_m2(found.rgb)[good] / luminance_cd_m2(plain.rgb)[good]
    np.testing.assert_allclose(np.quantile(ratio, (0.01, 0.5, 0.99)), 0.81, rtol=0.01)


def opened(wells: np.ndarray, stated: list[int] | None = None) -> SimpleNamespace:
    return SimpleNamespace(
        raw_image_visible=np.minimum(wells, 15_600).round().astype(np.uint16),
        black_level_per_channel=[1024] * 4,
        white_level=15_600,
        camera_white_level_per_channel=stated,
    )


def test_only_piles_of_wells_are_saturation() -> None:
    """Photons scatter the wells of an even surface; those that are full are alike."""
    rng = np.random.default_rng(0)
    light = np.exp(rng.uniform(np.log(30), np.log(60_000), (200, 1000)))
    wells = rng.normal(light, np.sqrt(light)) + 1024
    assert saturation(opened(wells)) == 1
    assert saturation(opened(np.minimum(wells, 12_700))) == pytest.approx((12_700 - 1024) / (15_600 - 1024))
    assert saturation(opened(np.minimum(wells, 12_700) + rng.normal(0, 8, wells.shape))) == pytest.approx(0.8, abs=0.01)
    assert saturation(opened(wells, [13_000, 13_100, 13_000, 0])) == pytest.approx((13_000 - 1024) / (15_600 - 1024))
    assert saturation(opened(np.minimum(wells, 12_700), [13_000] * 4)) < 0.802
    wall = np.full(wells.shape, 9000.0)
    assert saturation(opened(rng.normal(wall, np.sqrt(wall)) + 1024)) == 1
    assert saturation(opened(rng.normal(0 * wall, 3) + 1024)) == 1, "a dark frame"
    few = wells * (wells < 3000)
    few[::10, ::20] = 12_700
    few[5:, :] *= few[5:, :] < 12_700
    assert saturation(opened(few)) == 1, "hot wells"
    assert saturation(opened(np.full((4, 4), 12_700.0))) == 1, "no picture"
