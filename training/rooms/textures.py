"""A bank of relative textures (mean 1) for any surface, made once from the patterns of `mocks.rooms` and a few more."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from mocks.rooms.finish import draw_finish
from mocks.rooms.materials import picture_material
from mocks.rooms.model import Material, Use
from mocks.rooms.textures.catalogue import tile
from processing.ground.arrays import Floats

SIDE = 128
LEVELS = (128, 64, 32, 16, 8, 4)
GROUPS = ("floor", "wall", "rug", "wood", "cloth", "picture", "plain")


@dataclass(frozen=True)
class Tile:
    """Relative albedo at falling sizes (each side x side x 3), for a square of ``size_m``."""

    group: str
    size_m: tuple[float, float]
    levels: tuple[Floats, ...]

    def at(self, uv_m: Floats, footprint_m: Floats) -> Floats:
        """Return values (N, 3) at places in metres, at the coarseness of their footprint."""
        finest = self.size_m[0] / SIDE
        level = np.clip(np.ceil(np.log2(np.maximum(footprint_m / finest, 1))), 0, len(LEVELS) - 1).astype(int)
        out = np.empty((len(uv_m), 3), np.float32)
        for one in np.unique(level):
            mine = np.flatnonzero(level == one)
            side = LEVELS[one]
            x = (uv_m[mine, 0] / self.size_m[0] % 1.0 * side).astype(np.intp) % side
            y = (uv_m[mine, 1] / self.size_m[1] % 1.0 * side).astype(np.intp) % side
            out[mine] = self.levels[one][y, x]
        return out


def _made(group: str, albedo: Floats, size_m: tuple[float, float]) -> Tile:
    fine = cv2.resize(albedo, (SIDE, SIDE), interpolation=cv2.INTER_AREA)
    fine = fine / np.maximum(fine.mean(axis=(0, 1)), 0.02)
    levels = tuple(cv2.resize(fine, (s, s), interpolation=cv2.INTER_AREA).astype(np.float32) for s in LEVELS)
    return Tile(group, size_m, levels)


def make_bank(count: int = 60, seed: int = 5) -> list[Tile]:
    """Return textures: those of ``count`` drawn finishes, and stripes, checks and noise."""
    found: list[Tile] = []
    uses = list(Use)
    for k in range(count):
        rng = np.random.default_rng([seed, k])
        finish = draw_finish(rng, uses[k % len(uses)])
        chosen: list[tuple[str, Material]] = [("floor", finish.floor)]
        if k % 3 == 0:
            chosen += [("rug", finish.rug), ("picture", picture_material(rng)), ("cloth", finish.bedding)]
        if k % 4 == 0:
            chosen += [("wood", finish.wood), ("cloth", finish.fabric), ("wall", finish.accent_wall)]
        for group, material in chosen:
            if material.texture is not None:
                made = tile(material.texture)
                found.append(_made(group, np.asarray(made.albedo, np.float32), made.size_m))
    return found + [plain_tile(np.random.default_rng([seed, 999, k])) for k in range(40)]


def plain_tile(rng: np.random.Generator) -> Tile:
    """Return stripes, checks or noise in two tones."""
    y, x = np.mgrid[0:SIDE, 0:SIDE] / SIDE
    kind, n = rng.integers(4), int(rng.integers(2, 9))
    if kind == 0:
        pattern = (x * n % 1 < rng.uniform(0.2, 0.8)).astype(np.float32)
    elif kind == 1:
        pattern = ((np.floor(x * n) + np.floor(y * n)) % 2).astype(np.float32)
    else:
        noise = cv2.GaussianBlur(np.tile(rng.normal(size=(SIDE, SIDE)), (2, 2)), (0, 0), rng.uniform(0.6, 6))
        noise = noise[SIDE // 2 : SIDE // 2 + SIDE, SIDE // 2 : SIDE // 2 + SIDE]
        pattern = noise / noise.std() * 0.3 + 0.5
    a, b = rng.uniform(0.3, 1.0, 3), rng.uniform(0.3, 1.0, 3)
    tone = a + np.clip(pattern, 0, 1)[..., None] * (b - a) * rng.uniform(0.3, 1.0)
    size = float(rng.uniform(0.4, 2.0))
    return _made("plain", tone.astype(np.float32), (size, size))


def saved_bank(path: Path) -> list[Tile]:
    """Return the bank kept in a file, made first if it is not there."""
    if not path.exists():
        bank = make_bank()
        sizes = np.array([t.size_m for t in bank])
        fine = np.stack([t.levels[0] for t in bank]).astype(np.float16)
        np.savez(path, size_m=sizes, fine=fine, group=np.array([t.group for t in bank]))
    kept = np.load(path)
    return [
        _made(str(group), fine.astype(np.float32), (float(size[0]), float(size[1])))
        for group, fine, size in zip(kept["group"], kept["fine"], kept["size_m"], strict=True)
    ]
