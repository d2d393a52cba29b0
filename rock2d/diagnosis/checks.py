"""Predictive checks: would the diagnosed model have made this film?

Each check looks for a pattern in the residuals of the film, compared with replicates of it (Gelman, Meng and Stern
1996, Statistica Sinica 6, 733-807). In a replicate, all residuals of a release have the same random sign. That keeps
sizes, tails and correlations within a release, and removes what is systematic. The part of each pattern that the fitted
parameters can absorb is subtracted first (Hemerik, Goeman and Finos 2020, J. R. Stat. Soc. B 82(3), 841-864). So no
simulation and no assumption on distributions is needed. Slow errors of a track, as those of dust, can be alike in all
releases; a replicate has one normal number for each, instead of signs.

A check contains several patterns, for example one for each zone and channel. Its value is the largest of them, in
standard deviations of the replicates. The smallest p value of all checks is compared with that of the same replicates
(Westfall and Young 1993, Resampling-Based Multiple Testing), so that many checks do not fail more often than one.

A last check counts the impacts that are far from the model. The likelihood is robust, because a few impacts fall on the
other side of an edge. So a cause that changes some impacts completely, and others not at all, hardly counts in it. In a
replicate each impact is simulated again, with drawn noise of the camera and drawn soil: it shows how many impacts the
model itself puts far away. The law of a true cause may have another form than that of the catalogue. In one impact it
then acts as this law with another size, so an impact that is near the model with a cause of another size is not far."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy.special import gammainc

from rock2d.arrays import Array
from rock2d.diagnosis.cross_validation import summed
from rock2d.diagnosis.data import Data, FilmData
from rock2d.diagnosis.derivatives import ScatterColumns, drawn_impacts, square_roots, times_normal
from rock2d.diagnosis.fitting import Fit
from rock2d.diagnosis.flight_response import path_quantities
from rock2d.diagnosis.likelihood import chi_square, flight_weight, impact_weight, standard_deviations
from rock2d.diagnosis.model import BASE_WIDTH, Model, choice_positions
from rock2d.diagnosis.quantities import (
    BLOCK,
    CONSTANT,
    FLIGHT_DEPENDENCES,
    IMPACT_DEPENDENCES,
    KINDS,
    OMEGA_RAD_S,
    VX_M_S,
    VY_M_S,
    Dependences,
    bases,
    kind_names,
)
from rock2d.diagnosis.replicates import near_pairs
from rock2d.diagnosis.significance import probability_from_p_value
from rock2d.kinematics.impacts import ground_axes

# probability that any check of means fails although the model is right; the same for spreads
FALSE_ALARMS = 0.03
REPLICATES = 5000
# least share of the variance of a pattern that fitted parameters must not absorb
LEAST_UNABSORBED_SHARE = 0.05
# dependences in plain words
DEPENDENCE_WORDS = {"series": "release", "orientation to the ground": "orientation"}
# name of a check -> the dependences that it tests
IMPACT_MEANS = {
    "mean of impacts": (CONSTANT,), "impacts by zone and place": ("zone", "place"), "impacts by block": ("block",),
    "impacts with speed": ("normal speed", "sliding speed"), "impacts with spin": ("spin",),
    "impacts with orientation": ("orientation to the ground",), "impacts over releases": ("series",),
    "impacts of a release": ("history",),
}  # fmt: skip
FLIGHT_MEANS = {
    "bend of flights": (CONSTANT, "block"), "flights with velocity and spin": ("velocity", "spin"),
    "flights with height and place": ("height", "place"),
}  # fmt: skip
SPREADS = {
    "spread by channel": (CONSTANT,), "spread by zone and block": ("zone", "block"),
    "spread over releases": ("series",),
}  # fmt: skip
VELOCITIES = "residual velocities after impacts"
FAR = 5.0  # root mean square of the residuals, in standard deviations, from which on an impact is far from the model
SIMULATED_REPLICATES = 20
# Factor by which more impacts may be far than in the replicates, and further number of them: the track is not exact.
# Share that the causes may leave of those that they explain: the forms of their laws are not exact, either.
MORE, FURTHER, LEFT_BY_FORMS = 2.0, 1.0, 0.25
OTHER_SIZES = (0.5, 0.7, 1.4, 2.0)  # factors on the size of a cause that stand for other forms of its law


@dataclass(frozen=True)
class Check:
    """A check of the film against replicates of the diagnosed model.

    Attributes
    ----------
    name : what is tested
    compared : the compared quantity
    largest : name of the largest pattern
    value : value of the film, in standard deviations of the replicates
    percentiles : (101,) percentiles 0 to 100 of the values of the replicates
    p : share of the replicates with at least this value
    p_of_all : share of the replicates in which any check is at least as improbable"""

    name: str
    compared: str
    largest: str
    value: float
    percentiles: Array
    p: float
    p_of_all: float

    @property
    def replicates(self) -> list[float]:
        """Quantiles 0.05, 0.5 and 0.95 of the replicates."""
        return [float(self.percentiles[k]) for k in (5, 50, 95)]

    @property
    def words(self) -> str:
        """What is compared, as one line."""
        return f"{self.compared}, in standard deviations of the replicates; the largest: {self.largest}"

    @property
    def fails(self) -> bool:
        """Whether the data are improbable under the model."""
        return self.p_of_all < FALSE_ALARMS


@dataclass(frozen=True)
class Checks:
    """The checks of a model: of means of residuals, of their spreads, and of the number of far impacts."""

    means: list[Check]
    spreads: list[Check]
    far: list[Check]

    @property
    def all(self) -> list[Check]:
        """All checks, those of means first."""
        return [*self.means, *self.spreads, *self.far]

    @property
    def p(self) -> float:
        """Probability that a true model has a check of means at least as improbable as the most improbable one."""
        return min((check.p_of_all for check in self.means), default=1.0)

    @property
    def p_outside(self) -> float:
        """Probability that something acts that the model does not contain: not less than the share of the checks of
        means that fail."""
        failed_share = float(np.mean([check.fails for check in self.means])) if self.means else 0.0
        return max([failed_share, *(probability_from_p_value(check.p) for check in self.far if check.fails)])

    def content(self) -> list[dict[str, Any]]:
        """The key `checks` of diagnosis.json."""
        return [
            {"name": c.name, "words": c.words, "value": c.value, "replicates": c.replicates, "p": c.p} for c in self.all
        ]


def predictive_checks(data: Data, base: Fit, fit: Fit, seed: int) -> Checks:
    """The checks of a fitted model on the data that it was fitted to; `base`: the base law; `seed` of the
    replicates."""
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    signs = rng.choice([-1.0, 1.0], (1 + REPLICATES, len(data.order)))
    signs[0] = 1.0  # the data themselves
    shared = rng.normal(size=(1 + REPLICATES, data.slow_outcomes().shape[-1]))
    shared[0] = 0.0
    left = _RemainingPatterns(data, fit, np.hstack([signs, shared]))
    return Checks(_rank_checks(left.means()), _rank_checks(left.spreads()), _check_of_far_impacts(data, base, fit, rng))


class _Patterns(NamedTuple):
    """The k patterns of a check: their names, and (1 + replicates, k) values, first of the data."""

    name: str
    compared: str
    parts: Sequence[str]
    values: Array


def _rank_checks(checks: Sequence[_Patterns]) -> list[Check]:
    """Each check with its rank among the replicates."""
    if not checks:
        return []
    z = [np.abs(patterns.values) / np.maximum(patterns.values[1:].std(axis=0), 1e-300) for patterns in checks]
    largest = np.array([patterns.max(axis=1) for patterns in z])
    count = largest.shape[1]
    # share of all rows, its own included, that are as far out
    p = np.array([(count - np.searchsorted(np.sort(row), row)) / count for row in largest])
    least = p.min(axis=0)
    return [
        Check(
            patterns.name, patterns.compared, patterns.parts[int(sizes[0].argmax())], float(row[0]),
            np.quantile(row[1:], np.linspace(0.0, 1.0, 101)), float(rank[0]),
            float((least <= rank[0]).mean()),
        )
        for patterns, sizes, row, rank in zip(checks, z, largest, p, strict=True)
    ]  # fmt: skip


def _check_of_far_impacts(data: Data, base: Fit, fit: Fit, rng: np.random.Generator) -> list[Check]:
    """The check of the number of far impacts; none without impacts."""
    if not len(data.impact_release):
        return []
    far, replicates, p = far_impacts(data, base, fit, rng)
    zones, count = fit.model.setup.cross_section.zone_names, np.bincount(data.impact_zone[far], minlength=1)
    most = f", most in {zones[int(count.argmax())]}" if far.any() else ""
    unit = max(float(replicates.std()), 1.0)
    return [
        Check(
            "far impacts", f"number of impacts more than {FAR:.0f} standard deviations from the model",
            f"{far.sum()} of {len(far)}{most}", float(far.sum() / unit),
            np.quantile(replicates / unit, np.linspace(0.0, 1.0, 101)), p, p,
        )
    ]  # fmt: skip


def far_impacts(data: Data, base: Fit, fit: Fit, rng: np.random.Generator) -> tuple[Array, Array, float]:
    """(n,) whether each impact of the data is far from a fitted model; (SIMULATED_REPLICATES,) number of those that are
    in replicates; and the probability that as many are if the model is right, up to MORE, FURTHER and LEFT_BY_FORMS.

    `base`: the base law without causes"""
    covariance, limit = fit.covariance(), FAR**2 * fit.residuals.impacts.shape[1]
    far, far_of_base = (chi_square(own.residuals.impacts, own.covariance()) > limit for own in (fit, base))
    replicates = np.array([(chi_square(r, covariance) > limit).sum() for r in _simulated_again(data, fit, rng)])
    explained = max(float(far_of_base.sum() - far.sum()), 0.0)
    expected = MORE * float(replicates.mean()) + FURTHER + LEFT_BY_FORMS * explained
    for p in _with_other_sizes(fit.model, fit.p):
        if far.any():
            far &= chi_square(fit.model.residuals(p, data).impacts, covariance) > limit
    # share of a Poisson distribution
    return far, replicates, float(gammainc(far.sum(), expected))


def _with_other_sizes(model: Model, p: Array) -> Iterator[Array]:
    """Parameters at which one cause of the motion is smaller or larger, from no effect (0) on the scale of `Model`."""
    low, high = model.bounds()
    for effect in model.effects:
        own = np.zeros(model.size, bool)
        own[model.positions[effect.name]] = not (effect.camera or effect.scatter)
        own[choice_positions(model)] = False
        for factor in OTHER_SIZES if own.any() else ():
            yield np.where(own, np.clip(factor * p, low, high), p)


def _simulated_again(data: Data, fit: Fit, rng: np.random.Generator) -> Iterator[Array]:
    """(n, d) residuals of each replicate: the difference of impacts with drawn noise, soil and amounts of effects that
    widen the scatter from those without."""
    model, p, n, first = fit.model, fit.p, len(data.impact_release), len(BASE_WIDTH)
    values, expected = model.values(p), model.residuals(p, data).impacts
    noise_before = square_roots(data.state_noise(model.world(p, data.impact_order)))
    noise_after = square_roots(data.outcome_noise())
    for _ in range(SIMULATED_REPLICATES):
        shift = times_normal(noise_before, rng)
        soil = fit.scatter[:first] * rng.normal(size=(n, first))
        amounts = [
            [sizes[0] * rng.normal(size=n), *sizes[1:]] if effect.scatter else sizes
            for effect, sizes in zip(model.effects, values, strict=True)
        ]
        yield expected - drawn_impacts(model, p, data, soil, shift, amounts) + times_normal(noise_after, rng)


class _Residuals(NamedTuple):
    """Residuals of n impacts or n flights.

    Attributes
    ----------
    release : (n,)
    z, weight, jacobian : (n, d) whitened residuals, (n, d) their weights in the robust likelihood, (n, d, P) their
        derivatives
    names, channels : names of the three tested channels, and (n, 3, d) their weights on z, in standard deviations
    quantities : name -> (n,) measured quantities
    slow : (n, d, s) whitened slow errors, 1 sigma, that all releases may share
    bends : (n,) factors of the functions: `FilmData.unit_bends` of flights, 1 of impacts"""

    release: Array
    z: Array
    weight: Array
    jacobian: Array
    names: tuple[str, str, str]
    channels: Array
    quantities: Mapping[str, Array]
    slow: Array
    bends: Array


class _RemainingPatterns:
    """Patterns in the residuals of a fit that its parameters cannot absorb, for the data and for replicates."""

    def __init__(self, data: Data, fit: Fit, signs: Array) -> None:
        self._data, self._signs = data, signs
        self._world = world = fit.model.world(fit.p, data.impact_order)
        low, high = fit.model.bounds()
        free = np.flatnonzero((fit.p > low) & (fit.p < high) & fit.free)
        r, covariance = fit.residuals.impacts, fit.covariance()
        root = np.linalg.cholesky(covariance)
        whiten, known = np.linalg.inv(root), np.isfinite(r).all(axis=1)
        heavy = impact_weight(chi_square(r, covariance), r.shape[1])
        # standard deviations of the rates, the last columns
        self._sd = standard_deviations(covariance)[:, -3:]
        scattered = ScatterColumns.of(fit.jacobian)
        self._soil, self._share = whiten @ scattered.scaled(fit.scatter), scattered.share
        self._impacts = _Residuals(
            data.impact_release, np.einsum("nij,nj->ni", whiten, np.nan_to_num(r)),
            np.tile((known * heavy)[:, None], r.shape[1]), whiten @ fit.jacobian.impacts[..., free],
            ("along the ground", "across the ground", "spin"), root[:, -3:] / self._sd[:, :, None],
            data.impact_quantities(world) if len(r) else {}, whiten @ data.slow_outcomes(), np.ones(len(r)),
        )  # fmt: skip
        m, degrees = data.flown, fit.residuals.flights.shape[-1]
        z, quantities, bends = fit.residuals.flights[:m].reshape(m, 3 * degrees), dict[str, Array](), np.empty(0)
        if isinstance(data, FilmData) and m:
            quantities = path_quantities(world, data.states(world).middle)
            quantities[BLOCK] = data.flights.block.astype(float)
            bends = data.unit_bends()
        self._flights = _Residuals(
            data.flight_release[:m], z, flight_weight(z),
            fit.jacobian.flights[:m, ..., free].reshape(*z.shape, len(free)), ("x", "y", "angle"),
            np.tile(np.kron(np.eye(3), np.arange(degrees) == 0), (m, 1, 1)), quantities,
            np.zeros((*z.shape, self._impacts.slow.shape[-1])), bends,
        )  # fmt: skip

    @cached_property
    def _parameter_shifts(self) -> Array:
        """(releases + s, P) shift of the parameters by the residuals of each release, for the sign +1, and by each
        shared slow error."""
        count = self._impacts.jacobian.shape[-1]
        pull, curvature = np.zeros((self._signs.shape[1], count)), np.zeros((count, count))
        for side in (self._impacts, self._flights):
            pulled = side.weight[..., None] * side.jacobian
            pull += self._pulls(side, pulled)
            curvature += np.einsum("ndp,ndq->pq", pulled, side.jacobian, optimize=True)
        size = np.sqrt(np.maximum(np.diag(curvature), 1e-300))
        return pull / size @ np.linalg.pinv(curvature / size / size[:, None], 1e-9, hermitian=True) / size

    def _pulls(self, side: _Residuals, columns: Array) -> Array:
        """(releases + s, k) products of columns (n, d, k) with the residuals of each release, and with each shared slow
        error."""
        own = summed(side.release, np.einsum("ndk,nd->nk", columns, side.z), len(self._data.order))
        return np.vstack([own, np.einsum("ndk,nds->sk", columns, side.slow)])

    def _functions(
        self, table: Mapping[str, Sequence[str]], dependences: Dependences, side: _Residuals
    ) -> Iterator[tuple[str, Array, list[str]]]:
        """For each check of a table: name, functions (n, k) of mean 0 unless constant, and names of the patterns."""
        members = kind_names(self._world)
        entries = {name: dependences[name] for names in table.values() for name in names}
        known = bases(entries, side.quantities) if side.quantities else {}
        for check, names in table.items():
            functions, parts = [], list[str]()
            for name in filter(known.__contains__, names):
                curves, f = known[name].curves, known[name].features(side.quantities)
                words = [f" with {DEPENDENCE_WORDS.get(name, name)}"] * f.shape[1] if curves else [""]
                if curves and curves[0].kind == KINDS:
                    labels = members.get(curves[0].quantity)
                    words = [f" in {labels[int(i)] if labels else f'impact {i + 1:.0f}'}" for i in curves[0].numbers]
                functions.append(f - f.mean(axis=0) if curves else f)
                parts += [channel + part for part in words for channel in side.names]
            if functions:
                yield check, np.concatenate(functions, axis=1), parts

    def _unabsorbed(
        self, name: str, compared: str, parts: Sequence[str], sums: Array, absorbed: Array
    ) -> list[_Patterns]:
        """A check from the contributions of the releases (and of shared slow errors), `sums` (r, k), and the part that
        the parameters absorb; no check if they absorb all, or of what was not measured."""
        left, size = sums - absorbed, (sums**2).sum(axis=0)
        kept = np.flatnonzero((size > 0.0) & ((left**2).sum(axis=0) > LEAST_UNABSORBED_SHARE * size)).tolist()
        patterns = _Patterns(name, compared, [parts[k] for k in kept], self._signs[:, : len(left)] @ left[:, kept])
        return [patterns] if kept else []

    def _mean(
        self, name: str, compared: str, parts: Sequence[str], side: _Residuals, columns: Array
    ) -> list[_Patterns]:
        """A check of weighted sums of whitened residuals times `columns` (n, d, k)."""
        pulled = side.weight[..., None] * columns
        moved = np.einsum("ndk,ndp->pk", pulled, side.jacobian, optimize=True)
        return self._unabsorbed(name, compared, parts, self._pulls(side, pulled), self._parameter_shifts @ moved)

    def means(self) -> list[_Patterns]:
        """Patterns of the means of residuals of impacts and flights."""
        patterns = list[_Patterns]()
        for compared, table, dependences, side in (
            (f"mean of {VELOCITIES}", IMPACT_MEANS, IMPACT_DEPENDENCES, self._impacts),
            ("mean of the residual bend of flights", FLIGHT_MEANS, FLIGHT_DEPENDENCES, self._flights),
        ):
            for name, f, parts in self._functions(table, dependences, side):
                columns = np.einsum("n,nk,ncd->ndkc", side.bends, f, side.channels).reshape(*side.z.shape, -1)
                patterns += self._mean(name, compared, parts, side, columns)
        return patterns + (self._energy() + self._near_replicates() if len(self._impacts.z) else [])

    def _energy(self) -> list[_Patterns]:
        """Pattern of the energy after impacts, in standard deviations."""
        after = self._data.outcome_quantities(self._world)
        blocks = np.array([(b.mass_kg, b.inertia_kg_m2) for b in self._world.blocks.values()])
        mass, inertia = blocks[self._data.impact_block].T
        along, across = ground_axes(self._data.tangent, np.column_stack([after[VX_M_S], after[VY_M_S]]))
        momentum = np.column_stack([mass * along, mass * across, inertia * after[OMEGA_RAD_S]])
        columns = np.einsum("nc,ncd->nd", momentum * self._sd, self._impacts.channels)
        columns /= np.maximum(np.linalg.norm(columns, axis=1, keepdims=True), 1e-300)
        parts = ["all impacts"]
        return self._mean("energy lost in impacts", "energy after impacts", parts, self._impacts, columns[..., None])

    def _near_replicates(self) -> list[_Patterns]:
        """Pattern: residuals of impacts from nearly the same state in different releases have the same direction."""
        impacts, pairs = self._impacts, near_pairs(self._data, self._world)
        if not pairs:
            return []
        root = np.sqrt(impacts.weight)
        # (n, d, releases + s) residuals as a function of the signs and the shared slow errors
        free = -np.einsum("ndp,rp->ndr", root[..., None] * impacts.jacobian, self._parameter_shifts)
        free[np.arange(len(free)), :, impacts.release] += root * impacts.z
        free[..., len(self._data.order) :] += root[..., None] * impacts.slow
        first, second = (free[rows].reshape(-1, free.shape[-1]) for rows in pairs[-1])
        agreed = ((self._signs @ (first.T @ second)) * self._signs).sum(axis=1)
        words = "agreement of the residuals of impacts from nearly the same state"
        return [_Patterns("near-replicates", words, ["all pairs"], (agreed - agreed[1:].mean())[:, None])]

    def spreads(self) -> list[_Patterns]:
        """Patterns of the sizes of residuals of impacts: channels compared with each other, and each by zone, block and
        release."""
        from scipy.special import ndtri
        from scipy.stats import rankdata

        impacts, patterns = self._impacts, list[_Patterns]()
        known = impacts.weight[:, :1] > 0.0
        z = np.einsum("ncd,nd->nc", impacts.channels, impacts.z)
        # normal scores of the sizes: symmetric, as random signs need it
        size = ndtri((rankdata(np.abs(z), axis=None).reshape(z.shape) - 0.5) / max(z.size, 1))
        # derivatives of the log likelihood by the logarithms of what scatters
        pulled = np.einsum("nd,ndk->nk", impacts.z, self._soil) ** 2
        soil = (impacts.weight[:, :1] * pulled - known * (self._soil**2).sum(axis=1)) @ self._share
        for name, f, parts in self._functions(SPREADS, IMPACT_DEPENDENCES, impacts):
            middle = size.mean(axis=1, keepdims=True) if CONSTANT in SPREADS[name] else size.mean(axis=0)
            each = np.einsum("nk,nc->nkc", f, known * (size - middle)).reshape(len(z), -1)
            absorbed = soil @ np.linalg.lstsq(soil, each, rcond=1e-9)[0]
            sums = (summed(impacts.release, values, len(self._data.order)) for values in (each, absorbed))
            patterns += self._unabsorbed(name, f"size of {VELOCITIES}", parts, *sums)
        return patterns
