"""Sessions of one simulated rig, for tests of its JPEGs and of its raw files: what is made of equal frames, once."""

from __future__ import annotations

import json
import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.photometry.rig import CHART_STOPS_S, DENSE_STOPS_S
from benchmarks.sessions import Taken, write_session
from mocks.optics.chart import ChartRoom
from mocks.worlds.light import Site
from mocks.worlds.simple_room import SimpleRoom
from mocks.worlds.sky import SimpleSky
from station.session.session import Side

SMALL = 12
"""Of the frames' size: with smaller ones no view shows the chart surely, and all are searched."""
INDOOR, OUTDOOR = Side.INDOOR, Side.OUTDOOR
RAW = {INDOOR: 1 / 1.5, OUTDOOR: 1.0}
"""The indoor camera's raw files are 1.5 times as bright as its JPEGs: k2 of one is none of the other."""
SKY = SimpleSky(sun_luminance_cd_m2=0.0)


@dataclass(frozen=True)
class PaperedRoom(ChartRoom):
    """The chart's room with patterned walls, by which the panorama camera's lenses can be placed."""

    def radiance(self, site, directions, pixel_rad=0.0, component=None):  # type: ignore[no-untyped-def]
        light = super().radiance(site, directions, pixel_rad, component)
        x, y, z = np.moveaxis(np.asarray(directions, np.float64), -1, 0)
        east, up = np.arctan2(x, y) / np.pi + 1, np.arcsin(np.clip(z, -1, 1)) / np.pi + 0.5
        paper = np.ones(light.shape[:-1])
        for n in (16, 32, 64):
            cells = np.random.default_rng(n).uniform(0.25, 1, (n, 2 * n)) ** 0.7
            paper *= cells[np.clip(up * n, 0, n - 1).astype(int), np.clip(east * n, 0, 2 * n - 1).astype(int)]
        paper[y > np.cos(np.radians(40))] = 1  # around chart and board
        return (light * paper[..., None]).astype(np.float32) if site is Site.INDOOR else light


@dataclass(frozen=True)
class UnderTheSky(PaperedRoom):
    """The same room, and an overcast sky outdoors."""

    def radiance(self, site, directions, pixel_rad=0.0, component=None):  # type: ignore[no-untyped-def]
        if site is Site.INDOOR:
            return super().radiance(site, directions, pixel_rad, component)
        return 4 * SKY.radiance(directions)

    def open_sky(self, site: Site, directions: np.ndarray) -> np.ndarray:
        return np.full(directions.shape[:-1], site is Site.OUTDOOR, np.float32)


def write_rig(folder: Path) -> Path:
    """Write the chart, a room, and the chart without the filter; those of the chart with raw files, too."""
    write_session(folder / "chart", Taken(PaperedRoom(), SMALL, stops_s=CHART_STOPS_S, raw=RAW))
    write_session(folder / "room", Taken(SimpleRoom(3), SMALL, (INDOOR,), stops_s=DENSE_STOPS_S))
    write_session(folder / "plain", Taken(PaperedRoom(), SMALL, (OUTDOOR,), nd=False, stops_s=DENSE_STOPS_S, raw=RAW))
    return folder


def without_raw(at: Path, into: Path, *sides: Side) -> Path:
    """Copy a session but for some sides' raw files."""
    shutil.copytree(at, into, ignore=shutil.ignore_patterns("stages"))
    found = json.loads((into / "session.json").read_text())
    found["frames"] = [f for f in found["frames"] if f["side"] not in sides or f["format"] != "dng"]
    (into / "session.json").write_text(json.dumps(found))
    for dng in (path for side in sides for path in (into / side.value).glob("*.dng")):
        dng.unlink()
    return into
