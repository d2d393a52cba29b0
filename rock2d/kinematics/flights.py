"""Filmed releases as flights, contacts and rests, with the noise of the film estimated from the flights themselves."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

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
from rock2d.files.experiment import Experiment
from rock2d.kinematics.segmentation import CONTACT, FLIGHT, LOOSE, REST, SPIN_LOOSE, partition
from rock2d.scene.world import World

Array = np.ndarray

SHORTEST = 8  # frames of a flight
WINDOW = 12  # frames over which the noise is first looked at
CLEAR = 0.1  # block radii that a flight must rise above the ground to be one
JUMP = 0.1  # of √(g × size): a smaller change of velocity above the ground is no impact
TRIM = 2  # frames left out next to a contact
LAGS = 6  # frames over which noise is taken to be correlated


@dataclass
class Film:
    """Frames of all releases, one after another.

    Attributes
    ----------
    t_s : (frames,) instants
    pose : (frames, 3) x_m, y_m, theta_rad (unwrapped) as recorded
    release, block : (frames,) index into `release_names` and `block_names`
    release_names : numbers of the releases, ascending (the order filmed)
    release_block : (releases,) block of each
    noise : (3,) 1 sigma of a frame, white part; `long_noise` (3,) the same for averages over many frames, which
        correlated noise makes larger
    """

    t_s: Array
    pose: Array
    release: Array
    release_names: Array
    release_block: Array
    block_names: list[str]
    stated_noise: Array
    noise: Array
    long_noise: Array


@dataclass
class Flights:
    """All flights in the order of time: (n,) arrays; frames `first` to `last` - 1 of the film, ends trimmed."""

    release: Array
    block: Array
    first: Array
    last: Array
    follows: Array  # index of the flight before it in the same release, -1 if it is the first

    def __len__(self) -> int:
        return len(self.release)


@dataclass
class Cut:
    """A film, its flights, and the kind of each frame (CONTACT, FLIGHT, REST)."""

    film: Film
    flights: Flights
    kinds: Array


def load_film(experiment: Experiment) -> Film:
    """Frames of an experiment with trajectories; lost frames are left out, angles unwrapped."""
    table = experiment.trajectories
    assert table is not None
    table = table.dropna().sort_values(["release", "t_s"], kind="stable")
    names, release = np.unique(table["release"].to_numpy(), return_inverse=True)
    block_names = list(experiment.blocks)
    starts = np.searchsorted(release, np.arange(len(names)))
    blocks = table["block"].map({name: i for i, name in enumerate(block_names)}).to_numpy()
    pose = table[["x_m", "y_m", "theta_rad"]].to_numpy(float).copy()
    for a, b in zip(starts, np.append(starts[1:], len(release)), strict=True):
        pose[a:b, 2] = np.unwrap(pose[a:b, 2])
    stated = np.array([experiment.position_noise_m, experiment.position_noise_m, experiment.angle_noise_rad])
    film = Film(
        table["t_s"].to_numpy(float),
        pose,
        release,
        names,
        blocks[starts],
        block_names,
        stated,
        stated,
        stated,
    )
    film.noise = film.long_noise = _first_noise(film)
    return film


def _first_noise(film: Film) -> Array:
    """Noise from the residuals of parabolas over short windows; contact spoils few of them."""
    n = len(film.t_s) // WINDOW * WINDOW
    if n < 4 * WINDOW:
        return np.maximum(film.stated_noise, 1e-6)
    windows = film.pose[:n].reshape(-1, WINDOW, 3)
    t = film.t_s[:n].reshape(-1, WINDOW)
    release = film.release[:n].reshape(-1, WINDOW)
    even = np.ptp(t, axis=1) < 1.5 * (WINDOW - 1) * np.median(np.diff(film.t_s)[np.diff(film.release) == 0])
    windows = windows[even & (release[:, 0] == release[:, -1])]
    if len(windows) < 4:
        return np.maximum(film.stated_noise, 1e-6)
    basis = np.linalg.qr(np.vander(np.linspace(-1, 1, WINDOW), 3))[0]
    residual = windows - np.einsum("fk,gk,wgc->wfc", basis, basis, windows)
    variance = (residual**2).sum(axis=1) / (WINDOW - 3)
    return np.maximum(np.sqrt(np.median(variance, axis=0)), 1e-9)


def cut_film(world: World, film: Film) -> Cut:
    """Cut every release into flights, contacts and rests in a world, and estimate the noise from the flights."""
    blocks = list(world.blocks.values())
    arrays = [block_arrays(b) for b in blocks]
    ground = ground_arrays(world.cross_section, 10 * max(b.radius_m for b in blocks))
    g = max(world.gravity_m_s2, 1e-3)
    kinds = np.zeros(len(film.t_s), np.int64)
    found: list[tuple[int, int, int, int, int]] = []
    starts = np.searchsorted(film.release, np.arange(len(film.release_names) + 1))
    for r, (a, b) in enumerate(itertools.pairwise(starts)):
        block = int(film.release_block[r])
        size, t, pose = blocks[block].radius_m, film.t_s[a:b], world.view.true(film.pose[a:b])
        lengths = world.view.true_per_recorded(pose.mean(axis=0)[None], np.eye(2))
        noise = film.noise * np.append(lengths, 1.0)
        curvature = np.array([0.0, -0.5 * g, 0.0]) / noise
        loose = 0.5 * np.array([LOOSE * g, LOOSE * g, SPIN_LOOSE * g / size]) / noise
        kind, number = partition(t - t[0], (pose - pose[0]) / noise, curvature, loose, SHORTEST)
        gap = clearances(arrays[block], ground, pose)
        stretches = _true_flights(kind, number, t, pose, gap, size, g, noise)
        kinds[a:b] = np.where(kind == REST, REST, CONTACT)
        before = -1
        for i, j in stretches:
            kinds[a + i : a + j] = FLIGHT
            # what still touches its indentation is not free, though nothing may press on it
            free = np.flatnonzero(gap[i:j] > 2.0 * noise[1])
            cut_in = max(TRIM, int(free[0]) if len(free) else 0) if i > 0 else 0
            cut_out = max(TRIM, j - i - 1 - int(free[-1]) if len(free) else 0) if j < b - a else 0
            while j - i - cut_in - cut_out < SHORTEST:
                cut_in, cut_out = max(cut_in - 1, 0), max(cut_out - 1, 0)
            found.append((r, block, a + i + cut_in, a + j - cut_out, before))
            before = len(found) - 1
    columns = np.array(found, np.int64).reshape(-1, 5).T
    cut = Cut(film, Flights(*columns), kinds)
    if len(found):
        film.noise, film.long_noise = _flight_noise(film, cut.flights)
    return cut


def _true_flights(
    kind: Array, number: Array, t: Array, pose: Array, gap: Array, size: float, g: float, noise: Array
) -> list[tuple[int, int]]:
    """Stretches (first, last) of frames that are flights: mended where one was cut in mid-air, and only those that rise
    above the ground: a hop within the indentation is still contact. Where the ground lies higher than stated, blocks
    do not come down to it: then it is their lower end that flights rise above."""
    flights = []
    for k in np.unique(number[kind == FLIGHT]):
        frames = np.flatnonzero(number == k)
        flights.append((int(frames[0]), int(frames[-1]) + 1))
    mended: list[tuple[int, int]] = []
    for i, j in flights:
        if mended:
            h, m = mended[-1]
            aloft = gap[max(m - 2, h) : i + 2].min() > max(0.15 * size, 5 * noise[0])
            if i - m <= 2 and aloft and _jump(t, pose, (h, m), (i, j)) < JUMP * np.sqrt(g * size):
                mended[-1] = (h, j)
                continue
        mended.append((i, j))
    rises = max(CLEAR * size, 5.0 * noise[1])
    whole = (0, len(gap))
    ground = [0.0 if ends == whole else max(min(gap[ends[0]], gap[ends[1] - 1]), 0.0) for ends in mended]
    return [
        (i, j)
        for (i, j), low in zip(mended, ground, strict=True)
        if np.quantile(gap[i:j], 0.75) > low + rises
    ]


def _jump(t: Array, pose: Array, before: tuple[int, int], after: tuple[int, int]) -> float:
    """Change of velocity in m/s between two stretches where they meet."""
    velocity = []
    for (i, j), at in ((before, t[before[1] - 1]), (after, t[after[0]])):
        fit = np.polynomial.polynomial.polyfit(t[i:j] - at, pose[i:j, :2], 2)
        velocity.append(fit[1])
    return float(np.hypot(*(velocity[1] - velocity[0])))


def _flight_noise(film: Film, flights: Flights) -> tuple[Array, Array]:
    """Noise of a frame, and that of long averages, from what cubics leave of the flights."""
    lagged, pairs, freedom, used = np.zeros((LAGS + 1, 3)), np.zeros(LAGS + 1), 0.0, 0
    for a, b in zip(flights.first, flights.last, strict=True):
        n = b - a
        if n < 2 * LAGS:
            continue
        t = film.t_s[a:b]
        basis = np.linalg.qr(np.vander((t - t[0]) / (t[-1] - t[0]) - 0.5, 4))[0]
        r = film.pose[a:b] - basis @ (basis.T @ film.pose[a:b])
        for k in range(LAGS + 1):
            lagged[k] += (r[k:] * r[: n - k]).sum(axis=0)
            pairs[k] += n - k
        freedom += n - 4
        used += 1
    if freedom < 50:
        return film.noise, film.noise
    variance = lagged[0] / freedom
    # of white noise, too, four parameters leave a little negative correlation
    correlation = lagged[1:] / pairs[1:, None] / variance + 4.0 * used / (freedom + 4.0 * used)
    sigma = np.sqrt(variance)
    return sigma, sigma * np.sqrt(np.maximum(1.0 + 2.0 * correlation.sum(axis=0), 1.0))


def clearances(block, ground, pose: Array) -> Array:
    """(n,) height in m of a block at poses (n, 3) above the ground, negative where it is in it."""
    return _clearances(block, ground, np.ascontiguousarray(pose))


@njit
def _clearances(block, ground, pose):
    out = np.empty(pose.shape[0])
    for i in range(pose.shape[0]):
        out[i] = _clearance(block, ground, pose[i, 0], pose[i, 1], pose[i, 2])
    return out


@kernel
def _clearance(block, ground, x, y, theta):
    """Height of one pose above the ground."""
    sides, facets = block.sides, ground.facets
    f0, f1 = facet_range(ground, x - 3.0 * block.radius, x + 3.0 * block.radius)
    if sides.shape[0] == 0:
        depth, _, _ = point_depth(x, y, facets, f0, f1)
        return -depth - block.semi_a
    c, s = np.cos(theta), np.sin(theta)
    gap = np.inf
    for k in range(sides.shape[0]):
        px, py = x + c * sides[k, 0] - s * sides[k, 1], y + s * sides[k, 0] + c * sides[k, 1]
        depth, _, _ = point_depth(px, py, facets, f0, f1)
        gap = min(gap, -depth)
    for v in range(max(f0, 1), f1):
        if facets[v, CONVEX] > 0.0:
            depth, _ = polygon_depth(facets[v, POINT_X], facets[v, POINT_Y], x, y, c, s, sides)
            gap = min(gap, -depth)
    return gap
