"""Rooms: the packages form floors, and a room imports only from the floors below it.

`python -m tests.test_rooms` prints the table of CONTRIBUTING.md."""

import ast
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = {"rock2d": ROOT, "rock2d_tracking": ROOT / "tracking", "rock2d_figures": ROOT / "figures"}
# from top to bottom: rooms -> what they hold; rooms of the first and the last floor may import one another
FLOORS = {
    ("cli", "commands", "api", "schemas", "interrupts", "rock2d"): "command line, public API",
    ("rock2d_figures",): "figures of the paper and of the documentation",
    ("blind", "field_tests", "reproduction"): "studies: trials of the diagnosis; measured releases; the paper",
    ("design", "diagnosis", "rock2d_tracking"): "how sure, which size, report; film against simulation; film → track",
    ("runs",): "scenario → results",
    ("graphics", "kinematics"): "pictures and pages; frames → flights and impacts",
    ("files", "engines"): "files in and out; laws → motion",
    ("effects",): "catalogue of effects",
    ("laws",): "pure functions of state and parameters",
    ("scene", "records", "calibration"): "blocks, ground, worlds; tracks; posteriors",
    (
        "arrays", "compiled", "compiling", "progress", "processes", "cluster", "registry", "statistics", "wording",
        "errors", "version",
    ): "helpers",
}  # fmt: skip


def table() -> str:
    """The floors in Markdown."""
    rows = ["| floor | rooms | what they hold |", "|---|---|---|"]
    for floor, (rooms, words) in zip(range(len(FLOORS) - 1, -1, -1), FLOORS.items(), strict=True):
        rows.append(f"| {floor} | {', '.join(f'`{room}`' for room in rooms)} | {words} |")
    return "\n".join(rows)


def room(module: str) -> str:
    """The room of a module."""
    package, *parts = module.split(".")
    return parts[0] if package == "rock2d" and parts else package


MODULES = {
    ".".join(path.relative_to(folder).with_suffix("").parts).removesuffix(".__init__"): path
    for package, folder in PACKAGES.items()
    for path in (folder / package).rglob("*.py")
}


def module_of(name: str) -> str:
    """The module that is imported, or from which a name is imported."""
    return name if name in MODULES else name.rpartition(".")[0]


@cache
def imports() -> tuple[tuple[str, str], ...]:
    """(module, module that it imports) of this project, also inside functions and for type checking."""
    found: list[tuple[str, str]] = []
    for module, path in MODULES.items():
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import | ast.ImportFrom):
                start = f"{node.module}." if isinstance(node, ast.ImportFrom) else ""
                names = [f"{start}{alias.name}" for alias in node.names]
                found += ((module, module_of(name)) for name in names if name.split(".")[0] in PACKAGES)
    return tuple(found)


def test_rooms_import_only_from_the_floors_below():
    floors = {own: floor for floor, rooms in enumerate(FLOORS) for own in rooms}
    level = {0, len(FLOORS) - 1}
    upwards = [
        (module, name)
        for module, name in imports()
        if (own := room(module)) != (other := room(name))
        and (floors[other] < floors[own] or (floors[other] == floors[own] and floors[own] not in level))
    ]
    assert not upwards


@pytest.mark.parametrize("part", [room, str])
def test_no_room_and_no_module_imports_itself_through_others(part):
    graph: dict[str, set[str]] = {}
    for module, name in imports():
        if part(module) != part(name):
            graph.setdefault(part(module), set()).add(part(name))
    assert list(TopologicalSorter(graph).static_order())  # raises CycleError for a circle


def test_only_the_command_of_the_diagnosis_writes_its_report():
    report = "rock2d.diagnosis.report"
    users = {module for module, name in imports() if room(module) == "diagnosis" and name.startswith(report)}
    assert {m for m in users if not m.startswith(report)} == {"rock2d.diagnosis.command"}


def test_contributing_shows_the_floors():
    assert table() in (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")


if __name__ == "__main__":
    print(table())
