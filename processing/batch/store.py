"""Sessions and results by URL (fsspec: s3, gs, az, file): pulled to scratch, processed, pushed, and ``done.json`` last.

A session's objects are its files as they are on disk. Each run pushes its results under a prefix of its own
(``results/RUN/stages/...``), looks whether all of them are there in full size, and only then writes ``done.json`` by a
conditional put: it names the prefix and the SHA-256 of every object. What has no ``done.json`` is not done, whatever
lies there; what has one is whole, since nothing under a named prefix is ever written again.
"""

import hashlib
import json
import posixpath
import shutil
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self, TypeVar
from uuid import uuid4

from processing.batch.work import Outcome, Task, work
from processing.errors import ParameterError, StoreError
from processing.ground.finished import digest
from processing.pipeline import STAGES
from processing.running.choices import FILE as CHOICES
from processing.running.requests import digests
from processing.segmentation.installed import installed
from station.session import strict_json
from station.session.folder import file_sha256
from station.session.session import MANIFEST_NAME

DONE = "done.json"
RESULTS = "results"
TRIES = 4  # of an operation (chosen: with the pauses, four seconds)
PAUSE_S = 0.5  # before the second try; twice as long before each further one (chosen)
T = TypeVar("T")
Sleep = Callable[[float], None]


def is_url(place: str) -> bool:
    """Return whether a place is a URL rather than a folder."""
    return "://" in place


@dataclass(frozen=True)
class Store:
    """A folder of objects. Every operation is tried again where the network or the service fails."""

    url: str
    files: Any
    """An fsspec file system."""
    root: str
    sleep: Sleep = time.sleep

    @classmethod
    def at(cls, url: str, sleep: Sleep = time.sleep) -> Self:
        """Open a URL; raises `StoreError` where its library is missing or it is none."""
        import fsspec

        try:
            files, root = fsspec.core.url_to_fs(url, use_listings_cache=False, skip_instance_cache=True)
        except (ImportError, ValueError, OSError) as error:
            advice = "pip install 'daylit[cloud]' (s3fs); gcsfs for gs://, adlfs for az://"
            raise StoreError(f"cannot be opened: {error}", where=url, advice=advice) from error
        return cls(url.rstrip("/"), files, root.rstrip("/"), sleep)

    def below(self, name: str) -> Self:
        """Return a folder in this one."""
        return replace(self, url=f"{self.url}/{name}", root=f"{self.root}/{name}")

    def sizes(self, depth: int | None = None) -> dict[str, int]:
        """Return the size of every object by its name below this folder."""

        def listed() -> dict[str, int]:
            found = self.files.find(self.root, maxdepth=depth, detail=True)
            return {posixpath.relpath(name, self.root): int(info["size"]) for name, info in found.items()}

        return self._again(listed, "listing", dict)

    def read(self, name: str) -> bytes | None:
        """Return an object; None where there is none."""
        return self._again(lambda: bytes(self.files.cat_file(f"{self.root}/{name}")), f"reading {name}", lambda: None)

    def pull(self, name: str, path: Path, size_bytes: int) -> None:
        """Copy an object of a known size to a file."""
        path.parent.mkdir(parents=True, exist_ok=True)

        def copied() -> None:
            self.files.get_file(f"{self.root}/{name}", str(path))
            if path.stat().st_size != size_bytes:
                raise OSError(f"{path.stat().st_size} of {size_bytes} bytes arrived")

        self._again(copied, f"pulling {name}")

    def push(self, path: Path, name: str) -> None:
        """Copy a file to an object."""
        target = f"{self.root}/{name}"
        if getattr(self.files, "protocol", None) in ("file", ("file", "local")):
            self.files.makedirs(posixpath.dirname(target), exist_ok=True)
        self._again(lambda: self.files.put_file(str(path), target), f"pushing {name}")

    def create(self, name: str, data: bytes) -> bool:
        """Write an object if there is none (a conditional put); return whether it is there with this content now."""

        def put() -> bool:
            try:
                self.files.pipe_file(f"{self.root}/{name}", data, mode="create")
            except FileExistsError:
                # Ours after all, where the answer to an earlier try was lost.
                return self.read(name) == data
            return True

        return self._again(put, f"writing {name}")

    def remove(self, name: str) -> None:
        """Remove an object; none is no error."""
        self._again(lambda: self.files.rm_file(f"{self.root}/{name}"), f"removing {name}", lambda: None)

    def _again(self, do: Callable[[], T], what: str, absent: Callable[[], T] | None = None) -> T:
        """Return what is done at the last of some tries; ``absent``: what counts where there is no such object."""
        for number in range(TRIES):
            try:
                return do()
            except StoreError:
                raise
            except Exception as error:
                if absent is not None and isinstance(error, FileNotFoundError):
                    return absent()
                if number + 1 == TRIES:
                    raise StoreError(f"{what}: {error}"[:400], where=self.url) from error
                self.sleep(PAUSE_S * 2**number)
        raise AssertionError("unreachable")


def remote_sessions(url: str, depth: int) -> list[str]:
    """Return the URLs of the sessions below one; raises `ParameterError` where there are none."""
    names = Store.at(url).sizes(depth + 1)
    found = sorted(posixpath.dirname(name) for name in names if posixpath.basename(name) == MANIFEST_NAME)
    if not found or found == [""]:
        raise ParameterError("no sessions here", where=url, advice=f"a session is a folder with {MANIFEST_NAME}")
    return [f"{url.rstrip('/')}/{name}" for name in found if f"/{RESULTS}/" not in f"/{name}/"]


def work_by_url(task: Task, *, do: Callable[[Task], Outcome] = work, sleep: Sleep = time.sleep) -> Outcome:
    """Process a session that is named by a URL; an outcome comes back whatever the store does."""
    begun_s = time.monotonic()
    try:
        outcome = process_in(Store.at(task.session, sleep), task, do)
    except StoreError as error:
        outcome = Outcome(task.name, "failed", error.code, error.message)
    return replace(outcome, seconds=round(time.monotonic() - begun_s, 3))


def process_in(store: Store, task: Task, do: Callable[[Task], Outcome]) -> Outcome:
    """Pull, process, push and mark a session as done, unless it is; raises `StoreError`."""
    manifest = store.read(MANIFEST_NAME)
    if manifest is None:
        raise StoreError(f"has no {MANIFEST_NAME}", where=store.url)
    # The digest of what a result depends on: the session, what was chosen for it, arguments, files and folders, stages
    files = {text: Path(text) for text in task.arguments if Path(text).is_absolute()} | {"model": installed()}
    files |= {name: Path(__file__).parents[1] / name for stage in STAGES for name in stage.data}
    named = digests({name: path for name, path in files.items() if path and path.exists()})
    session = hashlib.sha256(manifest + (store.read(CHOICES) or b"")).hexdigest()
    asked = {"session": session, "arguments": list(task.arguments), "zone": task.zone, "files": named}
    key = digest(asked | {"stages": {stage.name: stage.version for stage in STAGES}})
    former, again = done_of(store), {"--force", "--recheck"} & set(task.arguments)
    if former is not None and former["key"] == key and not again:
        return Outcome(task.name, "done", stages=dict.fromkeys(former["stages"], "skipped"), row=former["row"])
    with tempfile.TemporaryDirectory(prefix="daylit-scratch-") as scratch:
        here = Path(scratch) / posixpath.basename(store.root)
        _pull(store, here, former)
        outcome = do(replace(task, session=str(here)))
        return _published(store, here, key, outcome, former) if outcome.state == "done" else outcome


def done_of(store: Store) -> dict[str, Any] | None:
    """Return what ``done.json`` says; None where there is none. Raises `StoreError` for one that is not ours."""
    raw = store.read(DONE)
    if raw is None:
        return None
    try:
        found: dict[str, Any] = strict_json.loads(raw)
        if {"key", "prefix", "objects", "stages", "row"} <= set(found):
            return found
    except (ValueError, TypeError):
        pass
    raise StoreError(f"{DONE} was not written by daylit", where=store.url, advice="check it and remove it")


def _pull(store: Store, here: Path, former: dict[str, Any] | None) -> None:
    """Copy the session, and the results that it has, so that only what changed is done."""
    sizes = store.sizes()
    for name, size_bytes in sizes.items():
        if name != DONE and not name.startswith(f"{RESULTS}/"):
            store.pull(name, here / name, size_bytes)
    if former is None:
        return
    for name, sha256 in former["objects"].items():
        path, stored = here / name, f"{former['prefix']}/{name}"
        if stored in sizes:
            store.pull(stored, path, sizes[stored])
        if not path.exists() or file_sha256(path) != sha256:
            shutil.rmtree(here / "stages", ignore_errors=True)  # not as it was written: made anew
            return


def _published(store: Store, here: Path, key: str, outcome: Outcome, former: dict[str, Any] | None) -> Outcome:
    prefix = f"{RESULTS}/{uuid4().hex}"
    results = store.below(prefix)
    # The results' files by their names in the session; not what only this machine can use, which is hidden
    found = {path.relative_to(here): path for path in sorted((here / "stages").rglob("*")) if path.is_file()}
    files = {name.as_posix(): path for name, path in found.items() if not any(part[0] == "." for part in name.parts)}
    for name, path in files.items():
        results.push(path, name)
    stored, made = results.sizes(), {name: path.stat().st_size for name, path in files.items()}
    if stored != made:
        wrong = sorted(name for name in made.keys() | stored.keys() if made.get(name) != stored.get(name))
        raise StoreError(f"not all results arrived: {', '.join(wrong[:3])}", where=store.url)
    objects = {name: file_sha256(path) for name, path in files.items()}
    done = {"key": key, "prefix": prefix, "objects": objects, "stages": dict(outcome.stages), "row": dict(outcome.row)}
    if former is not None and done_of(store) == former:
        store.remove(DONE)
    if not store.create(DONE, json.dumps(done, sort_keys=True).encode()):
        theirs = done_of(store)
        if theirs is None or theirs["key"] != key:
            raise StoreError("another run has since finished it with other options", where=store.url)
        former = done  # the other run's results stand, ours go
    if former is not None:
        for name in former["objects"]:
            store.remove(f"{former['prefix']}/{name}")
    return outcome
