"""One release, compiled: half drift, kick, half drift; small steps in contact, parabolas in flight."""

from typing import NamedTuple

import numba
import numpy as np

from rock2d.blind.reality import parameters
from rock2d.blind.reality.compiled_records import (
    K_L,
    K_R,
    K_T,
    K_UL,
    N_GROUND_MOTION,
    OMEGA,
    PIVOT_X,
    PIVOT_Y,
    RISE,
    RISE_SPEED,
    SHIFT,
    SHIFT_SPEED,
    THETA,
    TILT,
    VX,
    VY,
    BlockMotion,
    Body,
    ContactRows,
    Contacts,
    Ground,
    ImpactDraws,
    SoilLaw,
    X,
    Y,
)
from rock2d.blind.reality.contact_detection import DEPTH, N_FOUND, NO_CONTACT, PX, PY, find_contacts, nearest_on_ground
from rock2d.blind.reality.data_model import Array
from rock2d.blind.reality.forces import (
    EMBANKMENT_FORCE,
    FORCE_X,
    FORCE_Y,
    MOMENT,
    N_ACTIVE,
    N_FIRST_LOADING,
    N_MEMORY,
    N_PRESSING,
    N_SUMS,
    NEXT_DISTANCE,
    NORMAL_X,
    NORMAL_Y,
    acts_in_flight,
    air_acceleration,
    row_of,
    sum_forces,
    update_contacts,
)

OSCILLATION_STEP_RAD = 0.03  # phase of the stiffest oscillation that one contact step covers
LANDING_STEP = 0.1  # least step in flight, as a share of a contact step: contacts begin close to the surface
DAMPING_STEP = 0.2  # share of a speed that a damping cause may take in a step
AIR_STEP = 4e-3  # longest step with forces of the air or on moving ground, in √(size / g)
AIR_STEP_SIZE = 0.1  # longest path of a step with forces of the air, as a share of the block's size
REST_TIME = 2.0  # time in √(size / g) after which a block that stays in place is at rest
REST_DISTANCE = 0.01  # largest displacement during that time, as a share of the block's size, and turn in rad
MOST_STEPS = 4_000_000


class PathPiece(NamedTuple):
    """The path from state `old` at t0 to `new` at t1 under a constant `gravity` (0: straight)."""

    t0: float
    t1: float
    old: Array
    new: Array
    gravity: float


class TimeSteps(NamedTuple):
    """Time steps in s while contacts load, while they unload, and while none presses."""

    loading: float
    unloading: float
    floating: float


@numba.njit
def time_steps(soil: Array, body: Body, values: Array) -> TimeSteps:
    """Time steps for a block on the stiffest soil."""
    k_l = k_ul = k_t = k_r = 0.0
    for z in range(soil.shape[0]):
        k_l, k_ul = max(k_l, soil[z, K_L]), max(k_ul, soil[z, K_UL])
        k_t, k_r = max(k_t, soil[z, K_T]), max(k_r, soil[z, K_R])
    k_ul *= np.exp(values[parameters.WAVE_LOG_FACTOR])
    lever = (body.centroid_x**2 + body.centroid_y**2) if body.group == 0 else body.reach**2
    normal = 1.0 / body.mass + lever / body.inertia
    oblique = 1.0 / body.mass + body.reach**2 / body.inertia
    other = max(k_t * oblique, k_r / body.inertia)
    damped = 1e9
    if values[parameters.DAMPING_RATE] > 0.0:
        damped = DAMPING_STEP / (values[parameters.DAMPING_RATE] * oblique)
    loading = min(damped, OSCILLATION_STEP_RAD / np.sqrt(max(k_l * normal, other)))
    unloading = min(damped, OSCILLATION_STEP_RAD / np.sqrt(max(k_ul * normal, other)))
    floating = min(damped, OSCILLATION_STEP_RAD / np.sqrt(max(k_r / body.inertia, 1e-12)))
    return TimeSteps(loading, unloading, max(floating, unloading))


@numba.njit
def fill_poses(done: int, path: PathPiece, body: Body, times: Array, poses: Array) -> int:
    """Fill the poses of the centroid at the instants up to `path.t1`. Returns how many instants are done."""
    t0, t1, old, new, gravity = path.t0, path.t1, path.old, path.new, path.gravity
    while done < times.size and times[done] <= t1:
        d, span = times[done] - t0, t1 - t0
        share = d / span
        bulge = 0.5 * gravity * d * (span - d) if gravity > 0.0 else 0.0
        x, y = old[0] + share * (new[0] - old[0]), old[1] + share * (new[1] - old[1]) + bulge
        theta = old[2] + share * (new[2] - old[2])
        c, s = np.cos(theta), np.sin(theta)
        poses[done, 0] = x + c * body.centroid_x - s * body.centroid_y
        poses[done, 1] = y + s * body.centroid_x + c * body.centroid_y
        poses[done, 2] = theta
        done += 1
    return done


@numba.njit
def move_ground(base: Ground, motion: Array, points: Array) -> None:
    """Fill `points` with those of `base`, displaced by the `motion` of the ground."""
    pivot_x, pivot_y, tilt = motion[PIVOT_X], motion[PIVOT_Y], motion[TILT]
    c, s = np.cos(tilt), np.sin(tilt)
    yielding = base.yielding
    for i in range(base.points.shape[0]):
        dx, dy = base.points[i, 0] - pivot_x, base.points[i, 1] - pivot_y
        if tilt != 0.0:
            dx, dy = c * dx - s * dy, s * dx + c * dy
        shifted = (i < yielding.size and yielding[i] > 0.0) or (i > 0 and yielding[i - 1] > 0.0)
        points[i, 0] = pivot_x + dx + (motion[SHIFT] if shifted else 0.0)
        points[i, 1] = pivot_y + dy + motion[RISE]


@numba.njit
def simulate_release(
    state: Array, times: Array, base: Ground, first_body: Body, law: SoilLaw, draws: ImpactDraws, poses: Array
) -> None:
    """Fill `poses` (frames, 3) of a release that starts at times[0] with `state` (of the centre of mass)."""
    values, gravity = law.values, law.gravity
    body = first_body
    reach, size = body.reach, body.size
    time_scale = np.sqrt(size / max(gravity, 1e-9))
    q, old, rested = state.copy(), state.copy(), state.copy()
    ground = Ground(base.points.copy(), base.zone, base.patch, base.ridges, base.yielding)
    impact_law = SoilLaw(law.soil.copy(), law.indentation, gravity, values)
    n_rows = body.corners.shape[0] + base.points.shape[0]
    contacts = Contacts(np.zeros((n_rows, N_FOUND)), np.zeros((n_rows, N_MEMORY)), np.zeros(N_SUMS))
    sums = contacts.sums
    contacts.found[:, DEPTH] = NO_CONTACT
    fixed = 0 if body.group == 0 else body.corners.shape[0] // body.group
    rows = ContactRows(fixed, fixed, fixed)
    velocity, path_velocity, accel = np.zeros(3), np.zeros(3), np.zeros(3)
    ground_motion = np.zeros(N_GROUND_MOTION)
    steps = time_steps(impact_law.soil, body, values)
    air_acts, shaking = acts_in_flight(values), values[parameters.SHAKE_AMPLITUDE] > 0.0
    t, done, impact, in_contact = times[0], 0, -1, False
    last, gap = 0.0, -1.0
    resting_from, end = t, times[times.size - 1]
    for _ in range(MOST_STEPS):
        if done == times.size:
            return
        speed = (
            np.sqrt(q[VX] * q[VX] + q[VY] * q[VY])
            + abs(q[OMEGA]) * reach
            + values[parameters.SHAKE_AMPLITUDE] * values[parameters.SHAKE_RATE]
        )
        moving = _embankment_moves(ground_motion, values)
        if in_contact:
            h = _contact_step(sums, steps, speed, time_scale)
        else:
            gap = max(0.0, -nearest_on_ground(q[X], q[Y], ground.points)[0]) - reach
            if gap < 0.5 * reach:
                rows, near = find_contacts(q, body, ground, contacts.found)
                gap = max(gap, min(near, 0.4 * reach))
            h = 0.8 * gap / (speed + np.sqrt(gravity * max(gap, 0.0)) + 1e-12)
            h = max(LANDING_STEP * steps.unloading, min(h, end - t + 1e-9))
            if air_acts:
                h = min(h, AIR_STEP * time_scale, AIR_STEP_SIZE * size / (speed + 1e-12))
        if moving or shaking:
            h = min(h, max(steps.unloading, AIR_STEP * time_scale))
        # to the middle of the step
        for k in range(6):
            old[k] = q[k]
        for k in range(3):
            q[k] += 0.5 * h * q[3 + k]
            velocity[k] = q[3 + k] + 0.5 * h * accel[k]
            path_velocity[k] = q[3 + k]
        if shaking:
            _shake(t + 0.5 * h, values, ground_motion)
        if shaking or moving:
            ground_motion[SHIFT] += 0.5 * h * ground_motion[SHIFT_SPEED]
            move_ground(base, ground_motion, ground.points)
        ax = ay = alpha = 0.0
        # contacts begin and end, and press, in the middle of the step
        if in_contact or gap < 2.0 * h * speed + gravity * h * h + 0.01 * body.rounding:
            rows, gap = find_contacts(q, body, ground, contacts.found)
            late_depth = 4.0 * h * speed + 1e-6 * size
            active = update_contacts(rows, q, late_depth, ground, contacts, values)
            if active > 0 and not in_contact:
                in_contact, last = True, 0.0
                impact = min(impact + 1, draws.soil_factors.shape[0] - 1)
                _draw_soil(law.soil, draws.soil_factors[impact], impact_law.soil)
                steps = time_steps(impact_law.soil, body, values)
                if draws.tilts[impact] != 0.0:
                    # the ground is turned about the point of contact for the time of the impact
                    ground_motion[TILT] = draws.tilts[impact]
                    ground_motion[PIVOT_X], ground_motion[PIVOT_Y] = _deepest_contact(rows, contacts.found, q)
                    move_ground(base, ground_motion, ground.points)
            if active > 0:
                motion = BlockMotion(q, velocity, path_velocity, 0.5 * (h + last))
                sum_forces(rows, motion, ground, ground_motion, impact_law, contacts)
                ax, ay = sums[FORCE_X] / body.mass, sums[FORCE_Y] / body.mass
                alpha = sums[MOMENT] / body.inertia
                last = h
            elif in_contact:
                in_contact, last = False, 0.0
                if impact == 0 and values[parameters.SHED_SHARE] > 0.0:
                    body = _without_shed_mass(body, q, values[parameters.SHED_SHARE])
                    steps = time_steps(impact_law.soil, body, values)
                _change_velocity_at_lift_off(q, reach, draws.speed_losses[impact], sums, values)
                _end_impact_of_ground(base, values, ground_motion, ground.points, sums)
        if air_acts:
            bx, by, beta = air_acceleration(q, velocity, gap, values)
            ax, ay, alpha = ax + bx, ay + by, alpha + beta
        accel[0], accel[1], accel[2] = ax, ay - gravity, alpha
        if values[parameters.RECOIL_MASS] > 0.0:
            _recoil(sums[EMBANKMENT_FORCE] if in_contact else 0.0, h, values, ground_motion)
        # to the end of the step
        for k in range(3):
            q[3 + k] += h * accel[k]
            q[k] += 0.5 * h * q[3 + k]
        path = PathPiece(t, t + h, old, q, 0.0 if in_contact or air_acts else gravity)
        done = fill_poses(done, path, body, times, poses)
        t += h
        if impact < 0 or _has_moved(q, rested, size):
            resting_from = t
            for k in range(3):
                rested[k] = q[k]
        elif t - resting_from > REST_TIME * time_scale:
            break
    fill_poses(done, PathPiece(t, np.inf, q, q, 0.0), body, times, poses)


@numba.njit
def _embankment_moves(motion: Array, values: Array) -> bool:
    """Whether the embankment moves, or its spring will push it back."""
    pushed = motion[SHIFT] != 0.0 and values[parameters.RECOIL_SPRING] > 0.0
    return abs(motion[SHIFT_SPEED]) > 1e-9 or pushed


@numba.njit
def _shake(t: float, values: Array, motion: Array) -> None:
    """Set the rise of shaking ground at the time t, and its speed."""
    angle = values[parameters.SHAKE_RATE] * t + values[parameters.SHAKE_PHASE]
    motion[RISE] = values[parameters.SHAKE_AMPLITUDE] * np.sin(angle)
    motion[RISE_SPEED] = values[parameters.SHAKE_AMPLITUDE] * values[parameters.SHAKE_RATE] * np.cos(angle)


@numba.njit
def _end_impact_of_ground(base: Ground, values: Array, motion: Array, points: Array, sums: Array) -> None:
    """End of an impact: the embankment stops unless a spring pushes it back, and turned ground turns back."""
    if values[parameters.RECOIL_SPRING] == 0.0:
        motion[SHIFT_SPEED] = 0.0
    if motion[TILT] != 0.0:
        motion[TILT] = 0.0
        move_ground(base, motion, points)
    sums[EMBANKMENT_FORCE] = 0.0


@numba.njit
def _contact_step(sums: Array, steps: TimeSteps, speed: float, time_scale: float) -> float:
    """Time step in s of a block in contact."""
    if sums[N_ACTIVE] > 0.0 and sums[N_PRESSING] == 0.0:
        way = 0.25 * sums[NEXT_DISTANCE] / (speed + 1e-12)
        return max(steps.unloading, min(steps.floating, way, 0.02 * time_scale))
    return steps.loading if sums[N_FIRST_LOADING] == sums[N_PRESSING] else steps.unloading


@numba.njit
def _has_moved(state: Array, start: Array, size: float) -> bool:
    """Whether a block has left the place where its rest may have begun."""
    distance = max(abs(state[X] - start[X]), abs(state[Y] - start[Y]))
    return distance > REST_DISTANCE * size or abs(state[THETA] - start[THETA]) > REST_DISTANCE


@numba.njit
def _draw_soil(base: Array, factors: Array, soil: Array) -> None:
    """Fill `soil` with the rows of `base` times the factors of an impact."""
    for z in range(soil.shape[0]):
        for k in range(5):
            soil[z, k] = base[z, k] * factors[k]
        soil[z, K_UL] = max(soil[z, K_L], base[z, K_UL] * factors[K_L] * factors[K_UL])


@numba.njit
def _without_shed_mass(body: Body, state: Array, share: float) -> Body:
    """The block after it has left a share of its mass behind, at rest; its momentum stays."""
    for k in range(3):
        state[3 + k] /= 1.0 - share
    kept = 1.0 - share
    return Body(
        body.corners, body.mass * kept, body.inertia * kept, body.reach, body.rounding, body.centroid_x,
        body.centroid_y, body.group, body.size,
    )  # fmt: skip


@numba.njit
def _deepest_contact(rows: ContactRows, found: Array, state: Array) -> tuple[float, float]:
    """Point of the deepest contact in m."""
    deepest, x, y = NO_CONTACT, state[X], state[Y]
    for i in range(rows.corners + rows.high - rows.low):
        j = row_of(i, rows)
        if found[j, DEPTH] > deepest:
            deepest, x, y = found[j, DEPTH], found[j, PX], found[j, PY]
    return x, y


@numba.njit
def _change_velocity_at_lift_off(state: Array, reach: float, loss: float, sums: Array, values: Array) -> None:
    """Change the velocity at the end of an impact; `loss`: share of the horizontal speed."""
    if values[parameters.SPIN_KICK] > 0.0:
        kick = values[parameters.SPIN_KICK] * abs(state[OMEGA]) * reach
        state[VX] += kick * sums[NORMAL_X]
        state[VY] += kick * sums[NORMAL_Y]
    if values[parameters.SPEED_LOSS] > 0.0:
        state[VX] *= 1.0 - loss


@numba.njit
def _recoil(force: float, h: float, values: Array, motion: Array) -> None:
    """Move the embankment through the second half of a step of h under a horizontal `force` in N on it."""
    push = force / values[parameters.RECOIL_MASS] - values[parameters.RECOIL_SPRING] * motion[SHIFT]
    speed = (motion[SHIFT_SPEED] + h * push) / (1.0 + h * values[parameters.RECOIL_DASHPOT])
    friction = h * values[parameters.RECOIL_FRICTION]
    motion[SHIFT_SPEED] = np.sign(speed) * max(0.0, abs(speed) - friction)
    motion[SHIFT] += 0.5 * h * motion[SHIFT_SPEED]
