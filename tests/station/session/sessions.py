"""Small sessions for tests of the store."""

from __future__ import annotations

import hashlib
from datetime import UTC, datetime
from pathlib import Path

from station.session.folder import StoredFrame
from station.session.session import BracketRecord, FrameRecord, SessionManifest, Side
from station.session.store import SessionStore

CREATED_UTC = datetime(2023, 5, 19, 15, 54, tzinfo=UTC)
STOPS_S = (4.0, 1 / 4, 1 / 60)


def manifest(**fields: object) -> SessionManifest:
    given = {
        "session_id": "ab" * 16,
        "name": "coda 320",
        "created_utc": CREATED_UTC,
        "bracket": BracketRecord(mode="full", stops_s=STOPS_S, sides=(Side.INDOOR,)),
        "readings_planned": 0,
    }
    return SessionManifest.model_validate({**given, **fields})


def frame_record(side: Side, stop: int, stored: StoredFrame) -> FrameRecord:
    return FrameRecord(
        side=side,
        stop=stop,
        file=stored.file,
        size_bytes=stored.size_bytes,
        sha256=stored.sha256,
        asked_s=STOPS_S[stop],
        camera_s=STOPS_S[stop],
    )


def put(store: SessionStore, stop: int, data: bytes, side: Side = Side.INDOOR) -> FrameRecord:
    """Write, commit and acknowledge a frame."""
    part = store.begin_frame(side, stop, STOPS_S[stop])
    part.write(data)
    stored = part.commit()
    assert stored.sha256 == hashlib.sha256(data).hexdigest()
    record = frame_record(side, stop, stored)
    store.add_frame(record)
    return record


def complete_session(parent: Path) -> Path:
    """A finished session of three indoor frames."""
    with SessionStore.create(parent, manifest()) as store:
        for stop in range(3):
            put(store, stop, bytes([stop]) * (1000 + stop))
        store.finish()
        return store.path
