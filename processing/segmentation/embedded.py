"""The network that daylit ships: classes and boundaries of an upright panorama, without any download.

It was trained on simulated rooms only (docs/reference/network.md, `training/`). It sees the panorama at 512 x 256,
turned and mirrored several times by angles that do not fall on its grid: their mean is better than each answer.
"""

import hashlib
import json
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from processing.errors import ParameterError, SegmenterError
from processing.ground.arrays import Floats
from processing.pictures.images import LUMINANCE_WEIGHTS, LuminanceImage, RelativeImage
from processing.segmentation.evidence import BoundaryEvidence, SceneClass, SceneEvidence
from processing.segmentation.segmenters import open_session
from processing.sphere import Equirectangular

# The network is shown a small tone-mapped copy of a panorama. The exposure is taken from the picture itself and the
# curve has no white point, so that a calibrated picture with the sun in it and a JPEG of the same room look alike.

WIDTH_PX, HEIGHT_PX = 256, 128  # of the network's classes and columns
SEEN_PX = SEEN_WIDTH_PX, SEEN_HEIGHT_PX = 512, 256  # of the picture that it is shown
MIDDLE = 0.18  # to which the picture's median luminance is scaled
BRIGHTEST = 12.0
"""Scaled values are cut here before pixels are averaged: the sun may fill one pixel of the copy, not its neighbours."""
KNEE = 0.35  # what the network is trained with; chosen, never swept
_SAMPLES_PX = 512  # columns that set the exposure; chosen, never swept
_BAND_ROWS = 256  # at a time; chosen, never swept


def network_picture(rgb: npt.ArrayLike) -> Floats:
    """Return the network's view (256, 512, 3), 0..1, of an equirectangular picture (H, W, 3) of linear RGB.

    A black picture stays black. The result does not depend on the picture's scale. Raises `ParameterError`: values that
    are not finite or below 0, another shape, fewer than 8 x 4 pixels.
    """
    picture = np.asarray(rgb)
    if picture.ndim != 3 or picture.shape[2] != 3 or picture.shape[0] < 4 or picture.shape[1] < 8:
        advice = "give (H, W, 3), 8 x 4 pixels or more"
        raise ParameterError(f"a picture of shape {picture.shape} for the room network", advice=advice)
    gain = exposure(picture)
    wide = picture.shape[1] >= SEEN_WIDTH_PX and picture.shape[0] >= SEEN_HEIGHT_PX
    bands = []
    for start in range(0, picture.shape[0], _BAND_ROWS):
        band = _scaled(picture[start : start + _BAND_ROWS], gain, start)
        # Means over an area are means over rows of means over columns: no scaled copy of the whole picture is needed.
        if wide:
            band = np.asarray(cv2.resize(band, (SEEN_WIDTH_PX, len(band)), interpolation=cv2.INTER_AREA), np.float32)
        bands.append(band)
    joined = np.concatenate(bands)
    if wide:
        return curve(np.asarray(cv2.resize(joined, SEEN_PX, interpolation=cv2.INTER_AREA), np.float32))
    return curve(_enlarged(joined))


def _scaled(band: npt.NDArray[np.floating], gain: float, first_row: int) -> Floats:
    """Return values times the gain, cut at `BRIGHTEST`."""
    lowest, highest = band.min(), band.max()
    if not (lowest >= 0 and highest < np.inf):
        text = f"values that light cannot have in rows {first_row} to {first_row + len(band) - 1}"
        raise ParameterError(text, advice="replace NaN, infinite and negative pixels; mark them invalid instead")
    exact = 1e-30 < gain < 1e30 and band.dtype == np.float32
    factor = np.float32(gain) if exact else np.float64(gain)
    with np.errstate(over="ignore"):
        return np.asarray(np.minimum(band * factor, BRIGHTEST), dtype=np.float32)


def exposure(picture: npt.NDArray[np.floating]) -> float:
    """Return the factor that brings the median luminance of a picture (H, W, 3), where not black, to `MIDDLE`."""
    step = max(1, picture.shape[1] // _SAMPLES_PX)
    few = np.asarray(picture[step // 2 :: step, step // 2 :: step], dtype=np.float64)
    luminance = few @ np.array(LUMINANCE_WEIGHTS)
    latitude = (0.5 - (np.arange(luminance.shape[0]) + 0.5) / luminance.shape[0]) * np.pi
    weight = np.broadcast_to(np.cos(latitude)[:, None], luminance.shape)
    lit = np.isfinite(luminance) & (luminance > 0)
    if not lit.any():
        return 0.0
    order = np.argsort(luminance[lit], kind="stable")
    total = np.cumsum(weight[lit][order])
    median = luminance[lit][order][int(np.searchsorted(total, total[-1] / 2))]
    return float(min(MIDDLE / median, 1e300))


def curve(scaled: Floats) -> Floats:
    """Return what is shown for scaled values >= 0 of any shape: rising, below 1, without a white point."""
    return np.sqrt(scaled / (scaled + np.float32(KNEE)))


def _enlarged(scaled: Floats) -> Floats:
    """Return a picture smaller than the copy at the copy's size, linear between its pixels' middles."""
    height, width = scaled.shape[:2]
    pad = width // 2
    around = np.concatenate([scaled[:, -pad:], scaled, scaled[:, :pad]], axis=1)
    x = ((np.arange(SEEN_WIDTH_PX) + 0.5) * width / SEEN_WIDTH_PX - 0.5 + pad).astype(np.float32)
    y = ((np.arange(SEEN_HEIGHT_PX) + 0.5) * height / SEEN_HEIGHT_PX - 0.5).astype(np.float32)
    grid_x, grid_y = np.meshgrid(x, y)
    drawn = cv2.remap(around, grid_x, grid_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(drawn, dtype=np.float32)


SHIPPED = Path(__file__).with_name("room_network.onnx")
TURNS_PX = {"draft": (0,), "standard": (0, 134), "reference": (0, 71, 134, 205)}
"""By quality: by how many columns the picture is turned; every second turn is mirrored too. Not multiples of 16, by
which the network's answer only turns along."""
LEAST_CONTRAST = 0.004  # of what the network is shown (0..1): a picture that varies less says nothing
LEAST_LATITUDE_RAD = 0.01  # chosen: keeps distances finite
_OUTPUTS = ("probabilities", "columns", "details")  # (2, H, W): skirting's share, log distance in camera heights


@dataclass(frozen=True)
class _Network:
    """A loaded network and what its page says."""

    session: Any
    name: str
    ceiling_scale: float
    floor_scale: float


def scene_evidence(
    image: RelativeImage | LuminanceImage, *, quality: str = "standard", model: Path | None = None
) -> SceneEvidence:
    """Return classes and distances of 128 x 256 pixels and boundaries of 256 columns of an upright panorama.

    ``quality``: draft, standard, reference: 1, 2 or 4 turns.
    ``model``: a network trained anew by `training` (its JSON beside it); None: the shipped one.

    A picture that shows nothing (black, or of one tone) gives uniform classes and no boundary, and a note. Raises
    `ParameterError`: another geometry than a whole equirectangular picture with longitude 0 in its middle; values that
    are not finite or below 0; an unknown quality; `SegmenterError`: the network's file or page is missing, damaged,
    changed or of another kind.
    """
    if not isinstance(image.geometry, Equirectangular) or image.geometry.yaw_rad != 0.0:
        text = "the room network needs an equirectangular picture with longitude 0 at its centre"
        advice = "resample it to Equirectangular(width, height) first"
        raise ParameterError(text, where=str(image.geometry), advice=advice)
    if quality not in TURNS_PX:
        raise ParameterError(f"no quality {quality!r}", advice=f"choose {', '.join(TURNS_PX)}")
    network = _network(model or SHIPPED)
    picture = network_picture(image.rgb)
    if float(np.ptp(picture)) < LEAST_CONTRAST:
        even = np.full((len(SceneClass), HEIGHT_PX, WIDTH_PX), 1 / len(SceneClass), dtype=np.float32)
        return SceneEvidence(even, network.name, notes=("the picture is black or uniform: nothing can be recognised",))
    turns = TURNS_PX[quality]
    probabilities, columns, details = _run(network, _turned(picture, turns))
    return SceneEvidence(
        _mean(probabilities, turns),
        network.name,
        _boundary(network, columns, turns),
        views_used=len(turns),
        reach=np.exp(_mean(details, turns)[1]),
        skirting=_mean(details, turns)[0],
    )


def _turned(picture: Floats, turns: tuple[int, ...]) -> Floats:
    """Return the turned, every second time mirrored pictures (N, 3, 256, 512); turns are columns of the answer."""
    scale = SEEN_WIDTH_PX // WIDTH_PX
    found = [np.roll(picture, scale * turn, axis=1)[:, :: -1 if number % 2 else 1] for number, turn in enumerate(turns)]
    return np.ascontiguousarray(np.stack(found).transpose(0, 3, 1, 2))


def _back(values: Floats, number: int, turn: int) -> Floats:
    """Return what was found on a turned picture (..., N) as it lies on the picture itself."""
    return np.asarray(np.roll(values[..., :: -1 if number % 2 else 1], -turn, axis=-1), dtype=np.float32)


def _mean(found: Floats, turns: tuple[int, ...]) -> Floats:
    """Return the mean (C, H, W) of what was found on all turned pictures (N, C, H, W)."""
    return np.asarray(np.mean([_back(found[k], k, by) for k, by in enumerate(turns)], axis=0, dtype=np.float64), "f")


def _boundary(network: _Network, found: Floats, turns: tuple[int, ...]) -> BoundaryEvidence:
    """Fuse the columns of all turns: means weighted by the inverse variance.

    The turns' errors are alike, as they come from one network: the variance is their mean one, plus that between them.
    """
    columns = np.stack([_back(found[k], k, turn) for k, turn in enumerate(turns)]).astype(np.float64)
    fused = []
    for edge, scale in ((0, network.ceiling_scale), (1, network.floor_scale)):
        variance = (columns[:, 2 + edge] * scale) ** 2
        weight = 1 / variance
        weight /= weight.sum(axis=0)
        middle = (columns[:, edge] * weight).sum(axis=0)
        between = ((columns[:, edge] - middle) ** 2 * weight).sum(axis=0)
        fused.append((middle, np.sqrt((variance * weight).sum(axis=0) + between)))
    (ceiling, ceiling_sigma), (floor, floor_sigma) = fused
    most = np.pi / 2 - LEAST_LATITUDE_RAD
    return BoundaryEvidence(
        np.clip(ceiling, LEAST_LATITUDE_RAD, most),
        np.clip(floor, -most, -LEAST_LATITUDE_RAD),
        ceiling_sigma,
        floor_sigma,
        np.clip(columns[:, 4].mean(axis=0), 0, 1).astype(np.float32),
    )


def _run(network: _Network, pictures: Floats) -> tuple[Floats, Floats, Floats]:
    try:
        probabilities, columns, details = network.session.run(list(_OUTPUTS), {"picture": pictures})
    # onnxruntime's errors have no common base of their own.
    except Exception as exc:
        raise SegmenterError(f"the network rejects the picture: {str(exc)[:300]}", where=network.name) from exc
    count, size = len(pictures), (HEIGHT_PX, WIDTH_PX)
    right = (count, len(SceneClass), *size), (count, 5, WIDTH_PX), (count, 2, *size)
    if (probabilities.shape, columns.shape, details.shape) != right or not np.isfinite(columns).all():
        text = f"not a room network: it gives {probabilities.shape} and {columns.shape}"
        raise SegmenterError(text, where=network.name, advice="give a network that `python -m training export` wrote")
    return probabilities, columns, details


def _network(path: Path) -> _Network:
    page_path = path.with_suffix(".json")
    try:
        stamp = (path.stat().st_mtime_ns, page_path.stat().st_mtime_ns)
    except OSError as exc:
        advice = "reinstall daylit; a network of your own needs its JSON beside it"
        raise SegmenterError("the room network or its JSON is missing", where=str(exc.filename), advice=advice) from exc
    return _loaded(path, *stamp)


@lru_cache(maxsize=2)
def _loaded(path: Path, _network_changed: int, _page_changed: int) -> _Network:
    """Load a network, once for each state of its files."""
    data = path.read_bytes()
    try:
        page = json.loads(path.with_suffix(".json").read_text("utf-8"))
        name, digest = str(page["name"]), str(page["sha256"])
        scales = float(page["ceiling_sigma_scale"]), float(page["floor_sigma_scale"])
    except (ValueError, KeyError, TypeError) as exc:
        raise SegmenterError(f"the network's JSON is damaged: {exc!r}", where=str(path.with_suffix(".json"))) from exc
    if hashlib.sha256(data).hexdigest() != digest:
        text = "the room network does not match its JSON"
        advice = "reinstall daylit, or export network and JSON together"
        raise SegmenterError(text, where=str(path), likely="the file is damaged or was replaced", advice=advice)
    # One thread: more gain little on so small a picture, and one gives the same answer everywhere.
    session = open_session(
        data, lambda what: SegmenterError(f"the room network {what}", where=str(path)), repeatable=True
    )
    there = {one.name for one in (*session.get_inputs(), *session.get_outputs())}
    if there != {"picture", *_OUTPUTS}:
        raise SegmenterError(f"not a room network: it has {', '.join(sorted(there))}", where=str(path))
    return _Network(session, name, *scales)
