"""Two cameras, two threads: neither waits for the other."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor

from drivers.canon_5d2 import codes as canon_codes
from drivers.ptp.codes import Operation
from drivers.theta_z1 import codes as ricoh_codes
from mocks.instruments.canon_5d2 import SimulatedCanon5D2
from mocks.instruments.clock import ScaledClock
from mocks.instruments.theta_z1 import SimulatedThetaZ1
from mocks.instruments.usb.bus import SimulatedUsbBackend
from tests.mocks.instruments.raw_host import RawHost
from tests.mocks.optics.shot_sources import TinyShots
from tests.virtual_clock import VirtualClock

LONG_S = 0.1


class MeetingClock(VirtualClock):
    """Its long sleeps end only when two threads are in one at the same time."""

    def __init__(self) -> None:
        super().__init__()
        self.meeting = threading.Barrier(2)

    def sleep(self, duration_s: float) -> None:
        if duration_s > LONG_S:
            self.meeting.wait(timeout=120)
        super().sleep(duration_s)


def fetch(host: RawHost) -> int:
    """Read the first picture of an open session and return its size."""
    data = host.call(Operation.GET_OBJECT_HANDLES, 0xFFFFFFFF, 0x3801, 0).data
    return len(host.call(Operation.GET_OBJECT, int.from_bytes(data[4:8], "little")).data)


def test_transfers_of_two_cameras_run_at_the_same_time() -> None:
    clock = MeetingClock()
    shots = TinyShots(padding=5_000_000)
    cameras = (SimulatedThetaZ1(shots, clock), SimulatedCanon5D2(shots, clock))
    backend = SimulatedUsbBackend(cameras, clock)
    hosts = [RawHost(backend, ids) for ids in (ricoh_codes.USB_ID, canon_codes.USB_ID)]
    for host, camera in zip(hosts, cameras, strict=True):
        host.open()
        camera.press_shutter()
    VirtualClock.sleep(clock, 3)
    with ThreadPoolExecutor(2) as pool:
        sizes = list(pool.map(fetch, hosts))
    assert min(sizes) > 5_000_000
    assert clock.meeting.broken is False


def test_many_transactions_from_two_threads_at_high_speed() -> None:
    clock = ScaledClock(200)
    cameras = (SimulatedThetaZ1(TinyShots(), clock), SimulatedCanon5D2(TinyShots(), clock))
    backend = SimulatedUsbBackend(cameras, clock)

    def chat(ids: tuple[int, int]) -> int:
        host = RawHost(backend, ids)
        host.open()
        return sum(host.call(Operation.GET_DEVICE_INFO).code == 0x2001 for _ in range(100))

    with ThreadPoolExecutor(2) as pool:
        assert list(pool.map(chat, (ricoh_codes.USB_ID, canon_codes.USB_ID))) == [100, 100]
    assert [c.stats.violations for c in cameras] == [[], []]
