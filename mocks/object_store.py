"""The card or memory of a simulated camera: folders, files, free space, and what can be wrong with it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime

from drivers.ptp.codes import ObjectFormat
from mocks.ptp_wire import string, u16, u32

ALL = 0xFFFFFFFF


@dataclass(frozen=True)
class StoredObject:
    """One object as PTP knows it; folders are empty objects of format Association."""

    handle: int
    storage_id: int
    parent: int
    format: int
    name: str
    taken_local: datetime
    data: bytes = b""
    width_px: int = 0
    height_px: int = 0

    def info(self) -> bytes:
        """Return the ObjectInfo dataset."""
        folder = self.format == ObjectFormat.ASSOCIATION
        date = string(self.taken_local.strftime("%Y%m%dT%H%M%S"))
        return (
            u32(self.storage_id)
            + u16(self.format, 0)
            + u32(len(self.data))
            + u16(0)
            + u32(0, 0, 0, self.width_px, self.height_px, 0 if folder else 24, self.parent)
            + u16(1 if folder else 0)
            + u32(0, 0)
            + string(self.name)
            + date
            + date
            + string("")
        )


@dataclass
class ObjectStore:
    """One storage. ``storage_type``, ``filesystem`` as in StorageInfo; sizes in bytes.

    ``first_handle`` is the handle of the first object added.
    """

    storage_id: int
    capacity_bytes: int
    storage_type: int = 4
    filesystem: int = 3
    first_handle: int = 1
    present: bool = True
    read_only: bool = False
    full: bool = False

    def __post_init__(self) -> None:
        self._objects: dict[int, StoredObject] = {}
        self._next_handle = self.first_handle

    def __iter__(self) -> Iterator[StoredObject]:
        return iter(list(self._objects.values()))

    @property
    def used_bytes(self) -> int:
        """Bytes of all objects."""
        return sum(len(item.data) for item in self._objects.values())

    @property
    def free_bytes(self) -> int:
        """Bytes left; 0 when the store is made full or is missing."""
        return 0 if self.full or not self.present else max(0, self.capacity_bytes - self.used_bytes)

    def take_handle(self) -> int:
        """Return a handle that has never been used."""
        handle = self._next_handle
        self._next_handle += 1
        return handle

    def add(self, item: StoredObject) -> StoredObject:
        """Keep an object."""
        self._objects[item.handle] = item
        return item

    def add_folder(self, name: str, parent: int, made_local: datetime) -> int:
        """Make a folder and return its handle (``parent`` 0: at the root)."""
        handle = self.take_handle()
        self.add(StoredObject(handle, self.storage_id, parent, ObjectFormat.ASSOCIATION, name, made_local))
        return handle

    def get(self, handle: int) -> StoredObject | None:
        """Return an object, or None."""
        return self._objects.get(handle)

    def remove(self, handle: int) -> StoredObject | None:
        """Remove an object and return it, or None."""
        return self._objects.pop(handle, None)

    def handles(self, object_format: int = 0, parent: int = 0) -> tuple[int, ...]:
        """Return handles: of one format (0: any), below one parent (0: anywhere; FFFFFFFF: at the root)."""
        wanted_parent = 0 if parent == ALL else parent
        return tuple(
            item.handle
            for item in self._objects.values()
            if object_format in (0, item.format) and (parent == 0 or item.parent == wanted_parent)
        )

    def info(self, bytes_per_picture: int) -> bytes:
        """Return the StorageInfo dataset."""
        pictures = self.free_bytes // max(1, bytes_per_picture)
        access = 1 if self.read_only else 0
        return (
            u16(self.storage_type, self.filesystem, access)
            + self.capacity_bytes.to_bytes(8, "little")
            + self.free_bytes.to_bytes(8, "little")
            + u32(min(pictures, 0x7FFFFFFF))
            + string("")
            + string("")
        )
