"""The certificate: its budget is the illuminance's own uncertainty, part by part."""

from __future__ import annotations

import json
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

SIZE = (80, 40)
CALIBRATION = {
    "indoor": {"k1_parts": {"meter": 0.012, "spot": 0.005}, "meter_drift_frac": 0.002},
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
    assert all(found[name]["value"] is None for name in NOT_DETERMINED)


def test_the_command_writes_page_and_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    session = write_session(tmp_path / "room", Taken(SimpleRoom(3), 32, (Side.INDOOR,)))
    assert daylit.main(["certificate", str(tmp_path / "room")]) == 2
    stages = tmp_path / "room" / "stages"
    (stages / "calibrate").mkdir(parents=True)
    (stages / "merge").mkdir()
    write_exr(stages / "calibrate" / "indoor.exr", picture())
    (stages / "calibrate" / "calibration.json").write_text(json.dumps(CALIBRATION))
    (stages / "merge" / "result.json").write_text(json.dumps({"metrics": MERGED}))
    capsys.readouterr()
    assert daylit.main(["certificate", str(tmp_path / "room"), "--json"]) == 0, session
    answer = json.loads(capsys.readouterr().out)
    page = Path(answer["page"]).read_text("utf-8")
    assert "not determined" in page
    assert f"{answer['budgets'][0]['value']:.4g}" in page
    assert json.loads((tmp_path / "room" / "certificate" / "certificate.json").read_text())["version"] == 1
