"""Pages of results in the browser."""

from __future__ import annotations

import shutil
import tempfile
import webbrowser
from collections.abc import Callable
from pathlib import Path


def view(write: Callable[[Path], object], page: str) -> Path:
    """Let `write` fill a new temporary folder and open its `page`; returns the path of the page.

    The folder is left to the system, because the browser reads it later.
    """
    folder = Path(tempfile.mkdtemp(prefix="rock2d_"))
    try:
        write(folder)
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise
    webbrowser.open((folder / page).as_uri())
    return folder / page
