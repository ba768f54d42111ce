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


PLUMP = 2.5
"""How full a pillow is: its half thickness is h sqrt(1 - s^PLUMP), s from 0 in its middle to 1 at its seam. The seam's
radius is PLUMP h^2 / (2 x its smaller half width): 3 to 5 cm for pillows of 0.12 to 0.2 m (chosen by looking)."""
SQUARE = 6.0  # of a pillow's rim as a superellipse: corners as round as cloth is when it is filled. Chosen by looking


def pillow(width_m: float, height_m: float, thick_m: float, *, seed: int = 0, rings: int = 8, around: int = 9) -> Solid:
    """Return a pillow lying around the origin, x its width, y its height: two plump sheets sewn at a rim.

    It is fuller at -y, its foot where it stands, its edges are drawn in between the corners, and cloth is gathered
    along its seam. ``rings``: from its middle to the rim; ``around``: cells of each of its four sides.
    """
    rng = np.random.default_rng(seed)
    t = np.sin(np.pi / 2 * np.linspace(-1, 1, around + 1))[:-1]  # denser towards the corners, which are round
    one = np.ones(around)
    u, v = np.concatenate([-t, -one, t, one]), np.concatenate([one, -t, -one, t])
    gauge = (np.abs(u) ** SQUARE + np.abs(v) ** SQUARE) ** (1 / SQUARE)
    drawn = 0.06 * (1 - np.minimum(np.abs(u), np.abs(v)) ** 2)  # of the way to the middle, between the corners
    x, y = (a / gauge * (1 - drawn) for a in (u, v))
    x, y = x / np.abs(x).max(), y / np.abs(y).max()
    s = np.sin(np.pi / 2 * np.linspace(0, 1, rings + 1)[1:])[:, None]
    angle = np.arctan2(y, x)
    corner = np.abs(np.sin(2 * np.arctan2(v, u))) ** 3
    # As round at its short sides as at its long ones, which are nearer to its middle.
    long = (width_m * np.cos(angle) ** 2 + height_m * np.sin(angle) ** 2) / min(width_m, height_m)
    full = np.sqrt(np.maximum(1 - s ** (PLUMP * long), 0)) * (1 - 0.3 * corner * s**3)  # less fills its corners
    lumps = sum(
        0.05 * np.sin(k[0] * 2 * s * x + k[1] * 2 * s * y + rng.uniform(0, 6.28)) for k in rng.normal(0, 1.6, (4, 2))
    )
    gather = (
        sum(rng.uniform(0.4, 1) * np.sin(k * angle + rng.uniform(0, 6.28)) for k in (9, 13, 17))
        * s**3
        * (0.05 + 0.07 * corner)
    )
    z = thick_m / 2 * full * (1 + lumps + gather) * (1 - 0.14 * s * y)
    back = thick_m / 2 * full * (0.92 + 0.5 * gather) * (1 - 0.14 * s * y)
    flat = np.stack([width_m / 2 * s * x, height_m / 2 * s * y], axis=-1)
    # A seam is 3 mm wide, and stands out from what it holds together.
    rim = np.concatenate([flat[-1:] * (1 + 0.006 / min(width_m, height_m)), flat[-1:]])
    edge = np.full((1, 4 * around), 0.0015)
    front = np.concatenate([np.zeros((1, 4 * around, 2)), flat[:-1], rim[1:], rim[:1]])
    heights = np.concatenate([np.full((1, 4 * around), thick_m / 2), z[:-1], edge, edge])
    depths = np.concatenate([np.full((1, 4 * around), -thick_m / 2 * 0.92), -back[:-1], -edge, -edge])
    heights[0], depths[0] = (heights[1].mean(), depths[1].mean())
    up = np.concatenate([front, heights[..., None]], axis=-1)
    down = np.concatenate([front, depths[..., None]], axis=-1)
    return solids.loft(np.concatenate([down, up[::-1]]))


FOLD_M = 0.05  # radius at which a cover turns down over an edge (chosen: a quilt's)
HEM = (0.0, 0.12, 0.45, 1.0)  # of half a cover's thickness: where its hem, which is round, is cut into cells
PLEAT_M, PLEAT_OUT_M = 0.26, 0.017
"""How far apart the folds of hanging cloth are, and how far they stand out at its hem. Chosen: a quilt's."""
RIM_M = 0.0015  # chosen: a hem's thickness at its very end, where its two sides meet
MOST_OUT_M = 0.024  # chosen: of all that is uneven in a cover, so that one lies on another, and above the mattress


def hanging(
    width_m: float,
    length_m: float,
    drop_m: float,
    thick_m: float,
    *,
    seed: int = 0,
    foot_drop_m: float = 0.0,
    begin_m: float = 0.0,
    cells: tuple[int, int] = (48, 40),
) -> Solid:
    """Return a cover lying with its upper middle at z = 0 and hanging down both long sides (and the end at +y).

    x in [-width/2, width/2] over all; y from 0 to `length_m`. Covers of one seed that begin at different `begin_m` have
    the same folds, so that one lies on the other. Its underside, which nobody sees, has a quarter of the cells.
    """
    flat, foot_flat = width_m / 2 - FOLD_M - 0.5 * thick_m, length_m
    reach = np.pi / 2 * FOLD_M + max(drop_m - FOLD_M, 0.0)
    foot_reach = np.pi / 2 * FOLD_M + max(foot_drop_m - FOLD_M, 0.0)
    far = length_m
    if foot_drop_m > 0:
        foot_flat -= FOLD_M + 0.5 * thick_m
        far = foot_flat + foot_reach
    hem = np.array(HEM) * thick_m / 2
    s = _cuts(-flat - reach, flat + reach, hem, cells[0], (-flat - FOLD_M, flat + FOLD_M))
    t = _cuts(0.0, far, hem, cells[1], (foot_flat + FOLD_M,) if foot_drop_m > 0 else ())
    gs, gt = np.meshgrid(s, t, indexing="ij")
    # Round a corner of the bed both edges are turned down at once, and the hem stays level.
    aside, beyond = np.maximum(np.abs(gs) - flat, 0) / reach, np.maximum(gt - foot_flat, 0) / foot_reach
    turn = np.arctan2(beyond, aside)
    down = np.maximum(aside, beyond) * (reach * np.cos(turn) ** 2 + foot_reach * np.sin(turn) ** 2)
    out, z, hang = _over_edge(down)
    gx = np.sign(gs) * (np.minimum(np.abs(gs), flat) + out * np.cos(turn))
    gy = np.minimum(gt, foot_flat) + out * np.sin(turn)
    uneven = _crumpled(gs * 0.5 / (width_m / 2), gt + begin_m, seed)
    # Hanging cloth has upright folds: the farther down, the deeper; those of the foot run along the width.
    along = (gt + begin_m) * np.cos(turn) ** 2 + gs * np.sin(turn) ** 2
    pleat = np.sin(2 * np.pi / PLEAT_M * (along + 0.05 * np.sin(5.1 * along + seed)) + 2 * np.sign(gs))
    uneven = uneven * (1 - 0.6 * hang) + PLEAT_OUT_M * (pleat + 0.25 * pleat**2) * np.clip(down / 0.2, 0, 1) ** 0.8
    lift = np.stack([np.sign(gx) * hang * np.cos(turn), hang * np.sin(turn), 1 - 0.9 * hang], -1)
    lift /= np.linalg.norm(lift, axis=-1, keepdims=True)
    most = MOST_OUT_M * (1 - 0.35 * hang)
    upper = np.stack([gx, gy, z], -1) + lift * (np.clip(uneven, -most, most) - most)[..., None]
    rim = np.minimum(*np.meshgrid(*(np.minimum(a - a[0], a[-1] - a) for a in (s, t)), indexing="ij"))
    depth = np.maximum(thick_m * np.sqrt(1 - (1 - np.clip(rim / (thick_m / 2), 0, 1)) ** 2), RIM_M)
    mid = upper - lift * (thick_m / 2)
    top, under = (mid + sign * lift * depth[..., None] / 2 for sign in (1, -1))
    return _lined(top, under[::2, ::2])


def _cuts(low: float, high: float, hem: Doubles, cells: int, edges: tuple[float, ...] = ()) -> Doubles:
    """Return `cells` + 1 places from low to high: a hem's at both ends, those between denser at folds over `edges`."""
    fine = np.linspace(low + hem[-1], high - hem[-1], 400)
    dense = 1 + 5.0 * sum(np.exp(-(((fine - edge) / 0.05) ** 2)) for edge in edges)
    total = np.cumsum(np.broadcast_to(dense, fine.shape))
    inner = np.interp(np.linspace(total[0], total[-1], cells - 2 * (len(hem) - 1) + 1)[1:-1], total, fine)
    return np.concatenate([low + hem, inner, high - hem[::-1]])


def _crumpled(x: Doubles, y: Doubles, seed: int) -> Doubles:
    """Return how uneven lying cloth is at places (...), m: down below it, then creases that cross, finer and finer."""
    rng = np.random.default_rng(seed)

    def waves(length_m: float, count: int) -> Doubles:
        total = np.zeros_like(x)
        for _ in range(count):
            way, phase = rng.uniform(0, 2 * np.pi), rng.uniform(0, 2 * np.pi)
            k = 2 * np.pi / (length_m * rng.uniform(0.75, 1.35))
            total += np.sin(k * (np.cos(way) * x + np.sin(way) * y) + phase)
        return np.asarray(total / np.sqrt(count))

    down, astray = waves(0.62, 4), 0.5 * waves(0.45, 3)
    found = 0.008 * down
    for length_m, high_m in ((0.30, 0.014), (0.16, 0.008)):
        for _ in range(3):  # a crease is narrow, bends, and is there in places only
            way, k = rng.uniform(0, np.pi), 2 * np.pi / length_m
            ridge = np.cos(k / 2 * (np.cos(way) * x + np.sin(way) * y) + astray + rng.uniform(0, 6.28)) ** 6
            found += high_m * ridge * np.clip(0.4 + 0.6 * waves(0.55, 3), 0, 1)
    return np.asarray(found - 0.006)


def _lined(top: Doubles, under: Doubles) -> Solid:
    """Return the closed body of a sheet (2 M - 1, 2 N - 1, 3) and a coarser one below it (M, N, 3), of one rim."""
    (m, n), (a, b) = top.shape[:2], under.shape[:2]
    faces, rim = [grid_faces(m, n), grid_faces(a, b)[:, ::-1] + m * n], grid_rim(m, n)
    low = grid_rim(a, b) + m * n
    first, half, last, this, that = rim[::2], rim[1::2], np.roll(rim[::2], -1), low, np.roll(low, -1)
    faces += [np.stack(three, -1) for three in ((first, this, half), (half, this, that), (half, that, last))]
    points = np.concatenate([top.reshape(-1, 3), under.reshape(-1, 3)])
    return solids.cleaned(points, np.concatenate(faces).astype(np.int64))


def _over_edge(down: Doubles) -> tuple[Doubles, Doubles, Doubles]:
    """Return how far out and how high cloth is, and its steepness (0 to 1), so far along it beyond an edge (...), m."""
    bend = np.clip(down / FOLD_M, 0, np.pi / 2)
    height = -FOLD_M * (1 - np.cos(bend)) - np.clip(down - np.pi / 2 * FOLD_M, 0, None)
    return FOLD_M * np.sin(bend), height, np.sin(bend)
