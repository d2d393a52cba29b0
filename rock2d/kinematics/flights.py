"""A film as arrays, its segmentation into flights, contacts and rests, and its noise, measured in the flights."""

import itertools
from dataclasses import dataclass, fields
from functools import cached_property
from typing import NamedTuple, Self

import numpy as np

from rock2d.arrays import Array
from rock2d.compiled import kernel, njit
from rock2d.engines.geometry import (
    CONVEX,
    POINT_X,
    POINT_Y,
    block_arrays,
    facet_range,
    ground_arrays,
    point_depth,
    polygon_depth,
)
from rock2d.files.experiment import Experiment, seen_frames
from rock2d.kinematics.partition import ACCELERATION_SD, FLIGHT, SPIN_ACCELERATION_SD, partition
from rock2d.records.columns import THETA, X, Y
from rock2d.scene.world import World

FEWEST_FLIGHT_FRAMES = 8
RESIDUAL_DEGREES = 5  # polynomial degrees 2 to 6 of the residuals of a flight
FRAMES_PER_DEGREE = 6  # a short flight has fewer degrees
NOISE_WINDOW_FRAMES = 12  # for the first estimate of the noise
FLIGHT_RISE_RADII = 0.1  # block radii that a flight must rise above the ground
IMPACT_VELOCITY_CHANGE = 0.1  # in √(g × size): a smaller change of velocity above the ground is no impact
IMPACT_SIGMAS = 5.0  # ... nor is one of fewer standard errors
# 1 sigma of the apparent acceleration by air, lens and perspective, in units of gravity
SMOOTH_ACCELERATION_SD = 0.5
SMOOTH_DEGREE = 4  # degree of a curve without an impact
CONTACT_MARGIN_FRAMES = 2  # frames next to a contact that do not count as flight
SMALLEST_NOISE = 1.0e-9  # for positions in m and angles in rad, in films without noise
NOISE_LAGS = 6  # frames over which the noise may be correlated
LARGEST_VARIANCE = 9.0  # variance of a flight, over the median of all, up to which it counts in the noise


@dataclass
class Film:
    """Frames of all releases, one after another.

    Attributes
    ----------
    t_s : (frames,) instants
    pose : (frames, 3) x_m, y_m, theta_rad (unwrapped) as recorded
    release : (frames,) index into `release_names`
    release_names : numbers of the releases, ascending, in the order of filming
    release_block : (releases,) index of the block of each release in `block_names`
    angle_known : (releases,) whether the angle was measured; the angle of a circle without marks is constant
    stated_noise : (3,) noise of the experiment, 1 sigma
    noise : (3,) 1 sigma of a frame; `long_noise` (3,) the same for averages over many frames, which is larger if the
        noise is correlated
    smear_offset_s : offset of a block over its speed that all frames share, 1 sigma"""

    t_s: Array
    pose: Array
    release: Array
    release_names: Array
    release_block: Array
    block_names: list[str]
    angle_known: Array
    stated_noise: Array
    noise: Array
    long_noise: Array
    smear_offset_s: float = 0.0

    @property
    def blocks_without_angle(self) -> list[str]:
        """Blocks whose angle was not measured in some release."""
        return [self.block_names[b] for b in np.unique(self.release_block[~self.angle_known])]

    @cached_property
    def measured(self) -> Array:
        """(3,) whether x, y and theta were measured, that is change at all."""
        return np.asarray(np.ptp(self.pose, axis=0) > 0.0)


@dataclass
class Flights:
    """n flights in the order of time, with orthonormal polynomials on the frames of each, the same in every world.

    Attributes
    ----------
    release, block : (n,) index of release and block
    first, last : (n,) a flight has the frames `first` to `last` - 1 of the film, without those next to a contact
    follows : (n,) index of the flight before it in the same release, -1 if it is the first
    middle : (n,) mean instant, in s as recorded
    slope : (n,) slope of the polynomial of degree 1, per s
    values : (m, 2 + RESIDUAL_DEGREES) polynomials of degree 0, 1, 2 ... on `frames`; 0 beyond the `degrees` of a flight
    """

    release: Array
    block: Array
    first: Array
    last: Array
    follows: Array
    middle: Array
    slope: Array
    values: Array

    @classmethod
    def of(cls, film: Film, first: Array, last: Array, follows: Array) -> Self:
        """The flights of a film with these frames (n,) and `follows` (n,)."""
        release, lengths = film.release[first], last - first
        middle, slope = np.empty(len(lengths)), np.empty(len(lengths))
        flights = cls(
            release, film.release_block[release], first, last, follows, middle, slope,
            np.zeros((lengths.sum(), 2 + RESIDUAL_DEGREES)),
        )  # fmt: skip
        for i, (a, b) in enumerate(itertools.pairwise(flights.start)):
            t, degrees = film.t_s[first[i] : last[i]], 2 + flights.degrees[i]
            middle[i] = t.mean()
            span = np.ptp(t)
            polynomials, r = np.linalg.qr(np.vander((t - middle[i]) / span, degrees, increasing=True))
            flights.values[a:b, :degrees] = polynomials * np.sign(np.diag(r))
            slope[i] = 1.0 / (r[1, 1] * np.sign(r[1, 1]) * span)
        return flights

    def __len__(self) -> int:
        return len(self.release)

    def only(self, keep: Array) -> Self:
        """Some of the flights, given as a mask; `follows` keeps its numbers."""
        own = {f.name: getattr(self, f.name)[keep] for f in fields(self) if f.name != "values"}
        return type(self)(**own, values=self.values[np.repeat(keep, self.last - self.first)])

    @cached_property
    def frames(self) -> Array:
        """(m,) frames of all flights, one flight after the other."""
        every = (np.arange(a, b) for a, b in zip(self.first, self.last, strict=True))
        return np.concatenate([np.empty(0, np.int64), *every])

    @cached_property
    def start(self) -> Array:
        """(n + 1,) index in `frames` at which each flight begins."""
        return np.concatenate([[0], np.cumsum(self.last - self.first)])

    @cached_property
    def level(self) -> Array:
        """(n,) value of the polynomial of degree 0."""
        return np.asarray(1.0 / np.sqrt(self.last - self.first))

    @cached_property
    def degrees(self) -> Array:
        """(n,) number of degrees beyond 1, fewer for a short flight."""
        return np.clip((self.last - self.first) // FRAMES_PER_DEGREE, 1, RESIDUAL_DEGREES)


def load_film(experiment: Experiment) -> Film:
    """Frames of an experiment with trajectories. Lost frames are left out, angles are unwrapped.

    Raises InputError if every frame is lost."""
    table = seen_frames(experiment, corners=True).sort_values(["release", "t_s"], kind="stable")
    names, release = np.unique(table["release"].to_numpy(), return_inverse=True)
    block_names = list(experiment.blocks)
    starts = np.searchsorted(release, np.arange(len(names)))
    blocks = table["block"].map({name: i for i, name in enumerate(block_names)}).to_numpy()
    pose = table[["x_m", "y_m", "theta_rad"]].to_numpy(float).copy()
    round_ = np.array([block.shape == "circle" for block in experiment.blocks.values()])
    assert experiment.trajectories is not None
    measured = experiment.trajectories.groupby("release")["theta_rad"].count().reindex(names).to_numpy() > 0
    angle_known = np.ones(len(names), bool)
    for r, (a, b) in enumerate(itertools.pairwise(np.append(starts, len(release)))):
        pose[a:b, THETA] = np.unwrap(pose[a:b, THETA])
        angle_known[r] = measured[r] if not round_[blocks[a]] else np.ptp(pose[a:b, THETA]) > 0.0
    stated = np.array([experiment.position_noise_m, experiment.position_noise_m, experiment.angle_noise_rad])
    film = Film(
        table["t_s"].to_numpy(float), pose, release, names, blocks[starts], block_names, angle_known, stated, stated,
        stated, experiment.smear_offset_s,
    )  # fmt: skip
    film.noise = film.long_noise = _or_stated(film, _first_noise(film))
    return film


def _or_stated(film: Film, noise: Array) -> Array:
    """The estimated noise; the stated noise for quantities that were not measured."""
    return np.where(film.measured, noise, np.maximum(film.stated_noise, SMALLEST_NOISE))


def _first_noise(film: Film) -> Array:
    """Noise from the residuals of parabolas over short windows. The median ignores the few windows with contact."""
    n = len(film.t_s) // NOISE_WINDOW_FRAMES * NOISE_WINDOW_FRAMES
    if n < 4 * NOISE_WINDOW_FRAMES:
        return np.maximum(film.stated_noise, 1e-6)
    windows = film.pose[:n].reshape(-1, NOISE_WINDOW_FRAMES, 3)
    t = film.t_s[:n].reshape(-1, NOISE_WINDOW_FRAMES)
    release = film.release[:n].reshape(-1, NOISE_WINDOW_FRAMES)
    even = np.ptp(t, axis=1) < 1.5 * (NOISE_WINDOW_FRAMES - 1) * np.median(
        np.diff(film.t_s)[np.diff(film.release) == 0]
    )
    whole = even & (release[:, 0] == release[:, -1])
    windows, known = windows[whole], film.angle_known[release[whole, 0]]
    if len(windows) < 4:
        return np.maximum(film.stated_noise, 1e-6)
    own = t[whole] - t[whole].mean(axis=1, keepdims=True)
    basis = np.linalg.qr((own / np.ptp(own, axis=1, keepdims=True))[..., None] ** np.arange(3))[0]
    residual = windows - np.einsum("wfk,wgk,wgc->wfc", basis, basis, windows)
    variance = (residual**2).sum(axis=1) / (NOISE_WINDOW_FRAMES - 3)
    noise = np.maximum(np.sqrt(np.median(variance, axis=0)), SMALLEST_NOISE)
    if not known.all():
        angle = np.sqrt(np.median(variance[known, THETA])) if known.any() else film.stated_noise[THETA]
        noise[THETA] = max(float(angle), SMALLEST_NOISE)
    return noise


def find_flights(world: World, film: Film) -> Flights:
    """The flights of all releases in a world.

    Sets `film.noise` and `film.long_noise` to estimates from these flights."""
    blocks = list(world.blocks.values())
    arrays = [block_arrays(b) for b in blocks]
    ground = ground_arrays(world.cross_section)
    g = max(world.gravity_m_s2, 1e-3)
    found: list[tuple[int, int, int]] = []
    starts = np.searchsorted(film.release, np.arange(len(film.release_names) + 1))
    for r, (a, b) in enumerate(itertools.pairwise(starts)):
        block = int(film.release_block[r])
        size, t, pose = blocks[block].radius_m, film.t_s[a:b], world.view.true(film.pose[a:b])
        lengths = world.view.true_per_recorded(pose.mean(axis=0)[None], np.eye(2))
        noise = film.noise * np.append(lengths, 1.0)
        clearance = clearances(arrays[block], ground, pose)
        recording = _Recording(t, pose, clearance, noise, size, g)
        kind, number = _partition(recording)
        before = -1
        for i, j in _true_flights(recording, kind, number):
            first, last = _trimmed(recording, i, j)
            found.append((a + first, a + last, before))
            before = len(found) - 1
    flights = Flights.of(film, *np.array(found, np.int64).reshape(-1, 3).T)
    if len(found):
        film.noise, film.long_noise = (_or_stated(film, own) for own in flight_noise(film, flights))
    return flights


class _Recording(NamedTuple):
    """Frames of one release: instants (n,), true poses (n, 3), clearances in m (n,), noise (3,) in true
    units, size of the block and gravity."""

    t_s: Array
    pose: Array
    clearance_m: Array
    noise: Array
    size_m: float
    gravity_m_s2: float


def _partition(recording: _Recording) -> tuple[Array, Array]:
    """Kind (n,) and number of the segment (n,) of each frame; see `partition.partition`."""
    t, pose, _, noise, size, g = recording
    curvature = np.array([0.0, -0.5 * g, 0.0]) / noise
    spread = np.array([ACCELERATION_SD * g, ACCELERATION_SD * g, SPIN_ACCELERATION_SD * g / size])
    return partition(t - t[0], (pose - pose[0]) / noise, curvature, 0.5 * spread / noise, FEWEST_FLIGHT_FRAMES)


def _trimmed(recording: _Recording, i: int, j: int) -> tuple[int, int]:
    """First and last (exclusive) frame of the flight i to j without frames that may still be in contact, for example
    within the indentation."""
    clearance, noise = recording.clearance_m, recording.noise
    free = np.flatnonzero(clearance[i:j] > 2.0 * noise[Y])
    head = max(CONTACT_MARGIN_FRAMES, int(free[0]) if len(free) else 0) if i > 0 else 0
    tail = max(CONTACT_MARGIN_FRAMES, j - i - 1 - int(free[-1]) if len(free) else 0) if j < len(clearance) else 0
    while j - i - head - tail < FEWEST_FLIGHT_FRAMES:
        head, tail = max(head - 1, 0), max(tail - 1, 0)
    return i + head, j - tail


def _true_flights(recording: _Recording, kind: Array, number: Array) -> list[tuple[int, int]]:
    """Segments (first, last) of frames that are flights.

    Two parts of one flight that was divided in mid-air are joined, because drag, a lens or perspective deform the
    parabola. A segment counts as a flight only if it rises above the ground; hops within the indentation are contact.
    If the ground lies higher than stated, so that blocks do not come down to it, a flight must rise above its own lower
    end."""
    clearance, noise, size = recording.clearance_m, recording.noise, recording.size_m
    flights = []
    for k in np.unique(number[kind == FLIGHT]):
        frames = np.flatnonzero(number == k)
        flights.append((int(frames[0]), int(frames[-1]) + 1))
    joined: list[tuple[int, int]] = flights[:1]
    for (h, m), (i, j) in itertools.pairwise(flights):
        aloft = clearance[max(m - 2, h) : i + 2].min() > max(0.15 * size, 5 * noise[X])
        if i - m <= 2 and aloft and not _kinked(recording, (h, m), (i, j)):
            joined[-1] = (joined[-1][0], j)
        else:
            joined.append((i, j))
    rises = max(FLIGHT_RISE_RADII * size, 5.0 * noise[Y])
    whole = (0, len(clearance))
    ground = [0.0 if ends == whole else max(min(clearance[ends[0]], clearance[ends[1] - 1]), 0.0) for ends in joined]
    return [
        (i, j) for (i, j), low in zip(joined, ground, strict=True) if np.quantile(clearance[i:j], 0.75) > low + rises
    ]


def _kinked(recording: _Recording, before: tuple[int, int], after: tuple[int, int]) -> bool:
    """Whether the velocity jumps between two segments, by more than a smooth curve through both explains.

    The fitted curve is a polynomial with an acceleration near gravity, and a jump of velocity between the segments."""
    t, pose, _, noise, size, g = recording
    frames = np.concatenate([np.arange(*before), np.arange(*after)])
    own = t[frames] - 0.5 * (t[before[1] - 1] + t[after[0]])
    span = np.ptp(own)
    powers = np.arange(SMOOTH_DEGREE + 1)
    columns = np.column_stack([(own[:, None] / span) ** powers, np.maximum(own, 0.0)])
    # the same acceleration at one span from the meeting, by each of the powers from 2 on
    bends = powers[2:]
    prior = np.zeros((len(bends), columns.shape[1]))
    prior[bends - 2, bends] = bends * (bends - 1) / span**2 / (SMOOTH_ACCELERATION_SD * g)
    change, sigmas, squares = 0.0, 0.0, 0.0
    for axis, gravity in ((X, 0.0), (Y, g)):
        seen = pose[frames, axis] - pose[frames[0], axis] + 0.5 * gravity * own**2
        q, r = np.linalg.qr(np.vstack([columns / noise[axis], prior]))
        target = np.append(seen / noise[axis], np.zeros(len(bends)))
        found = q.T @ target
        change += (found[-1] / r[-1, -1]) ** 2
        sigmas += found[-1] ** 2
        squares += float(target @ target - found @ found)
    factor = max(squares / (2 * (len(frames) - columns.shape[1] + len(bends))), 1.0)
    return bool(change > IMPACT_VELOCITY_CHANGE**2 * g * size and sigmas > IMPACT_SIGMAS**2 * factor)


def flight_noise(film: Film, flights: Flights) -> tuple[Array, Array]:
    """(3,) noise of a frame, and of averages over many frames, from the residuals of cubics fitted to the flights whose
    quantity was measured; the noise of the film where these are too few. A flight that deviates far more than most, for
    example one that holds an impact, does not count."""
    long_enough = np.flatnonzero(flights.last - flights.first >= 2 * NOISE_LAGS)
    residuals = [_cubic_residuals(film, flights.first[f], flights.last[f]) for f in long_enough]
    variances = np.array([(r**2).sum(axis=0) / (len(r) - 4) for r in residuals]).reshape(-1, 3)
    measured = np.column_stack([np.ones((len(residuals), 2), bool), film.angle_known[flights.release[long_enough]]])
    typical = [
        np.median(own[known]) if known.any() else 0.0 for own, known in zip(variances.T, measured.T, strict=True)
    ]
    counted = measured & (variances <= LARGEST_VARIANCE * np.maximum(typical, SMALLEST_NOISE**2))
    lagged, pairs = np.zeros((NOISE_LAGS + 1, 3)), np.zeros((NOISE_LAGS + 1, 3))
    freedom, used = np.zeros(3), counted.sum(axis=0)
    for r, own in zip(residuals, counted, strict=True):
        n = len(r)
        for k in range(NOISE_LAGS + 1):
            lagged[k] += own * (r[k:] * r[: n - k]).sum(axis=0)
            pairs[k] += own * (n - k)
        freedom += own * (n - 4)
    enough, freedom, pairs = freedom >= 50, np.maximum(freedom, 1), np.maximum(pairs, 1)
    variance = np.maximum(lagged[0] / freedom, SMALLEST_NOISE**2)
    # four fitted parameters give even white noise a small negative correlation
    correlation = lagged[1:] / pairs[1:] / variance + 4.0 * used / (freedom + 4.0 * used)
    long_sigma = np.sqrt(variance) * np.sqrt(np.maximum(1.0 + 2.0 * correlation.sum(axis=0), 1.0))
    return np.where(enough, np.sqrt(variance), film.noise), np.where(enough, long_sigma, film.noise)


def _cubic_residuals(film: Film, first: int, last: int) -> Array:
    """(n, 3) residuals of a cubic through some frames."""
    t, pose = film.t_s[first:last], film.pose[first:last]
    basis = np.linalg.qr(np.vander((t - t[0]) / (t[-1] - t[0]) - 0.5, 4))[0]
    return np.asarray(pose - basis @ (basis.T @ pose))


def clearances(block, ground, pose: Array) -> Array:
    """(n,) clearance in m of a block at poses (n, 3), negative inside the ground."""
    return _clearances(block, ground, np.ascontiguousarray(pose))


def block_clearances(world: World, block: Array, pose: Array) -> Array:
    """(n,) clearances of blocks with the indices `block` (n,) in a world."""
    ground, out = ground_arrays(world.cross_section), np.empty(len(pose))
    for b, shape in enumerate(world.blocks.values()):
        out[block == b] = clearances(block_arrays(shape), ground, pose[block == b])
    return out


@njit
def _clearances(block, ground, pose):
    out = np.empty(pose.shape[0])
    for i in range(pose.shape[0]):
        out[i] = _clearance(block, ground, pose[i, 0], pose[i, 1], pose[i, 2])
    return out


@kernel
def _clearance(block, ground, x, y, theta):
    """Clearance in m at one pose."""
    sides, facets = block.sides, ground.facets
    f0, f1 = facet_range(ground, x - 3.0 * block.radius, x + 3.0 * block.radius)
    if sides.shape[0] == 0:
        depth, _, _ = point_depth(x, y, facets, f0, f1)
        return -depth - block.semi_a
    c, s = np.cos(theta), np.sin(theta)
    clearance = np.inf
    for k in range(sides.shape[0]):
        px, py = x + c * sides[k, 0] - s * sides[k, 1], y + s * sides[k, 0] + c * sides[k, 1]
        depth, _, _ = point_depth(px, py, facets, f0, f1)
        clearance = min(clearance, -depth)
    for v in range(max(f0, 1), f1):
        if facets[v, CONVEX] > 0.0:
            depth, _ = polygon_depth(facets[v, POINT_X], facets[v, POINT_Y], (x, y, c, s), sides)
            clearance = min(clearance, -depth)
    return clearance
