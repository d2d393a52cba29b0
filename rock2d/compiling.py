"""Where compiled code is kept, and who hears when numba begins and ends to compile, which takes long; code from the
cache is not compiled."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

COMPILING = "compiling, once for this version (about a minute)"
_listeners: list[Callable[[bool], None]] = []
_depth = 0  # functions are compiled within others


def cache_root() -> Path:
    """The folder in which rock2d keeps what it can compute again; not made here."""
    return Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "rock2d"


@contextmanager
def heard(listener: Callable[[bool], None]) -> Iterator[None]:
    """In the block, this process calls `listener(True)` when it begins to compile, and `listener(False)` at the end.
    The innermost listener hears it alone."""
    _listeners.append(listener)
    try:
        yield
    finally:
        _listeners.remove(listener)


@contextmanager
def compiling() -> Iterator[None]:
    """Numba compiles something in the block, or waits for another process that does."""
    begins()
    try:
        yield
    finally:
        ends()


def begins() -> None:
    """Numba compiles something; the module that sets up numba calls this."""
    global _depth
    _depth += 1
    if _depth == 1 and _listeners:
        _listeners[-1](True)


def ends() -> None:
    """What began last is compiled."""
    global _depth
    _depth -= 1
    if _depth == 0 and _listeners:
        _listeners[-1](False)
