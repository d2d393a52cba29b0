"""Open pages of results in the browser."""

from __future__ import annotations

import shutil
import tempfile
import webbrowser
from collections.abc import Callable
from pathlib import Path


def view(write: Callable[[Path], object], page: str) -> Path:
    """Call `write` with a new temporary folder, open its `page` in the browser and return the path of the page.

    The folder is not deleted, because the browser reads it later.
    """
    folder = Path(tempfile.mkdtemp(prefix="rock2d_"))
    try:
        write(folder)
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise
    webbrowser.open((folder / page).as_uri())
    return folder / page
