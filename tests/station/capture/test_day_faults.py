"""What a day on site brings to one bracket: late partners, a set clock, a pause, a lamp, stops that are not there."""

from __future__ import annotations

import json
import os
import signal
from dataclasses import dataclass
from pathlib import Path

import pytest

import daylit
from drivers.camera import ExposureProgress
from drivers.clock import SteadyClock, SystemClock
from drivers.errors import DeviceBusyError, DeviceTimeoutError
from station.capture.bracket import PAPER_STOPS_S, estimate_bracket, light_drift, plan_bracket, typical_cost
from station.capture.capture import Capture, CaptureRequest
from station.capture.events import CaptureEvent, EventKind
from station.capture.preflight import PreflightError
from station.capture.rig import known_times_s
from station.capture.rig_file import BracketTable
from station.commands.following import follow
from station.commands.views import SilentView
from station.errors import RigError
from station.session.session import Side
from tests.station.capture.fake_camera import FakeCamera
from tests.station.capture.test_capture import STOPS_S, make_rig, run
from tests.virtual_clock import VirtualClock


@dataclass
class ArmedCamera(FakeCamera):
    """Knows whether its button is held, and for how long nobody kept it awake while it was."""

    armed_s: float | None = None
    longest_s: float = 0.0

    def arm(self) -> None:
        super().arm()
        self.armed_s = self.clock.monotonic_s()

    def _seen(self, *, held: bool) -> None:
        if self.armed_s is not None:
            self.longest_s = max(self.longest_s, self.clock.monotonic_s() - self.armed_s)
        self.armed_s = self.clock.monotonic_s() if held and self.armed_s is not None else None

    def keep_alive(self) -> None:
        super().keep_alive()
        self._seen(held=True)

    def stand_down(self) -> None:
        super().stand_down()
        self._seen(held=False)

    def release(self) -> None:
        self._seen(held=False)
        super().release()


@dataclass
class SlowToRecover(FakeCamera):
    """Breaks once, when its partner is armed ahead for the next stop; then needs a while."""

    partner: ArmedCamera | None = None

    def poll_exposure(self) -> ExposureProgress:
        if self.partner and self.partner.calls["arm"] > self.calls["arm"]:
            self.partner = None
            raise DeviceTimeoutError("no picture within 30 s")
        return super().poll_exposure()

    def recover(self) -> None:
        self.clock.sleep(0.4)
        super().recover()


def test_the_partner_of_a_camera_that_breaks_is_let_go(tmp_path: Path) -> None:
    clock = SystemClock()
    partner = ArmedCamera(clock)
    late = SlowToRecover(clock, readout_s=0.3, partner=partner)
    manifest, _, events = run(make_rig(late, partner), tmp_path)
    assert manifest.status == "complete"
    assert not manifest.rejected
    assert partner.calls["stand_down"] >= 1
    assert partner.longest_s < 0.35, "armed while the other one was recovered"
    said = [e.text for e in events if e.kind is EventKind.RECOVERING]
    assert said[0].endswith("recovering")
    assert said[-1].endswith("the camera is back")


def test_a_camera_that_is_only_late_is_recovered_until_it_is_back(tmp_path: Path) -> None:
    busy = {("recover", n): DeviceBusyError("still working") for n in (1, 2)}
    late = FakeCamera(SystemClock(), failures={("poll_exposure", 3): DeviceTimeoutError("late"), **busy})
    manifest, _, _ = run(make_rig(late, FakeCamera(SystemClock())), tmp_path)
    assert manifest.status == "complete"
    assert late.calls["recover"] == 3


def test_an_armed_camera_is_kept_awake_while_its_partner_takes_its_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("station.capture.camera_worker.KEEP_ALIVE_S", 0.1)
    slow, partner = FakeCamera(SystemClock(), readout_s=0.8), ArmedCamera(SystemClock())
    run(make_rig(slow, partner), tmp_path)
    assert partner.calls["keep_alive"] >= 3
    assert partner.longest_s < 0.7, "nobody spoke to it while it stood armed"


class Settable(SystemClock):
    """A computer's clock that somebody sets."""

    step_s = 0.0

    def utc_now(self):
        from datetime import timedelta

        return super().utc_now() + timedelta(seconds=self.step_s)


@pytest.mark.parametrize("step_s", [-86_400, -20, 47, 3600])
def test_a_set_clock_is_noticed_and_rejects_no_frame(tmp_path: Path, step_s: float) -> None:
    wall = Settable()
    rig = make_rig(FakeCamera(SystemClock()))
    rig.clock = SteadyClock(wall)
    job = Capture.new(rig, CaptureRequest(room="x", into=tmp_path, stops_s=STOPS_S))
    for event in job.events():
        if event.kind is EventKind.EXPOSED and not wall.step_s:
            wall.step_s = step_s
    manifest = job.store.manifest
    job.store.close()
    assert manifest.status == "complete"
    assert not manifest.rejected
    assert [w.code for w in manifest.warnings].count("clock_step") == 1
    times = [f.taken_utc for f in manifest.frames if f.taken_utc]
    assert max(times) - min(times) < max(times) - manifest.created_utc
    assert "clock_step" in (job.store.path / "journal.jsonl").read_text()


def test_a_steady_clock_notices_each_step_once() -> None:
    clock = VirtualClock()
    steady = SteadyClock(clock)
    clock.sleep(1000)
    assert steady.new_step_s() is None
    start = steady.utc_now()
    clock._start_utc = clock._start_utc.replace(year=2022)
    assert steady.new_step_s() == pytest.approx(-365 * 86_400)
    assert steady.new_step_s() is None
    assert steady.utc_now() == start
    steady.rebase()
    assert steady.utc_now() == clock.utc_now()


def test_a_stop_that_a_camera_lacks_is_refused_by_name(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    camera = FakeCamera(SystemClock())
    job = Capture.new(make_rig(camera), CaptureRequest(room="x", into=tmp_path, stops_s=(0.25, 1 / 25_000)))
    with pytest.raises(PreflightError, match=r"indoor stops: .*1/25000 s \(its nearest is 1/8000 s\)"):
        list(job.events())
    assert not camera.opened_s
    options = ["capture", "x", "--simulate", "room", "--dry-run", "--stops", "60,1/25000", "--only"]
    assert daylit.main([*options, "outdoor"]) == 2
    said = capsys.readouterr().err
    assert "60 s (its nearest is 30 s)" in said
    assert "1/25000 s (its nearest is 1/8000 s)" in said
    assert daylit.main([*options, "indoor"]) == 0


def test_two_stops_that_are_one_to_a_camera_are_refused(tmp_path: Path) -> None:
    job = Capture.new(make_rig(FakeCamera(SystemClock())), CaptureRequest("x", tmp_path, stops_s=(1 / 15, 1 / 16)))
    with pytest.raises(PreflightError, match="the same setting"):
        list(job.events())


def test_the_papers_stops_are_there_on_both_cameras() -> None:
    from station.capture.bracket import unavailable_stops

    assert not any(unavailable_stops(PAPER_STOPS_S, known_times_s(kind)) for kind in ("theta_z1", "canon_5d2"))


class AtEvent(SilentView):
    """Does something when an event of a kind is shown, once."""

    def __init__(self, kind: EventKind, action) -> None:
        self._kind, self._action = kind, action
        self.seen: list[CaptureEvent] = []

    def show(self, event: CaptureEvent) -> None:
        self.seen.append(event)
        if event.kind is self._kind:
            self._kind = None
            self._action()


def test_sighup_ends_a_capture_as_sigterm_does(tmp_path: Path) -> None:
    job = Capture.new(make_rig(FakeCamera(SystemClock())), CaptureRequest("x", tmp_path, stops_s=STOPS_S))

    def close_terminal() -> None:
        os.kill(os.getpid(), signal.SIGHUP)
        os.kill(os.getpid(), signal.SIGHUP)
        raise OSError(5, "Input/output error")

    assert follow(job, AtEvent(EventKind.EXPOSED, close_terminal))
    assert job.store.manifest.status == "partial"
    assert len(job.store.manifest.frames) == 1, "what was exposed is kept"
    assert (job.store.path / "session.json").exists()
    job.store.close()


def test_signals_pause_and_continue(tmp_path: Path) -> None:
    job = Capture.new(make_rig(FakeCamera(SystemClock())), CaptureRequest("x", tmp_path, stops_s=STOPS_S))
    paused = AtEvent(EventKind.PAUSED, lambda: os.kill(os.getpid(), signal.SIGUSR2))
    asked = AtEvent(EventKind.RELEASED, lambda: os.kill(os.getpid(), signal.SIGUSR1))
    shown = paused.show
    paused.show = lambda event: (asked.show(event), shown(event))  # type: ignore[method-assign]
    assert not follow(job, paused)
    kinds = [event.kind for event in paused.seen]
    assert kinds.index(EventKind.CONTINUED) == kinds.index(EventKind.PAUSED) + 1
    assert job.store.manifest.status == "complete"
    job.store.close()


def test_a_paused_bracket_waits_with_its_buttons_let_go_and_says_so(tmp_path: Path) -> None:
    cameras = [ArmedCamera(SystemClock()), ArmedCamera(SystemClock(), readout_s=0.1)]
    job = Capture.new(make_rig(*cameras), CaptureRequest("x", tmp_path, stops_s=STOPS_S))
    held: list[float | None] = []
    for event in job.events():
        if event.kind is EventKind.RELEASED and not held:
            job.ask_pause(paused=True)
        if event.kind is EventKind.PAUSED:
            SystemClock().sleep(0.3)
            held = [camera.armed_s for camera in cameras]
            job.ask_pause(paused=False)
    assert held == [None, None]
    assert {"paused"} <= {w.code for w in job.store.manifest.warnings}
    assert job.store.manifest.status == "complete"
    job.store.close()


@pytest.mark.parametrize(("gain", "changed"), [(30.0, False), (36.0, True)])
def test_a_repeated_frame_shows_light_that_changed(tmp_path: Path, gain: float, changed: bool) -> None:
    camera = FakeCamera(SystemClock())

    def brighter(shot: int, _shutter_s: float, data: bytes) -> bytes:
        camera.gain = gain if shot == len(STOPS_S) else 30.0
        return data

    camera.spoil = brighter
    manifest, path, _ = run(make_rig(camera, bracket=BracketTable(reference=True)), tmp_path)
    assert manifest.status == "complete"
    assert len(camera.opened_s) == len(STOPS_S) + 1
    (record,) = manifest.references
    assert record.ratio == pytest.approx(gain / 30, rel=0.08)
    assert record.side is Side.INDOOR
    assert record.file
    assert (path / record.file).exists()
    assert ("moving_light" in {w.code for w in manifest.warnings}) == changed
    from station.session.verify import verify_session

    report = verify_session(path)
    assert report.intact, report.problems
    assert any("the light changed" in note for note in report.notes) == changed


def test_each_camera_repeats_the_stop_that_shows_most_of_its_own_picture(tmp_path: Path) -> None:
    cameras = [FakeCamera(SystemClock(), gain=30.0), FakeCamera(SystemClock(), gain=2.0)]
    manifest, _, _ = run(make_rig(*cameras, bracket=BracketTable(reference=True)), tmp_path)
    assert manifest.status == "complete"
    repeated = {record.side: record.stop for record in manifest.references}
    for side in Side:
        means = {f.stop: f.statistics.mean_frac for f in manifest.frames if f.side is side and f.statistics}
        assert repeated[side] == min(means, key=lambda stop: abs(means[stop] - 0.4))
    assert repeated[Side.INDOOR] > repeated[Side.OUTDOOR]
    assert [len(camera.opened_s) for camera in cameras] == [len(STOPS_S) + 1] * 2


def test_nine_raw_stops_take_as_long_as_they_truly_do() -> None:
    """50 to 54 s from the first file to the last in 14 brackets of the paper's authors."""
    plan = plan_bracket(PAPER_STOPS_S, "full", (Side.INDOOR,))
    rows = estimate_bracket(plan, {Side.INDOOR: typical_cost("theta_z1", keep_raw=True)}).rows
    first_to_last_s = sum(row.pair_s for row in rows[:-1]) + (rows[-1].asked_s - rows[0].asked_s)
    assert 50 <= first_to_last_s <= 58
    assert all(6 <= row.pair_s <= 7 for row in rows)


def test_the_drift_of_sun_and_sky_is_stated(capsys: pytest.CaptureFixture[str]) -> None:
    drift = light_drift(240.0, 0.0)
    assert drift.sun_deg == pytest.approx(1.0)
    # Haurwitz 1945 at 30 and 31 degrees of sun: 489.5 and 505.7 W/m2 on the horizontal
    assert drift.sky_frac == pytest.approx(0.033, abs=0.002)
    assert daylit.main(["capture", "x", "--simulate", "room", "--dry-run", "--json"]) == 0
    plan = json.loads(capsys.readouterr().out)
    assert plan["sun_deg"] == pytest.approx(0.25 * plan["total_s"] / 60)


def test_toml_of_50000_nested_arrays_is_a_typed_error(tmp_path: Path) -> None:
    from processing.layout.rules import RulesError, read_rules
    from station.capture.rig_file import load_rig

    path = tmp_path / "rig.toml"
    path.write_text("x = " + "[" * 50_000 + "]" * 50_000)
    with pytest.raises(RigError, match=str(path)):
        load_rig(path)
    with pytest.raises(RulesError, match=path.name):
        read_rules(path)
