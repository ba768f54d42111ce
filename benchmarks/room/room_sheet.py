"""``python -m benchmarks.room.room_sheet``: two dozen simulated rooms on one sheet.


All rooms are of training seeds. Each panorama is exposed and balanced by itself, as a camera would.
"""

from __future__ import annotations

from itertools import cycle, islice
from pathlib import Path
from typing import get_args

import click
import cv2
import numpy as np

from benchmarks.seeds import seeds
from mocks.rooms.light.light import QUALITIES
from mocks.rooms.model import Use
from mocks.rooms.room import Room, make_room
from mocks.rooms.sky.sky import Kind
from mocks.rooms.truth import equirectangular
from mocks.rooms.world import RoomWorld
from mocks.worlds.light import Site, luminance_cd_m2
from processing.ground.arrays import Bytes, Floats
from processing.ground.colour import srgb_of_linear

COLUMNS, ROWS, TILE_ROWS_PX, GAP_PX = 4, 6, 240, 6
SHEET_SEED = 3
USES = (Use.LIVING, Use.BEDROOM, Use.DINING, Use.OFFICE, Use.LIVING, Use.BEDROOM, Use.EMPTY)
LAMPS_EVERY = 5
JPEG_QUALITY = 88
BALANCE = 0.7
"""Share of the light's colour that the white balance takes away."""
MIDDLE, WHITE, CONTRAST = 0.5, 16.0, 1.25
"""What the logarithmic mean and white are before the highlights are compressed (Reinhard et al. 2002, equation 4),
and the power that gives back the contrast this takes."""


def sheet_rooms(seed: int = SHEET_SEED) -> list[Room]:
    """Return the rooms of the sheet: every use and every sky in turn, lamps lit in some."""
    numbers = seeds("train", COLUMNS * ROWS, seed)
    uses, skies = cycle(USES), cycle(get_args(Kind))
    drawn = islice(zip(numbers, uses, skies, strict=False), len(numbers))
    return [make_room(n, use, sky=sky, lamps_on=k % LAMPS_EVERY == 2) for k, (n, use, sky) in enumerate(drawn)]


def panorama(world: RoomWorld, rows: int) -> Bytes:
    """Return a room as an 8-bit sRGB panorama (rows, 2 rows, 3), the mean of four rays a pixel."""
    rays = equirectangular(2 * rows)
    shown = tone_mapped(world.radiance(Site.INDOOR, rays, np.pi / (2 * rows)))
    return np.asarray(cv2.resize(shown, (2 * rows, rows), interpolation=cv2.INTER_AREA), dtype=np.uint8)


def tone_mapped(radiance: Floats) -> Bytes:
    """Return sRGB bytes of a panorama in linear RGB: ceilings nearly white, the rest exposed by its middle."""
    rows = len(radiance)
    ceiling = np.median(radiance[: rows // 6], axis=(0, 1))
    balanced = radiance / (ceiling / luminance_cd_m2(ceiling)) ** BALANCE
    light = luminance_cd_m2(balanced)
    # Each row counts for the solid angle it stands for; a bright window hardly moves the logarithmic mean.
    share = np.cos((np.arange(rows) + 0.5) / rows * np.pi - np.pi / 2)
    middle = np.exp(np.average(np.log(np.maximum(light, 1e-3)).mean(axis=1), weights=share))
    exposed, light = balanced * (MIDDLE / middle), light[..., None] * (MIDDLE / middle)
    soft = exposed * (1 + light / WHITE**2) / (1 + light)
    soft = np.maximum(soft, 0) ** CONTRAST
    return srgb_of_linear(soft)


def contact_sheet(pictures: list[Bytes], columns: int = COLUMNS) -> Bytes:
    """Return equal pictures in rows of ``columns``, white between them."""
    gap = GAP_PX // 2
    framed = [np.pad(p, ((gap, gap), (gap, gap), (0, 0)), constant_values=255) for p in pictures]
    lines = [np.concatenate(framed[k : k + columns], axis=1) for k in range(0, len(framed), columns)]
    return np.concatenate(lines)


def save(picture: Bytes, path: Path) -> None:
    """Write a JPEG or PNG."""
    options = [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY] if path.suffix in (".jpg", ".jpeg") else []
    if not cv2.imwrite(str(path), picture[..., ::-1], options):
        raise OSError(f"{path} could not be written")


@click.command()
@click.option("--out", type=click.Path(path_type=Path), default=Path("docs/images/rooms.jpg"), show_default=True)
@click.option("--quality", type=click.Choice(list(QUALITIES)), default="draft", show_default=True)
@click.option(
    "--room", "names", multiple=True, help="Such as bedroom-7: one large panorama each, in place of the sheet."
)
@click.option(
    "--rows", type=click.IntRange(min=16), default=TILE_ROWS_PX, show_default=True, help="Height of each, px."
)
def main(out: Path, quality: str, names: tuple[str, ...], rows: int) -> None:
    """Render the contact sheet of simulated rooms."""
    rooms = [make_room(int(seed), use) for use, seed in (name.split("-") for name in names)] or sheet_rooms()
    pictures = []
    for room in rooms:
        pictures.append(panorama(RoomWorld(room, quality), rows))
        click.echo(f"{room.name} {room.sky.kind}{' lamps' if room.lamps_on else ''}", err=True)
    save(contact_sheet(pictures, 1 if names else COLUMNS), out)


if __name__ == "__main__":
    main()
