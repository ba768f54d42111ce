"""A session that is completed later: what is taken anew, what is not, and what a person typed."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

import daylit
from drivers.clock import SystemClock
from drivers.errors import DeviceLostError, StoreFullError
from station.capture.capture import Capture, CaptureRequest
from station.capture.events import CaptureEvent, EventKind
from station.capture.rig_file import BracketTable
from station.errors import SessionError
from station.session.session import SessionManifest, SessionStatus, Side
from station.session.store import SessionStore
from station.session.verify import damaged_frames, verify_session
from tests.station.capture.fake_camera import FakeCamera, make_jpeg
from tests.station.capture.test_capture import STOPS_S, TABLE, FakeMeter, make_rig, run
from tests.station.capture.test_noise import camera as further_camera


def later(**options: object) -> FakeCamera:
    """Return a camera in other light, as later in the day: the same picture twice would be a repeat."""
    return FakeCamera(SystemClock(), gain=25.0, **options)


def resume(
    path: Path, *cameras: FakeCamera, typed: tuple[float, ...] = (), **tables: object
) -> tuple[SessionManifest, list[CaptureEvent]]:
    with SessionStore.open(path, writable=True) as store:
        events = list(Capture.resume(make_rig(*cameras, **tables), store, typed_readings=typed).events())
        return store.manifest, events


def without_readings(into: Path) -> Path:
    """Return a session with every frame whose meter died before the first reading."""
    with pytest.raises(DeviceLostError):
        run(make_rig(later(), meter=FakeMeter(DeviceLostError("unplugged"))), into)
    (path,) = into.iterdir()
    manifest, _ = resume(path, later())
    assert manifest.missing == ("meter reading before", "meter reading after")
    return path


def test_a_number_that_was_typed_once_is_one_reading(tmp_path: Path) -> None:
    manifest, _ = resume(without_readings(tmp_path), later(), typed=(34.63,))
    assert [(r.when, r.luminance_cd_m2) for r in manifest.readings] == [("before", 34.63)]
    assert (manifest.status, manifest.missing) == (SessionStatus.PARTIAL, ("meter reading after",))
    assert manifest.drift_frac is None


@pytest.mark.parametrize("typed", [((34.63,), (35.0,)), ((34.63, 35.0),)], ids=["one at a time", "both"])
def test_numbers_that_are_typed_later_complete_it(tmp_path: Path, typed: tuple[tuple[float, ...], ...]) -> None:
    path = without_readings(tmp_path)
    for numbers in typed:
        manifest, _ = resume(path, later(), typed=numbers)
    assert [(r.when, r.luminance_cd_m2) for r in manifest.readings] == [("before", 34.63), ("after", 35.0)]
    assert manifest.status is SessionStatus.COMPLETE


@pytest.mark.parametrize(("planned", "typed"), [(0, 1), (1, 2)])
def test_a_number_that_no_reading_is_missing_for_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], planned: int, typed: int
) -> None:
    """It would be dropped, and the session be as relative as before."""
    _, path, _ = run(make_rig(later(), later()), tmp_path)
    with SessionStore.open(path, writable=True) as store:
        store.update(readings_planned=planned)
        store.finish()
    numbers = ("--reading", "34.63") * typed
    assert daylit.main(["capture", "--resume", str(path), "--simulate", "uniform:100", *numbers]) == 2
    assert f"--reading: readings missing here: {planned}" in capsys.readouterr().err
    with SessionStore.open(path, writable=False) as store:
        assert not store.manifest.readings


def spoil(path: Path, side: Side, stop: int) -> None:
    with SessionStore.open(path, writable=False) as store:
        frame = store.manifest.frame(side, stop)
    assert frame is not None
    (path / frame.file).write_bytes(b"damaged")


def test_a_damaged_frame_needs_its_camera_as_a_missing_one_does(tmp_path: Path) -> None:
    _, path, _ = run(make_rig(FakeCamera(SystemClock()), FakeCamera(SystemClock())), tmp_path)
    spoil(path, Side.OUTDOOR, 1)
    with pytest.raises(SessionError, match="outdoor"):
        resume(path, later())
    with pytest.raises(SessionError, match="iso was 100, is 200"):
        resume(path, later(), later(), outdoor=TABLE.model_copy(update={"iso": 200}))
    manifest, _ = resume(path, later(), later())
    assert manifest.status is SessionStatus.COMPLETE
    assert verify_session(path).intact


@pytest.mark.parametrize("key", ["lens", "nd_filter"])
def test_frames_of_another_lens_or_filter_are_not_mixed(tmp_path: Path, key: str) -> None:
    with pytest.raises(StoreFullError):
        run(make_rig(FakeCamera(SystemClock(), failures={("release", 2): StoreFullError("full")})), tmp_path)
    (path,) = tmp_path.iterdir()
    with pytest.raises(SessionError, match=f"{key} was , is another"):
        resume(path, later(), indoor=TABLE.model_copy(update={key: "another"}))


def test_a_damaged_further_exposure_is_not_said_to_be_taken_again(tmp_path: Path) -> None:
    _, path, _ = run(make_rig(further_camera()), tmp_path, noise_frac=0.005)
    spoil(path, Side.INDOOR, len(STOPS_S))
    spoil(path, Side.INDOOR, 1)
    manifest, _ = resume(path, further_camera(gain=25.0))
    said = [w.message.rpartition("; ")[2] for w in manifest.warnings if w.code == "damaged"]
    assert said == ["taken again", "left out"]
    assert manifest.frame(Side.INDOOR, len(STOPS_S)) is None
    assert manifest.status is SessionStatus.COMPLETE


def test_a_doubtful_frame_of_an_adaptive_bracket_is_taken_again(tmp_path: Path) -> None:
    """The others show that its stop adds nothing; but it is there, and wrong."""
    bright = {"gain": 1e5}

    def dim(shot: int, shutter_s: float, data: bytes) -> bytes:
        taken = SystemClock().utc_now()
        return make_jpeg(shutter_s, iso=100, f_number=5.6, taken=taken, gain=3e3) if shot == 1 else data

    camera = FakeCamera(SystemClock(), spoil=dim, **bright)
    manifest, _, _ = run(make_rig(camera), tmp_path, mode="adaptive")
    assert [round(1 / shutter_s) for _, shutter_s in camera.opened_s].count(60) == 2
    assert manifest.frame(Side.INDOOR, 2).retakes == 1  # type: ignore[union-attr]
    assert 2 not in {skipped.stop for skipped in manifest.skipped}
    assert "brightness_order" not in {warning.code for warning in manifest.warnings}


def test_a_stray_file_asks_for_no_camera(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """All frames are there, only a reading is missing: no camera is looked for, whatever else lies in their folder."""
    from station.commands import capture as commands

    manifest, path, _ = run(make_rig(later(), later()), tmp_path)
    asked = []
    monkeypatch.setattr(commands, "_open", lambda file, *_args: asked.append(set(file.cameras())) or _end())
    options = ["capture", "--resume", str(path), "--simulate", "uniform:100"]
    shutil.copy(path / manifest.frames[0].file, path / "indoor" / "copy of it.jpg")
    with SessionStore.open(path, writable=True) as store:
        store.update(readings_planned=1)
        store.finish()
    assert daylit.main(options) != 0
    assert asked == [set()]
    spoil(path, Side.OUTDOOR, 1)
    assert daylit.main(options) != 0
    assert asked[1:] == [{Side.OUTDOOR}]


def _end() -> None:
    raise DeviceLostError("far enough")


@pytest.mark.parametrize("asked", ["reference", "noise", "nothing"])
def test_what_is_not_made_up_for_is_said(tmp_path: Path, asked: str) -> None:
    """A resumed capture repeats no stop, and adds none for the noise."""
    broken = further_camera(failures={("release", 2): StoreFullError("full")})
    rig = make_rig(broken)
    if asked == "reference":
        rig.file = rig.file.model_copy(update={"bracket": BracketTable(reference=True)})
    with pytest.raises(StoreFullError):
        run(rig, tmp_path, noise_frac=0.05 if asked == "noise" else None)
    (path,) = tmp_path.iterdir()
    manifest, _ = resume(path, further_camera(gain=25.0))
    (said,) = (warning.message for warning in manifest.warnings if warning.code == "resumed")
    assert ("no stop is repeated" in said) is (asked != "nothing")
    assert not manifest.references


def test_frames_that_only_the_journal_knows_are_not_damaged(tmp_path: Path) -> None:
    """After a crash session.json is behind: it names none of the frames that are there."""
    job = Capture.new(make_rig(later()), CaptureRequest(room="x", into=tmp_path, stops_s=STOPS_S))
    events = job.events()
    while next(events).kind is not EventKind.SAVED:
        pass
    events.close()  # type: ignore[attr-defined]
    with SessionStore.open(job.store.path, writable=False) as store:
        manifest = store.manifest
    assert manifest.frames
    assert "manifest-behind" in {problem.code for problem in verify_session(job.store.path).problems}
    assert damaged_frames(job.store.path, manifest) == ()
    (job.store.path / manifest.frames[0].file).unlink()
    assert damaged_frames(job.store.path, manifest) == manifest.frames[:1]
