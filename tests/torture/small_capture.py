"""A small but whole capture on the session store, which can be interrupted anywhere and run again until complete.

As a script (`python small_capture.py FOLDER`) it prints one acknowledgement a line, for runs under strace.
"""

from __future__ import annotations

import hashlib
import json
import os
import random
import sys
from collections.abc import Callable
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import TypeVar

from station.errors import ResourceError
from station.session.session import (
    JOURNAL_NAME,
    MANIFEST_NAME,
    BracketRecord,
    DeviceRecord,
    ReadingRecord,
    RejectedFrame,
    SessionManifest,
    Side,
    SkippedStop,
    WarningRecord,
)
from station.session.store import SessionStore
from tests.station.session.sessions import STOPS_S, frame_record

T = TypeVar("T")
Ack = dict[str, object]
Acknowledge = Callable[[Ack], None]

SKIPPED = 1
FRAME_BYTES = 5000
UTC_TIME = datetime(2023, 5, 19, 15, 54, tzinfo=UTC)
MANIFEST = SessionManifest(
    session_id="0123456789abcdef" * 2,
    name="coda 320",
    created_utc=UTC_TIME,
    simulated=True,
    bracket=BracketRecord(mode="full", stops_s=STOPS_S, sides=(Side.INDOOR, Side.OUTDOOR)),
)


def content(side: str, stop: int) -> bytes:
    """The bytes of a frame: no two are alike, so that a misfiled one shows."""
    return random.Random(f"{side} {stop}").randbytes(FRAME_BYTES + 100 * stop)


def digest(side: str, stop: int) -> str:
    return hashlib.sha256(content(side, stop)).hexdigest()


def sessions(parent: Path) -> list[Path]:
    """The session folders in ``parent`` that have a manifest or a journal."""
    return [p for p in sorted(parent.iterdir()) if (p / MANIFEST_NAME).exists() or (p / JOURNAL_NAME).exists()]


def run(parent: Path, acknowledge: Acknowledge, patience: int = 0) -> None:
    """Capture, or complete what an interrupted run left.

    With ``patience`` a step that meets a full or failing disk is tried again in the same store, as the station
    does after a pause; without, the error ends the run.
    """
    found = sessions(parent)
    store = (
        _again(lambda: SessionStore.open(found[0], writable=True), patience)
        if found
        else _again(lambda: SessionStore.create(parent, MANIFEST), patience)
    )
    with store:
        acknowledge({"what": "session", "name": store.path.name})
        for step in (_before, *(_framer(side, stop) for stop in (0, 2) for side in Side), _after):
            _again(partial(step, store, acknowledge), patience)
        _again(store.finish, patience)
        acknowledge({"what": "finished"})


def _again(step: Callable[[], T], patience: int) -> T:
    """Do a step; while there is patience, do it again after a disk error."""
    while True:
        try:
            return step()
        except ResourceError:
            if patience == 0:
                raise
            patience -= 1


def _before(store: SessionStore, acknowledge: Acknowledge) -> None:
    if not store.manifest.devices:
        store.update(devices=(DeviceRecord(role="indoor", kind="theta_z1"), DeviceRecord(role="meter", kind="ls160")))
    acknowledge({"what": "devices"})
    _reading(store, "before", 34.5, acknowledge)
    for side in Side:
        if not any(s.side == side for s in store.manifest.skipped):
            store.add(SkippedStop(side=side, stop=SKIPPED, reason="nothing clipped any more"))
        acknowledge({"what": "skipped", "side": side})


def _framer(side: Side, stop: int) -> Callable[[SessionStore, Acknowledge], None]:
    def take(store: SessionStore, acknowledge: Acknowledge) -> None:
        if store.manifest.frame(side, stop) is None:
            _frame(store, side, stop)
        acknowledge({"what": "frame", "side": side, "stop": stop})
        store.save_manifest()

    return take


def _frame(store: SessionStore, side: Side, stop: int) -> None:
    if (side, stop) == (Side.INDOOR, 2) and not any(r.reason == "black" for r in store.manifest.rejected):
        part = store.begin_frame(side, stop, STOPS_S[stop])
        part.write(b"black")
        file = part.reject("black")
        store.add(RejectedFrame(side=side, stop=stop, file=file, reason="black"))
    part = store.begin_frame(side, stop, STOPS_S[stop])
    try:
        data = content(side, stop)
        for start in range(0, len(data), 2000):
            part.write(data[start : start + 2000])
        stored = part.commit()
    finally:
        part.abort()
    store.add_frame(frame_record(side, stop, stored))


def _after(store: SessionStore, acknowledge: Acknowledge) -> None:
    _reading(store, "after", 35.0, acknowledge)
    if not store.manifest.warnings:
        store.add(WarningRecord(code="drift", message="the light changed"))
    store.update(drift_frac=0.5 / 34.5)
    store.event("note", text="lamp off")
    acknowledge({"what": "drift"})


def _reading(store: SessionStore, when: str, value: float, acknowledge: Acknowledge) -> None:
    if when in store.manifest.missing_readings():
        record = {"when": when, "status": "ok", "luminance_cd_m2": value, "taken_utc": UTC_TIME}
        store.add(ReadingRecord.model_validate(record))
    acknowledge({"what": "reading", "when": when})


def lost(manifest: SessionManifest, acknowledged: list[Ack], path: Path) -> list[str]:
    """Say which acknowledged facts the manifest or the files do not have, and which frames are not themselves."""
    problems = []
    for ack in acknowledged:
        what = ack["what"]
        if what == "frame" and manifest.frame(Side(str(ack["side"])), int(str(ack["stop"]))) is None:
            problems.append(f"lost {ack}")
        if what == "reading" and ack["when"] in manifest.missing_readings():
            problems.append(f"lost {ack}")
        if what == "skipped" and not any(s.side == ack["side"] for s in manifest.skipped):
            problems.append(f"lost {ack}")
        if what == "devices" and len(manifest.devices) != 2:
            problems.append(f"lost {ack}")
        if what == "drift" and not (manifest.drift_frac and manifest.warnings):
            problems.append(f"lost {ack}")
        if what == "finished" and manifest.missing:
            problems.append(f"lost {ack}")
    for frame in manifest.frames:
        file = path / frame.file
        data = file.read_bytes() if file.exists() else b""
        if frame.sha256 != digest(frame.side, frame.stop) or data != content(frame.side, frame.stop):
            problems.append(f"misfiled {frame.file}")
    return problems


def main() -> None:
    """Run in the folder named on the command line; acknowledgements go to standard output, unbuffered."""
    run(Path(sys.argv[1]), lambda ack: os.write(1, json.dumps(ack).encode() + b"\n") and None)


if __name__ == "__main__":
    main()
