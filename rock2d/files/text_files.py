"""Text files of the user: only regular files in UTF-8 are read."""

import json
import re
import stat
from pathlib import Path
from typing import Any

from rock2d.errors import InputError

DECIMAL_COMMA = re.compile(r"[+-]?\d+,\d+([eE][+-]?\d+)?")


def require_regular(file: str | Path) -> None:
    """Raise `InputError` if this is not a regular file: reading a pipe or a device may never end."""
    try:
        mode = Path(file).stat().st_mode
    except (OSError, ValueError) as error:
        raise _unreadable(file, error) from None
    if not stat.S_ISREG(mode):
        what = "a folder" if stat.S_ISDIR(mode) else "a pipe, device or socket"
        raise InputError(f"expected a file, found {what}", file, code="unreadable")


def read_bytes(file: str | Path) -> bytes:
    """The content of a file; raises `InputError` if it is missing or not a regular file."""
    require_regular(file)
    try:
        return Path(file).read_bytes()
    except OSError as error:
        raise _unreadable(file, error) from None


def read_text(file: str | Path) -> str:
    """The text of a UTF-8 file; raises `InputError` if it is missing, not a regular file or not UTF-8."""
    raw = read_bytes(file)
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        place = place_in(raw[: error.start].decode("utf-8", "replace"), None)
        message = f"byte 0x{raw[error.start]:02x} is not UTF-8; save the file as text in UTF-8"
        raise InputError(message, file, *place, code="not_text") from None


def read_json(file: str | Path) -> Any:
    """The content of a JSON file; raises `InputError` if it is not JSON."""
    return json_content(read_text(file), file)


def json_content(text: str, file: str | Path) -> Any:
    """The content of a JSON text; raises `InputError`, which names `file`, if it is not JSON."""
    try:
        return json.loads(text)
    except json.JSONDecodeError as error:
        raise InputError(f"not JSON: {error.msg}", file, error.lineno, error.colno, code="not_json") from None
    except RecursionError:
        raise InputError("not JSON: nested too deeply", file, 1, 1, code="not_json") from None
    except ValueError:  # Python refuses integers with thousands of digits
        raise InputError("not JSON: a number that is too long", file, 1, 1, code="not_json") from None


def reads_as_number(text: str) -> bool:
    """Whether the text can be read as a number."""
    try:
        float(text)
    except ValueError:
        return False
    return True


def place_in(text: str, position: int | None) -> tuple[int, int]:
    """Line and column, from 1, of a position in a text; None is its end."""
    before = text[:position]
    return before.count("\n") + 1, len(before) - (before.rfind("\n") + 1) + 1


def _unreadable(file: str | Path, error: Exception) -> InputError:
    reason = getattr(error, "strerror", None) or error
    code = "missing_file" if isinstance(error, FileNotFoundError) else "unreadable"
    return InputError(f"cannot be read: {reason}", file, code=code)
