"""What is done to pictures of training views: turned, mirrored, stretched, coloured anew.

A room stretched along its walls' directions is seen, from the stretched camera place, along directions that are known
for every pixel, and its boundaries stay exact (the augmentation that HorizonNet, Sun et al. 2019, introduced).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional

from training.looks import Bank, Batch, Chance, add_foot, blurred, photographed, radiance

STRETCHED = 0.65
"""Share of pictures."""


class Lesson(NamedTuple):
    """Pictures and their truth."""

    picture: Tensor
    """(B, 3, H, W)"""
    label: Tensor
    """(B, H, W)"""
    reach: Tensor
    """(B, H, W): log of the distance in camera heights; NaN where nothing is met."""
    ceiling_rad: Tensor
    """(B, N) of columns, as ``floor_rad`` and ``corner``."""
    floor_rad: Tensor
    corner: Tensor


@torch.no_grad()
def lesson(views: Batch, bank: Bank, generator: torch.Generator, *, augmented: bool = True) -> Lesson:
    """Return pictures of views (`training.rooms.render.View`, stacked) with their truth."""
    chance = Chance(len(views["label"]), generator)
    light, label = add_foot(radiance(views, bank, chance), views["label"].long(), views["eye_m"][:, 0], chance)
    picture = photographed(light, chance).permute(0, 3, 1, 2)
    far = views["reach_m"].float() / views["eye_m"][:, :, None]
    reach = torch.where(far > 0, far.clamp(0.05, 20).log(), torch.nan)
    made = Lesson(picture, label, reach, views["ceiling_rad"], views["floor_rad"], views["corner"])
    if not augmented:
        return made
    spread = torch.exp((0.24 * chance.normal(2)).clamp(-0.55, 0.55))
    spread = torch.where(chance.yes(STRETCHED)[:, None], spread, torch.ones_like(spread))
    made = turned(stretched(made, spread, views["direction_rad"][:, 0]), chance)
    return made._replace(picture=recoloured(made.picture, chance))


def stretched(made: Lesson, factors: Tensor, direction_rad: Tensor) -> Lesson:
    """Return rooms stretched by factors (B, 2) along azimuth ``direction_rad`` (B,) and across it; heights stay."""
    count, _, rows, columns = made.picture.shape
    device = made.picture.device
    along, across = factors[:, :1], factors[:, 1:]

    def sources(n: int) -> tuple[Tensor, Tensor]:
        """Return where columns come from, in columns (B, n), and how much nearer their walls were."""
        longitude = ((torch.arange(n, device=device) + 0.5) / n - 0.5) * (2 * math.pi) - direction_rad[:, None]
        x, y = torch.sin(longitude) / across, torch.cos(longitude) / along
        source = torch.atan2(x, y) + direction_rad[:, None]
        return (source / (2 * math.pi) + 0.5) * n - 0.5, torch.hypot(x, y)

    at_column, shrunk = sources(columns)
    latitude = ((0.5 - (torch.arange(rows, device=device) + 0.5) / rows) * math.pi)[None, :, None]
    x, y = torch.cos(latitude) * shrunk[:, None], torch.sin(latitude).expand(count, rows, columns)
    at_row = (0.5 - torch.atan2(y, x) / math.pi) * rows - 0.5
    # One column more at either side, so that interpolation meets the seam's other side.
    grid_x = (at_column % columns + 1 + 0.5) / (columns + 2) * 2 - 1
    grid = torch.stack([grid_x[:, None].expand(-1, rows, -1), (at_row + 0.5) / rows * 2 - 1], dim=-1)

    def drawn(values: Tensor, mode: str) -> Tensor:
        wide = torch.cat([values[..., -1:], values, values[..., :1]], dim=-1)
        return functional.grid_sample(wide, grid, mode=mode, padding_mode="border", align_corners=False)

    label = drawn(made.label[:, None].float(), "nearest")[:, 0].round().long()
    # The path to the source, stretched as its direction is.
    reach = drawn(made.reach[:, None], "nearest")[:, 0] - torch.log(torch.hypot(x, y))
    there, nearer = sources(made.floor_rad.shape[1])
    columned = [
        _columns(made.ceiling_rad, there, nearer),
        _columns(made.floor_rad, there, nearer),
        _columns(made.corner, there),
    ]
    return Lesson(drawn(made.picture, "bilinear"), label, reach, *columned)


def _columns(values: Tensor, at: Tensor, nearer: Tensor | None = None) -> Tensor:
    count = values.shape[1]
    low = at.floor()
    share = at - low
    first = values.gather(1, low.long() % count)
    found = first * (1 - share) + values.gather(1, (low.long() + 1) % count) * share
    if nearer is None:
        return found
    # Walls are farther away by the factor, their edges as high as before.
    return torch.atan2(torch.sin(found), torch.cos(found) / nearer)


def turned(made: Lesson, chance: Chance) -> Lesson:
    """Return each turned about the vertical by whole columns, and every second mirrored."""
    width = made.picture.shape[-1]
    by = chance.uniform(0, width).long().clamp(max=width - 1)
    mirror = chance.yes(0.5)

    def moved(values: Tensor) -> Tensor:
        n = values.shape[-1]
        at = (torch.arange(n, device=values.device)[None] - (by * n // width)[:, None]) % n
        at = torch.where(mirror[:, None], at.flip(1), at)
        shape = [len(at), *([1] * (values.dim() - 2)), n]
        return values.gather(-1, at.reshape(shape).expand_as(values))

    return Lesson(*(moved(values) for values in made))


def recoloured(picture: Tensor, chance: Chance) -> Tensor:
    """Return pictures (B, 3, H, W) of 0..1 with a chance exposure, contrast, colour, uneven light, blur and noise."""
    device, one = picture.device, (slice(None), None, None, None)
    out = picture.clamp(1e-6, 1) ** torch.exp(0.25 * chance.normal())[one]
    mix = torch.eye(3, device=device) + 0.15 * chance.normal(3, 3) * chance.yes(0.5)[:, None, None]
    out = torch.einsum("bchw,bcd->bdhw", out, mix / mix.sum(dim=1, keepdim=True))
    grey = out.mean(dim=1, keepdim=True)
    out = grey + (out - grey) * chance.uniform(0.0, 1.7)[one]
    out = out * (1 + 0.06 * chance.normal(3))[:, :, None, None]
    middle = out.mean(dim=(1, 2, 3), keepdim=True)
    contrast = torch.where(chance.yes(0.5), chance.uniform(0.7, 1.4), 1.0)
    out = middle + (out - middle) * contrast[one]
    rows = (4, 8, 16)[int(chance.uniform(0, 3)[0])]
    field = chance.normal(1, rows, 2 * rows) * (chance.uniform(0.02, 0.13) * chance.yes(0.4))[one]
    field = torch.cat([field, field[..., :1]], dim=-1)
    out = out * torch.exp(functional.interpolate(field, picture.shape[2:], mode="bicubic", align_corners=True))
    soft = blurred(out.permute(0, 2, 3, 1), 1.0).permute(0, 3, 1, 2)
    sharpness = torch.where(chance.yes(0.35), chance.uniform(-0.8, 0.6), 0.0)[one]
    out = out + sharpness * (out - soft)
    return (out + chance.normal(*out.shape[1:]) * chance.uniform(0, 0.02)[one]).clamp(0, 1)
