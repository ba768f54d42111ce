"""An object store that fails: every operation of a run can be lost, come too late, write half, or be the worker's last.

The server is moto's S3 on the loopback (in the short run a store in memory); the session is a few bytes, the work a
digest of them. What is checked after each fault is read by the server's own client, not by the code under test.
"""

from __future__ import annotations

import hashlib
import json
import random
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from processing.batch.store import DONE, Store, process_in
from processing.batch.work import Outcome, Task
from processing.errors import StoreError

BUCKET = "rooms"
KINDS = ("lost", "answer lost", "half, then lost", "half, and said done", "killed before", "killed after")
MOVED = ("cat_file", "find", "get_file", "put_file", "pipe_file", "rm_file")


class Killed(BaseException):
    """The worker is gone at this point."""


@contextmanager
def in_memory() -> Iterator[Any]:
    """Give the same in memory, for runs that have no time for a server."""
    import fsspec

    files = fsspec.filesystem("memory", skip_instance_cache=True)
    files.store.clear()
    files.pseudo_dirs[:] = [""]
    yield files
    files.store.clear()


@contextmanager
def object_store() -> Iterator[Any]:
    """Serve an empty bucket; gives an fsspec file system of it."""
    import s3fs
    from moto.server import ThreadedMotoServer

    server = ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    server.start()
    try:
        host, port = server.get_host_and_port()
        files = s3fs.S3FileSystem(
            key="test",
            secret="test",
            endpoint_url=f"http://{host}:{port}",
            client_kwargs={"region_name": "us-east-1"},
            skip_instance_cache=True,
            use_listings_cache=False,
        )
        files.call_s3("create_bucket", Bucket=BUCKET)
        yield files
    finally:
        server.stop()


class Faulty:
    """The same file system, with faults at operations of given numbers."""

    def __init__(self, files: Any, faults: dict[int, str]) -> None:
        self.protocol, self._files, self._faults = files.protocol, files, faults
        self.count = self.injected = 0

    def __getattr__(self, name: str) -> Any:
        if name not in MOVED:
            return getattr(self._files, name)
        return lambda *given, **named: self._do(name, getattr(self._files, name), *given, **named)

    def _do(self, name: str, do: Callable[..., Any], *given: Any, **named: Any) -> Any:
        self.count += 1
        kind = self._faults.get(self.count)
        if kind is None:
            return do(*given, **named)
        self.injected += 1
        if kind.startswith("killed"):
            if kind == "killed after":
                do(*given, **named)
            raise Killed
        if kind.startswith("half") and name in ("put_file", "get_file"):
            self._half(name, *given)
            if kind == "half, and said done":
                return None
        elif kind == "answer lost":
            do(*given, **named)
        raise OSError("injected")

    def _half(self, name: str, source: str, target: str) -> None:
        if name == "put_file":
            data = Path(source).read_bytes()
            self._files.pipe_file(target, data[: len(data) // 2])
        else:
            data = self._files.cat_file(source)
            Path(target).write_bytes(data[: len(data) // 2])


def put_session(files: Any, name: str) -> str:
    """Store a session of two frames; returns its root."""
    root = str(files._strip_protocol(f"{BUCKET}/{name}"))
    frames = {f"indoor/{k}.jpg": f"{name} frame {k}".encode() * 20 for k in range(2)}
    digests = {key: hashlib.sha256(data).hexdigest() for key, data in frames.items()}
    for key, data in {**frames, "session.json": json.dumps(digests).encode()}.items():
        files.pipe_file(f"{root}/{key}", data)
    return root


def digested(task: Task) -> Outcome:
    """Do the work of a session: its frames are checked, and digested as the arguments say."""
    here = Path(task.session)
    known = json.loads((here / "session.json").read_text())
    for name, digest in known.items():
        if hashlib.sha256((here / name).read_bytes()).hexdigest() != digest:
            return Outcome(task.name, "failed", "SES-003", f"{name} is not as it was taken")
    for stage in ("merge", "report"):
        (here / "stages" / stage).mkdir(parents=True, exist_ok=True)
        (here / "stages" / stage / "result.json").write_text(f"{stage} {task.arguments} {sorted(known.values())}" * 5)
    return Outcome(task.name, "done", stages={"merge": "ran", "report": "ran"})


def whole_or_not_done(files: Any, root: str) -> str:
    """Return what is wrong with a session that is called done, read by the server's own client; "" where nothing is."""
    if not files.exists(f"{root}/{DONE}"):
        return ""
    done = json.loads(files.cat_file(f"{root}/{DONE}"))
    known = sorted(json.loads(files.cat_file(f"{root}/session.json")).values())
    for name, digest in done["objects"].items():
        path = f"{root}/{done['prefix']}/{name}"
        data = files.cat_file(path) if files.exists(path) else b""
        if hashlib.sha256(data).hexdigest() != digest or str(known) not in data.decode():
            return f"{name} is called done and is not whole"
    return "" if len(done["objects"]) == 2 else f"done with {len(done['objects'])} results"


def campaign(files: Any, least: int, seed: int) -> tuple[int, int, list[str]]:
    """Inject at least so many faults; returns how many there were, how many runs said so, and what was wrong."""
    rng = random.Random(seed)
    injected = result = number = 0
    wrong: list[str] = []
    while injected < least:
        root = put_session(files, f"s{number}")
        number += 1
        for round_ in range(3):
            # One fault at each operation in turn, or several at random; the third round has none and must be done.
            task = Task(f"s3://{root}", root, (f"--round-{max(round_, 1)}",), 60.0)
            several = {rng.randint(1, 24): rng.choice(KINDS) for _ in range(rng.randint(1, 6))}
            one = {1 + number % 20: KINDS[(number // 20 + round_) % len(KINDS)]}
            faults = {} if round_ == 2 else several if number % 2 else one
            faulty = Faulty(files, faults)
            outcome = None
            try:
                outcome = process_in(Store(task.session, faulty, root, lambda _s: None), task, digested)
            except (Killed, StoreError):
                result += 1
            injected += faulty.injected
            problem = whole_or_not_done(files, root)
            if outcome is not None and outcome.state == "done" and not files.exists(f"{root}/{DONE}"):
                problem = "reported as done, and there is no mark"
            if round_ == 2 and (outcome is None or outcome.state != "done"):
                problem = f"not done without any fault: {outcome}"
            wrong += [f"session {number}, round {round_}, faults {faulty.injected}: {problem}"] if problem else []
    return injected, result, wrong
