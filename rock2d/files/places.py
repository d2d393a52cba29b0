"""Places of numbers in the data of a file: keys and list indices with dots between them, `embankment.height_m`."""

from __future__ import annotations

from typing import Any

Path_ = tuple[str | int, ...]


def place_of(place: str) -> Path_:
    """The keys and list indices of a dotted place. Block and zone names with dots cannot be reached."""
    return tuple(int(part) if part.isdigit() else part for part in place.split("."))


def number_at(data: Any, place: str) -> float | None:
    """The number at a place in the data of a scenario file; None if there is no number."""
    here = data
    try:
        for step in place_of(place):
            here = here[step]
    except (KeyError, IndexError, TypeError):
        return None
    return float(here) if isinstance(here, (int, float)) and not isinstance(here, bool) else None
