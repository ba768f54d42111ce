"""Pictures of training views, drawn anew at every step: coats, light, the camera's foot, exposure, tones, noise.

All of a batch at once, where the views lie (a GPU, most often). Amounts are drawn, forms are the view's: gradients from
the windows, contact shadows, patches of sun where the sun can shine, windows mirrored by a glossy floor.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor
from torch.nn import functional

from processing.ground.colour import LUMINANCE_WEIGHTS
from processing.segmentation.embedded import BRIGHTEST, KNEE, MIDDLE
from processing.segmentation.evidence import SceneClass
from training.rooms.paints import LEVELS, SIDE, Tile

STEP = 4
"""Pixels of a view per coarse point, each way."""
_PYRAMID = [side * side for side in LEVELS]
_WARM = (1.0, 0.2, -1.0)

Batch = dict[str, Tensor]


class Bank:
    """The textures of all tiles, where the views are: pixels of all levels in one row."""

    def __init__(self, tiles: list[Tile], device: torch.device) -> None:
        rows = [torch.cat([torch.from_numpy(level).reshape(-1, 3) for level in tile.levels]) for tile in tiles]
        self.pixels = torch.stack(rows).to(device)
        self.size_m = torch.tensor([tile.size_m for tile in tiles], device=device, dtype=torch.float32)
        starts = [sum(_PYRAMID[:k]) for k in range(len(_PYRAMID))]
        self.starts = torch.tensor(starts, device=device)
        self.sides = torch.tensor(LEVELS, device=device)


class Chance:
    """Random numbers of a batch, one of each a view."""

    def __init__(self, count: int, generator: torch.Generator) -> None:
        self.count, self.generator = count, generator

    def uniform(self, low: float, high: float, *shape: int) -> Tensor:
        """Return values (B, *shape)."""
        device = self.generator.device
        return low + (high - low) * torch.rand(self.count, *shape, generator=self.generator, device=device)

    def normal(self, *shape: int) -> Tensor:
        """Return values (B, *shape)."""
        return torch.randn(self.count, *shape, generator=self.generator, device=self.generator.device)

    def yes(self, share: float) -> Tensor:
        """Return flags (B,)."""
        return self.uniform(0, 1) < share


def rays(rows: int, device: torch.device) -> Tensor:
    """Return unit directions (rows, 2 rows, 3); longitude 0 along +y in the middle, growing towards +x."""
    latitude = (0.5 - (torch.arange(rows, device=device) + 0.5) / rows) * math.pi
    longitude = ((torch.arange(2 * rows, device=device) + 0.5) / (2 * rows) - 0.5) * (2 * math.pi)
    flat = torch.cos(latitude)[:, None]
    parts = (
        flat * torch.sin(longitude),
        flat * torch.cos(longitude),
        torch.sin(latitude)[:, None].expand(-1, 2 * rows),
    )
    return torch.stack(parts, dim=-1)


def _wide(values: Tensor, dims: int) -> Tensor:
    """Return (B, ...) with ``dims`` more axes."""
    return values.reshape(*values.shape, *([1] * dims))


def radiance(views: Batch, bank: Bank, chance: Chance) -> Tensor:
    """Return linear light (B, H, W, 3), arbitrary scale, of views as `training.rooms.render.View`."""
    way = rays(views["label"].shape[1], views["label"].device)
    place = way * views["reach_m"].float()[..., None]
    normal = views["normal"].float() / 127
    coats = _coats(views, chance)
    paint = views["paint"].long()
    albedo = _albedo(views, bank, coats, place, normal)
    light, window = _light(views, coats, place, normal, chance)
    mean = light.mean(dim=(1, 2, 3))
    out = albedo * light + _of(coats[..., 8:], paint) * _wide(chance.uniform(2, 12) * mean, 3)
    out = _glossy(views, coats, out, way, normal, window)
    away = outdoors(way, chance) * _wide(window, 3)
    return torch.where((paint < 0)[..., None], away, out)


def _coats(views: Batch, chance: Chance) -> Tensor:
    """Return one set of coats (B, P, 9), its tones changed a little."""
    sets = views["coats"]
    which = (chance.uniform(0, 1) * sets.shape[1]).long().clamp(max=sets.shape[1] - 1)
    coats = sets[torch.arange(len(which), device=which.device), which].float()
    tone = torch.exp(0.18 * chance.normal(coats.shape[1], 1) + 0.05 * chance.normal(coats.shape[1], 3))
    return torch.cat([(coats[..., :3] * tone).clamp(0.015, 0.92), coats[..., 3:]], dim=-1)


def _of(values: Tensor, paint: Tensor) -> Tensor:
    """Return the values (B, ..., C) of paints (B, ...) from a table (B, P, C)."""
    flat = paint.clamp(min=0).reshape(paint.shape[0], -1, 1).expand(-1, -1, values.shape[-1])
    return values.gather(1, flat).reshape(*paint.shape, values.shape[-1])


def _albedo(views: Batch, bank: Bank, coats: Tensor, place: Tensor, normal: Tensor) -> Tensor:
    coat = _of(coats, views["paint"].long())
    number = coat[..., 3].round().long()
    tile, scale, turn = number.clamp(min=0), coat[..., 4].clamp(min=0.05), coat[..., 5]
    upright = normal[..., 2].abs() < 0.7
    # On upright faces the horizontal axis is the one that runs along the face.
    along = torch.where(normal[..., 0].abs() > normal[..., 1].abs(), place[..., 1], place[..., 0])
    u = torch.where(upright, along, place[..., 0])
    v = torch.where(upright, place[..., 2], place[..., 1])
    c, s = torch.cos(turn), torch.sin(turn)
    size = bank.size_m[tile]
    x = ((u * c - v * s) / scale / size[..., 0]) % 1.0
    y = ((u * s + v * c) / scale / size[..., 1]) % 1.0
    footprint = views["reach_m"].float() * (math.pi / place.shape[1]) / scale
    level = torch.log2((footprint / (size[..., 0] / SIDE)).clamp(min=1)).ceil().long().clamp(max=len(LEVELS) - 1)
    side = bank.sides[level]
    column, row = (x * side).long().clamp(min=0), (y * side).long().clamp(min=0)
    at = bank.starts[level] + torch.minimum(row, side - 1) * side + torch.minimum(column, side - 1)
    relative = bank.pixels[tile, at]
    factor = (1 + (relative - 1) * coat[..., 6:7]).clamp(min=0.05)
    return torch.where((number >= 0)[..., None], coat[..., :3] * factor, coat[..., :3]).clamp(max=0.95)


def _light(views: Batch, coats: Tensor, place: Tensor, normal: Tensor, chance: Chance) -> tuple[Tensor, Tensor]:
    """Return light on every pixel (B, H, W, 3), mean about 1, and the windows' radiance (B,) on the same scale."""
    sky, lamps = views["sky"].float(), views["lamps"].float()
    mean_sky, mean_lamps = sky.mean(dim=(1, 2)), lamps.mean(dim=(1, 2))
    has_sky, has_lamps = mean_sky > 1e-6, mean_lamps > 1e-6
    use_lamps = has_lamps & (chance.yes(0.45) | ~has_sky)
    warm = torch.tensor(_WARM, device=sky.device)
    share = torch.where(has_sky, chance.uniform(0.3, 1.0), 0.0)
    sky_gain = share / mean_sky.clamp(min=1e-6)
    lamp_gain = torch.where(use_lamps, (1 - 0.8 * share) / mean_lamps.clamp(min=1e-6), 0.0)
    day = _wide((1 + 0.08 * chance.normal(3)).clamp(min=0.25), 0)[:, None, None]
    tint = (1 + 0.25 * chance.normal(3) * warm).clamp(min=0.25)[:, None, None]
    direct = _wide(sky * _wide(sky_gain, 2), 1) * day + _wide(lamps * _wide(lamp_gain, 2), 1) * tint
    level = direct.mean(dim=(1, 2, 3))
    lit = level > 1e-6
    # What the surroundings give back: their colour times the mean light, less where they are close.
    bounce = views["bounce"].long()
    colour = torch.where((bounce >= 0)[..., None], _of(coats[..., :3], bounce), 0.2).mean(dim=3)
    fill = torch.where(lit, torch.exp(chance.uniform(-1.2, 0.7)), 1.0) * torch.where(lit, level, 1.0).clamp(min=0.2)
    soft = colour * _wide(views["openness"].float(), 1) * _wide(fill, 3)
    even = smoothed(smoothed(direct + soft, place, normal), place, normal)
    total = spread(even, place, normal)
    window = torch.where(has_sky, sky_gain * torch.exp(chance.uniform(-0.5, 1.5)), chance.uniform(1, 20)).clamp(0.3, 60)
    return total + _sun(views, normal, chance, torch.where(lit, level, 1.0)), window


def _sun(views: Batch, normal: Tensor, chance: Chance, level: Tensor) -> Tensor:
    suns = views["suns"]
    which = (chance.uniform(0, 1) * suns.shape[1]).long().clamp(max=suns.shape[1] - 1)
    ray = suns[torch.arange(len(which), device=which.device), which]
    seen = (views["sun"].long() >> _wide(which, 2)) & 1
    cosine = (normal * ray[:, None, None]).sum(dim=-1).clamp(min=0)
    strength = torch.where(chance.yes(0.5), chance.uniform(1.5, 15.0) * level, 0.0)
    colour = torch.tensor([1.0, 0.95, 0.85], device=normal.device)
    return _wide(seen * cosine * _wide(strength, 2), 1) * colour


def coarse(values: Tensor) -> Tensor:
    """Return every fourth value each way of (B, H, W, ...)."""
    return values[:, STEP // 2 - 1 :: STEP, STEP // 2 - 1 :: STEP]


def smoothed(light: Tensor, place: Tensor, normal: Tensor, reach: int = 3) -> Tensor:
    """Return coarse light (B, h, w, 3) averaged with neighbours on the same plane."""
    normal = coarse(normal)
    plane = (coarse(place) * normal).sum(dim=-1)
    solid = normal.abs().sum(dim=-1) > 0.5
    rows = torch.arange(light.shape[1], device=light.device)
    total, weight = torch.zeros_like(light), torch.full_like(plane, 1e-6)
    for down in range(-reach, reach + 1):
        at = (rows + down).clamp(0, light.shape[1] - 1)
        n, p, ok, there = normal[:, at], plane[:, at], solid[:, at], light[:, at]
        for right in range(-reach, reach + 1):
            turned = [values.roll(-right, dims=2) for values in (n, p, ok, there)]
            same = ((turned[0] * normal).sum(dim=-1) > 0.95) & ((turned[1] - plane).abs() < 0.05) & turned[2]
            total += turned[3] * same[..., None]
            weight += same
    return total / weight[..., None]


def spread(light: Tensor, place: Tensor, normal: Tensor) -> Tensor:
    """Return coarse light (B, h, w, 3) at all pixels (B, H, W, 3): linear, among neighbours on the same plane."""
    height, width = normal.shape[1:3]
    few = coarse(normal)
    low_h, low_w = few.shape[1:3]
    plane, few_plane = (place * normal).sum(dim=-1), (coarse(place) * few).sum(dim=-1)
    solid = few.abs().sum(dim=-1) > 0.5
    y = (torch.arange(height, device=light.device) - (STEP // 2 - 1)) / STEP
    x = (torch.arange(width, device=light.device) - (STEP // 2 - 1)) / STEP
    y0, x0 = y.floor().long(), x.floor().long()
    wy, wx = y - y0, x - x0
    out, total = torch.zeros_like(normal), torch.zeros_like(plane)
    for down in (0, 1):
        rows = (y0 + down).clamp(0, low_h - 1)[:, None]
        for right in (0, 1):
            at = (slice(None), rows, ((x0 + right) % low_w)[None])
            share = (wy if down else 1 - wy)[:, None] * (wx if right else 1 - wx)[None]
            same = ((few[at] * normal).sum(dim=-1) > 0.9) & ((few_plane[at] - plane).abs() < 0.06) & solid[at]
            weight = share * (1e-3 + same)
            out += light[at] * weight[..., None]
            total += weight
    return out / total[..., None].clamp(min=1e-6)


def _glossy(views: Batch, coats: Tensor, out: Tensor, way: Tensor, normal: Tensor, window: Tensor) -> Tensor:
    """Add mirrored light on glossy paints: bright windows and the colours of what stands there."""
    gloss = _of(coats[..., 7:8], views["paint"].long())[..., 0]
    mirrored = views["mirrored"].long().repeat_interleave(2, dim=1).repeat_interleave(2, dim=2)
    cosine = -(way * normal).sum(dim=-1).clamp(-1, 0)
    shown = torch.where(
        (mirrored >= 0)[..., None],
        _of(coats[..., :3], mirrored) * 2 * out.mean(dim=(1, 2), keepdim=True),
        _wide(window, 3),
    )
    share = gloss + (0.6 - gloss).clamp(min=0) * (1 - cosine) ** 5
    share = torch.where((gloss > 0) & (mirrored > -2) & (views["paint"] >= 0), share, 0.0)
    return out + share[..., None] * (shown - out * 0.5)


def outdoors(way: Tensor, chance: Chance) -> Tensor:
    """Return relative radiance (B, H, W, 3) of sky, land and what stands on it, about 1 for the sky."""
    azimuth, up = torch.atan2(way[..., 0], way[..., 1])[None], way[..., 2][None]
    device = way.device
    grey = _wide(chance.yes(0.4), 3)
    zenith = torch.where(
        grey, torch.tensor([0.8, 0.9, 1.0], device=device), torch.tensor([0.35, 0.6, 1.2], device=device)
    )
    share = up.clamp(0, 1)[..., None] ** 0.5
    out = _wide(chance.uniform(0.8, 1.4), 3) * (1 - share) + zenith * share
    ground = (_wide(chance.uniform(0.05, 0.45), 1) * (1 + 0.25 * chance.normal(3))).abs()[:, None, None]
    out = torch.where((up < 0)[..., None], ground, out)
    phase = chance.uniform(0, 6.28, 6)
    edge = torch.stack([torch.sin(azimuth * k * 2 + _wide(phase[:, k - 1], 2)) / k for k in range(1, 7)]).sum(dim=0)
    line = _wide(chance.uniform(0, 0.45), 2) * (0.5 + 0.3 * edge) + _wide(chance.uniform(-0.1, 0.1), 2)
    kinds = torch.tensor([(0.5, 0.8, 0.3), (0.8, 0.75, 0.7), (0.7, 0.4, 0.3)], device=device)
    leaf = _wide(chance.uniform(0.04, 0.35), 1) * kinds[(chance.uniform(0, 3)).long().clamp(max=2)]
    a, b = (_wide(chance.uniform(20, 90), 2) for _ in range(2))
    speckle = 1 + 0.5 * torch.sin(azimuth * a + _wide(phase[:, 0], 2)) * torch.sin(up * b + _wide(phase[:, 1], 2))
    things = (up < line) & (up > _wide(chance.uniform(-0.35, -0.03), 2))
    return torch.where(things[..., None], leaf[:, None, None] * speckle[..., None], out)


def add_foot(light: Tensor, label: Tensor, eye_m: Tensor, chance: Chance) -> tuple[Tensor, Tensor]:
    """Put a tripod, a black or blurred disc, or nothing, under the cameras of pictures (B, H, W, 3) and labels."""
    rows, columns = label.shape[1:]
    down = ((torch.arange(rows, device=light.device).flip(0) + 0.5) / rows * math.pi)[None, :, None]
    turn = ((torch.arange(columns, device=light.device) + 0.5) / columns * 2 * math.pi)[None, None]
    phase, kind = chance.uniform(0, 2 * math.pi, 5), chance.uniform(0, 1)
    wobble = sum(torch.sin(turn * k + _wide(phase[:, k], 2)) * _wide(chance.uniform(0, 1), 2) / k for k in range(1, 5))
    wide = torch.deg2rad(torch.where(kind < 0.8, chance.uniform(3, 9), chance.uniform(9, 24)))
    where = down < _wide(wide, 2) * (1 + 0.15 * wobble)
    legs = torch.tensor([0, 3, 3, 4], device=light.device)[chance.uniform(0, 4).long().clamp(max=3)]
    spread_m, thick = chance.uniform(0.2, 0.6), chance.uniform(0.012, 0.035)
    for k in range(4):
        toward = _wide(phase[:, 0] + k * 2 * math.pi / legs.clamp(min=1), 2)
        away = ((turn - toward + math.pi) % (2 * math.pi) - math.pi).abs()
        from_axis = torch.tan(down.clamp(max=1.2)) * torch.sin(away.clamp(max=1.5))
        leg = (away < 1.5) & (from_axis < _wide(thick, 2)) & (down < _wide(torch.atan(spread_m / eye_m), 2))
        where = where | (leg & _wide(k < legs, 2))
    where = where & _wide(kind >= 0.3, 2)
    below = light[:, -rows // 8 :].mean(dim=(1, 2))
    tone_kind = _wide(chance.uniform(0, 1), 1)
    odd = (_wide(chance.uniform(0, 2), 1) * (1 + 0.4 * chance.normal(3))).abs()
    tone = (
        torch.where(
            tone_kind < 0.6,
            _wide(chance.uniform(0, 0.25), 1),
            torch.where(tone_kind < 0.8, _wide(chance.uniform(0.6, 1.4), 1), odd),
        )
        * below
    )
    waves = _wide(chance.uniform(1, 7).floor(), 2)
    shade = 1 + _wide(chance.uniform(0, 0.5), 2) * torch.sin(turn * waves + _wide(phase[:, 1], 2))
    foot = tone[:, None, None] * shade.clamp(min=0)[..., None]
    named = torch.where(where, torch.full_like(label, SceneClass.TRIPOD), label)
    return torch.where(where[..., None], foot.expand_as(light), light), named


def blurred(picture: Tensor, sigma_px: float) -> Tensor:
    """Return pictures (B, H, W, C) blurred by a Gaussian, round the seam."""
    reach = max(1, math.ceil(2.5 * sigma_px))
    line = torch.arange(-reach, reach + 1, device=picture.device, dtype=picture.dtype)
    kernel = torch.exp(-0.5 * (line / sigma_px) ** 2)
    kernel = kernel / kernel.sum()
    count = picture.shape[3]
    x = picture.permute(0, 3, 1, 2)
    x = torch.cat([x[..., -reach:], x, x[..., :reach]], dim=-1)
    x = functional.conv2d(x, kernel.view(1, 1, 1, -1).expand(count, 1, 1, -1), groups=count)
    x = functional.pad(x, (0, 0, reach, reach), mode="replicate")
    x = functional.conv2d(x, kernel.view(1, 1, -1, 1).expand(count, 1, -1, 1), groups=count)
    return x.permute(0, 2, 3, 1)


def photographed(light: Tensor, chance: Chance) -> Tensor:
    """Return the network's view (B, H, W, 3) of linear light, most often by way of an eight-bit picture."""
    warm = torch.tensor([1.0, 0.2, -1.2], device=light.device)
    cast = torch.exp(0.12 * chance.normal(3) * torch.tensor([1.0, 0.4, 1.0], device=light.device))
    lamps = torch.exp(_wide(chance.uniform(0.1, 0.45), 1) * warm)
    cast = torch.where(_wide(chance.yes(0.3), 1), cast * lamps, cast)
    shown = light.clamp(min=0) * cast[:, None, None]
    codes = _developed(shown, chance)
    soft = blurred(codes, 0.45 + 0.8 * float(chance.uniform(0, 1)[0]))
    codes = torch.where(_wide(chance.yes(0.35), 3), soft, blurred(codes, 0.4))
    codes = codes + chance.normal(*codes.shape[1:]) * _wide(chance.uniform(0, 0.03), 3)
    codes = (codes * 255).round().clamp(0, 255) / 255
    linear = torch.where(codes <= 0.04045, codes / 12.92, ((codes + 0.055) / 1.055) ** 2.4)
    raw = blurred(shown, 0.4) * (1 + 0.02 * chance.normal(*shown.shape[1:])).clamp(min=0)
    return network_view(torch.where(_wide(chance.yes(0.2), 3), raw, linear))


def _developed(light: Tensor, chance: Chance) -> Tensor:
    """Return display values 0..1."""
    # What tone-mapped real-estate pictures look like: large differences are flattened.
    small = functional.avg_pool2d(torch.log(light.mean(dim=3) + 1e-4)[:, None], 8)
    wide = blurred(small.permute(0, 2, 3, 1), 0.5 + 4.5 * float(chance.uniform(0, 1)[0])).permute(0, 3, 1, 2)
    wide = functional.interpolate(wide, scale_factor=8.0, mode="bilinear", align_corners=False)[:, 0]
    wide = wide - wide.mean(dim=(1, 2), keepdim=True)
    share = torch.where(chance.yes(0.35), chance.uniform(0.2, 0.75), 0.0)
    light = light * torch.exp(-_wide(share, 2) * wide)[..., None]
    middle = light.mean(dim=3).flatten(1)[:, ::7].median(dim=1).values + 1e-6
    exposed = light * _wide(0.22 / middle * 2.0 ** (0.1 + 0.75 * chance.normal()), 3)
    knee = exposed * (1 + exposed / 9) / (1 + exposed * _wide(chance.uniform(0.2, 0.8), 3))
    exposed = torch.where(_wide(chance.yes(0.5), 3), knee, exposed)
    encoded = exposed.clamp(1e-6, 1) ** _wide(1 / chance.uniform(1.9, 2.6), 3)
    contrast = _wide(0.25 * chance.normal(), 3)
    encoded = encoded + contrast * (encoded * encoded * (3 - 2 * encoded) - encoded)
    grey = encoded.mean(dim=3, keepdim=True)
    return (grey + (encoded - grey) * _wide(chance.uniform(0.6, 1.9), 3)).clamp(0, 1)


def network_view(light: Tensor) -> Tensor:
    """Return what `network_picture` shows of linear light (B, H, W, 3) of the network's own size."""
    few = light[:, 1::2, 1::2] @ torch.tensor(LUMINANCE_WEIGHTS, device=light.device, dtype=light.dtype)
    rows = few.shape[1]
    latitude = (0.5 - (torch.arange(rows, device=light.device) + 0.5) / rows) * math.pi
    weight = torch.cos(latitude)[None, :, None].expand_as(few) * (few > 0)
    order = few.flatten(1).argsort(dim=1)
    total = weight.flatten(1).gather(1, order).cumsum(dim=1)
    at = torch.searchsorted(total, total[:, -1:] / 2).clamp(max=total.shape[1] - 1)
    median = few.flatten(1).gather(1, order.gather(1, at)).clamp(min=1e-9)
    scaled = (light * _wide(MIDDLE / median[:, 0], 3)).clamp(0, BRIGHTEST)
    return torch.sqrt(scaled / (scaled + KNEE))
