"""From linear light to what cameras give: nadir, exposure, colour cast, tone curve, noise, blur, JPEG."""

from __future__ import annotations

import cv2
import numpy as np

from processing.ground.arrays import Bytes, Floats, Int8s
from processing.ground.colour import linear_of_srgb
from processing.segmentation.embedded import HEIGHT_PX, WIDTH_PX, network_picture
from processing.segmentation.evidence import SceneClass


def add_foot(rng: np.random.Generator, light: Floats, label: Int8s, eye_m: float) -> tuple[Floats, Int8s]:
    """Put a tripod, a black or blurred disc, or nothing, under the camera of a picture (H, W, 3) with labels (H, W)."""
    chance = rng.random()
    if chance < 0.3:
        return light, label
    rows, columns = label.shape
    down = (np.arange(rows) + 0.5)[::-1, None] / rows * np.pi
    turn = ((np.arange(columns) + 0.5) / columns * 2 * np.pi)[None]
    phase = rng.uniform(0, 2 * np.pi, 5)
    wobble = sum(np.sin(turn * k + phase[k]) * rng.uniform(0, 1) / k for k in range(1, 5))
    disc = np.radians(rng.uniform(3, 9) if chance < 0.8 else rng.uniform(9, 24)) * (1 + 0.15 * wobble)
    where = np.broadcast_to(down < disc, label.shape).copy()
    legs = int(rng.choice([0, 3, 3, 4]))
    spread, thick = rng.uniform(0.2, 0.6), rng.uniform(0.012, 0.035)
    for k in range(legs):
        away = np.abs((turn - phase[0] - k * 2 * np.pi / legs + np.pi) % (2 * np.pi) - np.pi)
        from_axis = np.tan(np.minimum(down, 1.2)) * np.sin(np.minimum(away, 1.5))
        where |= (away < 1.5) & (from_axis < thick) & (down < np.arctan(spread / eye_m))
    below = light[-rows // 8 :].mean(axis=(0, 1))
    kind = rng.random()
    if kind < 0.6:
        tone = np.full(3, rng.uniform(0, 0.25)) * below
    elif kind < 0.8:
        tone = below * rng.uniform(0.6, 1.4)
    else:
        tone = np.abs(rng.uniform(0, 2) * (1 + 0.4 * rng.normal(size=3))) * below
    out, named = light.copy(), label.copy()
    shade = 1 + 0.5 * rng.random() * np.sin(turn * rng.integers(1, 7) + phase[1]) * np.ones_like(down)
    out[where] = (tone * np.maximum(shade, 0)[..., None])[where]
    named[where] = SceneClass.TRIPOD
    return out, named


def photographed(rng: np.random.Generator, light: Floats) -> Floats:
    """Return the network's view, shape (128, 256, 3), of linear light (H, W, 3), most often by way of a JPEG."""
    cast = np.exp(rng.normal(0, 0.12, 3) * np.array([1.0, 0.4, 1.0]))
    if rng.random() < 0.3:
        # Lamps that the camera took for daylight.
        cast *= np.exp(rng.uniform(0.1, 0.45) * np.array([1.0, 0.2, -1.2]))
    shown = light * cast.astype(np.float32)
    if rng.random() < 0.2:
        noisy = shown * (1 + rng.normal(0, 0.02, shown.shape)).astype(np.float32)
        return network_picture(np.maximum(noisy, 0))
    return network_picture(decoded(_jpeg(rng, _developed(rng, shown))))


def _developed(rng: np.random.Generator, light: Floats) -> Floats:
    """Return display values 0..1."""
    luminance = light.mean(axis=2)
    if rng.random() < 0.35:
        # What tone-mapped real-estate pictures look like: large differences are flattened.
        wide = cv2.GaussianBlur(
            np.log(luminance + 1e-4), (0, 0), float(rng.uniform(4, 40)), borderType=cv2.BORDER_REFLECT
        )
        light = light * np.exp(-rng.uniform(0.2, 0.75) * (wide - wide.mean()))[..., None]
        luminance = light.mean(axis=2)
    middle = float(np.median(luminance)) + 1e-6
    exposed = light * np.float32(0.22 / middle * 2.0 ** rng.normal(0.1, 0.75))
    knee = rng.uniform(0.0, 1.0)
    if knee > 0.5:
        exposed = exposed * (1 + exposed / 9) / (1 + exposed * rng.uniform(0.2, 0.8))
    encoded = np.clip(exposed, 0, 1) ** np.float32(1 / rng.uniform(1.9, 2.6))
    contrast = rng.normal(0, 0.25)
    encoded = encoded + contrast * (encoded * encoded * (3 - 2 * encoded) - encoded)
    grey = encoded.mean(axis=2, keepdims=True)
    return np.asarray(np.clip(grey + (encoded - grey) * rng.uniform(0.6, 1.9), 0, 1), dtype=np.float32)


def _jpeg(rng: np.random.Generator, shown: Floats) -> Bytes:
    if rng.random() < 0.3:
        shown = np.asarray(cv2.GaussianBlur(shown, (0, 0), float(rng.uniform(0.4, 1.2))), dtype=np.float32)
    noisy = shown + rng.normal(0, rng.uniform(0, 0.03), shown.shape)
    codes = np.clip(noisy * 255 + 0.5, 0, 255).astype(np.uint8)
    if rng.random() < 0.6:
        _, data = cv2.imencode(".jpg", codes, [cv2.IMWRITE_JPEG_QUALITY, int(rng.integers(30, 96))])
        codes = np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR), dtype=np.uint8)
    return codes


def decoded(codes: Bytes) -> Floats:
    """Return linear light of sRGB codes of any shape (IEC 61966-2-1)."""
    return linear_of_srgb(codes)


def small_labels(label: Int8s) -> Bytes:
    """Return the commonest class of labels (H, W) in each of the network's pixels, uint8."""
    fine = label.reshape(HEIGHT_PX, label.shape[0] // HEIGHT_PX, WIDTH_PX, label.shape[1] // WIDTH_PX)
    votes = np.stack([(fine == k).sum(axis=(1, 3)) for k in range(len(SceneClass))])
    return np.asarray(votes.argmax(axis=0), dtype=np.uint8)
