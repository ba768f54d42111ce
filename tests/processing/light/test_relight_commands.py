"""daylit relight and daylit view-from on a small session made by hand."""

from __future__ import annotations

import json
import math
import re
import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import OpenEXR
import pytest
from click.testing import CliRunner
from PIL import Image

from processing.commands.relight import relight, view_from
from processing.errors import DaylightError, RelightError, ViewpointError
from processing.layout.arrange import arrange
from processing.layout.assumed import with_door
from processing.layout.items import KINDS, parse_items
from processing.layout.models.catalogue import Catalogue, write_model
from processing.layout.plan import from_room_model
from processing.pictures.display import AS_GIVEN
from processing.pictures.exr import read_exr, write_exr
from processing.pictures.images import LuminanceImage
from processing.pictures.radiance import write_radiance_hdr
from processing.relighting.relit_session import check_sky, contact_sheet, display_of_day, read_session_room
from processing.report.staging import relit_moments
from processing.running.choices import forget
from processing.sphere import Equirectangular
from station.errors import SessionNotFoundError
from station.session.session import Side
from tests.processing.finished import finish_all
from tests.processing.light.rooms import box_room
from tests.processing.relighting.lit_sessions import lit_session


@pytest.fixture(scope="module")
def session(tmp_path_factory, few_rays) -> Path:
    folder = lit_session(tmp_path_factory.mktemp("sessions") / "bedroom")
    finish_all(folder)
    return folder


def run(command, *arguments: object) -> dict:
    result = CliRunner().invoke(
        command, [*map(str, arguments), "--json"], catch_exceptions=False, standalone_mode=False
    )
    if result.exception:
        raise result.exception
    return json.loads(result.output.splitlines()[-1])


def size_of(path: Path) -> tuple[int, int]:
    with Image.open(path) as picture:
        picture.load()
        return picture.size


def test_at_the_captured_time_the_room_is_as_it_was(session) -> None:
    found = run(relight, session, "--at", "2023-05-19T19:00Z", "--rows", 64, "--quality", "draft")
    relit = read_exr(session / "relight" / "empty-2023-05-19T1500.exr")
    taken = read_exr(session / "stages" / "remove" / "empty.exr")
    assert isinstance(relit, LuminanceImage)
    ratio = relit.rgb.sum(axis=2) / np.maximum(taken.rgb.sum(axis=2), 1e-6)
    assert np.median(ratio) == pytest.approx(1, abs=0.03)
    assert relit.attributes["relit"]["time_utc"] == "2023-05-19T19:00+00:00"  # type: ignore[index]
    assert found["moments"][0]["detail_kept_share"] > 0.9
    assert found["basis"] == "made"
    assert size_of(session / "relight" / "empty-2023-05-19T1500.jpg") == (128, 64)
    # The second time the stored rays are taken, and the day goes by.
    day = run(relight, session, "--sweep", "day", "--step", "4h", "--rows", 64, "--quality", "draft")
    assert day["basis"] == "kept"
    assert [m["local_time"][-5:] for m in day["moments"]] == ["08:00", "12:00", "16:00", "20:00"]
    noon = day["moments"][1]
    assert noon["global_horizontal_lx"] > day["moments"][0]["global_horizontal_lx"]
    # The window faces south: sun at noon.
    assert noon["sunny_share"] > 0
    assert size_of(session / "relight" / "empty-2023-05-19.webp") == (128, 64)
    with Image.open(session / "relight" / "empty-2023-05-19-sheet.png") as sheet:
        said, (wide, high) = sheet.info["XML:com.adobe.xmp"], sheet.size
        assert len({tuple(p) for p in np.asarray(sheet)[-30:].reshape(-1, 3).tolist()}) > 2, "it says so at its foot"
    assert wide > 0 < high
    with Image.open(session / "relight" / "empty-2023-05-19.webp") as animation:
        assert animation.info["xmp"].decode() == said
    # Each picture says what was done to it, and names the photograph, which lies beside it.
    for data in (said.encode(), (session / "relight" / "empty-2023-05-19T1200.jpg").read_bytes()):
        for words in (b"removed digitally", b"another time", b"Unaltered original: original.jpg", b"compositeSynth"):
            assert words in data
    assert b"compositeSynthetic" not in (session / "relight" / "original.jpg").read_bytes()
    assert size_of(session / "relight" / "original.jpg") == (128, 64)


def test_another_weather_leaves_the_captured_ones_pictures_and_both_have_their_own_figures(session) -> None:
    small = ("--rows", 64, "--quality", "draft")
    captured = run(relight, session, "--sweep", "day", "--step", "6h", *small)["moments"]
    before = (session / "relight" / "empty-2023-05-19T1200.jpg").read_bytes()
    (dull,) = run(relight, session, "--at", "2023-05-19 12:00", "--weather", "overcast", *small)["moments"]
    assert (session / "relight" / "empty-2023-05-19T1200.jpg").read_bytes() == before
    assert (
        run(relight, session, "--sweep", "day", "--step", "6h", "--weather", "overcast", *small)["moments"][0] == dull
    )
    assert (session / "relight" / "empty-2023-05-19-overcast.webp").is_file()
    found = {path.name: facts for path, title, facts, _ in relit_moments(session) if title.startswith("2023-05-19 12")}
    assert found["empty-2023-05-19T1200.jpg"] == captured[0]
    assert found["empty-2023-05-19T1200-overcast.jpg"] == dull


def test_moments_of_a_room_that_has_changed_since_are_not_shown(tmp_path) -> None:
    room = lit_session(tmp_path / "bedroom")
    finish_all(room)
    run(relight, room, "--at", "2023-05-19 12:00", "--rows", 64, "--quality", "draft")
    assert len(list(relit_moments(room))) == 1
    empty = read_exr(room / "stages" / "remove" / "empty.exr")
    assert isinstance(empty, LuminanceImage)
    write_exr(room / "stages" / "remove" / "empty.exr", replace(empty, rgb=empty.rgb * np.float32(2)))
    finish_all(room)
    assert not list(relit_moments(room)), "they are of the room as it was"
    run(relight, room, "--at", "2023-05-19 14:00", "--rows", 64, "--quality", "draft")
    assert [title[11:16] for _, title, _, _ in relit_moments(room)] == ["14:00"]


def test_an_imported_session_whose_frames_have_no_time_says_what_is_taken_for_it(tmp_path) -> None:
    room = lit_session(tmp_path / "bedroom")
    finish_all(room)
    small = ("--at", "2023-05-19 12:00", "--rows", 64, "--quality", "draft")
    facts = json.loads((room / "session.json").read_text())
    assert (facts["bracket"]["mode"], facts["frames"]) == ("imported", [])
    assert any("no frame says when it was taken" in note for note in run(relight, room, *small)["notes"])
    facts["bracket"]["mode"] = "full"
    (room / "session.json").write_text(json.dumps(facts))
    assert not any("no frame says" in note for note in run(relight, room, *small)["notes"])


def test_a_heading_that_is_given_is_the_pictures_too(tmp_path) -> None:
    room, small = lit_session(tmp_path / "turned"), ("--rows", 64, "--quality", "draft")
    finish_all(room)
    for more, degrees in (((), 0), (("--heading", 90), 90)):
        run(relight, room, "--at", "2023-05-19 12:00", *small, *more)
        data = (room / "relight" / "empty-2023-05-19T1200.jpg").read_bytes()
        (said,) = re.findall(rb'PoseHeadingDegrees(?:="|>)([\d.]+)', data)
        assert float(said) == degrees


def test_another_sky(session, tmp_path) -> None:
    even = np.full((32, 64, 3), 3000.0, np.float32)
    sky = LuminanceImage(
        even, np.full((32, 64), 0.1, np.float32), np.zeros((32, 64), np.uint8), Equirectangular(64, 32), 0.1
    )
    write_exr(tmp_path / "cloudy.exr", sky)
    found = run(relight, session, "--sky", tmp_path / "cloudy.exr", "--rows", 64, "--quality", "draft")
    assert found["moments"][0]["sky_horizontal_lx"] == pytest.approx(math.pi * 3000, rel=0.01)
    assert found["moments"][0]["sunny_share"] == 0
    # Without a scale of its own, or with none that is stated, a sky says nothing in lx.
    write_exr(tmp_path / "relative.exr", replace(sky, absolute=False))
    for name, white in (("nobody", {}), ("stated", {"whiteLuminance": 30.0})):
        OpenEXR.File({"compression": OpenEXR.ZIP_COMPRESSION, **white}, {"RGB": even / 30}).write(
            str(tmp_path / f"{name}.exr")
        )
    for name in ("relative", "nobody"):
        with pytest.raises(RelightError, match="without an absolute scale"):
            run(relight, session, "--sky", tmp_path / f"{name}.exr", "--rows", 64, "--quality", "draft")
    write_radiance_hdr(tmp_path / "radiance.hdr", sky)
    for name in ("stated.exr", "radiance.hdr"):
        found = run(relight, session, "--sky", tmp_path / name, "--rows", 64, "--quality", "draft")
        assert found["moments"][0]["sky_horizontal_lx"] == pytest.approx(math.pi * 3000, rel=0.01)


def test_from_another_place(session, monkeypatch) -> None:
    # The denoiser loads torch where that is installed, which takes longer than this test.
    monkeypatch.setattr("processing.light.solver.irradiance.denoiser_available", lambda: False)
    found = run(view_from, session, "--eye", "-1,0.5,1.2", "--look", "20,-5", "--width", 96)
    assert found["seen_share"] > 0.95
    picture = read_exr(session / "views" / "empty-from--1_0.5_1.2-20_-5.exr")
    assert picture.rgb.shape == (72, 96, 3)
    assert (picture.rgb > 0).all()
    data = (session / "views" / "empty-from--1_0.5_1.2-20_-5.jpg").read_bytes()
    assert b"did not see is computer-generated" in data
    assert b"Unaltered original: original.jpg" in data
    assert (session / "views" / "original.jpg").is_file()
    run(view_from, session, "--eye", "-1,0.5,1.2", "--look", "-60, 0", "--width", 96)
    kept = sorted(path.name for path in (session / "views").glob("empty-from-*.exr"))
    assert len(kept) == 2, "another direction from there is another picture"
    with pytest.raises(ViewpointError, match="outside the room"):
        run(view_from, session, "--eye", "9,0,1")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--at", "2023-05-19T19:00Z", "--sweep", "day"), "give one of"),
        ((), "give one of"),
        (("--sky", __file__, "--site", "1,2"), "has no effect with --sky"),
        (("--at", "2023-05-19T19:00Z", "--step", "1h"), "needs --sweep"),
        (("--at", "2023-05-19T19:00Z", "--site", "north"), "LATITUDE,LONGITUDE"),
        (("--at", "2023-05-19T19:00Z", "--empty", "--staged", "1"), "cannot be combined"),
        (("--sweep", "day", "--step", "soon"), "30m or 1h"),
    ],
)
def test_requests_that_cannot_be(session, arguments, words) -> None:
    result = CliRunner().invoke(relight, [str(session), *arguments])
    assert result.exit_code == 2
    assert words in result.output


def test_what_is_not_there_is_named(session, tmp_path) -> None:
    with pytest.raises(SessionNotFoundError):
        run(relight, tmp_path, "--at", "2023-05-19T19:00Z")
    with pytest.raises(RelightError, match="no staged alternative 2"):
        run(relight, session, "--at", "2023-05-19T19:00Z", "--staged", 2)
    with pytest.raises(DaylightError, match="below the horizon"):
        run(relight, session, "--at", "2023-05-19T06:00Z", "--rows", 64)
    for bad in (
        ("--eye", "1,2"),
        ("--eye", "0,0,1", "--panorama", "--fov", "50"),
        ("--eye", "0,0,1", "--look", "0,95"),
    ):
        assert CliRunner().invoke(view_from, [str(session), *bad]).exit_code == 2


def test_without_a_picture_of_the_sky_nobody_knows_another(session, tmp_path) -> None:
    copy = Path(shutil.copytree(session, tmp_path / "copy"))
    (copy / "stages" / "materials" / "materials.json").write_text(
        '{"outdoors": "windows as they appear from inside"}', "utf-8"
    )
    with pytest.raises(RelightError, match="no picture of the sky"):
        run(relight, copy, "--at", "2023-05-19T19:00Z", "--rows", 64)


def test_a_sky_without_a_scale_is_not_called_missing() -> None:
    """A user with nine frames of the sky and no k2 was sent to capture the sky."""
    sky = SimpleNamespace(side=Side.OUTDOOR)
    room = SimpleNamespace(outdoors_measured=False, manifest=SimpleNamespace(name="hall", frames=(sky,)))
    with pytest.raises(RelightError, match=r"no picture of the sky is in cd/m2.*--k2"):
        check_sky(room)


def test_sheets_and_exposures() -> None:
    dark, light = np.full((8, 16, 3), 1.0, np.float32), np.full((8, 16, 3), 100.0, np.float32)
    day, noon = (display_of_day(AS_GIVEN, some) for some in ([dark, light], [light]))
    assert day.exposure == pytest.approx(noon.exposure)
    sheet = contact_sheet([np.zeros((8, 16, 3), np.uint8)] * 4, ["a", "b", "c", "d"])
    assert sheet.dtype == np.uint8
    assert sheet.shape[1] == 3 * (16 + 8) + 8


@pytest.fixture(scope="module")
def own_furniture(session, tmp_path_factory) -> Path:
    """A folder with one armchair, and what processing with it leaves behind."""
    folder = tmp_path_factory.mktemp("furniture")
    write_model(folder / "armchair.glb", Catalogue.builtin("mid-century").mesh("armchair"))
    stages = session / "stages"
    (stages / "arrange").mkdir(exist_ok=True)
    (stages / "render").mkdir(exist_ok=True)
    items = parse_items("armchair", {**KINDS, **Catalogue.at(folder).kinds(0)})
    found = arrange(from_room_model(with_door(box_room())[0], keep_camera_free=True), items, "tight", n=1, seed=0)
    assert found.arrangements[0].items[0].model == "armchair"
    found.write(stages / "arrange" / "arrangement.json")
    (stages / "render" / "staged.json").write_text('{"alternatives": [{"style": "scandinavian"}]}', "utf-8")
    (stages / "render" / "result.json").write_text('{"ingredients": {"files": {"furniture": "0"}}}', "utf-8")
    write_exr(stages / "render" / "staged-1.exr", read_exr(stages / "remove" / "empty.exr"))
    return folder


def test_a_room_staged_with_furniture_of_ones_own(session, own_furniture, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr("processing.light.solver.irradiance.denoiser_available", lambda: False)
    small = ("--staged", 1, "--into", tmp_path)
    at = ("--at", "2023-05-19T19:00Z", "--rows", 64, "--quality", "draft")
    with pytest.raises(RelightError, match="give the same --furniture FOLDER"):
        run(relight, session, *at, *small)
    assert run(relight, session, *at, *small, "--furniture", own_furniture)["staged"] == 1
    view = ("--eye", "0.3,0.2,1.4", "--width", 64)
    assert run(view_from, session, *view, *small)["staged"] == 1, "the session remembers the folder"
    forget(session, ["furniture"])
    with pytest.raises(RelightError, match="folder of your own"):
        run(view_from, session, *view, *small)
    assert run(view_from, session, *view, *small, "--furniture", own_furniture)["staged"] == 1
    chair = [s for s in read_session_room(session, 1, 32, own_furniture).scene.parts if "armchair" in s.name]
    assert 0.3 < np.ptp(np.concatenate([part.vertices_m[:, 2] for part in chair])) < 1.5
