"""Places of numbers in the data of a file: keys and list indices joined by dots, such as `embankment.height_m`."""

from collections.abc import Iterator
from typing import Any, TypeGuard

DataPath = tuple[str | int, ...]  # keys and list indices from the top of the data


def place_of(data: Any, place: str) -> DataPath | None:
    """The keys and list indices that lead to a place in the data of a file; None if there is no such place.

    A key may contain dots: of the keys that fit, the longest is taken."""
    path: list[str | int] = []
    here, rest = data, place
    while rest:
        if isinstance(here, list):
            word, _, tail = rest.partition(".")
            if not word.isdigit() or int(word) >= len(here):
                return None
            step: str | int = int(word)
        elif isinstance(here, dict):
            fits = [key for key in here if isinstance(key, str) and (rest == key or rest.startswith(f"{key}."))]
            if not fits:
                return None
            step = max(fits, key=len)
            tail = rest[len(step) + 1 :]
        else:
            return None
        path.append(step)
        here, rest = here[step], tail
    return tuple(path)


def value_at(data: Any, path: DataPath) -> Any:
    """The value at a path that `place_of` gave."""
    for step in path:
        data = data[step]
    return data


def is_number(value: Any) -> TypeGuard[int | float]:
    """Whether a value of a file is a number; true and false are none."""
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def number_at(data: Any, place: str) -> float | None:
    """The number at a place in the data of a scenario file; None if there is no number."""
    path = place_of(data, place)
    value = None if path is None else value_at(data, path)
    return float(value) if is_number(value) else None


def places_of_numbers(data: Any, above: str = "") -> Iterator[str]:
    """The places of all numbers in the data of a file."""
    if isinstance(data, (dict, list)):
        for step, own in data.items() if isinstance(data, dict) else enumerate(data):
            yield from places_of_numbers(own, f"{above}.{step}".lstrip("."))
    elif is_number(data):
        yield above
