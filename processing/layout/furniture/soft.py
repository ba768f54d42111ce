"""Soft shapes: padded boxes, cushions with piping, pillows, covers that hang. All are closed and wind outward."""

import numpy as np

from processing.ground.arrays import Doubles
from processing.ground.mesh import band_faces, grid_faces, grid_rim
from processing.layout.furniture import solids
from processing.layout.furniture.solids import Solid, Spot


def pad(low: Spot, high: Spot, edge_m: float, puff_m: float | Spot, *, inner: int = 8, steps: int = 3) -> Solid:
    """Return a padded box: rounded edges, and faces that swell to reach the box by `puff_m` in their middles."""
    lo, hi = np.array(low, dtype=np.float64), np.array(high, dtype=np.float64)
    puff = np.minimum(np.broadcast_to(np.asarray(puff_m, dtype=np.float64), 3), 0.35 * (hi - lo) / 2)
    half = (hi - lo) / 2 - puff
    body = solids.cube_grid(half, float(min(edge_m, 0.95 * half.min())), steps, inner)
    q = body.vertices / half
    swell = 1 - np.clip(np.abs(q), 0, 1) ** 2.5
    out = np.stack([np.sign(q[:, k]) * np.abs(q[:, k]) ** 4 * swell[:, k - 1] * swell[:, k - 2] for k in range(3)], 1)
    return solids.solid(body.vertices + puff * out, body.faces).moved(*((lo + hi) / 2))


def wrinkled(body: Solid, amount_m: float, wave_m: float, seed: int) -> Solid:
    """Return a soft body with shallow creases."""
    rng = np.random.default_rng(seed)
    shift = np.zeros(len(body.vertices))
    for octave in range(4):
        for _ in range(3):
            wave = rng.normal(size=3)
            wave *= 2 * np.pi * 1.7**octave / (wave_m * max(float(np.linalg.norm(wave)), 1e-9))
            shift += 0.6**octave * np.sin(body.vertices @ wave + rng.uniform(0, 2 * np.pi))
    normals = np.zeros_like(body.vertices)
    corner = solids.corner_normals(body.vertices, body.faces, np.pi)
    np.add.at(normals, body.faces.ravel(), corner.reshape(-1, 3))
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    return Solid(body.vertices + normals * (amount_m / 2.5 * shift)[:, None], body.faces, body.rest)


def cushion(
    width_m: float,
    depth_m: float,
    thick_m: float,
    *,
    crown_m: float = 0.03,
    seed: int = 0,
    piping_m: float = 0.005,
    inner: int = 8,
) -> Solid:
    """Return a seat cushion, lying, its middle over the origin and its underside at z = 0, with piped seams."""
    w, d = width_m / 2, depth_m / 2
    edge = min(0.42 * thick_m, 0.06)
    body = pad((-w, -d, 0), (w, d, thick_m), edge, (0.012, 0.012, crown_m), inner=inner, steps=2)
    body = wrinkled(body, 0.0025, 0.35, seed)
    if piping_m <= 0:
        return body
    crown = min(crown_m, 0.35 * thick_m / 2)
    inset, radius = 0.012 + 0.29 * edge, 0.75 * edge
    ring = _dense(solids.rounded_rectangle(2 * (w - inset), 2 * (d - inset), radius, steps=4), 0.18)
    seams = [
        solids.tube(ring + np.array([0, 0, z]), piping_m, 5, closed=True)
        for z in (crown + 0.29 * edge, thick_m - crown - 0.29 * edge)
    ]
    return solids.joined([body, *seams])


def _dense(ring: Doubles, step_m: float) -> Doubles:
    """Return a closed line with points at least every step."""
    out = []
    for a, b in zip(ring, np.roll(ring, -1, axis=0), strict=True):
        count = max(1, int(np.ceil(np.linalg.norm(b - a) / step_m)))
        out.append(a + (b - a) * (np.arange(count) / count)[:, None])
    return np.concatenate(out)


def sheets(upper: Doubles, lower: Doubles) -> Solid:
    """Return the closed body between two (M, N, 3) sheets with a common rim; x grows with m, y with n."""
    m, n = upper.shape[:2]
    top, rim = grid_faces(m, n), grid_rim(m, n)
    faces = np.concatenate([top, top[:, ::-1] + m * n, band_faces(rim, rim + m * n)]).astype(np.int64)
    return solids.cleaned(np.concatenate([upper.reshape(-1, 3), lower.reshape(-1, 3)]), faces)


def pillow(width_m: float, height_m: float, thick_m: float, *, seed: int = 0, grid: int = 13) -> Solid:
    """Return a pillow lying around the origin, x its width, y its height: two sheets sewn at a rim with round corners.

    It is as full as down is, and fuller at -y, its foot where it stands.
    """
    s = np.sin(np.pi / 2 * np.linspace(-1, 1, grid))
    u, v = np.meshgrid(s, s, indexing="ij")
    corner = 1 - 0.1 * np.square(u * v)
    x = width_m / 2 * u * (1 - 0.04 * (1 - v**2) * np.abs(u) ** 3) * corner
    y = height_m / 2 * v * (1 - 0.04 * (1 - u**2) * np.abs(v) ** 3) * corner
    z = thick_m / 2 * np.sqrt((1 - u**4) * (1 - v**4)) * (1 - 0.15 * v)
    rng = np.random.default_rng(seed)
    for _ in range(5):
        k = rng.normal(size=2) * 2.5
        z = z * (1 + 0.045 * np.sin(k[0] * u * 2 + k[1] * v * 2 + rng.uniform(0, 6.28)))
    flat = np.stack([x, y, z], axis=-1)
    return sheets(flat, flat * np.array([1, 1, -0.85]))


FOLD_M = 0.05  # radius at which a cover turns down over an edge (chosen: a quilt's)


def hanging(
    width_m: float,
    length_m: float,
    drop_m: float,
    thick_m: float,
    *,
    seed: int = 0,
    foot_drop_m: float = 0.0,
    begin_m: float = 0.0,
    cells: tuple[int, int] = (40, 30),
) -> Solid:
    """Return a cover lying with its upper middle at z = 0 and hanging down both long sides (and the end at +y).

    x in [-width/2, width/2] over all; y from 0 to `length_m`. Covers of one seed that begin at different `begin_m` have
    the same folds, so that one lies on the other.
    """
    m, n = cells
    rng = np.random.default_rng(seed)
    flat, foot_flat = width_m / 2 - FOLD_M - 0.5 * thick_m, length_m
    reach = np.pi / 2 * FOLD_M + max(drop_m - FOLD_M, 0.0)
    foot_reach = np.pi / 2 * FOLD_M + max(foot_drop_m - FOLD_M, 0.0)
    far, rows = length_m, np.linspace(0, 1, n + 1)
    if foot_drop_m > 0:
        foot_flat -= FOLD_M + 0.5 * thick_m
        far = foot_flat + foot_reach
        rows = np.interp(rows, (0, 0.6, 0.85, 1), np.array((0, foot_flat, foot_flat + np.pi / 2 * FOLD_M, far)) / far)
    even = np.linspace(-1, 1, m + 1)
    s = (flat + reach) * np.sign(even) * (1 - (1 - np.abs(even)) ** 1.25)  # a little denser towards the ends
    gs, gt = np.meshgrid(s, far * rows, indexing="ij")
    # Round a corner of the bed both edges are turned down at once, and the hem stays level.
    aside, beyond = np.maximum(np.abs(gs) - flat, 0) / reach, np.maximum(gt - foot_flat, 0) / foot_reach
    turn = np.arctan2(beyond, aside)
    down = np.maximum(aside, beyond) * (reach * np.cos(turn) ** 2 + foot_reach * np.sin(turn) ** 2)
    out, z, hang = _over_edge(down)
    gx = np.sign(gs) * (np.minimum(np.abs(gs), flat) + out * np.cos(turn))
    gy = np.minimum(gt, foot_flat) + out * np.sin(turn)
    folded = np.clip(np.abs(gs) - flat, 0, None) / 0.2
    gs, gt = gs * 0.5 / (width_m / 2), gt + begin_m
    puff = np.zeros_like(gx)
    for octave in range(4):
        for _ in range(3):
            k = rng.normal(size=2) * 2 * np.pi / 0.75 * 1.6**octave
            puff += 0.0065 * 0.55**octave * np.sin(k[0] * gs + k[1] * gt + rng.uniform(0, 6.28))
    folds = 0.012 * np.sin(2 * np.pi * gt / 0.34 + 1.3 * np.sin(gt * 5)) * folded
    lift = np.stack([np.sign(gx) * hang * np.cos(turn), hang * np.sin(turn), 1 - 0.9 * hang], -1)
    lift /= np.linalg.norm(lift, axis=-1, keepdims=True)
    upper = np.stack([gx, gy, z], -1) + lift * (np.clip(puff + folds, -0.02, 0.02) - 0.02)[..., None]
    i, j = np.ogrid[: m + 1, : n + 1]
    rim = np.minimum(np.minimum(i, m - i), np.minimum(j, n - j))
    depth = thick_m * np.clip(rim / 2.0, 0, 1) ** 0.5
    mid = upper - lift * (thick_m / 2)
    return sheets(mid + lift * depth[..., None] / 2, mid - lift * depth[..., None] / 2)


def _over_edge(down: Doubles) -> tuple[Doubles, Doubles, Doubles]:
    """Return how far out and how high cloth is, and its steepness (0 to 1), so far along it beyond an edge (...), m."""
    bend = np.clip(down / FOLD_M, 0, np.pi / 2)
    height = -FOLD_M * (1 - np.cos(bend)) - np.clip(down - np.pi / 2 * FOLD_M, 0, None)
    return FOLD_M * np.sin(bend), height, np.sin(bend)
