"""The sun of an outdoor picture, in one place: found, turned into north, repaired where it is clipped."""

from __future__ import annotations

from processing.calibration.clear_sky import Beam, Place, SunPlace, clear_beam, sun_place
from processing.calibration.north import North, north_from_heading, north_from_sun, oriented
from processing.calibration.sun_disc import SUN_RADIUS_RAD, SUN_SOLID_ANGLE_SR, Sun, find_sun
from processing.calibration.sun_repair import SunRepair, repair_sun

__all__ = [
    "SUN_RADIUS_RAD",
    "SUN_SOLID_ANGLE_SR",
    "Beam",
    "North",
    "Place",
    "Sun",
    "SunPlace",
    "SunRepair",
    "clear_beam",
    "find_sun",
    "north_from_heading",
    "north_from_sun",
    "oriented",
    "repair_sun",
    "sun_place",
]
