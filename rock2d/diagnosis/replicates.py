"""A floor of the gap that is independent of models: near-replicates.

Two impacts of the same block in the same zone with nearly the same state before them differ only by noise and soil. So
half the mean square difference of their residuals estimates the variance of noise and soil (the nugget of the
variogram; Matheron 1963, Economic Geology 58(8), 1246-1266). If it is smaller than the mean square of the residuals,
the model misses something that depends on the state."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rock2d.arrays import Array
from rock2d.diagnosis.data import Data
from rock2d.diagnosis.quantities import LEAN_RAD, NORMAL_SPEED_M_S, PLACE_M, SPIN_M_S, TANGENTIAL_SPEED_M_S
from rock2d.scene.world import World

NEAR_SHARE = 0.03  # share of all pairs that count as near-replicates
FEWEST_NEAR_PAIRS = 20
FEWEST_IN_CELL = 5  # impacts of a block in a zone
MOST_IN_CELL = 700  # if there are more, every k-th is used
JACKKNIFE_GROUPS = 10  # groups of releases, for the standard error
SMALLEST_RATIO = 0.02
HARMONIC = 4  # order in the orientation: a square looks the same after a quarter of a turn


@dataclass(frozen=True)
class Ratio:
    """Half the mean square difference of near-replicates over the mean square of the residuals, with standard error."""

    value: float
    error: float

    @property
    def upper_bound(self) -> float:
        """Value plus one standard error, at most 1."""
        return min(self.value + self.error, 1.0)

    def draws(self, rng: np.random.Generator, count: int) -> Array:
        """(1 + count,) the value and other plausible ones, at most 1."""
        drawn = np.clip(rng.normal(self.value, self.error, count), SMALLEST_RATIO, 1.0)
        return np.append(min(self.value, 1.0), drawn)


NO_PAIRS = Ratio(1.0, 0.0)


def replicate_ratio(data: Data, world: World, z: Array) -> Ratio:
    """The ratio for the residuals z (n, d), in standard deviations, of a model's impacts.

    Several definitions of "nearly the same state" are tried. The one with the lowest upper bound counts."""
    ratios = [_ratio(pairs, z, data.impact_release) for pairs in near_pairs(data, world)]
    return min([NO_PAIRS, *ratios], key=lambda ratio: ratio.upper_bound)


def near_pairs(data: Data, world: World) -> list[tuple[Array, Array]]:
    """Pairs of impacts (first, second) that are near-replicates, for each definition of nearness with enough pairs."""
    if len(data.impact_release) < FEWEST_IN_CELL:
        return []
    q = data.impact_quantities(world)
    lean = HARMONIC * q[LEAN_RAD]
    speeds, turn = [q[NORMAL_SPEED_M_S], q[TANGENTIAL_SPEED_M_S], q[SPIN_M_S]], [np.sin(lean), np.cos(lean)]
    cell = data.impact_block * (data.impact_zone.max() + 1) + data.impact_zone
    pairs = []
    for features in (speeds, [q[PLACE_M]], [*speeds, *turn], [*speeds, *turn, q[PLACE_M]]):
        first, second, distance = _pairs(np.column_stack(features), cell, data.impact_release)
        near = distance <= np.quantile(distance, NEAR_SHARE) if len(distance) else np.empty(0, bool)
        if near.sum() >= FEWEST_NEAR_PAIRS:
            pairs.append((first[near], second[near]))
    return pairs


def _ratio(pairs: tuple[Array, Array], z: Array, release: Array) -> Ratio:
    """The ratio for one definition of nearness."""
    first, second = pairs
    half = 0.5 * ((z[first] - z[second]) ** 2).mean(axis=1)
    size = (z**2).mean(axis=1)
    group = release % JACKKNIFE_GROUPS
    whole = half.mean() / size.mean()
    left: list[float] = []
    for g in np.unique(group):
        keep = (group[first] != g) & (group[second] != g)
        if keep.any() and (group != g).any():
            left.append(half[keep].mean() / size[group != g].mean())
    k = len(left)
    if k < 2:
        return NO_PAIRS
    return Ratio(float(whole), float(np.sqrt((k - 1) / k * np.sum((np.array(left) - np.mean(left)) ** 2))))


def _pairs(features: Array, cell: Array, release: Array) -> tuple[Array, Array, Array]:
    """Pairs of impacts in the same cell and in different releases: the two impacts, and their distance."""
    parts: list[Sequence[Array]] = []
    for c in np.unique(cell):
        members = np.flatnonzero(cell == c)
        members = members[:: -(-len(members) // MOST_IN_CELL)]
        if len(members) < FEWEST_IN_CELL:
            continue
        x = features[members]
        x = (x - x.mean(axis=0)) / np.maximum(x.std(axis=0), 1e-12)
        i, j = np.triu_indices(len(members), 1)
        different = release[members[i]] != release[members[j]]
        i, j = i[different], j[different]
        parts.append((members[i], members[j], np.sqrt(((x[i] - x[j]) ** 2).sum(axis=1))))
    if not parts:
        none = np.empty(0, np.int64)
        return none, none, np.empty(0)
    first, second, distance = (np.concatenate(part) for part in zip(*parts, strict=True))
    return first, second, distance
