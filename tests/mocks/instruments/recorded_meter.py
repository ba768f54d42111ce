"""A meter that says what one said before: made from a transcript of its line."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Protocol

from mocks.instruments.serial_port import Piece

CLOSES = ("open", "close")
"""Entries that end an exchange."""


class Entry(Protocol):
    """What is needed of an entry of a transcript (`drivers.transcript.Entry`)."""

    @property
    def t_s(self) -> float:
        """Seconds from the transcript's beginning."""
        ...

    @property
    def who(self) -> str:
        """Which instrument."""
        ...

    @property
    def way(self) -> str:
        """``out`` and ``in`` carry bytes."""
        ...

    @property
    def data(self) -> bytes:
        """What went over the line."""
        ...

    @property
    def error(self) -> str:
        """Code of a failed call."""
        ...


@dataclass(frozen=True)
class _Exchange:
    question: bytes
    line_end: bytes
    pieces: tuple[Piece, ...]


class RecordedMeter:
    """Answers each question with the recorded answer, at its recorded time after the question.

    A question that was put several times is answered in the recorded order, from the one after the last answer given,
    and from the beginning again after the end; one that was never put is not answered.

    ``entries``: of `drivers.transcript.read_transcript`; ``who``: the meter's name in them;
    ``line_end``: of the questions; the one that was answered most often, if it is not given.
    """

    def __init__(self, entries: Iterable[Entry], who: str = "meter", line_end: bytes | None = None) -> None:
        exchanges = list(_exchanges(e for e in entries if e.who == who))
        answered = Counter(e.line_end for e in exchanges if e.pieces)
        self.line_end = line_end or (answered.most_common(1)[0][0] if answered else b"\r\n")
        self._exchanges = [e for e in exchanges if e.line_end == self.line_end]
        self._next = 0
        self.unknown: list[bytes] = []
        """Questions that nobody put in the recording, for tests."""

    def hear(self, line: bytes, now_s: float) -> list[Piece]:
        """Return the recorded answer to one question (without its line end)."""
        n = len(self._exchanges)
        for step in range(n):
            place = (self._next + step) % n
            if self._exchanges[place].question == line:
                self._next = place + 1
                return list(self._exchanges[place].pieces)
        self.unknown.append(line)
        return []


def _exchanges(entries: Iterable[Entry]) -> Iterable[_Exchange]:
    """Yield each question with what came until the next one."""
    asked: Entry | None = None
    pieces: list[Piece] = []
    for entry in entries:
        if entry.way == "in" and asked is not None and entry.data:
            pieces.append(Piece(entry.t_s - asked.t_s, entry.data))
        elif entry.way == "out" or entry.way in CLOSES:
            if asked is not None:
                yield _exchange(asked.data, pieces)
            asked, pieces = (entry if entry.way == "out" and not entry.error else None), []
    if asked is not None:
        yield _exchange(asked.data, pieces)


def _exchange(sent: bytes, pieces: list[Piece]) -> _Exchange:
    question = sent.rstrip(b"\r\n")
    return _Exchange(question, sent[len(question) :], tuple(pieces))
