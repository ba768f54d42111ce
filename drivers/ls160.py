"""Konica Minolta luminance meters over serial, in any dialect; a reading has a number only when a whole line says so.

What is done about a noisy line: bytes that are on it before a question are thrown away (a late answer is never taken
for this one), a line counts only if all of it has the dialect's form, a line that has not is asked again a bounded
number of times, and several samples must agree within a limit. What remains is stated in docs/meter-dialects.md.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace

from drivers.clock import Clock, Deadline
from drivers.errors import DeviceError, DeviceTimeoutError
from drivers.meter import MeterIdentity, MeterReading, ReadingStatus
from drivers.meter_dialect import Dialect, Step
from drivers.serial_link import ByteLine

MAX_ASKS = 3
"""A garbled answer is asked again so often in all."""
MAX_SPREAD_FRAC = 0.10
"""Samples that differ more are no measurement of one luminance."""
FROZEN_SAMPLES = 5
FROZEN_RESOLUTION = 2e-3
"""So many equal samples in a row, shown to better than this relative resolution, are a frozen display: a live meter
of 0.1 % repeatability gives that less than once in ten thousand."""
DRAIN_QUIET_S = 0.02
DRAIN_LIMIT_S = 0.5
RESYNC_QUIET_S, RESYNC_LIMIT_S = 1.5, 6.0
"""After silence or garbage the line must be quiet for so long before the next question: an answer that is late would
otherwise be taken for the next one's."""
WRITE_LIMIT_S = 2.0
RETRYABLE = (ReadingStatus.GARBLED, ReadingStatus.NO_ANSWER)


@dataclass(frozen=True)
class _Answer:
    status: ReadingStatus
    raw: str
    value_text: str = ""
    wait_s: float = 0.0
    groups: tuple[tuple[str, str], ...] = ()
    detail: str = ""


class KonicaMinoltaMeter:
    """A meter of any dialect; follows `drivers.meter.Meter`.

    Parameters
    ----------
    open_line
        Opens the line anew; called by `connect`.
    dialect
        What the meter speaks.
    clock
        Time.
    """

    kind = "konica_minolta"

    def __init__(self, open_line: Callable[[], ByteLine], dialect: Dialect, clock: Clock) -> None:
        self._open_line = open_line
        self._dialect = dialect
        self._clock = clock
        self._line: ByteLine | None = None
        self._recent: list[str] = []
        self._in_step = True

    def connect(self) -> MeterIdentity:
        """Open the line and go through the dialect's greeting.

        Raises
        ------
        DeviceTimeoutError
            Nothing of the dialect's form came back.
        DeviceError
            The line does not open.
        """
        self.close()
        self._line = self._open_line()
        found: dict[str, str] = {}
        for step in self._dialect.connect:
            answer = self._ask_patiently(step)
            if answer.status is not ReadingStatus.OK:
                name = self._line.name
                self.close()
                raise DeviceTimeoutError(
                    f"no {self._dialect.title} answers: {answer.status} {answer.detail} {answer.raw!r}",
                    where=name,
                    likely="it is off, not in remote mode, or speaks another dialect",
                    advice="LS-100: hold F while switching on. Find out: daylit meter probe. Or type: --reading",
                )
            found |= dict(answer.groups)
        return MeterIdentity(
            model=found.get("model", self._dialect.title),
            serial=found.get("serial", ""),
            dialect=self._dialect.name,
            dialect_verified=self._dialect.verified,
            port=self._line.name,
        )

    def measure(self, *, n_samples: int = 1, timeout_s: float = 15.0) -> MeterReading:
        """Take ``n_samples`` and return their mean and spread, or the status that spoils them.

        Raises
        ------
        DeviceLostError
            The line is gone. Anything the meter itself says, or does not say, is a status.
        """
        if n_samples < 1:
            raise ValueError(f"n_samples is {n_samples}, at least 1 is needed")
        deadline = Deadline.after(self._clock, timeout_s)
        samples: list[float] = []
        answer = _Answer(ReadingStatus.NO_ANSWER, "", detail=f"no reading within {timeout_s:g} s")
        while len(samples) < n_samples and not deadline.expired:
            answer = self._one_sample(deadline)
            if answer.status is not ReadingStatus.OK:
                return self._reading(answer)
            samples.append(float(answer.value_text))
        if len(samples) < n_samples:
            detail = f"{len(samples)} of {n_samples} samples within {timeout_s:g} s"
            return self._reading(replace(answer, status=ReadingStatus.NO_ANSWER, detail=detail))
        return self._judge(samples, answer)

    def close(self) -> None:
        """Say goodbye and give the line back; never raises."""
        line, self._line = self._line, None
        self._recent.clear()
        if line is None:
            return
        with suppress(DeviceError):  # the line may be gone: there is nobody left to tell
            for step in self._dialect.goodbye:
                line.write(self._encode(step), WRITE_LIMIT_S)
        line.close()

    def _one_sample(self, deadline: Deadline) -> _Answer:
        """Go through the measuring steps; a garbled or missing answer starts them anew, a bounded number of times."""
        answer = _Answer(ReadingStatus.NO_ANSWER, "", detail="no time left")
        for _ in range(MAX_ASKS):
            for step in self._dialect.measure:
                answer = self._ask(step, min(step.timeout_s, deadline.remaining_s))
                if answer.status is not ReadingStatus.OK:
                    break
                self._clock.sleep(min(answer.wait_s, deadline.remaining_s))
            if answer.status not in RETRYABLE or deadline.expired:
                return answer
        return answer

    def _ask_patiently(self, step: Step) -> _Answer:
        answer = self._ask(step, step.timeout_s)
        for _ in range(MAX_ASKS - 1):
            if answer.status not in RETRYABLE:
                break
            answer = self._ask(step, step.timeout_s)
        return answer

    def _ask(self, step: Step, timeout_s: float) -> _Answer:
        line = self._open()
        self._clock.sleep(self._dialect.pause_s)
        if self._in_step:
            line.drain(DRAIN_QUIET_S, DRAIN_LIMIT_S)
        else:
            line.drain(RESYNC_QUIET_S, RESYNC_LIMIT_S)
        line.write(self._encode(step), WRITE_LIMIT_S)
        self._in_step = False
        try:
            raw = line.read_line(self._dialect.line_end.encode(), self._dialect.max_line_bytes, timeout_s)
        except DeviceTimeoutError as error:
            partial = bytes.fromhex(str(error.details.get("partial", "")))
            status = ReadingStatus.GARBLED if partial else ReadingStatus.NO_ANSWER
            return _Answer(status, _shown(partial), detail="the line was not finished" if partial else "silence")
        answer = interpret(self._dialect, step, raw)
        self._in_step = answer.status is not ReadingStatus.GARBLED
        return answer

    def _open(self) -> ByteLine:
        if self._line is None:
            self._line = self._open_line()
        return self._line

    def _encode(self, step: Step) -> bytes:
        return (step.send + self._dialect.line_end).encode("ascii")

    def _judge(self, samples: list[float], last: _Answer) -> MeterReading:
        mean = sum(samples) / len(samples)
        spread = (max(samples) - min(samples)) / mean if mean > 0 else 0.0
        low, high = self._dialect.range_cd_m2
        if not low <= mean <= high:
            status = ReadingStatus.UNDER_RANGE if mean < low else ReadingStatus.OVER_RANGE
            return self._reading(replace(last, status=status, detail=f"{mean:g} is outside {low:g} .. {high:g} cd/m2"))
        if spread > MAX_SPREAD_FRAC:
            detail = f"samples from {min(samples):g} to {max(samples):g} cd/m2"
            return self._reading(replace(last, status=ReadingStatus.UNSTEADY, detail=detail), len(samples), spread)
        self._recent = [*self._recent, *(f"{s!r}" for s in samples)][-FROZEN_SAMPLES:]
        if self._is_frozen(last.value_text):
            detail = f"{FROZEN_SAMPLES} readings in a row are exactly {last.value_text.strip()}"
            return self._reading(replace(last, status=ReadingStatus.FROZEN, detail=detail), len(samples), spread)
        return self._reading(last, len(samples), spread, mean)

    def _is_frozen(self, value_text: str) -> bool:
        same = len(self._recent) == FROZEN_SAMPLES and len(set(self._recent)) == 1
        decimals = len(value_text.strip().partition(".")[2])
        value = float(value_text)
        return same and value > 0 and 10**-decimals / value < FROZEN_RESOLUTION

    def _reading(
        self, answer: _Answer, n_samples: int = 1, spread_frac: float = 0.0, value: float | None = None
    ) -> MeterReading:
        return MeterReading(
            status=answer.status,
            luminance_cd_m2=value,
            raw=answer.raw,
            taken_utc=self._clock.utc_now(),
            taken_monotonic_s=self._clock.monotonic_s(),
            dialect=self._dialect.name,
            dialect_verified=self._dialect.verified,
            n_samples=n_samples,
            spread_frac=spread_frac,
            detail=answer.detail,
        )


def interpret(dialect: Dialect, step: Step, raw: bytes) -> _Answer:
    """Return what a line means as the answer to ``step``; anything but the exact form is garbled."""
    shown = _shown(raw)
    if len(raw) > dialect.max_line_bytes:
        return _Answer(ReadingStatus.GARBLED, shown, detail="the line is too long")
    try:
        text = raw.decode("ascii")
    except UnicodeDecodeError:
        return _Answer(ReadingStatus.GARBLED, shown, detail="not ASCII")
    for pattern, status in dialect.error_patterns:
        if pattern.fullmatch(text):
            return _Answer(status, shown, detail=f"the meter says {text}")
    found = step.pattern.fullmatch(text)
    if found is None:
        return _Answer(ReadingStatus.GARBLED, shown, detail="not of the form expected")
    groups = {name: value for name, value in found.groupdict().items() if value is not None}
    for name, table in dialect.meanings.items():
        if name in groups:
            status = ReadingStatus(table.get(groups[name], "garbled"))
            if status is not ReadingStatus.OK:
                return _Answer(status, shown, detail=f"{name} is {groups[name]!r}")
    return _Answer(
        ReadingStatus.OK,
        shown,
        value_text=groups.get("value", ""),
        wait_s=float(groups.get("wait_s", 0)),
        groups=tuple(groups.items()),
    )


def _shown(raw: bytes) -> str:
    """Return bytes as ASCII with escapes, at most 120 characters."""
    return raw.decode("ascii", "backslashreplace").encode("unicode_escape").decode("ascii")[:120]
