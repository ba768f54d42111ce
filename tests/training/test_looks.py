"""Pictures of training views and what is done to them; only where torch is installed."""

from __future__ import annotations

import numpy as np
import pytest

from processing.segmentation.embedded import network_picture
from processing.segmentation.evidence import SceneClass
from tests.training.test_changes import BOX, columns_of, rotated
from tests.training.test_recipe import box_view, check_structure, tiles

torch = pytest.importorskip("torch", reason="torch is not installed (training/requirements.txt)")

from training.augment import Lesson, lesson, stretched, turned  # noqa: E402
from training.looks import Bank, Chance, add_foot, network_view  # noqa: E402

ROWS, COLUMNS = 64, 128
CPU = torch.device("cpu")


def chance(count: int, seed: int = 1) -> Chance:
    return Chance(count, torch.Generator().manual_seed(seed))


def lesson_of(columns: dict[str, np.ndarray]) -> Lesson:
    parts = {name: torch.from_numpy(np.asarray(columns[name]))[None].float() for name in ("ceiling_rad", "floor_rad")}
    label = torch.from_numpy(columns["label"])[None].long()
    blank = torch.zeros(1, ROWS, COLUMNS)
    return Lesson(blank[:, None].expand(-1, 3, -1, -1), label, blank, **parts, corner=torch.zeros(1, COLUMNS))


@pytest.mark.parametrize(("along", "across"), [(1.4, 1.0), (0.7, 1.3), (1.0, 1.0)])
def test_stretched_room_is_that_of_the_stretched_outline(along: float, across: float) -> None:
    turn = 0.35
    after = stretched(lesson_of(columns_of(rotated(BOX, turn))), torch.tensor([[along, across]]), torch.tensor([turn]))
    wanted = columns_of(rotated(BOX * (across, along), turn))
    for name in ("ceiling_rad", "floor_rad"):
        assert np.abs(getattr(after, name)[0].numpy() - wanted[name]).max() < np.radians(1.5)
    assert (after.label[0].numpy() == wanted["label"]).mean() > 0.985


def test_pictures_of_a_view_have_its_labels_however_they_are_moved() -> None:
    view = box_view()
    views = {name: torch.from_numpy(np.stack([getattr(view, name)] * 4)) for name in view._fields}
    made = lesson(views, Bank(tiles(), CPU), torch.Generator().manual_seed(3))
    assert made.picture.shape == (4, 3, 256, 512)
    assert float(made.picture.min()) >= 0
    assert float(made.picture.max()) <= 1
    assert float(made.picture.std()) > 0.01
    for k in range(4):
        moved = view._replace(
            label=made.label[k].numpy().astype(np.uint8),
            ceiling_rad=made.ceiling_rad[k].numpy(),
            floor_rad=made.floor_rad[k].numpy(),
        )
        check_structure(moved, slack_px=1.6)


def test_the_foot_is_labelled_where_it_is_drawn() -> None:
    light, label = torch.ones(8, 128, 256, 3), torch.zeros(8, 128, 256, dtype=torch.long)
    out, named = add_foot(light, label, torch.full((8,), 1.5), chance(8))
    changed = (out != light).any(dim=3)
    assert changed.any()
    assert (named[changed] == SceneClass.TRIPOD).all()
    assert not changed[:, :64].any()


def test_turning_and_mirroring_move_all_alike() -> None:
    line = torch.arange(8.0)
    plain = Lesson(line.expand(2, 3, 4, 8), line.expand(2, 4, 8), line.expand(2, 4, 8), *[line.expand(2, 8)] * 3)
    moved = turned(plain, chance(2))
    for k in range(2):
        assert (moved.picture[k, 0, 0] == moved.label[k, 0]).all()
        assert (moved.label[k, 0] == moved.floor_rad[k]).all()
        assert sorted(moved.corner[k].tolist()) == line.tolist()


def test_the_view_that_is_taught_is_the_one_that_the_program_shows() -> None:
    light = np.random.default_rng(4).lognormal(0, 1, (256, 512, 3)).astype(np.float32)
    shown = network_view(torch.from_numpy(light)[None])[0].numpy()
    assert np.abs(shown - network_picture(light)).max() < 0.02
