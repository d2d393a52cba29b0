"""Hops of a ball within its own indentation, compiled.

A ball that rolls or slides fast trembles, and is off the bottom of its indentation most of the time. There nothing
acts but gravity: each hop is one exact parabola, and one contact step.
"""

from __future__ import annotations

import numpy as np

from rock2d.compiled import kernel
from rock2d.engines.contact_state import INDEX
from rock2d.engines.geometry import LENGTH, NORMAL_Y, POINT_X, POINT_Y, SMOOTH_FACET, TANGENT_X, TANGENT_Y
from rock2d.engines.guard import GUARD
from rock2d.engines.loaded_contacts import DEPTH_0, L_BOTTOM, L_KIND, L_OFFSET, RATE_0
from rock2d.records.columns import VX, VY, X, Y

BEHIND_LANDING = 1.01  # duration of a hop as a multiple of the time to its landing, so that the step finds it
BEFORE_LIFT_OFF = 0.9  # duration of a hop as a share of the time to lift-off: the rest is for a full step


@kernel
def hop_s(q, active, loaded, ints, world, anchor, longest):
    """Time in s (at most `longest`) that a ball above the bottom of its indentation may fly in one step, on an exact
    parabola: until just behind its landing there, or before it leaves the ground, its facet or the guard."""
    rows, trial, gravity, time = loaded.rows, loaded.trial, world.gravity, longest
    pace = abs(q[VX]) + abs(q[VY]) + gravity * longest
    time = min(time, (anchor[GUARD] - abs(q[X] - anchor[X]) - abs(q[Y] - anchor[Y])) / max(pace, 1e-300))
    for a in range(active):
        facet = world.ground.facets[ints[loaded.which[a], INDEX]]
        pull = 0.5 * gravity * facet[NORMAL_Y]  # depth gains rate × time + pull × time²
        if rows[a, L_KIND] != SMOOTH_FACET or pull <= 0.0:
            return 0.0
        tx, ty = facet[TANGENT_X], facet[TANGENT_Y]
        along = (q[X] - facet[POINT_X]) * tx + (q[Y] - facet[POINT_Y]) * ty
        ahead = facet[LENGTH] - along if q[VX] * tx + q[VY] * ty > 0.0 else along
        time = min(time, ahead / max(pace, 1e-300))
        depth, rate = trial[a, DEPTH_0], trial[a, RATE_0]
        if rate < 0.0 and rate * rate >= 4.0 * pull * depth:
            out = 2.0 * depth / (np.sqrt(rate * rate - 4.0 * pull * depth) - rate)
            time = min(time, BEFORE_LIFT_OFF * out)
        else:
            above = rows[a, L_BOTTOM] + rows[a, L_OFFSET] - depth
            time = min(
                time, BEHIND_LANDING * (np.sqrt(rate * rate + 4.0 * pull * above) - rate) / (2.0 * pull)
            )
    return time
