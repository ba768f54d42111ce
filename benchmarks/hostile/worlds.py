"""Worlds and cameras that break what photometry takes for granted, one thing after another and all at once.

A world says what reaches the sensor in each frame: clouds that pass while the bracket is taken, lamps that flicker,
shutters that are off, lenses that scatter and mirror, two lenses that do not agree. The truth is the light itself,
averaged over the bracket's frames where it moves.

A camera is as cameras are: a mosaic of coloured wells with faults, and a maker's processing to JPEG. Nothing in it is
what `processing` assumes. Tone curves come as tables (measured ones), noise passes through demosaicing, a median
filter and sharpening, colours through a camera matrix, codes through one of several JPEG encoders.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import datetime

import cv2
import numpy as np
import numpy.typing as npt

from mocks.instruments.exposures import ShotRequest
from mocks.optics.picture_jobs import RawFrame, mosaic_file
from processing.ground.arrays import Bytes, Floats

_LIMIT, BLACK = 16383, 1024  # 14 bits; black as Canon's cameras of 14 bits have it
_EYE = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
_BAYER = {0: (0, 0), 1: (0, 1), 2: (1, 1)}
"""Channel: row and column of its place in a cell of two by two; green has the other diagonal too."""
MATRIX_5D2 = ((0.61, 0.29, 0.10), (0.17, 0.86, -0.03), (0.02, 0.24, 0.74))
"""Camera RGB of linear sRGB under daylight, rows to 1: about what raw converters state for a Canon EOS 5D Mark II."""


@dataclass(frozen=True)
class HostileCamera:
    """One camera; all of it may be drawn at random."""

    irradiance: npt.NDArray[np.float64]
    """(N,) 0..1, rising: where the tone curves are tabulated."""
    brightness: npt.NDArray[np.float64]
    """(3, N) 0..1, not falling."""
    full_well_e: float = 30_000.0
    read_e: float = 6.0
    prnu: float = 0.0
    """Relative standard deviation of the wells' gains."""
    hot_share: float = 0.0
    """Of the wells, that leak."""
    matrix: tuple[tuple[float, float, float], ...] | None = None
    """Camera RGB of scene RGB; None: the camera sees the scene's own primaries."""
    mosaic: bool = False
    denoise: bool = False
    sharpen: float = 0.0
    tone_mapping_stops: float = 0.0
    """By how much a frame's shadows are lifted where most of it is dark, and lowered where most is bright."""
    jpeg: tuple[str, int, str] | None = None
    """Encoder (see `jpeg_file`), quality, chroma ("4:4:4", "4:2:2", "4:2:0"); None: lossless."""
    seed: int = 0

    def frame(self, light: Floats, moment: int) -> Bytes:
        """Return the picture (H, W, 3) of ``light`` (H, W, 3), 1 at saturation; ``moment``: number of the frame."""
        return coded(self.developed(light, moment), self.jpeg)

    def developed(self, light: Floats, moment: int, leak: float = 1.0) -> Bytes:
        """Return the same before it is coded; ``leak``: of what hot wells leak, which dark current does by time."""
        signal = np.maximum(self._wells(light, moment, leak), 0)
        if self.mosaic:
            signal = _demosaiced(signal)
        if self.matrix is not None:
            signal = np.clip(signal @ np.linalg.inv(np.array(self.matrix)).T.astype(np.float32), 0, 1)
        return self._codes(signal)

    def raw(self, light: Floats, moment: int) -> bytes:
        """Return the DNG beside `frame` of ``light`` (H, W, 3): the same wells, 14 bits, RGGB."""
        counts = BLACK + (_LIMIT - BLACK) * _bayer(self._wells(light, moment))
        wells = RawFrame(np.clip(np.rint(counts), 0, _LIMIT).astype(np.uint16), BLACK, _LIMIT, self.matrix or _EYE)
        height, width = light.shape[:2]
        taken = datetime.fromisoformat(f"2026-06-01T12:00:{moment:02d}")
        shot = ShotRequest(TIMES_S[moment], 100, 5.6, 5600, width, height, taken, moment + 1, "Maker", "A-1", "1", "1")
        return mosaic_file(wells, shot, cr2=False)

    def _wells(self, light: Floats, moment: int, leaking: float = 1.0) -> Floats:
        """Return what all wells show of all channels, at most 1, noise below 0 too."""
        fixed, rng = np.random.default_rng((self.seed, 1)), np.random.default_rng((self.seed, 2, moment))
        height, width = light.shape[:2]
        seen = light if self.matrix is None else np.maximum(light @ np.array(self.matrix, np.float32).T, 0)
        gain = 1 + self.prnu * fixed.standard_normal(seen.shape, dtype=np.float32)
        leak = np.where(fixed.random((height, width, 1)) < self.hot_share, fixed.random((height, width, 1)), 0)
        signal = np.minimum(seen, 8) * gain + (0.3 * leaking * leak).astype(np.float32)
        spread = np.sqrt(np.maximum(signal, 0) / self.full_well_e + (self.read_e / self.full_well_e) ** 2)
        signal = signal + spread * rng.standard_normal(signal.shape, dtype=np.float32)
        return np.minimum(signal, 1).astype(np.float32)

    def _codes(self, signal: Floats) -> Bytes:
        """Return 8-bit codes: filter, tone, sharpening."""
        if self.denoise:
            signal = np.asarray(cv2.bilateralFilter(np.sqrt(signal), 5, 0.03, 1.2) ** 2, dtype=np.float32)
        if self.tone_mapping_stops:
            lift = self.tone_mapping_stops * (0.5 - float(np.mean(np.sqrt(signal))))
            signal = np.asarray(signal * np.exp2(lift * (1 - signal) ** 2), dtype=np.float32)
        shown = np.stack([np.interp(signal[..., c], self.irradiance, self.brightness[c]) for c in range(3)], axis=-1)
        if self.sharpen:
            shown = shown + self.sharpen * (shown - cv2.GaussianBlur(shown, (0, 0), 1.0))
        return np.rint(255 * np.clip(shown, 0, 1)).astype(np.uint8)


def _demosaiced(signal: Floats) -> Floats:
    """Return full colour of the one channel that each place of a Bayer mosaic (RGGB) keeps."""
    code = np.rint(_bayer(signal) * _LIMIT).astype(np.uint16)
    # OpenCV names a mosaic by its second row's second and third place: RGGB is its BayerBG.
    return np.asarray(cv2.cvtColor(code, cv2.COLOR_BayerBG2RGB).astype(np.float32) / _LIMIT)


def _bayer(signal: Floats) -> Floats:
    raw = signal[..., 1].copy()
    for channel in (0, 2):
        row, column = _BAYER[channel]
        raw[row::2, column::2] = signal[row::2, column::2, channel]
    return np.asarray(raw, dtype=np.float32)


def coded(frame: Bytes, jpeg: tuple[str, int, str] | None) -> Bytes:
    """Return a frame (H, W, 3) of sRGB codes after JPEG coding and decoding."""
    if jpeg is None:
        return frame
    data = np.frombuffer(jpeg_file(frame, jpeg), np.uint8)
    shown = np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR), dtype=np.uint8)
    return np.ascontiguousarray(shown[..., ::-1])


def jpeg_file(frame: Bytes, jpeg: tuple[str, int, str]) -> bytes:
    """Return a frame (H, W, 3) as JPEG by an encoder of a quality with a chroma.

    All at hand are of the libjpeg family: what differs between makers is varied. "opencv", "pillow": baseline, with the
    standard's tables; "progressive": optimised too; "fast": the coarser integer transform of small processors; "maker":
    tables of another form (`_maker_tables`), which ``quality`` then scales.
    """
    encoder, quality, chroma = jpeg
    if encoder == "opencv":
        sampling = {"4:4:4": 0x111111, "4:2:2": 0x211111, "4:2:0": 0x221111}[chroma]
        options = [cv2.IMWRITE_JPEG_QUALITY, quality, cv2.IMWRITE_JPEG_SAMPLING_FACTOR, sampling]
        done, data = cv2.imencode(".jpg", frame[..., ::-1], options)
        assert done
        return bytes(data)
    if encoder == "fast":
        import simplejpeg

        whole = np.ascontiguousarray(frame)
        return bytes(simplejpeg.encode_jpeg(whole, quality, "RGB", chroma.replace(":", ""), fastdct=True))
    from PIL import Image

    more = {
        "pillow": {"quality": quality},
        "progressive": {"quality": quality, "progressive": True, "optimize": True},
        "maker": {"qtables": _maker_tables(quality)},
    }
    buffer = io.BytesIO()
    Image.fromarray(frame).save(buffer, "JPEG", subsampling=chroma, **more[encoder])
    return buffer.getvalue()


def _maker_tables(quality: int) -> list[list[int]]:
    """Return quantisers of luminance and colour as a Canon's files have them: rising, then flat; 1 to 5 at 97."""
    rise = np.add.outer(np.arange(8), np.arange(8)).ravel()
    scale = (100 - quality) / 3
    tables = (np.minimum(1 + rise / 3, 5), np.minimum(1 + rise / 1.5, 5))
    return [[int(step) for step in np.maximum(np.rint(scale * table), 1)] for table in tables]


Curves = tuple[npt.NDArray[np.float64], Sequence[npt.NDArray[np.float64]]]
"""Irradiance (N,) and brightness (3, N) of each camera there is to draw from."""
TIMES_S = (4.0, 1.0, 1 / 4, 1 / 15, 1 / 60, 1 / 250, 1 / 1000, 1 / 4000, 1 / 8000)
ENCODERS = (
    ("opencv", 93, "4:2:2"),
    ("pillow", 92, "4:2:0"),
    ("progressive", 95, "4:4:4"),
    ("opencv", 96, "4:2:0"),
    ("maker", 93, "4:2:2"),
    ("fast", 94, "4:2:0"),
)
_COLUMNS = 24  # cells of a cloud across; chosen
WORN: dict[str, object] = {"prnu": 0.006, "hot_share": 0.001}
LENS_BLUR_PX = 0.7  # chosen: no lens draws a mosaic's pixels sharply
_SEAM = 0.25
"""Of the width: a panorama's second lens sees from here to three quarters."""


@dataclass(frozen=True)
class HostileWorld:
    """What is wrong in one world."""

    name: str
    camera: HostileCamera
    jitter_stops: float = 0.0
    """Standard deviation of the shutter's error."""
    cloud: float = 0.0
    """Share of the light that passing clouds take from part of the picture, frame by frame."""
    flicker: float = 0.0
    """Share of the light that mains flicker takes or gives in the half of the picture that lamps light."""
    halo: float = 0.0
    """Share of the light that spreads over a tenth of the picture, and an eighth of it as a mirrored ghost."""
    lenses: float = 0.0
    """By how much the second lens is brighter; the seam is blended over a few degrees."""


@dataclass(frozen=True)
class HostileBracket:
    """Frames (H, W, 3) uint8, the times written on the dial, and the light behind them (H, W, 3); raw files if any."""

    frames: tuple[Bytes, ...]
    nominal_s: tuple[float, ...]
    radiance: Floats
    moving: bool
    raw: tuple[bytes, ...] = ()


def hostile_bracket(
    world: HostileWorld, radiance: Floats, white_s: float, seed: int, *, raw: bool = False
) -> HostileBracket:
    """Return a bracket of ``radiance`` (H, W, 3); light of 1 saturates in ``white_s`` seconds; ``raw``: DNGs too."""
    rng = np.random.default_rng((seed, 7))
    radiance = np.asarray(cv2.GaussianBlur(radiance, (0, 0), LENS_BLUR_PX), dtype=np.float32)
    height, width = radiance.shape[:2]
    cloud, lamps = _field(rng, (width, height)), np.linspace(-1, 1, width)[None, :, None] > 0
    fixed = through_lens(radiance, world)
    frames, lights, files = [], [], []
    for number, time_s in enumerate(TIMES_S):
        taken = 1 - world.cloud * np.clip(cloud * np.sin(0.9 * number + 6 * rng.random()), 0, 1)
        flicker = 1 + world.flicker * (2 * rng.random() - 1) * lamps * min(1.0, 0.01 / time_s)
        light = (taken[..., None] * flicker).astype(np.float32)
        lights.append(light)
        true_s = time_s * 2.0 ** (world.jitter_stops * rng.standard_normal())
        exposed = fixed * light * np.float32(true_s / white_s)
        frames.append(world.camera.frame(exposed, number))
        files += [world.camera.raw(exposed, number)] if raw else []
    mean = np.mean(lights, axis=0, dtype=np.float64).astype(np.float32)
    moving = bool(world.cloud or world.flicker)
    return HostileBracket(tuple(frames), TIMES_S, radiance * mean, moving, tuple(files))


def through_lens(radiance: Floats, world: HostileWorld) -> Floats:
    """Return what the lens makes of the light (H, W, 3): halo, ghost, and a second lens of another brightness."""
    out = radiance
    width = radiance.shape[1]
    if world.halo:
        small = cv2.resize(radiance, None, fx=0.25, fy=0.25, interpolation=cv2.INTER_AREA)
        wide = cv2.resize(cv2.GaussianBlur(small, (0, 0), width / 40), (width, radiance.shape[0]))
        ghost = cv2.GaussianBlur(radiance[::-1, ::-1], (0, 0), width / 100)
        out = np.asarray((1 - 1.125 * world.halo) * radiance + world.halo * (wide + ghost / 8), dtype=np.float32)
    if world.lenses:
        place = np.abs((np.arange(width) + 0.5) / width - 0.5)
        second = 1 / (1 + np.exp((place - _SEAM) * width / 4))
        out = np.asarray(out * (1 + world.lenses * second)[None, :, None], dtype=np.float32)
    return np.asarray(out, dtype=np.float32)


def _field(rng: np.random.Generator, size: tuple[int, int]) -> Floats:
    cells = rng.standard_normal((_COLUMNS // 2, _COLUMNS)).astype(np.float32)
    return np.asarray(cv2.resize(cells, size, interpolation=cv2.INTER_CUBIC))


def hostile_worlds(curves: Curves, seed: int) -> list[HostileWorld]:
    """Return twenty worlds; each camera has a real curve and an encoder of its own.

    ``curves``: irradiance (N,) and brightness of shape (3, N) each.
    """
    rng = np.random.default_rng((seed, 3))
    irradiance, every = curves
    order = rng.permutation(len(every))

    def camera(number: int, **parts: object) -> HostileCamera:
        shown = every[int(order[number % len(every)])]
        plain = HostileCamera(irradiance, shown, seed=seed * 100 + number, jpeg=ENCODERS[number % len(ENCODERS)])
        return replace(plain, full_well_e=float(rng.uniform(15e3, 60e3)), read_e=float(rng.uniform(2, 12)), **parts)  # type: ignore[arg-type]

    maker: dict[str, object] = {"matrix": MATRIX_5D2, "mosaic": True, "denoise": True, "sharpen": rng.uniform(0.1, 0.5)}
    worn: dict[str, object] = WORN
    return [
        HostileWorld("lossless", camera(0, jpeg=None)),
        HostileWorld("opencv jpeg", camera(4, jpeg=ENCODERS[0])),
        HostileWorld("pillow jpeg", camera(1)),
        HostileWorld("progressive jpeg", camera(2)),
        HostileWorld("matrix", camera(3, matrix=MATRIX_5D2)),
        HostileWorld("worn sensor", camera(5, **worn)),
        HostileWorld("maker's processing", camera(6, **maker)),
        HostileWorld("maker's processing, worn", camera(7, **maker, **worn)),
        HostileWorld("jitter of a sixth", camera(8), jitter_stops=1 / 6),
        HostileWorld("jitter of a twentieth", camera(9), jitter_stops=1 / 20),
        HostileWorld("processing and jitter", camera(10, **maker), jitter_stops=1 / 20),
        HostileWorld("clouds", camera(11), cloud=0.1),
        HostileWorld("thin clouds", camera(12), cloud=0.03),
        HostileWorld("flicker", camera(13), flicker=0.3),
        HostileWorld("tone mapping", camera(14, tone_mapping_stops=0.3)),
        HostileWorld("halo and ghost", camera(15), halo=0.02),
        HostileWorld("two lenses", camera(16), lenses=0.04),
        HostileWorld("two lenses, halo", camera(17), lenses=-0.03, halo=0.01),
        HostileWorld("mosaic, lossless", camera(18, mosaic=True, jpeg=None)),
        HostileWorld(
            "all of it, mild",
            camera(19, **maker, **worn, tone_mapping_stops=0.15),
            *(0.03, 0.03, 0.05, 0.01, 0.02),
        ),
    ]
