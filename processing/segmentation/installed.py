"""Networks of others that daylit knows: pinned by name, size and SHA-256, and never fetched without being asked.

They are kept in the user's data folder (``DAYLIT_MODELS`` names another), with their licences' names in the list. A
file counts as installed only where its size and digest are those of the list. Without any of them daylit works with
its own network.
"""

from __future__ import annotations

import os
import shutil
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from processing.errors import ModelError
from processing.ground.tables import table_of
from station.session.folder import file_sha256

if TYPE_CHECKING:
    from processing.segmentation.segmenters import TfliteSegmenter

DOWNLOAD_TIMEOUT_S = 30.0  # without a byte, after which a download is given up (chosen)


class KnownModel(NamedTuple):
    """A network that can be had, and how it is read."""

    name: str
    file: str
    url: str
    size_bytes: int
    sha256: str
    licence: str
    what: str


ADE20K_DEEPLAB = KnownModel(**table_of(__package__, "networks")["ade20k-deeplab"])
KNOWN_MODELS = (ADE20K_DEEPLAB,)


def models_folder() -> Path:
    """Return where models are kept: ``DAYLIT_MODELS``, or the user's data folder."""
    import platformdirs

    asked = os.environ.get("DAYLIT_MODELS")
    return Path(asked) if asked else platformdirs.user_data_path("daylit") / "models"


def model_named(name: str) -> KnownModel:
    """Return a model of the list; `ModelError` names those there are."""
    for model in KNOWN_MODELS:
        if model.name == name:
            return model
    raise ModelError(f"no such model: {name!r}", advice=f"models: {', '.join(one.name for one in KNOWN_MODELS)}")


def installed(model: KnownModel = ADE20K_DEEPLAB) -> Path | None:
    """Return a model's file if it is there and whole, else None."""
    path = models_folder() / model.file
    try:
        state = path.stat()
    except OSError:
        return None
    return path if state.st_size == model.size_bytes and _digest(path, state.st_mtime_ns) == model.sha256 else None


@lru_cache(maxsize=16)
def _digest(path: Path, _changed_ns: int) -> str:
    return file_sha256(path)


def add_model(path: Path) -> tuple[KnownModel, Path]:
    """Copy a file that a user has into the models' folder; which model it is, its digest says."""
    try:
        digest = _digest(path, path.stat().st_mtime_ns)
    except OSError as exc:
        raise ModelError(f"the file cannot be read: {exc.strerror}", where=str(path)) from exc
    for model in KNOWN_MODELS:
        if model.sha256 == digest:
            return model, _kept(model, path)
    likely = "another version, an unfinished download, or a pointer to the file"
    advice = "`daylit models list` has the digests; give a network of your own with --segmenter FILE"
    raise ModelError(f"no known model has this file's SHA-256 {digest}", where=str(path), likely=likely, advice=advice)


def get_model(model: KnownModel, *, url: str | None = None) -> Path:
    """Download a model, check it and keep it; nothing is fetched where it is there already.

    Raises `ModelError`: the server does not answer, or gives another file.
    """
    there = installed(model)
    if there is not None:
        return there
    import pooch

    source = url or model.url
    loader = pooch.HTTPDownloader(timeout=DOWNLOAD_TIMEOUT_S)
    part = models_folder() / f"{model.file}.part"
    try:
        models_folder().mkdir(parents=True, exist_ok=True)
        pooch.retrieve(source, f"sha256:{model.sha256}", part.name, part.parent, downloader=loader)
        return _kept(model, part)
    # What the client raises is an OSError; another file than the pinned one is a ValueError.
    except (OSError, ValueError) as exc:
        text = f"{model.name} cannot be downloaded: {str(exc)[:300]}"
        advice = f"download {model.file} yourself (SHA-256 {model.sha256}), then `daylit models add FILE`"
        raise ModelError(text, where=source, likely="no network here, or the file has moved", advice=advice) from exc
    finally:
        part.unlink(missing_ok=True)


def _kept(model: KnownModel, path: Path) -> Path:
    """Copy a checked file to its place: all of it, or none."""
    target = models_folder() / model.file
    part = target.with_suffix(".new")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(path, part)
        part.replace(target)
    except OSError as exc:
        raise ModelError(f"the models folder cannot be written: {exc.strerror}", where=str(target)) from exc
    _digest.cache_clear()
    return target


def segmenter_file(asked: Path | None) -> Path | None:
    """Return the file of the network beside our own that ``--segmenter`` means; None: our own alone.

    Not asked: the installed model, if there is one. `ModelError` where it is asked for and not installed.
    """
    if asked is not None and str(asked) != "fuse":
        return None if str(asked) == "own" else asked
    there = installed()
    if there is None and asked is not None:
        text = "--segmenter fuse: no model is installed"
        raise ModelError(text, advice=f"daylit models get {ADE20K_DEEPLAB.name}, or leave it out")
    return there


def open_installed(path: Path) -> TfliteSegmenter:
    """Return the network of an installed model's file: MLPerf Mobile 0.7 labels, 0 for all but ADE20K's first 31."""
    # What stages only need to name the file must not wait for their libraries.
    from processing.segmentation.adapters import ADE20K, NetworkContract
    from processing.segmentation.segmenters import TfliteSegmenter

    read = table_of(__package__, "networks")["contracts"]["ade20k-deeplab"]
    contract = NetworkContract(classes=("other", *ADE20K[:31]), **read)
    return TfliteSegmenter(path, contract, threads=1)
