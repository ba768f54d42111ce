"""Debian's gphoto2, and our own driver through the real libusb, on an emulated USB bus with recorded bodies."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

WRAPPER, GPHOTO2, PYTHON = shutil.which("umockdev-wrapper"), shutil.which("gphoto2"), "/usr/bin/python3"
ROOT = Path(__file__).resolve().parents[2]
BINDINGS = "import gi; gi.require_version('UMockdev', '1.0'); from gi.repository import UMockdev"
LIMIT_S = 240


def _why_not() -> str:
    """Return what is missing; the bridge runs in the system's Python, which must be of our version."""
    if WRAPPER is None or GPHOTO2 is None:
        return "umockdev or gphoto2 is not installed (Debian: apt install umockdev gir1.2-umockdev-1.0 gphoto2)"
    version = f"import sys; sys.exit(sys.version_info[:2] != {sys.version_info[:2]}); {BINDINGS}"
    if subprocess.run([PYTHON, "-c", f"{BINDINGS}; {version}"], capture_output=True, check=False).returncode:
        return f"{PYTHON} has no bindings of umockdev, or another version than {sys.version_info[:2]}"
    return ""


MISSING = _why_not()
pytestmark = [pytest.mark.peer, pytest.mark.skipif(bool(MISSING), reason=MISSING)]


def on_usb(body: str, folder: Path, *command: str) -> tuple[str, dict[str, object]]:
    """Run a command with a recorded body on the bus; return its output and what the camera saw of it."""
    path = f"{ROOT}:{sysconfig.get_path('purelib')}"
    environment = {**os.environ, "LC_ALL": "C", "HOME": str(folder), "PYTHONPATH": path}
    words = [str(WRAPPER), PYTHON, "-m", "tests.peers.umockdev_usb", body, *command]
    done = subprocess.run(
        words, cwd=folder, env=environment, capture_output=True, text=True, timeout=LIMIT_S, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    *output, seen = done.stdout.strip().splitlines()
    return "\n".join(output), json.loads(seen)


@pytest.mark.parametrize("target", ["card", "computer"])
@pytest.mark.parametrize("body", ["eos_5d2", "eos_5d3", "eos_60d"])
def test_gphoto2_takes_a_picture(body: str, target: str, tmp_path: Path) -> None:
    wanted = ("--set-config", f"capturetarget={int(target == 'card')}", "--set-config", "shutterspeed=1/60")
    output, seen = on_usb(body, tmp_path, "gphoto2", *wanted, "--capture-image-and-download", "--filename", "a.jpg")
    assert ("/DCIM/100CANON/IMG_0001.JPG" in output) == (target == "card")
    assert (tmp_path / "a.jpg").read_bytes()[2:10] == b"0.016667"
    assert seen == {"violations": [], "shots": 1}


def test_our_driver_conforms_through_libusb(tmp_path: Path) -> None:
    (tmp_path / "rig.toml").write_text(
        '[outdoor]\nkind = "canon_5d2"\niso = 200\nf_number = 16\nsize_px = [5616, 3744]\n', encoding="utf-8"
    )
    words = (sys.executable, "-m", "daylit", "conform", "--rig", "rig.toml", "--delete", "--json")
    output, seen = on_usb("eos_5d2", tmp_path, *words)
    assert json.loads(output)["ok"]
    assert seen["violations"] == []
