"""The certificate: its budget is the illuminance's own uncertainty, part by part."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

import daylit
from benchmarks.sessions import Taken, write_session
from mocks.worlds.simple_room import SimpleRoom
from processing.calibration.scale.photometry import illuminance_lx
from processing.calibration.scale.veiling_glare import unmeasured_modes
from processing.figures.certificate import DETECTED, NOT_DETERMINED, RECTIFICATION, certificate
from processing.pictures.exr import write_exr
from processing.pictures.images import LuminanceImage
from processing.pictures.modes import seam_mode, widened
from processing.sphere import Equirectangular
from station.session.session import Side
from tests.processing.finished import finish_all

SIZE = (80, 40)
CALIBRATION = {
    "indoor": {"k1_parts": {"meter": 0.012, "spot": 0.005}, "meter_drift_frac": 0.002, "spectral_mismatch": 0.043},
}
MERGED = {"indoor": {"offset_stops": [0.01, 0.0, -0.02]}}


def picture(*, veil: bool = True) -> LuminanceImage:
    level = np.geomspace(0.01, 1000, SIZE[0], dtype=np.float32)
    light = np.broadcast_to(level[None, :, None], (SIZE[1], SIZE[0], 3)).copy()
    doubt = np.broadcast_to((0.01 + 0.1 / level)[None], SIZE[::-1]).astype(np.float32)
    image = LuminanceImage(light, doubt, np.zeros(SIZE[::-1], np.uint8), Equirectangular(*SIZE), 0.013)
    return widened(image, [*unmeasured_modes(image), seam_mode(None)]) if veil else image


def test_the_budget_adds_up_to_the_illuminances_own_uncertainty() -> None:
    image = picture()
    found = certificate({"indoor": image}, CALIBRATION, MERGED)
    [budget] = found["budgets"]
    light = illuminance_lx(image)
    assert budget["value"] == light.value_lx
    rows = {row["cause"]: row["relative_uncertainty"] for row in budget["rows"]}
    assert {"meter", "spot", "noise", "stray light", "stitching", "rectification"} <= set(rows)
    stated = np.hypot(light.uncertainty_lx / light.value_lx, RECTIFICATION)
    assert budget["combined_relative"] == pytest.approx(stated, rel=1e-6)
    assert budget["expanded"] == pytest.approx(2 * stated * light.value_lx, rel=1e-6)


def test_indices_that_a_session_shows_and_those_that_it_cannot() -> None:
    image = picture(veil=False)
    found = {row["index"]: row for row in certificate({"indoor": image}, CALIBRATION, MERGED)["indices"]}
    assert found["indoor: f3 (linearity)"]["value"] == pytest.approx(1 - 2**-0.02)
    assert found["indoor: f11 (change of range)"]["value"] == pytest.approx(1 - 2**-0.02)
    limit = found["indoor: limit of detection"]["value"]
    assert 0.1 / DETECTED / 2 < limit < 2 * 0.1 / DETECTED
    assert found["indoor: spectral mismatch"]["value"] == 0.043
    assert all(found[name]["value"] is None for name in NOT_DETERMINED)


def test_repeatability_and_limit_of_detection_are_of_noise_alone() -> None:
    """What all pixels share is in the budget; a repetition has it again."""
    found = []
    for image in (picture(veil=False), picture()):
        rows = certificate({"indoor": image}, CALIBRATION, MERGED)["indices"]
        found.append([row["value"] for row in rows if row["index"].endswith(("repeatability", "limit of detection"))])
    assert np.median(picture().uncertainty) > 1.1 * np.median(picture(veil=False).uncertainty)
    assert found[1] == pytest.approx(found[0], rel=1e-3)


def test_every_index_of_the_standard_is_found_or_named() -> None:
    """F1 to f8 and f11 of ISO/CIE 19476, as far as a luminance camera has them."""
    said = " ".join(row["index"] for row in certificate({"indoor": picture()}, CALIBRATION, MERGED)["indices"])
    assert {
        name for name in ("f1'", "f2", "f3", "f4", "f5", "f6", "f7", "f8", "f11") if f"{name} (" not in said
    } == set()


def limit_of_detection(image: LuminanceImage) -> float | None:
    rows = certificate({"outdoor": image}, {"outdoor": {"k2_source": "k2"}}, {})["indices"]
    return {row["index"]: row["value"] for row in rows}["outdoor: limit of detection"]


def test_the_unsure_edge_of_a_sun_is_no_limit_of_detection() -> None:
    image = picture(veil=False)
    image.rgb[0, :3], image.uncertainty[0, :3] = 1e8, 0.7
    assert 0.1 < limit_of_detection(image) < 1.0
    image.uncertainty[:] = 0.5
    assert limit_of_detection(image) is None


def test_the_command_writes_page_and_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    session = write_session(tmp_path / "room", Taken(SimpleRoom(3), 32, (Side.INDOOR,)))
    assert daylit.main(["certificate", str(tmp_path / "room")]) == 2
    stages = tmp_path / "room" / "stages"
    (stages / "calibrate").mkdir(parents=True)
    write_exr(stages / "calibrate" / "indoor.exr", picture())
    (stages / "calibrate" / "calibration.json").write_text(json.dumps(CALIBRATION))
    finish_all(tmp_path / "room", merge=MERGED)
    capsys.readouterr()
    assert daylit.main(["certificate", str(tmp_path / "room"), "--json"]) == 0, session
    answer = json.loads(capsys.readouterr().out)
    page = Path(answer["page"]).read_text("utf-8")
    assert "not determined" in page
    assert f"{answer['budgets'][0]['value']:.4g}" in page
    assert json.loads((tmp_path / "room" / "certificate" / "certificate.json").read_text())["version"] == 1


@pytest.fixture(scope="module")
def once_calibrated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A session with both sides calibrated, as its stages leave it; tests change copies."""
    session = tmp_path_factory.mktemp("calibrated") / "room"
    write_session(session, Taken(SimpleRoom(3), 32, (Side.INDOOR,)))
    (session / "stages" / "calibrate").mkdir(parents=True)
    for side in Side:
        write_exr(session / "stages" / "calibrate" / f"{side}.exr", picture())
    facts = {**CALIBRATION, "outdoor": {"k2_source": "calibration", "k2_relative_uncertainty": 0.01}}
    (session / "stages" / "calibrate" / "calibration.json").write_text(json.dumps(facts))
    finish_all(session, merge=MERGED)
    return session


@pytest.fixture
def calibrated(once_calibrated: Path, tmp_path: Path) -> Path:
    return shutil.copytree(once_calibrated, tmp_path / "room")


def test_a_certificate_after_clean_is_the_same(calibrated: Path, capsys: pytest.CaptureFixture[str]) -> None:
    said = []
    for _ in range(2):
        assert daylit.main(["certificate", str(calibrated), "--json"]) == 0
        said.append(capsys.readouterr().out)
        assert daylit.main(["clean", str(calibrated)]) == 0
        capsys.readouterr()
    assert not (calibrated / "stages" / "merge").exists()
    assert said[0] == said[1]


def test_a_session_that_was_cleaned_without_a_record_says_what_to_run(
    calibrated: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.rmtree(calibrated / "stages" / "merge")
    assert daylit.main(["certificate", str(calibrated)]) == 5
    said = capsys.readouterr().err
    assert "stages/merge" in said
    assert f"daylit process {calibrated}" in said


@pytest.mark.parametrize("text", ["garbage", "{}", "null", "[]", '{"metrics": {}}'])
@pytest.mark.parametrize("file", ["calibrate/calibration.json", "calibrate/result.json", "merge/result.json"])
def test_damaged_facts_are_a_typed_error(
    calibrated: Path, file: str, text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (calibrated / "stages" / file).write_text(text)
    assert daylit.main(["certificate", str(calibrated)]) == 5
    said = capsys.readouterr().err
    assert Path(file).name in said
    assert f"--force {Path(file).parent}" in said
    assert not (calibrated / "certificate").exists()


@pytest.mark.parametrize("side", Side)
@pytest.mark.parametrize("gone", [False, True])
def test_no_certificate_of_one_side_where_the_others_picture_is_damaged_or_gone(
    calibrated: Path, side: Side, gone: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    path = calibrated / "stages" / "calibrate" / f"{side}.exr"
    path.unlink() if gone else path.write_bytes(path.read_bytes()[:-9])
    assert daylit.main(["certificate", str(calibrated)]) == 5
    assert f"{side}.exr" in capsys.readouterr().err
