"""The smallest camera: it keeps bytes and gives them back; for tests of what lies below the cameras."""

from __future__ import annotations

from drivers.clock import Clock
from mocks.instruments.exposures import CameraTiming
from mocks.instruments.faults import Fault, FaultSchedule
from mocks.instruments.ptp.responder import PtpResponder
from mocks.instruments.ptp.wire import Answer, DeviceIdentity, Request, Rule

KEEP, GIVE, SIGNAL, SLOW = 0x9000, 0x9001, 0x9002, 0x9003
IDENTITY = DeviceIdentity(
    usb_id=(0x1209, 0x0001),
    endpoints=(0x81, 0x02, 0x83),
    interrupt_packet_bytes=8,
    vendor_extension=(0, 0),
    operations=(0x1001, 0x1002, 0x1003, KEEP, GIVE, SIGNAL, SLOW),
    events=(),
    properties=(),
    capture_formats=(),
    image_formats=(),
    manufacturer="Nobody",
    model="Echo",
    version="1",
    serial="7",
)
TIMING = CameraTiming(release_lag_s=0, processing_s=0, transfer_bytes_per_s=1e6, transaction_latency_s=0.001)


class Echo(PtpResponder):
    """KEEP takes data, GIVE returns it (or as many bytes as asked), SIGNAL emits an event, SLOW thinks 5 s."""

    def __init__(self, clock: Clock, *faults: Fault) -> None:
        self.kept = b""
        super().__init__(IDENTITY, clock, TIMING, FaultSchedule.of(*faults), 0)

    def standard_rules(self) -> dict[int, Rule]:
        more = {
            KEEP: Rule(self._keep, data_out=True),
            GIVE: Rule(self._give, 0, 1),
            SIGNAL: Rule(self._signal, 1, 3),
            SLOW: Rule(lambda _request: Answer(delay_s=5.0)),
        }
        return {**super().standard_rules(), **more}

    def _keep(self, request: Request) -> Answer:
        self.kept = request.data
        return Answer(params=(len(request.data),))

    def _give(self, request: Request) -> Answer:
        return Answer(data=bytes(i % 251 for i in range(request.param(0))) if request.params else self.kept)

    def _signal(self, request: Request) -> Answer:
        self.emit(*request.params, transaction_id=request.transaction_id)
        return Answer()
