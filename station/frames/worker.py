"""The process in which strangers' bytes are decoded; started by `station.frames.check`, never imported by it.

It reads one JSON request a line from standard input and answers one JSON line. Before the first request it locks itself
in: 2 GiB of address space, no new files, no children, few open files, an empty folder, no network where the system lets
it. OpenCV is the decoder because it says what libjpeg found odd ("premature end of data segment") on standard error,
which is read here; Pillow keeps that to itself and fills the rest of the picture with grey.
"""

import hashlib
import io
import json
import mmap
import os
import stat
import sys
import tempfile
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from station.frames.exif import check_raw, check_tiff, read_exif
from station.frames.jpeg import read_header, read_png
from station.frames.problems import FrameProblemError, Reason

Circle = Sequence[float]

# Chosen: no frame of either camera comes near.
MAX_JPEG_BYTES = 256 * 2**20
MAX_RAW_BYTES = 1_000_000_000  # chosen: far above either camera's raw files (26 to 47 MB)
MAX_OPEN_FILES = 64  # chosen: the frame, the pipes, libraries
CLIPPED_FROM, DARK_TO = 250, 8
SMALL_PIXELS = 60_000  # the small picture has at least so many pixels, where the frame has
TELLING_FRAC, TELLING_PIXELS = 0.02, 200
"""Below so many pixels between dark and clipped, two different frames may well look the same."""

NOISE_PX, LEAST_NOISE_PX, WHOLE = 96, 5, 0.999  # chosen: nine thousand differences settle a median to 1 %, nine to 40 %
CODING = 0.5  # codes; chosen: a simulated sky then errs by what is stated (docs/measurements/photometry.md)
_CODE = np.arange(256) / 255
_LINEAR = np.where(_CODE <= 0.04045, _CODE / 12.92, ((_CODE + 0.055) / 1.055) ** 2.4).astype(np.float32)
_BGR_WEIGHTS = np.array([0.0722, 0.7151, 0.2127], np.float32)  # of luminance: Rec. 709
_REDUCED = {8: cv2.IMREAD_REDUCED_COLOR_8, 4: cv2.IMREAD_REDUCED_COLOR_4, 2: cv2.IMREAD_REDUCED_COLOR_2}
_CLONE_NEWUSER, _CLONE_NEWNET = 0x10000000, 0x40000000


def main() -> None:
    """Serve requests until standard input ends."""
    requests = os.fdopen(os.dup(0), "rb")
    answers = os.fdopen(os.dup(1), "wb")
    complaints = _catch_output()
    # Give up what decoding does not need; return what is in force, in words, and what could not be had
    cv2.setNumThreads(0)
    folder = tempfile.mkdtemp(prefix="daylit-empty-")
    os.chdir(folder)
    with suppress(OSError):
        os.rmdir(folder)  # noqa: PTH106 (the folder lives on as our working folder, and nobody has to clean it up)
    _answer(answers, {"ok": True, "limits": [_leave_network(), *_limit_resources(int(sys.argv[1]))]})
    while line := requests.readline(100_000):
        request = json.loads(line)
        # So many more seconds of processor time; the system ends the process behind them
        with suppress(ImportError):
            import resource

            used = resource.getrusage(resource.RUSAGE_SELF)
            limit_s = int(used.ru_utime + used.ru_stime) + 1 + request["cpu_s"]
            resource.setrlimit(resource.RLIMIT_CPU, (limit_s, resource.getrlimit(resource.RLIMIT_CPU)[1]))
        _answer(answers, _serve(request, complaints))


def _answer(answers: Any, answer: dict[str, Any]) -> None:
    answers.write(json.dumps(answer).encode() + b"\n")
    answers.flush()


def _serve(request: dict[str, Any], complaints: Callable[[], str]) -> dict[str, Any]:
    """Return the facts of a file, or the reason why there are none."""
    try:
        return {"ok": True, "facts": inspect(request, complaints)}
    except FrameProblemError as problem:
        return {"ok": False, "reason": problem.reason, "message": problem.message}
    except MemoryError:
        return {"ok": False, "reason": Reason.TOO_MUCH_MEMORY, "message": "decoding it needs too much memory"}
    except OSError as error:
        return {"ok": False, "reason": Reason.NOT_A_FILE, "message": f"cannot be read: {error.strerror}"}


def inspect(request: dict[str, Any], complaints: Callable[[], str]) -> dict[str, Any]:
    """Read and measure one file; ``complaints`` returns what the decoder said since it was last called."""
    path, format_ = request["path"], request["format"]
    # Refuse links, and do not wait for the writer of a pipe
    flags = os.O_RDONLY
    for name in ("O_NOFOLLOW", "O_NONBLOCK", "O_CLOEXEC", "O_BINARY"):
        flags |= getattr(os, name, 0)
    descriptor = os.open(path, flags)
    with os.fdopen(descriptor, "rb") as file:
        status = os.fstat(descriptor)
        limit_bytes = MAX_JPEG_BYTES if format_ in ("jpeg", "png", "tiff") else MAX_RAW_BYTES
        if not stat.S_ISREG(status.st_mode):
            raise FrameProblemError(Reason.NOT_A_FILE, "not a regular file")
        if status.st_size > limit_bytes:
            raise FrameProblemError(Reason.TOO_LARGE, f"{status.st_size} bytes; the limit is {limit_bytes}")
        if format_ == "jpeg":
            return _inspect_jpeg(file.read(status.st_size), request["exact"], request.get("circle"), complaints)
        if format_ in ("png", "tiff"):
            return _inspect_lossless(file.read(status.st_size), format_, request.get("circle"), complaints)
        if status.st_size == 0:
            raise FrameProblemError(Reason.NOT_RAW, "an empty file")
        with mmap.mmap(descriptor, 0, access=mmap.ACCESS_READ) as raw:
            check_raw(raw, format_)
            return _of_file(raw, raw) | (
                _inspect_wells(bytes(raw), request.get("circle")) if request.get("pixels") else {}
            )


def _inspect_jpeg(data: bytes, exact: bool, circle: Circle | None, complaints: Callable[[], str]) -> dict[str, Any]:
    header = read_header(data)
    found = _of_file(data, header.exif)
    scale = next((s for s in (8, 4, 2) if header.width_px * header.height_px >= SMALL_PIXELS * s * s), 1)
    small = _decode(data, scale, complaints)
    pixels = _decode(data, 1, complaints) if exact and scale > 1 else small
    width_px, height_px = -(-header.width_px // scale), -(-header.height_px // scale)
    if small.shape != (height_px, width_px, 3):
        raise FrameProblemError(Reason.DAMAGED, f"decodes to {small.shape}, not {width_px}x{height_px}")
    measures = measure(pixels, circle)
    return found | {
        "width_px": header.width_px,
        "height_px": header.height_px,
        "exact": exact or scale == 1,
        "picture_sha256": _picture_digest(small, measures),
        "patches": _parts(_LINEAR[small.max(axis=2)], circle).ravel().tolist(),
        "noise": _noise(pixels, _parts(np.ones(small.shape[:2], np.float32), circle)) if exact else [],
        "notes": list(header.notes),
        **measures,
    }


def _inspect_lossless(data: bytes, format_: str, circle: Circle | None, faults: Callable[[], str]) -> dict[str, Any]:
    """Check the file's own structure (chunks with checksums, strips inside the file), then decode and count it all."""
    found = _of_file(data, read_png(data) if format_ == "png" else check_tiff(data))
    pixels = _decode(data, 1, faults, lossless=True)
    deep = pixels.dtype == np.uint16
    if deep:
        pixels = np.asarray(cv2.convertScaleAbs(pixels, alpha=1 / 257))
    elif pixels.dtype != np.uint8:
        raise FrameProblemError(Reason.UNSUPPORTED, f"it holds {pixels.dtype}: save it with 8 or 16 bits per channel")
    measures = measure(pixels, circle)
    return found | {
        "width_px": pixels.shape[1],
        "height_px": pixels.shape[0],
        "exact": True,
        "picture_sha256": _picture_digest(pixels, measures),
        "notes": ["16 bits per channel: merged with their 8-bit curve"] if deep else [],
        **measures,
    }


def _inspect_wells(data: bytes, circle: Circle | None) -> dict[str, Any]:
    """Measure a raw file that is a picture by itself: a pixel a cell of two by two wells, white at the sensor's."""
    import rawpy

    try:
        with rawpy.imread(io.BytesIO(data)) as raw:
            (height, width), black = raw.raw_image_visible.shape, np.float32(np.mean(raw.black_level_per_channel))
            wells = raw.raw_image_visible[: height // 2 * 2, : width // 2 * 2]
            letters = [chr(raw.color_desc[place]) for place in raw.raw_colors_visible[:2, :2].ravel()]
            quarters = dict(zip(letters, (wells[k // 2 :: 2, k % 2 :: 2] for k in range(4)), strict=True))
            light = (np.stack([quarters.get(c, quarters["G"]) for c in "BGR"], -1) - black) / (raw.white_level - black)
    except rawpy.LibRawError as error:
        raise FrameProblemError(Reason.DAMAGED, f"its wells cannot be read: {error.args[0].decode()}") from error
    pixels = np.rint(255 * np.clip(light, 0, 1) ** (1 / 2.2)).astype(np.uint8)
    facts = {"width_px": width, "height_px": height, "exact": True, **measure(pixels, circle)}
    return {**facts, "picture_sha256": _picture_digest(pixels, facts)}


def _of_file(data: bytes | mmap.mmap, block: bytes | mmap.mmap | None) -> dict[str, Any]:
    """Return size and digest, EXIF facts, and what is wrong with them; whether that matters is the asker's choice."""
    try:
        exif, problem = ({}, "no EXIF") if block is None else (read_exif(block), "")
    except FrameProblemError as error:
        exif, problem = {}, error.message
    digest = hashlib.sha256(data).hexdigest()
    return {"size_bytes": len(data), "sha256": digest, "exif": exif, "exif_problem": problem}


def _decode(data: bytes, scale: int, complaints: Callable[[], str], *, lossless: bool = False) -> npt.NDArray[Any]:
    """Decode at 1/scale (libjpeg's scaled transform); whatever the decoder complains of is refused.

    ``lossless``: in the depth that the file has, and what it only warns of (libpng and libtiff do so of profiles and
    tags) is let pass. Otherwise the result is uint8, (H, W, 3).
    """
    flags = _REDUCED.get(scale, cv2.IMREAD_COLOR) | cv2.IMREAD_IGNORE_ORIENTATION | lossless * cv2.IMREAD_ANYDEPTH
    try:
        pixels = cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    except cv2.error as error:
        if error.code == cv2.Error.StsNoMem:
            raise MemoryError from error
        raise FrameProblemError(Reason.DAMAGED, f"does not decode: {error.err[:200]}") from error
    complaint = complaints()
    if complaint and not (lossless and "warning" in complaint.lower()):
        raise FrameProblemError(Reason.DAMAGED, f"the picture data is damaged: {complaint}")
    if pixels is None:
        raise FrameProblemError(Reason.DAMAGED, "the picture data does not decode")
    return np.asarray(pixels)


def measure(pixels: npt.NDArray[np.uint8], circle: Circle | None = None) -> dict[str, Any]:
    """Return brightness measures of an 8-bit picture (H, W, 3), band by band so that little memory is needed.

    With ``circle`` (centre column, centre row, radius as fractions of width, height and width) only what lies inside
    counts: around a fisheye's picture all is black.
    """
    counts = np.zeros((4, 256), np.int64)
    for top in range(0, pixels.shape[0], 256):
        band = pixels[top : top + 256]
        inside = None if circle is None else _inside(pixels.shape, range(top, top + len(band)), circle)
        blue, green, red = cv2.split(band)
        for row, plane in enumerate((red, green, blue, cv2.max(cv2.max(blue, green), red))):
            counts[row] += np.bincount(plane.ravel() if inside is None else plane[inside], minlength=256)
    n_pixels = max(1, int(counts[3].sum()))
    clipped = counts[:, CLIPPED_FROM:].sum(axis=1) / n_pixels
    return {
        "mean_frac": float((counts[:3] @ np.arange(256)).sum() / (3 * 255 * n_pixels)),
        "clipped_frac": float(clipped[3]),
        "dark_frac": float(counts[3, : DARK_TO + 1].sum() / n_pixels),
        "clipped_rgb_frac": [float(share) for share in clipped[:3]],
    }


def _parts(plane: npt.NDArray[np.float32], circle: Circle | None) -> npt.NDArray[np.float32]:
    """Return the means of 8 rows of 16 parts of a picture (H, W); 0 counts for what is outside a circle."""
    if circle is not None:
        plane = plane * _inside(plane.shape, range(plane.shape[0]), circle)
    return np.clip(cv2.resize(plane, (16, 8), interpolation=cv2.INTER_AREA), 0, 1).astype(np.float32)


def _noise(pixels: npt.NDArray[np.uint8], shown: npt.NDArray[np.float32]) -> list[float]:
    """Return the relative noise of luminance in these parts of a picture (H, W, 3); 0 where not all is ``shown``.

    By the sRGB curve, from the median of second differences both ways (Immerkaer 1996, CVIU 64) in the middle of a
    part, which edges hardly move, and what rounding and JPEG, which smooths those differences, change: `CODING`.
    """
    height, width = pixels.shape[0] // 8, pixels.shape[1] // 16
    side = min(height, width, NOISE_PX)
    if side < LEAST_NOISE_PX:
        return []
    rows, columns = (slice((n - side) // 2, (n + side) // 2) for n in (height, width))
    parts = pixels[: 8 * height, : 16 * width].reshape(8, height, 16, width, 3)[:, rows, :, columns]
    light, step = _LINEAR[parts] @ _BGR_WEIGHTS, np.gradient(_LINEAR)[parts] @ _BGR_WEIGHTS
    second = np.median(np.abs(np.diff(np.diff(light, 2, axis=1), 2, axis=3)), axis=(1, 3)) / (0.6745 * 6)
    noise = np.hypot(second, CODING * step.mean(axis=(1, 3))) / np.maximum(light.mean(axis=(1, 3)), 1e-6)
    return list(np.where(shown > WHOLE, np.clip(noise, 0, 1), 0).ravel().tolist())


def _inside(shape: tuple[int, ...], rows: range, circle: Circle) -> npt.NDArray[np.bool_]:
    """Return which pixels of the rows have their centre in the circle."""
    height_px, width_px = shape[:2]
    x = (np.arange(width_px) + 0.5) / width_px - circle[0]
    y = ((np.array(rows) + 0.5) / height_px - circle[1]) * height_px / width_px
    return np.asarray(x[None, :] ** 2 + y[:, None] ** 2 <= circle[2] ** 2)


def _picture_digest(small: npt.NDArray[np.uint8], measures: dict[str, Any]) -> str | None:
    """Return the digest of the small picture; None where too little shows to distinguish two frames."""
    telling_frac = 1.0 - measures["clipped_frac"] - measures["dark_frac"]
    if telling_frac < TELLING_FRAC or telling_frac * small.shape[0] * small.shape[1] < TELLING_PIXELS:
        return None
    return hashlib.sha256(repr(small.shape).encode() + small.tobytes()).hexdigest()


def _catch_output() -> Callable[[], str]:
    """Send whatever libraries print into a pipe of our own, and return a function that empties it."""
    read_end, write_end = os.pipe()
    for descriptor in (read_end, write_end):
        if hasattr(os, "set_blocking"):
            os.set_blocking(descriptor, False)
    for standard in (1, 2):
        os.dup2(write_end, standard)

    def complaints() -> str:
        try:
            text = os.read(read_end, 65536).decode("ascii", "replace")
        except BlockingIOError:
            return ""
        return " ".join(text.split())[:200]

    return complaints


def _leave_network() -> str:
    """Move into a network name space of our own, which has no interface (Linux)."""
    if sys.platform != "linux":
        return "network: not blocked on this system"
    import ctypes

    libc = ctypes.CDLL(None, use_errno=True)
    if libc.unshare(_CLONE_NEWNET) == 0 or libc.unshare(_CLONE_NEWUSER | _CLONE_NEWNET) == 0:
        return "network: none"
    return f"network: not blocked ({os.strerror(ctypes.get_errno())})"


def _limit_resources(memory_bytes: int) -> list[str]:
    try:
        import resource
    except ImportError:
        return ["memory, processor time and files: not limited on this system"]
    wanted = {
        "address space": (resource.RLIMIT_AS, memory_bytes),
        "file size": (resource.RLIMIT_FSIZE, 0),
        "core dump": (resource.RLIMIT_CORE, 0),
        "open files": (resource.RLIMIT_NOFILE, MAX_OPEN_FILES),
        "processes": (resource.RLIMIT_NPROC, 0),
    }
    said = []
    for name, (kind, value) in wanted.items():
        try:
            resource.setrlimit(kind, (value, value))
        except (ValueError, OSError) as error:  # macOS refuses RLIMIT_AS
            said.append(f"{name}: not limited ({error})")
        else:
            said.append(f"{name}: {value}")
    return said


if __name__ == "__main__":
    main()
