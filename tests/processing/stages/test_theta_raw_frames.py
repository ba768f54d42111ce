"""A panorama camera's DNGs beside its JPEGs, by the command: stitched by ours, nearer the truth; the JPEGs else."""

from __future__ import annotations

import io
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import daylit
from benchmarks.hostile.two_lenses import two_lens_bracket
from benchmarks.hostile.worlds import TIMES_S, HostileBracket
from mocks.optics.lenses import TwoFisheyes
from processing.pictures.exr import read_exr
from processing.pictures.images import LuminanceImage, RelativeImage, luminance_cd_m2
from processing.pictures.modes import SEAM_KEY, modes_of
from tests.processing.calibration.merge.test_two_lenses import HEIGHT, room
from tests.processing.stages.test_raw_frames import makers_camera
from tests.station.frames.pictures import exif


@pytest.fixture(scope="module")
def bracket() -> HostileBracket:
    return two_lens_bracket(makers_camera(), 100 * room(), TwoFisheyes(gains=(1.0, 1.05)), 900_011)


def session(bracket: HostileBracket, at: Path, capsys: pytest.CaptureFixture[str], *kinds: str) -> Path:
    """Import what the camera's card holds: .jpg, .dng or both of each frame."""
    (at / "card").mkdir(parents=True)
    for k, time_s in enumerate(TIMES_S):
        if "dng" in kinds:
            (at / "card" / f"R001000{k}.DNG").write_bytes(bracket.raw[k])
        if "jpg" in kinds:
            buffer = io.BytesIO()
            block = exif(time_s, (2 * HEIGHT, HEIGHT), MAKE="RICOH", MODEL="RICOH THETA Z1")
            Image.fromarray(bracket.frames[k]).save(buffer, "JPEG", quality=95, exif=block)
            (at / "card" / f"R001000{k}.JPG").write_bytes(buffer.getvalue())
    capsys.readouterr()
    assert daylit.main(["import", "theta", "--indoor", str(at / "card"), "--into", str(at / "s"), "--json"]) in (
        0,
        None,
    )
    return Path(json.loads(capsys.readouterr().out)["session"])


def result(at: Path, *options: str) -> dict:
    assert daylit.main(["process", str(at), "--until", "merge", *options, "--json"]) in (0, None)
    found: dict = json.loads((at / "stages/merge/result.json").read_text())
    return found


def stops_off(at: Path, bracket: HostileBracket) -> np.ndarray:
    image = read_exr(at / "stages/merge/indoor.exr")
    assert isinstance(image, RelativeImage)
    good = image.validity == 0
    assert good.mean() > 0.97
    off = np.log2(luminance_cd_m2(image.rgb)[good] / luminance_cd_m2(bracket.radiance)[good])
    return np.asarray(np.abs(off - np.median(off)))


def test_dngs_are_stitched_and_nearer_the_truth_than_the_jpegs(
    bracket: HostileBracket, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    at = session(bracket, tmp_path, capsys, "jpg", "dng")
    found = result(at)
    assert found["metrics"]["indoor"]["response_source"] == "linear"
    lenses = found["metrics"]["indoor"]["lenses"]
    assert lenses["second_stops"] == pytest.approx(np.log2(1.05), abs=0.01)
    assert lenses["off_deg"] < 0.3
    raw = np.median(stops_off(at, bracket))
    # The seam's uncertainty is the measured one from here on.
    assert daylit.main(["process", str(at), "--until", "calibrate", "--k1", "2"]) in (0, None)
    picture = read_exr(at / "stages/calibrate/indoor.exr")
    assert isinstance(picture, LuminanceImage)
    [seam] = [mode for mode in modes_of(picture) if mode.name == "stitching"]
    assert seam.values == pytest.approx((-lenses["seam_sigma"], lenses["seam_sigma"]))
    assert picture.attributes[SEAM_KEY] == lenses["seam_sigma"]
    assert result(at, "--frames", "jpeg")["metrics"]["indoor"]["response_source"] == "recovered"
    assert raw < np.median(stops_off(at, bracket)) / 1.7


def test_dngs_of_another_moment_leave_the_jpegs_and_say_so(
    bracket: HostileBracket, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    turned = two_lens_bracket(makers_camera(), 100 * room()[:, ::-1], TwoFisheyes(gains=(1.0, 1.05)), 900_011)
    at = session(replace(bracket, raw=turned.raw), tmp_path, capsys, "jpg", "dng")
    found = result(at)
    assert found["metrics"]["indoor"]["response_source"] == "recovered"
    why = found["left_out"]["indoor raw files"]
    assert "do not match its panorama" in why or "fit its panorama" in why
    assert any("from JPEGs" in warning["message"] for warning in found["warnings"])
    assert daylit.main(["process", str(at), "--until", "merge", "--frames", "raw"]) != 0
    assert why.partition(":")[0][:30] in capsys.readouterr().err
