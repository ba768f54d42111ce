"""What fails is counted and said: no figure is better for a room, a picture or a rival that is left out."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.hostile import rigs
from benchmarks.hostile.two_lenses import error_of
from benchmarks.hostile.worlds import HostileBracket
from benchmarks.layout import arrange, steady
from benchmarks.light import emptying
from benchmarks.room import detect, room, room_openings
from benchmarks.room.room_level import as_image
from benchmarks.room.room_run import Estimated
from processing.errors import LayoutError, NoRoomError, ProcessingError
from processing.ground.room_model import Opening, OpeningKind
from processing.layout.items import set_items
from processing.pictures.images import RelativeImage
from processing.sphere import Equirectangular
from tests.processing.room.evidence import BOX, room_of

WINDOW = Opening(kind=OpeningKind.WINDOW, wall=0, start_m=0.5, end_m=1.5, sill_m=0.9, head_m=2.0)


def test_a_refused_room_misses_its_windows(monkeypatch: pytest.MonkeyPatch) -> None:
    true = room_of(BOX).model_copy(update={"openings": (WINDOW,)})
    refused = Estimated(None, (), "ROOM-001: nothing", {"level": 1.0}, 0.0, None)
    row = room._row(refused, true)
    assert (row["windows"], row["windows_false"], row["iou3d"]) == ([0.0], 0, 0.0)

    def fails(*_: object) -> Any:
        raise NoRoomError("no boundaries")

    monkeypatch.setattr(room_openings, "estimate_room", fails)
    score = room_openings._scored(as_image(np.ones((16, 32, 3), np.float32)), true, lambda _: None, own_room=True)  # type: ignore[arg-type, return-value]
    assert (score["window"], score["window_found"], score["refused"]) == ([0.0], 0, 1)


def test_a_picture_that_is_refused_is_not_one_without_false_sun(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: object) -> Any:
        raise ProcessingError("no room")

    monkeypatch.setattr(detect, "MODEL", Path("none"))
    monkeypatch.setattr(detect, "picture_file", lambda _: Path("none"))
    monkeypatch.setattr(detect, "photograph", lambda _: None)
    monkeypatch.setattr(detect, "scene_evidence", lambda _: None)
    monkeypatch.setattr(detect, "estimated", fails)
    assert detect._false_sun("any") < 0


def test_rooms_that_were_not_emptied_are_counted() -> None:
    done = {"room": "a", "empty_median_err_pct": 4.0, "stage_cpu_s": {"light": 2.0}}
    rows: list[dict[str, Any]] = [
        done,
        {"room": "b", "refused": "CAL-002: nothing"},
        {"room": "c", "left_out": {"x": 1}},
    ]
    found = emptying._metrics(rows)
    assert (found["rooms"], found["rooms_not_emptied"], found["filled_median_err_pct"]) == (3, 2, 4.0)
    assert emptying._line(rows[1]) == "b: CAL-002: nothing"


def test_a_group_without_rooms_has_not_furnished_them_all() -> None:
    rows: list[dict[str, Any]] = [{"group": 0, "complete": True}, {"group": 0, "refused": "why"}]
    assert arrange._placed(rows) == {"placed_all_tuning_pct": 50.0}
    assert arrange._scene_eval(np.array([])) == {}
    assert arrange._scene_eval(np.array([[0, 0.1, 0, 0.5], [0, 0.3, 0, 0.7]]))["sceneeval_collision_pct"] == 20.0


def test_a_room_refused_when_measured_anew_has_moved(monkeypatch: pytest.MonkeyPatch) -> None:
    plan, items = steady.boxed(900_000)
    known, usual = plan.corners.copy(), steady.arrange

    def only_as_it_is(plan: Any, *args: Any, **options: Any) -> Any:
        if not np.array_equal(plan.corners, known):
            raise LayoutError("no")
        return usual(plan, set_items("bedroom")[:1], *args[1:], **options)

    monkeypatch.setattr(steady, "arrange", only_as_it_is)
    row = steady._measured(plan, items, 0)
    assert row is not None
    assert len(row["moved"]) == steady.DRAWS * len(row["scores"])
    assert np.isinf(row["moved"]).all()


def test_rigs_have_a_median_and_a_worst_of_each_figure(monkeypatch: pytest.MonkeyPatch) -> None:
    errors = iter([{"k1_err_pct": v, "k2_sigmas": v, "lux_sigmas": v} for v in (1.0, 2.0, 9.0)])
    monkeypatch.setattr(rigs, "hostile_bodies", lambda *_: {})
    monkeypatch.setattr(rigs, "rig_errors", lambda *_: next(errors))
    found, _ = rigs.rig_figures((np.zeros(1), []), (1, 2, 3), 8, 3)
    assert (found["hostile_k1_err_pct"], found["hostile_k1_worst_pct"]) == (2.0, 9.0)
    assert (found["hostile_k2_sigmas"], found["hostile_k2_sigmas_worst"]) == (2.0, 9.0)


def test_an_error_in_stops_is_the_same_up_and_down() -> None:
    """Half of the pixels are a stop darker than the others: all are half a stop off after a common scale."""
    truth = np.ones((2, 4, 3), np.float32)
    shown = truth * np.array([0.5, 0.5, 1, 1], np.float32)[None, :, None]
    geometry = Equirectangular(4, 2)
    image = RelativeImage(shown, np.full((2, 4), 0.01, np.float32), np.zeros((2, 4), np.uint8), geometry)
    error, _ = error_of(image, HostileBracket((), (), truth, moving=False))
    assert error == pytest.approx(0.5, abs=1e-4)
