"""What ``import daylit`` offers: light to import, documented, and as the examples use it."""

from __future__ import annotations

import inspect
import json
import runpy
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import daylit
from processing.errors import ParameterError
from station.capture.rig import SIZE_STEPS
from station.errors import SessionNotFoundError
from tests.once import PURE, each_once, fewer_patches

ROOT = Path(__file__).resolve().parents[2]


def test_public_names_are_sorted_and_importing_them_is_lazy() -> None:
    assert daylit.__all__ == sorted(daylit.__all__)
    assert set(daylit.__all__) <= set(dir(daylit))
    assert all(hasattr(daylit, name) for name in daylit.__all__)
    with pytest.raises(AttributeError, match="nonsense"):
        daylit.nonsense  # noqa: B018 (it is the access that counts)
    code = "import sys, daylit; assert not {'numpy', 'pydantic', 'processing', 'station'} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60)


@pytest.mark.parametrize("name", [n for n in daylit.__all__ if inspect.isfunction(getattr(daylit, n))])
def test_functions_say_what_they_take_and_show_how(name: str) -> None:
    text = inspect.getdoc(getattr(daylit, name)) or ""
    assert "Example" in text
    for parameter in inspect.signature(getattr(daylit, name)).parameters:
        assert parameter in text or len(text.splitlines()) < 12, f"{name} does not explain {parameter}"


def test_the_reference_page_is_up_to_date() -> None:
    page = runpy.run_path(str(ROOT / "docs" / "make_api.py"))["page"]()
    assert (ROOT / "docs" / "reference" / "api.md").read_text("utf-8") == page, "run python docs/make_api.py"


@pytest.fixture
def session(tmp_path: Path) -> daylit.Session:
    from processing.running.panorama_session import panorama_session

    rgb = np.random.default_rng(1).integers(60, 200, (64, 128, 3), dtype=np.uint8)
    Image.fromarray(rgb).save(tmp_path / "room.png")
    return daylit.open_session(str(panorama_session(tmp_path / "room.png", tmp_path / "sessions")))


def test_a_session_is_processed_read_and_shown(session: daylit.Session) -> None:
    report = daylit.process(session, until="calibrate", k1=2.0)
    assert [stage.stage for stage in report.stages] == ["verify", "merge", "calibrate"]
    assert set(session.stages) == {"verify", "merge", "calibrate"}
    picture = daylit.read_picture(session / "stages" / "calibrate" / "indoor.exr")
    assert isinstance(picture, daylit.LuminanceImage)
    assert picture.unit == "cd/m2"
    assert picture.luminance_cd_m2().shape == picture.uncertainty.shape == (64, 128)
    for shown, words in ((session, "indoor.exr"), (report, "calibrate"), (picture, "128 x 64, equirectangular")):
        assert words in shown._repr_html_()
    dry = daylit.process(session.path, "calibrate", k1=2.0, dry_run=True)
    assert {stage.action.value for stage in dry.stages} == {"skipped"}


def test_options_and_folders_that_are_none_are_named_errors(session: daylit.Session, tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match="no such option: --k9"):
        daylit.process(session, k9=1)
    with pytest.raises(SessionNotFoundError):
        daylit.open_session(tmp_path / "nothing")


def test_furniture_is_arranged_in_a_plan(tmp_path: Path) -> None:
    plan = tmp_path / "plan.json"
    corners = "[[0, 0], [4, 0], [4, 3.5], [0, 3.5]]"
    plan.write_text(f'{{"polygon": {corners}, "openings": [{{"kind": "door", "edge": 0, "t0": 0.3, "t1": 1.2}}]}}')
    found = daylit.arrange(plan, "bed, nightstand", alternatives=2)
    assert [item.category for item in found.arrangements[0].items] == ["bed", "nightstand"]
    assert "bed" in {item.category for item in daylit.arrange(str(plan), "bedroom").arrangements[0].items}


def test_the_examples_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """Script and notebook photograph the same room: what follows from their equal frames is worked out once."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(SIZE_STEPS, "small", 32)
    with each_once(PURE), fewer_patches():
        run_the_examples(capsys)


def run_the_examples(capsys: pytest.CaptureFixture[str]) -> None:
    assert runpy.run_path(str(ROOT / "examples" / "first_room.py"))["main"]() == 0
    printed = capsys.readouterr().out
    assert "18 frames" in printed
    assert "cd/m2" in printed
    notebook = json.loads((ROOT / "examples" / "first_room.ipynb").read_text("utf-8"))
    names: dict[str, object] = {}
    for cell in notebook["cells"]:
        if cell["cell_type"] == "code":
            assert not cell["outputs"], "a notebook is kept without outputs"
            exec("".join(cell["source"]), names)  # our own notebook
    assert "cd/m2; " in capsys.readouterr().out
