"""Contacts that pass on along a run of facets all but in line, compiled: nothing of the contact changes there."""

from __future__ import annotations

from rock2d.compiled import kernel
from rock2d.engines.geometry import (
    CORNER_FACET,
    F_NORMAL,
    F_POINT,
    F_SHAPE,
    LENGTH,
    NORMAL_X,
    NORMAL_Y,
    POINT_X,
    POINT_Y,
    RUN_FIRST,
    RUN_LAST,
    SMOOTH_FACET,
    TANGENT_X,
    TANGENT_Y,
)
from rock2d.engines.loaded_contacts import (
    DEPTH_0,
    L_DISPLACEMENT,
    L_KIND,
    L_LAW,
    L_OFFSET,
    L_PEAK,
    RATE_0,
    placed,
)
from rock2d.laws.contact import K_L, K_T, K_UL, MU, change_feature, normal_force, tangential_force
from rock2d.records.columns import OMEGA, PLASTIC, VX, VY, X, Y


@kernel(forceinline=True)
def follow_run(loaded, a, facets, index, q, direction, audit):
    """Load the facet of its run that a contact has moved to at state q, whose direction is (cos θ, sin θ); returns the
    facet's index."""
    rows = loaded.rows
    c, s = direction
    kind, px, py = int(rows[a, L_KIND]), q[X], q[Y]
    if kind == CORNER_FACET:
        corner_x, corner_y = rows[a, F_SHAPE], rows[a, F_SHAPE + 1]
        px, py = px + c * corner_x - s * corner_y, py + s * corner_x + c * corner_y
    elif kind != SMOOTH_FACET:
        return index
    elif not _below_centre(rows, a):
        _, _, _, rx, ry = placed(rows, a, (px, py, c, s))
        px, py = px + rx, py + ry
    first, last, found = int(facets[index, RUN_FIRST]), int(facets[index, RUN_LAST]), index
    while True:
        along = (px - facets[found, POINT_X]) * facets[found, TANGENT_X]
        along += (py - facets[found, POINT_Y]) * facets[found, TANGENT_Y]
        if along < 0.0 and found > first and found <= index:
            found -= 1
        elif along > facets[found, LENGTH] and found < last and found >= index:
            found += 1
        else:
            break
    if found != index:
        _load_facet(loaded, a, facets[found], q, (q[X], q[Y], c, s), audit)
    return found


@kernel(forceinline=True)
def _below_centre(rows, a):
    """Whether a smooth profile is a ball's, whose contact point lies below its centre."""
    round_about = rows[a, F_SHAPE + 2] == 0.0 and rows[a, F_SHAPE + 3] == 0.0
    return round_about and rows[a, F_SHAPE] == rows[a, F_SHAPE + 1]


@kernel
def _load_facet(loaded, a, facet, q, pose, audit):
    """Let a contact go on at the next facet of its run, see `change_feature`."""
    rows, trial = loaded.rows, loaded.trial
    rows[a, F_POINT], rows[a, F_POINT + 1] = facet[POINT_X], facet[POINT_Y]
    rows[a, F_NORMAL], rows[a, F_NORMAL + 1] = facet[NORMAL_X], facet[NORMAL_Y]
    depth, nx, ny, rx, ry = placed(rows, a, pose)
    row = rows[a, L_LAW:]
    force_n = normal_force(trial[a, DEPTH_0] - rows[a, L_OFFSET], rows[a, L_PEAK], row[K_L], row[K_UL])
    force_t = tangential_force(rows[a, L_DISPLACEMENT], force_n, row[K_T], row[MU])
    rows[a, L_OFFSET], _, _, lost = change_feature(
        row, depth, depth - trial[a, DEPTH_0], (rows[a, L_OFFSET], rows[a, L_PEAK]), (force_n, force_t)
    )
    audit[PLASTIC] += lost
    trial[a, DEPTH_0] = depth
    trial[a, RATE_0] = -((q[VX] - q[OMEGA] * ry) * nx + (q[VY] + q[OMEGA] * rx) * ny)
