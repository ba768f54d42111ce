"""What has the colour of the surface behind it."""

from __future__ import annotations

import numpy as np

from processing.surfaces.sun import coloured_as_behind


def test_what_is_coloured_as_the_plane_behind_it() -> None:
    plane, hidden = np.zeros((4, 6), np.int16), np.zeros((4, 6), bool)
    hidden[:, 3:] = True
    rgb = np.full((4, 6, 3), (0.5, 0.4, 0.3), np.float32)
    rgb[0, 3:] = (4.0, 2.6, 1.2)
    rgb[1, 3:] = (0.1, 0.2, 0.9)
    rgb[2, 3:] = 0
    rgb[3] = (0.2, 0.3, 0.5)
    plane[3] = 2
    everywhere = np.ones_like(hidden)
    result = coloured_as_behind(rgb, plane, everywhere, hidden)
    assert result[:, :3].all()
    assert result[0, 3:].all(), "the sun is warmer than the sky"
    assert not result[1, 3:].any(), "a blue chair"
    assert result[3].all(), "each plane has its own colour"
    assert not coloured_as_behind(rgb, plane, ~everywhere, hidden).any()
    assert not coloured_as_behind(rgb, plane, everywhere, everywhere).any(), "nothing is known of what nobody sees"
    assert not coloured_as_behind(np.zeros_like(rgb), plane, everywhere, hidden).any()
