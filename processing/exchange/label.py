"""A label in the picture itself: whoever sees a staged picture can read that it is one.

Its letters are 3 % of the picture's height, so that it does not vanish in large pictures. On a panorama it stands
three times, 120 degrees apart and a little below the horizon: a viewer with the usual field always shows one.
"""

from __future__ import annotations

from processing.ground.arrays import Bytes

from typing import TYPE_CHECKING, Any

import numpy as np

from processing.errors import ParameterError

if TYPE_CHECKING:
    from PIL import Image

TEXT = "Virtually staged"
LETTERS = 0.03
"""Height of a line, of the picture's."""
LEAST_LETTERS_PX = 11
"""Below which letters cannot be read; pictures lower than 370 px get relatively larger ones."""
LATITUDE_DEG = -26.0
"""Of the labels of a panorama."""
TIMES = 3
_PLATE = (16, 16, 20, 200)
_INK = (255, 255, 255, 255)


def labelled(rgb8: Bytes, text: str = TEXT, *, panorama: bool | None = None) -> Bytes:
    """Return a copy of an 8-bit picture (H, W, 3) with the label on it.

    ``panorama``: whether it shows the whole sphere; None: if it is twice as wide as high. The label is made smaller
    where it does not fit; below about 200 pixels of width it cannot be read. Raises `ParameterError` for another array
    and for a text that is empty or longer than 60 characters.
    """
    from PIL import Image

    if rgb8.dtype != np.uint8 or rgb8.ndim != 3 or rgb8.shape[2] != 3 or not rgb8.size:
        raise ParameterError(f"an 8-bit picture is uint8 (H, W, 3), not {rgb8.dtype} {rgb8.shape}")
    if not text.strip() or len(text) > 60 or not text.isprintable():
        raise ParameterError("a label is 1 to 60 printable characters")
    height, width = rgb8.shape[:2]
    round_ = width == 2 * height if panorama is None else panorama
    room_px = width // TIMES if round_ else width
    plate = _plate(text, height, room_px, height // 3 or 1)
    picture = Image.fromarray(np.ascontiguousarray(rgb8)).convert("RGBA")
    for x, y in _places(plate, width, height, whole_sphere=round_):
        picture.alpha_composite(plate, (x, y))
    return np.asarray(picture.convert("RGB"), dtype=np.uint8)


def _places(plate: Image.Image, width: int, height: int, *, whole_sphere: bool) -> list[tuple[int, int]]:
    """Return the upper left corners of the label."""
    if not whole_sphere:
        margin = min(plate.height // 2, width - plate.width, height - plate.height)
        return [(margin, height - plate.height - margin)]
    y = round((0.5 - LATITUDE_DEG / 180) * height - plate.height / 2)
    centres = [(2 * i + 1) / (2 * TIMES) * width for i in range(TIMES)]
    return [(max(0, round(x - plate.width / 2)), min(y, height - plate.height)) for x in centres]


def _plate(text: str, height: int, room_px: int, tallest_px: int) -> Image.Image:
    """Return the label on its dark plate, at most ``room_px`` wide."""
    from PIL import Image, ImageDraw, ImageFont

    size = max(LEAST_LETTERS_PX, round(LETTERS * height))
    font: Any = ImageFont.load_default(size)
    left, top, right, bottom = font.getbbox(text)
    pad = max(2, size // 2)
    plate = Image.new("RGBA", (int(right - left) + 2 * pad, int(bottom - top) + 2 * pad), (0, 0, 0, 0))
    draw = ImageDraw.Draw(plate)
    draw.rounded_rectangle((0, 0, plate.width - 1, plate.height - 1), pad // 2, _PLATE)
    draw.text((pad - left, pad - top), text, fill=_INK, font=font)
    shrink = min(1.0, room_px / plate.width, tallest_px / plate.height)
    if shrink < 1:
        plate = plate.resize((max(1, int(plate.width * shrink)), max(1, int(plate.height * shrink))))
    return plate
