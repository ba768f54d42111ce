"""Where a session's pictures show a view: openings that do in the photograph, with the glass apart from its reveal."""

from __future__ import annotations

import numpy as np

from processing.exchange.showing import panes_of, shown_as
from processing.ground.room_model import OpeningKind
from processing.pictures.display import LEAST_VIEW, luminance_cd_m2
from processing.pictures.images import LuminanceImage
from processing.sphere import Equirectangular
from processing.surfaces.maps import opening_map
from tests.processing.surfaces.rooms import BOX, model, window

GEOMETRY = Equirectangular(512, 256)
ROOM = model(BOX, openings=[window(0, 0.5, 1.7), window(1, 0.5, 1.7).model_copy(update={"kind": OpeningKind.DOOR})])


def photograph() -> LuminanceImage:
    """A grey room with a bright window, and a wardrobe that was taken for a door."""
    opening = opening_map(ROOM, GEOMETRY)
    rgb = np.where(opening == 0, 60.0, np.where(opening == 1, 0.2, 1.0))[..., None] * np.ones(3)
    shape = opening.shape
    return LuminanceImage(
        rgb.astype(np.float32), np.full(shape, 0.02, np.float32), np.zeros(shape, np.uint8), GEOMETRY, 0.02
    )


def test_a_bright_wall_in_the_place_of_a_wardrobe_is_not_lowered_like_a_view() -> None:
    image = photograph()
    shown = shown_as(image, image, {}, ROOM, "panorama")
    assert shown.display.views == (0,)
    nothing = window(2, 0.5, 0.5001)  # so narrow that no pixel shows it
    assert shown_as(image, image, {}, model(BOX, openings=[nothing, ROOM.openings[0]]), "panorama").display.views == (
        1,
    )
    opening, emptied = opening_map(ROOM, GEOMETRY), image.rgb.copy()
    emptied[opening == 1] = 3
    panes = panes_of(ROOM, GEOMETRY, shown.display.views)
    light = shown.display.light(emptied, panes)
    plain = shown.display.balanced(emptied)
    assert plain[opening == 1].min() > LEAST_VIEW, "bright enough to be taken for a view"
    np.testing.assert_array_equal(light[opening == 1], shown.display.light(emptied)[opening == 1])
    assert panes is not None
    assert np.median(luminance_cd_m2(light)[panes == 2]) < 0.2 * luminance_cd_m2(plain)[panes == 2].min()


def test_glass_lies_within_its_opening_and_its_reveal_around_it() -> None:
    panes, opening = panes_of(ROOM, GEOMETRY, (0,)), opening_map(ROOM, GEOMETRY)
    assert panes is not None
    assert ((panes > 0) == (opening == 0)).all()
    assert 0.3 < (panes == 2).sum() / (panes > 0).sum() < 0.9
    assert panes_of(model(BOX), GEOMETRY) is None
    np.testing.assert_array_equal(panes_of(ROOM, GEOMETRY, (0, 5)), panes)  # a room with fewer openings than it had
    assert panes_of(None, GEOMETRY) is None
