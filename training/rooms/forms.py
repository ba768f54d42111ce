"""Furniture of chance form: made beds, wardrobes, shelves full of things, blocks, heaps, and what lies on tables."""

from __future__ import annotations

import numpy as np

from processing.ground.arrays import Doubles, Floats
from processing.ground.mesh import grid_faces
from processing.segmentation.evidence import SceneClass
from training.rooms.pieces import Piece, joined
from training.rooms.soup import WORLD, Soup

Vec = tuple[float, float, float]


class _Maker:
    """A piece in the making: boxes and lumps, each with a paint."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng, self.soup = rng, Soup()
        self.colours: list[Vec] = []

    def paint(self, kind: str = "furniture") -> int:
        r, g, b = self.rng.uniform(0.03, 0.8, 3)
        self.colours.append((float(r), float(g), float(b)))
        return self.soup.paint(kind)

    def box(self, low: Vec, high: Vec, paint: int) -> None:
        self.soup.box(WORLD, low, high, SceneClass.FURNITURE, paint)

    def lump(self, at: Vec, size: Vec, paint: int, *, square: float = 0.5) -> None:
        """Add a rounded body: a superellipsoid, from a box (``square`` near 0) to a ball (1)."""
        v, u = np.meshgrid(np.linspace(-np.pi / 2, np.pi / 2, 7), np.linspace(0, 2 * np.pi, 11), indexing="ij")

        def eased(values: Doubles) -> Doubles:
            return np.asarray(np.sign(values) * np.abs(values) ** square)

        x = eased(np.cos(v)) * eased(np.cos(u)) * size[0] / 2
        y = eased(np.cos(v)) * eased(np.sin(u)) * size[1] / 2
        z = eased(np.sin(v)) * size[2] / 2
        self.sheet(np.stack([x, y, z], axis=-1) + np.array(at), paint)

    def sheet(self, grid: Doubles, paint: int) -> None:
        """Add a surface through points (N, M, 3)."""
        self.soup.add(grid.reshape(-1, 3)[grid_faces(*grid.shape[:2])], SceneClass.FURNITURE, paint)

    def piece(self, kind: str, size: Vec) -> Piece:
        triangles, _, paint_of = self.soup.joined()
        names = tuple(p.kind for p in self.soup.paints)
        return Piece(kind, size, triangles, paint_of, tuple(self.colours), names)


def _vec(values: Doubles) -> Vec:
    return float(values[0]), float(values[1]), float(values[2])


def draw_form(rng: np.random.Generator) -> Piece:
    """Return a piece of chance form."""
    made = (bed, bed, wardrobe, wardrobe, shelf, couch, block, heap)
    return made[int(rng.integers(len(made)))](rng)


def bed(rng: np.random.Generator) -> Piece:
    """Return a bed with a quilt, flat or rumpled, hanging over its sides, and pillows."""
    make = _Maker(rng)
    w, d, h = (float(rng.uniform(*span)) for span in ((0.85, 2.0), (1.85, 2.25), (0.35, 0.65)))
    frame, sheet, quilt = make.paint(), make.paint("linen"), make.paint("quilt")
    make.box((-w / 2, -d / 2, 0.02 + h * 0.3 * (rng.random() < 0.5)), (w / 2, d / 2, h * 0.55), frame)
    make.box((-w / 2, -d / 2, h * 0.55), (w / 2, d / 2, h), sheet)
    if rng.random() < 0.8:
        tall = float(rng.uniform(0.2, 0.8))
        make.box((-w / 2 - 0.04, d / 2, 0.0), (w / 2 + 0.04, d / 2 + 0.07, h + tall), frame)
    if rng.random() < 0.25:
        make.box((-w / 2, -d / 2 - 0.06, 0.0), (w / 2, -d / 2, h + float(rng.uniform(0.0, 0.3))), frame)
    if rng.random() < 0.92:
        _quilt(make, (w, d, h), quilt)
        if rng.random() < 0.35:
            _quilt(make, (w, d * float(rng.uniform(0.3, 0.7)), h + 0.03), make.paint("quilt"))
    for x in (-w / 4, w / 4) if w > 1.2 else (0.0,):
        pillow = make.paint("linen")
        for k in range(int(rng.integers(0, 3))):
            size = (min(w * 0.45, 0.7), float(rng.uniform(0.3, 0.45)), float(rng.uniform(0.1, 0.18)))
            make.lump((x, d / 2 - 0.25 - 0.1 * k, h + 0.09 + 0.11 * k), size, pillow, square=0.6)
    return make.piece("bed", (w + 0.1, d + 0.15, h + 0.5))


def _quilt(make: _Maker, size: Vec, paint: int) -> None:
    """Lay a cloth over the lower part of a bed."""
    w, d, h = size
    rng = make.rng
    drop = float(rng.uniform(0.05, h - 0.05))
    top = float(rng.uniform(0.0, 0.35)) * d
    across = np.concatenate(
        [[-w / 2 - 0.05, -w / 2 - 0.03], np.linspace(-w / 2, w / 2, 11), [w / 2 + 0.03, w / 2 + 0.05]]
    )
    along = np.concatenate([[-d / 2 - 0.05, -d / 2 - 0.03], np.linspace(-d / 2, d / 2 - top, 11)])
    x, y = np.meshgrid(across, along, indexing="ij")
    z = np.full_like(x, h + 0.03)
    rumple = float(rng.choice([0.004, 0.02, 0.05]))
    z += np.abs(rng.normal(0, rumple, z.shape)) + rumple * np.sin(5 * x + rng.uniform(0, 6)) * np.sin(4 * y)
    over = (np.abs(x) > w / 2 + 0.04) | (y < -d / 2 - 0.04)
    z[over] = h - drop + rng.normal(0, 0.02, int(over.sum()))
    make.sheet(np.stack([x, y, np.maximum(z, 0.01)], axis=-1), paint)


def wardrobe(rng: np.random.Generator) -> Piece:
    """Return a cupboard with leaves or drawers, from a chest to one that reaches the ceiling."""
    make = _Maker(rng)
    w, d, h = (float(rng.uniform(*span)) for span in ((0.5, 2.6), (0.35, 0.68), (0.7, 2.45)))
    body, leaf, line = make.paint(), make.paint(), make.paint("gap")
    if rng.random() < 0.6:
        leaf = body
    plinth = float(rng.choice([0.0, 0.06, 0.12]))
    make.box((-w / 2, -d / 2, plinth), (w / 2, d / 2, h), body)
    if plinth and rng.random() < 0.5:
        make.box((-w / 2 + 0.03, -d / 2 + 0.05, 0.0), (w / 2 - 0.03, d / 2, plinth), line)
    if rng.random() < 0.4:
        make.box((-w / 2 - 0.04, -d / 2 - 0.04, h), (w / 2 + 0.04, d / 2, h + 0.06), body)
    columns = max(1, round(w / float(rng.uniform(0.35, 0.9))))
    rows = 1 if h > 1.3 and rng.random() < 0.7 else max(1, round(h / float(rng.uniform(0.2, 0.6))))
    handle, front = make.paint("metal"), -d / 2
    raised = float(rng.choice([0.012, 0.02]))
    for i in range(columns):
        for k in range(rows):
            x0, x1 = -w / 2 + w * i / columns + 0.012, -w / 2 + w * (i + 1) / columns - 0.012
            z0, z1 = plinth + (h - plinth) * k / rows + 0.012, plinth + (h - plinth) * (k + 1) / rows - 0.012
            make.box((x0, front - raised, z0), (x1, front, z1), leaf)
            at = x1 - 0.06 if i % 2 == 0 else x0 + 0.04
            middle = (z0 + z1) / 2
            make.box((at, front - raised - 0.03, middle - 0.05), (at + 0.02, front - raised, middle + 0.05), handle)
            if rng.random() < 0.2:
                inner = (x0 + 0.1 * (x1 - x0), x1 - 0.1 * (x1 - x0), z0 + 0.1 * (z1 - z0), z1 - 0.1 * (z1 - z0))
                make.box(
                    (inner[0], front - raised - 0.006, inner[2]), (inner[1], front - raised, inner[3]), make.paint()
                )
    return make.piece("wardrobe", (w + 0.02, d + 0.1, h))


def shelf(rng: np.random.Generator) -> Piece:
    """Return an open shelf with books and things."""
    make = _Maker(rng)
    w, d, h = (float(rng.uniform(*span)) for span in ((0.4, 1.8), (0.22, 0.45), (0.5, 2.2)))
    body, rows = make.paint(), max(1, round(h / float(rng.uniform(0.28, 0.5))))
    for x in (-w / 2, w / 2 - 0.025):
        make.box((x, -d / 2, 0.0), (x + 0.025, d / 2, h), body)
    if rng.random() < 0.75:
        make.box((-w / 2, d / 2 - 0.012, 0.0), (w / 2, d / 2, h), body)
    things = [make.paint() for _ in range(5)]
    for k in range(rows + 1):
        z = min(0.05 + (h - 0.07) * k / rows, h - 0.02)
        make.box((-w / 2, -d / 2, z), (w / 2, d / 2, z + 0.02), body)
        x, room = -w / 2 + 0.04, (h - 0.07) / rows - 0.03
        while x < w / 2 - 0.1 and k < rows:
            wide = float(rng.uniform(0.03, 0.3))
            if rng.random() < 0.75:
                high = room * float(rng.uniform(0.4, 1.0))
                x1 = min(x + wide, w / 2 - 0.04)
                deep = float(rng.uniform(0.3, 0.9)) * d
                make.box(
                    (x, -d / 2 + 0.02, z + 0.02), (x1, -d / 2 + 0.02 + deep, z + 0.02 + high), int(rng.choice(things))
                )
            x += wide + 0.005
    return make.piece("bookshelf", (w, d, h))


def couch(rng: np.random.Generator) -> Piece:
    """Return a sofa or armchair with soft bodies."""
    make = _Maker(rng)
    w, d = float(rng.uniform(0.7, 2.6)), float(rng.uniform(0.7, 1.05))
    seat, back = float(rng.uniform(0.35, 0.48)), float(rng.uniform(0.65, 1.0))
    cloth, soft, square = make.paint("quilt"), make.paint("quilt"), float(rng.uniform(0.15, 0.5))
    if rng.random() < 0.6:
        soft = cloth
    arm = float(rng.uniform(0.1, 0.3))
    make.box((-w / 2, -d / 2, 0.08), (w / 2, d / 2, seat - 0.12), cloth)
    make.lump((0, d / 2 - 0.12, (back + 0.1) / 2), (w, 0.26, back - 0.1), cloth, square=square)
    for x in (-w / 2 + arm / 2, w / 2 - arm / 2):
        make.lump((x, 0.0, 0.33), (arm, d, 0.55), cloth, square=square)
    count = max(1, round((w - 2 * arm) / 0.65))
    for k in range(count):
        wide = (w - 2 * arm) / count
        x = -w / 2 + arm + wide * (k + 0.5)
        make.lump((x, -0.08, seat - 0.06), (wide, d - 0.22, 0.2), soft, square=square)
        make.lump((x, d / 2 - 0.28, seat + 0.22), (wide, 0.22, 0.42), soft, square=square)
        if rng.random() < 0.35:
            make.lump((x, 0.02, seat + 0.16), (0.42, 0.2, 0.36), make.paint("quilt"), square=0.6)
    return make.piece("sofa" if w > 1.2 else "armchair", (w, d, back))


def block(rng: np.random.Generator) -> Piece:
    """Return a table or box of chance proportions."""
    make = _Maker(rng)
    w, d, h = (float(rng.uniform(*span)) for span in ((0.25, 1.8), (0.25, 0.9), (0.25, 1.6)))
    a, b = make.paint(), make.paint()
    if rng.random() < 0.6:
        leg, top = float(rng.uniform(0.03, 0.08)), float(rng.uniform(0.02, 0.1))
        h = min(h, 1.0)
        make.box((-w / 2, -d / 2, h - top), (w / 2, d / 2, h), a)
        for x in (-w / 2, w / 2 - leg):
            for y in (-d / 2, d / 2 - leg):
                make.box((x, y, 0.0), (x + leg, y + leg, h - top), b)
        return laden(rng, make.piece("dining table", (w, d, h)))
    foot = float(rng.choice([0.0, 0.12]))
    make.box((-w / 2, -d / 2, foot), (w / 2, d / 2, h), a)
    if foot:
        make.box((-w / 2.2, -d / 2.4, 0.0), (w / 2.2, d / 2.4, foot), b)
    return laden(rng, make.piece("box", (w, d, h)))


def heap(rng: np.random.Generator) -> Piece:
    """Return bags, boxes, balls and clothes on the floor."""
    make = _Maker(rng)
    reach = float(rng.uniform(0.15, 0.6))
    for _ in range(int(rng.integers(1, 7))):
        size = _vec(rng.uniform(0.1, 0.5, 3) * reach / 0.4)
        x, y = rng.uniform(-reach, reach, 2)
        paint = make.paint("quilt" if rng.random() < 0.5 else "furniture")
        make.lump((float(x), float(y), size[2] / 2), size, paint, square=float(rng.uniform(0.1, 1.2)))
    return make.piece("heap", (2.2 * reach, 2.2 * reach, 0.5))


def laden(rng: np.random.Generator, piece: Piece, small: list[Piece] | None = None) -> Piece:
    """Return a piece with a flat top and things on it."""
    w, d, h = piece.size_m
    make, count = _Maker(rng), int(rng.choice([0, 1, 2, 4, 8]))
    if not count:
        return piece
    on: list[tuple[Piece, Floats]] = []
    for _ in range(count):
        x, y = rng.uniform(-0.42, 0.42, 2) * (w, d)
        if small and rng.random() < 0.35:
            one = small[int(rng.integers(len(small)))]
            if one.size_m[0] < w and one.size_m[1] < d * 1.1:
                on.append((one, np.array([x * 0.5, y * 0.5, h], np.float32)))
                continue
        size = _vec(np.exp(rng.uniform(-3, -1.1, 3)))
        make.lump((float(x), float(y), h + size[2] / 2), size, make.paint(), square=float(rng.choice([0.05, 0.4, 1.0])))
    if make.colours:
        on.append((make.piece("things", (w, d, 0.3)), np.zeros(3, np.float32)))
    return joined(piece.kind, piece.size_m, [(piece, np.zeros(3, np.float32)), *on])
