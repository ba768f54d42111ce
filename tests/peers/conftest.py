"""A card, the virtual camera that reads it, and our session with that camera."""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from PIL import Image
from PIL.ExifTags import IFD, Base

from drivers.clock import SystemClock
from drivers.ptp.codes import HEADER_BYTES
from drivers.ptp.session import PtpSession
from drivers.usb_link import UsbLink
from tests.peers.camera_talk import new_session
from tests.peers.vcamera import USB_IDS, VirtualCamera, VirtualCameraBackend

PACKET_BYTES = 512


def fill(folder: Path) -> None:
    """Make a card: a JPEG whose container ends with a packet, a raw file longer than a read, a text, an empty file."""
    pictures = folder / "DCIM" / "100DAYLT"
    pictures.mkdir(parents=True)
    exif = Image.Exif()
    exif.get_ifd(IFD.Exif).update({Base.ExifImageWidth: 64, Base.ExifImageHeight: 32})
    jpeg = pictures / "IMG_0001.JPG"
    Image.new("RGB", (64, 32), (90, 120, 60)).save(jpeg, exif=exif)
    data = jpeg.read_bytes()
    jpeg.write_bytes(data + bytes(-(len(data) + HEADER_BYTES) % PACKET_BYTES))
    (pictures / "IMG_0002.DNG").write_bytes(hashlib.shake_256(b"daylit").digest(1_300_001))
    (folder / "DCIM" / "NOTE.TXT").write_bytes(b"grey card in frame 1\n")
    (folder / "DCIM" / "EMPTY.TXT").write_bytes(b"")


@pytest.fixture(scope="module")
def card(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The card's folder; the camera only reads it."""
    folder = tmp_path_factory.mktemp("card")
    fill(folder)
    return folder


@pytest.fixture
def backend(card: Path) -> Iterator[VirtualCameraBackend]:
    with VirtualCamera(card) as camera:
        yield VirtualCameraBackend(camera)


@pytest.fixture
def link(backend: VirtualCameraBackend) -> Iterator[UsbLink]:
    link = UsbLink.open(*USB_IDS, backend=backend, clock=SystemClock())
    yield link
    link.close()


@pytest.fixture
def session(link: UsbLink) -> Iterator[PtpSession]:
    session = new_session(link)
    session.open()
    yield session
    session.close()


@pytest.fixture(scope="module")
def result(card: Path) -> dict[str, Any]:
    """What libgphoto2's own initiator says of the same card in the same camera."""
    script = Path(__file__).with_name("gphoto2_report.py")
    done = subprocess.run(
        [sys.executable, "-I", str(script)],
        env={**os.environ, "VCAMERADIR": str(card), "LC_ALL": "C"},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    answer: dict[str, Any] = json.loads(done.stdout)
    return answer
