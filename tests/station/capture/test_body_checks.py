"""Preflight and the settings of the body that no rig file sets: set, recorded or refused, by name and reason."""

from __future__ import annotations

import itertools
import shutil
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest

from drivers.camera import BodySetting, CameraStatus, Verdict
from drivers.canon_5d2.codes import CanonProp
from drivers.clock import SystemClock
from drivers.link_errors import GRABBERS
from mocks.instruments.theta_z1 import ThetaOptions
from station.capture.preflight import Check, Findings, Level, PreflightError, check_computer, check_rig
from station.capture.rig import Rig
from station.capture.rig_file import PAPER_INDOOR, PAPER_OUTDOOR, RigFile
from station.session.session import Side
from tests.mocks.instruments.test_recorded_bodies import canon, theta
from tests.station.capture.fake_camera import FakeCamera
from tests.station.capture.test_capture import TABLE, make_rig, run


def check_canon(
    folder: Path, *accept: str, body: str = "eos_5d2", **options: object
) -> tuple[Findings, dict[str, str]]:
    """Return the findings of a simulated EOS, and its settings as the session will have them."""
    camera, _, clock = canon(body, **options)
    table = PAPER_OUTDOOR.model_copy(update={"accept": accept})
    findings = check_rig(Rig(RigFile(outdoor=table), {Side.OUTDOOR: camera}, None, clock), folder, bytes_needed=0)
    camera.close()
    return findings, {s.name: s.got for d in findings.devices for s in d.settings}


def named(findings: Findings, level: Level) -> dict[str, str]:
    return {c.name: c.text for c in findings.checks if c.level is level}


def failures(findings: Findings) -> list[Check]:
    return [check for check in findings.checks if check.level is Level.FAIL]


def test_a_body_made_ready_passes_and_is_recorded(tmp_path: Path) -> None:
    findings, kept = check_canon(tmp_path)
    assert not failures(findings)
    wanted = {
        "picture style": "standard",
        "colour space": "sRGB",
        "mirror lock-up": "off",
        "exposure bracketing": "none",
        "highlight tone priority": "off",
        "lighting optimiser": "off",
        "auto power off": "after 60 s",
        "long-exposure noise reduction": "off",
        "high-ISO noise reduction": "standard",
    }
    assert wanted.items() <= kept.items()


def test_what_has_one_right_value_is_set_and_named(tmp_path: Path) -> None:
    values = ((CanonProp.COLOR_SPACE, 2), (CanonProp.WB_SHIFT_AB, 0xFFFFFFFE), (CanonProp.EXPOSURE_BRACKETING, 8))
    findings, kept = check_canon(tmp_path, values=values)
    assert not failures(findings)
    warned = named(findings, Level.WARN)
    assert warned["outdoor colour space"] == "sRGB: was Adobe RGB"
    assert warned["outdoor white-balance shift amber-blue"] == "none: was -2"
    assert "outdoor exposure bracketing" in warned
    assert kept["colour space"] == "sRGB"


@pytest.mark.parametrize(
    ("options", "name"),
    [
        ({"values": ((CanonProp.PICTURE_STYLE, 0x86),)}, "picture style"),
        ({"custom_functions": ((0x203, 1),)}, "highlight tone priority"),
        ({"custom_functions": ((0x204, 0),)}, "lighting optimiser"),
        ({"custom_functions": ((0x60F, 1),)}, "mirror lock-up"),
        ({"body": "eos_5d3"}, "lighting optimiser"),
    ],
)
def test_what_spoils_a_bracket_is_refused_by_name_unless_accepted(
    tmp_path: Path, options: dict[str, object], name: str
) -> None:
    findings, _ = check_canon(tmp_path, **options)  # type: ignore[arg-type]
    (failure,) = failures(findings)
    assert failure.name == f"outdoor {name}"
    assert f'accept = ["{name}"]' in failure.advice
    accepted, _ = check_canon(tmp_path, name, **options)  # type: ignore[arg-type]
    assert not failures(accepted)
    assert f"outdoor {name}" in named(accepted, Level.WARN)


def test_what_a_rig_file_cannot_accept_is_not_offered_for_it(tmp_path: Path) -> None:
    class Locked(FakeCamera):
        def body_settings(self) -> tuple[BodySetting, ...]:
            why = "it should be none, and the camera does not let a computer change it"
            return (BodySetting("exposure bracketing", "+8", "", Verdict.REFUSED, why),)

    (failure,) = failures(check_rig(make_rig(Locked(SystemClock())), tmp_path, bytes_needed=0))
    assert failure.name == "indoor exposure bracketing"
    assert failure.advice == "change it on the camera"


@pytest.mark.parametrize(("keep_raw", "free", "needed"), [(False, 4, 0), (False, 3, 4), (True, 8, 0), (True, 7, 8)])
def test_a_card_needs_room_for_the_bracket_and_no_more(tmp_path: Path, keep_raw: bool, free: int, needed: int) -> None:
    class Small(FakeCamera):
        def status(self) -> CameraStatus:
            return replace(super().status(), free_frames=free)

    rig = make_rig(Small(SystemClock()), indoor=TABLE.model_copy(update={"keep_raw": keep_raw}))
    findings = check_rig(rig, tmp_path, bytes_needed=0, n_stops=4)
    said = [check.text for check in failures(findings)]
    assert said == ([f"room for {free} frames on the card, {needed} needed"] if needed else [])
    if needed and not keep_raw:
        with pytest.raises(PreflightError, match="card"):
            run(rig, tmp_path)


def test_long_exposure_noise_reduction_is_a_warning(tmp_path: Path) -> None:
    findings, _ = check_canon(tmp_path, custom_functions=((0x201, 2),))
    assert not failures(findings)
    assert "twice as long" in named(findings, Level.WARN)["outdoor long-exposure noise reduction"]


def test_what_a_body_does_not_report_is_named(tmp_path: Path) -> None:
    """A 60D has its optimiser as a property, off in mode M; a 5D Mark III sends no functions in this state."""
    assert not failures(check_canon(tmp_path, body="eos_60d")[0])
    findings, _ = check_canon(tmp_path, "lighting optimiser", body="eos_5d3")
    assert "high-ISO noise reduction" in named(findings, Level.WARN)["outdoor settings"]


def test_a_card_that_is_not_there_is_refused(tmp_path: Path) -> None:
    findings, _ = check_canon(tmp_path, card_bytes=0)
    assert any("no card" in c.text for c in failures(findings))


@pytest.mark.parametrize(
    ("firmware", "refused"),
    [("1.50.1", "static stitching"), ("2.11.1", ""), ("2.30.1", "firmware"), ("3.0.2", "firmware")],
)
def test_firmware_of_the_theta(tmp_path: Path, firmware: str, refused: str) -> None:
    camera, clock = theta(ThetaOptions(firmware=firmware))
    rig = Rig(RigFile(indoor=PAPER_INDOOR), {Side.INDOOR: camera}, None, clock)
    findings = check_rig(rig, tmp_path, bytes_needed=0)
    assert [c.name for c in failures(findings)] == ([f"indoor {refused}"] if refused else [])
    settings = {s.name: s.got for d in findings.devices for s in d.settings}
    assert settings["function"] == "normal"
    camera.close()


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="other programs are named by /proc")
@pytest.mark.parametrize("name", GRABBERS)
def test_a_program_that_grabs_cameras_is_named(name: str, tmp_path: Path) -> None:
    program = tmp_path / name
    shutil.copy("/bin/sleep", program)
    with subprocess.Popen([program, "60"]) as process:
        try:
            while Path(f"/proc/{process.pid}/comm").read_text().strip() != name[:15]:
                time.sleep(0.01)  # its name comes a moment after it has been started
            checks = itertools.takewhile(lambda check: check.name != "disk", check_computer(tmp_path))
            found = [c.text for c in checks if c.name == "desktop" and f"kill {process.pid} " in c.advice]
        finally:
            process.kill()
    assert len(found) == 1
    assert found[0].startswith(name[:15])
