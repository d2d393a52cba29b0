"""The reference kernel: the batch engine's law and geometry in plain C (`reference/`).

It is the same algorithm with the same arithmetic, compiled by the system's compiler: the engine is measured against it.
"""

import ctypes
import shutil
import subprocess
from pathlib import Path
from typing import NamedTuple

import numpy as np

from rock2d.engines import contact_step
from rock2d.engines.batch import BATCH_STEP_FRACTION, Ensemble, pack
from rock2d.engines.contact_state import SMOOTH_CONTACTS, VERTEX_CONTACTS
from rock2d.engines.geometry import CONVEX, block_arrays, ground_arrays, is_ball
from rock2d.laws.contact import CONTACT_LAW_COLUMNS
from rock2d.records.columns import N_INSTANT

SOURCE = Path(__file__).parent / "reference" / "release.c"
MOST_CONTACTS = 40  # as in model.h
# -std=c11 has every operation rounded by itself, as in the engine: no fused multiply-add
FLAGS = ("-std=c11", "-O3", "-march=native", "-shared", "-fPIC")
_REAL, _INTEGER, _POINTER = ctypes.c_double, ctypes.c_int64, ctypes.c_void_p


class _World(ctypes.Structure):
    """`World` of model.h."""

    _fields_ = [
        ("sides", _POINTER), ("corners", _INTEGER), ("mass", _REAL), ("inertia", _REAL), ("radius", _REAL),
        ("facets", _POINTER), ("points", _INTEGER), ("first", _POINTER), ("last", _POINTER), ("bins", _INTEGER),
        ("x_start", _REAL), ("bins_per_m", _REAL), ("x_low", _REAL), ("x_high", _REAL), ("facet_m", _REAL),
        ("tree", _POINTER), ("nodes", _INTEGER), ("law", _POINTER), ("lines", _POINTER), ("line_count", _INTEGER),
        ("gravity", _REAL), ("contacts", _INTEGER),
    ]  # fmt: skip


class ReferenceResult(NamedTuple):
    """As `batch.BatchResult`."""

    stop: np.ndarray
    ends: np.ndarray
    impact_count: np.ndarray
    crossings: np.ndarray


def compiler() -> str | None:
    """The system's C compiler; None if there is none."""
    return shutil.which("cc")


def compile_reference(folder: Path, *flags: str) -> ctypes.CDLL:
    """The kernel, compiled into `folder`, with further flags. Raises CalledProcessError if that fails."""
    library = folder / f"reference{''.join(flags)}.so"
    command = ["cc", *FLAGS, *flags, "-o", str(library), str(SOURCE), "-lm"]
    subprocess.run(command, check=True, capture_output=True)
    return ctypes.CDLL(str(library))


def run_reference(
    library: ctypes.CDLL,
    ensemble: Ensemble,
    states: np.ndarray,
    *,
    gravity_m_s2: float = 9.81,
    time_limit_s: float = 5.0,
    impact_limit: int = 0,
) -> ReferenceResult:
    """As `run_batch` with one sharp polygon or ball on one cross-section, on one thread."""
    (block,), (cross_section,), packed = ensemble.blocks, ensemble.cross_sections, pack(ensemble)
    b, ground = block_arrays(block), ground_arrays(cross_section)
    corners, convex = len(b.sides), int(ground.facets[:, CONVEX].sum())
    contacts = corners + min(VERTEX_CONTACTS, convex) if corners > 0 else SMOOTH_CONTACTS
    laws = len(CONTACT_LAW_COLUMNS)
    if b.rounding or b.air.size or not (corners > 0 or is_ball(b)) or packed.tables[:, :, laws:].any():
        raise ValueError("the reference kernel knows sharp polygons and balls, without effects")
    if contacts > MOST_CONTACTS:
        raise ValueError("the block has too many corners for the reference kernel")
    law, lines = packed.tables[0, :, :laws].copy(), packed.lines[0].copy()
    world = _World(
        b.sides.ctypes.data, corners, b.mass, b.inertia, b.radius,
        ground.facets.ctypes.data, len(ground.facets), ground.first.ctypes.data, ground.last.ctypes.data,
        ground.first.size, ground.x_start, ground.bins_per_m, ground.x_low, ground.x_high, ground.facet_m,
        packed.trees.ctypes.data, len(packed.trees), law.ctypes.data, lines.ctypes.data, len(lines), gravity_m_s2,
        contacts,
    )  # fmt: skip
    n, states = len(states), np.ascontiguousarray(states, float)
    steps = np.tile(contact_step.contact_steps_s(block, packed.tables[0], BATCH_STEP_FRACTION), (n, 1))
    limits = np.full(n, float(time_limit_s))
    found = ReferenceResult(
        np.zeros(n, np.int64), np.empty((n, N_INSTANT)), np.zeros(n, np.int64),
        np.full((n, len(lines), N_INSTANT), np.nan),
    )  # fmt: skip
    library.run_releases(
        ctypes.byref(world), _INTEGER(n), *(_POINTER(a.ctypes.data) for a in (states, steps, limits)),
        _INTEGER(impact_limit),
        *(_POINTER(a.ctypes.data) for a in (found.stop, found.impact_count, found.ends, found.crossings)),
    )  # fmt: skip
    return found
