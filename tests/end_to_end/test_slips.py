"""What a new user's slips lead to: a message that names them, at once, and nothing left behind."""

from __future__ import annotations

import errno
import json
import os
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import daylit
from processing.batch import run as batch_run
from processing.exchange import inspection
from processing.figures import figures
from processing.layout.drawn.canvas import Sheet, write_sheet
from station.errors import DiskFullError
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
        (("--stops", "4,4"), "an exposure time is given twice"),
        (("--stops", "4,3.99"), "3.99 s beside 4 s: the same setting"),
        (("--every", "0m", "--until", "23:59"), "--every"),
        (("--every", "60m", "--until", "25:00"), "--until"),
        (("--every", "60m", "--until", "23:59", "--reading", "5"), "--reading"),
        (("--reading", "5", "--reading", "6", "--reading", "7"), "at most two readings"),
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


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
def test_a_pipe_is_refused_rather_than_waited_for(ran: Ran, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "room.jpg")
    for command in (("inspect", "room.jpg"), ("process", "--panorama", "room.jpg"), ("figures", "room.jpg")):
        code, said = ran(*command)
        assert code == 2
        assert "'room.jpg' is a pipe" in said
    code, said = ran("inspect", "x" * 300)
    assert code != 2, "a name that is too long is refused where it is opened"


def test_results_replace_neither_a_device_nor_a_file_of_another_kind(ran: Ran, tmp_path: Path) -> None:
    (tmp_path / "null").symlink_to(os.devnull)
    (tmp_path / "p.hdr").write_bytes(b"a picture")
    (tmp_path / "rig.toml").write_text("a rig")
    for words, says in (
        (("figures", "p.hdr", "--csv", "null"), "'null' is a device"),
        (("inspect", "null"), "'null' is a device"),
        (("figures", "p.hdr", "--csv", "p.hdr"), "must end in .csv"),
        (("figures", "p.hdr", "--falsecolour", "p.webp"), "must end in .png"),
        (("furniture", "show", "sofa/classic", "--into", "sofa.jpg"), "must end in .png"),
        (("furniture", "export", "a.json", "--into", "a.json"), "must end in .glb"),
        (("rig", "calibrate", ".", "--into", "rig.toml"), "must end in .json"),
        (("furniture", "show", "--size", "1,1,1"), "--size"),
    ):
        code, said = ran(*words)
        assert code == 2, words
        assert says in said
    assert (tmp_path / "null").is_symlink()
    assert (tmp_path / "p.hdr").read_bytes() == b"a picture"
    assert (tmp_path / "rig.toml").read_text() == "a rig"


def test_verify_does_not_look_at_frames_that_it_does_not_read(ran: Ran, session: Path) -> None:
    code, said = ran("verify", str(session), "--fast", "--look")
    assert code == 2
    assert "--fast reads no frame" in said


def test_a_picture_that_is_not_there_is_a_slip_of_usage(ran: Ran) -> None:
    for words in (("process", "--panorama"), ("demo", "--room")):
        code, said = ran(*words, "nowhere.jpg")
        assert code == 2
        assert "'nowhere.jpg' does not exist" in said


def test_one_folder_is_not_room_and_sky(ran: Ran, tmp_path: Path) -> None:
    (tmp_path / "frames").mkdir()
    code, said = ran("import", "x", "--indoor", "frames", "--outdoor", "frames/")
    assert code == 2
    assert "--outdoor: it is the room's folder, too" in said


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
    assert "No such file" not in said
    assert " | " not in said, "what happened and what to do, as parts of one sentence"
    assert "remove: " not in said or "has the stage run? (daylit process" in said
    assert "absolute scale" in said, "evalglare would take relative units for cd/m2"


def test_stills_are_not_copied_to_where_they_are(ran: Ran, session: Path) -> None:
    own = session / "stages" / "stills"
    before = {path.name: path.read_bytes() for path in own.glob("*.jpg")}
    assert ran("stills", str(session), "--into", str(own))[0] == 2
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


def test_a_full_disk_leaves_no_cut_off_drawing(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def fsync(fd: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(durable.os_calls, "fsync", fsync)
    with pytest.raises(DiskFullError, match=r"layout-1\.svg"):
        write_sheet(Sheet([], (0.0, 0.0), (1.0, 1.0)), tmp_path / "layout-1")
    assert not list(tmp_path.iterdir())


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


@pytest.mark.parametrize(
    "words",
    [
        ("stills", "SESSION", "--into", "SESSION/indoor"),
        ("export", "SESSION", "--what", "jpeg", "--into", "SESSION/stages/render"),
        ("proof", "SESSION", "--into", "SESSION/stages/../stages"),
        ("certificate", "SESSION", "--into", "SESSION/given/more"),
        ("relight", "SESSION", "--sweep", "day", "--into", "link"),
    ],
)
def test_results_do_not_go_among_a_sessions_own_files(ran: Ran, session: Path, words: tuple[str, ...]) -> None:
    """There they would count as damage (frames), or be gone after the next run (stages)."""
    Path("link").symlink_to(session / "stages", target_is_directory=True)
    before = sorted(session.rglob("*"))
    code, said = ran(*(word.replace("SESSION", str(session)) for word in words))
    assert code == 2
    assert "belongs to a session; choose another folder" in said
    assert sorted(session.rglob("*")) == before


def test_results_go_beside_a_session_and_into_folders_of_its_own_names(ran: Ran, session: Path) -> None:
    assert ran("stills", str(session), "--into", "indoor")[0] == 0
    assert ran("stills", str(session), "--into", str(session / "mine"))[0] == 0
    assert len(list(Path("indoor").glob("still-*.jpg"))) == len(list((session / "mine").glob("still-*.jpg"))) > 0


def test_a_framing_that_makes_no_picture_is_refused_before_it_is_saved(ran: Ran, session: Path) -> None:
    saved = (session / "choices.toml").read_bytes()
    for words in (("choices", str(session), "aim=0,100"), ("process", str(session), "--aim", "0,100", "--dry-run")):
        code, said = ran(*words)
        assert code == 2
        assert "--aim: 0,100: not a valid framing: a lens has 12 to 50 mm" in said
    assert (session / "choices.toml").read_bytes() == saved


@pytest.mark.parametrize(("flag", "text"), [("--room", "{}"), ("--room", "NaN"), ("--mask", "no picture")])
def test_a_file_that_is_refused_is_not_saved(ran: Ran, session: Path, flag: str, text: str) -> None:
    """Else the corrected file would be as useless as the first: later runs take the saved copy."""
    Path("given").write_text(text)
    saved = (session / "choices.toml").read_bytes()
    for words in (("--dry-run",), ("--quality", "draft")):
        code, said = ran("process", str(session), flag, "given", *words)
        assert code == 5
        assert "given" in said
    assert tomllib.loads((session / "choices.toml").read_text())["chosen"] == tomllib.loads(saved.decode())["chosen"]


@pytest.mark.parametrize("flag", ["--room", "--mask", "--mask-add", "--mask-keep", "--mask-sunlight", "--calibration"])
def test_a_file_that_no_stage_could_use_ends_a_run_before_its_first_stage(ran: Ran, session: Path, flag: str) -> None:
    """Only the stage that reads it noticed, after minutes of others; and --dry-run not at all."""
    Path("given").write_text("[]")
    code, said = ran("process", str(session), flag, "given", "--force", "verify")
    assert code == 5
    assert "given" in said
    assert "verify" not in said


def test_an_arrangement_says_which_of_its_keys_are_wrong(ran: Ran) -> None:
    Path("arrangement.json").write_text('{"plan": 3}')
    code, said = ran("furniture", "export", "arrangement.json")
    assert code == 5
    assert "arrangement.json: not a valid arrangement file: plan: Input should be" in said
    assert "validation errors" not in said


def test_files_may_start_with_a_byte_order_mark(ran: Ran, session: Path) -> None:
    """As Windows' programs write them."""

    def marked(path: Path) -> str:
        path.write_text(path.read_text("utf-8"), "utf-8-sig")
        return str(path)

    Path("plan.json").write_text(json.dumps(PLAN))
    assert ran("arrange", marked(Path("plan.json")), "--items", "plant", "--no-pictures")[0] == 0
    assert ran("furniture", "export", marked(Path("plan-layout/arrangement.json")), "--into", "x.glb")[0] == 0
    ran("doctor", "--write-rig", "rig.toml")
    assert ran("capture", "x", "--rig", marked(Path("rig.toml")), "--dry-run")[0] == 0
    marked(session / "session.json")
    marked(session / "choices.toml")
    assert "quality" in ran("choices", str(session))[1]
    assert ran("dataset", "build", str(session.parent), "--name", "x", "--licence", "CC0-1.0")[0] == 0
    marked(session.parent / "index.csv")
    assert ran("dataset", "summary", str(session.parent))[0] == 0


def test_a_batch_whose_table_has_no_place_is_refused_before_its_first_session(
    ran: Ran, session: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def started(*_: object) -> None:
        raise AssertionError("sessions were processed first")

    monkeypatch.setattr(batch_run, "run_batch", started)
    Path("file").touch()
    code, said = ran("batch", str(session.parent), "--into", "file/tables")
    assert code == 6
    assert "RES-002" in said


@pytest.mark.parametrize("typed", ["k1=nan", "k1=1e400", "margin=wide", "seed=1.5"])
def test_a_saved_option_that_is_no_number_is_named(ran: Ran, session: Path, typed: str) -> None:
    code, said = ran("choices", str(session), typed)
    assert code == 2
    assert f"{typed}: not a" in said


def test_what_to_do_about_a_strange_frame_is_to_move_it(ran: Ran, session: Path) -> None:
    (session / "indoor").mkdir(exist_ok=True)
    (session / "indoor" / "holiday.jpg").write_bytes(b"x")
    for words in (("verify", str(session)), ("process", str(session), "--until", "merge")):
        said = ran(*words)[1]
        assert "move files that do not belong to the session out of its folder" in said
        assert "backup" not in said


def _front_door(words: str, **more: Any) -> subprocess.CompletedProcess[bytes]:
    command = [sys.executable, "-c", f"import sys, daylit; sys.exit(daylit.main({words.split()!r}))"]
    return subprocess.run(command, stderr=subprocess.PIPE, check=False, timeout=120, **more)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is full")
@pytest.mark.parametrize("words", ["furniture list", "furniture list --json"])
def test_standard_output_on_a_full_disk_is_an_error_of_the_disk(words: str) -> None:
    with Path("/dev/full").open("wb") as full:
        done = _front_door(words, stdout=full)
    assert done.returncode == 6
    assert b"RES-001" in done.stderr
    assert b"Traceback" not in done.stderr


def test_a_reader_who_has_read_enough_is_no_failed_check() -> None:
    reading, writing = os.pipe()
    os.close(reading)
    with os.fdopen(writing, "wb") as pipe:
        done = _front_door("furniture list", stdout=pipe)
    assert (done.returncode, done.stderr) == (141, b"")


def test_a_computer_without_memory_is_no_internal_error(ran: Ran, monkeypatch: pytest.MonkeyPatch) -> None:
    def needs_much(*_: object) -> None:
        raise MemoryError("Unable to allocate 977. MiB")

    monkeypatch.setattr(inspection, "open_picture", needs_much)
    code, said = ran("inspect", "large.png")
    assert code == 6
    assert "RES-000 not enough memory: Unable to allocate 977. MiB" in said
