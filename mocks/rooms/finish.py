"""The materials of a room, drawn to go together as in real homes."""

from __future__ import annotations

import numpy as np

from mocks.light import Vector
from mocks.rooms.floors import draw_floor
from mocks.rooms.materials import (
    a_seed,
    cloth,
    linear,
    of_luminance,
    pick,
    plain,
    scaled,
    textured,
    turned,
    veneer,
)
from mocks.rooms.model import Finish, Material, Texture, Use
from mocks.rooms.styles import Style, draw_style

_WHITE = "#fbfaf6"
_CREAM: Vector = (0.70, 0.62, 0.47)


def draw_finish(rng: np.random.Generator, use: Use) -> Finish:
    """Return the materials of a room for ``use``; a quarter of all rooms have one wall that is different.

    ``accent_walls`` then names one of the first four walls; `mocks.rooms.room` puts it where plan and furniture want
    it. Woods have their grain along u.
    """
    style = draw_style(rng, use)
    wall_colour = of_luminance(pick(rng, style.walls), rng.uniform(*style.wall_reflectance))
    wall = _wall(rng, wall_colour)
    has_accent = bool(rng.random() < 0.25)
    white = of_luminance(_WHITE, rng.uniform(0.72, 0.82))
    wood = veneer(rng, pick(rng, style.woods), rng.uniform(0.25, 0.5))
    return Finish(
        floor=draw_floor(rng, style, use),
        wall=wall,
        accent_wall=_accent(rng, style, wall_colour) if has_accent else wall,
        ceiling=_painted(rng, "ceiling paint", of_luminance("#fcfbf8", rng.uniform(0.75, 0.88))),
        trim=_trim(rng, white, wall_colour, wood),
        door=_door(rng, style, white, wood),
        window_frame=plain("window frame", scaled(pick(rng, style.frames), 0.95), 0.25),
        radiator=plain("radiator", of_luminance(_WHITE, rng.uniform(0.74, 0.82)), 0.3),
        wood=wood,
        second_wood=veneer(rng, pick(rng, style.woods), rng.uniform(0.25, 0.5)),
        lacquer=plain("lacquer", scaled(pick(rng, style.lacquers), 0.95), rng.uniform(0.12, 0.4)),
        metal=plain("metal", pick(rng, style.metals), rng.uniform(0.12, 0.3)),
        fabric=cloth(
            rng, "fabric", pick(rng, style.fabrics), ("woven", "woven", "woven", "woven", "boucle", "leather")
        ),
        second_fabric=cloth(
            rng, "second fabric", pick(rng, style.second_fabrics), ("woven", "woven", "boucle", "knit")
        ),
        bedding=_bedding(rng, style),
        curtain=cloth(rng, "curtain", scaled(pick(rng, style.curtains), 0.92)),
        rug=_rug(rng, style),
        accent_walls=(int(rng.integers(4)),) if has_accent else (),
    )


def _painted(rng: np.random.Generator, name: str, colour: Vector) -> Material:
    return textured(name, Texture("paint", a_seed(rng), (colour,)))


def _wall(rng: np.random.Generator, colour: Vector) -> Material:
    """Return what most walls have: rolled paint, some smoothed plaster, a few a light wallpaper."""
    draw = rng.random()
    if draw < 0.70:
        return _painted(rng, "wall paint", colour)
    if draw < 0.92:
        return textured("plaster", Texture("plaster", a_seed(rng), (colour,)))
    return _wallpaper(rng, colour, rng.uniform(0.82, 0.95))


def _wallpaper(rng: np.random.Generator, ground: Vector, contrast: float) -> Material:
    kind = pick(rng, ("wallpaper stripes", "wallpaper motifs", "wallpaper damask"))
    span = {"wallpaper stripes": (0.06, 0.16), "wallpaper motifs": (0.08, 0.2), "wallpaper damask": (0.3, 0.5)}[kind]
    options = (("period_m", rng.uniform(*span)), ("leaves", float(rng.integers(4, 7))))
    return textured("wallpaper", Texture(kind, a_seed(rng), (ground, scaled(ground, contrast)), options))


def _accent(rng: np.random.Generator, style: Style, wall_colour: Vector) -> Material:
    """Return the wall that is different: a strong colour, else a wallpaper on a strong or on the usual ground."""
    strong = scaled(pick(rng, style.accents), rng.uniform(0.9, 1.1))
    draw = rng.random()
    if draw < 0.65:
        return _painted(rng, "accent paint", strong)
    if draw < 0.85:
        return _wallpaper(rng, strong, rng.uniform(1.2, 1.5))
    return _wallpaper(rng, wall_colour, rng.uniform(0.55, 0.8))


def _trim(rng: np.random.Generator, white: Vector, wall_colour: Vector, wood: Material) -> Material:
    draw = rng.random()
    if draw < 0.75:
        return plain("trim", white, 0.3)
    return plain("trim", wall_colour, 0.4) if draw < 0.85 else wood


def _door(rng: np.random.Generator, style: Style, white: Vector, wood: Material) -> Material:
    draw = rng.random()
    if draw < 0.62:
        return plain("door", white, 0.25)
    return turned(wood) if draw < 0.9 else plain("door", pick(rng, style.accents), 0.25)


def _bedding(rng: np.random.Generator, style: Style) -> Material:
    """Return plain linen, stripes, checks or a knitted cover."""
    colour = scaled(pick(rng, style.beddings), 0.92)
    draw = rng.random()
    if draw < 0.6:
        return cloth(rng, "bedding", colour, ("woven", "woven", "woven", "knit"))
    ground = colour if rng.random() < 0.5 else _CREAM
    stripes = [linear(pick(rng, style.second_fabrics)) for _ in range(int(rng.integers(1, 3)))]
    checks = draw > 0.85
    options = (("period_m", rng.uniform(0.05, 0.2)), ("share", rng.uniform(0.2, 0.5)), ("checks", float(checks)))
    return textured("bedding", Texture("striped", a_seed(rng), (ground, *stripes), options))


def _rug(rng: np.random.Generator, style: Style) -> Material:
    """Return a plain rug, or one of the knotted and woven patterns."""
    colour = linear(pick(rng, style.rugs))
    kind = str(rng.choice(["carpet pile", "rug medallions", "rug lozenges", "rug bands"], p=[0.35, 0.2, 0.2, 0.25]))
    accents = [linear(pick(rng, style.second_fabrics)) for _ in range(2)]
    colours: tuple[Vector, ...] = {
        "carpet pile": (colour,),
        "rug medallions": (colour, scaled(pick(rng, style.fabrics), 0.5), _CREAM, accents[0]),
        "rug lozenges": (_CREAM, scaled(colour, 0.25)) if rng.random() < 0.6 else (colour, scaled(_CREAM, 0.9)),
        "rug bands": (colour, _CREAM, *accents),
    }[kind]
    return textured("rug", Texture(kind, a_seed(rng), colours))
