"""The materials of a room, plain or patterned, drawn to go together as in real homes."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mocks.rooms.model import USES, Finish, Material, Texture, Use
from mocks.rooms.textures.catalogue import mean_albedo
from mocks.worlds.light import Vector, vector_of
from processing.ground.colour import LUMINANCE_WEIGHTS, srgb_decoded
from processing.ground.tables import table_of

# How people furnish: the colours that go together, as sRGB, and woods by name.


@dataclass(frozen=True)
class Style:
    """One taste. Colours are ``#rrggbb``; woods are names of `WOODS`."""

    name: str
    walls: tuple[str, ...]
    wall_reflectance: tuple[float, float]
    accents: tuple[str, ...]
    floors: tuple[str, ...]
    woods: tuple[str, ...]
    lacquers: tuple[str, ...]
    fabrics: tuple[str, ...]
    second_fabrics: tuple[str, ...]
    beddings: tuple[str, ...]
    curtains: tuple[str, ...]
    rugs: tuple[str, ...]
    metals: tuple[str, ...] = ("#2a2a2c", "#8d9093", "#b9bbbd")
    frames: tuple[str, ...] = ("#f4f3ef", "#f4f3ef", "#f1efe9")


def _style(row: dict[str, Any]) -> Style:
    fields: dict[str, Any] = {name: tuple(value) if isinstance(value, list) else value for name, value in row.items()}
    return Style(**fields)


_TABLES = table_of(__package__, "styles")
STYLES = tuple(map(_style, _TABLES["style"]))
WOODS: dict[str, Vector] = {name: vector_of(rgb) for name, rgb in _TABLES["woods"].items()}
"""Linear albedo of finished woods."""


def linear(colour: str | Vector) -> Vector:
    """Return linear albedo of ``#rrggbb`` (sRGB, IEC 61966-2-1); a vector is linear already."""
    if not isinstance(colour, str):
        return colour
    codes = np.array([int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)])
    return vector_of(np.clip(srgb_decoded(codes), 0.02, 0.9))


def scaled(colour: str | Vector, factor: float) -> Vector:
    """Return a colour made lighter or darker, within 0.02 to 0.9."""
    return vector_of(min(max(c * factor, 0.02), 0.9) for c in linear(colour))


def of_luminance(colour: str | Vector, reflectance: float) -> Vector:
    """Return the colour's hue at a given luminous reflectance."""
    rgb = linear(colour)
    return scaled(rgb, reflectance / float(np.dot(LUMINANCE_WEIGHTS, rgb)))


def plain(name: str, colour: str | Vector, roughness: float | None = None) -> Material:
    """Return a material of one colour, ``#rrggbb`` in sRGB or linear albedo."""
    return Material(name, linear(colour), roughness=roughness)


def textured(name: str, texture: Texture, roughness: float | None = None) -> Material:
    """Return a material with a pattern; its colour is the pattern's mean."""
    return Material(name, mean_albedo(texture), texture, roughness)


def turned(material: Material) -> Material:
    """Return the material with its pattern turned a quarter: grain that ran along v runs along u, and back."""
    texture = material.texture
    if texture is None:
        return material
    options = {**dict(texture.options), "turned": 1.0 - texture.option("turned", 0.0)}
    return replace(material, texture=replace(texture, options=tuple(options.items())))


def a_seed(rng: np.random.Generator) -> int:
    """Return a seed for a pattern."""
    return int(rng.integers(1 << 31))


def pick(rng: np.random.Generator, choices: Sequence[str]) -> str:
    """Return one of several."""
    return choices[int(rng.integers(len(choices)))]


def veneer(rng: np.random.Generator, wood: str, roughness: float | None = 0.35) -> Material:
    """Return furniture of a wood, its grain along u (across fronts and tops); white and black wood is painted."""
    if wood in ("white wood", "black wood"):
        return plain(wood, scaled(WOODS[wood], rng.uniform(0.95, 1.1)), roughness)
    options = (("figure", rng.uniform(0.06, 0.12)), ("arches", rng.uniform(1.2, 2.8)), ("turned", 1.0))
    texture = Texture("veneer", a_seed(rng), (scaled(WOODS[wood], rng.uniform(0.85, 1.15)),), options)
    return textured(wood, texture, roughness)


def cloth(rng: np.random.Generator, name: str, colour: str | Vector, kinds: tuple[str, ...] = ("woven",)) -> Material:
    """Return a cloth of a colour, of one of several kinds of texture; leather has a sheen."""
    kind = pick(rng, kinds)
    if kind == "leather":
        return textured("leather", Texture(kind, a_seed(rng), (linear(colour),)), rng.uniform(0.35, 0.5))
    shades: tuple[Vector, ...] = (linear(colour),)
    if kind == "woven" and rng.random() < 0.4:
        shades = (linear(colour), scaled(colour, rng.uniform(1.2, 1.6)))
    options = (("thread_m", rng.uniform(0.002, 0.004)),) if kind == "woven" else ()
    return textured(name, Texture(kind, a_seed(rng), shades, options))


# Floors, drawn as often as people have them: planks, laminate, parquet, carpet, tiles, stone.

_SORTS = ("planks", "laminate", "parquet", "carpet", "tiles", "stone")
_GLOSSY = 0.45  # chosen: share of floors with a gloss

_COLOURS: dict[str, list[str]] = _TABLES["floors"]
_CONCRETES: tuple[Vector, ...] = ((0.30, 0.295, 0.285), (0.38, 0.37, 0.35), (0.22, 0.218, 0.212))


def draw_floor(rng: np.random.Generator, style: Style, use: Use) -> Material:
    """Return a floor; carpets are matte, other floors are glossy (roughness 0.12 to 0.35) in 45 of 100 rooms."""
    sort = str(rng.choice(_SORTS, p=USES[use]["floors"]))
    roughness = rng.uniform(0.12, 0.35) if rng.random() < _GLOSSY else None
    if sort == "carpet":
        colour = scaled(pick(rng, style.rugs), rng.uniform(0.8, 1.1))
        kind = pick(rng, ("carpet loop", "carpet pile"))
        shades = (colour, scaled(colour, rng.uniform(0.5, 1.4))) if rng.random() < 0.5 else (colour,)
        return textured("carpet", Texture(kind, a_seed(rng), shades))
    if sort == "tiles":
        return _tiles(rng, roughness)
    if sort == "stone":
        return _stone(rng, roughness)
    wood = pick(rng, style.floors)
    colour = scaled(WOODS[wood], rng.uniform(0.85, 1.15))
    kind, options = {"planks": _planks, "laminate": _laminate, "parquet": _parquet}[sort](rng)
    texture = Texture(kind, a_seed(rng), (colour, scaled(colour, rng.uniform(0.12, 0.35))), options)
    floor = textured(f"{wood} {kind}", texture, roughness)
    return turned(floor) if rng.random() < 0.5 else floor


_Drawn = tuple[str, tuple[tuple[str, float], ...]]


def _planks(rng: np.random.Generator) -> _Drawn:
    board_m = rng.uniform(0.07, 0.22)
    return "planks", (
        ("board_m", board_m),
        ("length_m", rng.uniform(0.9, 2.2) if board_m > 0.1 else rng.uniform(0.6, 1.2)),
        ("gap_m", rng.uniform(0.001, 0.004)),
        ("variation", rng.uniform(0.05, 0.14)),
        ("figure", rng.uniform(0.06, 0.14)),
        ("knots", 0.0 if rng.random() < 0.6 else rng.uniform(0.05, 0.4)),
    )


def _laminate(rng: np.random.Generator) -> _Drawn:
    return "laminate", (
        ("strips", float(rng.choice([1, 1, 2, 3]))),
        ("board_m", rng.uniform(0.18, 0.22)),
        ("length_m", rng.uniform(1.2, 1.4)),
        ("prints", float(rng.integers(3, 6))),
    )


def _parquet(rng: np.random.Generator) -> _Drawn:
    if rng.random() < 0.7:
        sizes = (("block_m", rng.uniform(0.06, 0.11)), ("ratio", float(rng.integers(4, 7))))
        return "herringbone", (*sizes, ("variation", rng.uniform(0.05, 0.13)))
    return "blocks", (("block_m", rng.uniform(0.12, 0.3)), ("ratio", float(rng.integers(4, 7))))


def _tiles(rng: np.random.Generator, roughness: float | None) -> Material:
    colours = (linear(pick(rng, _COLOURS["tiles"])), linear(pick(rng, _COLOURS["grouts"])))
    draw = rng.random()
    if draw < 0.15:
        return textured("hexagon tiles", Texture("hexagons", a_seed(rng), colours), roughness)
    if draw < 0.3:
        chequered = (linear("#dcd7cc"), linear("#77736d"), linear(pick(rng, ("#333436", "#7a3a2c", "#6f8078"))))
        side = rng.uniform(0.2, 0.4)
        squares = (("tile_u_m", side), ("tile_v_m", side), ("chequered", 1.0))
        return textured("chequered tiles", Texture("tiles", a_seed(rng), chequered, squares), roughness)
    width_m, height_m = ((0.3, 0.3), (0.45, 0.45), (0.6, 0.6), (0.6, 0.3), (0.9, 0.45))[int(rng.integers(5))]
    options = (
        ("tile_u_m", width_m),
        ("tile_v_m", height_m),
        ("offset", float(rng.choice([0.0, 0.5])) if width_m > height_m else 0.0),
        ("gap_m", rng.uniform(0.002, 0.006)),
        ("variation", rng.uniform(0.01, 0.05)),
        ("clouding", rng.uniform(0.01, 0.06)),
    )
    return textured("tiles", Texture("tiles", a_seed(rng), colours, options), roughness)


def _stone(rng: np.random.Generator, roughness: float | None) -> Material:
    draw = rng.random()
    if draw < 0.45:
        colour = _CONCRETES[int(rng.integers(len(_CONCRETES)))]
        return textured("concrete", Texture("concrete", a_seed(rng), (colour,)), roughness)
    if draw < 0.7:
        colours = (linear("#d6d1c7"), *(linear(pick(rng, _COLOURS["chips"])) for _ in range(3)))
        return textured("terrazzo", Texture("terrazzo", a_seed(rng), colours), roughness)
    slab, joint = pick(rng, _COLOURS["marbles"]), pick(rng, _COLOURS["grouts"])
    sizes = (("tile_u_m", 0.6), ("tile_v_m", 0.6), ("gap_m", 0.002), ("veins", rng.uniform(0.2, 0.5)))
    return textured("marble", Texture("tiles", a_seed(rng), (linear(slab), linear(joint)), sizes), roughness)


_WHITE = "#fbfaf6"
_CREAM: Vector = (0.70, 0.62, 0.47)


def draw_finish(rng: np.random.Generator, use: Use) -> Finish:
    """Return the materials of a room for ``use``; a quarter of all rooms have one wall that is different.

    ``accent_walls`` then names one of the first four walls; `mocks.rooms.room` puts it where plan and furniture want
    it. Woods have their grain along u.
    """
    style = STYLES[int(rng.choice(len(STYLES), p=USES[use]["styles"]))]
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
        fabric=cloth(rng, "fabric", pick(rng, style.fabrics), (*["woven"] * 4, "boucle", "leather")),
        second_fabric=cloth(rng, "second fabric", pick(rng, style.second_fabrics), (*["woven"] * 2, "boucle", "knit")),
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
    options = (("period_m", rng.uniform(0.05, 0.2)), ("share", rng.uniform(0.2, 0.5)), ("checks", float(draw > 0.85)))
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
