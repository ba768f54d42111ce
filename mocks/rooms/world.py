"""A procedural room as the instruments see it: its light is baked once, kept on disk, and looked up ray by ray."""

import io
import lzma
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from mocks.optics.picture_cache import PictureCache, content_key
from mocks.rooms.furniture.build import BOARD_SIDE_M
from mocks.rooms.light.geometry import Geometry
from mocks.rooms.light.light import QUALITIES, Baked, bake, components, lightings
from mocks.rooms.model import Use
from mocks.rooms.room import Room, make_room
from mocks.rooms.sky.sky import CloudDrift, Kind
from mocks.rooms.view import RoomView, outdoors
from mocks.worlds.light import BrightDisc, Site, Vector, unit, vector_of
from processing.ground.arrays import Floats

# Raise when baking changes (then `python -m mocks.rooms.world` makes the shipped light anew); when looking it up does.
LIGHT_VERSION, VIEW_VERSION = 7, 2
DEFAULT: tuple[str, int, str, Kind] = ("bedroom", 7, "reference", "clear")
"""The room of `daylit demo`, whose light is shipped: nobody waits for it, and its walls are free of noise."""
SHIPPED = Path(__file__).with_name("default.light")


@dataclass(frozen=True)
class RoomWorld:
    """A room and its sky (a `mocks.worlds.light.World`). ``quality`` names the work that goes into its light."""

    room: Room
    quality: str = "standard"
    drift: CloudDrift = field(default_factory=CloudDrift)

    @property
    def key(self) -> str:
        """Return what the light depends on."""
        return f"RoomWorld {LIGHT_VERSION} {VIEW_VERSION} {self.room.key} {QUALITIES[self.quality]!r} {self.drift!r}"

    @property
    def components(self) -> tuple[str, ...]:
        """Return one component for constant light, else what clouds change apart: sky, sun, lamps."""
        return self._lights if self.drift.amplitude > 0 else ("light",)

    def weights(self, t_s: float) -> tuple[float, ...]:
        """Return the brightness of each component relative to time 0."""
        if self.drift.amplitude == 0:
            return (1.0,)
        sky, sun = self.drift.weights(t_s)
        return tuple({"sky": sky, "sun": sun, "lamps": 1.0}[name] for name in self._lights)

    def radiance(self, site: Site, directions: Floats, pixel_rad: float = 0.0, component: int | None = None) -> Floats:
        """Return radiance at time 0 without the sun's disc; shapes as `mocks.worlds.light.World`."""
        chosen = self._lights if component is None or self.components == ("light",) else (self._lights[component],)
        flat = np.ascontiguousarray(directions.reshape(-1, 3), dtype=np.float32)
        if site is Site.OUTDOOR:
            out = outdoors(self.room.sky, flat, pixel_rad, chosen)
        else:
            out = self.view.radiance(flat, pixel_rad, chosen)
        return out.reshape(directions.shape)

    def discs(self, site: Site) -> tuple[BrightDisc, ...]:
        """Return the sun where it shines."""
        disc = self.room.sky.disc()
        if disc is None:
            return ()
        # Indoors `open_sky` dims by the glass's green share; the rest of its tint is the disc's.
        glass = self.room.glass_transmittance
        tint = [t / glass[1] if site is Site.INDOOR else 1.0 for t in glass]
        rgb = vector_of(v * t for v, t in zip(disc.radiance_rgb, tint, strict=True))
        component = self.components.index("sun") if "sun" in self.components else 0
        return (replace(disc, radiance_rgb=rgb, component=component),)

    def open_sky(self, site: Site, directions: Floats) -> Floats:
        """Return 1 outdoors; indoors the glass where a ray leaves the room, else 0; shapes as `World`."""
        if site is Site.OUTDOOR:
            return np.ones(directions.shape[:-1], np.float32)
        flat = np.ascontiguousarray(directions.reshape(-1, 3), dtype=np.float32)
        hits = self.view.geometry.cast(np.array(self.room.eye, np.float32), flat)
        through = np.where(hits.face < 0, np.float32(self.room.glass_transmittance[1]), np.float32(0))
        return through.reshape(directions.shape[:-1])

    @property
    def board_direction(self) -> Vector:
        """Return the direction from the camera to the middle of the white meter board."""
        board = self.room.board()
        if board is None:
            return (0.0, 1.0, 0.0)
        x, y, z = board.position_m
        return unit((x, y, z + board.size_m[2] - BOARD_SIDE_M / 2 - self.room.eye[2]))

    @property
    def view(self) -> RoomView:
        """Return the view, made once a process for each of the last rooms."""
        return _view_of(self.room, self.quality)

    @property
    def _lights(self) -> tuple[str, ...]:
        return components(self.room)


def room_world(use: str, seed: int, quality: str | None = None, sky: Kind | None = None) -> RoomWorld:
    """Return a room by name, for `mocks.worlds.world.open_world`.

    ``quality`` None: that of the shipped light where it is this room's, else "standard"; ``sky`` None: the seed's own.
    """
    room = make_room(seed, None if use == "any" else Use(use), sky=sky)
    if quality is None:
        quality = DEFAULT[2] if _is_shipped(light_key(room, DEFAULT[2])) else "standard"
    return RoomWorld(room, quality)


@lru_cache(maxsize=3)
def _view_of(room: Room, quality: str) -> RoomView:
    geometry = Geometry(room.parts())
    return RoomView(room, geometry, baked_light(room, geometry, quality), QUALITIES[quality].face_px)


def baked_light(room: Room, geometry: Geometry, quality: str, cache: PictureCache | None = None) -> dict[str, Baked]:
    """Return the room's light by component, from the cache or baked now (some seconds to a minute)."""
    cache = cache or PictureCache()
    key = light_key(room, quality)
    data = cache.read(key, ".light") or _shipped(key)
    if data is None or not _is_finite(data):
        with cache.rendering("light"):
            data = cache.read(key, ".light")
            if data is None or not _is_finite(data):
                made = {name: bake(room, geometry, lit, QUALITIES[quality]) for name, lit in lightings(room).items()}
                cache.write(key, ".light", _packed(made))
                return made
    return _unpacked(data)


def light_key(room: Room, quality: str) -> str:
    """Return the name of a room's light."""
    return content_key("room light", LIGHT_VERSION, room.key, QUALITIES[quality])


def _is_shipped(key: str) -> bool:
    """Return whether the light that came with the program is this one: its name stands in front."""
    if not SHIPPED.is_file():
        return False
    with SHIPPED.open("rb") as file:
        return file.readline().rstrip(b"\n").decode() == key


def _shipped(key: str) -> bytes | None:
    """Return the light that came with the program, if it is this one."""
    return lzma.decompress(SHIPPED.read_bytes().partition(b"\n")[2]) if _is_shipped(key) else None


def ship() -> None:
    """Write the light of the default room, baked now unless it is in the cache."""
    world = room_world(*DEFAULT)
    baked = baked_light(world.room, Geometry(world.room.parts()), world.quality)
    light = _packed(baked, np.float16)  # in lx to 65,504: direct sun is not in it, and 0.05 % is not seen
    assert _is_finite(light), "brighter than half precision holds"
    SHIPPED.write_bytes(light_key(world.room, world.quality).encode() + b"\n" + lzma.compress(light))


def _is_finite(data: bytes) -> bool:
    """Return whether all light in a file is finite: older versions kept what one bad sample had spoilt."""
    return all(
        np.isfinite(baked.irradiance).all() and (baked.gloss is None or np.isfinite(baked.gloss).all())
        for baked in _unpacked(data).values()
    )


def _packed(baked: dict[str, Baked], kind: type[np.floating] = np.float32) -> bytes:
    arrays = {f"{name}.irradiance": b.irradiance.astype(kind) for name, b in baked.items()}
    arrays |= {f"{name}.gloss": b.gloss.astype(kind) for name, b in baked.items() if b.gloss is not None}
    out = io.BytesIO()
    np.savez(out, allow_pickle=False, **arrays)
    return out.getvalue()


def _unpacked(data: bytes) -> dict[str, Baked]:
    with np.load(io.BytesIO(data), allow_pickle=False) as file:
        arrays = {name: file[name].astype(np.float32, copy=False) for name in file.files}
    names = dict.fromkeys(name.split(".")[0] for name in arrays)
    return {name: Baked(arrays[f"{name}.irradiance"], arrays.get(f"{name}.gloss")) for name in names}


if __name__ == "__main__":
    ship()
