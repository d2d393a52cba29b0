"""The active contacts of a block, loaded into rows for the next steps, and their forces, compiled."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rock2d.compiled import kernel, njit
from rock2d.effects.columns import N_COLUMNS
from rock2d.effects.forces import ANY_EFFECT_ACTS, FIRST_EFFECT_COLUMN, ground_forces, recoil
from rock2d.engines.contact_state import (
    ACTIVE,
    DEPTH,
    DISPLACEMENT,
    INDEX,
    KIND,
    OFFSET,
    PART,
    PEAK,
    RATE,
    ROTATION,
    ZONE,
)
from rock2d.engines.free_flight import in_air
from rock2d.engines.geometry import N_FEATURE, load_feature, place_feature
from rock2d.laws.contact import (
    CONTACT_LAW_COLUMNS,
    K_L,
    K_R,
    K_T,
    K_UL,
    MU,
    ROLLING_CAP,
    ROLLING_IN_INDENTATION,
    normal_force_from_bottom,
    residual_indentation,
    rolling_moment,
    tangential_force,
)

# columns of a loaded contact: its feature (`geometry.load_feature`), the parameters of the law, its memory, its kind,
# its residual indentation, whether the ground presses on it in this step, whether effects act in it, and their columns
L_FEATURE = 0
L_LAW = L_FEATURE + N_FEATURE
L_OFFSET = L_LAW + len(CONTACT_LAW_COLUMNS)
L_PEAK, L_DISPLACEMENT, L_ROTATION, L_KIND, L_BOTTOM, L_PRESSED, L_ACTS, L_EFFECTS = range(
    L_OFFSET + 1, L_OFFSET + 9
)
N_LOADED = L_EFFECTS + N_COLUMNS - FIRST_EFFECT_COLUMN
# columns of a contact's row of rates: deformation of its springs at the end of a step, and their rates at a stage
TAKEN_DISPLACEMENT, TAKEN_ROTATION, SLIP_RATE, SPIN_RATE = range(4)
# columns of a contact's row of a trial step: penetration and its rate before and after it, arm and slip of the contact
# point after it, and the outcome (`trial_step.step_to_event`): peak penetration, states of the springs, normal force of
# the law before and after, acting force, tangential force before and after, rolling moment, and plastic work
(
    DEPTH_0, RATE_0, DEPTH_1, RATE_1, ARM, SLIP, PEAK_1, DISPLACEMENT_1, ROTATION_1, NORMAL_0, NORMAL_1, ACTING_1,
    TANGENTIAL_0, TANGENTIAL_1, MOMENT_1, PLASTIC_WORK,
) = range(16)  # fmt: skip
LEAST_FORCE_N = 1e-300  # least force of a pressed contact, so that its springs act until it lifts off
LEAST_EVENT = 1e-3  # share of a step: the step starts, to rounding, at an event that comes sooner


class LoadedContacts(NamedTuple):
    """Rows of the active contacts; only the first rows are in use."""

    rows: np.ndarray  # (contacts, N_LOADED)
    which: np.ndarray  # (contacts,) index of the contact of a row
    rates: np.ndarray  # (contacts, 4) TAKEN_DISPLACEMENT ... SPIN_RATE
    trial: np.ndarray  # (contacts, 16) DEPTH_0 ... PLASTIC_WORK


@njit
def new_loaded(count):
    """Rows for `count` contacts."""
    return LoadedContacts(
        np.empty((count, N_LOADED)),
        np.empty(count, np.int64),
        np.empty((count, 4)),
        np.empty((count, PLASTIC_WORK + 1)),
    )


@kernel
def load_active(world, memory, loaded):
    """Copy feature, parameters, memory and depths of the active contacts into rows; returns how many there are."""
    ints, reals, rows, law = memory.ints, memory.reals, loaded.rows, world.law
    active = np.int64(0)
    for j in range(ints.shape[0]):
        if ints[j, ACTIVE]:
            feature = load_feature(
                ints[j, KIND], ints[j, INDEX], ints[j, PART], world.block, world.ground.facets
            )
            px, py, nx, ny, w1, w2, w3, w4 = feature
            rows[active, 0], rows[active, 1], rows[active, 2], rows[active, 3] = px, py, nx, ny
            rows[active, 4], rows[active, 5], rows[active, 6], rows[active, 7] = w1, w2, w3, w4
            zone = ints[j, ZONE]
            for i in range(FIRST_EFFECT_COLUMN):
                rows[active, L_LAW + i] = law[zone, i]
            rows[active, L_ACTS] = law[zone, ANY_EFFECT_ACTS]
            if law[zone, ANY_EFFECT_ACTS] != 0.0:
                for i in range(N_COLUMNS - FIRST_EFFECT_COLUMN):
                    rows[active, L_EFFECTS + i] = law[zone, FIRST_EFFECT_COLUMN + i]
            rows[active, L_OFFSET], rows[active, L_PEAK] = reals[j, OFFSET], reals[j, PEAK]
            rows[active, L_BOTTOM] = residual_indentation(reals[j, PEAK], law[zone, K_L], law[zone, K_UL])
            rows[active, L_DISPLACEMENT], rows[active, L_ROTATION] = (
                reals[j, DISPLACEMENT],
                reals[j, ROTATION],
            )
            rows[active, L_KIND] = ints[j, KIND]
            loaded.trial[active, DEPTH_0], loaded.trial[active, RATE_0] = reals[j, DEPTH], reals[j, RATE]
            loaded.which[active] = j
            active += 1
    return active


@kernel(forceinline=True)
def note_pressed(active, loaded, h):
    """Set L_PRESSED: on which contacts the ground presses in a step of h (s) that begins at DEPTH_0 and RATE_0.

    It holds for the whole step, which ends if a contact passes the bottom of its indentation: there the moment of the
    rolling spring, and friction of 90 degrees, jump to 0.
    """
    rows, trial = loaded.rows, loaded.trial
    for a in range(active):
        ahead = trial[a, DEPTH_0] - rows[a, L_OFFSET] + LEAST_EVENT * h * trial[a, RATE_0]
        rows[a, L_PRESSED] = 1.0 if ahead > rows[a, L_BOTTOM] else 0.0


@kernel
def effects_act(block, active, rows):
    """Whether effects of the catalogue act on the block, in the air or in a loaded contact."""
    act = in_air(block)
    for a in range(active):
        act = act or rows[a, L_ACTS] != 0.0
    return act


@kernel(forceinline=True)
def placed(rows, a, pose):
    """`contact_point` of the a-th loaded contact."""
    feature = (rows[a, 0], rows[a, 1], rows[a, 2], rows[a, 3], rows[a, 4], rows[a, 5], rows[a, 6], rows[a, 7])
    return place_feature(int(rows[a, L_KIND]), feature, pose)


@kernel(forceinline=True)
def contact_rates(rows, a, pose, velocity, displacement, rotation, effects):
    """Force and rates of one contact.

    velocity : (vx in m/s, vy in m/s, ω in rad/s); displacement in m and rotation in rad of its springs

    Returns (force along x and y in N, moment in N m, slip velocity in m/s and spin in rad/s that deform its springs,
    0 while unpressed; power in W of its tangential spring, of its rolling spring and of its effects; acceleration along
    x in m/s² of recoiling ground).
    """
    depth, nx, ny, rx, ry = placed(rows, a, pose)
    vx, vy, omega = velocity
    k_l, k_ul, cap = rows[a, L_LAW + K_L], rows[a, L_LAW + K_UL], rows[a, L_LAW + ROLLING_CAP]
    depth -= rows[a, L_OFFSET]
    peak, bottom = rows[a, L_PEAK], rows[a, L_BOTTOM]
    ux, uy = vx - omega * ry, vy + omega * rx
    slip = ux * ny - uy * nx
    force_n, mu = normal_force_from_bottom(depth, peak, bottom, k_l, k_ul), rows[a, L_LAW + MU]
    pressed = rows[a, L_PRESSED] != 0.0
    if pressed:
        force_n = max(force_n, LEAST_FORCE_N)
    drag = taken = push = 0.0
    if effects and rows[a, L_ACTS] != 0.0:
        rate, law_n = -(ux * nx + uy * ny), force_n
        force_n, factor, drag = ground_forces(rows[a], L_EFFECTS, (depth, rate, slip, peak, bottom), law_n)
        mu *= factor
        taken = (force_n - law_n) * rate + drag * slip
    grip = force_n if pressed else 0.0
    indentation = rows[a, L_LAW + ROLLING_IN_INDENTATION]
    spin = omega if grip > 0.0 or indentation > 0.0 else 0.0
    force_t = tangential_force(displacement, grip, rows[a, L_LAW + K_T], mu)
    arm = np.sqrt(rx * rx + ry * ry) if cap > 0.0 else 0.0
    rolling = rolling_moment(rotation, grip, arm, rows[a, L_LAW + K_R], cap, indentation)
    along = force_t
    if effects:
        along += drag
    fx, fy = force_n * nx - along * ny, force_n * ny + along * nx
    if effects and rows[a, L_ACTS] != 0.0:
        push = recoil(rows[a], L_EFFECTS) * fx
    moment, winding = rx * fy - ry * fx - rolling, slip if pressed else 0.0
    return fx, fy, moment, winding, spin, force_t * slip, rolling * omega, taken, push
