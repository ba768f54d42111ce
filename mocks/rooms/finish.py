"""The materials of a room, drawn to go together as in real homes."""

from __future__ import annotations

import numpy as np

from mocks.rooms.materials import WOODS, a_seed, of_luminance, pick, plain, scaled, textured
from mocks.rooms.model import Finish, Material, Texture, Use
from mocks.rooms.styles import Style, draw_style


def draw_finish(rng: np.random.Generator, use: Use) -> Finish:
    """Return the materials of a room for ``use``. About half of the hard floors are glossy."""
    style = draw_style(rng, use)
    wall_colour = of_luminance(pick(rng, style.walls), rng.uniform(*style.wall_reflectance))
    wall = plain("wall paint", wall_colour)
    has_accent = rng.random() < 0.25
    accent = plain("accent paint", scaled(pick(rng, style.accents), rng.uniform(0.9, 1.1)))
    white = of_luminance("#fbfaf6", rng.uniform(0.72, 0.82))
    wood, second = pick(rng, style.woods), pick(rng, style.woods)
    return Finish(
        floor=_floor(rng, style, use),
        wall=wall,
        accent_wall=accent if has_accent else wall,
        ceiling=plain("ceiling paint", of_luminance("#fcfbf8", rng.uniform(0.75, 0.88))),
        trim=plain("trim", white, 0.3),
        door=plain("door", white, 0.25),
        window_frame=plain("window frame", pick(rng, style.frames), 0.25),
        radiator=plain("radiator", of_luminance("#fbfaf6", 0.8), 0.3),
        wood=plain(wood, WOODS[wood], 0.35),
        second_wood=plain(second, WOODS[second], 0.35),
        lacquer=plain("lacquer", pick(rng, style.lacquers), 0.2),
        metal=plain("metal", pick(rng, style.metals), 0.2),
        fabric=plain("fabric", pick(rng, style.fabrics)),
        second_fabric=plain("second fabric", pick(rng, style.second_fabrics)),
        bedding=plain("bedding", pick(rng, style.beddings)),
        curtain=plain("curtain", pick(rng, style.curtains)),
        rug=plain("rug", pick(rng, style.rugs)),
        accent_walls=(int(rng.integers(4)),) if has_accent else (),
    )


def _floor(rng: np.random.Generator, style: Style, use: Use) -> Material:
    wood = pick(rng, style.floors)
    colour = scaled(WOODS[wood], rng.uniform(0.85, 1.15))
    texture = Texture("planks", a_seed(rng), (colour, scaled(colour, 0.15)))
    return textured(f"{wood} planks", texture, rng.uniform(0.12, 0.35) if rng.random() < 0.45 else None)
