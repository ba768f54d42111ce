"""A scene in a file (`scene.npz`): plain arrays and one JSON text, nothing that could run; the same scene, same bytes.

What it holds is in the header `scene` (version, names, numbers); arrays are named after what they belong to
(`surface-0-albedo`). Reading checks a scene as building one does, so a damaged file is a named error.
"""

import json
import zipfile
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from processing.errors import SceneError
from processing.light.scene.scene import Material, Outdoors, Pane, Part, Scene, Sun, Surface

VERSION = 1  # of the file's format, raised when it changes
MOST_BYTES = 4 << 30  # of all arrays together; a room's own take some hundred megabytes at most

Arrays = dict[str, npt.NDArray[Any]]


def write_scene(path: Path, scene: Scene) -> None:
    """Write a scene; the same scene gives the same bytes."""
    arrays: Arrays = {"outdoors-rgb": scene.outdoors.rgb}
    header = {
        "version": VERSION,
        "surfaces": [_taken(s, f"surface-{k}", arrays) for k, s in enumerate(scene.surfaces)],
        "panes": [_taken(p, f"pane-{k}", arrays) for k, p in enumerate(scene.panes)],
        "parts": [
            _taken(p, f"part-{k}", arrays) | {"material": _taken(p.material, f"part-{k}-material", arrays)}
            for k, p in enumerate(scene.parts)
        ],
        "sun": None if scene.outdoors.sun is None else _taken(scene.outdoors.sun, "sun", arrays),
    }
    arrays["scene"] = np.frombuffer(json.dumps(header, allow_nan=False).encode("utf-8"), np.uint8)
    with path.open("wb") as file:
        np.savez_compressed(file, **arrays)  # type: ignore[arg-type]


def read_scene(path: Path) -> Scene:
    """Read a scene; raise `SceneError` (or `MaterialError`) for what is none, naming the file."""
    try:
        _check_size(path)
        with path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        header = json.loads(arrays["scene"].tobytes().decode("utf-8"))
        if header["version"] != VERSION:
            raise SceneError(f"a scene of version {header['version']}", where=path.name, advice="rebuild it")
        return _scene(header, arrays)
    except (OSError, EOFError, ValueError, KeyError, TypeError, zipfile.BadZipFile, zipfile.LargeZipFile) as error:
        text = f"not a scene file: {str(error).splitlines()[0] if str(error) else type(error).__name__}"
        likely = "a damaged file, or one of another program"
        advice = "run the materials stage again (--force materials)"
        raise SceneError(text, where=path.name, likely=likely, advice=advice) from error


def _check_size(path: Path) -> None:
    with zipfile.ZipFile(path) as archive:
        whole = sum(entry.file_size for entry in archive.infolist())
    if whole > MOST_BYTES:
        raise ValueError(f"{whole / 1e9:.1f} GB of arrays")


def _taken(thing: Any, name: str, arrays: Arrays) -> dict[str, Any]:
    """Return a dataclass's plain values; its arrays go into ``arrays`` under their names."""
    plain: dict[str, Any] = {}
    for field in fields(thing):
        value = getattr(thing, field.name)
        if isinstance(value, np.ndarray):
            arrays[f"{name}-{field.name}"] = value
        elif not (field.name == "material" or value is None):
            plain[field.name] = value
    return plain


def _scene(header: dict[str, Any], arrays: Arrays) -> Scene:
    def made(kind: type, values: dict[str, Any], name: str) -> Any:
        given = {key: _tuples(value) for key, value in values.items()}
        for field in fields(kind):
            if f"{name}-{field.name}" in arrays:
                given[field.name] = arrays[f"{name}-{field.name}"]
        return kind(**given)

    def part(values: dict[str, Any], name: str) -> Part:
        material = made(Material, values["material"], f"{name}-material")
        return made(Part, {**values, "material": material}, name)  # type: ignore[no-any-return]

    sun = None if header["sun"] is None else made(Sun, header["sun"], "sun")
    return Scene(
        surfaces=tuple(made(Surface, s, f"surface-{k}") for k, s in enumerate(header["surfaces"])),
        panes=tuple(made(Pane, p, f"pane-{k}") for k, p in enumerate(header["panes"])),
        outdoors=Outdoors(arrays["outdoors-rgb"], sun),
        parts=tuple(part(p, f"part-{k}") for k, p in enumerate(header["parts"])),
    )


def _tuples(value: Any) -> Any:
    """Return lists of JSON as the tuples they were."""
    return tuple(_tuples(v) for v in value) if isinstance(value, list) else value
