"""Our PTP initiator on libgphoto2's virtual camera (PyPI wheel gphoto2): through PtpSession, UsbLink and pyusb."""

from __future__ import annotations

import hashlib
import re
from pathlib import Path
from typing import Any

import pytest

from drivers.errors import StoreFullError
from drivers.ptp.codes import HEADER_BYTES, DataType, Event, FormFlag, ObjectFormat, Operation, Prop
from drivers.ptp.datasets import decode_date
from drivers.ptp.session import ALL_STORAGES, PtpEvent, PtpSession
from drivers.usb_link import UsbLink
from tests.peers.camera_talk import (
    EXPOSURE_TIME,
    STORAGE,
    added_pictures,
    capture,
    events_until,
    get_object,
    handle_of,
    new_session,
)
from tests.peers.vcamera import NO_LIBRARY, VirtualCameraBackend, find_library

pytestmark = [pytest.mark.peer, pytest.mark.skipif(find_library() is None, reason=NO_LIBRARY)]
ROOT = 0xFFFFFFFF
UNPROMPTED = 0xFFFFFFFF
PICTURES_UNTIL_FULL = 26
PACKET_BYTES = 512
LAST_EVENT_S = 1.5
"""No event of the camera comes later than a second after its cause."""


# ---- what the camera says of itself


def test_device_info_is_what_libgphoto2_reads(session: PtpSession, result: dict[str, Any]) -> None:
    info = session.device_info()
    assert result["config"] == {
        "manufacturer": info.manufacturer,
        "cameramodel": info.model,
        "deviceversion": info.device_version,
        "serialnumber": info.serial,
        "vendorextension": info.vendor_extension_desc,
    }
    extension = f"Vendor Extension ID: {info.vendor_extension_id:#x} ({info.vendor_extension_version / 100:.1f})"
    assert extension in result["summary"]
    assert info.operations[:3] == (Operation.GET_DEVICE_INFO, Operation.OPEN_SESSION, Operation.CLOSE_SESSION)
    assert Operation.INITIATE_CAPTURE in info.operations
    assert Operation.GET_PARTIAL_OBJECT not in info.operations
    assert info.events == (
        Event.OBJECT_ADDED,
        Event.OBJECT_REMOVED,
        Event.DEVICE_PROP_CHANGED,
        Event.STORE_FULL,
        Event.CAPTURE_COMPLETE,
    )
    assert "Capture Formats: JPEG\n" in result["summary"]
    assert info.capture_formats == info.image_formats == (ObjectFormat.EXIF_JPEG,)


def test_device_info_works_without_a_session(link: UsbLink, backend: VirtualCameraBackend) -> None:
    session = new_session(link)
    assert session.device_info().model == "VC"
    (transfer,) = backend.transfers
    assert transfer.endswith(bytes([0x0C, 0, 0, 0, 3, 0, 0x01, 0x20, 0, 0, 0, 0])), "data and response came in one read"


def test_store(session: PtpSession, result: dict[str, Any]) -> None:
    assert session.get_storage_ids() == (STORAGE,)
    info = session.get_storage_info(STORAGE)
    assert result["store"] == {
        "capacity_kib": info.max_bytes // 1024,
        "free_kib": info.free_bytes // 1024,
        "free_images": info.free_images,
        "description": info.description,
        "label": info.label,
    }
    assert f"Maximum Capability: {info.max_bytes} " in result["summary"]


# ---- objects


def test_handles_name_every_object_once(session: PtpSession) -> None:
    handles = session.get_object_handles()
    assert len(set(handles)) == len(handles)
    names = {session.get_object_info(h).filename for h in handles}
    assert names == {"DCIM", "100DAYLT", "IMG_0001.JPG", "IMG_0002.DNG", "NOTE.TXT", "EMPTY.TXT"}
    assert session.transact(Operation.GET_NUM_OBJECTS, (ALL_STORAGES,)).params == (len(handles),)
    (dcim,) = session.get_object_handles(STORAGE, 0, ROOT)
    assert session.get_object_info(dcim).filename == "DCIM"
    inside = session.get_object_handles(STORAGE, 0, dcim)
    assert {session.get_object_info(h).filename for h in inside} == {"100DAYLT", "NOTE.TXT", "EMPTY.TXT"}


def test_object_info_is_what_libgphoto2_reads(session: PtpSession, card: Path, result: dict[str, Any]) -> None:
    infos = [session.get_object_info(h) for h in session.get_object_handles()]
    files = {i.filename: i for i in infos if i.format_code != ObjectFormat.ASSOCIATION}
    assert {f["name"] for f in result["files"]} == set(files)
    for file in result["files"]:
        info = files[file["name"]]
        path = next(card.rglob(file["name"]))
        assert info.size_bytes == file["size_bytes"] == path.stat().st_size
        assert [info.image_width_px, info.image_height_px] == file["size_px"]
        assert session.get_object_info(info.parent).filename == file["folder"] == path.parent.name
        assert info.storage_id == STORAGE
        assert decode_date(info.capture_date) is not None
    assert files["IMG_0001.JPG"].format_code == ObjectFormat.EXIF_JPEG
    assert (files["IMG_0001.JPG"].image_width_px, files["IMG_0001.JPG"].image_height_px) == (64, 32)
    assert files["IMG_0002.DNG"].format_code == ObjectFormat.DNG
    folders = [i for i in infos if i.format_code == ObjectFormat.ASSOCIATION]
    assert [i.association_type for i in folders] == [1, 1]


@pytest.mark.parametrize("name", ["IMG_0001.JPG", "IMG_0002.DNG", "NOTE.TXT"])
def test_objects_arrive_byte_by_byte(session: PtpSession, card: Path, result: dict[str, Any], name: str) -> None:
    data = get_object(session, handle_of(session, name))
    assert data == next(card.rglob(name)).read_bytes()
    assert {f["sha256"] for f in result["files"] if f["name"] == name} == {hashlib.sha256(data).hexdigest()}
    assert session.late_answers == 0


def test_a_jpeg_whose_data_ends_with_a_packet(card: Path) -> None:
    assert (next(card.rglob("*.JPG")).stat().st_size + HEADER_BYTES) % PACKET_BYTES == 0, "the case above is that one"


# ---- properties


def summary_of(result: dict[str, Any], prop: int) -> re.Match[str]:
    """Return access, type, form and value of a property as libgphoto2's summary writes them."""
    line = re.search(rf"\({prop:04x} (r[ow]) (\w+) *\): (\w+) \[([^]]*)\] value: (.*)", result["summary"])
    assert line is not None
    return line


@pytest.mark.parametrize(
    ("prop", "data_type", "name"),
    [
        (Prop.BATTERY_LEVEL, DataType.UINT8, "u8"),
        (Prop.IMAGE_SIZE, DataType.STRING, "str"),
        (Prop.F_NUMBER, DataType.UINT16, "u16"),
        (Prop.EXPOSURE_BIAS, DataType.INT16, "i16"),
        (EXPOSURE_TIME, DataType.UINT32, "u32"),
    ],
)
def test_descriptions_are_what_libgphoto2_reads(
    session: PtpSession, result: dict[str, Any], prop: int, data_type: DataType, name: str
) -> None:
    desc = session.get_prop_desc(prop)
    access, kind, form, values, current = summary_of(result, prop).groups()
    assert (desc.data_type, kind) == (data_type, name)
    assert desc.writable == (access == "rw")
    assert str(desc.current) in current
    found = tuple(re.findall(r"-?\d+(?:x\d+)?", values.replace(" - ", " ")))
    if form == "Range":
        assert desc.form is FormFlag.RANGE
        assert tuple(map(str, desc.value_range or ())) == found
    else:
        assert desc.form is FormFlag.ENUMERATION
        assert tuple(map(str, desc.choices)) == found
    assert session.get_prop_value(prop, data_type) == desc.current


def test_the_date_is_a_date(session: PtpSession) -> None:
    desc = session.get_prop_desc(Prop.DATE_TIME)
    assert desc.form is FormFlag.NONE
    assert re.fullmatch(r"\d{8}T\d{6}", str(desc.current))
    session.set_prop_value(Prop.DATE_TIME, DataType.STRING, "20260620T120000")


@pytest.mark.parametrize(
    ("prop", "data_type", "value"),
    [
        (EXPOSURE_TIME, DataType.UINT32, 10000),
        (Prop.F_NUMBER, DataType.UINT16, 1600),
        (Prop.EXPOSURE_BIAS, DataType.INT16, -1500),
    ],
)
def test_settings_are_taken_and_announced(session: PtpSession, prop: int, data_type: DataType, value: int) -> None:
    session.set_prop_value(prop, data_type, value)
    assert session.get_prop_value(prop, data_type) == value
    assert session.get_prop_desc(prop).current == value
    # Inside, the camera reads the description with each of the three, and announces whatever it has read or set.
    announced = PtpEvent(Event.DEVICE_PROP_CHANGED, UNPROMPTED, (prop,))
    assert [events_until(session, Event.DEVICE_PROP_CHANGED) for _ in range(5)] == 5 * [[announced]]
    assert session.poll_event(LAST_EVENT_S) is None


# ---- pictures


def test_the_first_object_of_a_capture_is_a_folder(session: PtpSession, card: Path) -> None:
    events = capture(session)
    command = session.last_transaction_id
    assert [e.code for e in events] == [Event.OBJECT_ADDED, Event.OBJECT_ADDED, Event.CAPTURE_COMPLETE]
    assert {e.transaction_id for e in events} == {command}
    folder, picture = (e.params[0] for e in events[:2])
    assert session.get_object_info(folder).format_code == ObjectFormat.ASSOCIATION
    info = session.get_object_info(picture)
    assert (info.format_code, info.parent) == (ObjectFormat.EXIF_JPEG, folder)
    assert get_object(session, picture) == next(card.rglob("IMG_0001.JPG")).read_bytes()
    assert picture in session.get_object_handles(STORAGE, 0, folder)


def test_capture_complete_names_no_object(session: PtpSession) -> None:
    complete = capture(session)[-1]
    assert complete.params == (0,), "the camera fills the parameter it does not have with zero"
    assert complete.params[0] not in session.get_object_handles()


def test_the_card_is_full_after_26_pictures(session: PtpSession) -> None:
    pictures = [handle for _ in range(PICTURES_UNTIL_FULL) for handle in added_pictures(session, capture(session))]
    assert len(set(pictures)) == PICTURES_UNTIL_FULL
    session.transact(Operation.INITIATE_CAPTURE, (0, 0))
    (event,) = events_until(session, Event.STORE_FULL)
    assert event.params == (pictures[-1],), "the camera names its last object here, not the store"
    assert session.poll_event(LAST_EVENT_S) is None
    with pytest.raises(StoreFullError, match="the card is full"):
        session.transact(Operation.INITIATE_CAPTURE, (0, 0))
    assert session.broken is None
    assert session.get_object_info(pictures[-1]).format_code == ObjectFormat.EXIF_JPEG
