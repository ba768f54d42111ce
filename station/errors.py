"""Errors of the station that are not an instrument's (the tree starts in `drivers.errors`), and the report of a crash.

Exit codes: 2 usage · 3 device · 4 session · 5 stage · 6 resource · 70 internal · 130 interrupted.
"""

from __future__ import annotations

from pathlib import Path

from drivers.errors import DaylitError


class UsageError(DaylitError):
    """A command or a rig file that cannot be right."""

    code = "USE-001"
    exit_code = 2


class RigError(UsageError):
    """A rig file that does not say what is needed; names the file and the key."""

    code = "USE-002"


class ConditionsError(UsageError):
    """A list of conditions that does not say what is needed; names file, line and column."""

    code = "USE-003"


class SessionError(DaylitError):
    """A session folder that is not what it should be."""

    code = "SES-000"
    exit_code = 4


class SessionNotFoundError(SessionError):
    """No session at that path."""

    code = "SES-001"


class SessionLockedError(SessionError):
    """Another process works on the session (``details``: who)."""

    code = "SES-002"
    retryable = True


class SessionExistsError(SessionError):
    """The folder is already there and would be overwritten."""

    code = "SES-003"


class ManifestError(SessionError):
    """session.json cannot be read: not JSON, too large, or not of the schema."""

    code = "SES-004"


class SchemaTooNewError(SessionError):
    """session.json was written by a newer daylit."""

    code = "SES-005"


class JournalError(SessionError):
    """journal.jsonl is damaged before its last line."""

    code = "SES-006"


class IntegrityError(SessionError):
    """Files that are missing, changed, or more than the manifest says (``details``: files)."""

    code = "SES-007"


class FrameRejectedError(SessionError):
    """A frame that cannot be what was asked; the message names the reason and the file."""

    code = "SES-008"


class IncompleteBracketError(SessionError):
    """A session that lacks frames or readings (``details``: missing)."""

    code = "SES-009"


class AmbiguousImportError(SessionError):
    """Files that could belong to more than one session, or to none (``details``: paths)."""

    code = "SES-010"


class ResourceError(DaylitError):
    """The computer cannot go on."""

    code = "RES-000"
    exit_code = 6


class DiskFullError(ResourceError):
    """No space left for the session."""

    code = "RES-001"


class DiskError(ResourceError):
    """The disk refused to write or to sync; what was being written does not count."""

    code = "RES-002"


def software_versions() -> dict[str, str]:
    """Return the versions that matter for a result: ours, Python's and those of what touches bytes."""
    import platform
    from importlib.metadata import PackageNotFoundError, version

    versions = {"python": platform.python_version(), "system": platform.platform()}
    for name in ("daylit", "numpy", "pillow", "pydantic", "pyserial", "pyusb", "libusb-package"):
        try:
            versions[name] = version(name)
        except PackageNotFoundError:
            versions[name] = "not installed"
    return versions


def write_crash_report(error: BaseException, arguments: list[str]) -> Path:
    """Write the trace of an unexpected error to a new file and return its path; the home folder is cut out."""
    import tempfile
    import traceback

    lines = ["daylit crash report", f"arguments: {arguments}", f"versions: {software_versions()}", ""]
    lines += traceback.format_exception(error)
    text = "\n".join(lines).replace(str(Path.home()), "~").replace(tempfile.gettempdir(), "<tmp>")
    with tempfile.NamedTemporaryFile("w", prefix="daylit-crash-", suffix=".txt", delete=False) as file:
        file.write(text)
    return Path(file.name)
