"""Question and answer with a luminance meter: what a line means, and which answer belongs to which question.

A line without a checksum can lie in four ways; each has its own defence here:

* it has not the dialect's form (noise, pieces, joined lines): it is no answer;
* it is the late answer to an earlier question: after anything but a clean answer the dialogue is *fenced*: a harmless
  question whose answer looks like no reading must be answered first. A meter answers in order, so whatever is older
  has come by then and has been thrown away;
* it is our own question, echoed: skipped once;
* noise turned it into another well-formed line: where the dialect can, the held value is asked for again, and both
  transmissions must carry the same digits.
"""

import re
from dataclasses import dataclass, replace

from drivers.clock import Clock, Deadline
from drivers.errors import DeviceTimeoutError
from drivers.meter.dialect import Dialect, Step
from drivers.meter.interface import ReadingStatus
from drivers.serial_link import ByteLine

MAX_ASKS = 3  # a question that got no clean answer is put so often in all
QUIET_S = 0.05  # a line that was silent for so long is idle: some 24 characters at 4800 baud
# Chosen: a line of 64 characters takes 0.15 s at 4800 baud.
DRAIN_LIMIT_S = 0.5
WRITE_LIMIT_S = 2.0  # chosen: a line of 32 characters takes 70 ms at 4800 baud
EARLY_S = 0.5
"""A meter that can say "still measuring" announces whole seconds, rounded up: asked so much earlier, as the public
programs for the CS-200 do."""
DONE_LATE_S = 2.0  # chosen: the line that says "done" may come so much later than announced
MAX_PAUSE_S = 30.0  # no meter is believed that asks for a longer wait
SHOWN_CHARACTERS = 120  # chosen: one line of a message
_NUMBER = re.compile(r" *\+?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]{1,2})? *")


@dataclass(frozen=True)
class Answer:
    """What came back to one question."""

    status: ReadingStatus
    raw: str = ""
    value_text: str = ""
    wait_s: float = 0.0
    groups: tuple[tuple[str, str], ...] = ()
    detail: str = ""
    ask_again: bool = False
    """Whether the same question may have a better answer (silence, noise, a question the meter misheard)."""
    silent: bool = False
    """The time was over before a whole line had come."""
    busy: bool = False
    """The meter is still measuring: the same question later."""

    @property
    def ok(self) -> bool:
        """Whether it is a clean answer."""
        return self.status is ReadingStatus.OK


class Dialogue:
    """Questions and answers over one open line.

    ``line``: the open line; the dialogue reads all of it.
    ``dialect``: what the meter speaks; ``connect[0]`` is the fence.
    """

    def __init__(self, line: ByteLine, dialect: Dialect, clock: Clock) -> None:
        self.line = line
        self._dialect = dialect
        self._clock = clock
        self._line_end = dialect.line_end.encode("ascii")
        self._in_step = False

    def greet(self, deadline: Deadline) -> Answer:
        """Go through the dialect's greeting; returns the last clean answer with all groups, or the first failure."""
        groups: tuple[tuple[str, str], ...] = ()
        answer = Answer(ReadingStatus.NO_ANSWER)
        for number, step in enumerate(self._dialect.connect):
            for _ in range(MAX_ASKS):
                answer = self._fence(deadline) if number == 0 else self.ask(step, deadline)
                if not answer.ask_again or deadline.expired:
                    break
            if not answer.ok:
                return answer
            groups += answer.groups
        return replace(answer, groups=groups)

    def sample(self, deadline: Deadline) -> Answer:
        """Take one reading: all measuring steps, then the check of the transmission; repeated after noise or silence.

        Raises `DeviceLostError`: the line is gone.
        """
        answer = Answer(ReadingStatus.NO_ANSWER, detail="no time left", ask_again=True)
        for _ in range(MAX_ASKS):
            answer = self._sample_once(deadline)
            if not answer.ask_again or deadline.expired:
                return answer
        return answer

    def ask(self, step: Step, deadline: Deadline) -> Answer:
        """Put one question, anew while the meter is busy; a dialogue that may be out of step is fenced before."""
        patience = self._patience(deadline)
        while True:
            answer = self._ask_once(step, deadline)
            if not answer.busy or patience.expired:
                return answer
            self._clock.sleep(min(self._dialect.busy_pause_s, patience.remaining_s))

    def _patience(self, deadline: Deadline) -> Deadline:
        return Deadline.after(self._clock, min(self._dialect.busy_limit_s, deadline.remaining_s))

    def _ask_once(self, step: Step, deadline: Deadline) -> Answer:
        self._pause(deadline)
        if self.line.drain(0.0, DRAIN_LIMIT_S):
            self._in_step = False  # nobody asked for what was there
        if not self._in_step:
            fenced = self._fence(deadline)
            if not fenced.ok:
                return fenced
            self._pause(deadline)
        self._in_step = False
        self.line.write(self._encode(step), WRITE_LIMIT_S)
        limit = Deadline.after(self._clock, min(step.timeout_s, deadline.remaining_s))
        answer = self._listen(step, limit)
        if answer.raw == step.send:
            answer = self._listen(step, limit)
        self._in_step = answer.status not in (ReadingStatus.GARBLED, ReadingStatus.NO_ANSWER)
        return answer

    def goodbye(self) -> None:
        """Say what the dialect says at the end; does not wait for answers."""
        for step in self._dialect.goodbye:
            self.line.write(self._encode(step), WRITE_LIMIT_S)

    def _sample_once(self, deadline: Deadline) -> Answer:
        answer = Answer(ReadingStatus.NO_ANSWER)
        for step in self._dialect.measure:
            answer = self.ask(step, deadline)
            if answer.ok:
                answer = self._wait(step, answer, deadline)
            if not answer.ok:
                return answer
        if self._dialect.confirm is None:
            return answer
        again = self.ask(self._dialect.confirm, deadline)
        if not again.ok:
            return again
        if again.value_text != answer.value_text:
            self._in_step = False
            detail = f"two transmissions of one reading differ: {answer.raw} and {again.raw}"
            return replace(again, status=ReadingStatus.GARBLED, detail=detail, ask_again=True)
        return answer

    def _wait(self, step: Step, answer: Answer, deadline: Deadline) -> Answer:
        """Wait as long as the answer asks for, or until the line comes that says "done"; returns its error, if any."""
        if not step.done:
            early_s = EARLY_S if self._dialect.busy else 0.0
            self._clock.sleep(min(max(0.0, answer.wait_s - early_s), deadline.remaining_s))
            return answer
        limit = Deadline.after(self._clock, min(answer.wait_s + DONE_LATE_S, deadline.remaining_s))
        said = self._listen(Step(send=step.send, expect=step.done), limit)
        return answer if said.ok or said.silent else said

    def _fence(self, deadline: Deadline) -> Answer:
        """Put the harmless question and drop everything up to its answer.

        An answer with a group ``tail`` could as well be a late reading: it counts only if nothing else follows.
        """
        step = self._dialect.connect[0]
        self._in_step = False
        self.line.drain(QUIET_S, DRAIN_LIMIT_S)
        self.line.write(self._encode(step), WRITE_LIMIT_S)
        limit = Deadline.after(self._clock, min(step.timeout_s, deadline.remaining_s))
        patience = self._patience(deadline)
        best = Answer(ReadingStatus.NO_ANSWER, detail="no time left", ask_again=True)
        while True:
            answer = self._listen(step, limit)
            if answer.busy and not patience.expired:
                self._clock.sleep(min(self._dialect.busy_pause_s, patience.remaining_s))
                self.line.write(self._encode(step), WRITE_LIMIT_S)
                limit = Deadline.after(self._clock, min(step.timeout_s, deadline.remaining_s))
                continue
            if answer.ok and not dict(answer.groups).get("tail"):
                self._in_step = True
                return answer
            if best.status is ReadingStatus.NO_ANSWER or not answer.silent:
                best = answer
            if answer.silent:
                break
        self._in_step = best.ok
        return best

    def _pause(self, deadline: Deadline) -> None:
        self._clock.sleep(min(self._dialect.pause_s, deadline.remaining_s))

    def _listen(self, step: Step, limit: Deadline) -> Answer:
        try:
            raw = self.line.read_line(self._line_end, self._dialect.max_line_bytes, limit.remaining_s)
        except DeviceTimeoutError as error:
            partial = bytes.fromhex(str(error.details.get("partial", "")))
            status = ReadingStatus.GARBLED if partial else ReadingStatus.NO_ANSWER
            detail = "the line was not finished" if partial else f"silence for {limit.limit_s:g} s"
            return Answer(status, shown(partial), detail=detail, ask_again=True, silent=True)
        return interpret(self._dialect, step, raw)

    def _encode(self, step: Step) -> bytes:
        return step.send.encode("ascii") + self._line_end


def interpret(dialect: Dialect, step: Step, raw: bytes) -> Answer:
    """Return what a line (without its end) means as the answer to ``step``; anything but the exact form is garbled."""
    if len(raw) > dialect.max_line_bytes:
        return _garbled(raw, "the line is too long")
    if not raw.isascii():
        return _garbled(raw, "not ASCII")
    # Some meters with a line end of one character send the other half of CR LF, too.
    text = raw.decode("ascii")
    text = text.strip("\r\n") if len(dialect.line_end) == 1 else text
    for pattern, status in dialect.error_patterns:
        if pattern.fullmatch(text):
            detail = f"the meter says {text}{', still measuring' if text in dialect.busy else ''}"
            again, busy = text in dialect.ask_again, text in dialect.busy
            return Answer(status, shown(raw), detail=detail, ask_again=again, busy=busy)
    found = step.pattern.fullmatch(text)
    if found is None:
        return _garbled(raw, "not of the form expected")
    groups = {name: value for name, value in found.groupdict().items() if value is not None}
    numbers = (groups.get(name, "") for name in ("value", "wait_s") if name in step.pattern.groupindex)
    if not all(map(_NUMBER.fullmatch, numbers)):
        return _garbled(raw, "not a number where one should be")
    for name, table in dialect.meanings.items():
        if name in groups:
            status = ReadingStatus(table.get(groups[name], "garbled"))
            if status is not ReadingStatus.OK:
                detail, garbled = f"{name} is {groups[name]!r}", status is ReadingStatus.GARBLED
                return Answer(status, shown(raw), detail=detail, ask_again=garbled)
    return Answer(
        ReadingStatus.OK,
        shown(raw),
        value_text=groups.get("value", ""),
        wait_s=min(float(groups.get("wait_s", 0)), MAX_PAUSE_S),
        groups=tuple(groups.items()),
    )


def shown(raw: bytes) -> str:
    """Return bytes as ASCII with escapes, at most `SHOWN_CHARACTERS` of them."""
    text = raw[:SHOWN_CHARACTERS].decode("ascii", "backslashreplace")
    return text.encode("unicode_escape").decode("ascii")[:SHOWN_CHARACTERS]


def _garbled(raw: bytes, detail: str) -> Answer:
    return Answer(ReadingStatus.GARBLED, shown(raw), detail=detail, ask_again=True)
