"""Which camera is set up for which stop: orders to a pair, its answers, and what holds while one of it is recovered."""

from collections import Counter
from collections.abc import Iterable, Mapping

from drivers.clock import Clock, Deadline
from station.capture.bracket import BracketPlan
from station.capture.camera_worker import CameraWorker
from station.capture.events import Breaking, Broken, Exposed, Fire, Notice, Ready, SetUp, StandDown
from station.session.session import Side

FIRE_AHEAD_S = 0.008
"""Both threads get their orders this long before the shutters are to open, more than a thread takes to wake."""
RECOVERY_LIMIT_S = 120.0
"""One attempt at a recovery and the settings anew: the drivers' own limits add up to 113 s, Theta's. The longest in the
fault campaigns (docs/measurements/reliability.md) was 15 s."""


class Pairing:
    """Orders cameras and keeps their answers, by side and stop."""

    def __init__(self, plan: BracketPlan, workers: Mapping[Side, CameraWorker], clock: Clock) -> None:
        self.retakes: Counter[tuple[Side, int]] = Counter()
        self.repeats = False
        """Whether what is ordered is compared only: the end of a bracket."""
        self.released_s: dict[Side, float] = {}
        """When each camera of the last pair was released, monotonic seconds."""
        self.plan = plan
        self._workers = workers
        self._clock = clock
        self._answers: dict[tuple[Side, int], Notice] = {}
        self._ahead: dict[Side, int] = {}
        self._let_go: set[Side] = set()
        """Cameras stood down since the last pair was ordered: their Ready is out of date."""
        self._n_orders: Counter[Side] = Counter()
        self._breaking: dict[Side, Deadline] = {}

    def set_up(self, stop: int, sides: tuple[Side, ...]) -> None:
        """Order the set-up of a stop from the sides that have not been ordered it ahead; forget other orders ahead."""
        self._let_go.clear()
        for side, worker in self._workers.items():
            ahead = self._ahead.pop(side, None)
            if ahead == stop and side in sides:
                continue
            if ahead is not None:
                worker.order(StandDown())
            if side in sides:
                self._order(side, stop)

    def set_up_ahead(self, side: Side, stop: int) -> None:
        """Let a camera that is through set the next stop while its partner still exposes or saves."""
        if not self._breaking:
            self._ahead[side] = stop
            self._order(side, stop)

    def _order(self, side: Side, stop: int) -> None:
        self._answers.pop((side, stop), None)
        self._n_orders[side] += 1
        shutter_s, retakes = self.plan.stops_s[stop], self.retakes[side, stop]
        self._workers[side].order(SetUp(stop, shutter_s, retakes, self.repeats, self._n_orders[side]))

    def fire(self, stop: int, sides: tuple[Side, ...]) -> None:
        """Order the shutters of a pair that is ready to open together."""
        for side in sides:
            del self._answers[side, stop]
        self.released_s = {}
        open_at_s = self._clock.monotonic_s() + FIRE_AHEAD_S + max(self._workers[s].release_lag_s for s in sides)
        for side in sides:
            self._workers[side].order(Fire(open_at_s))

    def stand_down(self, sides: Iterable[Side]) -> None:
        """Let cameras go that are armed."""
        for side in sides:
            self._ahead.pop(side, None)
            self._let_go.add(side)
            self._workers[side].order(StandDown())

    def take(self, notice: Ready | Exposed | Breaking | Broken) -> None:
        """Take an answer in. A camera that breaks would leave its partners armed for as long as its recovery takes."""
        side = notice.side
        if isinstance(notice, Breaking):
            self._breaking[side] = Deadline.after(self._clock, RECOVERY_LIMIT_S)
            self.stand_down(partner for partner in self._workers if partner != side)
            return
        if isinstance(notice, Ready) and notice.number != self._n_orders[side]:
            return
        if isinstance(notice, Broken):
            self._breaking.pop(side, None)
        if notice.stop is not None:
            self._answers[side, notice.stop] = notice

    def recovering(self) -> bool:
        """Whether a camera is being recovered; `DeviceTimeoutError` where that takes too long."""
        for side, deadline in self._breaking.items():
            deadline.check("end of the recovery", str(side))
        return bool(self._breaking)

    def answered(self, stop: int, sides: Iterable[Side]) -> bool:
        """Whether each of the sides has answered for the stop."""
        return all((side, stop) in self._answers for side in sides)

    def ready(self, stop: int, sides: Iterable[Side]) -> bool:
        """Whether each of the sides is armed for the stop."""
        return all(isinstance(self._answers.get((s, stop)), Ready) and s not in self._let_go for s in sides)

    def broken(self, stop: int, sides: Iterable[Side]) -> tuple[Side, ...]:
        """Return the sides that broke at the stop."""
        return tuple(side for side in sides if isinstance(self._answers.get((side, stop)), Broken))

    def start_skew_s(self) -> float:
        """Return how far apart the shutters of the last pair opened; 0 where one opened alone."""
        opened_s = [at_s + self._workers[side].release_lag_s for side, at_s in self.released_s.items()]
        return max(opened_s, default=0.0) - min(opened_s, default=0.0)
