"""The likelihood of a soil given measured distances, by simulation; its emulator, and the posterior.

The likelihood of a soil is estimated from a hundred descents, so it is noisy and takes half a second. A Gaussian
process smooths it over the simulated soils, and the posterior is drawn with the smooth likelihood (Gutmann and Corander
2016, J. Mach. Learn. Res. 17(125)). The same simulations give the posterior for any subset of the releases, such as one
block or a fold."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from rock2d.arrays import Array
from rock2d.calibration.sequential_monte_carlo import posterior, prior_draws
from rock2d.field_tests.descents import Descents
from rock2d.files.field_releases import FieldReleases
from rock2d.files.scenario import Scenario
from rock2d.files.scenario_variants import variant

# share of unexplained stops, which lie anywhere up to a distance
UNEXPLAINED_SHARE, UNEXPLAINED_REACH_M = 0.002, 200.0
# priors, uniform in the logarithm: standard deviation of the discrepancy, and share of blocks that something unknown (a
# hollow, a shrub, a boulder) catches anywhere on their way
DISCREPANCY_RANGE_M, CAUGHT_RANGE = (2.0, 16.0), (0.005, 0.25)
LOG_LIKELIHOOD_DEPTH = 2.0  # smaller log likelihoods, per release below the best, are cut off
# Powers of the likelihood from which the soils of each round are drawn. Far from simulated soils the Gaussian process
# may be too high; each round simulates soils there, and so corrects it.
ROUND_POWERS = (0.4, 0.4, 0.7, 1.0)
PRIOR_STREAM, REFINED_STREAM, POSTERIOR_STREAM = range(3)  # first numbers of spawn keys


@dataclass(frozen=True)
class Unknowns:
    """The unknowns: numbers of the scenario, the discrepancy and the share of caught blocks. A *soil* has all of them.

    Attributes
    ----------
    scenario : scenario with the key uncertainty
    quantiles : place -> quantile function"""

    scenario: Scenario
    quantiles: Mapping[str, Callable[[Any], Any]]

    @property
    def dimensions(self) -> int:
        """Number of dimensions: the numbers of the scenario, then the discrepancy and the share of caught blocks."""
        return len(self.quantiles) + 2

    def values(self, u: Array) -> dict[str, float]:
        """Place -> value of a soil u (d,)."""
        return {place: float(q(share)) for (place, q), share in zip(self.quantiles.items(), u, strict=False)}

    def scenario_of(self, u: Array) -> Scenario:
        """The scenario of a soil."""
        return variant(self.scenario, self.values(u))

    @staticmethod
    def discrepancy_m(u: Array) -> Array:
        """Standard deviation of the discrepancy in m, for soils u (..., d)."""
        low, high = DISCREPANCY_RANGE_M
        return np.asarray(low * (high / low) ** u[..., -2])

    @staticmethod
    def caught(u: Array) -> Array:
        """Share of caught blocks, for soils u (..., d)."""
        low, high = CAUGHT_RANGE
        return np.asarray(low * (high / low) ** u[..., -1])


@dataclass(frozen=True)
class SimulatedSoils:
    """Simulated soils, and the log density of each release with each soil.

    Attributes
    ----------
    u : (k, d) soils in the unit cube
    log_density : (k, n) log density in 1/m of each measured distance"""

    u: Array
    log_density: Array

    def joined(self, other: SimulatedSoils) -> SimulatedSoils:
        """These soils and others."""
        return SimulatedSoils(np.vstack([self.u, other.u]), np.vstack([self.log_density, other.log_density]))


def log_density(measured_m: Array, simulated_m: Array, sd_m: Array | float, caught: Array | float) -> Array:
    """(n,) log of the density in 1/m at measured distances, given simulated ones.

    Parameters
    ----------
    measured_m : (n,)
    simulated_m : (m,) or (n, m); NaN for blocks that did not start, which are ignored
    sd_m : standard deviation of the normal kernel about each simulated distance, a number or the shape of simulated_m
    caught : share of blocks that stop anywhere on their way, likewise"""
    x, simulated = measured_m[:, None], np.atleast_2d(simulated_m)
    started = np.isfinite(simulated)
    far = np.where(started, simulated, 1.0)
    z = (x - far) / sd_m
    goes_on = np.exp(-0.5 * z * z) / (np.sqrt(2.0 * np.pi) * sd_m)
    density = (1.0 - caught) * goes_on + caught * (x < far) / far
    mean = (density * started).sum(axis=1) / np.maximum(started.sum(axis=1), 1)
    return np.asarray(np.log((1.0 - UNEXPLAINED_SHARE) * mean + UNEXPLAINED_SHARE / UNEXPLAINED_REACH_M))


def log_density_by_block(releases: FieldReleases, metres: Array, sd_m: float, caught: float) -> Array:
    """(n,) `log_density` of each release among the descents (n, m) of its block."""
    found = np.empty(len(releases))
    for block in dict.fromkeys(releases.blocks):
        own = releases.of_blocks(block)
        found[own] = log_density(releases.distances_m[own], metres[own].ravel(), sd_m, caught)
    return found


def simulate_soils(
    unknowns: Unknowns, descents: Descents, u: Array, on_progress: Callable[[int], Any]
) -> SimulatedSoils:
    """Simulate all releases with each of these soils (k, d)."""
    found = []
    for soil in u:
        metres = descents.simulated(unknowns.scenario_of(soil)).metres
        sd, caught = float(unknowns.discrepancy_m(soil)), float(unknowns.caught(soil))
        found.append(log_density_by_block(descents.releases, metres, sd, caught))
        on_progress(1)
    return SimulatedSoils(u, np.array(found))


def prior_soils(unknowns: Unknowns, seed: int, count: int) -> Array:
    """(count, d) draws of the prior."""
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(PRIOR_STREAM,)))
    drawn = prior_draws(count, unknowns.dimensions, rng)
    return np.asarray(drawn.clip(1e-6, 1 - 1e-6))


def refined_soils(soils: SimulatedSoils, seed: int, part: int, count: int) -> Array:
    """(count, d) soils of a round, drawn from the present posterior given all releases, with the power of the round."""
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(REFINED_STREAM, part)))
    every = np.arange(soils.log_density.shape[1])
    return drawn_posterior(soils, every, rng, count, ROUND_POWERS[part])


def drawn_posterior(
    soils: SimulatedSoils, indices: Array, rng: np.random.Generator, count: int, power: float = 1.0
) -> Array:
    """(count, d) draws of the posterior given some releases (indices); `power` below 1 flattens the likelihood."""
    emulator = Emulator(soils.u, soils.log_density[:, indices].sum(axis=1), len(indices))
    start = prior_draws(8 * count, soils.u.shape[1], rng).clip(1e-6, 1 - 1e-6)
    return posterior(lambda u: power * emulator(u), start, count, rng).u.clip(1e-6, 1 - 1e-6)


class Emulator:
    """A smooth log-likelihood over the unit cube, from noisy ones (k,) at soils (k, d)."""

    def __init__(self, u: Array, log_likelihood: Array, releases: int) -> None:
        from sklearn.exceptions import ConvergenceWarning
        from sklearn.gaussian_process import GaussianProcessRegressor
        from sklearn.gaussian_process.kernels import RBF, ConstantKernel, Kernel, WhiteKernel

        floor = log_likelihood.max() - LOG_LIKELIHOOD_DEPTH * releases
        kernel: Kernel = ConstantKernel(1.0, (1e-2, 1e3)) * RBF(np.full(u.shape[1], 0.5), (0.1, 20.0)) + WhiteKernel(
            0.05, (1e-4, 1.0)
        )
        self._process = GaussianProcessRegressor(kernel, normalize_y=True, random_state=0)
        with warnings.catch_warnings():  # the length scale of a number without influence reaches its bound
            warnings.simplefilter("ignore", ConvergenceWarning)
            self._process.fit(u, np.maximum(log_likelihood, floor))

    def __call__(self, u: Array) -> Array:
        """(n,) log-likelihood at soils (n, d)."""
        return np.asarray(self._process.predict(u))
