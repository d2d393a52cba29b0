"""One release, compiled: half drift, kick, half drift; small steps in contact, parabolas in flight."""

from __future__ import annotations

import numba
import numpy as np

from rock2d.blind.reality import parameters
from rock2d.blind.reality.contact import (
    COUNT,
    EMBANKMENT,
    FX,
    FY,
    MOMENT,
    N_SUMS,
    OUT_X,
    OUT_Y,
    PRESSING,
    VIRGIN,
    WAY,
    add_up,
    settle,
)
from rock2d.blind.reality.contact_detection import DEPTH, PX, PY, find
from rock2d.blind.reality.data_model import Array
from rock2d.blind.reality.forces import K_L, K_R, K_T, K_UL, N_MEMORY, air, blows
from rock2d.blind.reality.ground import below, facet_at, foot

PHASE = 0.03  # rad of the stiffest oscillation in a contact step
LANDING = 0.1  # of a contact step: the last steps of a flight, so that contacts begin close to the surface
DAMPED = 0.2  # share of a speed that effects may take in a step
AIR_STEP = 4e-3  # of √(size / g), with forces of the air
AIR_WAY = 0.1  # of the block's size, too
CALM = 2.0  # √(size / g): so long must a block stand still to be at rest
STILL = 0.01  # of its size (and rad): it may move so far meanwhile
MOST_STEPS = 4_000_000
# what of a block the motion needs: mass, inertia about the centre of mass, reach and rounding, where the centroid is
# seen from the centre of mass, how many corners share a contact (0: a circle), size
MASS, INERTIA, REACH, ROUNDING, CENTROID_X, CENTROID_Y, GROUP, SIZE = range(8)


@numba.njit
def steps_s(soil: Array, block: Array, dial: Array) -> tuple[float, float, float]:
    """Steps in s while contacts load, while they unload, and while none presses."""
    k_l = k_ul = k_t = k_r = 0.0
    for z in range(soil.shape[0]):
        k_l, k_ul = max(k_l, soil[z, K_L]), max(k_ul, soil[z, K_UL])
        k_t, k_r = max(k_t, soil[z, K_T]), max(k_r, soil[z, K_R])
    lever = (block[CENTROID_X] ** 2 + block[CENTROID_Y] ** 2) if block[GROUP] == 0.0 else block[REACH] ** 2
    normal = 1.0 / block[MASS] + lever / block[INERTIA]
    oblique = 1.0 / block[MASS] + block[REACH] ** 2 / block[INERTIA]
    other = max(k_t * oblique, k_r / block[INERTIA])
    damped = 1e9
    if dial[parameters.STIFFENING_RATE] > 0.0:
        damped = DAMPED / (dial[parameters.STIFFENING_RATE] * oblique)
    loading = min(damped, PHASE / np.sqrt(max(k_l * normal, other)))
    unloading = min(damped, PHASE / np.sqrt(max(k_ul * normal, other)))
    floating = min(damped, PHASE / np.sqrt(max(k_r / block[INERTIA], 1e-12)))
    return loading, unloading, max(floating, unloading)


@numba.njit
def film_to(
    done: int, t0: float, t1: float, old: Array, new: Array, gravity: float, block: Array, times: Array,
    poses: Array,
) -> int:  # fmt: skip
    """Poses of the centroid at the instants up to t1, on the way from `old` at t0 to `new` under constant
    acceleration downward of `gravity` (0: straight). Returns how many instants are done."""
    while done < times.size and times[done] <= t1:
        d, span = times[done] - t0, t1 - t0
        share = d / span
        bulge = 0.5 * gravity * d * (span - d) if gravity > 0.0 else 0.0
        x, y = old[0] + share * (new[0] - old[0]), old[1] + share * (new[1] - old[1]) + bulge
        theta = old[2] + share * (new[2] - old[2])
        c, s = np.cos(theta), np.sin(theta)
        poses[done, 0] = x + c * block[CENTROID_X] - s * block[CENTROID_Y]
        poses[done, 1] = y + s * block[CENTROID_X] + c * block[CENTROID_Y]
        poses[done, 2] = theta
        done += 1
    return done


@numba.njit
def lay_ground(
    base: Array,
    pivot_x: float,
    pivot_y: float,
    tilt: float,
    shift: float,
    yielding: Array,
    lift: float,
    points: Array,
) -> None:
    """The ground as it is now: `base` turned by `tilt` about the pivot, the embankment shifted, all lifted."""
    c, s = np.cos(tilt), np.sin(tilt)
    for i in range(base.shape[0]):
        dx, dy = base[i, 0] - pivot_x, base[i, 1] - pivot_y
        if tilt != 0.0:
            dx, dy = c * dx - s * dy, s * dx + c * dy
        moved = (i < yielding.size and yielding[i] > 0.0) or (i > 0 and yielding[i - 1] > 0.0)
        points[i, 0] = pivot_x + dx + (shift if moved else 0.0)
        points[i, 1] = pivot_y + dy + lift


@numba.njit
def clearance(x: float, y: float, reach: float, points: Array) -> float:
    """Lower bound of the distance in m between the ground and a disc of radius `reach`; negative if unknown."""
    home = facet_at(x, points)
    if below(x, y, home, points):
        return -reach
    nearest = 1e9
    for f in range(points.shape[0] - 1):
        nearest = min(nearest, foot(x, y, f, points)[2])
    return np.sqrt(nearest) - reach


@numba.njit
def release(
    state: Array, times: Array, base: Array, zone: Array, patch: Array, ridges: Array, yielding: Array, corners: Array,
    block: Array, laws: Array, indentation: bool, gravity: float, factors: Array, tilts: Array, shares: Array, dial:
    Array, poses: Array,
) -> None:  # fmt: skip
    """Fill `poses` (frames, 3) of a release that starts at times[0] with `state` (of the centre of mass)."""
    body = block.copy()
    mass, inertia, reach, size = body[MASS], body[INERTIA], body[REACH], body[SIZE]
    group, rounding = int(body[GROUP]), body[ROUNDING]
    pace = np.sqrt(size / max(gravity, 1e-9))
    q, old, start = state.copy(), state.copy(), state.copy()
    points, soil = base.copy(), laws.copy()
    rows = corners.shape[0] + base.shape[0]
    fixed = 0 if group == 0 else corners.shape[0] // group
    found, memory, sums = np.zeros((rows, 6)), np.zeros((rows, N_MEMORY)), np.zeros(N_SUMS)
    found[:, DEPTH] = -1e9
    velocity, going = np.zeros(3), np.zeros(3)
    accel = np.zeros(3)
    loading, unloading, floating = steps_s(soil, body, dial)
    windy, shaking, recoils = blows(dial), dial[parameters.SHAKE] > 0.0, dial[parameters.RECOIL_MASS] > 0.0
    t, done, impact, is_open = times[0], 0, -1, False
    last, low, high, gap = 0.0, 0, 0, -1.0
    shift = drift = lift = heave = tilt = pivot_x = pivot_y = 0.0
    calm_from, end = t, times[times.size - 1]
    for _ in range(MOST_STEPS):
        if done == times.size:
            return
        speed = (
            np.sqrt(q[3] * q[3] + q[4] * q[4])
            + abs(q[5]) * reach
            + dial[parameters.SHAKE] * dial[parameters.SHAKE_RATE]
        )
        moving = abs(drift) > 1e-9 or (shift != 0.0 and dial[parameters.RECOIL_SPRING] > 0.0)
        # how far to step
        if is_open:
            h = unloading
            if sums[COUNT] > 0.0 and sums[PRESSING] == 0.0:
                h = max(unloading, min(floating, 0.25 * sums[WAY] / (speed + 1e-12), 0.02 * pace))
            elif sums[VIRGIN] == sums[PRESSING]:
                h = loading
        else:
            gap = clearance(q[0], q[1], reach, points)
            if gap < 0.5 * reach:
                low, high, near = find(
                    q[0], q[1], q[2], corners, rounding, group, reach, points, ridges, patch, found
                )
                gap = max(gap, min(near, 0.4 * reach))
            h = 0.8 * gap / (speed + np.sqrt(gravity * max(gap, 0.0)) + 1e-12)
            h = max(LANDING * unloading, min(h, end - t + 1e-9))
            if windy:
                h = min(h, AIR_STEP * pace, AIR_WAY * size / (speed + 1e-12))
        if moving or shaking:
            h = min(h, max(unloading, AIR_STEP * pace))
        for k in range(6):
            old[k] = q[k]
        # to the middle of the step
        for k in range(3):
            q[k] += 0.5 * h * q[3 + k]
            velocity[k] = q[3 + k] + 0.5 * h * accel[k]
            going[k] = q[3 + k]
        if shaking:
            angle = dial[parameters.SHAKE_RATE] * (t + 0.5 * h) + dial[parameters.SHAKE_PHASE]
            lift = dial[parameters.SHAKE] * np.sin(angle)
            heave = dial[parameters.SHAKE] * dial[parameters.SHAKE_RATE] * np.cos(angle)
        if shaking or moving:
            shift += 0.5 * h * drift
            lay_ground(base, pivot_x, pivot_y, tilt, shift, yielding, lift, points)
        ax = ay = alpha = 0.0
        if is_open or gap < 2.0 * h * speed + gravity * h * h + 0.01 * rounding:
            low, high, gap = find(
                q[0], q[1], q[2], corners, rounding, group, reach, points, ridges, patch, found
            )
            late = 4.0 * h * speed + 1e-6 * size
            on = settle(low, high, fixed, q[2], late, zone, found, memory, dial)
            if on > 0 and not is_open:
                is_open = True
                impact = min(impact + 1, factors.shape[0] - 1)
                for z in range(soil.shape[0]):
                    for k in range(5):
                        soil[z, k] = laws[z, k] * factors[impact, k]
                    soil[z, K_UL] = max(
                        soil[z, K_L], laws[z, K_UL] * factors[impact, K_L] * factors[impact, K_UL]
                    )
                if tilts[impact] != 0.0:
                    tilt = tilts[impact]
                    pivot_x, pivot_y = _foot_of_first(low, high, fixed, found, q)
                    lay_ground(base, pivot_x, pivot_y, tilt, shift, yielding, lift, points)
                loading, unloading, floating = steps_s(soil, body, dial)
                last = 0.0
            if on > 0:
                add_up(
                    low, high, fixed, q[0], q[1], velocity, going, 0.5 * (h + last), drift, heave, yielding, soil,
                    indentation, dial, found, memory, sums,
                )  # fmt: skip
                ax, ay, alpha = sums[FX] / mass, sums[FY] / mass, sums[MOMENT] / inertia
                last = h
            elif is_open:
                is_open, last = False, 0.0
                if impact == 0 and dial[parameters.SHEDS] > 0.0:
                    mass *= 1.0 - dial[parameters.SHEDS]
                    inertia *= 1.0 - dial[parameters.SHEDS]
                    body[MASS], body[INERTIA] = mass, inertia
                    for k in range(3):
                        q[3 + k] /= 1.0 - dial[parameters.SHEDS]
                    loading, unloading, floating = steps_s(soil, body, dial)
                _lift_off(q, reach, impact, sums, shares, dial)
                drift = 0.0 if dial[parameters.RECOIL_SPRING] == 0.0 else drift
                if tilt != 0.0:
                    tilt = 0.0
                    lay_ground(base, pivot_x, pivot_y, tilt, shift, yielding, lift, points)
                sums[EMBANKMENT] = 0.0
        if windy:
            bx, by, beta = air(q[0], q[1], velocity[0], velocity[1], velocity[2], gap, dial)
            ax, ay, alpha = ax + bx, ay + by, alpha + beta
        ay -= gravity
        accel[0], accel[1], accel[2] = ax, ay, alpha
        if recoils:
            drift = _recoil(drift, shift, sums[EMBANKMENT] if is_open else 0.0, h, dial)
            shift += 0.5 * h * drift
        for k in range(3):
            q[3 + k] += h * accel[k]
            q[k] += 0.5 * h * q[3 + k]
        done = film_to(done, t, t + h, old, q, 0.0 if is_open or windy else gravity, body, times, poses)
        t += h
        # at rest?
        away = max(abs(q[0] - start[0]), abs(q[1] - start[1])) > STILL * size or abs(q[2] - start[2]) > STILL
        if away or impact < 0:
            calm_from = t
            for k in range(3):
                start[k] = q[k]
        elif t - calm_from > CALM * pace:
            break
    film_to(done, t, np.inf, q, q, 0.0, body, times, poses)


@numba.njit
def _foot_of_first(low: int, high: int, fixed: int, found: Array, q: Array) -> tuple[float, float]:
    """Where the block touches: the deepest contact's point in m."""
    deepest, x, y = -1e9, q[0], q[1]
    for i in range(fixed + high - low):
        j = i if i < fixed else low + i - fixed
        if found[j, DEPTH] > deepest:
            deepest, x, y = found[j, DEPTH], found[j, PX], found[j, PY]
    return x, y


@numba.njit
def _lift_off(q: Array, reach: float, impact: int, sums: Array, shares: Array, dial: Array) -> None:
    """What happens to the velocity when an impact ends."""
    if dial[parameters.KICK] > 0.0:
        kick = dial[parameters.KICK] * abs(q[5]) * reach
        q[3] += kick * sums[OUT_X]
        q[4] += kick * sums[OUT_Y]
    if dial[parameters.LEAVES] > 0.0:
        q[3] *= 1.0 - shares[impact]


@numba.njit
def _recoil(drift: float, shift: float, force: float, h: float, dial: Array) -> float:
    """The embankment's velocity in m/s after a step under a horizontal `force` in N on it."""
    push = force / dial[parameters.RECOIL_MASS] - dial[parameters.RECOIL_SPRING] * shift
    drift = (drift + h * push) / (1.0 + h * dial[parameters.RECOIL_DASHPOT])
    grip = h * dial[parameters.RECOIL_GRIP]
    return np.sign(drift) * max(0.0, abs(drift) - grip)
