"""Tables of words that lie beside the code as TOML, as trusted as the code."""

import tomllib
from functools import cache
from importlib.resources import files
from typing import Any


@cache
def table_of(package: str, name: str) -> dict[str, Any]:
    """Return the table ``name``.toml of a package; it is shared: leave it as it is."""
    return tomllib.loads((files(package) / f"{name}.toml").read_text("utf-8"))
