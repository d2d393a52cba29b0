"""Contact state, compiled: the memory of each contact of a block, the energy in it, and the active contacts loaded into
rows for the next steps, with their forces.

A polygon has a contact for each corner and VERTEX_CONTACTS for ground corners under its faces; a circle or ellipse has
SMOOTH_CONTACTS."""

from typing import NamedTuple

import numpy as np

from rock2d.compiled import copy, kernel, njit
from rock2d.effects.columns import ANY_EFFECT_ACTS, FIRST_EFFECT_COLUMN, N_COLUMNS
from rock2d.effects.forces import ground_forces
from rock2d.engines.free_flight import air_acts
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
    elastic_energy,
    normal_force,
    normal_force_from_bottom,
    residual_indentation,
    rolling_energy,
    rolling_moment,
    tangential_force,
)
from rock2d.records.columns import N_STATE, OMEGA, VX, VY
from rock2d.scene.blocks import Block

# memory of a contact: integers, then reals; ACTING is the force of a contact with effects
ACTIVE, KIND, INDEX, PART, ZONE, KEY = range(6)
DEPTH, RATE, PEAK, DISPLACEMENT, ROTATION, OFFSET, ACTING = range(7)
N_INTS, N_REALS = KEY + 1, ACTING + 1
# saved contact of a suspended release: its integers, its reals, and the largest kinetic energy of the release at the
# beginning of a contact
SAVED_ENERGY = N_INTS + N_REALS
N_SAVED = SAVED_ENERGY + 1
VERTEX_CONTACTS = 8  # convex ground corners under one polygon at a time
SMOOTH_CONTACTS = 6  # patches and corners under one circle or ellipse at a time
NOWHERE = -1.0e300  # depth of a contact that has no feature
# columns of a loaded contact: its feature (`geometry.load_feature`), the parameters of the law, its memory, its kind,
# its residual indentation, whether the ground presses on it in this step, whether effects act in it, and their columns
L_FEATURE = 0
L_LAW = L_FEATURE + N_FEATURE
L_OFFSET = L_LAW + len(CONTACT_LAW_COLUMNS)
L_PEAK, L_DISPLACEMENT, L_ROTATION, L_KIND, L_BOTTOM, L_PRESSED, L_ACTS, L_EFFECTS = range(L_OFFSET + 1, L_OFFSET + 9)
N_LOADED = L_EFFECTS + N_COLUMNS - FIRST_EFFECT_COLUMN
# columns of a contact's row of rates: deformation of its springs at the end of a step, before friction and cap limit
# it, and their rates at a stage
UNLIMITED_DISPLACEMENT, UNLIMITED_ROTATION, SLIP_RATE, SPIN_RATE = range(4)
# columns of a contact's row of a trial step: penetration and its rate before and after it, arm and slip of the contact
# point after it, and the outcome (`trial_step.step_to_event`): peak penetration, states of the springs, normal force of
# the law before and after, acting force, tangential force before and after, rolling moment, and plastic work
(
    DEPTH_0, RATE_0, DEPTH_1, RATE_1, ARM, SLIP, PEAK_1, DISPLACEMENT_1, ROTATION_1, NORMAL_0, NORMAL_1, ACTING_1,
    TANGENTIAL_0, TANGENTIAL_1, MOMENT_1, PLASTIC_WORK,
) = range(16)  # fmt: skip
LEAST_FORCE_N = 1e-300  # least force of a pressed contact, so that its springs act until it lifts off
LEAST_EVENT = 1e-3  # share of a step: the step starts, to rounding, at an event that comes sooner
LARGEST_STEP_GROWTH = 5.0  # largest factor on contact steps while the motion decays


class Contacts(NamedTuple):
    """The memory of all contacts of a block, or the features that a search found for them."""

    ints: np.ndarray  # (contacts, N_INTS): ACTIVE, KIND, INDEX, PART, ZONE, KEY
    reals: np.ndarray  # (contacts, N_REALS): DEPTH, RATE, PEAK, DISPLACEMENT, ROTATION, OFFSET, ACTING


def contact_count(block: Block) -> int:
    """Number of contacts that a block needs."""
    return SMOOTH_CONTACTS if block.smooth else len(block.corners_m) + VERTEX_CONTACTS


@njit
def new_contacts(count):
    """Empty memory of `count` contacts."""
    contacts = Contacts(np.zeros((count, N_INTS), np.int64), np.zeros((count, N_REALS)))
    clear(contacts)
    return contacts


@kernel
def clear(contacts):
    """Empty the memory of all contacts."""
    ints, reals = contacts.ints, contacts.reals
    for j in range(ints.shape[0]):  # slice assignments take seconds to compile
        for k in range(N_INTS):
            ints[j, k] = 0
        for k in range(N_REALS):
            reals[j, k] = 0.0
        ints[j, KEY], reals[j, DEPTH] = -1, NOWHERE


@kernel
def save_contacts(memory, energy, saved):
    """Write the memory of all contacts, and the largest kinetic energy (J), into `saved` (contacts, N_SAVED)."""
    for j in range(memory.ints.shape[0]):
        for k in range(N_INTS):
            saved[j, k] = memory.ints[j, k]
        copy(memory.reals[j], saved[j, N_INTS:SAVED_ENERGY])
        saved[j, SAVED_ENERGY] = energy


@kernel
def restore_contacts(saved, memory):
    """Read the memory of all contacts from `saved`; returns (active contacts, largest kinetic energy in J)."""
    active = 0
    for j in range(memory.ints.shape[0]):
        for k in range(N_INTS):
            memory.ints[j, k] = int(saved[j, k])
        copy(saved[j, N_INTS:SAVED_ENERGY], memory.reals[j])
        active += memory.ints[j, ACTIVE]
    return active, saved[0, SAVED_ENERGY]


@kernel
def kinetic_energy(q, block):
    """Kinetic energy in J."""
    return 0.5 * (block.mass * (q[VX] * q[VX] + q[VY] * q[VY]) + block.inertia * q[OMEGA] * q[OMEGA])


@kernel
def stored_energy(memory, law):
    """Energy in J stored in the springs of all contacts; `law`: rows (zones, columns)."""
    ints, reals = memory.ints, memory.reals
    total = 0.0
    for j in range(ints.shape[0]):
        if ints[j, ACTIVE]:
            p = law[ints[j, ZONE]]
            force_n = normal_force(reals[j, DEPTH] - reals[j, OFFSET], reals[j, PEAK], p[K_L], p[K_UL])
            force_t = tangential_force(reals[j, DISPLACEMENT], force_n, p[K_T], p[MU])
            if p[ANY_EFFECT_ACTS] != 0.0:
                force_t = p[K_T] * reals[j, DISPLACEMENT]  # the step before has limited it to friction
            total += elastic_energy(force_n, force_t, p) + rolling_energy(reals[j, ROTATION], p)
    return total


@kernel
def pressure(memory, law):
    """(sum of normal forces in N, forces of effects included; largest penetration in m; number of active contacts)."""
    ints, reals = memory.ints, memory.reals
    force, deepest, active = 0.0, 0.0, 0
    for j in range(ints.shape[0]):
        if ints[j, ACTIVE]:
            p = law[ints[j, ZONE]]
            if p[ANY_EFFECT_ACTS] != 0.0:
                force += reals[j, ACTING]
            else:
                force += normal_force(reals[j, DEPTH] - reals[j, OFFSET], reals[j, PEAK], p[K_L], p[K_UL])
            deepest = max(deepest, reals[j, DEPTH])
            active += 1
    return force, deepest, active


@kernel
def step_growth(reference_energy, block, memory, law):
    """Factor (1 to LARGEST_STEP_GROWTH) by which a contact step may grow while the oscillation in the contacts decays.

    The energy error of a step is of order energy × step⁵. With a step ∝ 1/√energy, below a sixteenth of the reference
    energy, it still decreases. Steady rolling and sliding do not count as oscillation."""
    ints, reals = memory.ints, memory.reals
    energy, touching = stored_energy(memory, law), False
    for j in range(ints.shape[0]):
        if ints[j, ACTIVE]:
            energy += 0.5 * block.mass * reals[j, RATE] * reals[j, RATE]
            touching = True
    if not touching:
        return 1.0
    if energy <= 0.0:
        return LARGEST_STEP_GROWTH
    return min(LARGEST_STEP_GROWTH, max(1.0, 0.25 * np.sqrt(reference_energy / energy)))


class LoadedContacts(NamedTuple):
    """Rows of the active contacts; only the first rows are in use."""

    rows: np.ndarray  # (contacts, N_LOADED)
    which: np.ndarray  # (contacts,) index of the contact of a row
    rates: np.ndarray  # (contacts, 4) UNLIMITED_DISPLACEMENT ... SPIN_RATE
    trial: np.ndarray  # (contacts, 16) DEPTH_0 ... PLASTIC_WORK
    state: np.ndarray  # (6,) state of the block at the end of a trial step


@njit
def new_loaded(count):
    """Rows for `count` contacts."""
    return LoadedContacts(
        np.empty((count, N_LOADED)),
        np.empty(count, np.int64),
        np.empty((count, 4)),
        np.empty((count, PLASTIC_WORK + 1)),
        np.empty(N_STATE),
    )


@kernel
def load_active(world, memory, loaded):
    """Copy feature, parameters, memory and depths of the active contacts into rows; returns how many there are."""
    ints, reals, rows, law = memory.ints, memory.reals, loaded.rows, world.law
    active = np.int64(0)
    for j in range(ints.shape[0]):
        if ints[j, ACTIVE]:
            feature = load_feature(ints[j, KIND], ints[j, INDEX], ints[j, PART], world.block, world.ground.facets)
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
            rows[active, L_DISPLACEMENT], rows[active, L_ROTATION] = (reals[j, DISPLACEMENT], reals[j, ROTATION])
            rows[active, L_KIND] = ints[j, KIND]
            loaded.trial[active, DEPTH_0], loaded.trial[active, RATE_0] = reals[j, DEPTH], reals[j, RATE]
            loaded.which[active] = j
            active += 1
    return active


@kernel(forceinline=True)
def note_pressed(active, loaded, h):
    """Set L_PRESSED: on which contacts the ground presses in a step of h (s) that begins at DEPTH_0 and RATE_0.

    It holds for the whole step, which ends if a contact passes the bottom of its indentation: there the moment of the
    rolling spring, and friction of 90 degrees, jump to 0."""
    rows, trial = loaded.rows, loaded.trial
    for a in range(active):
        ahead = trial[a, DEPTH_0] - rows[a, L_OFFSET] + LEAST_EVENT * h * trial[a, RATE_0]
        rows[a, L_PRESSED] = 1.0 if ahead > rows[a, L_BOTTOM] else 0.0


@kernel
def effects_act(block, active, rows):
    """Whether effects of the catalogue act on the block, in the air or in a loaded contact."""
    act = air_acts(block)
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
    0 while unpressed; power in W of its tangential spring, of its rolling spring and of its effects)."""
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
    drag = power_e = 0.0
    if effects and rows[a, L_ACTS] != 0.0:
        rate, law_n = -(ux * nx + uy * ny), force_n
        force_n, factor, drag = ground_forces(rows[a], L_EFFECTS, (depth, rate, slip, peak, bottom), law_n)
        mu *= factor
        power_e = (force_n - law_n) * rate + drag * slip
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
    moment, winding = rx * fy - ry * fx - rolling, slip if pressed else 0.0
    return fx, fy, moment, winding, spin, force_t * slip, rolling * omega, power_e
