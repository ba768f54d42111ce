"""Small sessions whose frames are known brackets."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from station.session.session import BracketRecord, DeviceRecord, FrameRecord, Side
from station.session.store import SessionStore
from tests.station.session.sessions import manifest

Frames = Sequence[npt.NDArray[np.uint8]]


def bracket_session(
    parent: Path, sides: dict[Side, Frames], times_s: Sequence[float], *, model: str = "", quality: int = 98
) -> Path:
    """A session of 4:4:4 JPEGs, longest time first."""
    plan = BracketRecord(mode="full", stops_s=tuple(times_s), sides=tuple(sides))
    with SessionStore.create(parent, manifest(bracket=plan)) as store:
        store.update(devices=tuple(DeviceRecord(role=side.value, kind="test", model=model) for side in sides))
        for side, frames in sides.items():
            for stop, (frame, time_s) in enumerate(zip(frames, times_s, strict=True)):
                part = store.begin_frame(side, stop, time_s)
                settings = [cv2.IMWRITE_JPEG_QUALITY, quality, cv2.IMWRITE_JPEG_SAMPLING_FACTOR, 0x111111]
                data = cv2.imencode(".jpg", frame[..., ::-1], settings)[1].tobytes()
                part.write(data)
                stored = part.commit()
                assert stored.sha256 == hashlib.sha256(data).hexdigest()
                store.add_frame(
                    FrameRecord(
                        side=side,
                        stop=stop,
                        file=stored.file,
                        size_bytes=stored.size_bytes,
                        sha256=stored.sha256,
                        asked_s=time_s,
                        camera_s=time_s,
                        iso=100,
                        f_number=5.6,
                        width_px=frame.shape[1],
                        height_px=frame.shape[0],
                    )
                )
        store.finish()
        return store.path
