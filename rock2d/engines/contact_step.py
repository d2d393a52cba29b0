"""One block in contact, advanced in time: fourth-order steps that land on the events of the law, compiled.

The state is q = (x, y, θ, vx, vy, ω). Each contact point of the block has a *contact*, which holds its memory. Within a
step, features do not change, and the law is evaluated at four Runge-Kutta stages. `trial_step` ends the step at the
first event. Without contacts a step is exact."""

from typing import Any, NamedTuple, Self

import numpy as np

from rock2d.compiled import copy, kernel
from rock2d.effects.columns import FIRST_EFFECT_COLUMN, damping_Ns_m
from rock2d.engines.contact_search import changes_feature, find_features, hand_over
from rock2d.engines.contact_state import (
    ACTING,
    ACTING_1,
    ACTIVE,
    DEPTH,
    DEPTH_1,
    DISPLACEMENT,
    DISPLACEMENT_1,
    INDEX,
    KEY,
    KIND,
    NORMAL_1,
    NOWHERE,
    OFFSET,
    PART,
    PEAK,
    PEAK_1,
    PLASTIC_WORK,
    RATE,
    ROTATION,
    ROTATION_1,
    TANGENTIAL_0,
    TANGENTIAL_1,
    ZONE,
    effects_act,
    load_active,
)
from rock2d.engines.event_detection import first_event
from rock2d.engines.geometry import CORNER_FACET, SMOOTH_FACET, ZONE_ID, Body, pose_of
from rock2d.engines.recording import note_recoil
from rock2d.engines.trial_step import correct_energy, step_to_event
from rock2d.laws.contact import (
    K_L,
    K_R,
    K_T,
    K_UL,
    MU,
    change_feature,
    cross_zone,
    elastic_energy,
    normal_force,
    residual_indentation,
    rolling_energy,
    tangential_force,
)
from rock2d.records.columns import EFFECTS, FRICTION, OMEGA, PLASTIC, ROLLING, VX, VY
from rock2d.scene.blocks import Block

SURFACE_TOLERANCE = 1e-10  # share of the radius by which rounding may leave a landing above the surface
FINE_STEP_FRACTION = 0.03  # phase in rad of the stiffest contact oscillation that one step may cover


def contact_steps_s(block: Block, tables: np.ndarray, fraction: float = FINE_STEP_FRACTION) -> tuple[Any, Any]:
    """Contact steps in s, see `Stiffest.steps_s`: for parameters (zones, columns) two numbers; for tables (n, zones,
    columns) two (n,) arrays."""
    return Stiffest.of(tables).steps_s(block, fraction)


class Stiffest(NamedTuple):
    """Largest stiffnesses of all zones in N/m, `k_r` in N m/rad, and largest `damping_Ns_m`."""

    k_l: Any
    k_ul: Any
    k_t: Any
    k_r: Any
    damping: Any

    @classmethod
    def of(cls, tables: np.ndarray) -> Self:
        """Those of parameters (zones, columns), or of each of tables (n, zones, columns)."""
        columns = [tables[..., k] for k in (K_L, K_UL, K_T, K_R)]
        # zones that a table lacks are NaN
        return cls(*(np.fmax.reduce(values, axis=-1) for values in (*columns, damping_Ns_m(tables))))

    def steps_s(self, block: Block, fraction: float) -> tuple[Any, Any]:
        """Contact steps in s: (while every contact is in first loading, otherwise).

        A step covers the phase `fraction` in rad of the stiffest oscillation, ω² = k (1/m + r²/I), with the largest
        lever r of the force; the normal force of a circle has no lever. Damping c of effects counts as the rate
        c (1/m + r²/I)."""
        lever = block.reach_m
        if block.smooth:
            lever = abs(block.semi_axes_m[0] - block.semi_axes_m[1]) + float(np.hypot(*block.centre_of_mass_m))
        inverse_mass_n = 1 / block.mass_kg + lever**2 / block.inertia_kg_m2
        inverse_mass_t = 1 / block.mass_kg + block.reach_m**2 / block.inertia_kg_m2
        others = np.maximum(self.k_t * inverse_mass_t, self.k_r / block.inertia_kg_m2)
        damping = (self.damping * inverse_mass_t) ** 2
        loading, unloading = (np.maximum(k * inverse_mass_n, others) for k in (self.k_l, self.k_ul))
        return fraction / np.sqrt(loading + damping), fraction / np.sqrt(unloading + damping)


@kernel
def _commit(world, contacts, active, works, audit):
    """Write the outcome of a finished step, from the rows of `active` loaded contacts, into memory and audit; works :
    see `step_to_event`."""
    memory, found, _ = contacts
    _update_inactive(world, memory, found, True)
    change_t, change_r = 0.0, 0.0  # energy in J that the tangential and the rolling springs gain
    for a in range(active):
        gained_t, gained_r = _commit_contact(a, world, contacts, audit)
        change_t += gained_t
        change_r += gained_r
    audit[FRICTION] += works[0] - change_t
    audit[ROLLING] += works[1] - change_r
    audit[EFFECTS] += works[2]


@kernel
def _commit_contact(a, world, contacts, audit):
    """`_commit` of the a-th loaded contact; returns the energy in J that its (tangential, rolling) spring gained."""
    memory, found, loaded = contacts
    ints, reals, found_r = memory.ints, memory.reals, found.reals
    trial, j, law = loaded.trial, loaded.which[a], world.law
    p = law[ints[j, ZONE]]
    gone = found_r[j, DEPTH] == NOWHERE  # the contact has slid off its feature in this step
    jump, depth = 0.0, trial[a, DEPTH_1]
    if not gone and changes_feature(j, memory, found):
        jump, depth = found_r[j, DEPTH] - depth, found_r[j, DEPTH]
    _follow(j, memory, found)
    reals[j, DEPTH], reals[j, RATE] = depth, found_r[j, RATE]
    before_r = rolling_energy(reals[j, ROTATION], p)
    reals[j, PEAK], reals[j, ACTING] = trial[a, PEAK_1], trial[a, ACTING_1]
    reals[j, DISPLACEMENT], reals[j, ROTATION] = trial[a, DISPLACEMENT_1], trial[a, ROTATION_1]
    audit[PLASTIC] += trial[a, PLASTIC_WORK]
    force_n, force_t = trial[a, NORMAL_1], trial[a, TANGENTIAL_1]
    gained_t = elastic_energy(0.0, force_t, p) - elastic_energy(0.0, trial[a, TANGENTIAL_0], p)
    if jump != 0.0:
        reals[j, OFFSET], force_n, force_t, lost = change_feature(
            p, depth, jump, (reals[j, OFFSET], reals[j, PEAK]), (force_n, force_t)
        )
        audit[PLASTIC] += lost
    after_r = rolling_energy(reals[j, ROTATION], p) if depth > 0.0 else 0.0
    zone = _zone(j, memory, world.ground)
    if zone != ints[j, ZONE] and depth > 0.0 and _parameters_differ(p, law[zone]):
        audit[PLASTIC] += _enter_zone(j, depth, (force_n, force_t), p, law[zone], memory)
    ints[j, ZONE] = zone
    if gone or depth <= 0.0:
        _dissipate_stored(j, depth, law[zone], memory, audit)
        _reset(j, memory)
        reals[j, DEPTH] = NOWHERE if gone else depth
        ints[j, KEY] = -1 if gone else ints[j, KEY]
    return gained_t, after_r - before_r


@kernel
def _enter_zone(j, depth, forces, p, new, memory):
    """Move contact j from a zone with parameters `p` into one with `new`; returns the energy in J that is lost.

    forces : (normal force of the law, tangential force) in N before"""
    reals = memory.reals
    force_n, force_t = forces
    kept = reals[j, ROTATION]
    stored = elastic_energy(force_n, force_t, p) + rolling_energy(kept, p)
    # an unpressed contact meets the new soil at the bottom of its indentation
    bottom = reals[j, OFFSET] + residual_indentation(reals[j, PEAK], p[K_L], p[K_UL])
    loaded, reals[j, DISPLACEMENT], reals[j, ROTATION] = cross_zone(force_n, force_t, kept, depth, p, new)
    reals[j, PEAK] = loaded
    reals[j, OFFSET] = depth - loaded if force_n > 0.0 else bottom
    stored -= elastic_energy(new[K_L] * loaded, new[K_T] * reals[j, DISPLACEMENT], new)
    return stored - rolling_energy(reals[j, ROTATION], new)


@kernel
def _dissipate_stored(j, depth, p, memory, audit):
    """Book the energy in the springs of contact j, which ends, as dissipated."""
    reals = memory.reals
    force_n = normal_force(depth - reals[j, OFFSET], reals[j, PEAK], p[K_L], p[K_UL])
    force_t = tangential_force(reals[j, DISPLACEMENT], force_n, p[K_T], p[MU])
    audit[PLASTIC] += elastic_energy(force_n, force_t, p)
    if depth > 0.0:
        audit[ROLLING] += rolling_energy(reals[j, ROTATION], p)
    reals[j, DEPTH] = NOWHERE


@kernel(forceinline=True)
def _touches(depth, rate, block):
    """Whether a contact begins: below the surface, or at the surface to rounding and moving in."""
    return depth > 0.0 or (depth > -SURFACE_TOLERANCE * block.radius and rate >= 0.0)


@kernel
def _follow(j, memory, found):
    """Give contact j the feature found for it."""
    ints, found_i = memory.ints, found.ints
    ints[j, KIND], ints[j, INDEX] = found_i[j, KIND], found_i[j, INDEX]
    ints[j, PART], ints[j, KEY] = found_i[j, PART], found_i[j, KEY]


@kernel
def _begin(j, memory, found, ground):
    """Begin contact j at its depth, without force."""
    _follow(j, memory, found)
    memory.ints[j, ZONE] = _zone(j, memory, ground)  # before ACTIVE is set: `_zone` reads it
    _reset(j, memory)
    memory.ints[j, ACTIVE], memory.reals[j, OFFSET] = 1, memory.reals[j, DEPTH]


@kernel
def _parameters_differ(p, new):
    same = True
    for i in range(FIRST_EFFECT_COLUMN):
        same = same and p[i] == new[i]
    return not same


@kernel
def _reset(j, memory):
    memory.ints[j, ACTIVE] = 0
    reals = memory.reals
    reals[j, PEAK], reals[j, DISPLACEMENT], reals[j, ROTATION], reals[j, OFFSET] = 0.0, 0.0, 0.0, 0.0
    reals[j, ACTING] = 0.0


@kernel
def _zone(j, memory, ground):
    """Zone of a contact's feature. A vertex belongs to the facet before it, or to the one after it if the contact is
    already in that zone."""
    ints, facets = memory.ints, ground.facets
    index = ints[j, INDEX]
    if ints[j, KIND] in (CORNER_FACET, SMOOTH_FACET):
        return int(facets[index, ZONE_ID])
    before = int(facets[max(index - 1, 0), ZONE_ID])
    after = int(facets[min(index, facets.shape[0] - 2), ZONE_ID])
    return after if ints[j, ACTIVE] and ints[j, ZONE] == after else before


@kernel
def _update_inactive(world, memory, found, begin):
    """Give inactive contacts the depths found for them; with `begin`, begin those that touch the ground. Returns how
    many begin."""
    ints, reals, found_i, found_r = memory.ints, memory.reals, found.ints, found.reals
    begun = 0
    for j in range(ints.shape[0]):
        if ints[j, ACTIVE]:
            continue
        depth, rate = found_r[j, DEPTH], found_r[j, RATE]
        reals[j, DEPTH], reals[j, RATE] = depth, rate
        ints[j, KEY] = found_i[j, KEY] if depth != NOWHERE else -1
        if begin and _touches(depth, rate, world.block):
            _begin(j, memory, found, world.ground)
            begun += 1
    return begun


@kernel
def begin_contacts(q, near, world, memory, found):
    """Search the ground for the first time, when no contact is active: set depths, and begin contacts that touch it.

    near : (first, one past the last) index of the facets that are searched. Returns the number of active contacts."""
    find_features(q, world.block.radius, near, world, memory, found)
    return _update_inactive(world, memory, found, True)


@kernel
def refresh_depths(q, near, world, memory, found):
    """Update the depths of inactive contacts, after steps that did not search the ground."""
    find_features(q, world.block.radius, near, world, memory, found)
    _update_inactive(world, memory, found, False)


@kernel(forceinline=True)
def _inspect(q, q1, h, whole, _, view):
    """`inspect` of `trial_step.step_to_event`: find the nearest features at the end of the step, and the first
    event."""
    reach, near, world, memory, found = view
    find_features(q1, reach, near, world, memory, found)
    return np.int64(0), first_event(h, whole, q, q1, world, memory, found)


@kernel
def step(q, h, near, world, contacts, audit, floating):
    """Advance q in place by at most h (s), or to the first event of the law. Returns the elapsed time in s.

    near : (first, one past the last) index of the facets that are searched
    contacts : (memory, found, loaded) as `new_contacts` and `new_loaded` make them
    floating : no contact touches the bottom of its indentation, so that the block moves on a parabola to the next event
    """
    memory, found, loaded = contacts
    block, q1 = world.block, loaded.state
    speed = np.sqrt(q[VX] * q[VX] + q[VY] * q[VY])
    reach = 4.0 * h * (speed + abs(q[OMEGA]) * block.radius) + 1e-6 * block.radius
    active = load_active(world, memory, loaded)
    body = Body(block, world.gravity)
    effects = effects_act(block, active, loaded.rows)
    _, _, c, s = pose_of(q)
    counts, view = (np.int64(0) if floating else active, active), (reach, near, world, memory, found)
    _, h, _, works, (error, scale), _ = step_to_event(
        q, (c, s), h, body, counts, loaded, q1, effects, audit, _inspect, view
    )
    if active > 0 and not effects:
        correct_energy(q, q1, h, error, scale, body, audit)
    copy(q1, q)
    if block.rounding > 0.0:
        hand_over(block.sides.shape[0], memory, found, loaded, active)
    _commit(world, contacts, active, works, audit)
    note_recoil(h, works[3], audit)
    return h
