"""The pictures on a camera's store, and which of them are new; shared by the cameras that keep a card."""

from __future__ import annotations

from collections.abc import Collection, Mapping

from drivers.camera import FrameFormat, FrameRef
from drivers.camera_link import CameraLink
from drivers.errors import OperationRefusedError
from drivers.ptp.codes import Response

GONE = (Response.INVALID_OBJECT_HANDLE, Response.NO_VALID_OBJECT_INFO)
UNKNOWN_SIZE = 0xFFFFFFFF


class FrameStore:
    """Looks at objects of the store; ``known`` holds every handle that was there before or has been taken over."""

    def __init__(self, link: CameraLink, formats: Mapping[int, FrameFormat]) -> None:
        self.known: set[int] = set()
        self._link = link
        self._formats = formats

    def remember(self) -> None:
        """Take all that is on the store now for known."""
        self.known = set(self._handles())

    def new_handles(self) -> list[int]:
        """Return the handles that are on the store and not known, oldest first."""
        return sorted(set(self._handles()) - self.known)

    def _handles(self) -> tuple[int, ...]:
        return self._link.session.get_object_handles()

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
        found = (self.look_at(handle) for handle in sorted(self._handles()))
        return tuple(frame for frame in found if frame is not None)

    def delete(self, frame: FrameRef) -> None:
        """Delete a picture; another one that has its handle now (they may change with a session) is left alone."""
        found = self.look_at(frame.handle)
        if found is not None and (found.name, found.size_bytes) == (frame.name, frame.size_bytes):
            self._link.session.delete_object(frame.handle)


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
