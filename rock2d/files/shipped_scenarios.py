"""The scenario files that come with rock2d."""

from __future__ import annotations

from pathlib import Path


def scenario_file(name: str) -> Path:
    """Path of the scenario file `name`: inside an installed package, beside the package in a checkout."""
    package = Path(__file__).resolve().parents[1]
    installed = package / "scenarios" / name
    return installed if installed.exists() else package.parent / "scenarios" / name
