"""The front door: the ``daylit`` command and, for Python, a few names that are imported when they are used.

>>> import daylit
>>> session = daylit.open_session("sessions/2023-05-19T1554Z_coda-320")
>>> report = daylit.process(session, until="calibrate")
>>> picture = daylit.read_picture(session / "stages" / "calibrate" / "indoor.exr")
>>> picture.luminance_cd_m2().max(), picture.unit
"""

import importlib
import json
import os
import sys
import tomllib
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import click

if TYPE_CHECKING:
    from processing.api import Picture, Session, arrange, capture, open_session, process, read_picture, simulate
    from processing.layout.arrangement import Arrangements
    from processing.pictures.images import LuminanceImage, RelativeImage, Validity
    from processing.running.results import RunReport

__all__ = [
    "Arrangements",
    "LuminanceImage",
    "Picture",
    "RelativeImage",
    "RunReport",
    "Session",
    "Validity",
    "arrange",
    "capture",
    "open_session",
    "process",
    "read_picture",
    "simulate",
]
_ELSEWHERE = {
    "Arrangements": "processing.layout.arrangement",
    "LuminanceImage": "processing.pictures.images",
    "RelativeImage": "processing.pictures.images",
    "RunReport": "processing.running.results",
    "Validity": "processing.pictures.images",
}
"""Where public names live that are not in `processing.api`."""


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used."""
    if name not in __all__:
        raise AttributeError(f"module 'daylit' has no attribute {name!r}")
    value = getattr(importlib.import_module(_ELSEWHERE.get(name, "processing.api")), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


class Entry(NamedTuple):
    """Where a command lives, and its line in ``daylit --help`` (so that help needs no imports)."""

    module: str
    attribute: str
    help: str


_LIST = Path(__file__).parent / "processing" / "commands" / "commands.toml"
COMMANDS = {
    title: {name: Entry(*row) for name, row in section.items()}
    for title, section in tomllib.loads(_LIST.read_text("utf-8")).items()
}


def did_you_mean(word: str, known: list[str]) -> str:
    """Return the end of a sentence on a word that is none: what it may stand for."""
    import difflib

    near = difflib.get_close_matches(word, known)
    return f"; did you mean {' or '.join(near)}?" if near else ""


class LazyGroup(click.Group):
    """A group whose commands are imported when they are used."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return all command names, in the order of the table."""
        return [name for section in COMMANDS.values() for name in section]

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import the command's module and return the command."""
        for section in COMMANDS.values():
            if cmd_name in section:
                entry = section[cmd_name]
                command = getattr(importlib.import_module(entry.module), entry.attribute)
                assert isinstance(command, click.Command)
                return command
        return None

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Return the command that is named; of one that there is not, say which it may be."""
        names = self.list_commands(ctx)
        if args[0] not in names and not args[0].startswith("-"):
            ctx.fail(f"no such command: {args[0]!r}{did_you_mean(args[0], names)}")
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the table without importing any command."""
        for title, section in COMMANDS.items():
            with formatter.section(title):
                formatter.write_dl([(name, entry.help) for name, entry in section.items()])


_HELP = {"help_option_names": ["-h", "--help"], "max_content_width": 110, "show_default": True}


@click.group(cls=LazyGroup, context_settings=_HELP)
@click.version_option(package_name="daylit", prog_name="daylit")
def cli() -> None:
    """Capture rooms and skies in absolute luminance; stage them under measured daylight.

    \b
    Exit codes: 0 done · 1 a check failed · 2 usage · 3 instrument · 4 session · 5 a stage failed
                6 computer · 70 internal · 130 interrupted.
    Every command takes --json (one machine-readable object) and has examples in its own --help.
    """


def main(argv: list[str] | None = None) -> int:
    """Run the command line and return its exit code; errors go to standard error, as JSON under ``--json``."""
    arguments = sys.argv[1:] if argv is None else argv
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # read once, when NumPy is imported (`limit_libraries` says why)
    try:
        result = cli.main(arguments, prog_name="daylit", standalone_mode=False)
    except SystemExit:  # click's own, where whoever read the output has closed it
        return 141
    except click.exceptions.Abort:
        return _fail({"kind": "Interrupted", "message": "interrupted"}, "interrupted", 130, arguments)
    except click.ClickException as error:
        if "--json" in arguments:
            return _fail({"kind": "UsageError", "code": "USE-001", "message": error.format_message()}, "", 2, arguments)
        error.show()
        return error.exit_code
    except Exception as error:  # noqa: BLE001 (the last resort: reported as an internal error)
        return _report(error, arguments)
    return result if isinstance(result, int) else 0


def _report(error: Exception, arguments: list[str]) -> int:
    """Show an error a user can act on; anything unexpected goes to a file that can be sent in."""
    from drivers.errors import DaylitError

    if isinstance(error, OSError) and error.errno:
        from station.session.durable import WRITE_FAULTS, disk_error

        if error.filename is not None or error.errno in WRITE_FAULTS:
            error = disk_error(error, Path(os.fsdecode(error.filename or "a file")), "reading or writing")
    if isinstance(error, MemoryError):
        from station.errors import ResourceError

        error = ResourceError(f"not enough memory: {error}", advice="close other programs, or take smaller pictures")
    if isinstance(error, DaylitError):
        text = f"{error.code} {error}".replace(" | ", "\n  ")
        return _fail(error.to_dict(), text, error.exit_code, arguments)
    from station.errors import write_crash_report

    path = write_crash_report(error, arguments)
    text = f"internal error: {error!r}\n  crash report (personal paths removed): {path}. Please send it to us"
    return _fail({"kind": "InternalError", "message": repr(error), "report": str(path)}, text, 70, arguments)


def _fail(error: dict[str, object], text: str, exit_code: int, arguments: list[str]) -> int:
    if "--json" in arguments:
        with suppress(OSError):  # of a full disk, or a closed pipe: standard error hears of it then
            click.echo(json.dumps({"ok": False, "exit_code": exit_code, "error": error}))
            return exit_code
    if text:
        # A message may hold a device's own words: no control character of theirs reaches the terminal.
        shown = "".join(c if c.isprintable() or c == "\n" else "?" for c in text)
        click.echo(click.style("daylit: ", fg="red", bold=True) + shown, err=True)
    return exit_code


if __name__ == "__main__":
    sys.exit(main())
