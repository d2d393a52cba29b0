"""Reproduction computes; the figures draw. Nothing in rock2d except the command line imports the figures."""

from __future__ import annotations

import ast
from pathlib import Path

import rock2d


def test_only_the_command_line_imports_the_figures():
    root = Path(rock2d.__file__).parent
    importers = set()
    for path in root.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            if any(name.split(".")[0] == "rock2d_figures" for name in names):
                importers.add(path.relative_to(root).as_posix())
    assert importers <= {"cli.py"}
