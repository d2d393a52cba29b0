"""Registries: things of one kind, found by the folder that their files lie in."""

import re
from collections.abc import Mapping
from functools import cache
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import Any


@cache
def registered(package: str, constant: str) -> Mapping[str, Any]:
    """Everything that the modules of a package define as `constant`, by its `name`, in the order of the names.

    A module defines one thing as the constant, or a tuple of several as its plural; other modules are not imported.
    Raises ValueError if two things share a name."""
    found: dict[str, Any] = {}
    for path in sorted(Path(import_module(package).__path__[0]).glob("*.py")):
        if defined := re.search(rf"^{constant}(S?)\b", path.read_text(encoding="utf-8"), re.MULTILINE):
            own = getattr(import_module(f"{package}.{path.stem}"), defined[0])
            for one in own if defined[1] else (own,):
                if one.name in found:
                    raise ValueError(f"two of {package} are named {one.name}; one is in {path.name}")
                found[one.name] = one
    return MappingProxyType(dict(sorted(found.items())))
