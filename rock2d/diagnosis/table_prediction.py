"""Prediction with a diagnosed model of an impact table: the velocities after each impact from the state before it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rock2d.diagnosis.impact_table_data import TableData
from rock2d.diagnosis.learnt_prediction import KnownChange
from rock2d.diagnosis.levers import FRAME, FRAME_COLUMNS, LAW, OUTCOME, STATE
from rock2d.diagnosis.model import with_changed_law
from rock2d.kinematics.film_segments import STATE_SIZE
from rock2d.records.columns import X, Y
from rock2d.scene.world import World

Array = np.ndarray


def predicted_velocities(data: TableData, world: World, changes: Sequence[KnownChange]) -> Array:
    """(n, 3) velocities after the impacts in the image: vx, vy in m/s, omega in rad/s."""
    quantities = data.impact_quantities(world)
    shift = np.zeros((len(data.before), STATE_SIZE))
    added, unframed = np.zeros_like(data.after), np.zeros_like(data.after)
    for change in changes:
        own = change.of(quantities)
        if change.lever == LAW:
            world = with_changed_law(world, own)
        elif change.lever == STATE:
            shift += own
        elif change.lever == OUTCOME:
            added += own
        elif change.lever == FRAME:
            shift[:, FRAME_COLUMNS] += own
            unframed += change.of(data.outcome_quantities(world))[:, :-1]
    along, across, spin = (data.residuals(world, shift).impacts + added).T
    tx, ty = data.tangent[:, X], data.tangent[:, Y]
    return data.after + np.column_stack([tx * along - ty * across, ty * along + tx * across, spin]) - unframed
