from __future__ import annotations

import json
import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.shared_data import DATA
from station.errors import DaylitError, ManifestError, SchemaTooNewError, SessionNotFoundError
from station.session import strict_json
from station.session.manifest import load_manifest, manifest_bytes, parse_manifest
from station.session.session import FrameRecord, SessionManifest
from tests.station.session.sessions import complete_session, manifest

ROOT = Path(__file__).resolve().parents[3]
DAMAGED = DATA / "damaged"
SUITE = DAMAGED / "json" / "JSONTestSuite"
SHA = "0" * 64


def frame(**fields: object) -> dict[str, object]:
    record = {"side": "indoor", "stop": 0, "file": "indoor/00_4s.jpg", "size_bytes": 1, "sha256": SHA}
    return {**record, "asked_s": 4.0, "camera_s": 4.0, **fields}


def text(**fields: object) -> bytes:
    return json.dumps({**json.loads(manifest().model_dump_json()), **fields}).encode()


def test_the_schema_file_is_current() -> None:
    schema = {"$schema": "https://json-schema.org/draft/2020-12/schema", **SessionManifest.model_json_schema()}
    text = json.dumps(schema, indent=2, sort_keys=True) + "\n"
    assert (ROOT / "docs" / "schemas" / "session-1.schema.json").read_text() == text


def test_a_manifest_reads_back_as_written(tmp_path: Path) -> None:
    path = complete_session(tmp_path)
    whole = load_manifest(path)
    assert load_manifest(path / "session.json") == whole
    assert parse_manifest(manifest_bytes(whole), "x") == whole


@pytest.mark.parametrize(
    "raw",
    [
        b"",
        b"null",
        b"[]",
        b'"text"',
        b"{}",
        b"\xff\xfe",
        b"\xef\xbb\xbf{}",
        b'{"schema_version": 1',
        text(extra=1),
        text(heading_rad="north"),
        text(rig={"a": 1}).replace(b'{"a": 1}', b'{"a": NaN}'),
        text(rig={"a": 1}).replace(b'{"a": 1}', b'{"a": -Infinity}'),
        text(rig={"a": 1}).replace(b'{"a": 1}', b'{"a": 1e999}'),
        text(rig={"a": 1}).replace(b'{"a": 1}', b'{"a": ' + b"9" * 5000 + b"}"),
        text(rig={"a": 1}).replace(b'{"a": 1}', b'{"a": 0.' + b"1" * 5000 + b"}"),
        text(rig={"a": 1}).replace(b'{"a": 1}', b'{"a": 1, "a": 2}'),
        text(rig={"a": 1}).replace(b'{"a": 1}', b'{"a": "\\ud800"}'),
        text(rig={"a": 1}).replace(b'{"a": 1}', b"[" * 100_000),
        text(rig={"a": 1}).replace(b'{"a": 1}', b'{"a":' * 60 + b"1" + b"}" * 60),
        text(schema_version=0),
        text(schema_version="1"),
        text(schema_version=True),
        text(schema_version=1.5),
        text(frames=[frame(), frame()]),
        text(frames=[frame(), frame(stop=1)]),
        text(frames=[frame(), frame(stop=1, file="indoor/00_4S.JPG")]),
        text(frames=[frame(file="outdoor/00_4s.jpg")]),
        text(frames=[frame(stop=3)]),
        text(frames=[frame(size_bytes=0)]),
        text(frames=[frame(sha256="x")]),
        text(bracket={"mode": "full", "stops_s": [4.0], "sides": ["indoor"], "order": [0, 0]}),
    ],
)
def test_what_is_not_a_manifest_is_refused_with_file_and_reason(tmp_path: Path, raw: bytes) -> None:
    (tmp_path / "session.json").write_bytes(raw)
    with pytest.raises(ManifestError) as caught:
        load_manifest(tmp_path)
    assert caught.value.where == str(tmp_path / "session.json")
    assert len(caught.value.message) > 5


@pytest.mark.parametrize(
    "file",
    [
        "../../../etc/passwd",
        "/etc/passwd",
        "indoor/../../x",
        "indoor/a/b",
        "indoor/",
        "indoor/.hidden",
        "indoor/..",
        "indoor/a\0b",
        "indoor/a\nb",
        "indoor/a.jpg\n",
        "\\\\server\\share",
        "C:\\x",
        "indoor/" + "x" * 5000,
        "indoor/ü.jpg",
        "CON",
    ],
)
def test_paths_that_lead_elsewhere_are_refused(file: str) -> None:
    with pytest.raises(ManifestError, match=r"frames\.0\.file"):
        parse_manifest(text(frames=[frame(file=file)]), "session.json")


def test_a_newer_schema_is_reported_as_such() -> None:
    with pytest.raises(SchemaTooNewError, match="schema 2"):
        parse_manifest(text(schema_version=2, something_new=True), "session.json")


def test_too_large_a_file_is_refused_unread(tmp_path: Path) -> None:
    with (tmp_path / "session.json").open("wb") as file:
        file.truncate(1 << 40)
    with pytest.raises(ManifestError, match="larger than"):
        load_manifest(tmp_path)


def test_a_pipe_a_folder_or_nothing_in_its_place(tmp_path: Path) -> None:
    with pytest.raises(SessionNotFoundError):
        load_manifest(tmp_path)
    with pytest.raises(SessionNotFoundError):
        load_manifest(tmp_path / "none" / "at" / "all")
    os.mkfifo(tmp_path / "session.json")
    with pytest.raises(ManifestError, match="not a regular file"):
        load_manifest(tmp_path)
    (tmp_path / "session.json").unlink()
    (tmp_path / "session.json").mkdir()
    with pytest.raises(ManifestError):
        load_manifest(tmp_path)


@pytest.mark.parametrize("unit", [b'"', b'\\"', b'"\\', b"[", b"{", b'[{"', b"]", b'"\\"'])
def test_the_scan_for_depth_is_linear(unit: bytes) -> None:
    """A quadratic scan of these 4 MB would not end before the time limit of the test run."""
    raw = (unit * (4 << 20))[: 4 << 20]
    with pytest.raises(strict_json.StrictJsonError):
        strict_json.loads(raw)


@given(
    st.recursive(
        st.none() | st.booleans() | st.integers(-(10**18), 10**18) | st.text('ab\\"[]{}é'),
        lambda inner: st.lists(inner) | st.dictionaries(st.text('ab"\\['), inner),
    )
)
def test_plain_json_goes_through(value: object) -> None:
    assert strict_json.loads(json.dumps(value).encode()) == value
    assert strict_json.loads(json.dumps(value, ensure_ascii=False).encode()) == value


@given(st.binary(max_size=200), st.integers(0, 10_000))
def test_damaged_bytes_never_escape_the_typed_errors(junk: bytes, position: int) -> None:
    raw = text(frames=[frame()])
    position %= len(raw)
    try:
        found = parse_manifest(raw[:position] + junk + raw[position + len(junk) :], "session.json")
    except DaylitError:
        return
    assert isinstance(found, SessionManifest)


@pytest.mark.shared("damaged/json/JSONTestSuite")
def test_the_json_test_suite() -> None:
    counts = {"y": 0, "n": 0, "i": 0}
    for file in sorted(SUITE.iterdir()):
        raw, kind = file.read_bytes(), file.name[0]
        counts[kind] += 1
        try:
            strict_json.loads(raw)
            accepted = True
        except strict_json.StrictJsonError:
            accepted = False
        if kind == "n":
            assert not accepted, file.name
        if kind == "y" and not accepted:
            assert file.name.startswith("y_object_duplicated_key"), file.name
        with pytest.raises(ManifestError):
            parse_manifest(raw, file.name)
    assert counts["n"] > 50
    assert counts["y"] > 20


@pytest.mark.shared("damaged/handmade")
def test_the_handmade_hostile_json() -> None:
    files = sorted((DAMAGED / "handmade").glob("*.json"))
    assert files
    for file in files:
        with pytest.raises(ManifestError):
            load_manifest(file)
    listed = json.loads((DAMAGED / "handmade" / "manifest_traversal.json").read_bytes())
    assert listed["files"]
    for entry in listed["files"]:
        with pytest.raises(ManifestError):
            parse_manifest(text(frames=[frame(file=entry["path"])]), "session.json")
        with pytest.raises(ValueError, match="file"):
            FrameRecord.model_validate(frame(file=entry["path"]))
