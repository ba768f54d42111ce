"""Furniture files that mean harm or are damaged: a named error or a named correction, nothing read outside."""

from __future__ import annotations

import json
import resource
import struct
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from benchmarks.shared_data import DATA
from processing.errors import ModelFileError
from processing.layout.models.catalogue import Catalogue

TRIANGLE = struct.pack("<9f", 0, 0, 0, 1, 0, 0, 0, 1, 0)


def gltf(**changes: Any) -> dict[str, Any]:
    document: dict[str, Any] = {
        "asset": {"version": "2.0"},
        "buffers": [{"byteLength": 36}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "nodes": [{"mesh": 0}],
        "scenes": [{"nodes": [0]}],
        "scene": 0,
    }
    return {**document, **changes}


def glb(document: dict[str, Any] | bytes, data: bytes = TRIANGLE) -> bytes:
    text = document if isinstance(document, bytes) else json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(data), 0x004E4942) + data
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def refused(folder: Path, name: str, content: bytes) -> str:
    (folder / name).write_bytes(content)
    with pytest.raises(ModelFileError) as caught:
        Catalogue.at(folder).mesh(Path(name).stem)
    assert caught.value.code == "LAY-007"
    assert name in str(caught.value)
    return str(caught.value)


def test_the_plain_triangle_is_read(tmp_path: Path) -> None:
    (tmp_path / "table.glb").write_bytes(glb(gltf()))
    assert Catalogue.at(tmp_path).mesh("table").triangles == 1


def points(**changes: Any) -> list[dict[str, Any]]:
    return [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", **changes}]


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "JSON cannot be read"),
        (b"glTF", "cut off"),
        (glb(gltf())[:60], "cut off"),
        (glb(b"[" * 100_000), "JSON cannot be read"),
        (glb(b"{}"), "no glTF"),
        (glb(gltf(accessors=points(count=10**9))), "values in one"),
        (glb(gltf(accessors=points(count=2**40))), "values in one"),
        (glb(gltf(accessors=points(count=4))), "before the declared length"),
        (glb(gltf(bufferViews=[{"buffer": 0, "byteLength": 10**9}])), "before the declared length"),
        (glb(gltf(bufferViews=[{"buffer": 7, "byteLength": 3}])), "not glTF's"),
        (glb(gltf(nodes=[{"mesh": 0, "children": [1]}, {"children": [0]}])), "contain themselves"),
        (glb(gltf(nodes=[{"mesh": 0, "children": [2]}, {"children": [2]}, {"mesh": 0}])), "several parents"),
        (glb(gltf(nodes=[{"mesh": 0}] * 30_000)), "nodes; at most"),
        (glb(gltf(meshes="x")), "not glTF's"),
        (glb(gltf(extensionsRequired=["KHR_draco_mesh_compression"])), "compressed"),
        (glb(gltf(meshes=[])), "not glTF's"),
        (glb(gltf(nodes=[])), ""),
        (glb(gltf(), struct.pack("<9f", *[float("nan")] * 9)), "vertices are not numbers"),
        (glb(gltf(), struct.pack("<9f", *[0.5] * 9)), "all coincide"),
        (glb(gltf(), struct.pack("<9f", 0, 0, 0, 1, 0, 0, 2, 0, 0)), "area"),
    ],
)
def test_hostile_glb(tmp_path: Path, content: bytes, said: str) -> None:
    assert said in refused(tmp_path, "table.glb", content)


@pytest.mark.parametrize(
    "uri", ["../secret.bin", "/etc/hostname", "file:///etc/hostname", "%2e%2e/secret.bin", "C:\\x"]
)
def test_buffers_outside_are_not_read(tmp_path: Path, uri: str) -> None:
    (tmp_path / "secret.bin").write_bytes(TRIANGLE)
    inside = tmp_path / "models"
    inside.mkdir()
    text = refused(inside, "table.gltf", json.dumps(gltf(buffers=[{"byteLength": 36, "uri": uri}])).encode())
    assert "points outside the folder" in text


def test_material_files_outside_are_not_read(tmp_path: Path) -> None:
    (tmp_path / "secret.mtl").write_text("newmtl a\nKd 1 0 0\n")
    inside = tmp_path / "models"
    inside.mkdir()
    body = "mtllib ../secret.mtl\nusemtl a\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
    (inside / "table.obj").write_text(body)
    model = Catalogue.at(inside).mesh("table")
    assert any("points outside the folder" in note for note in model.notes)
    assert model.parts[0].material.base_colour[0] == model.parts[0].material.base_colour[1]


def test_links_that_lead_out_are_refused(tmp_path: Path) -> None:
    (tmp_path / "other.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    inside = tmp_path / "models"
    inside.mkdir()
    (inside / "table.obj").symlink_to(tmp_path / "other.obj")
    with pytest.raises(ModelFileError, match="points outside"):
        Catalogue.at(inside).mesh("table")


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "no vertices"),
        (b"v 0 0 0\nv 1 0 0\nv 0 1 0\n", "no faces"),
        (b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 999999999\n", "names vertex 999999999 of 3"),
        (b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 0\n", "vertex 0"),
        (b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 -4\n", "names vertex -4 of 3"),
        (b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 99999999999999999999\n", "names vertex"),
        (b"v nan 0 0\nv 1 inf 0\nv 0 1e308 0\nf 1 2 3\n", "are not numbers"),
        (b"v a b c\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", ""),
        (b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf a b c\n", "names no vertices"),
        (b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf -1.5 2 3\n", "names no vertices"),
        (b"\x00\x01\x02" * 100, "not a text file"),
        (b"v 0 0 0\nv 0 0 0\nv 0 0 0\nf 1 2 3\n", "all coincide"),
    ],
)
def test_hostile_obj(tmp_path: Path, content: bytes, said: str) -> None:
    assert said in refused(tmp_path, "table.obj", content)


def test_a_texture_that_is_a_bomb_is_left_out(tmp_path: Path) -> None:
    import zlib

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    head = chunk(b"IHDR", struct.pack(">IIBBBBB", 60_000, 60_000, 8, 2, 0, 0, 0))
    bomb = b"\x89PNG\r\n\x1a\n" + head + chunk(b"IDAT", zlib.compress(b"\0" * 1000)) + chunk(b"IEND", b"")
    (tmp_path / "big.png").write_bytes(bomb)
    (tmp_path / "table.mtl").write_text("newmtl a\nmap_Kd big.png\n")
    body = "mtllib table.mtl\nusemtl a\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n"
    (tmp_path / "table.obj").write_text(body)
    model = Catalogue.at(tmp_path).mesh("table")
    assert model.parts[0].material.texture is None
    assert any("texture" in note or "big.png" in note for note in model.notes)


READ_ALL = """
import sys
from pathlib import Path
from processing.errors import ModelFileError
from processing.layout.models.catalogue_folder import FileSource, load_model
for name in sys.argv[1:]:
    path = Path(name)
    try:
        model = load_model(FileSource(path.stem, "other", path, path.parent, ""))
        print("read", path.name, model.triangles)
    except ModelFileError as error:
        print("refused", path.name, error.code)
"""


@pytest.mark.shared("damaged")
def test_shared_damaged_files_within_limits() -> None:
    """All of them, whatever their ending, in a child with 3 GiB of addresses and 20 s of CPU time."""
    files = [
        p
        for folder in ("mesh/assimp_invalid", "handmade")
        for p in sorted((DATA / "damaged" / folder).iterdir())
        if p.is_file()
    ]

    def limits() -> None:
        resource.setrlimit(resource.RLIMIT_AS, (3 * 2**30, 3 * 2**30))
        resource.setrlimit(resource.RLIMIT_CPU, (20, 20))

    done = subprocess.run(
        [sys.executable, "-c", READ_ALL, *map(str, files)],
        capture_output=True,
        text=True,
        timeout=100,
        check=False,
        preexec_fn=limits,
        cwd=Path(__file__).resolve().parents[3],
    )
    assert done.returncode == 0, done.stderr[-2000:]
    lines = done.stdout.splitlines()
    assert len(lines) == len(files)
    assert all(line.startswith("refused") for line in lines), lines


def test_a_list_that_names_no_possible_file_is_passed_over(tmp_path: Path) -> None:
    (tmp_path / "table.glb").write_bytes(glb(gltf()))
    (tmp_path / "catalog.json").write_text(r'[{"file": "\ud800.glb", "unit": "cm"}, {"file": "a\u0000b"}]')
    assert Catalogue.at(tmp_path).mesh("table").triangles == 1
