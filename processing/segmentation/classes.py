"""The classes that daylit tells apart."""

from __future__ import annotations

from enum import IntEnum


class SceneClass(IntEnum):
    """What a pixel shows, as far as room and removal need to know; also the channel of `SceneEvidence`."""

    FLOOR = 0
    """Rugs lie on it and are FIXTURE."""
    WALL = 1
    """With skirting, columns and reveals."""
    CEILING = 2
    WINDOW = 3
    """Glass, frame and what is seen through it; glass doors too."""
    DOOR = 4
    """Leaf and frame; an open doorway and what is seen through it."""
    FURNITURE = 5
    """What is to be removed: whatever stands on the floor, and clutter on it."""
    FIXTURE = 6
    """What stays: built-ins, radiators, curtains, blinds, rugs, pictures, mirrors, lamps on ceiling and wall."""
    TRIPOD = 7
    """The photographer's own: tripod, its shadowless foot, meter board."""
