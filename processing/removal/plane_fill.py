"""One plane's texture without its holes: which way of filling suits it, region by region."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from processing.ground.arrays import Flags, Floats
from processing.ground.room_model import RoomModel
from processing.pictures.images import luminance_cd_m2
from processing.removal.near_periodic import Repeat, analyse, complete
from processing.removal.plain import fill_plain
from processing.removal.regions import opening_regions, too_bright
from processing.removal.skirting import Skirting
from processing.removal.sources import plane_sources
from processing.surfaces.planes import FIRST_WALL, FLOOR
from processing.surfaces.textures import Texture

PATTERN = 0.012
"""Roughness about light and profile from which a wall or ceiling is no plain paint but a pattern."""
WALL_NCC = 0.65
"""Of a wall's lattice: what hangs on it imitates one more easily than on a floor."""
LEAST_TEXELS = 30
"""Known texels of a surface, under which it gets one colour."""
SEEN, CONTINUED, SYNTHESISED = 0, 1, 2
SURE = 0.35
"""Confidence under which what was filled is called synthesised."""


@dataclass(frozen=True)
class FilledPlane:
    """A plane's texture, whole."""

    texture: Texture
    """As seen, holes left out."""
    values: Floats
    """(h, w, 3): as seen where seen, else filled; 0 outside the plane."""
    hole: Flags
    confidence: Floats
    """(h, w)."""
    continued: Flags
    """(h, w): where the surface repeats or is plain, so that its continuation is no invention."""
    how: str


def fill_plane(
    texture: Texture,
    hole: Flags,
    unfit: Flags,
    room: RoomModel,
    elsewhere: Floats,
    skirting: Skirting | None = None,
) -> FilledPlane:
    """Fill a texture's hole; ``unfit`` texels are known but nothing is copied from them (sunlight, mixed pixels).

    ``elsewhere`` (3,) is the colour of like planes, taken where too little of this one is known; ``skirting`` that of
    the room, for walls that hide their own.
    """
    known = texture.known & ~hole
    sources = known & ~unfit & ~too_bright(luminance_cd_m2(texture.values), known)
    values = np.where((known | hole)[..., None], texture.values, 0).astype(np.float32)
    if sources.sum() < 0.002 * max(int((known | hole).sum()), 1) or sources.sum() < LEAST_TEXELS:
        colour = _colour(values, sources, elsewhere)
        values[hole] = colour
        confidence = np.where(hole, 0.05, 1).astype(np.float32)
        return FilledPlane(texture, values, hole, confidence, ~hole, "nothing of it is seen: one colour")
    confidence = np.ones(hole.shape, np.float32)
    rest = np.ones_like(hole)
    for region in opening_regions(texture.plane, room, hole.shape, texture.px_per_m):
        inside = hole & region
        if (sources & region).sum() < 0.05 * region.sum():
            # Of an opening that is hidden altogether nobody knows that it is there: the wall goes on.
            continue
        rest &= ~region
        if inside.any():
            filled = fill_plain(values, known & region, inside, level_rows=True, most_rough=PATTERN)
            values, confidence[inside] = filled.values, 0.7 * filled.confidence[inside]
    inside = hole & rest
    continued, how = np.ones_like(hole), "openings only"
    if inside.any() and (sources & rest).sum() < LEAST_TEXELS:
        # All that is seen of it is openings, and a wall does not look like what is behind its windows.
        values[inside] = _colour(values, sources & rest, elsewhere)
        confidence[inside], continued[inside], how = 0.05, False, "nothing of it is seen: one colour"
    elif inside.any():
        own = sources & rest
        # Pictures, sockets and the like on walls are left out where these are filled.
        own = plane_sources(values, own, texture.px_per_m) if texture.plane.index == FLOOR else own
        values, sure, goes_on, how = _surface(texture, values, own, inside, skirting)
        confidence[inside], continued[inside] = sure[inside], goes_on
    return FilledPlane(texture, values, hole, confidence, continued, how)


def _colour(values: Floats, known: Flags, elsewhere: Floats) -> Floats:
    return elsewhere if known.sum() < LEAST_TEXELS else np.asarray(np.median(values[known], axis=0), np.float32)


def _surface(
    texture: Texture, values: Floats, sources: Flags, hole: Flags, skirting: Skirting | None
) -> tuple[Floats, Floats, bool, str]:
    """Return values, confidence, whether it is a continuation, and how it was filled."""
    if texture.plane.index == FLOOR:
        done = complete(values, sources, hole, density=texture.density)
    else:
        wall = texture.plane.index >= FIRST_WALL
        usual = skirting.rows(len(hole), texture.px_per_m) if wall and skirting is not None else None
        plain = fill_plain(
            values, sources, hole, level_rows=wall, usual_rows=usual, beside=sources, px_per_m=texture.px_per_m
        )
        said = f"plain (roughness {plain.roughness:.3f})"
        if plain.roughness < PATTERN:
            return plain.values, plain.confidence, True, said
        # Skirting runs along the wall and is no part of its pattern.
        rows = np.exp(plain.profile)
        level = np.asarray(values / rows, np.float32)
        found = analyse(level, plain.clean)
        if found.repeat is Repeat.NONE or (found.lattice is not None and found.lattice.strength < WALL_NCC):
            return plain.values, plain.confidence, True, said + ", no pattern"
        done = complete(level, plain.clean, hole, density=texture.density, found=found)
        done = replace(done, values=np.where(hole[..., None], done.values * rows, values))
    kind = "" if done.lattice is None else f", NCC {done.lattice.strength:.2f}"
    return done.values, done.confidence, done.repeat is not Repeat.NONE, f"{done.repeat.value}{kind}"
