"""A simulated room with all that decides its light: plan, finish, furniture, place, time, sky.

One room a seed, or by the name of a scene: the same name is the same room, whenever it is photographed.
"""

import hashlib
import math
import re
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Self

import numpy as np

from mocks.rooms.finish import draw_finish
from mocks.rooms.furnish.check import check_items
from mocks.rooms.furnish.furnish import furnish
from mocks.rooms.furniture import item_parts
from mocks.rooms.model import USES, Finish, Item, Part, Plan, Use
from mocks.rooms.plan.fixtures import draw_fixtures
from mocks.rooms.plan.forms import Outline, draw_camera, draw_outline, draw_turn_rad, rectangle, seen_from
from mocks.rooms.plan.openings import check_plan, draw_doors, draw_windows
from mocks.rooms.shell import shell_parts
from mocks.rooms.shell.openings import Pane, window_panes
from mocks.rooms.sky.daylight import Moment, draw_moment
from mocks.rooms.sky.sky import SHARES, CloudDrift, Kind, Sky, draw_sky, drawn_kind
from mocks.worlds.light import Vector

_NUMBER = re.compile(r"\d+\.\d+(?:e[+-]?\d+)?")
ATTEMPTS = 40  # chosen: then the rectangle below
FALLBACK_M = (4.2, 3.6)  # sides of the rectangle that is used should no form fit
_SCENE_DOMAIN = 5100  # parts these random numbers from all others of a seed
_SEEDS = 10**9
CLOUD_AMPLITUDE: dict[Kind, float] = {"clear": 0.3, "intermediate": 0.9, "overcast": 0.0}
"""How much of the sun passing clouds take, by sky; a closed cover does not change within minutes."""


def draw_plan(rng: np.random.Generator, use: Use, *, lamps_on: bool = False) -> Plan:
    """Return a valid plan (`check_plan` finds nothing). ``lamps_on`` lights its ceiling lamps."""
    for _ in range(ATTEMPTS):
        outline = draw_outline(rng, use)
        camera = draw_camera(rng, outline.points)
        if camera is None:
            continue
        plan = _furnish(rng, use, seen_from(outline, camera, draw_turn_rad(rng)), lamps_on)
        if plan is not None:
            return plan
    width, depth = FALLBACK_M
    still = np.random.default_rng(0)
    outline = seen_from(rectangle(width, depth), (width / 2, depth / 2), 0.0)
    return next(p for p in (_furnish(still, use, outline, lamps_on) for _ in range(ATTEMPTS)) if p is not None)


def _furnish(rng: np.random.Generator, use: Use, outline: Outline, lamps_on: bool) -> Plan | None:
    """Return the outline with height, openings and fixtures; None if that did not come out valid."""
    tall = rng.random() < 0.22
    height = float(rng.uniform(2.8, 3.4) if tall else rng.uniform(2.36, 2.75))
    skirting = float(rng.uniform(0.1, 0.16) if tall else rng.uniform(0.05, 0.09))
    bare = Plan(use, outline.points, round(height, 3), (), (), skirting_m=round(skirting, 3))
    plan = draw_doors(rng, draw_windows(rng, bare, outline.bay))
    if plan is None:
        return None
    plan = draw_fixtures(rng, plan, lamps_on)
    return None if check_plan(plan) else plan


# Raise when the same seed gives another room, or meshes, sky, street or textures change: light is kept on disk by it.
ROOMS_VERSION = 2
_DOMAIN = 4200  # parts these random numbers from all others of a seed
_LAMPS_ON = 0.3  # chosen: share of rooms with lamps lit
_PLANS = 12  # chosen: plans drawn for one room
MAIN_PIECE = {Use.BEDROOM: "bed", Use.LIVING: "sofa", Use.DINING: "dining table", Use.OFFICE: "desk"}


@dataclass(frozen=True)
class Room:
    """Everything about a room. ``glass_transmittance`` is that of every window, at every angle of incidence."""

    seed: int
    plan: Plan
    finish: Finish
    items: tuple[Item, ...]
    moment: Moment
    sky: Sky
    lamps_on: bool
    glass_transmittance: Vector

    @property
    def name(self) -> str:
        """Return the name that `open_world` knows, such as bedroom-7."""
        return f"{self.plan.use}-{self.seed}"

    @property
    def eye(self) -> Vector:
        """Return where the panorama camera is."""
        return (0.0, 0.0, self.plan.camera_height_m)

    @cached_property
    def key(self) -> str:
        """Return a digest of everything, numbers to nine digits: the last ones depend on the processor (OpenBLAS)."""
        text = _NUMBER.sub(lambda found: f"{float(found[0]):.9g}", repr(self))
        return hashlib.sha256(f"{ROOMS_VERSION} {text}".encode()).hexdigest()

    @cached_property
    def panes(self) -> tuple[Pane, ...]:
        """Return the clear panes of all windows."""
        return tuple(window_panes(self.plan))

    def emptied(self) -> Self:
        """Return the same room without furniture, clutter and the photographer's things, under the same light."""
        return replace(self, items=())

    def parts(self) -> list[Part]:
        """Return all meshes."""
        shell = shell_parts(self.plan, self.finish)
        return [*shell, *(part for item in self.items for part in item_parts(item, self.finish))]

    def board(self) -> Item | None:
        """Return the white meter board, None in an emptied room."""
        return next((item for item in self.items if item.kind == "meter board"), None)


def make_room(
    seed: int,
    use: Use | str | None = None,
    *,
    sky: Kind | None = None,
    lamps_on: bool | None = None,
    moment: Moment | None = None,
) -> Room:
    """Return the room of a seed; equal arguments give equal rooms on every machine.

    ``use`` None draws one; ``sky`` is clear, intermediate or overcast, None draws one; ``lamps_on`` None lights the
    lamps in three rooms of ten.

    Raises `ValueError`: a use or sky that does not exist, or a negative seed.
    """
    rng = np.random.default_rng([seed, _DOMAIN])
    drawn = str(rng.choice([Use.BEDROOM, Use.LIVING, Use.DINING, Use.OFFICE, Use.EMPTY], p=[0.3, 0.3, 0.15, 0.15, 0.1]))
    lit = bool(rng.random() < _LAMPS_ON)
    glass = float(rng.uniform(0.68, 0.82))
    kind = Use(use) if use is not None else Use(drawn)
    lit = lit if lamps_on is None else lamps_on
    finish = draw_finish(np.random.default_rng([seed, _DOMAIN, 2]), kind)
    plan, items = _furnished_plan(seed, kind, lit, finish)
    moment = moment or draw_moment(np.random.default_rng([seed, _DOMAIN, 4]))
    return Room(
        seed=seed,
        plan=plan,
        finish=replace(finish, accent_walls=(accent_wall(plan, items),) if finish.accent_walls else ()),
        items=items,
        moment=moment,
        sky=draw_sky(np.random.default_rng([seed, _DOMAIN, 5]), moment, sky),
        lamps_on=lit,
        glass_transmittance=(0.96 * glass, glass, 0.97 * glass),
    )


_kept_room = lru_cache(maxsize=16)(make_room)


def _furnished_plan(seed: int, use: Use, lit: bool, finish: Finish) -> tuple[Plan, tuple[Item, ...]]:
    """Return the seed's first plan in which tripod, meter board and what the room is for find a place.

    That is nearly always its first of all; after some tries, a room that lacks what it is for has to do."""
    makeshift = None
    for again in range(_PLANS):
        tail = [again] if again else []
        plan = draw_plan(np.random.default_rng([seed, _DOMAIN, 1, *tail]), use, lamps_on=lit)
        items = furnish(plan, finish, np.random.default_rng([seed, _DOMAIN, 3, *tail]))
        if check_items(plan, items):
            continue
        if use is Use.EMPTY or any(item.kind == MAIN_PIECE[use] for item in items):
            return plan, items
        makeshift = makeshift or (plan, items)
    if makeshift is None:
        raise RuntimeError(f"no place for the tripod or the meter board in {_PLANS} plans of seed {seed}")
    return makeshift


def accent_wall(plan: Plan, items: tuple[Item, ...]) -> int:
    """Return the wall that people would paint: behind bed or sofa, else the longest; without windows if there is one.

    A plan without any wall free of windows gives its longest.
    """
    whole = [wall for wall in range(len(plan.polygon)) if all(w.wall != wall for w in plan.windows)]
    walls = whole or list(range(len(plan.polygon)))
    for item in (item for item in items if item.kind in ("bed", "sofa")):
        behind = [wall for wall in walls if _stands_at(plan, item, wall)]
        if behind:
            return behind[0]
    return max(walls, key=plan.wall_length_m)


def _stands_at(plan: Plan, item: Item, wall: int) -> bool:
    """Return whether an item has its back to a wall."""
    (x0, y0), _ = plan.wall_ends(wall)
    along, inward = plan.wall_axes(wall)
    x, y = item.position_m[0] - x0, item.position_m[1] - y0
    gap_m = x * inward[0] + y * inward[1] - item.size_m[1] / 2
    facing = math.sin(item.turn_rad) * inward[0] - math.cos(item.turn_rad) * inward[1]
    before = 0.0 < x * along[0] + y * along[1] < plan.wall_length_m(wall)
    return before and abs(gap_m) < 0.2 and facing > math.cos(math.radians(5))


def use_of(scene: str) -> Use:
    """Return what a room of that name is for; any other name is a living room or an office by its digest."""
    lower = scene.lower()
    for use, facts in USES.items():
        if any(word in lower for word in facts["words"]):
            return Use(use)
    return (Use.LIVING, Use.OFFICE, Use.BEDROOM, Use.DINING)[_digest(lower) % 4]


def seed_of(scene: str, seed: int = 0) -> int:
    """Return the seed of a scene's room, among the rooms of a data set's ``seed``."""
    return _digest(f"{seed} {scene.lower()}") % _SEEDS


def scene_room(
    scene: str,
    moment: Moment,
    *,
    use: Use | str | None = None,
    seed: int = 0,
    lamps_on: bool = False,
    illuminance_lux: float | None = None,
) -> Room:
    """Return the room of a scene at a moment.

    What stands in it and what it looks out on follow from ``scene``, ``use`` and ``seed`` alone; the sky is drawn
    for the moment, of the kind whose open horizontal illuminance is nearest to ``illuminance_lux``.
    """
    number = seed_of(scene, seed)
    room = _kept_room(number, Use(use) if use is not None else use_of(scene), lamps_on=lamps_on)
    minute = int(moment.utc.timestamp()) // 60
    skies = {kind: draw_sky(np.random.default_rng([number, _SCENE_DOMAIN, minute]), moment, kind) for kind in SHARES}
    chance = np.random.default_rng([number, _SCENE_DOMAIN, minute, 1])
    kind = drawn_kind(chance) if illuminance_lux is None else nearest_kind(skies, illuminance_lux)
    sky = replace(skies[kind], seed=room.sky.seed, eye_height_m=room.sky.eye_height_m)
    return replace(room, moment=moment, sky=sky)


def nearest_kind(skies: dict[Kind, Sky], illuminance_lux: float) -> Kind:
    """Return the kind of sky whose open horizontal illuminance is nearest, as a ratio; ValueError unless above 0."""
    if not illuminance_lux > 0:
        raise ValueError(f"an illuminance of {illuminance_lux} lx says nothing of the sky")
    return min(skies, key=lambda kind: abs(math.log(sum(skies[kind].horizontal_illuminance_lx()) / illuminance_lux)))


def clouds_of(room: Room) -> CloudDrift:
    """Return the clouds that pass during a session in this room."""
    seed = int(room.moment.utc.timestamp()) // 60 + room.seed
    return CloudDrift(amplitude=CLOUD_AMPLITUDE[room.sky.kind], seed=seed)


def _digest(text: str) -> int:
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:8], "big")
