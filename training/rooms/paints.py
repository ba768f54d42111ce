"""Coats of surfaces: a bank of relative textures (mean 1), most from `mocks.rooms`, and the colours of each paint."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from mocks.rooms.finish import draw_finish
from mocks.rooms.model import Texture, Use
from mocks.rooms.textures.catalogue import tile
from processing.ground.arrays import Doubles, Floats, Int32s
from training.rooms.pictures import draw_picture, picture_tile
from training.rooms.soup import Paint

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
        chosen: list[tuple[str, Texture | None]] = [("floor", finish.floor.texture)]
        if k % 3 == 0:
            chosen += [("rug", finish.rug.texture), ("picture", draw_picture(rng)), ("cloth", finish.bedding.texture)]
        if k % 4 == 0:
            chosen += [("wood", finish.wood.texture), ("cloth", finish.fabric.texture)]
            chosen += [("wall", finish.accent_wall.texture)]
        for group, texture in chosen:
            if texture is not None:
                made = picture_tile(texture) if group == "picture" else tile(texture)
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


def bank_of(views: Path) -> list[Tile]:
    """Return the bank kept beside a folder of views, made first if it is not there."""
    path = views.parent / "bank.npz"
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


_WOODS = np.array(
    [
        (0.38, 0.245, 0.135),
        (0.19, 0.12, 0.07),
        (0.30, 0.12, 0.05),
        (0.52, 0.345, 0.175),
        (0.33, 0.27, 0.2),
        (0.50, 0.23, 0.06),
        (0.26, 0.06, 0.02),
        (0.42, 0.16, 0.05),
        (0.10, 0.05, 0.03),
    ]
)
OTHER = "other "
"""Before the kind of a paint of a room beyond, where that is not this room's own."""
_WHITE = (
    "ceiling",
    "trim",
    "window frame",
    "radiator",
    "door",
    "blind",
    "board",
    "fitted",
    "hallway",
    "sheer",
    "frosted",
)
_DARK = ("gap", "dark", "metal")
_COATED = ("furniture", "quilt", "linen", "fixture", "curtain", "rug", "frame")
_GROUP = {
    "floor": "floor",
    "rug": "rug",
    "picture": "picture",
    "wood door": "wood",
    "curtain": "cloth",
    "quilt": "",
    "linen": "",
    "ceiling": "plain",
    "accent wall": "wall",
    "wall": "wall",
    "fitted": "wood",
    "furniture": "",
    "fixture": "",
    "worktop": "plain",
    "splash": "plain",
}
_TEXTURED = {
    "floor": 0.85,
    "rug": 0.9,
    "picture": 0.95,
    "wood door": 0.5,
    "curtain": 0.35,
    "wall": 0.12,
    "accent wall": 0.4,
    "quilt": 0.65,
    "linen": 0.3,
    "ceiling": 0.06,
    "fitted": 0.4,
    "furniture": 0.28,
    "fixture": 0.1,
    "worktop": 0.4,
    "splash": 0.6,
}


_MIXED = (("cloth", "rug", "plain", "picture"), ("cloth", "wood", "plain"))
"""Groups of textures for cloth, and for furniture."""


@dataclass(frozen=True)
class Coats:
    """What each paint (m) looks like in one picture."""

    albedo: Floats
    tile: Int32s
    """Number of its texture, -1 for none."""
    scale: Floats
    turn: Floats
    contrast: Floats
    gloss: Floats
    """Share of mirrored light at right angles, 0 for matte."""
    emission: Floats


def draw_coats(rng: np.random.Generator, paints: list[Paint], bank: list[Tile]) -> Coats:
    """Return the coats of one look; what is proposed in a paint is kept in some looks."""
    count = len(paints)
    keep = rng.random() < 0.45
    room = {kind: _albedo(rng, kind.removeprefix(OTHER)) for kind in sorted({p.kind for p in paints})}
    groups = {g: [k for k, t in enumerate(bank) if t.group == g] for g in sorted({t.group for t in bank})}
    albedo, tile = np.empty((count, 3)), np.full(count, -1, np.int32)
    one_tile: dict[str, int] = {}
    palette = [_albedo(rng, "furniture") for _ in range(3)] + [_wood(rng)]
    matched = float(rng.choice([0.0, 0.6, 0.95]))
    for number, paint in enumerate(paints):
        single = paint.kind in ("furniture", "quilt", "linen", "fixture", "picture", "frame", "rug")
        drawn = _albedo(rng, paint.kind) if single else room[paint.kind]
        if paint.kind in ("furniture", "quilt") and rng.random() < matched:
            # Furniture of one home is of few colours.
            drawn = palette[int(rng.integers(len(palette)))] * np.exp(rng.normal(0, 0.2))
        if single and paint.kind != "frame" and rng.random() < 0.06 and "floor" in room:
            # Spreads, rugs and wood in the floor's own colour.
            drawn = room["floor"] * np.exp(rng.normal(0, 0.12))
        albedo[number] = paint.rgb if keep and paint.rgb is not None else drawn
        kind = paint.kind.removeprefix(OTHER)
        if rng.random() < _TEXTURED.get(kind, 0.0):
            among = groups.get(_GROUP.get(kind, "") or str(rng.choice(_MIXED[kind == "furniture"])), [])
            if among:
                chosen = int(rng.choice(among))
                tile[number] = chosen if single else one_tile.setdefault(paint.kind, chosen)
    gloss = np.where(rng.random(count) < 0.25, rng.uniform(0.02, 0.2, count), 0.0)
    floor_gloss = rng.uniform(0.02, 0.25) if rng.random() < 0.5 else 0.0
    gloss[[p.kind == "floor" for p in paints]] = floor_gloss
    gloss[[p.kind in ("wall", "accent wall", "ceiling") for p in paints]] = 0.0
    return Coats(
        albedo=np.clip(albedo, 0.015, 0.92).astype(np.float32),
        tile=tile,
        scale=np.exp(rng.normal(0, 0.35, count)).astype(np.float32),
        turn=np.where(rng.random(count) < 0.7, 0.0, rng.uniform(0, 1.57, count)).astype(np.float32),
        contrast=rng.uniform(0.4, 1.3, count).astype(np.float32),
        gloss=gloss.astype(np.float32),
        emission=np.array([p.emission for p in paints], np.float32),
    )


def _tinted(rng: np.random.Generator, level: float, saturation: float) -> Doubles:
    """Return an albedo of a mean level and a chance hue."""
    # Homes are mostly warm: half of the hues lie about orange.
    hue = rng.normal(0.6, 0.5) if rng.random() < 0.5 else rng.uniform(0, 2 * np.pi)
    tint = 1 + saturation * np.cos(hue - np.array([0.0, 2.094, 4.189]))
    return np.asarray(level * tint / tint.mean(), dtype=np.float64)


def _wood(rng: np.random.Generator) -> Doubles:
    wood = _WOODS[rng.integers(len(_WOODS))]
    # Varnish makes it redder and deeper.
    return np.asarray(wood ** rng.uniform(0.9, 1.35) * np.exp(rng.normal(0, 0.35)) * np.exp(rng.normal(0, 0.06, 3)))


def _albedo(rng: np.random.Generator, kind: str) -> Doubles:
    chance = rng.random()
    if kind == "floor":
        return _wood(rng) if chance < 0.55 else _tinted(rng, np.exp(rng.uniform(-3, -0.4)), rng.uniform(0, 0.35))
    if kind in ("wall", "accent wall"):
        strong = kind == "accent wall" or chance < 0.3
        if not strong:
            pale = _tinted(rng, rng.uniform(0.45, 0.86), rng.uniform(0, 0.08))
            return np.asarray(pale * np.array([1.05, 1.0, 0.92]), dtype=np.float64)
        return _tinted(rng, np.exp(rng.uniform(-2.3, -0.3)), rng.uniform(0.05, 0.8))
    if kind == "wood door" or (kind == "fitted" and chance < 0.5):
        return _wood(rng)
    if kind in _COATED:
        return _of_furniture(rng, kind, chance)
    if kind in _DARK:
        return _tinted(rng, rng.uniform(0.015, 0.08), 0.05)
    if kind in _WHITE:
        rare = chance < (0.12 if kind == "ceiling" else 0.25)
        return _tinted(rng, rng.uniform(0.1, 0.6) if rare else rng.uniform(0.6, 0.9), 0.3 if rare else 0.04)
    return _tinted(rng, rng.uniform(0.1, 0.8), rng.uniform(0, 0.5))


def _of_furniture(rng: np.random.Generator, kind: str, chance: float) -> Doubles:
    if kind == "linen":
        return _tinted(rng, rng.uniform(0.35, 0.85), rng.uniform(0, 0.25) * rng.random())
    if chance < 0.2 and kind == "furniture":
        return _tinted(rng, rng.uniform(0.5, 0.88), 0.06)
    if chance < 0.5 and kind != "quilt":
        return _wood(rng)
    return _tinted(rng, np.exp(rng.uniform(-3.6, -0.25)), rng.uniform(0, 0.9) * rng.random())
