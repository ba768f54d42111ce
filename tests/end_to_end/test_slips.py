"""What a new user's slips lead to: a message that names them, at once, and nothing left behind."""

from __future__ import annotations

import errno
import json
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import daylit
from processing.figures import figures
from station.session import durable

Ran = Callable[..., tuple[int, str]]
PLAN = {
    "polygon": [[0, 0], [4, 0], [4, 3], [0, 3]],
    "openings": [{"kind": "door", "edge": 0, "t0": 0.2, "t1": 1.1, "hinge": "left", "swing": "in"}],
}


@pytest.fixture
def ran(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Ran:
    """Return what runs a command in a folder of its own: its exit code, and all that it said."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments: str) -> tuple[int, str]:
        capsys.readouterr()
        code = daylit.main(list(arguments)) or 0
        said = capsys.readouterr()
        return code, said.out + said.err

    return run


@pytest.fixture(scope="module")
def processed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a session of one small grey panorama, without a room, up to its stills."""
    folder = tmp_path_factory.mktemp("one")
    Image.fromarray(np.full((128, 256, 3), 90, np.uint8)).save(folder / "grey.png")
    words = ["process", "--panorama", str(folder / "grey.png"), "--into", str(folder), "--quality", "draft"]
    assert not daylit.main([*words, "--until", "stills"])
    (session,) = folder.glob("*_grey")
    return session


@pytest.fixture
def session(processed: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(processed, tmp_path / "session"))


@pytest.fixture
def full(monkeypatch: pytest.MonkeyPatch) -> None:
    """No byte more fits on the disk."""

    def write_all(fd: int, data: bytes | memoryview) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(durable, "write_all", write_all)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--target", "400,0"), "--target"),
        (("--stops", "4,0"), "exposure time"),
        (("--every", "0m", "--until", "23:59"), "--every"),
        (("--every", "60m", "--until", "23:59", "--reading", "5"), "--reading"),
    ],
)
def test_a_capture_reads_its_options_before_a_room_is_rendered(
    ran: Ran, monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...], says: str
) -> None:
    import station.capture.rig

    def opened(*_: object, **__: object) -> None:
        raise AssertionError("the room was rendered first")

    monkeypatch.setattr(station.capture.rig, "open_named_rig", opened)
    code, said = ran("capture", "x", "--simulate", "bedroom-7", *words)
    assert code == 2
    assert says in said


def test_a_room_without_a_name_is_refused(ran: Ran, tmp_path: Path) -> None:
    assert ran("capture", " ", "--simulate", "room")[0] == 2
    (tmp_path / "frames").mkdir()
    code, said = ran("import", "", "--indoor", "frames")
    assert code == 2
    assert "empty" in said


def test_the_demo_refuses_an_unknown_set_before_it_captures(ran: Ran, tmp_path: Path) -> None:
    assert ran("demo", "--world", "room", "--set", "nonsense")[0] == 2
    assert not list(tmp_path.iterdir())


def test_days_that_no_calendar_has_are_refused_as_such(ran: Ran) -> None:
    for words in (
        ("plan", "--site", "40,-80", "--heading", "0"),
        ("relight", "x", "--sweep", "day"),
        ("dataset", "build", ".", "--name", "x", "--licence", "CC0-1.0"),
    ):
        code, said = ran(*words, "--date", "2023-02-30")
        assert code == 2, words
        assert "--date" in said
        assert "out of range for month" in said
    assert ran("plan", "--site", "40,-80", "--heading", "0", "--date", "2023-02-28")[0] == 0


def test_a_recording_that_is_not_there_is_no_damaged_line(ran: Ran) -> None:
    code, said = ran("doctor", "--simulate", "recorded:nowhere")
    assert code == 3
    assert "cannot be read" in said
    assert "line 0" not in said, "there is nothing to repair"


def test_a_sky_that_is_not_there_is_a_slip_of_usage(ran: Ran, session: Path) -> None:
    code, said = ran("relight", str(session), "--sky", "nowhere.exr")
    assert code == 2
    assert "--sky" in said


def test_furniture_that_there_is_not_is_named(ran: Ran) -> None:
    code, said = ran("furniture", "list", "--category", "spaceship")
    assert code == 2
    assert "sofa" in said
    assert ran("furniture", "export", "armchair/classic", "--rank", "2")[0] == 2


def test_stage_options_say_their_form(ran: Ran, session: Path) -> None:
    for flag, value, form in (("--eye-lens", "foo,180", "MAPPING"), ("--original-url", "not a url", "Web address")):
        code, said = ran("process", str(session), flag, value, "--dry-run")
        assert code == 2
        assert form in said
        assert "pattern" not in said
    code, said = ran("process", str(session), "--segmenter", "nowhere", "--dry-run")
    assert code == 2
    assert ": :" not in said
    assert "Value error" not in said


def test_without_a_journal_a_damaged_manifest_has_no_wrong_remedy(ran: Ran, session: Path) -> None:
    (session / "journal.jsonl").unlink()
    (session / "session.json").write_text("{}")
    code, said = ran("verify", str(session))
    assert code == 4
    assert "backup" in said


def test_a_certificate_in_relative_units_asks_for_a_scale(ran: Ran, session: Path) -> None:
    code, said = ran("certificate", str(session))
    assert code == 2
    assert "--k1" in said


def test_the_terminal_says_of_a_certificate_what_its_page_says(ran: Ran, tmp_path: Path) -> None:
    """What is clipped may be any brighter; the line left that out, and the page did not."""
    Image.fromarray(np.full((128, 256, 3), 255, np.uint8)).save(tmp_path / "white.png")
    assert ran("process", "--panorama", "white.png", "--k1", "10", "--until", "calibrate")[0] == 0
    (session,) = Path("sessions").iterdir()
    code, said = ran("certificate", str(session))
    assert code == 0
    page = (session / "certificate" / "index.html").read_text("utf-8")
    assert "a lower bound" in page
    assert page.count('<table class="long">') == page.count("<table") == 2, "tables that a phone shows whole"
    assert "a lower bound" in said


def test_figures_name_what_a_reason_is_of(ran: Ran, session: Path) -> None:
    picture = str(session / "stages" / "calibrate" / "indoor.exr")
    assert "glare: in relative units" in ran("figures", picture)[1]
    assert "glare: a panorama's depends" in ran("figures", picture, "--scale", "10")[1]
    code, said = ran("figures", picture, "--reading", "3")
    assert code == 2
    assert "'3'" in said


def test_stages_that_never_ran_are_named_as_such(ran: Ran, session: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(figures.write_glare_views.__kwdefaults__, "size_px", 32)
    code, said = ran("export", str(session), "--what", "exr,glare")
    assert code == 0
    assert "remove: " not in said or "has the stage run?" in said
    assert "absolute scale" in said, "evalglare would take relative units for cd/m2"


def test_stills_may_be_copied_to_where_they_are(ran: Ran, session: Path) -> None:
    own = session / "stages" / "stills"
    before = {path.name: path.read_bytes() for path in own.glob("*.jpg")}
    assert ran("stills", str(session), "--into", str(own))[0] == 0
    assert before
    assert {path.name: path.read_bytes() for path in own.glob("*.jpg")} == before


@pytest.mark.usefixtures("full")
def test_a_full_disk_leaves_no_cut_off_still(ran: Ran, session: Path) -> None:
    code, said = ran("stills", str(session), "--into", "copies")
    assert code == 6
    assert "copies" in said, "not the file that was copied"
    assert not list(Path("copies").iterdir())


@pytest.mark.usefixtures("full")
def test_a_full_disk_leaves_no_empty_arrangement(ran: Ran, tmp_path: Path) -> None:
    (tmp_path / "plan.json").write_text(json.dumps(PLAN))
    assert ran("arrange", "plan.json", "--items", "chest", "--no-pictures", "--into", "out")[0] == 6
    assert not list((tmp_path / "out").iterdir())


def test_a_full_disk_leaves_no_empty_rig_file(ran: Ran, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    real = durable.new_file

    class Full:
        def __init__(self, path: Path) -> None:
            self._file = real(path)

        def __enter__(self) -> Full:
            return self

        def __exit__(self, *_: object) -> None:
            self._file.close()

        def write(self, text: str) -> None:
            raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(durable, "new_file", Full)
    assert ran("doctor", "--write-rig", "rig.toml")[0] == 6
    assert not (tmp_path / "rig.toml").exists()
    monkeypatch.undo()
    monkeypatch.chdir(tmp_path)
    assert ran("doctor", "--write-rig", "rig.toml")[0] == 0
    assert ran("doctor", "--write-rig", "rig.toml")[0] == 2, "what is there stays"
