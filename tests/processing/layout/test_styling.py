"""What dresses a room: pieces enough, nothing covered, no rule broken, the same for the same seed."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from processing.layout.arrange import arrange
from processing.layout.arrangement import Arrangement, PlacedItem
from processing.layout.furniture.bench import STYLES, differing
from processing.layout.furniture.builtin import checked_size, design_of
from processing.layout.items import KINDS, ItemSpec, set_items
from processing.layout.models.catalogue import Catalogue
from processing.layout.plan import Door, FloorPlan, Hung, Window, make_plan
from processing.layout.rules import built_in_rules
from processing.layout.styling import LEVELS, styled
from processing.layout.verify import Judge, Piece

RING = [[0, 0], [4.6, 0], [4.6, 4.0], [0, 4.0]]
PLAN = make_plan(
    RING,
    doors=[Door(0, 0.2, 1.1)],
    windows=[Window(2, 1.2, 2.8, 0.9, 2.1), Hung(3, 0.5, 1.5, 1.2, 1.9, "picture")],
    ceiling_height_m=2.5,
)


@pytest.fixture(scope="module", params=["bedroom", "living", "dining"])
def solved(request: pytest.FixtureRequest) -> Arrangement:
    return arrange(PLAN, set_items(request.param), "tight", n=1).arrangements[0]


def spans(plan: FloorPlan, item: PlacedItem, edge: int) -> tuple[float, float, float, float] | None:
    """Return start, end, bottom and top of what hangs on an edge; None where it does not."""
    corner, u, _ = plan.edge(edge)
    x, y = item.t_m[0] - corner[0], item.t_m[1] - corner[1]
    along, away = x * u[0] + y * u[1], y * u[0] - x * u[1]
    if abs(away) > 0.15:
        return None
    return along - item.size_m[0] / 2, along + item.size_m[0] / 2, item.t_m[2], item.t_m[2] + item.size_m[2]


def test_a_room_gets_12_to_25_pieces_that_can_be_made(solved: Arrangement) -> None:
    counts = {level: len(styled(solved, PLAN, "scandinavian", level, 0)) for level in LEVELS}
    assert counts["none"] == 0 < counts["light"] < counts["full"]
    assert 12 <= len(solved.items) + counts["full"] <= 25
    added = styled(solved, PLAN, "classic", "full", 0)
    ids = [item.id for item in (*solved.items, *added)]
    assert len(set(ids)) == len(ids)
    for item in added:
        checked_size(item.category, item.size_m)


def test_nothing_covers_an_opening_or_what_hangs_already(solved: Arrangement) -> None:
    closed = [(d.edge, d.start_m, d.end_m, 0.0, 2.1) for d in PLAN.doors]
    closed += [(w.edge, w.start_m, w.end_m, w.sill_m, w.head_m) for w in (*PLAN.windows, *PLAN.hung)]
    hung = [i for i in styled(solved, PLAN, "classic", "full", 1) if i.category in ("art", "mirror", "curtain")]
    assert {"art", "curtain"} <= {item.category for item in hung}
    for item in hung:
        for edge, start, end, low, high in closed:
            at = spans(PLAN, item, edge)
            across = at is not None and min(at[1], end) - max(at[0], start) > 0.01
            assert not (across and min(at[3], high) - max(at[2], low) > 0.01), (item.id, edge)  # type: ignore[index]


def test_the_floor_keeps_its_rules_and_seeds_decide(solved: Arrangement) -> None:
    added = styled(solved, PLAN, "industrial", "full", 2)
    assert added == styled(solved, PLAN, "industrial", "full", 2)
    assert added != styled(solved, PLAN, "industrial", "full", 3) or len(added) < 8
    floor = [i for i in added if i.t_m[2] == 0.0 and i.category not in ("curtain",)]
    pieces = []
    for item in (*solved.items, *floor):
        spec = KINDS.get(item.category, ItemSpec(item.category, item.size_m))
        spec = replace(spec, size_m=item.size_m, base_m=item.base_m)
        pieces.append(Piece(item.id, spec, *item.t_m[:2], item.theta_rad, item.group))
    assert Judge(PLAN, built_in_rules().named("tight")).judge(pieces) == ()


def test_styles_have_designs_of_their_own() -> None:
    for number, one in enumerate(STYLES):
        assert differing(one, one) == 0.0
        assert all(differing(one, other) > 0.7 for other in STYLES[:number])


def test_a_lamp_hangs_low_over_a_table_else_above_heads_and_not_where_one_hangs(solved: Arrangement) -> None:
    assert not [i for i in styled(solved, PLAN, "classic", "light", 0) if i.category == "pendant"]
    (lamp,) = [i for i in styled(solved, PLAN, "classic", "light", 0, []) if i.category == "pendant"]
    assert lamp.base_m + lamp.size_m[2] == pytest.approx(PLAN.ceiling_height_m, abs=0.003)
    tables = [i for i in solved.items if i.category == "dining table"]
    if tables:
        assert lamp.t_m[:2] == pytest.approx(tables[0].t_m[:2])
        assert 0.6 < lamp.base_m - tables[0].size_m[2] < 0.9
    else:
        assert lamp.t_m[:2] == pytest.approx((2.3, 2.0))
        assert lamp.base_m > 2.0
    eye = replace(PLAN, keep_free=((lamp.t_m[0] + 0.6, lamp.t_m[1]),))
    above = styled(solved, eye, "classic", "light", 0, [])
    assert not [i for i in above if i.category == "pendant"], "it would fill the panorama's top"
    low = replace(PLAN, ceiling_height_m=2.15)
    assert tables or not [i for i in styled(solved, low, "classic", "light", 0, []) if i.category == "pendant"]


@pytest.mark.parametrize(("high", "lit"), [(0.5, True), (0.85, False)])
def test_a_lamp_may_stand_before_the_foot_of_a_pane_and_no_more(solved: Arrangement, high: float, lit: bool) -> None:
    """A bedside lamp of 0.44 m below a window from 0.9 m up: 4 cm before the pane, or 39."""
    beside = PlacedItem(
        id="nightstand",
        category="nightstand",
        size_m=(0.5, 0.4, high),
        base_m=0.0,
        theta_rad=math.pi,
        t_m=(2.6, 3.8, 0.0),
        edge=2,
    )
    one = solved.model_copy(update={"items": (beside,)})
    assert any(i.category == "table lamp" for i in styled(one, PLAN, "classic", "light", 0)) == lit


def test_art_hangs_over_its_host_wherever_that_was_moved() -> None:
    """A sofa that was arranged at one wall and dragged to another, or pinned there, has its picture at that one."""
    plan = make_plan([[0, 0], [5, 0], [5, 4], [0, 4]], doors=[Door(0, 0.2, 1.1)], ceiling_height_m=2.5)
    sofa = PlacedItem(
        id="sofa", category="sofa", size_m=(1.8, 0.85, 0.8), theta_rad=math.pi, t_m=(2.5, 3.5, 0.0), edge=1
    )
    one = Arrangement(rank=1, items=(sofa,), score=1.0, scores={}, rule_set="standard")
    for edge in (1, None):
        moved = one.model_copy(update={"items": (sofa.model_copy(update={"edge": edge}),)})
        (art,) = [i for i in styled(moved, plan, "classic", "light", 0) if i.category == "art" and i.t_m[2] < 1.3]
        assert spans(plan, art, 2) is not None
        assert art.t_m[0] == pytest.approx(2.5)
    free = one.model_copy(update={"items": (sofa.model_copy(update={"t_m": (2.5, 2.0, 0.0)}),)})
    assert not [i for i in styled(free, plan, "classic", "light", 0) if i.category == "art"]


def test_no_picture_hangs_where_a_ceiling_lamp_is_seen_before_the_wall() -> None:
    """A pendant that stays in the photograph would hang in front of the new picture, or grow out of it."""
    plan = make_plan([[0, 0], [5, 0], [5, 4], [0, 4]], doors=[Door(0, 0.2, 1.1)], ceiling_height_m=2.5)
    plan = replace(plan, keep_free=((2.5, 0.5),))
    sofa = PlacedItem(
        id="sofa", category="sofa", size_m=(1.8, 0.85, 0.8), theta_rad=math.pi, t_m=(2.5, 3.5, 0.0), edge=2
    )
    one = Arrangement(rank=1, items=(sofa,), score=1.0, scores={}, rule_set="standard")

    def over_sofa(*lamps: tuple[float, float]) -> list[float]:
        art = [i for i in styled(one, plan, "classic", "light", 0, lamps) if i.category in ("art", "mirror")]
        return [x for a in art if spans(plan, a, 2) for x in (a.t_m[0] - a.size_m[0] / 2, a.t_m[0] + a.size_m[0] / 2)]

    free = over_sofa()
    assert min(free) < 2.5 < max(free)
    # Half way to the wall it hides twice its 0.6 m, in the direction in which it is seen.
    for x in (2.5, 2.2):
        assert all(abs(end - (2.5 + 2 * (x - 2.5))) > 0.6 for end in over_sofa((x, 2.25)))
    assert over_sofa((0.6, 2.25)) == free, "seen before another wall"
    assert over_sofa((2.5, 1.0)) == free, "above the camera"


def test_a_floor_lamp_stands_before_no_picture() -> None:
    """Not before one that hangs there, nor before art that was hung over the sofa: its shade is at eye height."""
    sofa = PlacedItem(
        id="sofa", category="sofa", size_m=(1.8, 0.85, 0.8), theta_rad=math.pi, t_m=(2.5, 3.5, 0.0), edge=2
    )
    one = Arrangement(rank=1, items=(sofa,), score=1.0, scores={}, rule_set="standard")

    def lamp(*hung: Hung) -> list[PlacedItem]:
        ring = [[0, 0], [5, 0], [5, 4], [0, 4]]
        plan = make_plan(ring, doors=[Door(0, 0.2, 1.1)], windows=hung, ceiling_height_m=2.5)
        return [i for i in styled(one, plan, "scandinavian", "light", 0) if i.category == "floor lamp"]

    (alone,) = lamp()
    left, right = (Hung(2, 2.5 + x - 0.3, 2.5 + x + 0.3, 1.2, 1.8, "picture") for x in (-1.15, 1.15))
    (other,) = lamp(left if alone.t_m[0] > 2.5 else right)
    assert (other.t_m[0] > 2.5) != (alone.t_m[0] > 2.5)
    assert not lamp(left, right)
    assert lamp(*(replace(one, sill_m=1.7, head_m=2.2) for one in (left, right))), "it may stand below one"


def test_windows_without_room_for_curtains_get_blinds() -> None:
    """Drawn up before the top of each window of the row; not where curtains find room, or something hangs."""
    shelf = PlacedItem(id="shelf", category="bookshelf", size_m=(0.8, 0.3, 2.2), theta_rad=0.0, t_m=(0.7, 0.2, 0.0))
    one = Arrangement(rank=1, items=(shelf,), score=1.0, scores={}, rule_set="standard")
    ring = [[0, 0], [4.6, 0], [4.6, 4.0], [0, 4.0]]

    def blinds(*windows: Window, high: float = 2.6) -> list[PlacedItem]:
        plan = make_plan(ring, doors=[Door(1, 0.2, 1.1)], windows=windows, ceiling_height_m=high)
        added = styled(one, plan, "scandinavian", "light", 0)
        assert not ([i for i in added if "curtain" in i.category] and [i for i in added if i.category == "blind"])
        return [i for i in added if i.category == "blind"]

    row = Window(2, 0.15, 1.6, 0.9, 2.1), Window(2, 2.2, 3.4, 0.9, 2.1)
    found = blinds(*row)
    assert [v for i in found for v in (i.size_m[0], i.t_m[0])] == pytest.approx([1.57, 3.725, 1.32, 1.8]), (
        "they reach over the frame"
    )
    for item in found:
        assert item.base_m == pytest.approx(2.1 - 0.18)
        assert 2.1 + 0.05 < item.base_m + item.size_m[2] < 2.2
        assert 3.9 < item.t_m[1] + item.size_m[1] / 2 < 4.0
        checked_size(item.category, item.size_m)
    corner = blinds(Window(2, 0.01, 1.6, 0.9, 2.1), Window(2, 1.7, 2.5, 0.9, 2.1), Window(2, 2.6, 4.5, 0.9, 2.1))
    assert [i.size_m[0] for i in corner] == pytest.approx([1.59, 0.88, 1.98]), "no wider where there is no room"
    assert not blinds(Window(2, 1.2, 2.8, 0.9, 2.1)), "there is room for curtains"
    assert not blinds(*row, Hung(2, 0.4, 1.0, 0.95, 2.0, "curtain"))
    assert not blinds(*row, high=2.2), "nor where the ceiling begins"
    assert not blinds(Window(0, 0.4, 1.2, 0.9, 2.1)), "nor behind a high shelf"
    leaf = Hung(2, 0.0, 0.3, 0.1, 2.2, "door")
    assert len(blinds(*row, leaf)) == 1, "an open door before a window leaves the others theirs"
    leaf = replace(leaf, end_m=0.19)
    assert [i.size_m[0] for i in blinds(*row, leaf)] == pytest.approx([1.33, 1.32]), "within the frame it clears a leaf"


def test_windows_of_which_most_have_to_stay_bare_all_do() -> None:
    shelf = PlacedItem(id="shelf", category="bookshelf", size_m=(0.8, 0.3, 2.2), theta_rad=0.0, t_m=(0.7, 0.2, 0.0))
    one = Arrangement(rank=1, items=(shelf,), score=1.0, scores={}, rule_set="standard")
    free, behind = Window(2, 1.2, 2.8, 0.9, 2.1), (Window(0, 0.35, 0.65, 0.9, 2.1), Window(0, 0.75, 1.05, 0.9, 2.1))
    for windows, dressed in (((free, behind[0]), True), ((free, *behind), False)):
        plan = make_plan(RING, doors=[Door(1, 0.2, 1.1)], windows=windows, ceiling_height_m=2.6)
        added = styled(one, plan, "scandinavian", "light", 0)
        assert any("curtain" in item.category for item in added) == dressed


def test_no_two_plants_of_a_room_are_of_one_design() -> None:
    plan = make_plan([[0, 0], [6, 0], [6, 5], [0, 5]], doors=[Door(0, 0.2, 1.1)], ceiling_height_m=2.5)
    solved = arrange(plan, set_items("bedroom"), n=1).arrangements[0]
    for style in STYLES:
        plants = [i for i in (*solved.items, *styled(solved, plan, style, "full", 0)) if i.category == "plant"]
        models = [i.model if "/" in i.model else f"plant/{style}" for i in plants]
        assert len(plants) > 1
        designs = {design_of("plant", model.split("/")[1]) for model in models}
        assert len(designs) == len(plants)
        assert all(model in Catalogue.builtin() and style in model for model in models), "in the room's own finish"


def test_a_vase_does_not_stand_before_the_lens() -> None:
    table = PlacedItem(id="t", category="dining table", size_m=(1.4, 0.8, 0.74), theta_rad=0.0, t_m=(2.3, 2.0, 0.0))
    one = Arrangement(rank=1, items=(table,), score=1.0, scores={}, rule_set="standard")
    for eye, stands in (((2.3, 0.9), False), ((2.3, 0.3), True)):
        plan = make_plan(RING, doors=[Door(1, 0.2, 1.1)], keep_free=[eye], ceiling_height_m=2.6)
        added = styled(one, plan, "scandinavian", "full", 0)
        assert any(item.category == "vase" for item in added) == stands
        assert any(item.category == "bowl" for item in added), "low things may"
