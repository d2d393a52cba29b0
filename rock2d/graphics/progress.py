"""The progress bar of work that reports (done, total)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def frame_bar(what: str, shown: bool) -> Iterator[Callable[[int, int], None]]:
    """Give a callback (frames done, total) that drives a bar named `what`, or nothing unless `shown`."""
    from tqdm import tqdm

    with tqdm(desc=what, unit="frame", disable=not shown) as bar:

        def show(done: int, total: int) -> None:
            bar.total = total
            bar.update(done - bar.n)

        yield show
