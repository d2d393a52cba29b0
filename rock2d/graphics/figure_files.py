"""When the figures of a result are drawn: at once, in a second process while tables are written, or not at all."""

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
    """Figures that are drawn at once. A file is drawn once, although several parts of a result may ask for it."""

    wanted = True

    def __init__(self) -> None:
        self._asked: set[Path] = set()

    def save(self, path: Path, draw: Draw, *given: Any) -> Path:
        """Let the figure draw(*given) be a file, at the latest when `finish` ends."""
        if path not in self._asked:
            self._asked.add(path)
            self._save(path, draw, given)
        return path

    def finish(self) -> None:
        """Wait until all are files. Raises what a function raised that drew."""

    def _save(self, path: Path, draw: Draw, given: tuple[Any, ...]) -> None:
        from rock2d.graphics.figure_style import save_figure

        save_figure(draw(*given), path)


class NoFigures(Figures):
    """No figure is drawn."""

    wanted = False

    def _save(self, path: Path, draw: Draw, given: tuple[Any, ...]) -> None:
        pass


class FiguresBeside(Figures):
    """Figures that another process draws. It gives pictures and writes no file, so it leaves nothing half-written."""

    def __init__(self, submit: Callable[..., Future[Any]]) -> None:
        super().__init__()
        self._submit = submit
        self._waiting: dict[Path, tuple[Future[Any], Draw, tuple[Any, ...]]] = {}
        submit(_load)

    def finish(self) -> None:
        """See `Figures`. Those that the other process has not begun are drawn here meanwhile, as are those on which it
        died."""
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
def figures_beside() -> Iterator[Figures]:
    """Figures that are drawn in a second process, which loads while this one does other work."""
    with second_process() as submit:
        yield FiguresBeside(submit)


def _load() -> None:
    """Import what figures need, before the first is asked for."""
    from rock2d.graphics.figure_style import blank_figure

    blank_figure(1.0, 1.0)


def _picture(suffix: str, draw: Draw, given: tuple[Any, ...]) -> bytes:
    from rock2d.graphics.figure_style import FILE_DPI

    buffer = io.BytesIO()
    draw(*given).savefig(buffer, dpi=FILE_DPI, format=suffix.lstrip("."))
    return buffer.getvalue()
