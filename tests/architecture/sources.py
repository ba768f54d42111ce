"""The parsed source of a file, read once for all rules."""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path


@cache
def tree_of(path: Path) -> ast.Module:
    return ast.parse(path.read_text("utf-8"))


@cache
def nodes_of(path: Path) -> tuple[ast.AST, ...]:
    """Return what the rules look at: imports, functions, branches and texts."""
    kinds = (ast.Import, ast.ImportFrom, ast.FunctionDef, ast.AsyncFunctionDef, ast.If, ast.Constant)
    return tuple(node for node in ast.walk(tree_of(path)) if isinstance(node, kinds))
