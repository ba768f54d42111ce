"""A day in pictures: a contact sheet with the times, and an animation."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from processing.errors import ParameterError
from processing.ground.arrays import Bytes, Floats
from processing.pictures.preview import auto_exposure, preview_rgb8
from processing.pictures.writing import write_bytes

MARGIN_PX, TEXT_PX = 8, 22
FRAME_MS = 500
_INK, _PAPER = (30, 30, 34), (250, 250, 248)


def common_exposure(pictures: Sequence[Floats]) -> float:
    """Return one exposure for all pictures of a day, so that dusk looks darker than noon: the brighter half's mean."""
    if not pictures:
        raise ParameterError("no pictures")
    every = sorted(auto_exposure(p) for p in pictures)
    return float(np.exp(np.mean(np.log(every[: max(1, (len(every) + 1) // 2)]))))


def contact_sheet(pictures: Sequence[Bytes], captions: Sequence[str], *, columns: int = 3) -> Bytes:
    """Return 8-bit pictures (H, W, 3) of one size in rows, each with its caption below."""
    from PIL import Image, ImageDraw, ImageFont

    if not pictures or len(pictures) != len(captions):
        raise ParameterError("give as many captions as pictures, one at least")
    high, wide = pictures[0].shape[:2]
    columns = min(columns, len(pictures))
    rows = -(-len(pictures) // columns)
    cell_w, cell_h = wide + MARGIN_PX, high + TEXT_PX + MARGIN_PX
    sheet = Image.new("RGB", (columns * cell_w + MARGIN_PX, rows * cell_h + MARGIN_PX), _PAPER)
    pen, font = ImageDraw.Draw(sheet), ImageFont.load_default(15)
    for number, (picture, caption) in enumerate(zip(pictures, captions, strict=True)):
        x, y = MARGIN_PX + number % columns * cell_w, MARGIN_PX + number // columns * cell_h
        sheet.paste(Image.fromarray(np.ascontiguousarray(picture)), (x, y))
        pen.text((x + 2, y + high + 2), caption, fill=_INK, font=font)
    return np.asarray(sheet, dtype=np.uint8)


def write_sheet(path: Path, pictures: Sequence[Bytes], captions: Sequence[str]) -> None:
    """Write a contact sheet as PNG."""
    from PIL import Image

    out = io.BytesIO()
    Image.fromarray(contact_sheet(pictures, captions)).save(out, "PNG")
    write_bytes(path, out.getvalue())


def write_animation(path: Path, pictures: Sequence[Bytes]) -> None:
    """Write an animated WebP that repeats."""
    from PIL import Image

    frames = [Image.fromarray(np.ascontiguousarray(p)) for p in pictures]
    out = io.BytesIO()
    frames[0].save(out, "WEBP", save_all=True, append_images=frames[1:], duration=FRAME_MS, loop=0, quality=80)
    write_bytes(path, out.getvalue())


def reduced(rgb: Floats, rows: int) -> Floats:
    """Return a picture (H, W, 3) at most ``rows`` high, by area."""
    import cv2

    if rgb.shape[0] <= rows:
        return rgb
    size = (round(rgb.shape[1] * rows / rgb.shape[0]), rows)
    return np.asarray(cv2.resize(rgb, size, interpolation=cv2.INTER_AREA), dtype=np.float32)


__all__ = ["common_exposure", "contact_sheet", "preview_rgb8", "reduced", "write_animation", "write_sheet"]
