"""The worlds that the simulated instruments can look at, by name, and the meter's spot.

`SimpleRoom` is built in; `mocks.rooms` generates others; `ChartRoom` is closed and holds a colour chart; `HdrWorld` is
made of HDR pictures; `UniformWorld` is an integrating sphere.
"""

import math
import re
from pathlib import Path
from typing import TYPE_CHECKING, cast

import numpy as np

from mocks.optics.chart import ChartRoom
from mocks.rooms.model import Use
from mocks.worlds.hdr_world import HdrWorld, read_equirect
from mocks.worlds.light import Site, UniformWorld, Vector, World, WorldFileError, luminance_cd_m2, spread_over_disc
from mocks.worlds.simple_room import SimpleRoom

if TYPE_CHECKING:
    from mocks.rooms.sky.sky import Kind

_GENERATED = re.compile(r"(?P<use>[a-z]+)-(?P<seed>[0-9]{1,9})(?:-(?P<sky>clear|intermediate|overcast))?")


def meter_luminance_cd_m2(
    world: World, direction: Vector, t_s: float = 0.0, *, spot_deg: float = 1 / 3, site: Site = Site.INDOOR
) -> float:
    """Return what a luminance meter at the camera reads, in cd/m2: the mean over a round spot, bright discs included.

    Samples at equal solid angles, so many that an edge across the spot is right to 0.1 %; ``spot_deg`` is the spot's
    diameter (1/3 degree on an LS-160).
    """
    count = 32_768
    spot = spread_over_disc(direction, math.radians(spot_deg / 2), count)
    sample_rad = math.radians(spot_deg) / math.sqrt(count)
    weights = world.weights(t_s)
    means = [luminance_cd_m2(world.radiance(site, spot, sample_rad, i)).mean() for i in range(len(weights))]
    for disc in world.discs(site):
        share = float((disc.covers(spot) * world.open_sky(site, spot)).mean())
        means[disc.component] += share * luminance_cd_m2(np.array(disc.radiance_rgb, dtype=np.float32))
    return math.fsum(weight * float(mean) for weight, mean in zip(weights, means, strict=True))


def open_world(name: str) -> World:
    """Return a world by name.

    ``room`` or ``room:SEED`` (the built-in room), ``bedroom-7`` (a generated room: use and seed; with -clear,
    -intermediate or -overcast under that sky), ``chart`` or ``chart:SEED`` (the closed room with the colour chart),
    ``uniform:CD_M2``, or ``INDOOR.hdr,OUTDOOR.hdr`` (pictures, .hdr or .exr, read with the scales of `HdrWorld`).
    Raises `WorldFileError` for anything else.
    """
    generated = _GENERATED.fullmatch(name)
    if generated and generated["use"] in tuple(Use):
        from mocks.rooms.world import room_world

        return room_world(Use(generated["use"]), int(generated["seed"]), sky=cast("Kind | None", generated["sky"]))
    kind, _, value = name.partition(":")
    try:
        if kind == "room":
            return SimpleRoom(seed=int(value or 0))
        if kind == "chart":
            return ChartRoom(seed=int(value or 0))
        if kind == "uniform" and 0 < float(value or 100.0) < 1e9:
            return UniformWorld(float(value or 100.0))
    except ValueError as error:
        raise _unknown(name) from error
    indoor, comma, outdoor = name.partition(",")
    if not comma:
        raise _unknown(name)
    world = HdrWorld(Path(indoor), Path(outdoor))
    for path in (world.indoor, world.outdoor):
        read_equirect(path)
    return world


def _unknown(name: str) -> WorldFileError:
    rooms = ", ".join(f"{use}-7" for use in Use)
    advice = f"say room:7, {rooms}, chart, uniform:100, or two pictures as indoor.hdr,outdoor.hdr"
    return WorldFileError(f"no world is called {name!r}", where="world", likely="a misspelt name", advice=advice)
