"""`njit` for the laws and engines, with a disk cache that can never be stale.

numba keys its cache by the file of the outer function alone, so an edited law would live on inside a cached
engine. Here the cache folder carries a hash of every compiled source file of the package: any edit compiles anew.
"""

from __future__ import annotations

import atexit
import contextlib
import hashlib
import os
import shutil
import stat
import sys
import tempfile
from functools import partial
from pathlib import Path
from typing import Any

import numba
from numba.core import event

from rock2d import compiling
from rock2d.files.folders import cache_root

_PACKAGE = Path(__file__).resolve().parent
_KEPT = 4  # older caches are removed, newest first


def _digest() -> str:
    digest = hashlib.sha256(f"{numba.__version__}{_PACKAGE}".encode())
    for source in sorted(_PACKAGE.rglob("*.py")):
        text = source.read_bytes()
        if b"rock2d.compiled" in text or source.name == "compiled.py" or source.parent.name == "effects":
            digest.update(text)
    return digest.hexdigest()[:16]


def _cache_folder(root: Path) -> Path:
    """The folder of this code below `root`; OSError if there can be none."""
    folder = root / _digest()
    for part in (root.parent, root, folder):
        part.mkdir(parents=True, exist_ok=True, mode=0o700)
    for part in (root.parent, root):  # an earlier version left them open where the umask did
        with contextlib.suppress(PermissionError):
            part.chmod(0o700)
    os.utime(folder)
    for old in sorted(root.iterdir(), key=lambda p: p.stat().st_mtime, reverse=True)[_KEPT:]:
        shutil.rmtree(old, ignore_errors=True)
    return folder


def _open_to_others(folder: Path) -> Path | None:
    """The folder itself or the one above it in which another user could place code; None if there is none."""
    if not hasattr(os, "getuid"):
        return None
    for part in (folder, *folder.parents):
        found = part.stat()
        shared = found.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
        if (
            shared and part != folder and found.st_mode & stat.S_ISVTX
        ):  # like /tmp: others cannot rename what is in it
            shared = 0
        if shared or found.st_uid not in (os.getuid(), 0):
            return part
    return None


def _choose_cache() -> None:
    """Set the folder of compiled code; a temporary one, for this process and its workers, if others can write it."""
    root = cache_root() / "numba"
    with contextlib.suppress(OSError):  # nowhere to write: numba falls back to its own default
        folder = _cache_folder(root.resolve())
        if (found := _open_to_others(folder)) is not None:
            sys.stderr.write(
                f"warning: {found}: other users can write here; code is compiled anew for this run\n"
            )
            folder = Path(tempfile.mkdtemp(prefix="rock2d_"))
            os.environ["NUMBA_CACHE_DIR"] = str(folder)  # for workers
            atexit.register(shutil.rmtree, folder, ignore_errors=True)
        setattr(numba.config, "CACHE_DIR", str(folder))  # noqa: B010 (numba makes its settings at run time)


if "NUMBA_CACHE_DIR" not in os.environ:
    _choose_cache()


class _Compiling(event.Listener):
    """Hears of every function that is compiled; numba does not send this event for one that the cache holds."""

    def on_start(self, event):
        compiling.begins()

    def on_end(self, event):
        pass


event.register("numba:compile", _Compiling())

njit: Any = partial(numba.njit, cache=True, error_model="numpy")
# For code that allocates no arrays: without reference counts, which numba keeps for every view and tuple of arrays by
# calls and atomic instructions that take longer than the arithmetic of a contact step.
kernel: Any = partial(njit, _nrt=False)


@kernel
def copy(source, target):
    """Copy a vector; the slice assignment of compiled code would allocate."""
    for i in range(source.size):
        target[i] = source[i]
