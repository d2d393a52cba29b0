"""Registries: things of one kind, one file each, found by the folder that they lie in."""

import re
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import Any


def registered(package: str, init_file: str, constant: str) -> Mapping[str, Any]:
    """Everything that the modules of a package define as `constant`, by its `name`, in the order of the names.

    package, init_file : `__name__` and `__file__` of the package. Modules that do not define the constant are not
    imported. Raises ValueError if two things share a name."""
    found: dict[str, Any] = {}
    for path in sorted(Path(init_file).parent.glob("*.py")):
        if re.search(rf"^{constant}\b", path.read_text(encoding="utf-8"), re.MULTILINE):
            one = getattr(import_module(f"{package}.{path.stem}"), constant)
            if one.name in found:
                raise ValueError(f"two of {package} are named {one.name}; one is in {path.name}")
            found[one.name] = one
    return MappingProxyType(dict(sorted(found.items())))
