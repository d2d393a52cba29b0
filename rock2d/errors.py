"""The one error that a user's input can cause."""

from __future__ import annotations

from pathlib import Path


class InputError(Exception):
    """Something the user gave cannot be used: one message, "file:line:column: expected ..., found ...".

    The command line prints it and exits with code 2. `line` and `column` count from 1.
    """

    def __init__(
        self, message: str, file: str | Path | None = None, line: int | None = None, column: int | None = None
    ) -> None:
        place = "".join(f"{part}:" for part in (file, line, column) if part is not None)
        super().__init__(f"{place} {message}" if place else message)
        self.message, self.file, self.line, self.column = message, file, line, column
