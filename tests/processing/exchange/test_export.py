"""`daylit export`: what it writes, as others read it: Mitsuba's EXR reader, falsecolor, Pillow, trimesh."""

from __future__ import annotations

import json
import math
import subprocess
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

import daylit
from drivers.errors import DaylitError
from processing.errors import ParameterError
from processing.exchange.export import export, pictures_of
from processing.light.scene.scene_file import write_scene
from processing.pictures.display import AS_GIVEN
from processing.pictures.exr import write_exr
from processing.pictures.images import LuminanceImage
from processing.pictures.panorama import read_tags
from processing.pictures.radiance import write_radiance_hdr
from processing.running.choices import remember
from processing.running.runner import clean
from processing.sphere import Equirectangular, Fisheye, LensMapping
from station.session.store import load_manifest
from tests.processing.finished import finish, finish_all
from tests.processing.light.rooms import box_room, scene_of, uniform_sky
from tests.station.session.sessions import complete_session


def picture(level: float, rows: int = 48) -> LuminanceImage:
    ramp = np.linspace(0.5, 1.5, 2 * rows, dtype=np.float32) * np.float32(level)
    rgb = np.repeat(np.repeat(ramp[None, :, None], rows, 0), 3, 2)
    shape = rgb.shape[:2]
    return LuminanceImage(
        rgb, np.full(shape, 0.05, np.float32), np.zeros(shape, np.uint8), Equirectangular(2 * rows, rows), 0.02
    )


@pytest.fixture
def session(tmp_path: Path) -> Path:
    path = complete_session(tmp_path / "sessions")
    for stage, name, level in (
        ("calibrate", "indoor", 100.0),
        ("remove", "empty", 120.0),
        ("render", "staged-1", 110.0),
        ("render", "staged-2", 90.0),
    ):
        (path / "stages" / stage).mkdir(parents=True, exist_ok=True)
        write_exr(path / "stages" / stage / f"{name}.exr", picture(level))
    (path / "stages" / "materials").mkdir()
    write_scene(path / "stages" / "materials" / "scene.npz", scene_of(box_room(), uniform_sky()))
    finish_all(path)
    return path


def test_pictures_in_every_format(session: Path, tmp_path: Path) -> None:
    done = export(session, tmp_path / "out", ("jpeg", "hdr", "exr", "gltf"))
    names = {path.name.removeprefix(session.name + "_") for path in done.files}
    pictures = ("room", "empty", "staged-1", "staged-2")
    assert names == {f"{p}.{kind}" for p in pictures for kind in ("jpg", "hdr", "exr")} | {"room.glb"}
    assert len(done.files) == len(set(done.files)), "each is written, and listed, once"
    assert done.left_out == {}
    assert all(path.stat().st_size > 0 for path in done.files)
    room, staged = ((tmp_path / "out" / f"{session.name}_{p}.jpg").read_bytes() for p in ("room", "staged-1"))
    assert b"compositeSynthetic" in staged
    assert b"compositeSynthetic" not in room
    assert b"GPano" in room


def test_a_kind_that_is_none_is_named_with_all_there_are(session: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert daylit.main(["export", str(session), "--what", "x"]) == 2
    found = capsys.readouterr().err
    assert "unknown kind of file: x" in found
    assert "jpeg, hdr, exr, gltf, glare" in found


def test_a_sky_with_north_in_its_middle_says_so(session: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As `--outdoor-view equirectangular` calibrates it: the session's heading is that of the room's panorama."""
    heading = 0.7
    manifest = load_manifest(session).model_copy(update={"heading_rad": heading})
    monkeypatch.setattr("processing.exchange.export.load_manifest", lambda _: manifest)
    sky = replace(picture(5000.0), geometry=Equirectangular(96, 48, -heading))
    write_exr(session / "stages" / "calibrate" / "outdoor.exr", sky)
    finish_all(session)
    export(session, tmp_path / "out", ("jpeg",))
    seen = {name: read_tags(tmp_path / "out" / f"{session.name}_{name}.jpg").gpano for name in ("room", "sky")}
    assert float(seen["room"]["PoseHeadingDegrees"]) == pytest.approx(math.degrees(heading) % 360, abs=1e-3)
    assert float(seen["sky"]["PoseHeadingDegrees"]) == pytest.approx(0, abs=1e-3)


@pytest.mark.parametrize("url", ["", "https://example.org/7"])
def test_emptied_and_staged_ones_say_what_was_changed_and_where_the_original_is(
    session: Path, tmp_path: Path, url: str
) -> None:
    """California AB 723: whatever was altered says so, and leads to the unaltered original."""
    remember(session, {"original-url": url or None}, by="test")
    assert daylit.main(["export", str(session), "--what", "jpeg", "--into", str(tmp_path / "out")]) == 0
    beside = f"{session.name}_room.jpg"
    assert (tmp_path / "out" / beside).is_file()
    for name, words in (("empty", b"removed digitally"), ("staged-1", b"The furniture is virtual"), ("room", b"")):
        data = (tmp_path / "out" / f"{session.name}_{name}.jpg").read_bytes()
        assert words in data
        assert (f"Unaltered original: {url or beside}".encode() in data) == (name != "room")
        assert (b"compositeSynthetic" in data) == (name != "room")


def test_a_room_from_which_nothing_was_removed_does_not_say_so(session: Path, tmp_path: Path) -> None:
    (session / "stages" / "remove" / "empty.exr").unlink()
    finish(session, "remove")
    export(session, tmp_path / "out", ("jpeg",))
    data = (tmp_path / "out" / f"{session.name}_staged-1.jpg").read_bytes()
    assert b"The furniture is virtual" in data
    assert b"removed" not in data


def test_pictures_whose_light_was_left_alone_do_not_claim_it(session: Path, tmp_path: Path) -> None:
    finish(session, "remove", left_out={"lift": "shading is kept"})
    export(session, tmp_path / "out", ("jpeg",))
    for name, words in (
        ("empty", b"Furniture was removed digitally. Un"),
        ("staged-1", b"and the light recalculated. Un"),
    ):
        assert words in (tmp_path / "out" / f"{session.name}_{name}.jpg").read_bytes()


def test_what_no_jpeg_holds_is_left_out_and_the_rest_stands(
    session: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("processing.exchange.jpeg_files.LONGEST_SIDE_PX", 90)
    done = export(session, tmp_path / "out", ("jpeg", "exr"))
    assert "at most 90 pixels" in done.left_out["room.jpeg"]
    assert {path.suffix for path in done.files} == {".exr"}


def test_one_exposure_for_a_room_and_a_label_that_can_be_left_out(session: Path, tmp_path: Path) -> None:
    export(session, tmp_path / "out", ("jpeg",), label=False)
    export(session, tmp_path / "labelled", ("jpeg",))

    def codes(folder: str, name: str) -> np.ndarray:
        with Image.open(tmp_path / folder / f"{session.name}_{name}.jpg") as opened:
            return np.asarray(opened, int)

    assert codes("out", "empty").mean() > codes("out", "room").mean() > codes("out", "staged-2").mean()
    for name in ("staged-1", "empty"):
        assert np.abs(codes("out", name) - codes("labelled", name)).max() > 60
    assert np.abs(codes("out", "room") - codes("labelled", "room")).max() == 0


def test_what_radiance_cannot_show_is_left_out_with_the_reason(session: Path, tmp_path: Path) -> None:
    shape = (40, 60)
    sky = LuminanceImage(
        np.full((*shape, 3), 900, np.float32),
        np.full(shape, 0.1, np.float32),
        np.zeros(shape, np.uint8),
        Fisheye(60, 40, LensMapping.EQUIDISTANT, 30, centre_px=(28.0, 20.0)),
        0.02,
    )
    write_exr(session / "stages" / "calibrate" / "outdoor.exr", sky)
    finish(session, "calibrate")
    done = export(session, tmp_path / "out", ("hdr", "jpeg"))
    assert set(done.left_out) == {"sky.hdr"}
    assert (tmp_path / "out" / f"{session.name}_sky.jpg").exists()


def test_relative_pictures_say_so(session: Path, tmp_path: Path) -> None:
    write_exr(session / "stages" / "calibrate" / "indoor.exr", replace(picture(1.0), absolute=False))
    finish(session, "calibrate")
    export(session, tmp_path / "out", ("jpeg",))
    assert b'daylit:Units="relative"' in (tmp_path / "out" / f"{session.name}_room.jpg").read_bytes()


def test_an_upright_panorama_comes_first_and_models_are_named(session: Path, tmp_path: Path) -> None:
    write_exr(session / "stages" / "room" / "panorama.exr", picture(50.0))
    (session / "stages" / "render" / "staged-1.glb").write_bytes(b"glTF")
    finish_all(session)
    assert pictures_of(session, {})["room"].name == "panorama.exr"
    done = export(session, tmp_path / "out", ("gltf",))
    assert [path.name.rpartition("_")[2] for path in done.files] == ["room.glb", "staged-1.glb"]
    assert set(trimesh.load(done.files[0]).geometry) >= {"floor", "ceiling", "wall-0"}
    (session / "stages" / "materials" / "scene.npz").unlink()
    assert "materials" in export(session, tmp_path / "out", ("gltf",)).left_out["room.gltf"]


def test_what_cannot_be_is_refused(session: Path, tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match="unknown kind"):
        export(session, tmp_path / "out", ("usd",))
    with pytest.raises(ParameterError, match="no results"):
        export(complete_session(tmp_path / "other"), tmp_path / "out", ("jpeg",))


def test_as_a_user_meets_it(
    session: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    import processing.figures.figures as module

    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", "")
    monkeypatch.setitem(module.write_glare_views.__kwdefaults__, "size_px", 32)
    assert daylit.main(["export", str(session), "--what", "jpeg,glare,jpeg", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert len(found["files"]) == 4 + 8
    assert all(name.startswith(f"{session.name}-export/") for name in found["files"])
    assert "evalglare" in found["left_out"]
    assert daylit.main(["export", str(session), "--what", "gif"]) == 2


def test_mitsuba_reads_our_exr(tmp_path: Path) -> None:
    import mitsuba

    mitsuba.set_variant("scalar_rgb")
    image = picture(1234.5)
    image.rgb[3, 4] = (1.6e9, 0.25, 0.0)
    write_exr(tmp_path / "a.exr", image)
    bitmap = mitsuba.Bitmap(str(tmp_path / "a.exr"))
    names = [field.name for field in bitmap.struct_()]
    values = np.array(bitmap)
    read = values[..., [names.index(name) for name in ("R", "G", "B")]]
    np.testing.assert_array_equal(read, image.rgb)
    assert np.array_equal(values[..., names.index("validity")], image.validity)
    assert bitmap.metadata()["whiteLuminance"] == 1.0


def test_the_tools_that_falsecolor_is_made_of_take_our_hdr(tmp_path: Path) -> None:
    """falsecolor itself is a script that pyradiance may lack: it asks pextrem for the range, pcomb for colours."""
    pyradiance = pytest.importorskip("pyradiance", reason="an oracle of the bench extra")
    tools = Path(pyradiance.__file__).parent / "bin"
    path = tmp_path / "a.hdr"
    write_radiance_hdr(path, picture(800.0, rows=64))

    def result(*words: str) -> bytes:
        return subprocess.run([str(tools / words[0]), *words[1:]], capture_output=True, check=True, timeout=60).stdout

    lowest, highest = ([float(v) for v in line.split()[2:]] for line in result("pextrem", "-o", str(path)).splitlines())
    assert lowest[1] * 179 == pytest.approx(400, rel=0.02)
    assert highest[1] * 179 == pytest.approx(1200, rel=0.02)
    (tmp_path / "half.hdr").write_bytes(result("pcomb", "-s", "0.5", str(path)))
    _, high = (line.split()[2:] for line in result("pextrem", "-o", str(tmp_path / "half.hdr")).splitlines())
    assert float(high[1]) * 179 == pytest.approx(600, rel=0.02)
    if (tools / "falsecolor").exists():
        assert pyradiance.falsecolor(str(path), scale="1200").startswith(b"#?RADIANCE")


ALL = ("jpeg", "hdr", "exr", "gltf")
HARMS: dict[str, Callable[[Path], object]] = {
    "cut": lambda path: path.write_bytes(path.read_bytes()[: path.stat().st_size // 2]),
    "gone": Path.unlink,
}


@pytest.mark.parametrize("harm", HARMS)
@pytest.mark.parametrize("file", ["render/staged-1.exr", "calibrate/indoor.exr", "remove/empty.exr", "room/room.json"])
def test_what_is_damaged_or_missing_is_named_and_the_rest_stands(
    session: Path, tmp_path: Path, file: str, harm: str
) -> None:
    (session / "stages" / "room" / "room.json").write_text("{}")
    (session / "stages" / "stills" / "display.json").write_text(json.dumps(AS_GIVEN.to_dict()))
    finish_all(session)
    HARMS[harm](session / "stages" / file)
    done = export(session, tmp_path / "out", ("jpeg", "exr"))
    assert set(done.left_out) == {file}
    assert "daylit process" in done.left_out[file]
    lost = {"indoor": "room", "room": ""}.get(Path(file).stem, Path(file).stem)
    names = {path.stem.rpartition("_")[2] for path in done.files}
    assert names == {"room", "empty", "staged-1", "staged-2"} - {lost}


@pytest.mark.parametrize("harm", HARMS)
def test_a_damaged_model_is_not_copied(session: Path, tmp_path: Path, harm: str) -> None:
    model = session / "stages" / "render" / "staged-1.glb"
    model.write_bytes(b"glTF" * 20)
    finish(session, "render")
    HARMS[harm](model)
    done = export(session, tmp_path / "out", ("gltf",))
    assert set(done.left_out) == {"render/staged-1.glb"}
    assert not (tmp_path / "out" / f"{session.name}_staged-1.glb").exists()


@pytest.mark.parametrize("text", ["garbage", "null", "[]"])
def test_a_damaged_room_or_result_is_named(session: Path, tmp_path: Path, text: str) -> None:
    (session / "stages" / "room" / "room.json").write_text("{}")
    finish(session, "room")
    (session / "stages" / "room" / "room.json").write_text(text)
    (session / "stages" / "render" / "result.json").write_text(text)
    done = export(session, tmp_path / "out", ALL)
    assert set(done.left_out) == {"room/room.json", "render"}
    assert any(path.name.endswith("_room.glb") for path in done.files)


@pytest.mark.parametrize("text", ["garbage", "null", "[]", "{}"])
def test_a_damaged_display_is_a_typed_error(session: Path, tmp_path: Path, text: str) -> None:
    (session / "stages" / "stills" / "display.json").write_text(text)
    with pytest.raises(DaylitError, match="display"):
        export(session, tmp_path / "out", ("jpeg",))


def test_what_was_cleaned_away_is_named(session: Path, tmp_path: Path) -> None:
    (session / "stages" / "room" / "panorama.exr").write_bytes(b"upright")
    finish(session, "room")
    clean(session)
    done = export(session, tmp_path / "out", ALL)
    assert set(done.left_out) == {"remove/empty.exr", "room/panorama.exr", "materials/scene.npz", "room.gltf"}


def test_a_session_whose_every_picture_is_damaged_says_so(session: Path, tmp_path: Path) -> None:
    pictures = [path.relative_to(session / "stages") for path in session.rglob("*.exr")]
    for path in pictures:
        (session / "stages" / path).write_bytes(b"")
    done = export(session, tmp_path / "out", ("exr",))
    assert not done.files
    assert set(done.left_out) == {path.as_posix() for path in pictures}


def test_the_rooms_model_has_the_panoramas_detail(session: Path, tmp_path: Path) -> None:
    """Its walls have 220 pixels a metre where the panorama has them (here 800 / pi / distance), not the albedo's 50."""
    albedo = scene_of(box_room(), uniform_sky(), albedo=lambda _: np.full((20, 30, 3), 0.5, np.float32))
    write_scene(session / "stages" / "materials" / "scene.npz", albedo)
    write_exr(session / "stages" / "remove" / "empty.exr", picture(120.0, rows=800))
    (session / "stages" / "room" / "room.json").parent.mkdir(exist_ok=True)
    (session / "stages" / "room" / "room.json").write_text(box_room().model_dump_json())
    finish_all(session)
    done = export(session, tmp_path / "out", ("gltf",))
    wall = next(s for s in albedo.surfaces if s.name == "wall-2")
    away_m = abs(float((np.array([0.0, 0.0, box_room().camera_height_m]) - wall.origin_m) @ wall.normal))
    texture = trimesh.load(done.files[0]).geometry["wall-2"].visual.material.baseColorTexture
    assert texture.size[0] / wall.width_m == pytest.approx(min(220, 800 / np.pi / away_m), rel=0.02)
