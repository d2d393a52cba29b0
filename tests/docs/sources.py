"""The texts of the documentation: pages written by hand, pages made from the code, and the files of the root."""

import importlib
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
ROOT_FILES = ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")


def generator() -> Any:
    """The module that makes pages from the code."""
    folder = str(DOCS / "hooks")
    if folder not in sys.path:
        sys.path.insert(0, folder)
    return importlib.import_module("pages")


def pages() -> Iterator[tuple[Path, str]]:
    """Every text with the place at which its links start."""
    for name in ROOT_FILES:
        yield ROOT / name, (ROOT / name).read_text(encoding="utf-8")
    for path in sorted(DOCS.rglob("*.md")):
        if "hooks" not in path.relative_to(DOCS).parts:
            yield path, path.read_text(encoding="utf-8")
    for name, make in generator().PAGES.items():
        yield DOCS / name, make()
