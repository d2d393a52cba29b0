"""Who is told when numba begins to compile, which takes long; code from the cache is not compiled."""

from __future__ import annotations

from collections.abc import Callable

_told: list[Callable[[], None]] = []


def tell_once(say: Callable[[], None]) -> None:
    """Have `say` called when this process compiles something for the first time."""
    _told.append(say)


def begins() -> None:
    """Numba compiles something; the module that sets up numba calls this."""
    while _told:
        _told.pop()()
