"""The store of a simulated camera: folders and files with handles, and the datasets that describe them."""

import struct
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from datetime import datetime

from drivers.ptp.codes import FormFlag, ObjectFormat
from mocks.instruments.ptp import wire as ptp_wire
from mocks.instruments.ptp.wire import Value

ROOT = 0  # PIMA 15740: no parent
ROOT_ONLY = 0xFFFFFFFF  # PIMA 15740, GetObjectHandles: what lies in the root
ANY = 0xFFFFFFFF  # PIMA 15740, GetObjectHandles: all storages
MAX_U32 = 0xFFFFFFFF  # 32 bits


@dataclass(frozen=True)
class StoredObject:
    """A folder or a file on the camera."""

    handle: int
    storage_id: int
    format: int
    name: str
    parent: int
    data: bytes = b""
    taken: datetime | None = None
    width_px: int = 0
    height_px: int = 0

    def info(self) -> bytes:
        """Return the ObjectInfo dataset."""
        association = 1 if self.format == ObjectFormat.ASSOCIATION else 0
        taken = ptp_wire.date(self.taken) if self.taken else ""
        head = struct.pack("<IHHI", self.storage_id, self.format, 0, min(len(self.data), MAX_U32))
        thumb = struct.pack("<HIII", 0, 0, 0, 0)
        image = struct.pack("<III", self.width_px, self.height_px, 24 if self.width_px else 0)
        tail = struct.pack("<IHII", self.parent, association, 0, 0)
        texts = ptp_wire.string(self.name) + ptp_wire.string(taken) + ptp_wire.string(taken) + ptp_wire.string("")
        return head + thumb + image + tail + texts


@dataclass(frozen=True)
class Storage:
    """A store as StorageInfo describes it (kind: 3 fixed RAM, 4 removable RAM; file system 3: DCF)."""

    storage_id: int
    kind: int
    capacity_bytes: int
    description: str = ""
    label: str = ""
    free_images: int | None = None
    """What it says of free pictures, where that is no count (EOS: FFFFFFFF)."""


class ObjectStore:
    """All objects of one store. Not locked: the camera's own lock covers it."""

    def __init__(self, storage: Storage, first_handle: int, folders: tuple[str, ...]) -> None:
        self.storage = storage
        self._next_handle = first_handle
        self._objects: dict[int, StoredObject] = {}
        parent = ROOT
        for name in folders:
            parent = self.add(StoredObject(0, 0, ObjectFormat.ASSOCIATION, name, parent)).handle
        self.picture_folder = parent

    def add(self, item: StoredObject) -> StoredObject:
        """Keep ``item`` under a fresh handle and return it as kept."""
        kept = replace(item, handle=self._next_handle, storage_id=self.storage.storage_id)
        self._next_handle += 1
        self._objects[kept.handle] = kept
        return kept

    def get(self, handle: int) -> StoredObject | None:
        """Return the object, or None."""
        return self._objects.get(handle)

    def remove(self, handle: int) -> None:
        """Forget the object."""
        del self._objects[handle]

    def files(self) -> Iterator[StoredObject]:
        """Yield everything but folders, oldest first."""
        return (o for o in self._objects.values() if o.format != ObjectFormat.ASSOCIATION)

    def select(self, object_format: int, parent: int) -> list[StoredObject]:
        """Return objects of a format (0: any) under a parent (0: everywhere, FFFFFFFF: the root only)."""
        return [
            o
            for o in self._objects.values()
            if object_format in (0, o.format)
            and (parent == ROOT or o.parent == (ROOT if parent == ROOT_ONLY else parent))
        ]

    @property
    def free_bytes(self) -> int:
        """Bytes left."""
        return max(0, self.storage.capacity_bytes - sum(len(o.data) for o in self._objects.values()))

    def info(self, *, free_bytes: int, free_pictures: int, read_only: bool) -> bytes:
        """Return the StorageInfo dataset."""
        head = struct.pack("<HHH", self.storage.kind, 3, 1 if read_only else 0)
        pictures = free_pictures if self.storage.free_images is None else self.storage.free_images
        sizes = struct.pack("<QQI", self.storage.capacity_bytes, free_bytes, pictures)
        return head + sizes + ptp_wire.string(self.storage.description) + ptp_wire.string(self.storage.label)


# Device properties of a simulated camera: their types, forms, rules and the DevicePropDesc dataset.


@dataclass(frozen=True)
class Property:
    """One property: ``choices`` makes an enumeration, ``span`` (min, max, step) a range."""

    code: int
    data_type: int
    default: Value
    writable: bool = False
    choices: tuple[Value, ...] = ()
    span: tuple[int, int, int] | None = None

    def allows(self, value: Value) -> bool:
        """Whether the form allows ``value``."""
        if self.choices:
            return value in self.choices
        if self.span and isinstance(value, int):
            low, high, step = self.span
            return low <= value <= high and (value - low) % step == 0
        return True

    def describe(self, current: Value, choices: tuple[Value, ...]) -> bytes:
        """Return the DevicePropDesc dataset with the choices as they are now."""
        head = struct.pack("<HHB", self.code, self.data_type, int(self.writable))
        values = ptp_wire.typed(self.data_type, self.default) + ptp_wire.typed(self.data_type, current)
        if choices:
            items = b"".join(ptp_wire.typed(self.data_type, c) for c in choices)
            return head + values + struct.pack("<BH", FormFlag.ENUMERATION, len(choices)) + items
        if self.span:
            span = b"".join(ptp_wire.typed(self.data_type, v) for v in self.span)
            return head + values + bytes([FormFlag.RANGE]) + span
        return head + values + bytes([FormFlag.NONE])


class PropertyTable:
    """Properties with their current values."""

    def __init__(self, properties: Iterable[Property]) -> None:
        self.properties = {p.code: p for p in properties}
        self.values: dict[int, Value] = {p.code: p.default for p in self.properties.values()}

    def number(self, code: int) -> int:
        """Return the current value of an integer property."""
        value = self.values[code]
        assert isinstance(value, int)
        return value

    def text(self, code: int) -> str:
        """Return the current value of a string property."""
        value = self.values[code]
        assert isinstance(value, str)
        return value

    def reset(self, keep: Iterable[int] = ()) -> None:
        """Bring every writable property but ``keep`` back to its default."""
        kept = set(keep)
        for code, prop in self.properties.items():
            if prop.writable and code not in kept:
                self.values[code] = prop.default
