"""What every prediction must obey, for a film and the two predictions of it: by the base law, and as diagnosed."""

from collections.abc import Iterator, Mapping
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
from scipy import stats

from rock2d.files.experiment import Experiment
from tests.hunt.releases import depth_in_ground

Array = np.ndarray
Faults = Iterator[tuple[str, str]]  # cause and facts

KEYS = ["release", "block", "segment", "t_s"]
POSE = ["x_m", "y_m", "theta_rad"]
STILL_RADII, STILL_RAD = 0.02, 0.02  # a block that moves less in a tail is at rest there
FEWEST_TAIL_FRAMES = 6
SLOWING = 0.5  # way in the second half as a share of that in the first: a block that slows down moves less
LARGEST_DRIFT_RADII, LARGEST_TURN_RAD = 0.1, 0.1
LARGEST_TAIL = 2.0  # in units of the base law's tail
TAIL_PERCENTILE = 95.0
LEAST_CHANCE = 1e-4  # bounces are chaotic: of few segments one or two may be far off by either law
ONE_SIGMA = 1.0  # no tail is worse than the base law's that is below
LEAST_NOISE_RADII, LEAST_NOISE_RAD = 0.01, 0.01  # where a film states less
DEEPER_RADII = 0.25  # than the base law and the film
OUTLINE_POINTS = 24


def prediction_faults(
    experiment: Experiment, content: Mapping[str, Any], base: pd.DataFrame, found: pd.DataFrame
) -> Faults:
    """What the diagnosed prediction breaks: cause and facts."""
    if list(base.columns) != list(found.columns) or len(base) != len(found):
        yield "predictions of different shape", f"{base.shape} and {found.shape}"
        return
    numbers = found.drop(columns=["block", "theta_rad"], errors="ignore")
    if numbers.isna().any(axis=None):
        yield "a prediction without a number", str(found[numbers.isna().any(axis=1)].head(3))
        return
    if nothing_found(content) and not base.equals(found):
        yield "a prediction that differs although nothing was found", str(base.compare(found).head(3))
    if experiment.trajectories is None or found.empty:
        return
    measured = found[KEYS[:1] + KEYS[3:]].merge(_rounded(experiment.trajectories), how="left", on=["release", "t_s"])
    yield from _pushed(experiment, base, found, measured)
    yield from _sunk(experiment, base, found, measured)
    yield from _tail(experiment, base, found, measured)


def nothing_found(content: Mapping[str, Any]) -> bool:
    """A diagnosis that uses no effect and learnt nothing."""
    return content["verdict"] in ("none", "unknown") and not content.get("model")


def _rounded(rows: pd.DataFrame) -> pd.DataFrame:
    """Rows of a film with instants as a prediction writes them."""
    return rows.assign(t_s=[float(f"{t:.6g}") for t in rows["t_s"]])[["release", "t_s", *POSE]]


def _pushed(experiment: Experiment, base: pd.DataFrame, found: pd.DataFrame, measured: pd.DataFrame) -> Faults:
    """Blocks at rest, in the film and by the base law, that the diagnosis moves in the second half of that time."""
    worst = (0.0, "")
    for (release, segment), rows in found.groupby(["release", "segment"]).indices.items():
        radius = experiment.blocks[found["block"].iloc[rows[0]]].radius_m
        unit = np.array([radius, radius, 1.0])
        noise = 4.0 * _noise(experiment, radius)
        poses = [table[POSE].to_numpy(float)[rows] for table in (base, measured, found)]
        still = np.array([STILL_RADII, STILL_RADII, STILL_RAD]) * unit
        first = max(_rests_from(poses[0], still), _rests_from(poses[1], still + noise))
        tail = poses[2][(first + len(rows)) // 2 :]
        if len(rows) - first < FEWEST_TAIL_FRAMES:
            continue
        middle = tail[len(tail) // 2]
        halves = [np.nan_to_num(np.abs(d) / unit) for d in (middle - tail[0], tail[-1] - middle)]
        ways = [max(np.hypot(x, y) / LARGEST_DRIFT_RADII, turn / LARGEST_TURN_RAD) for x, y, turn in halves]
        if ways[1] < SLOWING * ways[0]:
            continue  # the law lets it slide a little further, and it comes to rest
        x, y, turned = np.nan_to_num(np.abs(tail[-1] - tail[0]) / unit)
        moved = float(np.hypot(x, y))
        size = max(moved / LARGEST_DRIFT_RADII, turned / LARGEST_TURN_RAD)
        if size > worst[0]:
            worst = size, f"release {release}, segment {segment}: {moved:.2g} radii, {turned:.2g} rad"
    if worst[0] > 1.0:
        yield "a block at rest is moved", worst[1]


def _rests_from(pose: Array, still: Array) -> int:
    """First row from which poses (n, 3) stay where they end, to within `still`; NaN is no motion."""
    away = np.nan_to_num(np.abs(_apart(pose, pose[-1]))) > still
    return int(np.flatnonzero(away.any(axis=1))[-1]) + 1 if away.any() else 0


def _apart(a: Array, b: Array) -> Array:
    """Poses a less poses b; angles within half a turn."""
    difference = a - b
    difference[..., 2] = (difference[..., 2] + np.pi) % (2.0 * np.pi) - np.pi
    return np.asarray(difference)


def _sunk(experiment: Experiment, base: pd.DataFrame, found: pd.DataFrame, measured: pd.DataFrame) -> Faults:
    """Outlines that go deeper into the ground than those of the base law and of the film."""
    deepest = [_depth_radii(experiment, found["block"], table[POSE]) for table in (base, measured, found)]
    allowed = max(deepest[0].max(), deepest[1].max()) + DEEPER_RADII
    if deepest[2].max() > allowed:
        row = found.iloc[int(deepest[2].argmax())]
        facts = f"release {row['release']} at {row['t_s']} s: {deepest[2].max():.2f} radii, allowed {allowed:.2f}"
        yield "an outline deep in the ground", facts


def _depth_radii(experiment: Experiment, block: pd.Series, poses: pd.DataFrame) -> Array:
    """(n,) depth of the deepest point of each outline, in block radii; of the centre where there is no angle."""
    depth = np.zeros(len(poses))
    for name, own in experiment.blocks.items():
        rows = np.flatnonzero(block == name)
        x, y, theta = poses.to_numpy(float)[rows].T
        outline = own.outline(OUTLINE_POINTS)
        c, s = np.cos(theta)[:, None], np.sin(theta)[:, None]
        u = np.where(np.isnan(c), x[:, None], x[:, None] + c * outline[:, 0] - s * outline[:, 1])
        v = np.where(np.isnan(c), y[:, None], y[:, None] + s * outline[:, 0] + c * outline[:, 1])
        site = SimpleNamespace(cross_section=experiment.cross_section, block=own)
        if len(rows):
            depth[rows] = depth_in_ground(site, u, v).max(axis=1)
    return depth


def _tail(experiment: Experiment, base: pd.DataFrame, found: pd.DataFrame, measured: pd.DataFrame) -> Faults:
    """More segments than chance gives beyond twice the 95th percentile of the base law's misses."""
    radius = found["block"].map({name: own.radius_m for name, own in experiment.blocks.items()}).to_numpy(float)
    noise = np.array([_noise(experiment, r) for r in radius])
    misses = []
    for table in (base, found):
        z = _apart(table[POSE].to_numpy(float), measured[POSE].to_numpy(float)) / noise
        known = np.isfinite(z)
        mean = np.where(known, z, 0.0) ** 2 @ np.ones(3) / np.maximum(known.sum(axis=1), 1)
        square = pd.Series(mean)[known.any(axis=1)].groupby([found["release"], found["segment"]]).mean()
        misses.append(np.sqrt(square.dropna().to_numpy()))
    limit = LARGEST_TAIL * max(float(np.percentile(misses[0], TAIL_PERCENTILE)), ONE_SIGMA)
    beyond, count = int((misses[1] > limit).sum()), len(misses[1])
    by_chance = stats.binom.sf(beyond - 1, count, 1.0 - TAIL_PERCENTILE / 100.0)
    if by_chance < LEAST_CHANCE:
        yield ("a tail worse than twice the base law's", f"{beyond} of {count} segments beyond {limit:.3g} sigma")


def _noise(experiment: Experiment, radius_m: float) -> Array:
    """(3,) 1 sigma of a pose."""
    place = max(experiment.position_noise_m, LEAST_NOISE_RADII * radius_m)
    return np.array([place, place, max(experiment.angle_noise_rad, LEAST_NOISE_RAD)])
