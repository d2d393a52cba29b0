"""Output files and folders, which are written completely or not at all, and paths that must stay inside a folder."""

import errno
import glob
import json
import os
import secrets
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from itertools import islice
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any

from rock2d.compiling import cache_root
from rock2d.errors import InputError

MACHINE_ERRORS = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EMFILE, errno.ENFILE, errno.ENOMEM)
RESULT_MARKER = "rock2d_result.json"  # marks a folder as a result, which may be replaced


@contextmanager
def atomic_folder(path: str | Path, kind: str = "") -> Iterator[Path]:
    """Give a temporary sibling folder to write into; it becomes `path` only if the block ends without error.

    An older result of the same `kind` at `path` (its `RESULT_MARKER` says so) or an empty folder is replaced; anything
    else raises `InputError` at once. After an error or an interrupt `path` is unchanged. Temporary folders of killed
    processes are removed. Raises OSError, which names `path`, if the machine fails (for example a full disk)."""
    target = check_folder(path, kind)
    process = os.getpid()
    with temporary_folder(path) as partial:
        yield partial
        if os.getpid() != process:
            return  # in a process that was forked in the block
        mark_as_result(partial, kind)
        replaced = _hidden(target, "replaced")
        if target.exists():
            target.rename(replaced)
        try:
            partial.rename(target)
        except BaseException:
            if replaced.exists():
                replaced.rename(target)
            raise
        for older in target.parent.glob(f".{glob.escape(target.name)}.replaced-*"):
            shutil.rmtree(older, ignore_errors=True)


def mark_as_result(folder: Path, kind: str) -> None:
    """Write the `RESULT_MARKER` of a kind of result."""
    marker = {"made_by": "rock2d", "kind": kind}
    (folder / RESULT_MARKER).write_text(json.dumps(marker) + "\n", encoding="utf-8")


@contextmanager
def temporary_folder(path: str | Path) -> Iterator[Path]:
    """Give a hidden folder beside `path`, and remove it after the block. Folders of killed processes are also removed.

    Missing parent folders are created. Raises the errors of `atomic_file`."""
    target = Path(os.path.abspath(path))
    partial, unlocked = _hidden(target, "partial"), _hidden(target, "new")
    process = os.getpid()
    try:
        with _errors_name(path, partial), _errors_name(path, unlocked), ExitStack() as locks:
            _remove_abandoned(target)
            with _errors_name(path, Path(target.anchor)):
                target.parent.mkdir(parents=True, exist_ok=True)
            unlocked.mkdir()
            locks.enter_context(_lock(unlocked))
            unlocked.rename(partial)  # only now: another process removes a partial folder without a lock
            yield partial
    finally:
        if os.getpid() == process:
            shutil.rmtree(unlocked, ignore_errors=True)
            shutil.rmtree(partial, ignore_errors=True)


def _hidden(target: Path, what: str) -> Path:
    return target.with_name(f".{target.name}.{what}-{secrets.token_hex(4)}")


@contextmanager
def _lock(folder: Path) -> Iterator[bool]:
    """Hold the lock of a folder; gives False if another process holds it or if folders have no locks. The system
    releases the lock when the process ends."""
    try:
        import fcntl
    except ImportError:  # no POSIX system
        yield False
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            yield False
        else:
            yield True
    finally:
        os.close(handle)


def _remove_abandoned(target: Path) -> None:
    """Remove the temporary folders of processes that were killed while they wrote a result at `target`."""
    for partial in target.parent.glob(f".{glob.escape(target.name)}.partial-*"):
        with suppress(OSError), _lock(partial) as free:
            if free:
                shutil.rmtree(partial, ignore_errors=True)


def check_folder(path: str | Path, kind: str = "") -> Path:
    """The absolute path; raises InputError if `atomic_folder` would refuse it."""
    target = Path(os.path.abspath(path))  # not resolved: a link is refused below, never followed
    if target.is_symlink() or (target.exists() and not target.is_dir()):
        raise InputError("exists and is not a folder; choose another output folder", path, code="not_a_result")
    if target.is_dir() and target.samefile("."):  # a process whose folder is replaced finds no file by its path
        raise InputError("is the current folder; choose another output folder", path, code="not_a_result")
    if target.is_dir() and any(target.iterdir()) and not (target / RESULT_MARKER).is_file():
        raise InputError("exists and is not a rock2d result; choose another output folder", path, code="not_a_result")
    if (held := _kind_of(target)) not in ("", kind):
        message = f"holds another kind of result ({held}); choose another output folder"
        raise InputError(message, path, code="not_a_result")
    _check_parent(target, path)
    return target


def _kind_of(folder: Path) -> str:
    """The kind of the result in a folder; empty without one, or if it does not say its kind."""
    try:
        return str(json.loads((folder / RESULT_MARKER).read_text(encoding="utf-8")).get("kind", ""))
    except (OSError, ValueError, AttributeError):
        return ""


def check_output_folder(path: str | Path, overwrite: bool, kind: str) -> None:
    """Raise InputError if `atomic_folder` would refuse the folder, or if it holds results and `overwrite` is false."""
    target = check_folder(path, kind)
    if target.is_dir() and any(target.iterdir()) and not overwrite:
        message = "holds the results of an earlier run; --overwrite replaces them, --out chooses another folder"
        raise InputError(message, path, code="results_exist")


def check_file(path: str | Path) -> None:
    """Raise InputError if `atomic_file` could not write there."""
    if Path(path).is_dir():
        raise InputError("is a folder; choose another output file", path, code="not_writable")
    _check_parent(Path(os.path.abspath(path)), path)


def check_own_file(path: Path, header: str, *beside: Path) -> None:
    """Raise InputError if `path`, or a file that is written `beside` it, exists, and `path` is no table with this
    `header` in its first two lines: another command, a camera or a hand made it."""
    if path.is_file():
        with path.open(encoding="utf-8", errors="replace") as file:
            if header in (line.rstrip("\n") for line in islice(file, 2)):
                return
    for taken in (path, *beside):
        if taken.is_file():
            message = "exists and is no earlier result of this command; choose another output file"
            raise InputError(message, taken, code="not_a_result")


def _check_parent(target: Path, path: str | Path) -> None:
    """Try to write into the nearest existing parent of `target`."""
    parent = next(parent for parent in target.parents if parent.exists())
    with _errors_name(path, parent), tempfile.TemporaryFile(dir=parent):
        pass


def user_cache(name: str) -> Path | None:
    """A folder in the cache that only this user can read and write; None if it cannot be created."""
    folder = cache_root() / name
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        make_folder(folder)
    except (OSError, InputError):
        return None
    return folder


def make_folder(path: Path) -> None:
    """Create a folder and check that it is writable; raises InputError if it is not."""
    with _errors_name(path, path):
        path.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=path):
            pass


@contextmanager
def atomic_file(path: Path) -> Iterator[Path]:
    """Give a temporary sibling path with the same suffix; it becomes `path` only if the block ends without error.

    Missing parent folders are created. After an error or an interrupt `path` is unchanged. Raises InputError if no
    file can be written there, and OSError, which names `path`, if the machine fails (for example a full disk)."""
    process = os.getpid()
    with temporary_folder(path) as folder:
        partial = folder / path.name
        yield partial
        if os.getpid() == process:  # not in a process that was forked in the block
            os.replace(partial, path)


def write_whole(path: Path, text: str) -> None:
    """Write a text file completely or not at all; see `atomic_file`."""
    with atomic_file(path) as partial:
        partial.write_text(text, encoding="utf-8")


def unwritable(error: OSError, path: str | Path) -> InputError | OSError:
    """The error to raise if `path` cannot be written: InputError if another path may work, else OSError."""
    if error.errno in MACHINE_ERRORS or error.errno is None:
        return OSError(error.errno, error.strerror or str(error), str(path))
    return InputError(f"cannot be written: {error.strerror}", path, code="not_writable")


@contextmanager
def _errors_name(path: str | Path, partial: Path) -> Iterator[None]:
    """Make errors name `path` if they name no file, or one at or below `partial`."""
    try:
        yield
    except OSError as error:
        if error.filename is None or Path(os.fsdecode(error.filename)).is_relative_to(partial):
            raise unwritable(error, path) from None
        raise


def path_inside(folder: str | Path, relative: str, *where: Any, error: Callable[..., InputError] = InputError) -> Path:
    """`folder`/`relative`; raises `error` at the place `where` if that leaves `folder` (by "..", an absolute path or a
    link)."""

    def refused(words: str) -> InputError:
        return error(f"expected {words}", *where, code="outside_folder")

    pure, windows = PurePosixPath(relative), PureWindowsPath(relative)
    if not relative.strip() or "\0" in relative:
        raise refused(f"a path inside {folder}, found {relative!r}")
    if pure.is_absolute() or windows.drive or windows.root:
        raise refused(f"a relative path inside {folder}, found an absolute one")
    if ".." in pure.parts or ".." in windows.parts:
        raise refused(f"a path inside {folder}, found '..'")
    root = Path(folder).resolve()
    try:
        inside = (root / relative).resolve().is_relative_to(root)
    except (OSError, RuntimeError):
        inside = False
    if not inside:
        raise refused(f"a path inside {folder}, found a link that leads out of it")
    return Path(folder) / relative
