"""Every kind of fault has an effect on a camera that a host can see, and is noted when it has had it."""

from __future__ import annotations

import io

import pytest
from PIL import Image

from drivers.canon_5d2.codes import CanonEvent, CanonOperation, CanonProp, CanonResponse
from drivers.ptp.codes import Event, Operation, Prop, Response
from mocks.instruments.faults import Fault, FaultKind
from tests.mocks.instruments import test_canon_5d2, test_theta_z1
from tests.mocks.instruments.fault_dicts import fault_of
from tests.mocks.optics.shot_sources import exposure_time

Canon, Theta = test_canon_5d2.Bench, test_theta_z1.Bench
SHOOT = Operation.INITIATE_CAPTURE


def fired(bench: Canon | Theta) -> set[FaultKind]:
    return {f.kind for f in bench.camera.faults.fired}


@pytest.mark.parametrize(
    ("kind", "code"),
    [
        (FaultKind.STORE_FULL, Response.STORE_FULL),
        (FaultKind.STORE_READ_ONLY, Response.STORE_READ_ONLY),
        (FaultKind.NO_STORAGE, Response.STORE_NOT_AVAILABLE),
        (FaultKind.BUSY, Response.DEVICE_BUSY),
        (FaultKind.ACCESS_DENIED, Response.ACCESS_DENIED),
    ],
)
def test_refusals_of_a_release(kind: FaultKind, code: int) -> None:
    theta = Theta(Fault(kind, SHOOT))
    assert theta.host.call(SHOOT, 0, 0).code == code
    canon = Canon(Fault(kind, CanonOperation.REMOTE_RELEASE_ON))
    assert canon.press(3, 0) == code
    assert fired(theta) == fired(canon) == {kind}


def test_full_and_locked_cards_in_the_older_release() -> None:
    for kind, number in ((FaultKind.STORE_FULL, 7), (FaultKind.STORE_READ_ONLY, 8)):
        assert Canon(Fault(kind)).host.call(CanonOperation.REMOTE_RELEASE).params == (number,)


def test_a_full_store_shows_in_its_description_and_as_an_event() -> None:
    bench = Theta(Fault(FaultKind.STORE_FULL, SHOOT))
    bench.host.call(SHOOT, 0, 0)
    assert bench.host.event() == (Event.STORE_FULL, 0, (0x00020001,))
    assert bench.host.call(Operation.GET_STORAGE_INFO, 0x00020001).data[14:26] == bytes(12)
    assert bench.host.get(0xD006) == b"\1\0\0\0"


def test_without_a_card_nothing_is_found() -> None:
    bench = Theta(Fault(FaultKind.NO_STORAGE))
    assert bench.host.call(Operation.GET_STORAGE_IDS).data == bytes(4)
    assert bench.host.call(Operation.GET_STORAGE_INFO, 0x00020001).code == Response.STORE_NOT_AVAILABLE


def test_a_locked_card_keeps_its_pictures() -> None:
    bench = Theta(Fault(FaultKind.STORE_READ_ONLY, Operation.DELETE_OBJECT))
    handle = bench.shoot()
    assert bench.host.call(Operation.DELETE_OBJECT, handle, 0).code == Response.STORE_READ_ONLY
    assert bench.host.call(Operation.GET_OBJECT, handle).code == Response.OK


def test_low_battery() -> None:
    theta = Theta(Fault(FaultKind.BATTERY_LOW, parameters={"percent": 5}))
    assert theta.host.get(Prop.BATTERY_LEVEL) == b"\5"
    canon = Canon(Fault(FaultKind.BATTERY_LOW))
    assert canon.camera.settings.values[CanonProp.BATTERY_POWER] == 0
    assert canon.press(3, 0) == CanonResponse.LOW_BATTERY


def test_clock_offset_reaches_clock_and_exif() -> None:
    bench = Theta(Fault(FaultKind.CLOCK_OFFSET, parameters={"offset_s": 86400}))
    assert "20230520" in bench.host.get(Prop.DATE_TIME)[1:].decode("utf-16-le")
    bench.shoot()
    assert bench.shots.requests[0].taken_local.day == 20
    canon = Canon(Fault(FaultKind.CLOCK_OFFSET, parameters={"offset_s": 60}))
    offset_s = canon.camera.settings.number(CanonProp.CAMERA_TIME) - canon.clock.utc_now().timestamp()
    assert offset_s == pytest.approx(60, abs=1.5)


def test_asleep_in_the_middle() -> None:
    theta = Theta(Fault(FaultKind.ASLEEP, SHOOT))
    assert theta.host.call(SHOOT, 0, 0).code == Response.DEVICE_BUSY
    canon = Canon(Fault(FaultKind.ASLEEP, CanonOperation.REMOTE_RELEASE))
    with pytest.raises(OSError, match="disconnected"):
        canon.host.call(CanonOperation.REMOTE_RELEASE)
    canon.camera.replug()
    assert canon.camera.plugged
    assert fired(theta) == fired(canon) == {FaultKind.ASLEEP}


@pytest.mark.parametrize(("finds", "code"), [(1, Response.OK), (0, CanonResponse.OPERATION_REFUSED)])
def test_the_lens_switch_left_on_autofocus(finds: int, code: int) -> None:
    bench = Canon(Fault(FaultKind.AUTOFOCUS, parameters={"finds": finds}))
    assert bench.camera.settings.values[CanonProp.FOCUS_MODE] == 0
    assert bench.press(3, 0) == code
    with pytest.raises(ValueError, match="autofocus"):
        Theta(Fault(FaultKind.AUTOFOCUS))


def test_a_setting_silently_not_taken() -> None:
    theta = Theta(Fault(FaultKind.SETTING_NOT_TAKEN, Prop.EXPOSURE_PROGRAM_MODE))
    assert theta.host.set(Prop.EXPOSURE_PROGRAM_MODE, b"\1\0") == Response.OK
    assert theta.host.get(Prop.EXPOSURE_PROGRAM_MODE) == b"\2\0"
    assert theta.host.set(Prop.EXPOSURE_PROGRAM_MODE, b"\1\0") == Response.OK
    assert theta.host.get(Prop.EXPOSURE_PROGRAM_MODE) == b"\1\0"
    canon = Canon(Fault(FaultKind.SETTING_NOT_TAKEN, CanonProp.SHUTTER_SPEED))
    before = canon.camera.settings.number(CanonProp.SHUTTER_SPEED)
    assert canon.value(CanonProp.SHUTTER_SPEED, 0x28).code == Response.OK
    assert canon.camera.settings.number(CanonProp.SHUTTER_SPEED) == before
    assert fired(theta) == fired(canon) == {FaultKind.SETTING_NOT_TAKEN}


def pictures(*faults: Fault) -> list[bytes]:
    """Take three pictures and return them."""
    bench = Theta(*faults)
    bench.manual()
    taken = [bench.host.call(Operation.GET_OBJECT, bench.shoot()).data for _ in range(3)]
    assert fired(bench) == {f.kind for f in faults}
    return taken


def test_wrong_exposure() -> None:
    times_s = [exposure_time(p) for p in pictures(Fault(FaultKind.WRONG_EXPOSURE, nth=2, parameters={"factor": 4}))]
    assert times_s == [pytest.approx(1 / 60), pytest.approx(4 / 60), pytest.approx(1 / 60)]


def test_black_frame_keeps_its_exif() -> None:
    taken = pictures(Fault(FaultKind.BLACK_FRAME, nth=2))
    brightest = [Image.open(io.BytesIO(p)).convert("L").getextrema()[1] for p in taken]
    assert brightest[1] == 0
    assert min(brightest[0], brightest[2]) > 30
    assert exposure_time(taken[1]) == pytest.approx(1 / 60)


def test_repeated_frame() -> None:
    first, second, third = pictures(Fault(FaultKind.REPEATED_FRAME, nth=2))
    assert first == second
    assert third != second


def test_truncated_jpeg() -> None:
    whole, cut, _ = pictures(Fault(FaultKind.TRUNCATED_JPEG, nth=2, parameters={"fraction": 0.5}))
    assert len(cut) == pytest.approx(len(whole) / 2, abs=5)
    assert not cut.rstrip(b"\0").endswith(b"\xff\xd9")


@pytest.mark.parametrize(
    ("kind", "times", "moved"),
    [
        (FaultKind.LOST_EVENT, 0, 0),
        (FaultKind.DUPLICATE_EVENT, 2, 0),
        (FaultKind.OTHER_OBJECT_EVENT, 1, 1000),
        (FaultKind.REORDERED_EVENT, 1, 0),
    ],
)
def test_faults_of_canon_records(kind: FaultKind, times: int, moved: int) -> None:
    bench = Canon(Fault(kind, CanonEvent.OBJECT_ADDED_EX))
    records = bench.shoot()
    bench.clock.sleep(1)
    records += bench.drain()
    (picture,) = bench.camera.store.files()
    assert test_canon_5d2.handles(records, CanonEvent.OBJECT_ADDED_EX) == [picture.handle + moved] * times
    if kind is FaultKind.REORDERED_EVENT:
        assert records[-1][0] == CanonEvent.OBJECT_ADDED_EX
    assert fired(bench) == {kind}


def test_the_cable_pulled_while_a_record_is_fetched() -> None:
    fault = fault_of(
        {"kind": "unplug", "event": int(CanonEvent.OBJECT_ADDED_EX), "phase": "event", "replug_after_s": 1}
    )
    bench = Canon(fault)
    with pytest.raises(OSError, match="disconnected"):
        bench.shoot()
    bench.clock.sleep(2)
    assert bench.camera.plugged
    assert [o.name for o in bench.camera.store.files()] == ["IMG_0001.JPG"]
