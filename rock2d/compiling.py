"""The cache folder of rock2d, and listeners that are told when numba begins and ends to compile."""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

COMPILING = "compiling, once for this version (about a minute)"
_listeners: list[Callable[[bool], None]] = []
_depth = 0  # the compilation of a function compiles others


def cache_root() -> Path:
    """The cache folder of rock2d; it may not exist yet."""
    return Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "rock2d"


@contextmanager
def listening(listener: Callable[[bool], None]) -> Iterator[None]:
    """In the block, `listener(True)` is called when this process begins to compile, and `listener(False)` at the end.
    Of nested blocks, only the innermost listener is called."""
    _listeners.append(listener)
    try:
        yield
    finally:
        _listeners.remove(listener)


@contextmanager
def compiling() -> Iterator[None]:
    """Tell listeners that the block compiles something, or waits for another process that does."""
    begins()
    try:
        yield
    finally:
        ends()


def begins() -> None:
    """Numba begins to compile a function; called by `rock2d.compiled`."""
    global _depth
    _depth += 1
    if _depth == 1 and _listeners:
        _listeners[-1](True)


def ends() -> None:
    """Numba has compiled the latest function."""
    global _depth
    _depth -= 1
    if _depth == 0 and _listeners:
        _listeners[-1](False)
