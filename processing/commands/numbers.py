"""Options that are numbers with commas between, such as ``--at LON,LAT``."""

from __future__ import annotations

import math

import click


def numbers(flag: str, text: str, count: int, what: str) -> tuple[float, ...]:
    """Return the numbers of an option's text; `click.UsageError` says how many it takes, and of ``what``."""
    try:
        values = tuple(float(part) for part in text.split(","))
    except ValueError:
        values = ()
    if len(values) != count or not all(map(math.isfinite, values)):
        raise click.UsageError(f"{flag} {text[:40]!r}: {count} numbers with commas between, {what}")
    return values
