"""Layers: imports of kinematics and of the diagnosis lead in one direction only."""

from __future__ import annotations

import ast
from graphlib import TopologicalSorter
from pathlib import Path

import rock2d

ROOT = Path(rock2d.__file__).parent


def imports(path: Path) -> set[str]:
    """Modules that a file imports anywhere, also inside functions and for type checking."""
    nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
    names = {alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names}
    for node in nodes:
        if isinstance(node, ast.ImportFrom) and node.module:
            names |= {node.module} | {f"{node.module}.{alias.name}" for alias in node.names}
    return names


def modules(package: str) -> dict[str, set[str]]:
    """Module -> what it imports, of all modules below a package of rock2d."""
    return {
        ".".join(("rock2d", *path.relative_to(ROOT).with_suffix("").parts)): imports(path)
        for path in (ROOT / package).rglob("*.py")
    }


def test_kinematics_knows_no_diagnosis():
    assert not [(m, name) for m, own in modules("kinematics").items() for name in own if "diagnosis" in name]


def test_no_circle_of_imports():
    own = modules("kinematics") | modules("diagnosis")
    order = TopologicalSorter({module: names & set(own) for module, names in own.items()})
    assert list(order.static_order())  # raises CycleError for a circle


def test_only_the_command_writes_the_report():
    report = "rock2d.diagnosis.report"
    users = {m for m, own in modules("diagnosis").items() if any(name.startswith(report) for name in own)}
    assert {m for m in users if not m.startswith(report)} == {"rock2d.diagnosis.command"}
