"""Incident states: drawn from the distributions of a scenario, or fitted to the first frames of a film.

States are drawn for groups of `DRAW_GROUP` releases. Each group of a block has its own random stream and is drawn
completely, so release i of a block does not depend on the number of releases or of processes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from rock2d.arrays import Array
from rock2d.files.experiment import seen_frames
from rock2d.records.columns import POSE_NAMES
from rock2d.runs.acting_effects import true_film
from rock2d.scene.blocks import Block
from rock2d.scene.cross_section import CrossSection

if TYPE_CHECKING:
    from rock2d.files.scenario import Scenario
    from rock2d.files.scenario_keys import Incident

DRAW_GROUP = 1000  # releases that are drawn together
CHECKED_TOGETHER = 100 * DRAW_GROUP
# purposes of random streams: first number of the spawn key
STATE_STREAM, SEED_STREAM, NOISE_STREAM, SCATTER_STREAM, ROUGHNESS_STREAM = range(5)
CLEARANCE_SIGMA = 3.0  # a frame counts as flight if the block is clear of the ground by this many sigma
FEWEST_FRAMES = 3  # fewest frames to which a state is fitted
OUTLIER_SIGMA = 5.0  # a frame so far from the fitted flight ends the flight


@dataclass(frozen=True)
class IncidentState:
    """Incident state of one release: its number, block, time in s, state (6,) in SI, seed of its random stream, and
    number of frames to which the state was fitted (0: drawn)."""

    release: int
    block: str
    t_s: float
    state: Array
    seed: int
    frames: int = 0


def drawn_states(incident: Incident, seed: int, block: int, first: int, stop: int) -> Array:
    """(stop - first, 6) states of releases first .. stop - 1 of the block with index `block`; first < stop.

    Raises ValueError for measured incident states."""
    return drawn_in_groups(lambda stream: incident.draw(stream, DRAW_GROUP), seed, STATE_STREAM, block, first, stop)


def drawn_seeds(seed: int, block: int, first: int, stop: int) -> Array:
    """(stop - first,) uint64, seeds of the random streams of releases first .. stop - 1 of a block; first < stop."""

    def draw(stream: np.random.Generator) -> Array:
        return stream.integers(2**64, size=DRAW_GROUP, dtype=np.uint64)

    return drawn_in_groups(draw, seed, SEED_STREAM, block, first, stop)


def drawn_in_groups(
    draw: Callable[[np.random.Generator], Array], seed: int, stream: int, block: int, first: int, stop: int
) -> Array:
    """Draws of releases first .. stop - 1 of a block; `draw` returns an array for DRAW_GROUP releases."""
    groups = range(first // DRAW_GROUP, (stop - 1) // DRAW_GROUP + 1)
    keys = [np.random.SeedSequence(seed, spawn_key=(stream, block, group)) for group in groups]
    drawn = np.concatenate([draw(np.random.default_rng(key)) for key in keys])
    return drawn[first - groups.start * DRAW_GROUP :][: stop - first]


def measured_states(scenario: Scenario, seed: int, releases: int | None = None) -> list[IncidentState]:
    """Incident states of the first `releases` filmed releases of each block, fitted to their first frames."""
    experiment = true_film(scenario)
    source = scenario.incident["default"].from_experiment
    assert source is not None
    blocks, cross_section = scenario.make_blocks(), scenario.make_cross_section()
    rows = seen_frames(experiment)
    out, counts = [], dict.fromkeys(blocks, 0)
    films = rows["release"].nunique()
    seeds = {name: drawn_seeds(seed, b, 0, films + 1) for b, name in enumerate(blocks)}
    for release, film in rows.groupby("release", sort=True):
        name = str(film["block"].iloc[0])
        if counts[name] >= (releases or scenario.releases) or len(film) < FEWEST_FRAMES:
            continue
        own_seed = int(seeds[name][counts[name]])
        counts[name] += 1
        frames = film[["t_s", *POSE_NAMES]].to_numpy(float)[: source.frames]
        sigma = (experiment.position_noise_m, experiment.angle_noise_rad)
        state, used = fit_first_flight(frames, blocks[name], cross_section, experiment.gravity_m_s2, sigma)
        out.append(IncidentState(int(str(release)), name, float(frames[0, 0]), state, own_seed, used))
    return out


def fit_first_flight(
    frames: Array, block: Block, cross_section: CrossSection, gravity_m_s2: float, sigma: tuple[float, float]
) -> tuple[Array, int]:
    """State (6,) at the first of `frames` (n, 4: t, x, y, theta) and the number of frames that were used.

    Least-squares fit of a free flight, x + v t - g t²/2 and θ + ω t, to the first frames in which the block is clear of
    the ground and which lie on that flight (within OUTLIER_SIGMA times `sigma`: position in m, angle in rad). If the
    film starts on the ground, the first three frames are used."""
    t = frames[:, 0] - frames[0, 0]
    q = frames[:, 1:].copy()
    q[:, 2] = np.unwrap(q[:, 2])
    flat = q.copy()
    flat[:, 1] += 0.5 * gravity_m_s2 * t**2
    noise = np.maximum([sigma[0], sigma[0], sigma[1]], 1e-9)
    count = FEWEST_FRAMES
    while count < len(t) and _clear(q[count], block, cross_section, CLEARANCE_SIGMA * noise[0]):
        guess, covariance = _line(t[:count], flat[:count])
        ahead = np.array([1.0, t[count]])
        spread = np.sqrt(1 + ahead @ covariance @ ahead)
        miss = flat[count] - guess[0] - guess[1] * t[count]
        if (np.abs(miss) > OUTLIER_SIGMA * noise * spread).any():
            break
        count += 1
    fit, _ = _line(t[:count], flat[:count])
    return fit.reshape(-1), count


def _line(t: Array, values: Array) -> tuple[Array, Array]:
    """Least-squares (2, k) intercepts and slopes, and their (2, 2) covariance for unit noise."""
    design = np.column_stack([np.ones_like(t), t])
    covariance = np.linalg.inv(design.T @ design)
    return covariance @ design.T @ values, covariance


def _clear(pose: Array, block: Block, cross_section: CrossSection, margin_m: float) -> bool:
    import shapely

    c, s = np.cos(pose[2]), np.sin(pose[2])
    outline = block.outline() @ np.array([[c, s], [-s, c]]) + pose[:2]
    return bool(shapely.Polygon(outline).distance(shapely.LineString(cross_section.points_m)) > margin_m)
