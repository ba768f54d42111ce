"""Sessions from plain folders: what is good gets in, what is not is named, and the folders stay as they are."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

import pytest
from click.testing import CliRunner
from PIL import Image

import daylit
from benchmarks.shared_data import DATA
from station.commands.sessions import import_session as command
from station.commands.sessions import parse_zone
from station.errors import FrameRejectedError, IncompleteBracketError, SessionNotFoundError, UsageError
from station.frames.check import FrameChecker
from station.frames.importer import ImportReport, ImportRequest, import_session
from station.session.session import SessionStatus, Side
from station.session.store import load_manifest
from station.session.verify import verify_session
from tests.station.frames.pictures import dng, exif, jpeg

TIMES_S = (1 / 60, 4.0, 1.0, 1 / 15, 1 / 4)
"""In the order of the file names: not the order of the stops."""


@pytest.fixture(scope="module")
def checker() -> Iterator[FrameChecker]:
    with FrameChecker() as worker:
        yield worker


@pytest.fixture
def room(tmp_path: Path) -> Path:
    return fill(tmp_path / "room")


def fill(folder: Path, **options: object) -> Path:
    folder.mkdir()
    for i, time_s in enumerate(TIMES_S):
        (folder / f"IMG_{i}.JPG").write_bytes(jpeg(time_s, **options))
    return folder


def state(folder: Path) -> dict[str, tuple[str, int, int]]:
    """Return digest, time of change and mode of every file."""
    return {
        p.name: (hashlib.sha256(p.read_bytes()).hexdigest(), p.stat().st_mtime_ns, p.stat().st_mode)
        for p in folder.iterdir()
        if p.is_file()
    }


def run(tmp_path: Path, checker: FrameChecker, **options: object) -> ImportReport:
    """Import and check what holds for every import: folders unchanged, session sound."""
    request = ImportRequest(**{"room": "A room", "into": tmp_path / "sessions", **options})
    before = {side: state(folder) for side, folder in request.folders.items()}
    report = import_session(request, checker=checker)
    assert {side: state(folder) for side, folder in request.folders.items()} == before
    found = verify_session(report.session)
    assert not found.problems
    assert load_manifest(report.session) == report.manifest
    return report


def refusals(report: ImportReport) -> dict[str, str]:
    return {r.name: r.reason for r in report.refused}


def test_names_that_are_no_text(tmp_path: Path, checker: FrameChecker, room: Path) -> None:
    """A room's name in Latin-1 is refused; files with such names are not."""
    with pytest.raises(UsageError, match="not in UTF-8"):
        run(tmp_path, checker, folders={Side.INDOOR: room}, room="caf\udce9")
    (room / "IMG_0.JPG").rename(room / "caf\udce9.JPG")
    (room / "notes\udce9.txt").touch()
    report = run(tmp_path, checker, folders={Side.INDOOR: room})
    assert len(report.manifest.frames) == len(TIMES_S)
    assert report.ignored == ("indoor/notes?.txt",)


def test_a_whole_bracket(tmp_path, checker, room):
    report = run(tmp_path, checker, folders={Side.INDOOR: room}, readings_cd_m2=(34.63, 33.0))
    manifest = report.manifest
    assert manifest.status is SessionStatus.COMPLETE
    assert manifest.bracket.mode == "imported"
    assert manifest.bracket.stops_s == pytest.approx(sorted(TIMES_S, reverse=True))
    assert [(f.stop, f.camera_name) for f in manifest.frames] == [
        (0, "IMG_1.JPG"),
        (1, "IMG_2.JPG"),
        (2, "IMG_4.JPG"),
        (3, "IMG_3.JPG"),
        (4, "IMG_0.JPG"),
    ]
    for frame in manifest.frames:
        assert (report.session / frame.file).read_bytes() == (room / frame.camera_name).read_bytes()
        assert frame.statistics is not None
    assert [r.status for r in manifest.readings] == ["typed", "typed"]
    assert manifest.drift_frac == pytest.approx(33 / 34.63 - 1)
    (device,) = manifest.devices
    assert (device.model, device.serial, device.kind) == ("Canon EOS 5D Mark II", "0123456789", "imported")


def test_times_from_the_command_line_in_file_order(tmp_path, checker):
    room = fill(tmp_path / "room", with_exif=False)
    assert set(refusals_only(tmp_path, checker, room)) == {f"IMG_{i}.JPG" for i in range(5)}
    report = run(tmp_path, checker, folders={Side.INDOOR: room}, shutter_s=TIMES_S)
    assert report.manifest.status is SessionStatus.COMPLETE
    assert {f.camera_name: f.camera_s for f in report.manifest.frames} == {
        f"IMG_{i}.JPG": time_s for i, time_s in enumerate(TIMES_S)
    }
    with pytest.raises(UsageError, match="4 exposure times for 5 JPEGs"):
        run(tmp_path, checker, folders={Side.INDOOR: room}, shutter_s=TIMES_S[:4])


def refusals_only(tmp_path: Path, checker: FrameChecker, room: Path) -> list[str]:
    with pytest.raises(IncompleteBracketError) as caught:
        run(tmp_path, checker, folders={Side.INDOOR: room})
    assert not (tmp_path / "sessions").exists(), "no session without frames"
    return [line.partition("/")[2].partition(":")[0] for line in caught.value.details["refused"]]


def test_typed_times_that_contradict_exif_are_named(tmp_path, checker, room):
    typed = (1 / 60, 4.0, 1 / 2, 1 / 15, 1 / 4)
    report = run(tmp_path, checker, folders={Side.INDOOR: room}, shutter_s=typed)
    assert refusals(report) == {"IMG_2.JPG": "wrong_exposure"}
    assert report.manifest.status is SessionStatus.PARTIAL


def test_bad_files_are_named_and_the_rest_goes_on(tmp_path, checker, room):
    data = (room / "IMG_2.JPG").read_bytes()
    (room / "IMG_2.JPG").write_bytes(data[: len(data) // 2])
    (room / "page.jpg").write_text("<html>not found</html>")
    (room / "notes.txt").write_text("lens: 8 mm")
    (room / "sub").mkdir()
    report = run(tmp_path, checker, folders={Side.INDOOR: room})
    assert refusals(report) == {"IMG_2.JPG": "truncated", "page.jpg": "not_jpeg"}
    assert set(report.ignored) == {"indoor/notes.txt", "indoor/sub"}
    assert len(report.manifest.frames) == 4
    assert report.manifest.status is SessionStatus.PARTIAL
    assert any("IMG_2.JPG" in line for line in report.manifest.missing)
    assert any("notes.txt" in w.message for w in report.manifest.warnings)


def test_a_partial_import_is_not_to_be_resumed_but_imported_again(
    tmp_path: Path, checker: FrameChecker, room: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (room / "bad.jpg").write_bytes(b"junk")
    report = run(tmp_path, checker, folders={Side.INDOOR: room})
    assert daylit.main(["verify", str(report.session)]) == 4
    said = capsys.readouterr().out
    assert "what to do: complete it: import it again" in said
    assert "--resume" not in said


def test_a_refused_file_of_known_time_is_the_missing_stop(tmp_path, checker):
    room = fill(tmp_path / "room", with_exif=False)
    (room / "IMG_1.JPG").write_bytes(b"\0" * 1000)
    report = run(tmp_path, checker, folders={Side.INDOOR: room}, shutter_s=TIMES_S)
    assert report.manifest.missing == ("indoor: stop 0 (4 s)",)
    assert report.manifest.rejected[0].stop == 0


def test_strict_makes_no_session(tmp_path, checker, room):
    (room / "IMG_2.JPG").write_bytes(b"\xff\xd8\xff")
    (room / "IMG_3.JPG").write_bytes(b"")
    with pytest.raises(FrameRejectedError, match="and 1 more") as caught:
        run(tmp_path, checker, folders={Side.INDOOR: room}, strict=True)
    assert len(caught.value.details["refused"]) == 2
    assert not (tmp_path / "sessions").exists()


def test_duplicates_equal_times_and_strangers_are_named(tmp_path, checker, room):
    (room / "copy.jpg").write_bytes((room / "IMG_4.JPG").read_bytes())
    (room / "later.jpg").write_bytes(jpeg(1 / 4, seed=2))
    (room / "small.jpg").write_bytes(jpeg(1 / 8, size=(80, 60)))
    (room / "phone.jpg").write_bytes(jpeg(1 / 30, MODEL="Phone"))
    (room / "iso.jpg").write_bytes(jpeg(1 / 125, ISO=400))
    (room / "aperture.jpg").write_bytes(jpeg(1 / 500, F_NUMBER=11.0))
    report = run(tmp_path, checker, folders={Side.INDOOR: room})
    assert refusals(report) == {
        "copy.jpg": "repeated",
        "later.jpg": "repeated",
        "small.jpg": "wrong_size",
        "phone.jpg": "wrong_camera",
        "iso.jpg": "wrong_iso",
        "aperture.jpg": "wrong_f_number",
    }
    assert len(report.manifest.frames) == 5


def test_a_double_costs_nothing(tmp_path, checker, room):
    (room / "zcopy.jpg").write_bytes((room / "IMG_4.JPG").read_bytes())
    report = run(tmp_path, checker, folders={Side.INDOOR: room})
    assert refusals(report) == {"zcopy.jpg": "repeated"}
    assert report.manifest.status is SessionStatus.COMPLETE


def test_a_swapped_time_shows_in_the_brightness(tmp_path, checker):
    room = fill(tmp_path / "room", with_exif=False)
    typed = (1 / 60, 1.0, 4.0, 1 / 15, 1 / 4)
    report = run(tmp_path, checker, folders={Side.INDOOR: room}, shutter_s=typed)
    assert set(refusals(report).values()) == {"out_of_order"}
    assert set(refusals(report)) <= {"IMG_1.JPG", "IMG_2.JPG"}
    assert report.manifest.status is SessionStatus.PARTIAL


def test_two_sides_share_stops_and_may_have_their_own(tmp_path, checker, room):
    sky = tmp_path / "sky"
    sky.mkdir()
    for i, time_s in enumerate((1 / 16, 1 / 64, 1 / 1000)):
        (sky / f"{i}.jpeg").write_bytes(jpeg(time_s, seed=3))
    report = run(tmp_path, checker, folders={Side.INDOOR: room, Side.OUTDOOR: sky})
    manifest = report.manifest
    assert manifest.status is SessionStatus.COMPLETE
    assert len(manifest.bracket.stops_s) == 6
    assert [f.stop for f in manifest.frames if f.side is Side.OUTDOOR] == [3, 4, 5]
    assert {(s.side, s.stop) for s in manifest.skipped} == {
        (Side.INDOOR, 5),
        (Side.OUTDOOR, 0),
        (Side.OUTDOOR, 1),
        (Side.OUTDOOR, 2),
    }


def test_the_moment_is_known_where_the_zone_is(tmp_path, checker, room):
    report = run(tmp_path, checker, folders={Side.INDOOR: room})
    assert {f.taken_utc for f in report.manifest.frames} == {None}
    report = run(tmp_path, checker, folders={Side.INDOOR: room}, camera_zone=-240)
    assert report.manifest.frames[0].taken_utc == datetime(2023, 5, 19, 19, 54, 10, tzinfo=UTC)
    report = run(tmp_path, checker, folders={Side.INDOOR: room}, camera_zone=parse_zone("America/New_York"))
    assert report.manifest.frames[0].taken_utc == datetime(2023, 5, 19, 19, 54, 10, tzinfo=UTC), "by name, in summer"


@pytest.mark.parametrize("year", ["0001", "9999"])
def test_a_date_at_the_calendars_end_is_none(tmp_path, checker, year):
    room = fill(tmp_path / year, TAKEN_TAG=f"{year}:{'01:01 00:00:00' if year == '0001' else '12:31 23:59:59'}")
    for zone in (-840, 840):
        report = run(tmp_path, checker, folders={Side.INDOOR: room}, camera_zone=zone)
        assert {f.taken_utc for f in report.manifest.frames} == {None}


def test_a_camera_whose_clock_was_reset_is_noticed_by_the_others(tmp_path, checker, room):
    """A battery change sends old cameras back to their first year: dates and the sun's place would be of then."""
    zone = {"camera_zone": -240}
    for name, taken, warned in (("reset", "2008:01:01 00:03:10", True), ("true", "2023:05:19 15:58:00", False)):
        sky = fill(tmp_path / name, TAKEN_TAG=taken)
        report = run(tmp_path, checker, folders={Side.INDOOR: room, Side.OUTDOOR: sky}, **zone)
        said = [w.message for w in report.manifest.warnings if w.code == "clocks_apart"]
        assert len(said) == warned, said
        assert all("5617 days" in text for text in said)


def test_adobe_rgb_without_a_profile_is_noted(tmp_path, checker):
    folder = fill(tmp_path / "adobe")
    block = exif(TIMES_S[0])
    block.get_ifd(0x8769)[0xA001] = 65535
    block.get_ifd(0x8769)[0xA005] = {1: "R03", 2: b"0100"}
    with Image.open(folder / "IMG_0.JPG") as plain:
        plain.save(folder / "IMG_0.JPG", exif=block, quality=95)
    report = run(tmp_path, checker, folders={Side.INDOOR: folder})
    said = [w.message for w in report.manifest.warnings if "Adobe RGB" in w.message]
    assert [text.partition(":")[0] for text in said] == ["indoor/IMG_0.JPG"]


def test_hostile_names_are_text(tmp_path, checker, room):
    name = "a\x1b[31m\n.jpg" if os.name == "posix" else "a.jpg"
    (room / "IMG_0.JPG").rename(room / name)
    report = run(tmp_path, checker, folders={Side.INDOOR: room})
    assert {Path(f.file).name for f in report.manifest.frames} == {
        "00_4s.jpg",
        "01_1s.jpg",
        "02_1-4s.jpg",
        "03_1-15s.jpg",
        "04_1-60s.jpg",
    }
    assert all(f.camera_name.isprintable() for f in report.manifest.frames)


@pytest.mark.skipif(os.name != "posix", reason="links need a privilege elsewhere")
def test_links_to_files_are_read_and_broken_ones_named(tmp_path, checker, room):
    links = tmp_path / "links"
    links.mkdir()
    for path in sorted(room.iterdir()):
        (links / path.name).symlink_to(path)
    (links / "gone.jpg").symlink_to(tmp_path / "nowhere.jpg")
    report = run(tmp_path, checker, folders={Side.INDOOR: room})
    linked = import_session(
        ImportRequest(room="A room", into=tmp_path / "sessions", folders={Side.INDOOR: links}), checker=checker
    )
    assert refusals(linked) == {"gone.jpg": "not_a_file"}
    assert [f.sha256 for f in linked.manifest.frames] == [f.sha256 for f in report.manifest.frames]


def test_a_file_that_changes_under_the_import_does_not_count(tmp_path, room):
    class Meddler(FrameChecker):
        """Changes the last file once everything has been looked at."""

        def inspect(self, path: Path, **options: object):
            facts = super().inspect(path, **options)
            if path.name == "IMG_4.JPG":
                path.write_bytes(jpeg(1 / 4, seed=9))
            return facts

    with Meddler() as checker:
        request = ImportRequest(room="A room", into=tmp_path / "sessions", folders={Side.INDOOR: room})
        report = import_session(request, checker=checker)
    assert [r.name for r in report.refused] == ["IMG_4.JPG"]
    assert report.manifest.missing == ("indoor: stop 2 (1/4 s)",)
    assert not verify_session(report.session).problems


def test_folders_that_cannot_be_imported(tmp_path, checker):
    with pytest.raises(UsageError):
        run(tmp_path, checker, folders={})
    with pytest.raises(SessionNotFoundError):
        import_session(
            ImportRequest(room="r", into=tmp_path, folders={Side.INDOOR: tmp_path / "none"}), checker=checker
        )
    many = tmp_path / "many"
    many.mkdir()
    for i in range(100):
        (many / f"{i}.jpg").touch()
    with pytest.raises(UsageError, match="100 pictures"):
        run(tmp_path, checker, folders={Side.INDOOR: many})


def invoke(*arguments: str) -> tuple[int, str]:
    result = CliRunner().invoke(command, list(arguments), standalone_mode=False)
    if result.exception is not None:
        raise result.exception
    return int(result.return_value), result.output


def test_the_command(tmp_path, room):
    into = str(tmp_path / "sessions")
    options = ["--site", "40.44,-79.99", "--heading", "-90", "--target", "10,-5", "--zone", "-04:00"]
    code, output = invoke("room", "--indoor", str(room), "--reading", "34.63", "--into", into, *options, "--json")
    assert code == 0
    answer = json.loads(output)
    assert answer["ok"]
    assert answer["frames"] == 5
    manifest = load_manifest(Path(answer["session"]))
    assert manifest.heading_rad == pytest.approx(4.712389)
    assert (manifest.site.latitude_deg, manifest.site.longitude_deg) == (40.44, -79.99)
    assert manifest.target is not None
    assert manifest.readings_planned == 1
    (room / "IMG_0.JPG").write_bytes(b"nothing")
    code, output = invoke("room", "--indoor", str(room), "--into", into)
    assert code == 4
    assert "IMG_0.JPG: not a JPEG" in output
    assert "partial" in output


@pytest.mark.parametrize(
    "options",
    [["--site", "here"], ["--zone", "Mars/Olympus"], ["--target", "1"], ["--shutter", "4,x"], ["--site", "91,0"]],
)
def test_options_that_say_nothing_are_refused(tmp_path, room, options):
    with pytest.raises(UsageError):
        invoke("room", "--indoor", str(room), "--into", str(tmp_path / "s"), *options)
    assert not (tmp_path / "s").exists()


def test_the_address_is_what_people_call_the_place(tmp_path, room, capsys):
    where = ("--site", "40.44,-79.99", "--address", "7 Elm Street, Pittsburgh")
    assert daylit.main(["import", "r", "--indoor", str(room), "--into", str(tmp_path / "s"), *where, "--json"]) in (
        0,
        4,
    )
    (session,) = (tmp_path / "s").iterdir()
    site = load_manifest(session).site
    assert (site.name, site.latitude_deg) == ("7 Elm Street, Pittsburgh", 40.44)
    with pytest.raises(UsageError):
        invoke("room", "--dataset", str(room), "--address", "here")


def test_errors_of_the_command_are_json_where_asked(tmp_path, capsys):
    (tmp_path / "empty").mkdir()
    code = daylit.main(["import", "r", "--indoor", str(tmp_path / "empty"), "--into", str(tmp_path), "--json"])
    assert code == 4
    assert json.loads(capsys.readouterr().out)["error"]["kind"] == "IncompleteBracketError"


@pytest.mark.shared("brackets/canon5d2_8mm_bracket", "brackets/room_t2i")
@pytest.mark.parametrize(
    ("name", "stops_s"),
    [
        ("canon5d2_8mm_bracket", (13, 3.2, 0.8, 1 / 5, 1 / 20, 1 / 80, 1 / 320, 1 / 1250, 1 / 5000)),
        ("room_t2i", (2, 1 / 2, 1 / 8, 1 / 30, 1 / 125, 1 / 1000, 1 / 4000)),
    ],
)
def test_real_brackets(tmp_path, checker, name, stops_s):
    report = run(tmp_path, checker, folders={Side.INDOOR: DATA / "brackets" / name})
    assert report.manifest.status is SessionStatus.COMPLETE
    assert report.manifest.bracket.stops_s == pytest.approx(stops_s)
    assert report.refused == ()


@pytest.mark.parametrize("words", [("--reading", "nan"), ("--heading", "nan"), ("--reading", "inf")])
def test_a_number_that_is_none_makes_no_session(tmp_path: Path, room: Path, words: tuple[str, ...]) -> None:
    into = tmp_path / "sessions"
    assert daylit.main(["import", "r", "--indoor", str(room), "--into", str(into), *words]) == 2
    assert not into.exists()


def test_typed_times_need_names_that_sort_in_one_way(tmp_path, checker):
    """IMG_10 is before IMG_9 by letters, and behind it by number: the times would go to the wrong frames."""
    folder = tmp_path / "counted"
    folder.mkdir()
    for number, time_s in zip(range(9, 12), (4.0, 1.0, 1 / 4), strict=True):
        (folder / f"IMG_{number}.jpg").write_bytes(jpeg(time_s, with_exif=False))
    with pytest.raises(UsageError, match=r"IMG_10\.jpg or IMG_9\.jpg"):
        run(tmp_path, checker, folders={Side.INDOOR: folder}, shutter_s=(4.0, 1.0, 0.25))
    (folder / "IMG_9.jpg").rename(folder / "IMG_09.jpg")
    report = run(tmp_path, checker, folders={Side.INDOOR: folder}, shutter_s=(4.0, 1.0, 0.25))
    assert not report.refused


def test_a_link_to_itself_is_refused_by_name(tmp_path, checker, room):
    (room / "round.jpg").symlink_to("round.jpg")
    report = run(tmp_path, checker, folders={Side.INDOOR: room})
    assert refusals(report) == {"round.jpg": "not_a_file"}


@pytest.mark.parametrize(
    ("with_exif", "typed", "raw_s", "wrong"),
    [(True, (), 4.0, {"1.dng"}), (False, (4.0, 1.0), 0.25, {"0.dng", "1.dng"})],
)
def test_a_raw_file_of_another_exposure_is_not_taken_for_the_jpegs(tmp_path, checker, with_exif, typed, raw_s, wrong):
    """It would be merged in its place, with its time; also where only the raw file still has EXIF."""
    (folder := tmp_path / "both").mkdir()
    for number, time_s in enumerate((4.0, 1.0)):
        (folder / f"{number}.jpg").write_bytes(jpeg(time_s, with_exif=with_exif))
        (folder / f"{number}.dng").write_bytes(dng(raw_s))
    report = run(tmp_path, checker, folders={Side.INDOOR: folder}, shutter_s=typed)
    assert refusals(report) == dict.fromkeys(wrong, "wrong_exposure")
    assert {f.camera_name for f in report.manifest.frames} == {"0.jpg", "1.jpg", "0.dng", "1.dng"} - wrong


@pytest.mark.parametrize("side", list(Side))
def test_frames_of_a_room_that_must_be_rotated_are_refused(tmp_path, checker, side):
    """Frames are taken as they lie, so that a room would stand on its head; of a sky the tag says nothing."""
    folder = fill(tmp_path / "turned")
    (folder / "IMG_0.JPG").write_bytes(jpeg(TIMES_S[0], ORIENTATION=3))
    report = run(tmp_path, checker, folders={side: folder})
    assert refusals(report) == ({"IMG_0.JPG": "unsupported"} if side is Side.INDOOR else {})


def test_what_phones_put_behind_a_picture_and_its_profile_are_noted(tmp_path, checker):
    adobe = b"\0" * 128 + b"Adobe RGB (1998)"
    folder = fill(tmp_path / "phone", icc_profile=adobe)
    for path in folder.iterdir():
        path.write_bytes(
            path.read_bytes() + b"\0\0\1\x0a\x0e\0\0\0Image_UTC_Data1684511640000SEFH" + b"\1" * 20 + b"SEFT"
        )
    report = run(tmp_path, checker, folders={Side.INDOOR: folder})
    assert not report.refused
    said = [w.message for w in report.manifest.warnings if w.code == "frame_note"]
    assert sum("profile is not sRGB's" in text for text in said) == len(TIMES_S)
    assert sum("a trailer after the picture" in text for text in said) == len(TIMES_S)
