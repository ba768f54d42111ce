"""The stage detect by itself: masks, what is left out and why, the sun's place in the panorama."""

from __future__ import annotations

import math
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from processing.errors import ParameterError
from processing.ground.seam import share_of_sphere
from processing.pictures.images import LuminanceImage
from processing.pictures.preview import write_mask
from processing.pipeline import resolve, stage_named
from processing.report.sections import detect_section, tinted
from processing.segmentation.evidence import write_evidence
from processing.stages.contract import StageContext, StageOutput
from processing.stages.detect import MASKS, nothing_to_go_by, run
from processing.stages.parameters import DetectParameters
from processing.stages.upright import sun_direction
from station.session.session import FrameRecord, Side, Site
from tests.processing.removal.painted_room import Painted, iou, paint
from tests.station.session.sessions import manifest

FOUND_SUN = {"outdoor": {"sun": {"found": "yes, 35.00 degrees high"}}}


@pytest.fixture(scope="module")
def painted() -> Painted:
    return paint(rows=160)


@pytest.fixture(scope="module")
def usual(painted: Painted, tmp_path_factory: pytest.TempPathFactory) -> StageOutput:
    """What the stage makes of it with its defaults."""
    return run(context(painted, tmp_path_factory.mktemp("session")))


def picture(painted: Painted, **attributes: object) -> LuminanceImage:
    return LuminanceImage(
        painted.image.rgb,
        painted.image.uncertainty,
        painted.image.validity,
        painted.image.geometry,
        0.03,
        attributes=attributes,
    )


def context(painted: Painted, folder: Path, **changes: Any) -> StageContext:
    write_evidence(folder / "evidence.npz", painted.evidence)
    artifacts: dict[tuple[str, str], object] = {
        ("calibrate", "indoor"): picture(painted),
        ("calibrate", "calibration"): FOUND_SUN,
        ("room", "room"): painted.room,
        ("room", "evidence"): folder / "evidence.npz",
        **changes.pop("artifacts", {}),
    }
    whole = StageContext(
        session=manifest(),
        session_path=folder,
        folder=folder,
        parameters=DetectParameters(),
        fetch=lambda stage, name: artifacts.get((stage, name)),
        summary=lambda _stage: {},
    )
    return replace(whole, **changes)


def test_masks_are_made_and_reported(painted: Painted, usual: StageOutput) -> None:
    assert iou(usual.artifacts["furniture"], painted.furniture) > 0.9  # type: ignore[arg-type]
    assert iou(usual.artifacts["sunlight"], painted.sunlit) > 0.8  # type: ignore[arg-type]
    assert set(usual.artifacts) == {*MASKS, "target"}
    assert usual.metrics["shares"]["target"] > usual.metrics["shares"]["furniture"] > 0.01  # type: ignore[index,operator,call-overload]
    assert (usual.metrics["evidence"], usual.metrics["margin_deg"]) == ("painted", 0.6)
    section = detect_section(picture(painted), usual.artifacts, usual.metrics)  # type: ignore[arg-type]
    assert section.pictures[0].data.startswith(b"\xff\xd8")
    assert len(section.quantities) == 5
    assert section.tables[0].rows


def test_what_is_drawn_over_the_masks_is_added_or_stays(painted: Painted, usual: StageOutput, tmp_path: Path) -> None:
    plain = usual.artifacts["target"]
    more, kept = np.zeros((160, 320), bool), np.zeros((160, 320), bool)
    more[:20], kept[80:, :160] = True, True
    write_mask(tmp_path / "more.png", more)
    write_mask(tmp_path / "kept.png", kept)
    asked = DetectParameters(mask_add=tmp_path / "more.png", mask_keep=tmp_path / "kept.png")
    made = run(context(painted, tmp_path, parameters=asked))
    assert np.array_equal(made.artifacts["target"], (plain | more) & ~kept)
    assert not any((made.artifacts[name] & kept).any() for name in MASKS if name in made.artifacts)  # type: ignore[operator,attr-defined]
    assert np.array_equal(made.artifacts["furniture"], (usual.artifacts["furniture"] | more) & ~kept), "it is a thing"  # type: ignore[operator]
    assert made.metrics["shares"]["target"] == pytest.approx(share_of_sphere((plain | more) & ~kept), abs=1e-5)  # type: ignore[index,call-overload,operator]
    patch = usual.artifacts["sunlight"]
    write_mask(tmp_path / "more.png", patch)  # type: ignore[arg-type]
    thing = np.zeros((160, 320), bool)
    thing[:, 200:] = plain[:, 200:]
    write_mask(tmp_path / "sun.png", thing)
    asked = DetectParameters(mask_add=tmp_path / "more.png", mask_sunlight=tmp_path / "sun.png")
    lit = run(context(painted, tmp_path, parameters=asked))
    assert np.array_equal(lit.artifacts["sunlight"], thing), "a thing was sunlight, and the other way round"
    assert np.array_equal(lit.artifacts["furniture"], (usual.artifacts["furniture"] | patch) & ~thing)  # type: ignore[operator]
    assert np.array_equal(lit.artifacts["target"], plain | patch | thing)
    write_mask(tmp_path / "more.png", more[:80, :160])
    with pytest.raises(ParameterError, match="160 x 80"):
        run(context(painted, tmp_path, parameters=asked))


@pytest.mark.parametrize("tilt_deg", [pytest.param(0.0, marks=pytest.mark.long), 20.0])
def test_the_board_is_looked_for_where_levelling_took_it(painted: Painted, tmp_path: Path, tilt_deg: float) -> None:
    """The session records where the meter looked in the picture as it was taken; a levelled one shows it elsewhere."""
    image = picture(painted)
    row, column, half = 96, 60, 9
    rgb = np.array(image.rgb)
    rgb[row - half : row + half, column - half : column + half] = 1.6 * float(np.median(rgb))
    turn = Rotation.from_rotvec([0.0, math.radians(tilt_deg), 0.0]).as_matrix()
    longitude, latitude = (column / 320 - 0.5) * 2 * math.pi, (0.5 - row / 160) * math.pi
    level = math.cos(latitude)
    upright = np.array([level * math.sin(longitude), level * math.cos(longitude), math.sin(latitude)])
    x, y, z = turn.T @ upright
    taken = {"longitude_deg": math.degrees(math.atan2(x, y)), "latitude_deg": math.degrees(math.asin(z))}
    attributes = {"level_rotation": turn.tolist()} if tilt_deg else {}
    artifacts = {
        ("calibrate", "calibration"): FOUND_SUN | {"indoor": {"target": taken}},
        ("room", "panorama"): replace(image, rgb=rgb, attributes=attributes),
    }
    made = run(context(painted, tmp_path, artifacts=artifacts))
    assert made.artifacts["tripod"][row - 5 : row + 5, column - 5 : column + 5].all()  # type: ignore[index]
    assert any("meter's board" in note for note in made.metrics["notes"])  # type: ignore[union-attr]


def test_no_sun_in_the_outdoor_picture_means_no_sunlight(painted: Painted, tmp_path: Path) -> None:
    overcast = {("calibrate", "calibration"): {"outdoor": {"sun": {"found": "no: nothing is bright enough"}}}}
    made = run(context(painted, tmp_path, artifacts=overcast))
    assert "sunlight" not in made.artifacts
    assert made.left_out["sunlight"] == "the outdoor picture shows no sun"
    off = run(context(painted, tmp_path, parameters=DetectParameters(sunlight="off", margin_deg=0.0)))
    assert "switched off" in off.left_out["sunlight"]


def test_a_sun_far_brighter_than_the_shade_is_stated_with_its_strength(tmp_path: Path) -> None:
    sunny = paint(rows=160, sun_ratio=40.0)
    metrics = run(context(sunny, tmp_path)).metrics
    elevation = math.radians(metrics["sun_elevation_deg"])
    assert metrics["sun_times"] == pytest.approx(39 / math.sin(elevation), rel=0.15)


def test_without_a_room_there_is_nothing_to_go_by(painted: Painted, tmp_path: Path) -> None:
    assert nothing_to_go_by(context(painted, tmp_path)) is None
    reason = nothing_to_go_by(context(painted, tmp_path, artifacts={("room", "room"): None}))
    assert reason is not None
    assert "--room" in reason


def test_a_mask_of_another_size_is_refused_when_it_is_read(painted: Painted, tmp_path: Path) -> None:
    artifact = stage_named("detect").makes[0]
    assert artifact.name == "target"
    fits = resolve(artifact.fits)
    fits(np.ones((160, 320), bool), context(painted, tmp_path))
    with pytest.raises(ParameterError, match="target is 640 x 320, the panorama 320 x 160"):
        fits(np.ones((320, 640), bool), context(painted, tmp_path))


def test_the_sun_s_place_is_the_panorama_s() -> None:
    """Noon in June at the Tropic of Cancer's longitude 0: the sun due south, so behind a panorama that faces north."""
    frame = FrameRecord(
        side=Side.INDOOR,
        stop=0,
        file="indoor/a.jpg",
        size_bytes=1,
        sha256="0" * 64,
        asked_s=1.0,
        camera_s=1.0,
        iso=100,
        f_number=5.6,
        taken_utc=datetime(2023, 6, 21, 12, 2, tzinfo=UTC),
    )
    session = manifest().model_copy(
        update={"frames": (frame,), "site": Site(latitude_deg=50.0, longitude_deg=0.0), "heading_rad": 0.0}
    )
    found = sun_direction(session)
    assert found is not None
    assert abs(abs(found[0]) - math.pi) < math.radians(1.0)
    assert math.degrees(found[1]) == pytest.approx(90 - 50 + 23.44, abs=0.2)
    east = sun_direction(session.model_copy(update={"heading_rad": math.pi / 2}))
    assert east is not None
    assert math.degrees(east[0]) == pytest.approx(90, abs=1.0), "facing east, the south is to the right"
    assert sun_direction(session.model_copy(update={"heading_rad": None})) is None
    assert sun_direction(session.model_copy(update={"frames": ()})) is None


def test_tints_and_the_target_s_outline() -> None:
    grey = np.full((20, 40, 3), 100, np.uint8)
    target = np.zeros((20, 40), bool)
    target[5:15, 10:20] = True
    shown = tinted(grey, {"furniture": target, "target": target})
    assert (shown[10, 15] == (165, 70, 70)).all()
    assert (shown[5, 15] == (0, 220, 60)).all()
    assert (shown[0, 0] == 100).all()
