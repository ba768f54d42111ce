"""Rendered pictures on disk, by what they show: bounded, least recently used out first, safe with two processes."""

import hashlib
import os
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from filelock import FileLock, Timeout
from platformdirs import user_cache_path

from drivers.errors import DaylitError

# Chosen: three full-size brackets; waits are for another process that renders.
DEFAULT_LIMIT_BYTES = 2_000_000_000
_LOCK_LIMIT_S = 300.0  # chosen: longer than the slowest picture takes
_IN_USE_S = 120.0  # chosen: younger files may be read just now
_ABANDONED_S = 3600.0  # chosen: no writer takes an hour


def default_folder() -> Path:
    """Return ``$DAYLIT_CACHE``, or the user's cache folder for daylit."""
    chosen = os.environ.get("DAYLIT_CACHE")
    return Path(chosen) / "pictures" if chosen else user_cache_path("daylit") / "pictures"


def content_key(*parts: object) -> str:
    """Return a short digest of the texts of ``parts``."""
    return hashlib.sha256("\x1f".join(str(part) for part in parts).encode()).hexdigest()[:40]


class PictureCacheError(DaylitError, code="SIM-002", exit_code=6):
    """The folder for rendered pictures cannot be written."""


class PictureCache:
    """Files by content key and suffix. A file is either absent or complete: it is renamed into place."""

    def __init__(self, folder: Path | None = None, limit_bytes: int = DEFAULT_LIMIT_BYTES) -> None:
        self.folder = folder or default_folder()
        self.limit_bytes = limit_bytes

    def path(self, key: str, suffix: str) -> Path:
        """Return where the file is or would be."""
        return self.folder / f"{key}{suffix}"

    def holds(self, key: str, suffix: str) -> bool:
        """Return whether the file is there, and mark it as used now."""
        path = self.path(key, suffix)
        with suppress(OSError):
            os.utime(path)
            return True
        return False

    def read(self, key: str, suffix: str) -> bytes | None:
        """Return the file's bytes, None where it is not (or no longer) there."""
        with suppress(FileNotFoundError):
            return self.path(key, suffix).read_bytes() if self.holds(key, suffix) else None
        return None

    def write(self, key: str, suffix: str, data: bytes) -> None:
        """Store bytes."""
        with self.new_file(key, suffix) as path:
            path.write_bytes(data)

    @contextmanager
    def new_file(self, key: str, suffix: str) -> Iterator[Path]:
        """Give a temporary file to fill; it takes its name when the block ends well, and goes when it does not."""
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            handle, name = tempfile.mkstemp(dir=self.folder, suffix=".part")
            os.close(handle)
            path = Path(name)
            try:
                yield path
                path.replace(self.path(key, suffix))
            finally:
                path.unlink(missing_ok=True)
        except OSError as error:
            raise self._unwritable(error) from error
        self.evict()

    @contextmanager
    def rendering(self, what: str = "render") -> Iterator[None]:
        """Let one process at a time render pictures (or make ``what``): none makes what another has just made.

        Pictures may need other things made first: those have locks of their own. After five minutes of waiting it
        goes ahead all the same: the worst is work done twice.
        """
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise self._unwritable(error) from error
        lock = FileLock(self.folder / f"{what}.lock", timeout=_LOCK_LIMIT_S)
        with suppress(Timeout):
            lock.acquire()
        try:
            yield
        finally:
            lock.release()  # nothing where the wait was in vain

    def _unwritable(self, error: OSError) -> PictureCacheError:
        text = f"pictures cannot be kept ({error.strerror or error})"
        likely = "the disk is full or the folder may not be written"
        advice = "free some space (a full-size bracket takes about 600 MB), or point DAYLIT_CACHE elsewhere"
        return PictureCacheError(text, where=str(self.folder), likely=likely, advice=advice)

    def evict(self) -> None:
        """Delete the files unused for longest until the rest fits the limit; what is in use just now stays."""
        now_ns = time.time_ns()
        files = []
        with suppress(FileNotFoundError):
            for entry in os.scandir(self.folder):
                with suppress(FileNotFoundError):
                    facts = entry.stat()
                    files.append((facts.st_mtime_ns, facts.st_size, entry.path))
        total = sum(size for _, size, _ in files)
        for used_ns, size, path in sorted(files):
            age_s = (now_ns - used_ns) / 1e9
            if path.endswith(".part"):
                evictable = age_s > _ABANDONED_S
            else:
                evictable = total > self.limit_bytes and age_s > _IN_USE_S and not path.endswith(".lock")
            if evictable:
                Path(path).unlink(missing_ok=True)
                total -= size
