"""Errors of the station that are not an instrument's (the tree starts in `drivers.errors`), and the report of a crash.

Exit codes: 2 usage · 3 device · 4 session · 5 stage · 6 resource · 70 internal · 130 interrupted.
"""

from pathlib import Path

from drivers.errors import DaylitError


class UsageError(DaylitError, code="USE-001", exit_code=2):
    """A command or a rig file that cannot be right."""


class RigError(UsageError, code="USE-002"):
    """A rig file that does not say what is needed; names the file and the key."""


class ConditionsError(UsageError, code="USE-003"):
    """A list of conditions that does not say what is needed; names file, line and column."""


class SessionError(DaylitError, code="SES-000", exit_code=4):
    """A session folder that is not what it should be."""


class SessionNotFoundError(SessionError, code="SES-001"):
    """No session at that path."""


class SessionLockedError(SessionError, code="SES-002", retryable=True):
    """Another process works on the session (``details``: who)."""


class SessionExistsError(SessionError, code="SES-003"):
    """The folder is already there and would be overwritten."""


class ManifestError(SessionError, code="SES-004"):
    """session.json cannot be read: not JSON, too large, or not of the schema."""


class SchemaTooNewError(SessionError, code="SES-005"):
    """session.json was written by a newer daylit."""


class JournalError(SessionError, code="SES-006"):
    """journal.jsonl is damaged before its last line."""


class IntegrityError(SessionError, code="SES-007"):
    """Files that are missing, changed, or more than the manifest says (``details``: files)."""


class FrameRejectedError(SessionError, code="SES-008"):
    """A frame that cannot be what was asked; the message names the reason and the file."""


class IncompleteBracketError(SessionError, code="SES-009"):
    """A session that lacks frames or readings (``details``: missing)."""


class AmbiguousImportError(SessionError, code="SES-010"):
    """Files that could belong to more than one session, or to none (``details``: paths)."""


class ResourceError(DaylitError, code="RES-000", exit_code=6):
    """The computer cannot go on."""


class DiskFullError(ResourceError, code="RES-001"):
    """No space left for the session."""


class DiskError(ResourceError, code="RES-002"):
    """The disk refused to write or to sync; what was being written does not count."""


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
