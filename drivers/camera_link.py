"""One camera's cable and session, opened by a factory so that both can be replaced when the cable comes back."""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass

from drivers.camera import FrameFormat, FrameRef
from drivers.clock import Clock
from drivers.errors import DeviceLostError, DeviceNotFoundError, OperationRefusedError, UnsupportedError
from drivers.ptp.codes import Response
from drivers.ptp.datasets import DeviceInfo
from drivers.ptp.pipes import PtpTransport
from drivers.ptp.session import PtpSession

TRANSACTION_LIMIT_S = 8.0
"""Of one transaction; the slowest known (half press with a slow lens, opening a session) may need as long."""


@dataclass(frozen=True)
class CameraModel:
    """What a camera must say of itself before it is spoken to any further."""

    name: str
    vendor_extension_ids: Collection[int]
    required_operations: Collection[int]


class CameraLink:
    """Holds the session of one camera; `open` it, `recover` it, `close` it."""

    def __init__(self, open_transport: Callable[[], PtpTransport], clock: Clock, model: CameraModel) -> None:
        self._open_transport = open_transport
        self._clock = clock
        self._model = model
        self._session: PtpSession | None = None
        self._info: DeviceInfo | None = None
        self._generation = 0  # of the session in which the camera has last said who it is

    @property
    def name(self) -> str:
        """What to call the camera in messages."""
        return self._model.name

    @property
    def session(self) -> PtpSession:
        """The open session; `DeviceLostError` while there is none."""
        if self._session is None:
            likely = "it was unplugged or switched off"
            advice = "check the cable and the power switch, then resume"
            raise DeviceLostError("not connected", where=self._model.name, likely=likely, advice=advice)
        return self._session

    @property
    def info(self) -> DeviceInfo:
        """What the camera says of itself; `DeviceLostError` before the first `open`."""
        if self._info is None:
            raise DeviceLostError("not connected", where=self._model.name, advice="connect first")
        return self._info

    def open(self) -> DeviceInfo:
        """Open transport and session and check that the camera is of the right kind.

        Raises `UnsupportedError`: another PTP extension, or operations missing; `DeviceError`: what the transport or
        the session raises; nothing stays open then.
        """
        self.close()
        transport = self._open_transport()
        try:
            session = PtpSession(transport, self._clock, name=self._model.name, timeout_s=TRANSACTION_LIMIT_S)
            session.open()
            info = session.device_info()
            self._check(info)
        except BaseException:
            transport.close()
            raise
        self._session, self._info, self._generation = session, info, session.generation
        return info

    def _check(self, info: DeviceInfo) -> None:
        if info.vendor_extension_id not in self._model.vendor_extension_ids:
            known = " or ".join(f"{i:#x}" for i in self._model.vendor_extension_ids)
            text = f"{info.model!r} speaks PTP extension {info.vendor_extension_id:#x}, not {known}"
            likely = "another camera, or the camera is in another USB mode"
            advice = "connect the camera that the rig file names, in its still-picture (MTP/PTP) mode"
            raise UnsupportedError(text, where=self._model.name, likely=likely, advice=advice)
        missing = set(self._model.required_operations) - set(info.operations)
        if missing:
            text = f"{info.model!r} lacks the operations {', '.join(f'{code:#06x}' for code in sorted(missing))}"
            likely, advice = "another model, or firmware that is too old", "update the camera's firmware"
            raise UnsupportedError(text, where=self._model.name, likely=likely, advice=advice)

    def recover(self, *, from_port_reset: bool = False) -> bool:
        """Bring the session back into step, by reopening the link where nothing milder helps (or is wanted).

        Returns whether it is a new session (the camera may have lost modes and settings).

        Raises `DeviceNotFoundError`: another camera than before answers; `DeviceError`: what is still wrong after
        `drivers.ptp.resync.RESYNC_LIMIT_S`.
        """
        if self._session is None:
            before = self._info
            self.open()
            self._require_same(before)
            return True
        self._session.resynchronise(from_port_reset=from_port_reset)
        if self._session.generation == self._generation:
            return False
        before, self._info = self._info, self._session.device_info()
        self._generation = self._session.generation
        self._require_same(before)
        return True

    def _require_same(self, before: DeviceInfo | None) -> None:
        if before is None or before.serial == self.info.serial:
            return
        other, self._info = self.info.serial, before
        self.close()
        text = f"another camera answers: serial number {other}, not {before.serial}"
        advice = "plug the first camera in again, or start a new session with this one"
        raise DeviceNotFoundError(text, where=self._model.name, advice=advice)

    def close(self) -> None:
        """Close session and transport; never raises."""
        if self._session is not None:
            self._session.close()
        self._session = None


# The pictures on a camera's store, and which of them are new; shared by the cameras that keep a card.


GONE = (Response.INVALID_OBJECT_HANDLE, Response.NO_VALID_OBJECT_INFO)
# An object of 4 GiB or more (PTP 1.1, ObjectInfo).
UNKNOWN_SIZE = 0xFFFFFFFF


class FrameStore:
    """Looks at objects of the store; ``known`` holds every handle that was there before or has been taken over."""

    def __init__(self, link: CameraLink, formats: Mapping[int, FrameFormat]) -> None:
        self.known: set[int] = set()
        self._link = link
        self._formats = formats

    def remember(self) -> None:
        """Take all that is on the store now for known."""
        self.known = set(self._link.session.get_object_handles())

    def new_handles(self) -> list[int]:
        """Return the handles that are on the store and not known, oldest first."""
        return sorted(set(self._link.session.get_object_handles()) - self.known)

    def look_at(self, handle: int) -> FrameRef | None:
        """Return the picture behind a handle, or None for a folder, a film, or what is gone again."""
        try:
            info = self._link.session.get_object_info(handle)
        except OperationRefusedError as error:
            if error.response_code in GONE:
                return None
            raise
        frame_format = self._formats.get(info.format_code)
        if frame_format is None or info.size_bytes in (0, UNKNOWN_SIZE):
            return None
        return FrameRef(handle, info.filename, frame_format, info.size_bytes, info.storage_id)

    def list_frames(self) -> tuple[FrameRef, ...]:
        """Return all pictures on the store, oldest first."""
        found = (self.look_at(handle) for handle in sorted(self._link.session.get_object_handles()))
        return tuple(frame for frame in found if frame is not None)

    def holds(self, frame: FrameRef) -> bool:
        """Whether the store has this picture under its handle, and not another: handles may change with a session."""
        found = self.look_at(frame.handle)
        return found is not None and (found.name, found.size_bytes) == (frame.name, frame.size_bytes)

    def delete(self, frame: FrameRef) -> None:
        """Delete a picture; another one that has its handle now is left alone."""
        if self.holds(frame):
            self._link.session.delete_object(frame.handle)
            self.known.discard(frame.handle)  # cameras that make handles of file numbers use it again


class ExpectedFrames:
    """The frames that one exposure makes, filled in as they are announced: one of each format."""

    def __init__(self, formats: Collection[FrameFormat]) -> None:
        self._formats = tuple(formats)
        self._found: dict[FrameFormat, FrameRef] = {}

    def add(self, frame: FrameRef) -> bool:
        """Take a frame in; False where no such frame is expected, or it is there already."""
        if frame.format not in self._formats or frame.format in self._found:
            return False
        self._found[frame.format] = frame
        return True

    @property
    def complete(self) -> bool:
        """Whether all are there."""
        return len(self._found) == len(self._formats)

    @property
    def frames(self) -> tuple[FrameRef, ...]:
        """Those that are there, in the order in which they were expected (JPEG first)."""
        return tuple(self._found[f] for f in self._formats if f in self._found)
