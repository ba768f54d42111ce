"""The device side of PTP, over USB or TCP."""
