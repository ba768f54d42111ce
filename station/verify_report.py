"""What a check of a session found."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any

from station.errors import IntegrityError


def printable(text: str) -> str:
    """Return the text with everything unprintable spelled as an escape."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


@dataclass(frozen=True)
class Problem:
    """One thing that is not as it should be: a code to sort by, the file inside the session, and words."""

    code: str
    file: str
    message: str


@dataclass
class VerifyReport:
    """All that was found; without ``problems`` the session is intact (but maybe partial: ``status``)."""

    path: str
    fast: bool
    status: str = "unknown"
    missing: tuple[str, ...] = ()
    frames_checked: int = 0
    bytes_read: int = 0
    problems: list[Problem] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    @property
    def intact(self) -> bool:
        """Whether there is no problem."""
        return not self.problems

    def add(self, code: str, file: str, message: str) -> None:
        """Note a problem; text from a hostile session cannot reach a terminal as control characters."""
        self.problems.append(Problem(code, printable(file), printable(message)))

    def to_dict(self) -> dict[str, Any]:
        """Return the report as a JSON-able mapping."""
        return {"intact": self.intact, **asdict(self)}

    def raise_for_problems(self) -> None:
        """Raise `IntegrityError` listing every problem, if there is one."""
        if self.problems:
            told = "; ".join(f"{p.file}: {p.message}" for p in self.problems[:5])
            more = f"; and {len(self.problems) - 5} more" if len(self.problems) > 5 else ""
            raise IntegrityError(
                f"{len(self.problems)} problems: {told}{more}",
                where=self.path,
                advice="restore the files from a copy, or take them anew with `daylit capture --resume`",
                files=[p.file for p in self.problems],
            )
