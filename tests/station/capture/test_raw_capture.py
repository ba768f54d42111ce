"""Raw files beside the JPEGs: a stop is whole with both, of one exposure; a lost one is taken anew, never mixed."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from drivers.camera import ExposureProgress, FrameFormat, FrameRef, ShutterReadback
from drivers.clock import SystemClock
from drivers.errors import DeviceBusyError, DeviceError, DeviceTimeoutError
from station.capture.capture import Capture
from station.session.session import SessionManifest, SessionStatus, Side
from station.session.store import SessionStore
from station.session.verify import verify_session
from tests.station.capture.fake_camera import FakeCamera
from tests.station.capture.test_capture import STOPS_S, TABLE, make_rig, run
from tests.station.frames.test_check import raw_file

RAW_TABLE = TABLE.model_copy(update={"keep_raw": True})
RAW_HANDLES = 1000


@dataclass
class RawCamera(FakeCamera):
    """A fake that gives a DNG with each JPEG; ``bad_raws`` are exposures (counted from 1) whose DNG is cut."""

    chunk_bytes: int = 1 << 20
    bad_raws: tuple[int, ...] = ()
    says_time: bool = True
    late_raws: dict[int, int] = field(default_factory=dict)
    """Exposures whose DNG has the exposure time of another one."""
    same_raws: dict[int, int] = field(default_factory=dict)
    """Exposures whose DNG is, byte for byte, that of another one."""
    lost: dict[tuple[int, int], DeviceError] = field(default_factory=dict)
    """(handle, nth read of it) -> error."""

    def poll_exposure(self) -> ExposureProgress:
        progress = super().poll_exposure()
        if not progress.done:
            return progress
        number = progress.frames[0].handle
        shown_s = self._shutter_s if number not in self.late_raws else self.opened_s[self.late_raws[number] - 1][1]
        data = raw_file(version=True, shutter_s=shown_s if self.says_time else None) + f"{number} {self.gain}".encode()
        data = self._store[RAW_HANDLES + self.same_raws[number]] if number in self.same_raws else data
        self._store[RAW_HANDLES + number] = data[:120_000] if number in self.bad_raws else data
        size_bytes = len(self._store[RAW_HANDLES + number])
        raw = FrameRef(RAW_HANDLES + number, f"R{number:07d}.DNG", FrameFormat.DNG, size_bytes)
        return dataclasses.replace(progress, frames=(*progress.frames, raw))

    def read_chunk(self, frame: FrameRef, offset: int, max_bytes: int) -> bytes:
        self.calls[f"read {frame.handle}"] += 1
        error = self.lost.get((frame.handle, self.calls[f"read {frame.handle}"]))
        if error is not None:
            raise error
        return super().read_chunk(frame, offset, max_bytes)


def capture(camera: RawCamera, into: Path) -> tuple[SessionManifest, Path]:
    manifest, path, _ = run(make_rig(camera, indoor=RAW_TABLE), into)
    assert verify_session(path).intact
    return manifest, path


def assert_pairs(manifest: SessionManifest) -> None:
    """Every stop has its JPEG and its raw file, of one exposure."""
    assert manifest.status is SessionStatus.COMPLETE, manifest.missing
    for stop in range(len(STOPS_S)):
        jpeg, raw = manifest.frame(Side.INDOOR, stop), manifest.frame(Side.INDOOR, stop, "dng")
        assert jpeg is not None
        assert raw is not None
        assert jpeg.taken_utc == raw.taken_utc


def test_raw_files_are_kept(tmp_path: Path) -> None:
    manifest, _ = capture(RawCamera(SystemClock()), tmp_path)
    assert_pairs(manifest)
    assert not manifest.rejected


def test_a_rejected_jpeg_takes_its_raw_file_with_it(tmp_path: Path) -> None:
    camera = RawCamera(SystemClock(), spoil=lambda shot, _s, data: data[:200] if shot == 2 else data)
    manifest, _ = capture(camera, tmp_path)
    assert_pairs(manifest)
    assert len(camera.opened_s) == len(STOPS_S) + 1, "one retake for the pair"
    assert len(manifest.rejected) == 2


def test_a_rejected_raw_file_is_retaken_with_its_jpeg(tmp_path: Path) -> None:
    camera = RawCamera(SystemClock(), bad_raws=(2,))
    manifest, _ = capture(camera, tmp_path)
    assert_pairs(manifest)
    assert len(camera.opened_s) == len(STOPS_S) + 1


@pytest.mark.parametrize(
    ("camera", "why"),
    [
        (RawCamera(SystemClock(), late_raws={3: 2}), "its EXIF says 1/60 s, asked 1/15 s"),
        (RawCamera(SystemClock(), same_raws={3: 2}), "its EXIF says 1/60 s, asked 1/15 s"),
        (RawCamera(SystemClock(), says_time=False, same_raws={3: 2}), "the same bytes as indoor/02_"),
    ],
    ids=["another time", "another's bytes", "another's bytes without EXIF"],
)
def test_a_raw_file_that_comes_late_is_none_of_this_exposure(tmp_path: Path, camera: RawCamera, why: str) -> None:
    """What a slow card gives an exposure late is not the next one's, though its magic is right."""
    manifest, _ = capture(camera, tmp_path)
    assert why in manifest.rejected[0].reason
    raws = [frame for frame in manifest.frames if frame.format == "dng"]
    assert len({frame.sha256 for frame in raws}) == len(raws)
    assert all(frame.exif_s in (None, pytest.approx(frame.asked_s, rel=0.1)) for frame in raws)


@pytest.mark.parametrize("handle", [2, RAW_HANDLES + 2], ids=["jpeg", "raw"])
def test_a_frame_of_a_pair_that_cannot_be_fetched_is_taken_anew(tmp_path: Path, handle: int) -> None:
    lost: dict[tuple[int, int], DeviceError] = {(handle, n): DeviceTimeoutError("silent") for n in (1, 2)}
    manifest, _ = capture(RawCamera(SystemClock(), lost=lost), tmp_path)
    assert_pairs(manifest)


def test_a_raw_file_that_stays_bad_is_named_and_costs_no_jpeg_and_is_resumed(tmp_path: Path) -> None:
    manifest, path = capture(RawCamera(SystemClock(), bad_raws=(2, len(STOPS_S) + 1)), tmp_path)
    assert len([f for f in manifest.frames if f.format == "jpeg"]) == len(STOPS_S)
    assert manifest.missing == ("indoor: raw file of stop 2 (1/60 s)",)
    assert any(w.message.endswith("is kept") for w in manifest.warnings)
    assert_pairs(resume(path))


@pytest.mark.parametrize("gone", ["indoor/00_0.25s.dng", "indoor/00_0.25s.jpg"])
def test_a_file_of_a_pair_that_is_gone_is_taken_anew(tmp_path: Path, gone: str) -> None:
    _, path = capture(RawCamera(SystemClock()), tmp_path)
    (found,) = [p for p in (path / "indoor").iterdir() if p.name.startswith("00_") and p.suffix == Path(gone).suffix]
    found.unlink()
    assert_pairs(resume(path))


def resume(path: Path) -> SessionManifest:
    with SessionStore.open(path, writable=True) as store:
        for _ in events_of(store):
            pass
        manifest = store.manifest
    assert verify_session(path).intact
    return manifest


def events_of(store: SessionStore) -> Iterator[object]:
    # Other light, as later in the day: the same picture twice would be a repeat.
    yield from Capture.resume(make_rig(RawCamera(SystemClock(), gain=25.0), indoor=RAW_TABLE), store).events()


@dataclass
class HoldingCamera(FakeCamera):
    """A fake without a card: it keeps its last picture, and is busy until that was fetched and is safe."""

    holds_pictures: bool = True
    can_transfer_while_exposing: bool = False
    held: int = 0

    def set_shutter(self, shutter_s: float) -> ShutterReadback:
        if self.held:
            raise DeviceBusyError("a picture waits to be fetched", where="fake")
        return super().set_shutter(shutter_s)

    def release(self) -> None:
        self.held += 1
        super().release()

    def finish_frame(self, frame: FrameRef) -> None:
        super().finish_frame(frame)
        self.held -= 1


def test_a_camera_that_holds_its_pictures_is_never_asked_while_busy(tmp_path: Path) -> None:
    camera = HoldingCamera(SystemClock())
    manifest, _, events = run(make_rig(camera), tmp_path)
    assert manifest.status is SessionStatus.COMPLETE
    assert not [e for e in events if e.kind == "recovering"]
    assert (camera.recovered, camera.held) == (0, 0)
