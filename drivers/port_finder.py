"""Which port is the meter on, now and after it was plugged in again?"""

from __future__ import annotations

import os
from collections.abc import Callable, Collection

from drivers.clock import Clock
from drivers.errors import DeviceNotFoundError
from drivers.serial_link import PortInfo, PortSettings, SerialLink, list_ports


class PortOpener:
    """Opens the port of one and the same instrument each time, whatever number it has by then.

    Parameters
    ----------
    port
        Name of the port, or ``"auto"``: the only one with one of the ``usb_ids``.
    settings
        Line settings.
    ports
        Lists the ports.
    """

    def __init__(
        self,
        port: str,
        settings: PortSettings,
        *,
        usb_ids: Collection[tuple[int, int]] = (),
        clock: Clock | None = None,
        ports: Callable[[], list[PortInfo]] | None = None,
    ) -> None:
        self._port = port
        self._settings = settings
        self._usb_ids = usb_ids
        self._clock = clock
        self._ports = ports or list_ports
        self._known: PortInfo | None = None

    def __call__(self) -> SerialLink:
        """Open the port.

        Raises `DeviceNotFoundError`: the instrument that was there before is not there now (another one does not
        count), or none is; `DeviceError`: see `SerialLink.open`.
        """
        name = self._name_now()
        link = SerialLink.open(name, self._settings, clock=self._clock)
        real = os.path.realpath(name)
        self._known = next((p for p in self._ports() if os.path.realpath(p.device) == real), self._known)
        return link

    def _name_now(self) -> str:
        if self._known is None or not self._known.serial:
            return find_port(self._usb_ids, ports=self._ports) if self._port == "auto" else self._port
        known = self._known
        same = (known.vendor_id, known.product_id, known.serial)
        for port in self._ports():
            if (port.vendor_id, port.product_id, port.serial) == same:
                return port.device
        raise DeviceNotFoundError(
            f"the instrument with serial number {known.serial} is not among the ports",
            where=self._port,
            likely="it is unplugged or off",
            advice="plug it in, into whatever socket",
        )


def find_port(
    usb_ids: Collection[tuple[int, int]], serial_number: str = "", *, ports: Callable[[], list[PortInfo]] = list_ports
) -> str:
    """Return the port of the instrument with one of these USB ids (and serial number), whatever its number now.

    Raises `DeviceNotFoundError`: none, or several without a serial number to choose by.
    """
    found = [
        p
        for p in ports()
        if (p.vendor_id, p.product_id) in usb_ids and (not serial_number or p.serial == serial_number)
    ]
    if len(found) == 1:
        return found[0].stable_name
    what = "no meter" if not found else f"{len(found)} meters ({', '.join(p.device for p in found)})"
    raise DeviceNotFoundError(
        f"{what} among the serial ports",
        where="meter",
        likely="it is off, or it sits on an RS-232 adapter that does not tell what is behind it",
        advice='name the port in the rig: [meter] port = "/dev/ttyUSB0"',
    )
