"""The worker process: right facts from good files, a named refusal for bad ones, and the station goes on."""

from __future__ import annotations

import hashlib
import io
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from benchmarks.shared_data import DATA
from station.errors import FrameRejectedError, ResourceError
from station.frames.check import ExpectedFrame, FrameChecker, FrameFacts, Reason, check_order
from station.session.session import FrameRecord, Side
from tests.station.frames.pictures import TAKEN, jpeg

POSIX = pytest.mark.skipif(sys.platform == "win32", reason="signals and limits of POSIX")


@pytest.fixture(scope="module", autouse=True)
def kept_workers() -> None:
    """None here: each checker starts a process of its own, and ends it."""


@pytest.fixture(scope="module")
def checker() -> Iterator[FrameChecker]:
    with FrameChecker() as worker:
        yield worker


@pytest.fixture
def good(tmp_path: Path) -> Path:
    path = tmp_path / "good.jpg"
    path.write_bytes(jpeg(0.25))
    return path


def reason(checker: FrameChecker, path: Path, expected: ExpectedFrame | None = None) -> str:
    with pytest.raises(FrameRejectedError) as caught:
        checker.check(path, expected or ExpectedFrame())
    assert caught.value.where == path.name
    assert caught.value.message
    return caught.value.details["reason"]


def worker_pid(checker: FrameChecker) -> int:
    checker.start()
    assert checker._worker is not None
    return checker._worker._process.pid


def test_facts_of_a_good_frame(checker, good):
    facts = checker.check(good, ExpectedFrame(exposure_s=1 / 4, iso=100, f_number=5.6, width_px=160, height_px=120))
    assert (facts.name, facts.width_px, facts.height_px) == ("good.jpg", 160, 120)
    assert facts.sha256 == hashlib.sha256(good.read_bytes()).hexdigest()
    assert (facts.exif.exposure_s, facts.exif.serial, facts.exif.taken_local) == (0.25, "0123456789", TAKEN)
    assert facts.exact, "a small picture is decoded whole"


@pytest.mark.parametrize("time_s", [4, 1 / 4, 1 / 60, 1 / 1000])
def test_measures_agree_with_an_independent_count(checker, tmp_path, time_s):
    path = tmp_path / "f.jpg"
    path.write_bytes(jpeg(time_s, size=(900, 700)))
    values = np.asarray(Image.open(io.BytesIO(path.read_bytes())), dtype=np.int64)
    whole = checker.inspect(path, exact=True)
    assert whole.exact
    assert whole.mean_frac == pytest.approx(values.mean() / 255, abs=1e-4)
    assert whole.clipped_frac == pytest.approx((values >= 250).any(axis=2).mean(), abs=1e-4)
    assert whole.dark_frac == pytest.approx((values <= 8).all(axis=2).mean(), abs=1e-4)
    assert whole.clipped_rgb_frac == pytest.approx(tuple((values >= 250).mean(axis=(0, 1))), abs=1e-4)
    quick = checker.inspect(path)
    assert not quick.exact
    assert quick.mean_frac == pytest.approx(whole.mean_frac, abs=0.01)
    assert quick.picture_sha256 == whole.picture_sha256


def test_a_bracket_passes_in_order_and_its_frames_are_not_repeats(checker, tmp_path):
    times_s = [4, 1, 1 / 4, 1 / 15, 1 / 60, 1 / 250, 1 / 1000, 1 / 4000, 1 / 8000]
    found: list[FrameFacts] = []
    for stop, time_s in enumerate(times_s):
        path = tmp_path / f"{stop}.jpg"
        path.write_bytes(jpeg(time_s))
        found.append(checker.check(path, ExpectedFrame(exposure_s=time_s), earlier=found))
    check_order(dict(enumerate(found)), times_s)
    found[2], found[6] = found[6], found[2]
    with pytest.raises(FrameRejectedError):
        check_order(dict(enumerate(found)), times_s)


def test_a_lie_in_exif_over_a_good_picture(checker, tmp_path):
    path = tmp_path / "lie.jpg"
    path.write_bytes(jpeg(0.25, said_s=1 / 15))
    assert reason(checker, path, ExpectedFrame(exposure_s=1 / 4)) == Reason.WRONG_EXPOSURE
    path.write_bytes(jpeg(0.25, ISO=400))
    assert reason(checker, path, ExpectedFrame(iso=100)) == Reason.WRONG_ISO
    path.write_bytes(jpeg(0.25, WIDTH=6720))
    assert reason(checker, path) == Reason.WRONG_SIZE


def test_the_same_picture_with_another_exif_is_a_repeat(checker, good, tmp_path):
    first = checker.inspect(good)
    other = tmp_path / "other.jpg"
    other.write_bytes(jpeg(0.25, said_s=1))
    with pytest.raises(FrameRejectedError, match=r"same pixels as good\.jpg"):
        checker.check(other, ExpectedFrame(exposure_s=1), earlier=[first])
    with pytest.raises(FrameRejectedError, match=r"same bytes as good\.jpg"):
        checker.check(good, ExpectedFrame(), earlier=[first], name="05_1-60s.jpg")


def test_black_frames_are_not_each_others_repeats(checker, tmp_path):
    found: list[FrameFacts] = []
    for time_s in (1 / 4000, 1 / 8000):
        path = tmp_path / "black.jpg"
        path.write_bytes(jpeg(time_s, picture=np.zeros((480, 640, 3), np.uint8)))
        found.append(checker.check(path, ExpectedFrame(exposure_s=time_s), earlier=found))
    path.write_bytes(jpeg(4, picture=np.zeros((480, 640, 3), np.uint8)))
    assert reason(checker, path, ExpectedFrame(exposure_s=4)) == Reason.BLACK


def test_damage_inside_the_picture_data_is_heard_of(checker, tmp_path):
    """A cut that is closed again, and data lost from the middle: the decoder fills in grey, and says so."""
    data = jpeg(0.25, size=(800, 600))
    path = tmp_path / "cut.jpg"
    path.write_bytes(data[: len(data) * 2 // 3] + b"\xff\xd9")
    assert reason(checker, path) == Reason.DAMAGED
    path.write_bytes(data[: len(data) // 2] + data[len(data) // 2 + 500 :])
    assert reason(checker, path) == Reason.DAMAGED


def test_things_that_are_not_files(checker, good, tmp_path):
    assert reason(checker, tmp_path / "missing.jpg") == Reason.NOT_A_FILE
    assert reason(checker, tmp_path) == Reason.NOT_A_FILE
    (tmp_path / "empty.jpg").touch()
    assert reason(checker, tmp_path / "empty.jpg") == Reason.NOT_JPEG


@POSIX
def test_links_and_pipes_are_refused_without_waiting(checker, good, tmp_path):
    link, pipe = tmp_path / "link.jpg", tmp_path / "pipe.jpg"
    link.symlink_to(good)
    os.mkfifo(pipe)
    assert reason(checker, link) == Reason.NOT_A_FILE
    assert reason(checker, pipe) == Reason.NOT_A_FILE


def test_names_are_text_not_terminal_commands(checker, tmp_path):
    path = tmp_path / "a\x1b[2Jb\n.jpg"
    path.write_bytes(jpeg())
    assert checker.inspect(path).name == "a?[2Jb?.jpg"


@POSIX
def test_a_worker_killed_between_frames_is_replaced(good):
    with FrameChecker() as checker:
        os.kill(worker_pid(checker), signal.SIGKILL)
        assert checker.inspect(good).width_px == 160
        assert checker.deaths == 1


@POSIX
def test_a_worker_that_hangs_is_ended_and_named(good):
    with FrameChecker(limit_s=0.3) as checker:
        os.kill(worker_pid(checker), signal.SIGSTOP)
        assert reason(checker, good) == Reason.TOO_SLOW
        assert checker.deaths == 1
    with FrameChecker() as checker:
        assert checker.inspect(good).width_px == 160


@POSIX
def test_a_picture_that_needs_too_much_memory(good, tmp_path):
    path = tmp_path / "large.jpg"
    Image.new("RGB", (8000, 6000), (90, 120, 130)).save(path)
    with FrameChecker(memory_bytes=400 * 2**20) as checker:
        with pytest.raises(FrameRejectedError) as caught:
            checker.inspect(path, exact=True)
        assert caught.value.details["reason"] == Reason.TOO_MUCH_MEMORY
        assert checker.inspect(good).width_px == 160


def test_a_worker_that_cannot_start_says_so(monkeypatch, good):
    monkeypatch.setattr(sys, "executable", "/bin/false")
    with FrameChecker() as checker, pytest.raises(ResourceError, match="does not start"):
        checker.inspect(good)


@POSIX
def test_what_the_worker_gave_up(checker, tmp_path):
    pid = worker_pid(checker)
    assert any(limit.startswith("address space: 2147483648") for limit in checker.limits)
    if not Path("/proc/self/limits").exists():
        pytest.skip("limits and variables of a process are read in /proc, which is not here")
    limits = Path(f"/proc/{pid}/limits").read_text()
    soft = {line[:26].strip(): line[26:47].strip() for line in limits.splitlines()[1:]}
    assert soft["Max address space"] == str(2 * 2**30)
    assert (soft["Max file size"], soft["Max processes"], soft["Max core file size"]) == ("0", "0", "0")
    assert soft["Max open files"] == "64"
    assert os.readlink(f"/proc/{pid}/cwd").endswith("(deleted)")
    if "network: none" in checker.limits:
        interfaces = Path(f"/proc/{pid}/net/dev").read_text().splitlines()[2:]
        assert [line.split(":")[0].strip() for line in interfaces] in ([], ["lo"])


@POSIX
def test_the_worker_knows_none_of_the_users_variables(monkeypatch, good):
    monkeypatch.setenv("SOME_PRIVATE_TOKEN", "hunter2")
    with FrameChecker() as checker:
        pid = worker_pid(checker)
        environ = Path(f"/proc/{pid}/environ")
        if not environ.exists():
            pytest.skip("limits and variables of a process are read in /proc, which is not here")
        assert b"hunter2" not in environ.read_bytes()


def test_no_worker_outlives_its_station(tmp_path):
    """Killed, not closed: the worker reads the end of its requests and goes."""
    import psutil

    script = (
        "import os, sys\nfrom station.frames.check import FrameChecker\nc = FrameChecker()\nc.start()\n"
        "print(c._worker._process.pid, flush=True)\nsys.stdin.read()"
    )
    with subprocess.Popen(
        [sys.executable, "-c", script], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as station:
        worker = psutil.Process(int(station.stdout.readline()))
        station.kill()
        worker.wait(timeout=120)


def test_raw_companions(checker, tmp_path):
    path = tmp_path / "frame.cr2"
    path.write_bytes(raw_file())
    facts = checker.check_raw(path, "cr2")
    assert (facts.size_bytes, facts.width_px) == (len(raw_file()), None)
    for data, expected in [
        (jpeg(), Reason.NOT_RAW),
        (b"", Reason.NOT_RAW),
        (raw_file()[:99_000], Reason.TRUNCATED),
        (raw_file()[:150_000], Reason.TRUNCATED),
        (raw_file().replace(b"CR\x02", b"XX\x02"), Reason.NOT_RAW),
        (raw_file(next_at=16), Reason.DAMAGED),
    ]:
        path.write_bytes(data)
        with pytest.raises(FrameRejectedError) as caught:
            checker.check_raw(path, "cr2")
        assert caught.value.details["reason"] == expected
    path.write_bytes(raw_file())
    with pytest.raises(FrameRejectedError, match="DNG"):
        checker.check_raw(path, "dng")
    path.write_bytes(raw_file(version=True))
    assert checker.check_raw(path, "dng").size_bytes == len(raw_file(version=True))


def raw_file(next_at: int = 0, *, version: bool = False, shutter_s: float | None = None) -> bytes:
    """Return a file with the structure of a CR2 (or DNG) and one strip of 190,000 bytes."""
    entries = [(273, 4, 1, 1000), (279, 4, 1, 190_000)] + [(0xC612, 1, 4, 0x0401)] * version
    entries += [(0x829A, 5, 1, 900)] if shutter_s else []
    rational = b"".join(n.to_bytes(4, "little") for n in (round((shutter_s or 0) * 1e6), 1_000_000))
    table = len(entries).to_bytes(2, "little")
    for tag, type_, count, value in entries:
        table += tag.to_bytes(2, "little") + type_.to_bytes(2, "little")
        table += count.to_bytes(4, "little") + value.to_bytes(4, "little")
    head = b"II*\0" + (16).to_bytes(4, "little") + b"CR\x02\0" + b"\0" * 4
    front = (head + table + next_at.to_bytes(4, "little")).ljust(900, b"\0") + rational
    return front.ljust(1000, b"\0") + b"x" * 190_000


def test_verify_looks_into_frames(checker, good):
    data = good.read_bytes()
    record = FrameRecord(
        side=Side.INDOOR,
        stop=0,
        file="indoor/good.jpg",
        size_bytes=len(data),
        sha256=hashlib.sha256(data).hexdigest(),
        asked_s=0.25,
        camera_s=0.25,
        exif_s=0.25,
        width_px=160,
        height_px=120,
    )
    assert checker.verify_frame(good, record) is None
    assert "asked 1 s" in checker.verify_frame(good, record.model_copy(update={"exif_s": 1.0}))
    good.write_bytes(data[:-2])
    assert "end-of-image" in checker.verify_frame(good, record)


def facts_or_reason(checker: FrameChecker, path: Path) -> FrameFacts | str:
    try:
        return checker.inspect(path, exact=True)
    except FrameRejectedError as error:
        return str(error.details["reason"])


def damaged_files() -> list[Path]:
    """Return the shared damaged files that a session folder could hold as frames; half is kept back elsewhere."""
    folder = DATA / "damaged"
    found = [p for name in ("jpeg", "exif", "handmade") for p in (folder / name).rglob("*") if p.is_file()]
    return sorted(p for p in found if int(hashlib.sha256(p.name.encode()).hexdigest(), 16) % 2 == 0)


@pytest.mark.shared("damaged")
def test_damaged_files_are_refused_by_name_or_sound_to_an_independent_eye(checker):
    files = damaged_files()
    assert files
    before = checker.deaths
    found = {path: facts_or_reason(checker, path.resolve()) for path in files}
    reasons = [reason for reason in found.values() if isinstance(reason, str)]
    assert set(reasons) <= set(Reason)
    assert len(reasons) >= len(files) * 0.95, "nearly all of them are known to be broken"
    assert checker.deaths == before
    for path, facts in found.items():
        if isinstance(facts, FrameFacts):
            with Image.open(path) as picture:
                values = np.asarray(picture.convert("RGB"), dtype=np.int64)
            assert values.shape == (facts.height_px, facts.width_px, 3), path.name
            assert values.mean() / 255 == pytest.approx(facts.mean_frac, abs=0.02), path.name


@pytest.mark.shared("brackets/canon5d2_8mm_bracket")
def test_a_real_bracket_passes(checker):
    folder = DATA / "brackets" / "canon5d2_8mm_bracket"
    found: list[FrameFacts] = []
    for path in sorted(folder.glob("*.JPG")):
        expected = ExpectedFrame(iso=100, f_number=5.6, width_px=5616, height_px=3744)
        found.append(checker.check(path.resolve(), expected, earlier=found))
    check_order(dict(enumerate(found)), [f.exif.exposure_s or 0 for f in found])
    assert len(found) == 9
    wrong = ExpectedFrame(exposure_s=1 / 4)
    with pytest.raises(FrameRejectedError, match=r"1/5 s, asked 1/4 s, 0\.32 stops shorter"):
        checker.check((folder / "IMG_6961.JPG").resolve(), wrong)


@pytest.mark.shared("brackets/canon5d2_8mm_bracket")
@pytest.mark.parametrize("at", [200_000, 1_000_001, 3_000_000])
def test_a_packet_lost_from_a_real_frame_is_heard_of(checker, tmp_path, at):
    """Of 512 bytes lost or doubled every one was; of single flipped bits only one in five: those are for SHA-256."""
    source = DATA / "brackets" / "canon5d2_8mm_bracket" / "IMG_6963.JPG"
    data = source.read_bytes()
    path = tmp_path / "lost.jpg"
    path.write_bytes(data[:at] + data[at + 512 :])
    assert reason(checker, path) == Reason.DAMAGED
    path.write_bytes(data[:at] + data[at - 512 :])
    assert reason(checker, path) == Reason.DAMAGED
