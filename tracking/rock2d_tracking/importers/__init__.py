"""File formats of other tracking programs. One module is one format: its name is the name of the format, as in
`rock2d import --kind`, and it defines `IMPORTER`.

The command line and the error messages take the formats from this folder. CONTRIBUTING.md says how to add one."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rock2d_tracking.tracked_points import Points


@dataclass(frozen=True)
class Importer:
    """How the files of one program are read.

    Attributes
    ----------
    title : name of the program
    looks_like : whether a text is likely to be a file of this program
    read : the points of a file, from its path and its text (lines end with "\\n"); raises `InputError` with the place
    """

    title: str
    looks_like: Callable[[str], bool]
    read: Callable[[Path, str], Points]


def importer_names() -> tuple[str, ...]:
    """Names of all formats in alphabetical order. Imports none of them."""
    return tuple(sorted(module.name for module in pkgutil.iter_modules(__path__)))


def find_importer(name: str) -> Importer:
    """The format called `name`, one of `importer_names()`."""
    found: Importer = importlib.import_module(f"{__name__}.{name}").IMPORTER
    return found
