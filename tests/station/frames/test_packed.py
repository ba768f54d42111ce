"""Sessions and frames from a zip file, and archives that would do harm."""

from __future__ import annotations

import io
import stat
import zipfile
from collections.abc import Mapping
from pathlib import Path

import pytest
from PIL import Image
from PIL.TiffImagePlugin import IFDRational

from daylit import main
from drivers.errors import DaylitError
from station.errors import DiskError, IntegrityError, ManifestError, SessionExistsError, UsageError
from station.frames import packed
from station.frames.importer import ImportReport, ImportRequest
from station.session.session import Side
from station.session.store import SessionStore, load_manifest
from tests.station.session.sessions import STOPS_S, frame_record, manifest


def archive(path: Path, files: Mapping[str, bytes]) -> Path:
    with zipfile.ZipFile(path, "w") as made:
        for name, data in files.items():
            made.writestr(name, data)
    return path


def take_packed(path: Path, into: Path, **said: object) -> Path:
    return unpacked(path, into, **said)[0]


def unpacked(path: Path, into: Path, **said: object) -> tuple[Path, ImportReport | None]:
    return packed.take_packed(path, ImportRequest(path.stem, {}, into, **said))


def frame(seconds: float) -> bytes:
    exif, out = Image.Exif(), io.BytesIO()
    exif.get_ifd(0x8769)[0x829A] = IFDRational(round(1000 * seconds), 1000)
    Image.new("RGB", (64, 32), (round(200 * seconds),) * 3).save(out, "JPEG", exif=exif)
    return out.getvalue()


@pytest.fixture
def files(tmp_path: Path) -> dict[str, bytes]:
    with SessionStore.create(tmp_path / "made", manifest(name="kitchen")) as store:
        part = store.begin_frame(Side.INDOOR, 0, STOPS_S[0])
        part.write(frame(1))
        store.add_frame(frame_record(Side.INDOOR, 0, part.commit()))
        store.finish()
    root = tmp_path / "made"
    return {path.relative_to(root).as_posix(): path.read_bytes() for path in root.rglob("*") if path.is_file()}


def test_what_is_no_zip_file_or_no_folder_to_unpack_into_is_named(tmp_path: Path, files: dict[str, bytes]) -> None:
    (tmp_path / "folder.zip").mkdir()
    for name in ("misspelt.zip", "folder.zip"):
        with pytest.raises(IntegrityError, match=f"{name}: cannot be unpacked"):
            take_packed(tmp_path / name, tmp_path / "into")
    (tmp_path / "file").touch()
    with pytest.raises(DiskError, match="creating the folder"):
        take_packed(archive(tmp_path / "kitchen.zip", files), tmp_path / "file" / "below")


@pytest.mark.parametrize("deep", [True, False])
def test_a_session_is_as_it_was(tmp_path: Path, files: dict[str, bytes], deep: bool) -> None:
    """With its folder in the archive or without; what systems put beside it is left out."""
    named = files if deep else {name.partition("/")[2]: data for name, data in files.items()}
    junk = {"__MACOSX/kitchen/._session.json": b"x", ".DS_Store": b"x"}
    found = take_packed(archive(tmp_path / "a kitchen.zip", named | junk), tmp_path / "into")
    assert found.name == (next(iter(files)).partition("/")[0] if deep else "a kitchen")
    assert load_manifest(found).name == "kitchen"
    assert {path.relative_to(found).as_posix() for path in found.rglob("*") if path.is_file()} == {
        name.partition("/")[2] for name in files
    }
    with pytest.raises(SessionExistsError):
        take_packed(tmp_path / "a kitchen.zip", tmp_path / "into")
    assert [path.name for path in (tmp_path / "into").iterdir()] == [found.name], "nothing is left behind"


def test_frames_alone_are_imported(tmp_path: Path) -> None:
    frames = {f"room/{side}/{k}.jpg": frame(2.0**-k) for side in ("indoor", "outdoor") for k in range(3)}
    found = load_manifest(take_packed(archive(tmp_path / "hall.zip", frames), tmp_path / "into"))
    assert (found.name, len(found.frames), found.bracket.mode) == ("hall", 6, "imported")
    alone = {f"{k}.jpg": frame(2.0**-k) for k in range(3)}
    found = load_manifest(take_packed(archive(tmp_path / "den.zip", alone), tmp_path / "into"))
    assert {one.side for one in found.frames} == {Side.INDOOR}
    for place in ("outdoor", "Outdoor", "a day/OUTDOOR"):
        sky = archive(tmp_path / "sky.zip", {f"{place}/{name}": data for name, data in alone.items()})
        found = load_manifest(take_packed(sky, tmp_path / place))
        assert {one.side for one in found.frames} == {Side.OUTDOOR}, "a sky's folder alone is still a sky"


@pytest.mark.parametrize(
    "name", ["../evil", "/etc/evil", "a/../../evil", "a\\evil", "C:evil", "a\nb", "/".join("abcdefghij"), "a" * 300]
)
def test_nothing_is_written_elsewhere(tmp_path: Path, files: dict[str, bytes], name: str) -> None:
    with pytest.raises(IntegrityError):
        take_packed(archive(tmp_path / "x.zip", files | {name: b"evil"}), tmp_path / "into")
    assert list((tmp_path / "into").iterdir()) == []
    assert not list(tmp_path.rglob("*evil*"))


def test_links_bombs_and_damage_are_refused(
    tmp_path: Path, files: dict[str, bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    link = zipfile.ZipInfo("kitchen/indoor")
    link.external_attr = (stat.S_IFLNK | 0o777) << 16
    with zipfile.ZipFile(tmp_path / "link.zip", "w") as made:
        made.writestr(link, "/etc")
    whole = archive(tmp_path / "cut.zip", files).read_bytes()
    (tmp_path / "cut.zip").write_bytes(whole[: len(whole) // 2])
    (tmp_path / "text.zip").write_bytes(b"no archive at all")
    with zipfile.ZipFile(tmp_path / "bomb.zip", "w", zipfile.ZIP_DEFLATED) as made:
        made.writestr("a.jpg", bytes(1 << 20))
    monkeypatch.setattr(packed, "FREE_BYTES", 1 << 19)
    monkeypatch.setattr(packed, "MOST_FILES", 4)
    archive(tmp_path / "many.zip", {f"{k}.txt": b"" for k in range(5)})
    for name in ("link", "cut", "text", "bomb", "many"):
        with pytest.raises(IntegrityError):
            take_packed(tmp_path / f"{name}.zip", tmp_path / "into")
    for name, inside in (("empty", {}), ("words", {"notes.txt": b"hello"})):
        with pytest.raises(DaylitError):
            take_packed(archive(tmp_path / f"{name}.zip", inside), tmp_path / "into")
    with pytest.raises(ManifestError):
        take_packed(archive(tmp_path / "wrong.zip", {"session.json": b"{}"}), tmp_path / "into")
    assert list((tmp_path / "into").iterdir()) == []


def test_what_is_said_of_frames_in_an_archive_counts(tmp_path: Path, files: dict[str, bytes]) -> None:
    frames = {f"{k}.jpg": frame(2.0**-k) for k in range(3)} | {"z.jpg": b""}
    said = {"readings_cd_m2": (34.0,), "heading_rad": 2.0}
    session, report = unpacked(archive(tmp_path / "den.zip", frames), tmp_path / "into", **said)
    found = load_manifest(session)
    assert ([one.luminance_cd_m2 for one in found.readings], found.heading_rad) == ([34.0], 2.0)
    assert report is not None
    assert [one.name for one in report.refused] == ["z.jpg"]
    with pytest.raises(UsageError):
        take_packed(archive(tmp_path / "kitchen.zip", files), tmp_path / "sessions", **said)
    assert list((tmp_path / "sessions").iterdir()) == []


def test_the_command_lists_what_it_refuses(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = archive(tmp_path / "den.ZIP", {"0.jpg": frame(1), "1.jpg": frame(0.25), "z.jpg": b""})
    place = ["--into", str(tmp_path / "into")]
    assert main(["import", str(path), *place]) == 4
    assert "z.jpg: the file is empty" in capsys.readouterr().out
    assert main(["import", str(path), *place, "--strict"]) == 4
    assert main(["import", str(path), *place, "--indoor", str(tmp_path)]) == 2
    assert main(["import", str(path), *place, "--shutter", "1,2"]) == 2
    assert len(list((tmp_path / "into").iterdir())) == 1


@pytest.mark.parametrize("packing", [zipfile.ZIP_LZMA, zipfile.ZIP_BZIP2])
def test_what_is_no_archive_that_is_read_is_named(tmp_path: Path, packing: int) -> None:
    with zipfile.ZipFile(tmp_path / "odd.zip", "w", packing) as made:
        made.writestr("0.jpg", frame(1))
    (tmp_path / "folder.zip").mkdir()
    for name in ("odd", "folder", "none"):
        with pytest.raises(IntegrityError):
            take_packed(tmp_path / f"{name}.zip", tmp_path / "into")
