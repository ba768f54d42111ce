"""What is watched while no bracket runs: cameras kept awake and found again, batteries and cards."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress

from drivers.camera import CameraStatus
from drivers.clock import Clock
from drivers.errors import DeviceError
from station.capture.preflight import Check, Level
from station.capture.rig import Rig
from station.session.session import Side

LOOK_S = 5.0
"""Chosen: as often a camera is kept awake or looked for; EOS programs keep alive about every 10 s (libgphoto2)."""


class Watch:
    """Looks after the cameras of a rig between two brackets; not while a capture has them."""

    def __init__(self, rig: Rig, clock: Clock) -> None:
        self._rig = rig
        self._clock = clock
        self._away: dict[Side, str] = {}
        self._looked_s = clock.monotonic_s() - LOOK_S
        self._charge: dict[Side, list[float]] = {side: [] for side in rig.cameras}
        """Battery after each bracket, 0 to 1."""

    def look(self) -> Iterator[str]:
        """Keep each camera awake, or look for it; yields, every `LOOK_S`, who went and who is back."""
        if self._clock.monotonic_s() - self._looked_s < LOOK_S:
            return
        self._looked_s = self._clock.monotonic_s()
        for side, camera in self._rig.cameras.items():
            try:
                if side in self._away:
                    camera.connect()
                    del self._away[side]
                    yield f"{side}: the camera is there"
                else:
                    camera.keep_alive()
            except DeviceError as error:
                if self._away.get(side) != error.message:
                    self._away[side] = error.message
                    yield f"{side}: {error.message}"
                camera.close()

    def forget(self) -> None:
        """Take every camera for unconnected: what used it has failed, or it was never there."""
        self._away = dict.fromkeys(self._rig.cameras, "")
        self._looked_s = self._clock.monotonic_s() - LOOK_S

    def wants(self, frames: int) -> list[Check]:
        """Return what forbids a bracket of ``frames`` pictures a camera now; empty: it may begin."""
        found = [Check(Level.FAIL, str(side), why or "not connected") for side, why in self._away.items()]
        for side, status in self._statuses():
            limit = self._rig.file.limits.min_battery_frac
            if status.battery_frac is not None and status.battery_frac < limit:
                text = f"battery at {status.battery_frac:.0%}, the limit is {limit:.0%}"
                found.append(Check(Level.FAIL, f"{side} battery", text, "change the battery"))
            if status.free_frames is not None and status.free_frames < frames:
                text = f"room for {status.free_frames} frames on the card, {frames} needed"
                found.append(Check(Level.FAIL, f"{side} card", text, "change the card, or delete_after in the rig"))
            found += [Check(Level.FAIL, str(side), problem) for problem in status.problems]
        return found

    def outlook(self, frames: int, brackets: int) -> list[str]:
        """Return what will not last for ``brackets`` more of ``frames`` pictures a camera, after one has been taken."""
        found = []
        for side, status in self._statuses():
            if status.free_frames is not None and status.free_frames < brackets * frames:
                lasts = status.free_frames // max(frames, 1)
                found.append(f"{side}: the card has room for {lasts} of {brackets} brackets to come")
            if status.battery_frac is None:
                continue
            charge = self._charge[side]
            charge.append(status.battery_frac)
            used = max(charge[0] - charge[-1], 0.0) / max(len(charge) - 1, 1)
            left = status.battery_frac - self._rig.file.limits.min_battery_frac
            if used and left < brackets * used:
                found.append(
                    f"{side}: the battery lasts for about {max(int(left / used), 0)} of {brackets} brackets to come"
                )
            if len(charge) > 1 and charge[-1] > charge[-2]:
                charge[:] = charge[-1:]  # another battery
        return found

    def _statuses(self) -> Iterator[tuple[Side, CameraStatus]]:
        for side, camera in self._rig.cameras.items():
            if side not in self._away:
                with suppress(DeviceError):  # the next look finds it gone
                    yield side, camera.status()
