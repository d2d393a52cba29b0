"""The scenario files that come with rock2d."""

from pathlib import Path


def scenario_file(name: str) -> Path:
    """Path of the scenario file `name`: inside the package if it is installed, beside it in a checkout."""
    package = Path(__file__).resolve().parents[1]
    installed = package / "scenarios" / name
    return installed if installed.exists() else package.parent / "scenarios" / name
