"""Figures of a result as files: drawn immediately, in a second process while tables are written, or not at all."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rock2d.processes import second_process

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    Draw = Callable[..., Figure]


class Figures:
    """Figures that are drawn immediately. Each file is drawn once, even if several parts of a result request it."""

    wanted = True

    def __init__(self) -> None:
        self._asked: set[Path] = set()

    def save(self, path: Path, draw: Draw, *given: Any) -> Path:
        """Request the figure `draw(*given)` as a file; it exists when `finish` returns."""
        if path not in self._asked:
            self._asked.add(path)
            self._save(path, draw, given)
        return path

    def finish(self) -> None:
        """Wait until all files exist. Raises the exceptions of the functions that draw."""

    def _save(self, path: Path, draw: Draw, given: tuple[Any, ...]) -> None:
        from rock2d.graphics.figure_style import save_figure

        save_figure(draw(*given), path)


class NoFigures(Figures):
    """Draws no figure."""

    wanted = False

    def _save(self, path: Path, draw: Draw, given: tuple[Any, ...]) -> None:
        pass


class SecondProcessFigures(Figures):
    """Figures that a second process draws. It returns pictures and writes no files, so none can be incomplete."""

    def __init__(self, submit: Callable[..., Future[Any]]) -> None:
        super().__init__()
        self._submit = submit
        self._waiting: dict[Path, tuple[Future[Any], Draw, tuple[Any, ...]]] = {}
        submit(_import_matplotlib)

    def finish(self) -> None:
        """See `Figures`. This process draws the figures that the second process has not begun, and those during which
        the second process ended."""
        waiting, self._waiting = self._waiting, {}
        for path, (future, draw, given) in reversed(waiting.items()):
            if future.cancel():
                super()._save(path, draw, given)
        for path, (future, draw, given) in waiting.items():
            if not future.cancelled():
                try:
                    path.write_bytes(future.result())
                except BrokenProcessPool:
                    super()._save(path, draw, given)

    def _save(self, path: Path, draw: Draw, given: tuple[Any, ...]) -> None:
        try:
            self._waiting[path] = (self._submit(_picture, path.suffix, draw, given), draw, given)
        except BrokenProcessPool:
            super()._save(path, draw, given)


@contextmanager
def figures_in_second_process() -> Iterator[Figures]:
    """Figures that a second process draws; it starts and imports matplotlib in the background."""
    with second_process() as submit:
        yield SecondProcessFigures(submit)


def _import_matplotlib() -> None:
    """Import matplotlib before the first figure is requested."""
    from rock2d.graphics.figure_style import blank_figure

    blank_figure(1.0, 1.0)


def _picture(suffix: str, draw: Draw, given: tuple[Any, ...]) -> bytes:
    from rock2d.graphics.figure_style import FILE_DPI

    buffer = io.BytesIO()
    draw(*given).savefig(buffer, dpi=FILE_DPI, format=suffix.lstrip("."))
    return buffer.getvalue()
