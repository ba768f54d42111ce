"""What was chosen for a session stays chosen, whatever happens to the program that writes it."""

from __future__ import annotations

import shutil
import threading
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import click
import pytest

import processing.pipeline
from drivers.errors import DaylitError
from processing.errors import ChoicesError, LayoutNetworkError, ParameterError, PictureFileError, ProfileError
from processing.running import choices
from processing.running.choices import forget, going_on, read_choices, remember
from processing.running.requests import RunRequest
from processing.stages.contract import Quality
from station.errors import SchemaTooNewError, SessionNotFoundError
from station.session import durable
from station.session.verify import verify_session
from tests.processing.running.toy_stages import TOYS
from tests.station.session.sessions import complete_session


class Ticking:
    """A clock that is a minute later each time."""

    def __init__(self) -> None:
        self.now = datetime(2026, 3, 1, tzinfo=UTC)

    def utc_now(self) -> datetime:
        self.now += timedelta(minutes=1)
        return self.now

    def monotonic_s(self) -> float:
        return 0.0

    def sleep(self, duration_s: float) -> None:
        raise AssertionError(duration_s)


CLOCK = Ticking()


@pytest.fixture
def session(tmp_path: Path) -> Path:
    return complete_session(tmp_path / "sessions")


def chosen(session: Path, **given: object) -> None:
    remember(session, {name.replace("_", "-"): value for name, value in given.items()}, by="a test", clock=CLOCK)


def run(session: Path, given: dict[str, object] | None = None, **rest: Any) -> choices.GoingOn:
    with going_on(session, given or {}, RunRequest(**rest), by="a test", clock=CLOCK) as found:
        return found


def test_a_run_goes_on_with_what_was_chosen_and_what_is_given_goes_over_it(session: Path) -> None:
    assert run(session).request == RunRequest()
    run(session, {"set": "living", "quality": "draft", "max-error": 0.02})
    found = run(session, {"set": "office"})
    assert found.request.options == {"--set": "office"}
    assert found.request.quality is Quality.DRAFT
    assert found.kept == {"max-error": "0.02", "quality": "draft"}
    left = run(session)
    assert left.request.options == {"--set": "office"}
    past = read_choices(session).past
    assert [(one.name, one.value, one.by) for one in past] == [("set", "living", "a test")]
    assert past[0].at < past[0].until == read_choices(session).chosen["set"].at


def test_the_same_again_is_not_written(session: Path) -> None:
    chosen(session, set="living", seed=3, keep_sunlight=True)
    before = (session / "choices.toml").stat()
    chosen(session, set="living", seed=3, keep_sunlight=True)
    after = (session / "choices.toml").stat()
    assert (before.st_mtime_ns, before.st_ino) == (after.st_mtime_ns, after.st_ino)
    assert run(session).request.options == {"--keep-sunlight": True, "--seed": 3, "--set": "living"}


def test_what_a_shorter_run_cannot_use_is_left_out_of_it(session: Path) -> None:
    chosen(session, set="living", time_budget=30)
    assert run(session, until="calibrate").request == RunRequest(until="calibrate")
    assert run(session).request.time_budget_s == 30


def test_a_dry_run_chooses_nothing(session: Path) -> None:
    chosen(session, set="living")
    with going_on(session, {"set": "none"}, RunRequest(dry_run=True), by="a test", forgotten=["set"]) as found:
        assert found.request.options == {"--set": "none"}
    assert session.joinpath("choices.toml").read_text().count("living") == 1
    assert read_choices(session).chosen["set"].value == "living"


def test_files_are_copied_and_a_moved_session_still_has_them(session: Path, tmp_path: Path) -> None:
    profile = tmp_path / "lab.json"
    profile.write_text('{"k2": 1}')
    room = session / "room.json"
    room.write_text("{}")
    chosen(session, calibration=profile, room=room)
    moved = tmp_path / "elsewhere"
    shutil.move(session, moved)
    profile.unlink()
    found = run(moved).request.options
    assert Path(str(found["--calibration"])).read_text() == '{"k2": 1}'
    assert Path(str(found["--calibration"])).is_relative_to(moved)
    assert found["--room"] == moved / "room.json"
    assert verify_session(moved).intact


def test_networks_and_folders_are_named_where_they_are(session: Path, tmp_path: Path) -> None:
    network, models = tmp_path / "own.onnx", tmp_path / "models"
    network.write_bytes(b"x")
    models.mkdir()
    chosen(session, filler=network, furniture=models, segmenter="own")
    assert run(session).request.options == {"--filler": network, "--furniture": models, "--segmenter": "own"}
    shutil.rmtree(models)
    with pytest.raises(ChoicesError, match=r"furniture: .*models no longer exists.*--forget furniture"):
        run(session)
    assert run(session, until="remove").request.options == {"--filler": network, "--segmenter": "own"}


def test_a_file_in_a_stage_s_folder_is_copied_as_the_stage_may_replace_it(session: Path) -> None:
    mask = session / "stages" / "detect" / "target.png"
    mask.parent.mkdir(parents=True)
    mask.write_bytes(b"old")
    chosen(session, mask=mask)
    mask.write_bytes(b"new")
    found = run(session)
    assert Path(str(found.request.options["--mask"])).read_bytes() == b"old"
    assert found.notes == ("--mask: target.png has changed since it was saved; give it again to use the new content",)
    assert not run(session, {"mask": mask}).notes
    assert Path(str(run(session).request.options["--mask"])).read_bytes() == b"new"


def test_of_two_that_exclude_each_other_the_newer_goes_and_the_older_is_kept(session: Path, tmp_path: Path) -> None:
    mask = tmp_path / "mask.png"
    mask.write_bytes(b"m")
    chosen(session, mask=mask, items="bed")
    found = run(session, {"margin": 2.0, "set": "office"})
    assert found.request.options == {"--margin": 2.0, "--set": "office"}
    assert found.notes == (
        "not used: --items: --set was given since and replaces it",
        "not used: --mask: --margin was given since and replaces it",
    )
    assert set(run(session).request.options) == {"--margin", "--set"}
    forget(session, ["--margin"], clock=CLOCK)
    assert set(run(session).request.options) == {"--mask", "--set"}
    with pytest.raises(ParameterError, match="no effect with"):
        run(session, {"mask": mask, "margin": 1.0})


def test_what_went_with_another_value_goes_with_it(session: Path, tmp_path: Path) -> None:
    network, contract = tmp_path / "own.onnx", tmp_path / "own.json"
    network.write_bytes(b"x")
    contract.write_bytes(b"{}")
    chosen(session, segmenter=network, segmenter_contract=contract)
    assert set(run(session).request.options) == {"--segmenter", "--segmenter-contract"}
    found = run(session, {"segmenter": "own"})
    assert found.request.options == {"--segmenter": "own"}
    assert found.notes == ("not used: --segmenter-contract: it was for another --segmenter",)


def refused_at_work(session: Path, error: Exception) -> None:
    with going_on(session, {"seed": 1}, RunRequest(), by="a test"):
        assert read_choices(session).chosen["seed"].value == 1
        raise error


def test_what_cannot_be_is_not_chosen(session: Path, tmp_path: Path) -> None:
    chosen(session, set="living")
    before = (session / "choices.toml").read_bytes()
    for given, words in (
        ({"k1": -3.0}, r"--k1.*saved options: set"),
        ({"quality": "best"}, "no such quality: 'best'"),
        ({"mask": tmp_path / "none.png"}, "no file none.png"),
        ({"wings": "2"}, "does not apply to any stage"),
    ):
        with pytest.raises(ParameterError, match=words):
            run(session, given)
    for error in (ParameterError("the mask is too small"), ProfileError("not JSON"), PictureFileError("no mask")):
        with pytest.raises(type(error), match=error.message):
            refused_at_work(session, error)
    assert set(read_choices(session).chosen) == {"set"}
    for bad in (
        {"k1": "nan"},
        {"max-error": "inf"},
        {"zone": "Mars"},
        {"seed": "many"},
        {"keep-sunlight": "perhaps"},
        {"mask": tmp_path / "none.png"},
        {"wings": 1},
    ):
        with pytest.raises(ParameterError):
            remember(session, bad, by="a test")
    for site, words in (("95,0", "not on Earth"), ("Pittsburgh", "2 comma-separated numbers")):
        with pytest.raises((DaylitError, click.UsageError), match=words):
            remember(session, {"site": site}, by="a test")
    with pytest.raises(ParameterError, match="no such saved option"):
        forget(session, ["mask"])
    assert b'value = "living"' in before
    assert set(read_choices(session).chosen) == {"set"}


def test_a_network_or_arrangement_that_is_refused_is_not_chosen(session: Path, tmp_path: Path) -> None:
    """A saved copy of it would be taken by every later run, though the file itself is corrected."""
    given = tmp_path / "model.onnx"
    given.write_bytes(b"no network")
    for where in (str(given), "another file"):
        with (
            pytest.raises(LayoutNetworkError),
            going_on(session, {"layout-model": given, "set": "none"}, RunRequest(), by="a test"),
        ):
            raise LayoutNetworkError("cannot be loaded", where=where)
        kept = set() if where == str(given) else {"layout-model", "set"}
        assert set(read_choices(session).chosen) == kept


def test_a_run_that_fails_otherwise_keeps_what_was_chosen(session: Path) -> None:
    with pytest.raises(KeyboardInterrupt), going_on(session, {"set": "none"}, RunRequest(), by="a test"):
        raise KeyboardInterrupt
    assert read_choices(session).chosen["set"].value == "none"


@pytest.mark.parametrize(
    ("text", "error", "words"),
    [
        ("chosen = [", ChoicesError, "choices.toml: is not TOML"),
        ("\udcff", ChoicesError, "is not TOML"),
        ("[chosen.set]\nvalue = 'x'", ChoicesError, "chosen.set.at: Field required"),
        ("[chosen.mask]\nfile='../../x'\nat=2026-01-01T00:00:00Z\nby=''", ChoicesError, "neither a value nor a file"),
        ("[chosen.set]\nvalue = inf\nat=2026-01-01T00:00:00Z\nby=''", ChoicesError, "chosen.set.value"),
        ("schema_version = 9", SchemaTooNewError, "choices.toml: is of version 9, this version of daylit supports 1"),
    ],
)
def test_a_file_that_cannot_be_right_is_named_and_left_alone(
    session: Path, text: str, error: type[Exception], words: str
) -> None:
    file = session / "choices.toml"
    file.write_bytes(raw := text.encode("utf-8", "surrogateescape"))
    with pytest.raises(error, match=words):
        run(session)
    with pytest.raises(error):
        chosen(session, set="none")
    with pytest.raises(error):
        forget(session, ["all"])
    assert file.read_bytes() == raw


def test_an_option_of_another_version_is_named_and_kept(session: Path) -> None:
    file = session / "choices.toml"
    file.write_text("[chosen.mirrors]\nvalue = 'off'\nat = 2026-01-01T00:00:00Z\nby = 'daylit process'\n")
    assert run(session, {"set": "none"}).notes == ("not used: --mirrors: this version of daylit has no such option",)
    assert read_choices(session).chosen["mirrors"].value == "off"


def test_strange_texts_come_back_as_they_were(session: Path) -> None:
    text = 'a "bed", \\ 2 \x7f nightstand\t\n☃ \U0001f6cf'
    chosen(session, items=text)
    assert read_choices(session).chosen["items"].value == text


def test_only_sessions_have_choices(tmp_path: Path) -> None:
    with pytest.raises(SessionNotFoundError):
        remember(tmp_path, {"set": "none"}, by="a test")
    assert list(tmp_path.iterdir()) == []


class Died(BaseException):
    """The process ends."""


class Dying(durable.OsCalls):
    """Ends the process at the Nth call that changes something."""

    def __init__(self, last: int) -> None:
        self.left = last

    def _count(self) -> None:
        self.left -= 1
        if self.left < 0:
            raise Died

    def write(self, fd: int, data: bytes | memoryview) -> int:
        self._count()
        return super().write(fd, data)

    def fsync(self, fd: int) -> None:
        self._count()
        super().fsync(fd)

    def rename(self, source: str, target: str, *, src_dir_fd: int, dst_dir_fd: int) -> None:
        self._count()
        super().rename(source, target, src_dir_fd=src_dir_fd, dst_dir_fd=dst_dir_fd)

    def unlink(self, name: str, *, dir_fd: int) -> None:
        self._count()
        super().unlink(name, dir_fd=dir_fd)


def kills() -> Iterator[int]:
    yield from range(40)


def test_killed_at_any_call_the_old_choices_or_the_new_are_there(
    session: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    profile = tmp_path / "lab.json"
    profile.write_text("old")
    chosen(session, calibration=profile, set="none")
    profile.write_text("new")
    seen = set()
    for last in kills():
        with monkeypatch.context() as patched:
            patched.setattr(durable, "os_calls", Dying(last))
            try:
                chosen(session, calibration=profile, set=f"list-{last}")
                finished = True
            except Died:
                finished = False
        found = read_choices(session)
        word, text = found.chosen["set"].value, found.value(session, "calibration").read_text()
        assert (word == "none") == (text == "old")
        seen.add(text)
        if finished:
            break
    assert seen == {"old", "new"}
    assert finished
    chosen(session, set="last")
    assert not [path.name for path in (session / "choices").iterdir() if path.name.startswith(".part")]


def test_writers_beside_each_other_lose_nothing(session: Path) -> None:
    names = ["set", "seed", "rules", "style", "k1", "k2"]
    values: list[object] = ["none", 3, "tight", "oak", 0.5, 2.0]
    threads = [
        threading.Thread(target=remember, args=(session, {name: value}), kwargs={"by": name})
        for name, value in zip(names, values, strict=True)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(30)
    found = read_choices(session).chosen
    assert {name: one.value for name, one in found.items()} == dict(zip(names, values, strict=True))
    assert {one.by for one in found.values()} == set(names)


def test_the_runner_s_table_decides_what_can_be_chosen(session: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(processing.pipeline, "STAGES", TOYS)
    monkeypatch.setattr(processing.pipeline.options, "__defaults__", (TOYS,))
    assert "scale" in choices.known()
    assert "set" not in choices.known()


def test_the_session_itself_is_a_folder_like_another(session: Path) -> None:
    chosen(session, mask=session)
    assert read_choices(session).chosen["mask"].file == "."


def test_a_file_saved_by_another_editor_is_read(session: Path) -> None:
    chosen(session, set="living")
    file = session / "choices.toml"
    file.write_bytes(b"\xef\xbb\xbf" + file.read_bytes().replace(b"\n", b"\r\n"))
    assert read_choices(session).chosen["set"].value == "living"
