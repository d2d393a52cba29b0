"""Rejection of frames in which something other than the block was fitted: jumps, and fits to the background."""

from itertools import pairwise

import numpy as np

from rock2d.arrays import Array
from rock2d_tracking.sights import FollowedRelease, Sight, flights_of

COMPARED_FRAMES = 4  # frames on each side with which a frame is compared
JUMP_SIGMAS = 6.0  # largest distance of a frame from the parabola through its neighbours
SMALLEST_JUMP_PX, SMALLEST_JUMP_RAD = 0.75, 0.05  # a smaller distance is never a jump
LEAST_COVERED = 0.5  # share of a frame's outline that differs from the background, over the usual share
FLIGHT_ENDS = 5  # frames at the end of a flight from which it is extrapolated
FEWEST_BOUNCE_FRAMES = 4  # of a flight before or after a bounce
LONGEST_EXTRAPOLATION = 6  # frames over which a flight is extrapolated to the next one
# largest distance of two flights that meet: px, radii, steps
APART_PX, APART_RADII, APART_STEPS = 3.0, 0.5, 0.3


def reject_gross_errors(release: FollowedRelease, g_px_frame2: float) -> None:
    """Reject frames of a release that lie on the background or jump out of its motion."""
    _reject_background(release.seen)
    _reject_frames(release.seen, g_px_frame2)
    _reject_flights(release, g_px_frame2)
    _reject_frames(release.seen, g_px_frame2)  # the neighbours of rejected flights


def _reject_background(seen: list[Sight]) -> None:
    """Reject frames whose outline contains much more background than usual."""
    covered = np.array([s.covered for s in seen])
    if not np.isfinite(covered).any():
        return
    least = LEAST_COVERED * float(np.nanmedian(covered))
    for sight in seen:
        if sight.covered < least:
            sight.reject("on the background")


def _reject_frames(seen: list[Sight], g_px_frame2: float) -> None:
    """Reject frames far from the parabola through their neighbours."""
    if len(seen) < 2 * COMPARED_FRAMES + 1:
        return
    t = np.array([s.when for s in seen])
    pose = np.array([s.pose for s in seen])
    # without the fall, so that a line can be compared with few frames
    pose[:, 1] -= 0.5 * g_px_frame2 * (t - t[0]) ** 2
    odd = []
    for i in range(len(seen)):
        near = [k for k in range(max(0, i - COMPARED_FRAMES), min(len(seen), i + COMPARED_FRAMES + 1)) if k != i]
        before, after = [k for k in near if k < i], [k for k in near if k > i]
        # at an impact one side is enough
        misses = [_relative_misfit(t, pose, i, side) for side in (before, after, near) if len(side) >= 3]
        if misses and min(misses) > 1.0:
            odd.append(i)
    for i in odd:
        seen[i].reject("jumps")


def _relative_misfit(t: Array, pose: Array, i: int, side: list[int]) -> float:
    """Distance of a frame from the curve through some of its neighbours, over the largest allowed distance."""
    degree = 2 if len(side) > 4 else 1
    basis = np.vander(t[side] - t[i], degree + 1)
    fitted, *_ = np.linalg.lstsq(basis, pose[side], rcond=None)
    left = pose[side] - basis @ fitted
    sigma = np.sqrt((left**2).sum(axis=0) / max(len(side) - degree - 1, 1))
    off = np.abs(pose[i] - fitted[-1])
    return float((off / np.maximum(JUMP_SIGMAS * sigma, [SMALLEST_JUMP_PX, SMALLEST_JUMP_PX, SMALLEST_JUMP_RAD])).max())


def _reject_flights(release: FollowedRelease, g_px_frame2: float) -> None:
    """Reject flights that do not begin where the previous flight ends, because an impact does not displace a block. The
    longest flight is taken as right."""
    seen = release.seen
    flights = [[seen[i] for i in own] for own in flights_of(seen, g_px_frame2)]
    if len(flights) < 2:
        return
    longest = int(np.argmax([len(own) for own in flights]))
    for order in (flights[longest:], flights[longest::-1]):
        known = order[0]
        for own in order[1:]:
            if _meet(known, own, g_px_frame2, release.radius_px):
                known = own
                continue
            for sight in own:
                sight.reject("jumps")
    _reject_between(seen, flights, g_px_frame2)


def _reject_between(seen: list[Sight], flights: list[list[Sight]], g_px_frame2: float) -> None:
    """Reject frames between flights that are nearer to a rejected flight than to an accepted one."""
    inside = {s.when for own in flights for s in own}
    ends = np.array([[own[0].when, own[-1].when] for own in flights])
    for sight in seen:
        if sight.when in inside or sight.reason:
            continue
        beside = np.argsort(np.abs(ends - sight.when).min(axis=1))[:2].tolist()
        away = []
        for k in beside:
            own = flights[k][-FLIGHT_ENDS:] if ends[k, 1] < sight.when else flights[k][:FLIGHT_ENDS]
            place = _extrapolated(own, np.array([sight.when]), g_px_frame2)[0]
            away.append(float(np.hypot(*(sight.pose[:2] - place))))
        if flights[beside[int(np.argmin(away))]][0].reason:
            sight.reject("jumps")


def _meet(one: list[Sight], other: list[Sight], g_px_frame2: float, radius_px: float) -> bool:
    """Whether two flights, extrapolated toward each other, meet; True if this is unknown."""
    before, after = (one, other) if one[0].when < other[0].when else (other, one)
    if after[0].when - before[-1].when > LONGEST_EXTRAPOLATION or min(len(before), len(after)) < 2:
        return True
    paths = _between(before, after, g_px_frame2)
    step = max(float(np.hypot(*np.diff(path[:5:4], axis=0).T).max()) for path in paths)
    allowed = max(APART_PX, APART_RADII * radius_px) + APART_STEPS * step
    return bool(np.hypot(*(paths[0] - paths[1]).T).min() < allowed)


def bounces_of(seen: list[Sight], g_px_frame2: float) -> list[Array]:
    """Places (2,) at which a block bounces, from the flights before and after."""
    flights = [[seen[i] for i in own] for own in flights_of(seen, g_px_frame2)]
    found = []
    for before, after in pairwise(own for own in flights if len(own) >= FEWEST_BOUNCE_FRAMES):
        if after[0].when - before[-1].when > LONGEST_EXTRAPOLATION:
            continue
        coming, going = _between(before, after, g_px_frame2)
        if coming[-1, 1] > coming[-2, 1] and going[1, 1] < going[0, 1]:
            at = int(np.hypot(*(coming - going).T).argmin())
            found.append(0.5 * (coming[at] + going[at]))
    return found


def _between(before: list[Sight], after: list[Sight], g_px_frame2: float) -> list[Array]:
    """Places (n, 2) of two flights, extrapolated to the instants between them, four per frame."""
    gap = after[0].when - before[-1].when
    when = np.linspace(before[-1].when, after[0].when, 4 * int(np.ceil(gap)) + 1)
    return [_extrapolated(own, when, g_px_frame2) for own in (before[-FLIGHT_ENDS:], after[:FLIGHT_ENDS])]


def _extrapolated(sights: list[Sight], when: Array, g_px_frame2: float) -> Array:
    """(n, 2) places at the instants `when` (n,), on the parabola with gravity through some sights."""
    t = np.array([s.when for s in sights])
    bend = np.array([0.0, 0.5 * g_px_frame2])
    places = np.array([s.pose[:2] for s in sights]) - (t - t[0])[:, None] ** 2 * bend
    line = np.linalg.lstsq(np.vander(t - t[0], 2), places, rcond=None)[0]
    return np.asarray(np.vander(when - t[0], 2) @ line + (when - t[0])[:, None] ** 2 * bend)
