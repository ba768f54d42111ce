"""What is left behind after a fault of our own: a text file without personal paths, to send in."""

from __future__ import annotations

import platform
import tempfile
import traceback
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path


def software_versions() -> dict[str, str]:
    """Return the versions that matter for a result: ours, Python's and those of what touches bytes."""
    versions = {"python": platform.python_version(), "system": platform.platform()}
    for name in ("daylit", "numpy", "pillow", "pydantic", "pyserial", "pyusb", "libusb-package"):
        try:
            versions[name] = version(name)
        except PackageNotFoundError:
            versions[name] = "not installed"
    return versions


def write_crash_report(error: BaseException, arguments: list[str]) -> Path:
    """Write the trace of an unexpected error to a new file and return its path; the home folder is cut out."""
    lines = ["daylit crash report", f"arguments: {arguments}", f"versions: {software_versions()}", ""]
    lines += traceback.format_exception(error)
    text = "\n".join(lines).replace(str(Path.home()), "~").replace(tempfile.gettempdir(), "<tmp>")
    with tempfile.NamedTemporaryFile("w", prefix="daylit-crash-", suffix=".txt", delete=False) as file:
        file.write(text)
    return Path(file.name)
