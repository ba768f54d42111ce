"""Writes docs/reference/api.md from the docstrings of what ``import daylit`` offers.

python docs/make_api.py          # after a public name or its docstring has changed; a test compares
"""

from __future__ import annotations

import dataclasses
import inspect
import re
import sys
import typing
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "reference" / "api.md"
HEAD = """# Python API

Generated from docstrings by `docs/make_api.py`. Names are imported when they are used, so that `import daylit` costs
nothing. Paths are `str`, `Path` or `Session`; errors are those of the command line, with code, likely cause and advice.
[examples/first_room.py](../../examples/first_room.py) and the notebook beside it use them.
"""


def page() -> str:
    """Return the page's text: functions first, then types, each in alphabetical order."""
    import daylit

    found = {name: getattr(daylit, name) for name in daylit.__all__}
    functions = [name for name in found if inspect.isfunction(found[name])]
    types = [name for name in found if name not in functions]
    parts = [HEAD, "## Functions", *(_function(name, found[name]) for name in functions)]
    parts += ["## Types", *(_type(name, found[name]) for name in types)]
    return "\n\n".join(part.strip() for part in parts) + "\n"


def _function(name: str, function: typing.Any) -> str:
    signature = inspect.signature(function)
    lines = []
    for parameter in signature.parameters.values():
        if parameter.kind is parameter.KEYWORD_ONLY and "    *," not in lines:
            lines.append("    *,")
        stars = "**" if parameter.kind is parameter.VAR_KEYWORD else ""
        default = "" if parameter.default is parameter.empty else f" = {parameter.default!r}"
        lines.append(f"    {stars}{parameter.name}: {parameter.annotation}{default},")
    called = "\n".join([f"{name}(", *lines, f") -> {signature.return_annotation}"])
    return f"### {name}\n\n```text\n{called}\n```\n\n{_text(function)}"


def _type(name: str, kind: typing.Any) -> str:
    if not inspect.isclass(kind):
        return f"### {name}\n\n`{' | '.join(part.__name__ for part in typing.get_args(kind))}`"
    lines = [f"### {name}", _text(kind)]
    fields = [f.name for f in dataclasses.fields(kind)] if dataclasses.is_dataclass(kind) else []
    fields += list(getattr(kind, "model_fields", {}))
    if fields:
        lines.append("Fields: " + ", ".join(f"`{field}`" for field in fields) + ".")
    for member, value in vars(kind).items():
        target = value.fget if isinstance(value, property) else value
        if member.startswith("_") or not inspect.isfunction(target) or not target.__doc__:
            continue
        call = "" if isinstance(value, property) else "()"
        lines.append(f"* `{member}{call}`: {' '.join(inspect.cleandoc(target.__doc__).split())}")
    return "\n\n".join(lines)


def _text(thing: object) -> str:
    """Return a docstring as Markdown: parameters as a list, examples as code."""
    text, _, example = (inspect.getdoc(thing) or "").replace("``", "`").partition("\n\nExample\n-------\n")
    text = re.sub(r"^(\w+)\n-+$", r"**\1**\n", text, flags=re.M)
    text = re.sub(r"^([\w, ]+)\n    ", r"* `\1`: ", text, flags=re.M)
    text = re.sub(r"^    ", "  ", text, flags=re.M)
    return text + (f"\n\n```text\n{example}\n```" if example else "")


def main() -> int:
    """Write the page."""
    PAGE.parent.mkdir(parents=True, exist_ok=True)
    PAGE.write_text(page(), "utf-8")
    return 0


if __name__ == "__main__":
    sys.path.insert(0, str(ROOT))
    sys.exit(main())
