"""`njit` for the laws and engines, with a disk cache that can never be stale.

numba keys its cache by the file of the outer function alone, so an edited law would live on inside a cached
engine. Here the cache folder carries a hash of every compiled source file of the package: any edit compiles anew.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import shutil
from functools import partial
from pathlib import Path
from typing import Any

import numba

_PACKAGE = Path(__file__).resolve().parent
_KEPT = 4  # older caches are removed, newest first


def _cache_folder() -> Path:
    digest = hashlib.sha256(f"{numba.__version__}{_PACKAGE}".encode())
    for source in sorted(_PACKAGE.rglob("*.py")):
        text = source.read_bytes()
        if b"rock2d.compiled" in text or source.name == "compiled.py" or source.parent.name == "effects":
            digest.update(text)
    root = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "rock2d" / "numba"
    folder = root / digest.hexdigest()[:16]
    folder.mkdir(parents=True, exist_ok=True)
    os.utime(folder)
    for old in sorted(root.iterdir(), key=lambda p: p.stat().st_mtime, reverse=True)[_KEPT:]:
        shutil.rmtree(old, ignore_errors=True)
    return folder


if "NUMBA_CACHE_DIR" not in os.environ:
    with contextlib.suppress(OSError):  # nowhere to write: numba falls back to its own default
        setattr(numba.config, "CACHE_DIR", str(_cache_folder()))  # noqa: B010 (numba makes its settings at run time)

njit: Any = partial(numba.njit, cache=True, error_model="numpy")
# For code that allocates no arrays: without reference counts, which numba keeps for every view and tuple of arrays by
# calls and atomic instructions that take longer than the arithmetic of a contact step.
kernel: Any = partial(njit, _nrt=False)


@kernel
def copy(source, target):
    """Copy a vector; the slice assignment of compiled code would allocate."""
    for i in range(source.size):
        target[i] = source[i]
