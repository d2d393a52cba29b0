"""When a block in contact has come to rest, compiled; one rule for every engine."""

from __future__ import annotations

import numpy as np

from rock2d.compiled import njit

# At rest: for two windows of REST_WINDOW √(radius/g) in contact, the second within a box of REST_BOX radii, its net
# motion below REST_DRIFT radii and at most 5 % and REST_GROWTH radii more than the first's. The law has no damping
# below its thresholds: a resting block keeps an elastic tremor that lifts the friction limit off and on, so that it
# creeps without gaining speed. What slides above the friction angle, or tips, gains speed.
REST_WINDOW, REST_BOX, REST_DRIFT, REST_GROWTH = 2.0, 0.6, 0.4, 0.01
# what is watched: begin, x and y there, bounds x_min, x_max, y_min, y_max, net motion of the window before
W_TIME, W_X, W_Y, W_LOW_X, W_HIGH_X, W_LOW_Y, W_HIGH_Y, W_BEFORE = range(8)


@njit
def forget_rest(watch):
    """The block is not in contact: begin to watch anew."""
    watch[W_TIME] = -1.0
    watch[W_BEFORE] = np.inf


@njit
def watch_rest(watch, t, q, radius, gravity):
    """Note the state at time t of a block in contact; True if it has come to rest (see REST_WINDOW)."""
    x, y = q[0], q[1]
    if watch[W_TIME] < 0.0:
        watch[W_TIME], watch[W_X], watch[W_Y] = t, x, y
        watch[W_LOW_X], watch[W_HIGH_X], watch[W_LOW_Y], watch[W_HIGH_Y] = x, x, y, y
    watch[W_LOW_X], watch[W_HIGH_X] = min(watch[W_LOW_X], x), max(watch[W_HIGH_X], x)
    watch[W_LOW_Y], watch[W_HIGH_Y] = min(watch[W_LOW_Y], y), max(watch[W_HIGH_Y], y)
    if t - watch[W_TIME] < REST_WINDOW * np.sqrt(radius / max(gravity, 1e-9)):
        return False
    net = np.sqrt((x - watch[W_X]) ** 2 + (y - watch[W_Y]) ** 2)
    box = max(watch[W_HIGH_X] - watch[W_LOW_X], watch[W_HIGH_Y] - watch[W_LOW_Y])
    steady = net < min(REST_DRIFT * radius, 1.05 * watch[W_BEFORE] + REST_GROWTH * radius)
    at_rest = steady and watch[W_BEFORE] < np.inf and box < REST_BOX * radius
    watch[W_TIME], watch[W_BEFORE] = -1.0, net
    return at_rest
