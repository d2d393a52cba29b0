"""Arrays in .npz files, and a fingerprint of the data and the code that they were computed from."""

import hashlib
import zipfile
from pathlib import Path

import numpy as np

from rock2d.arrays import Array
from rock2d.files.folders import atomic_file


def fingerprint(*arrays: Array) -> str:
    """16 hexadecimal digits of a hash of the arrays and of the source of rock2d."""
    digest = hashlib.sha256()
    for array in arrays:
        digest.update(np.ascontiguousarray(array).tobytes())
    for source in sorted(Path(__file__).resolve().parent.parent.rglob("*.py")):
        digest.update(source.read_bytes())
    return digest.hexdigest()[:16]


def save_arrays(path: Path, **arrays: Array) -> None:
    """Write named arrays into the .npz file `path`; an interruption leaves no half-written file there."""
    with atomic_file(path) as partial, open(partial, "wb") as file:
        np.savez(file, **arrays)  # type: ignore[arg-type]


def load_arrays(path: Path) -> dict[str, Array] | None:
    """The arrays that `save_arrays` wrote; None if there is no readable file."""
    try:
        with np.load(path, allow_pickle=False) as found:
            return dict(found)
    except (OSError, ValueError, zipfile.BadZipFile):
        return None
