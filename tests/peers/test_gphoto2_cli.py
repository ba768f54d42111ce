"""Debian's gphoto2 as an independent initiator: it finds, sets and fires the simulated cameras over PTP/IP."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from drivers.canon_5d2.codes import CanonProp
from drivers.clock import SystemClock
from drivers.ptp.codes import Operation, Prop
from drivers.theta_z1.codes import RicohProp
from mocks.instruments.canon_5d2 import SimulatedCanon5D2
from mocks.instruments.theta_z1 import SimulatedThetaZ1
from tests.mocks.optics.shot_sources import TinyShots
from tests.peers.ptp_ip import LOOPBACK, PtpIpServer

GPHOTO2 = shutil.which("gphoto2")
pytestmark = [
    pytest.mark.peer,
    pytest.mark.skipif(GPHOTO2 is None, reason="the gphoto2 command is not installed (Debian: apt install gphoto2)"),
]
THETA, CANON = "Ricoh Theta (WLAN)", "Canon EOS (WLAN)"
LIMIT_S = 60
PICTURE_PADDING = 700_001
"""So that a picture takes several packets and no round number of them."""

Gphoto2 = Callable[..., str]


@pytest.fixture
def theta() -> SimulatedThetaZ1:
    return SimulatedThetaZ1(TinyShots(PICTURE_PADDING), SystemClock())


@pytest.fixture
def canon() -> SimulatedCanon5D2:
    return SimulatedCanon5D2(TinyShots(PICTURE_PADDING), SystemClock())


def gphoto2_on(camera: SimulatedThetaZ1 | SimulatedCanon5D2, model: str, folder: Path) -> Iterator[Gphoto2]:
    environment = {**os.environ, "LC_ALL": "C", "HOME": str(folder)}
    with PtpIpServer(camera) as server:

        def run(*arguments: str) -> str:
            port = f"ptpip:{LOOPBACK}:{server.port}:{server.port}"
            command = [str(GPHOTO2), "--port", port, "--camera", model, *arguments]
            done = subprocess.run(
                command, cwd=folder, env=environment, capture_output=True, text=True, timeout=LIMIT_S, check=False
            )
            assert done.returncode == 0, done.stdout + done.stderr
            return done.stdout

        yield run
    assert camera.stats.violations == [], "an initiator used for years makes no mistakes: ours then"


@pytest.fixture
def theta_cli(theta: SimulatedThetaZ1, tmp_path: Path) -> Iterator[Gphoto2]:
    yield from gphoto2_on(theta, THETA, tmp_path)


@pytest.fixture
def canon_cli(canon: SimulatedCanon5D2, tmp_path: Path) -> Iterator[Gphoto2]:
    yield from gphoto2_on(canon, CANON, tmp_path)


def test_theta_summary(theta_cli: Gphoto2, theta: SimulatedThetaZ1) -> None:
    summary = theta_cli("--summary")
    assert "Manufacturer: Ricoh Company, Ltd." in summary
    assert "Model: RICOH THETA Z1" in summary
    assert "Display Formats: Association/Directory, JPEG, MP4, DNG, Firmware" in summary
    assert "store_00020001" in summary
    assert "Maximum Capability: 21055815680" in summary
    assert "Battery Level(0x5001):(read only) (type=0x2) Range [0 - 100, step 1] value: 90%" in summary
    assert "Still Capture Mode(0x5013)" in summary
    asked = {o.params[0] for o in theta.stats.operations if o.operation == Operation.GET_DEVICE_PROP_DESC}
    assert asked == set(theta.identity.properties), "every description was read and understood"


def test_theta_takes_settings(theta_cli: Gphoto2, theta: SimulatedThetaZ1) -> None:
    theta_cli("--set-config", "500e=1")
    one_sixtieth = 60 << 32 | 1
    assert f"Current: {one_sixtieth}" in theta_cli("--set-config", f"d00f={one_sixtieth}", "--get-config", "d00f")
    theta_cli("--set-config", "5007=560", "--set-config", "500f=100")
    values = theta.properties.values
    assert values[RicohProp.SHUTTER_SPEED] == one_sixtieth
    assert (values[Prop.F_NUMBER], values[Prop.EXPOSURE_INDEX]) == (560, 100)


def test_theta_capture_arrives_byte_by_byte(theta_cli: Gphoto2, theta: SimulatedThetaZ1, tmp_path: Path) -> None:
    theta_cli("--capture-image-and-download", "--keep", "--filename", "shot.jpg")
    (kept,) = theta.store.files()
    assert (tmp_path / "shot.jpg").read_bytes() == kept.data
    assert len(kept.data) > PICTURE_PADDING
    assert len(theta.exposure_log) == 1


def test_theta_lists_fetches_and_deletes(theta_cli: Gphoto2, theta: SimulatedThetaZ1, tmp_path: Path) -> None:
    theta_cli("--capture-image")
    assert "R0010001.JPG" in theta_cli("--list-files")
    (kept,) = theta.store.files()
    theta_cli("--get-file", "1", "--filename", "again.jpg")
    assert (tmp_path / "again.jpg").read_bytes() == kept.data
    theta_cli("--folder", "/store_00020001/DCIM/100RICOH", "--delete-file", "1")
    assert list(theta.store.files()) == []


def test_canon_summary(canon_cli: Gphoto2) -> None:
    summary = canon_cli("--summary")
    assert "Manufacturer: Canon Inc." in summary
    assert "Model: Canon EOS 5D Mark II" in summary
    assert "Canon EOS Capture, Canon EOS Capture 2" in summary
    assert "Storage Type: Removable RAM (memory card)" in summary


def test_canon_takes_settings(canon_cli: Gphoto2, canon: SimulatedCanon5D2) -> None:
    result = canon_cli("--set-config", "shutterspeed=1/60", "--get-config", "shutterspeed")
    assert "Current: 1/60" in result
    assert "1/8000" in result
    canon_cli(
        "--set-config", "iso=200", "--set-config", "aperture=16", "--set-config", "whitebalance=Color Temperature"
    )
    number = canon.settings.number
    assert number(CanonProp.SHUTTER_SPEED) == 0x68
    assert number(CanonProp.ISO_SPEED) == 0x50
    assert number(CanonProp.APERTURE) == 0x48
    assert number(CanonProp.WHITE_BALANCE) == 9


def test_canon_capture_to_the_card(canon_cli: Gphoto2, canon: SimulatedCanon5D2, tmp_path: Path) -> None:
    canon_cli(
        *("--set-config", "capturetarget=1", "--set-config", "shutterspeed=1/250"),
        *("--capture-image-and-download", "--keep", "--filename", "card.jpg"),
    )
    (kept,) = canon.store.files()
    assert (tmp_path / "card.jpg").read_bytes() == kept.data
    assert canon.exposure_log[0].nominal_s == 1 / 250


def test_canon_capture_to_the_computer(canon_cli: Gphoto2, canon: SimulatedCanon5D2, tmp_path: Path) -> None:
    sent: list[bytes] = []
    remember = canon.remember

    def watch(name: str, object_format: int, data: bytes, size_px: tuple[int, int]) -> object:
        sent.append(data)
        return remember(name, object_format, data, size_px)

    canon.remember = watch  # type: ignore[method-assign,assignment]
    canon_cli("--set-config", "capturetarget=0", "--capture-image-and-download", "--filename", "memory.jpg")
    assert (tmp_path / "memory.jpg").read_bytes() == sent[0]
    assert list(canon.store.files()) == []
    assert canon.memory == {}, "gphoto2 says when it has fetched a picture"


def test_canon_raw_and_jpeg(canon_cli: Gphoto2, canon: SimulatedCanon5D2, tmp_path: Path) -> None:
    canon_cli(
        *("--set-config", "capturetarget=1", "--set-config", "imageformat=RAW + Large Fine JPEG"),
        *("--capture-image-and-download", "--keep", "--filename", "both.%C"),
    )
    kept = {Path(o.name).suffix: o.data for o in canon.store.files()}
    assert set(kept) == {".JPG", ".CR2"}
    for suffix, data in kept.items():
        assert (tmp_path / f"both{suffix}").read_bytes() == data


def test_canon_lists_the_card(canon_cli: Gphoto2, tmp_path: Path) -> None:
    canon_cli("--set-config", "capturetarget=1", "--capture-image-and-download", "--keep", "--filename", "a.jpg")
    assert "IMG_0001.JPG" in canon_cli("--list-files")
