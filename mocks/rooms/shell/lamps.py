"""Lamps at the ceiling, lit or not: opal domes, flat discs, pendants and recessed spots."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from mocks.rooms.model import Finish, Fixture, Material, Part, Role
from mocks.rooms.shell.surfaces import part_of
from mocks.worlds.light import Vector
from processing.ground.mesh import Mesh, merge, moved
from processing.ground.shapes import ball, cylinder, lathe, tube

OPAL = Material("opal glass", (0.82, 0.82, 0.8), roughness=0.2)
SHADE = Material("lamp shade", (0.74, 0.71, 0.65))
WARM_RGB: Vector = (1.846, 0.826, 0.233)
"""Light of an incandescent lamp (CIE illuminant A) in linear Rec. 709 at luminance 1."""
NEUTRAL_RGB: Vector = (1.414, 0.924, 0.533)
"""Light of 4000 K, likewise."""
LUMINANCE_CD_M2 = {
    "dome lamp": (3500.0, 7000.0),
    "disc lamp": (3000.0, 6500.0),
    "pendant lamp": (2000.0, 4000.0),
    "spot": (15000.0, 30000.0),
}
BULB_CD_M2 = 8000.0
"""Of the opal globe within a pendant's shade."""


def lamp(fixture: Fixture, ceiling_m: float, finish: Finish) -> list[Part]:
    """Return the parts of a ceiling lamp in the room's coordinates; lit parts have an emission."""
    rng = np.random.default_rng([fixture.seed, 21])
    cd_m2 = float(rng.uniform(*LUMINANCE_CD_M2[fixture.kind]))
    warmth = float(rng.uniform(0.4, 1.0))
    tint = np.array(WARM_RGB) * warmth + np.array(NEUTRAL_RGB) * (1.0 - warmth)
    radius = fixture.width_m / 2
    if fixture.kind == "pendant lamp":
        glowing, plain = _pendant(fixture, radius, float(rng.uniform()))
    elif fixture.kind == "spot":
        glowing = [(_disc(radius * 0.72, 0.004, 0.012), OPAL, cd_m2)]
        plain = [(_ring(radius, radius * 0.7, 0.01), finish.metal)]
    elif fixture.kind == "disc lamp":
        glowing = [(_disc(radius * 0.96, fixture.height_m, fixture.height_m * 0.4), OPAL, cd_m2)]
        plain = [(_disc(radius, fixture.height_m * 0.6, 0.003), finish.lacquer)]
    else:
        glowing = [(_dome(radius * 0.95, fixture.height_m), OPAL, cd_m2)]
        plain = [(_disc(radius, 0.03, 0.008), finish.metal)]
    top = (*fixture.centre, ceiling_m)
    parts = [_part(moved(mesh, top), material) for mesh, material in plain]
    for mesh, material, luminance in glowing:
        r, g, b = (float(v) for v in tint * (luminance or cd_m2))
        shown = replace(material, name=f"lit {material.name}", emission_cd_m2=(r, g, b)) if fixture.lit else material
        parts.append(_part(moved(mesh, top), shown))
    if fixture.kind == "pendant lamp":
        parts.append(_part(moved(_cord(fixture.height_m), top), finish.metal))
    return parts


def _part(mesh: Mesh, material: Material) -> Part:
    return part_of(mesh, material, "lamp", "light", Role.FIXTURE)


def _disc(radius: float, height: float, edge: float) -> Mesh:
    """Return a flat round body under the ceiling (z 0) with a rounded lower rim."""
    arc = [(radius - edge + edge * math.sin(a), -height + edge - edge * math.cos(a)) for a in np.linspace(0, 1.571, 5)]
    return lathe([(0.0, -height), *arc, (radius, 0.001)], 40)


def _dome(radius: float, height: float) -> Mesh:
    """Return a shallow bowl under the ceiling."""
    arc = [(radius * math.sin(a), -0.02 - (height - 0.02) * math.cos(a)) for a in np.linspace(0.0, math.pi / 2, 12)]
    return lathe([*arc, (radius, 0.0)], 40)


def _ring(outer: float, inner: float, height: float) -> Mesh:
    """Return the rim of a recessed spot."""
    return lathe(
        [(inner, -0.002), (inner, -height * 0.6), (inner + 0.004, -height), (outer - 0.003, -height), (outer, 0.0)]
    )


def _cord(drop: float) -> Mesh:
    """Return rose and cord down to the lamp holder."""
    meshes = [
        cylinder((0.0, 0.0, -0.028), 0.045, 0.029, 0.006),
        tube([(0.0, 0.0, -0.02), (0.0, 0.0, -drop + 0.2)], 0.0035, 8),
    ]
    meshes.append(cylinder((0.0, 0.0, -drop + 0.14), 0.019, 0.06, 0.004))
    return merge(meshes)


def _pendant(
    fixture: Fixture, radius: float, choice: float
) -> tuple[list[tuple[Mesh, Material, float]], list[tuple[Mesh, Material]]]:
    """Return globe, drum or cone: (glowing parts with their luminance, 0 for the drawn one), (others)."""
    low = -fixture.height_m
    if choice < 0.35:
        globe = min(radius * 0.75, 0.17)
        return [(ball((0.0, 0.0, low + globe), globe, 32), OPAL, 0.0)], []
    bulb = (ball((0.0, 0.0, low + 0.11), 0.045), OPAL, BULB_CD_M2)
    high, narrow = (0.22, radius) if choice < 0.7 else (0.2, radius * 0.35)
    wall = 0.003
    shade = lathe(
        [
            (radius - wall, low),
            (radius, low),
            (narrow, low + high),
            (narrow - wall, low + high),
            (radius - wall, low),
        ],
        40,
    )
    return ([(shade, SHADE, 0.0), bulb], []) if choice < 0.7 else ([bulb], [(shade, SHADE)])
