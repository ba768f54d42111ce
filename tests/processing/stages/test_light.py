"""The stage light: when it is skipped, and that removal uses what it makes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from processing.ground.room_model import Opening, OpeningKind, RoomModel
from processing.pictures.images import LuminanceImage, Validity
from processing.sphere import Equirectangular
from processing.stages.contract import Quality, StageContext
from processing.stages.light import nothing_to_lift, read_shade, run
from processing.stages.parameters import LightParameters, RemoveParameters
from processing.stages.remove import run as remove

ROWS = 48
ROOM = RoomModel(
    source="given",
    floor=((-2.0, -2.0), (2.0, -2.0), (2.0, 2.0), (-2.0, 2.0)),
    camera_height_m=1.6,
    ceiling_height_m=2.7,
    openings=(Opening(kind=OpeningKind.WINDOW, wall=0, start_m=1.0, end_m=3.0, sill_m=0.9, head_m=2.2),),
)


def picture() -> LuminanceImage:
    shape = (ROWS, 2 * ROWS)
    rgb = np.full((*shape, 3), 60.0, np.float32)
    rgb[16:26, :8] = rgb[16:26, -8:] = 2000.0
    rgb[furniture()] = 4.0
    nothing = np.full(shape, Validity.VALID, np.uint8)
    return LuminanceImage(rgb, np.full(shape, 0.02, np.float32), nothing, Equirectangular(2 * ROWS, ROWS), 0.02)


def furniture() -> np.ndarray[Any, np.dtype[np.bool_]]:
    mask = np.zeros((ROWS, 2 * ROWS), bool)
    mask[24:36, 40:60] = True
    return mask


def context(folder: Path, parameters: Any = None, **artifacts: Any) -> StageContext:
    given = {"indoor": picture(), "room": ROOM, "target": furniture(), "furniture": furniture()} | artifacts
    return StageContext(
        session=None,  # type: ignore[arg-type]
        session_path=folder,
        folder=folder,
        parameters=parameters or LightParameters(),
        fetch=lambda _stage, name: given.get(name),
        summary=lambda _stage: {"metrics": {"margin_deg": 1.0}, "left_out": {}},
        quality=Quality.DRAFT,
    )


def test_it_is_skipped_with_a_reason(tmp_path: Path) -> None:
    assert nothing_to_lift(context(tmp_path)) is None
    assert "--shade keep" in str(nothing_to_lift(context(tmp_path, LightParameters(shade="keep"))))
    none = np.zeros_like(furniture())
    assert nothing_to_lift(context(tmp_path, target=none)) == "nothing to remove"
    assert "no room" in str(nothing_to_lift(context(tmp_path, room=None)))
    assert "less than" in str(nothing_to_lift(context(tmp_path, furniture=none)))
    blind = ROOM.model_copy(update={"openings": ()})
    assert "no window" in str(nothing_to_lift(context(tmp_path, room=blind)))


def test_windows_without_a_sky_are_as_bright_as_the_light_that_they_cast(tmp_path: Path) -> None:
    clipped = picture()
    clipped.validity[clipped.rgb[..., 0] == 2000.0] = Validity.CLIPPED
    pressed = picture()  # by a tone curve: nothing is clipped, and windows look too dark for the room
    pressed.rgb[pressed.rgb[..., 0] == 2000.0] *= 0.25
    brighter = {}
    for name, image in {"clipped": clipped, "pressed": pressed}.items():
        assert nothing_to_lift(context(tmp_path, indoor=image)) is None
        metrics = run(context(tmp_path, indoor=image)).metrics
        assert any("windows: " in note for note in metrics["notes"]), name
        brighter[name] = metrics["brighter_median"]
    assert brighter["pressed"] > 1, "a room without furniture is no darker"


def test_a_given_target_counts_as_furniture(tmp_path: Path) -> None:
    """Where none was found the target is equipment and sunlight, with a margin of up to ten degrees: no furniture."""
    given = replace(context(tmp_path, furniture=None), summary=lambda _stage: {"metrics": {}, "given": ["target"]})
    assert nothing_to_lift(given) is None
    assert "less than" in str(nothing_to_lift(context(tmp_path, furniture=None)))


def test_removal_lifts_the_shade_that_it_found(tmp_path: Path) -> None:
    made = run(context(tmp_path))
    assert made.metrics["standins"] == 1
    assert any("no outdoor picture" in warning.message for warning in made.warnings)
    shade = read_shade(context(tmp_path, shade=tmp_path / "shade.npz"))
    assert shade is not None
    assert shade.seen.any()
    assert 0 < shade.doubt < 0.2
    assert any(note.startswith("change of light: ") for note in made.metrics["notes"])
    kept = remove(context(tmp_path, RemoveParameters()))
    lifted = remove(context(tmp_path, RemoveParameters(), shade=tmp_path / "shade.npz"))
    assert kept.artifacts["lift"] is None
    stays = ~furniture()
    before, after = kept.artifacts["empty"], lifted.artifacts["empty"]
    assert isinstance(before, LuminanceImage)
    assert isinstance(after, LuminanceImage)
    assert np.array_equal(before.rgb[stays], picture().rgb[stays])
    with np.load(tmp_path / "lift.npz") as file:
        change = file["log_luminance"].astype(np.float32)
    moved = stays & (change != 0)
    assert moved.any()
    ratio = after.rgb.mean(axis=-1)[moved] / picture().rgb.mean(axis=-1)[moved]
    np.testing.assert_allclose(np.log(ratio), change[moved], atol=0.02)
    assert (after.uncertainty[moved] >= before.uncertainty[moved]).all()
    assert lifted.metrics["lifted_median_pct"] > 0


def test_the_sun_that_patches_show_comes_back_where_the_furniture_held_it_off(tmp_path: Path) -> None:
    """Through the window behind the camera, on to what stands ahead of it; a sun from the side does not come in.

    Nor does one come back that the furniture does not show.
    """
    sunny, brighter = picture(), []
    sunny.rgb[24:36, 44:53] = 80 * 4.0
    sun_behind = {"sun_elevation_deg": 25.0, "sun_azimuth_deg": 180.0, "sun_times": 80.0}
    for sun in ({}, sun_behind, sun_behind | {"sun_azimuth_deg": 90.0}):
        found = {"metrics": {"sun_elevation_deg": 25.0} | sun, "left_out": {}}
        made = run(replace(context(tmp_path, indoor=sunny), summary=lambda _stage, found=found: found))
        brighter.append(made.metrics["brighter_median"])
        assert ("sun: 80 times the light in the shade, by its patches in the room" in made.metrics["notes"]) == bool(
            sun
        )
    # Little: with sun on furniture, most is what furniture takes from rooms.
    assert brighter[1] > 1.04 * brighter[0]
    assert brighter[2] == brighter[0]
    shows_none = run(replace(context(tmp_path), summary=lambda _stage: {"metrics": sun_behind, "left_out": {}}))
    assert shows_none.metrics["brighter_median"] == run(context(tmp_path)).metrics["brighter_median"]


def test_a_picture_of_another_brightness_is_lifted_alike(tmp_path: Path) -> None:
    run(context(tmp_path))
    one = read_shade(context(tmp_path, shade=tmp_path / "shade.npz"))
    bright = replace(picture(), rgb=picture().rgb * np.float32(100))
    run(context(tmp_path, indoor=bright))
    other = read_shade(context(tmp_path, shade=tmp_path / "shade.npz"))
    assert one is not None
    assert other is not None
    np.testing.assert_allclose(one.log_change, other.log_change, atol=0.01)
