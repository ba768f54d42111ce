"""Picture files: time, size, damage found, and what Radiance HDR loses; OpenEXR's other codings and OpenCV as rivals.

The picture is a panorama with the statistics of a merged bracket: a room's light over six decades, 1 % of noise in each
pixel, uncertainty in every pixel, validity and ghosts in patches.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import OpenEXR

from benchmarks.paired import cost_of
from benchmarks.seeds import seeds
from benchmarks.shared_data import DATA
from processing.calibration.scale.photometry import illuminance_lx
from processing.errors import PictureFileError
from processing.pictures.exr import read_exr, read_exr_rgb, write_exr
from processing.pictures.images import LuminanceImage, luminance_cd_m2
from processing.pictures.radiance import read_radiance_hdr, write_radiance_hdr
from processing.sphere import Equirectangular, Fisheye, LensMapping, directions

FULL, QUICK = (6720, 3360), (1680, 840)
CODINGS = ("NO", "ZIPS", "ZIP", "PIZ")
CORPUS = DATA / "damaged" / "exr"
SUN_CD_M2 = 1.6e9

Figures = dict[str, float]


def run(*, quick: bool, seed: int) -> dict[str, Any]:
    width, height = QUICK if quick else FULL
    rng = np.random.default_rng(seeds("test", 1, seed)[0])
    image = picture(width, height, rng)
    with tempfile.TemporaryDirectory(prefix="daylit-files-") as folder:
        place = Path(folder)
        metrics = ours(image, place, repeats=3)
        rivals = {f"openexr_{name.lower()}": coding(image, place, name) for name in CODINGS}
        rivals["opencv_hdr"] = opencv_hdr(image, place)
        metrics |= flips(place, rng, trials=200 if quick else 1000)
        flipped = flips_elsewhere(place, rng, trials=40 if quick else 200)
        for name, share in flipped.items():
            rivals[f"openexr_{name.lower()}"]["flips_unseen_pct"] = share
        metrics |= corpus() | evalglare(place, 400 if quick else 1000)
    notes = [f"{width} x {height} pixels: R, G, B, uncertainty float32, validity, ghost; times are CPU seconds"]
    return {
        "metrics": metrics,
        "rivals": rivals,
        "notes": notes,
        "units": {"damaged_refused": "", "flips_found_pct": "%"},
    }


def picture(width: int, height: int, rng: np.random.Generator) -> LuminanceImage:
    """Return a room's light as a merge gives it, with a sun in it."""
    coarse = rng.normal(0, 1, (height // 40, width // 40)).astype(np.float32)
    smooth = cv2.resize(cv2.GaussianBlur(coarse, (0, 0), 2), (width, height), interpolation=cv2.INTER_CUBIC)
    light = 80 * np.exp2(smooth * (2.5 / smooth.std()))
    rgb = light[..., None] * np.array([1.08, 1.0, 0.86], np.float32)
    rgb *= 1 + 0.01 * rng.standard_normal(rgb.shape, dtype=np.float32)
    rgb[height // 3, width // 5] = SUN_CD_M2
    uncertainty = (0.004 + 0.05 / np.sqrt(light)).astype(np.float32)
    uncertainty *= 1 + 0.05 * rng.standard_normal(uncertainty.shape, dtype=np.float32)
    validity = np.where(light < np.quantile(light[::8, ::8], 0.01), 2, 0).astype(np.uint8)
    ghost = np.zeros_like(validity)
    ghost[: height // 9, : width // 7] = 5
    geometry = Equirectangular(width, height)
    return LuminanceImage(rgb, np.abs(uncertainty) + np.float32(1e-4), validity, geometry, 0.01, ghost, {"k1": 0.034})


def median_cpu(work: Callable[[], object], repeats: int) -> float:
    return float(np.median([cost_of(work).cpu_s for _ in range(repeats)]))


def ours(image: LuminanceImage, place: Path, repeats: int) -> Figures:
    exr, hdr = place / "ours.exr", place / "ours.hdr"
    found: Figures = {"write_cpu_s": median_cpu(lambda: write_exr(exr, image), repeats)}
    found["read_cpu_s"] = median_cpu(lambda: read_exr(exr), repeats)
    found["exr_mb"] = exr.stat().st_size / 1e6
    back = read_exr(exr)
    found["exr_exact_pct"] = 100.0 * float(np.mean(back.rgb == image.rgb))
    found["hdr_write_cpu_s"] = median_cpu(lambda: write_radiance_hdr(hdr, image), 1)
    found["hdr_read_cpu_s"] = median_cpu(lambda: read_radiance_hdr(hdr), 1)
    return found | {"hdr_mb": hdr.stat().st_size / 1e6} | loss("hdr_", read_radiance_hdr(hdr).rgb, image)


def loss(prefix: str, rgb: np.ndarray, image: LuminanceImage) -> Figures:
    stops = np.log2(luminance_cd_m2(rgb) / luminance_cd_m2(image.rgb))
    keys = ("median_stops", "p99_stops", "max_stops")
    values = np.quantile(np.abs(stops), (0.5, 0.99, 1.0))
    return {prefix + key: float(value) for key, value in zip(keys, values, strict=True)} | {
        prefix + "bias_stops": float(np.mean(stops, dtype=np.float64))
    }


def coding(image: LuminanceImage, place: Path, name: str) -> Figures:
    """The library alone with the same channels: no checks, no checksum, no fsync; one and two threads."""
    path, found = place / f"{name}.exr", {}
    header = {"compression": getattr(OpenEXR, f"{name}_COMPRESSION"), "type": OpenEXR.scanlineimage}
    halves = {"validity": image.validity.astype(np.float16), "ghost": image.ghost.astype(np.float16)}
    channels = {"RGB": image.rgb, "uncertainty": image.uncertainty} | halves

    for threads in (1, 2):
        write = cost_of(lambda threads=threads: OpenEXR.File(header, channels, num_threads=threads).write(str(path)))
        read = cost_of(lambda threads=threads: OpenEXR.File(str(path), num_threads=threads).channels())
        found[f"write_wall_{threads}_threads_s"] = write.wall_s
        found[f"read_wall_{threads}_threads_s"] = read.wall_s
        found["write_cpu_s"], found["read_cpu_s"] = write.cpu_s, read.cpu_s
    return found | {"exr_mb": path.stat().st_size / 1e6}


def opencv_hdr(image: LuminanceImage, place: Path) -> Figures:
    path = place / "cv.hdr"
    turned = np.ascontiguousarray(image.rgb[..., ::-1])
    found = {"hdr_write_cpu_s": median_cpu(lambda: cv2.imwrite(str(path), turned), 1)}
    found["hdr_read_cpu_s"] = median_cpu(lambda: cv2.imread(str(path), cv2.IMREAD_UNCHANGED), 1)
    back = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)[..., ::-1]
    return found | {"hdr_mb": path.stat().st_size / 1e6} | loss("hdr_", back, image)


def flips(place: Path, rng: np.random.Generator, trials: int) -> Figures:
    """Flip one bit at a time of a small file of ours: found, without effect, or unseen (which must be none)."""
    path = place / "small.exr"
    image = picture(480, 240, rng)
    write_exr(path, image)
    data = path.read_bytes()
    found = unseen = 0
    for place_bits in rng.integers(0, 8 * len(data), trials):
        path.write_bytes(flipped(data, int(place_bits)))
        try:
            back = read_exr(path)
        except PictureFileError:
            found += 1
            continue
        same = back.geometry == image.geometry and back.attributes == image.attributes
        for name in ("rgb", "uncertainty", "validity", "ghost"):
            same = same and np.array_equal(getattr(back, name), getattr(image, name))
        unseen += not same
    return {"flips_found_pct": 100 * found / trials, "flips_unseen_pct": 100 * unseen / trials}


def flipped(data: bytes, bit: int) -> bytes:
    bad = bytearray(data)
    bad[bit // 8] ^= 1 << (bit % 8)
    return bytes(bad)


def flips_elsewhere(place: Path, rng: np.random.Generator, trials: int) -> Figures:
    """The same in the library's own codings without a checksum of ours: how many change the light unseen."""
    image, path, shares = picture(480, 240, rng), place / "theirs.exr", {}
    for name in CODINGS:
        header = {"compression": getattr(OpenEXR, f"{name}_COMPRESSION"), "type": OpenEXR.scanlineimage}
        OpenEXR.File(header, {"RGB": image.rgb}).write(str(path))
        data, unseen = path.read_bytes(), 0
        for bit in rng.integers(0, 8 * len(data), trials):
            path.write_bytes(flipped(data, int(bit)))
            try:
                unseen += not np.array_equal(read_exr_rgb(path)[0], image.rgb)
            except PictureFileError:
                continue
        shares[name] = 100 * unseen / trials
    return shares


CHILD = """
import json, resource, sys
from pathlib import Path
resource.setrlimit(resource.RLIMIT_AS, (4 << 30, 4 << 30))
resource.setrlimit(resource.RLIMIT_CPU, (60, 60))
from processing.errors import PictureFileError
from processing.pictures.exr import read_exr_rgb
read = 0
for name in sys.argv[1:]:
    try:
        read_exr_rgb(Path(name))
        read += 1
    except PictureFileError:
        pass
print(json.dumps(read))
"""


def corpus() -> Figures:
    """Damaged files of others in a child process of 4 GiB; 0 of 0 where the shared folder is not there."""
    files = [p for p in sorted(CORPUS.glob("*/*")) if p.name != "README.rst"]
    done = subprocess.run(
        [sys.executable, "-c", CHILD, *map(str, files)], capture_output=True, text=True, errors="replace", check=True
    )
    read = int(json.loads(done.stdout.splitlines()[-1]))
    return {"damaged_files": len(files), "damaged_refused": len(files) - read}


def evalglare(place: Path, size: int) -> Figures:
    """Largest difference between evalglare's illuminance of our file and ours; nothing where pyradiance is absent."""
    try:
        import pyradiance
    except ImportError:
        return {}
    tool = str(Path(pyradiance.__file__).parent / "bin" / "evalglare")
    worst = 0.0
    for mapping in (LensMapping.EQUIDISTANT, LensMapping.ORTHOGRAPHIC):
        geometry = Fisheye(size, size, mapping, size / 2)
        towards, seen = directions(geometry)
        for colour, cloud in (((1.0, 1.0, 1.0), 0.0), ((0.55, 1.0, 2.1), 0.0), ((0.8, 1.0, 1.4), 3e4)):
            level = 1000 * (1 + 2 * towards[..., 2]) + cloud * (towards @ (0.6, 0.0, 0.8) > 0.97)
            rgb = np.where(seen[..., None], level[..., None] * np.array(colour), 0).astype(np.float32)
            flat = np.full((size, size), 0.01, np.float32)
            image = LuminanceImage(rgb, flat, np.where(seen, 0, 3).astype(np.uint8), geometry, 0.0)
            write_radiance_hdr(place / "sky.hdr", image)
            answer = subprocess.run([tool, "-V", str(place / "sky.hdr")], capture_output=True, text=True, check=False)
            theirs = float(answer.stdout.split()[0])
            worst = max(worst, abs(theirs / illuminance_lx(image).value_lx - 1))
    return {"evalglare_err_pct": 100 * worst}
