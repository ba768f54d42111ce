"""Konica Minolta luminance meters over serial, in any dialect; a reading has a number only when whole lines say so.

How one answer is kept apart from noise, echoes and late answers: `drivers.meter.dialogue`. Here: several
samples must agree within a limit, a display that never changes is no measurement, and a lost line is opened anew.
What remains is stated in docs/reference/meter-dialects.md.
"""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace

from drivers.clock import Clock, Deadline
from drivers.errors import BatteryLowError, DeviceError, DeviceLostError, DeviceTimeoutError, ProtocolViolationError
from drivers.link_errors import COMES_BACK
from drivers.meter.dialect import Dialect
from drivers.meter.dialogue import Answer, Dialogue
from drivers.meter.interface import MeterIdentity, MeterReading, ReadingStatus
from drivers.serial_link import ByteLine

# Chosen: a greeting is put three times, with pauses.
CONNECT_LIMIT_S = 20.0
REOPEN_PAUSE_S = 0.5  # chosen: a port is there and its permissions set within a second or two
MAX_SPREAD_FRAC = 0.10
"""Samples that differ more are no measurement of one luminance (two steps of the last digit are always allowed)."""
SUSPECT_EQUALS = 3  # chosen: equal readings in a row that are asked on
FROZEN_EQUALS = 10
"""So many equal samples in a row are a frozen display. After `SUSPECT_EQUALS` the meter is asked on until a sample
differs: at 0.1 % repeatability ten equal ones come by chance less than once in ten thousand times."""
FROZEN_RESOLUTION = 1e-3  # coarser displays (0.05 cd/m2 in two digits) may well repeat themselves


class KonicaMinoltaMeter:
    """A meter of any dialect; follows `drivers.meter.interface.Meter`.

    ``open_line``: opens the line anew, wherever the instrument is now; called by `connect` and after a loss.
    """

    kind = "konica_minolta"

    def __init__(self, open_line: Callable[[], ByteLine], dialect: Dialect, clock: Clock) -> None:
        self._open_line = open_line
        self._dialect = dialect
        self._clock = clock
        self._dialogue: Dialogue | None = None
        self._last_text = ""
        self._equals = 0
        self._closings = self._closings_before = 0
        """How often it was closed, now and when the measurement began: a line that was closed meanwhile, by another
        thread, is not opened anew."""

    def connect(self) -> MeterIdentity:
        """Open the line and go through the dialect's greeting.

        Raises `DeviceTimeoutError, ProtocolViolationError`: nothing came back, or nothing of the dialect's form;
        `BatteryLowError`: it says so; `DeviceError`: the line does not open, or is lost.
        """
        return self._connect(Deadline.after(self._clock, CONNECT_LIMIT_S))

    def measure(self, *, n_samples: int = 1, timeout_s: float = 15.0) -> MeterReading:
        """Take ``n_samples`` and return their mean and spread, or the status that spoils them.

        Raises `DeviceLostError`: the line is gone, and did not come back in time; `DeviceError`: the meter was not
        connected, and connecting failed.
        """
        if n_samples < 1:
            raise ValueError(f"n_samples is {n_samples}, at least 1 is needed")
        deadline = Deadline.after(self._clock, timeout_s)
        self._closings_before = self._closings
        samples: list[float] = []
        answer = Answer(ReadingStatus.NO_ANSWER)
        while len(samples) < n_samples or self._is_suspect(answer):
            if deadline.expired:
                break
            answer = self._sample(deadline)
            if not answer.ok:
                return self._reading(answer)
            samples.append(float(answer.value_text))
        if len(samples) < n_samples:
            detail = f"{len(samples)} of {n_samples} samples within {timeout_s:g} s"
            return self._reading(replace(answer, status=ReadingStatus.NO_ANSWER, detail=detail))
        return self._judge(samples, answer)

    def close(self) -> None:
        """Say goodbye and give the line back; never raises. A measurement that runs in another thread ends."""
        self._closings += 1
        self._drop()

    def _drop(self) -> None:
        dialogue, self._dialogue = self._dialogue, None
        self._equals = 0
        if dialogue is None:
            return
        with suppress(DeviceError):  # the line may be gone: there is nobody left to greet
            dialogue.goodbye()
        dialogue.line.close()

    def _connect(self, deadline: Deadline) -> MeterIdentity:
        self._drop()
        line = self._open_line()
        self._dialogue = Dialogue(line, self._dialect, self._clock)
        try:
            answer = self._dialogue.greet(deadline)
        except DeviceError:
            self._drop()
            raise
        if not answer.ok:
            self._drop()
            raise self._refusal(answer, line.name)
        found = dict(answer.groups)
        return MeterIdentity(
            model=found.get("model", self._dialect.title),
            serial=found.get("serial", ""),
            dialect=self._dialect.name,
            dialect_verified=self._dialect.verified,
            port=line.name,
        )

    def _refusal(self, answer: Answer, where: str) -> DeviceError:
        """Return the error of a greeting that failed."""
        title = self._dialect.title
        if answer.status is ReadingStatus.BATTERY_LOW:
            return BatteryLowError("the battery is low", where=where, advice="change it, or type: --reading")
        if answer.status is ReadingStatus.NO_ANSWER:
            likely = "the meter is off, not in remote mode, or uses another dialect"
            advice = "LS-100: hold F while switching on. Find out: daylit meter probe. Or type: --reading"
            return DeviceTimeoutError(f"no {title} answers: {answer.detail}", where=where, likely=likely, advice=advice)
        text = f"this is not what the {title} answers: {answer.detail}"
        likely = "another dialect, other port settings, or a bad cable"
        advice = "find out: daylit meter probe. Or type: --reading"
        return ProtocolViolationError(text, where=where, likely=likely, advice=advice, got=answer.raw)

    def _sample(self, deadline: Deadline) -> Answer:
        try:
            answer = self._connected(deadline).sample(deadline)
        except DeviceLostError as lost:
            self._drop()
            answer = self._sample_anew(deadline, lost)
        if answer.ok:
            self._equals = self._equals + 1 if answer.value_text == self._last_text else 1
            self._last_text = answer.value_text
        return answer

    def _sample_anew(self, deadline: Deadline, lost: DeviceLostError) -> Answer:
        """Try on a new line, until time is up: a loose plug, or the port has another number (``open_line`` knows)."""
        while True:
            try:
                return self._connected(deadline).sample(deadline)
            except DeviceError as error:
                self._drop()
                if not isinstance(error, COMES_BACK) or deadline.expired or self._closings != self._closings_before:
                    raise lost from error
            self._clock.sleep(REOPEN_PAUSE_S)

    def _connected(self, deadline: Deadline) -> Dialogue:
        if self._dialogue is None and self._closings == self._closings_before:
            self._connect(deadline)
        dialogue = self._dialogue
        if dialogue is None or self._closings != self._closings_before:
            self._drop()
            raise DeviceLostError("the meter was closed during the reading", where=self._dialect.title)
        return dialogue

    def _is_suspect(self, last: Answer) -> bool:
        return SUSPECT_EQUALS <= self._equals < FROZEN_EQUALS and _resolution_frac(last.value_text) < FROZEN_RESOLUTION

    def _judge(self, samples: list[float], last: Answer) -> MeterReading:
        mean = sum(samples) / len(samples)
        spread_cd_m2 = max(samples) - min(samples)
        spread = spread_cd_m2 / mean if mean > 0 else 0.0
        low, high = self._dialect.range_cd_m2
        status, detail = ReadingStatus.OK, ""
        if not low <= mean <= high:
            status = ReadingStatus.UNDER_RANGE if mean < low else ReadingStatus.OVER_RANGE
            detail = f"{mean:g} is outside {low:g} .. {high:g} cd/m2"
        elif spread > MAX_SPREAD_FRAC and spread_cd_m2 > 2.01 * _last_digit(last.value_text):
            status = ReadingStatus.UNSTEADY
            detail = f"samples from {min(samples):g} to {max(samples):g} cd/m2"
        elif self._equals >= FROZEN_EQUALS and _resolution_frac(last.value_text) < FROZEN_RESOLUTION:
            status = ReadingStatus.FROZEN
            detail = f"{self._equals} samples in a row are exactly {last.value_text.strip()}"
        return self._reading(replace(last, status=status, detail=detail), len(samples), spread, mean)

    def _reading(
        self, answer: Answer, n_samples: int = 1, spread_frac: float = 0.0, mean_cd_m2: float | None = None
    ) -> MeterReading:
        return MeterReading(
            status=answer.status,
            luminance_cd_m2=mean_cd_m2 if answer.ok else None,
            raw=answer.raw,
            taken_utc=self._clock.utc_now(),
            taken_monotonic_s=self._clock.monotonic_s(),
            dialect=self._dialect.name,
            dialect_verified=self._dialect.verified,
            n_samples=n_samples,
            spread_frac=spread_frac,
            detail=answer.detail,
        )


def _last_digit(value_text: str) -> float:
    """Return the weight of the last digit shown: 0.01 for "34.63"."""
    mantissa, _, exponent = value_text.strip().lower().partition("e")
    return float(10 ** (int(exponent or 0) - len(mantissa.partition(".")[2])))


def _resolution_frac(value_text: str) -> float:
    """Return the weight of the last digit relative to the value (infinite for zero)."""
    value = float(value_text)
    return _last_digit(value_text) / value if value > 0 else float("inf")
