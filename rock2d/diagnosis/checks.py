"""Predictive checks: would the diagnosed model have made this film?

Each check looks for a pattern in what the model leaves, in the film and in replicates of it (Gelman, Meng and Stern
1996, Statistica Sinica 6, 733-807). A replicate gives all that is left of a release the same random sign. That keeps
sizes, tails and how the impacts of a release depend on each other, and breaks what is systematic. What the fitted
parameters can absorb is first taken out of each pattern (Hemerik, Goeman and Finos 2020, J. R. Stat. Soc. B 82(3),
841-864). So nothing is simulated, and no distribution is assumed.

A check holds several patterns, for example one for each zone and channel. Its value is the largest of them, in standard
deviations of the replicates. The smallest p value of all checks has its own place among the same replicates (Westfall
and Young 1993, Resampling-Based Multiple Testing), so that many checks fail no more often than one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from rock2d.diagnosis.data import Data
from rock2d.diagnosis.film_data import FilmData
from rock2d.diagnosis.fitting import Fit
from rock2d.diagnosis.flight_fields import path_quantities
from rock2d.diagnosis.likelihood import FLIGHT_STUDENT_DF, IMPACT_STUDENT_DF, chi_square
from rock2d.diagnosis.quantities import (
    BLOCK,
    CONSTANT,
    FLIGHT_DEPENDENCES,
    IMPACT_DEPENDENCES,
    KINDS,
    OMEGA_RAD_S,
    SERIES,
    VX_M_S,
    VY_M_S,
    ZONE,
    bases,
)
from rock2d.diagnosis.replicates import near_pairs
from rock2d.kinematics.impacts import ground_axes

Array = np.ndarray

FALSE_ALARMS = 0.03  # of the checks of means together, and of those of spreads, if the model is right
REPLICATES = 5000
LEAST_LEFT = 0.05  # share of its variance that the fitted parameters must leave of a pattern
IMPACT_CHANNELS = ("along the ground", "across the ground", "spin")
FLIGHT_CHANNELS = ("x", "y", "angle")
SAID = {"series": "release", "orientation to the ground": "orientation"}  # dependences in plain words
# name of a check -> the dependences that it looks at
IMPACT_MEANS = {
    "mean of impacts": (CONSTANT,),
    "impacts by zone and place": ("zone", "place"),
    "impacts by block": ("block",),
    "impacts with speed": ("normal speed", "sliding speed"),
    "impacts with spin": ("spin",),
    "impacts with orientation": ("orientation to the ground",),
    "impacts over releases": ("series",),
    "impacts of a release": ("history",),
}
FLIGHT_MEANS = {
    "bend of flights": (CONSTANT, "block"),
    "flights with velocity and spin": ("velocity", "spin"),
    "flights with height and place": ("height", "place"),
}
SPREADS = {
    "spread by channel": (CONSTANT,),
    "spread by zone and block": ("zone", "block"),
    "spread over releases": ("series",),
}


@dataclass(frozen=True)
class Check:
    """A check of the film among replicates of the diagnosed model.

    Attributes
    ----------
    name, compared : what is looked at, and what is measured of it; `largest`: the largest pattern
    value : of the film, in standard deviations of the replicates; `replicates`: their quantiles 0.05, 0.5 and 0.95
    p : share of the replicates that are as far out; `p_of_all`: in which any check is as improbable
    """

    name: str
    compared: str
    largest: str
    value: float
    replicates: list[float]
    p: float
    p_of_all: float

    @property
    def words(self) -> str:
        """What is compared, as one line."""
        return f"{self.compared}, in standard deviations of the replicates; the largest: {self.largest}"

    @property
    def fails(self) -> bool:
        """Whether the model would hardly have made this."""
        return self.p_of_all < FALSE_ALARMS


@dataclass(frozen=True)
class Checks:
    """The checks of a model: of what it leaves on the mean, and of how that spreads."""

    means: list[Check]
    spreads: list[Check]

    @property
    def all(self) -> list[Check]:
        """First the means."""
        return [*self.means, *self.spreads]

    def content(self) -> list[dict[str, Any]]:
        """The key `checks` of diagnosis.json."""
        return [
            {"name": c.name, "words": c.words, "value": c.value, "replicates": c.replicates, "p": c.p}
            for c in self.all
        ]

    @property
    def p(self) -> float:
        """Probability that a true model would look this bad: of a mean as improbable as the most improbable one."""
        return min((check.p_of_all for check in self.means), default=1.0)


def predictive_checks(data: Data, fit: Fit, seed: int) -> Checks:
    """The checks of a fitted model on the data that it was fitted to; `seed` of the replicates."""
    left = _Left(data, fit)
    signs = np.random.default_rng(np.random.SeedSequence(seed)).choice(
        [-1.0, 1.0], (1 + REPLICATES, len(data.order))
    )
    signs[0] = 1.0  # the film itself
    means = [*left.impact_means(), *left.flight_means()]
    return Checks(
        _placed([*(p.drawn(signs) for p in means), *left.near_replicates(signs)]),
        _placed([p.drawn(signs) for p in left.spreads()]),
    )


@dataclass(frozen=True)
class _Drawn:
    """The k patterns of a check: their names, and (1 + replicates, k) values, first of the film."""

    name: str
    compared: str
    parts: Sequence[str]
    values: Array


@dataclass(frozen=True)
class _Patterns:
    """The k patterns of a check: their names, and what each release adds to them, (releases, k)."""

    name: str
    compared: str
    parts: Sequence[str]
    sums: Array

    def drawn(self, signs: Array) -> _Drawn:
        """With signs (1 + replicates, releases)."""
        return _Drawn(self.name, self.compared, self.parts, signs @ self.sums)


def _placed(found: Sequence[_Drawn]) -> list[Check]:
    """Each check with its place among the replicates."""
    if not found:
        return []
    z = [np.abs(own.values) / np.maximum(own.values[1:].std(axis=0), 1e-300) for own in found]
    largest = np.array([own.max(axis=1) for own in z])
    count = largest.shape[1]
    # share of all rows, its own included, that are as far out
    p = np.array([(count - np.searchsorted(np.sort(row), row)) / count for row in largest])
    least = p.min(axis=0)
    return [
        Check(
            own.name, own.compared, own.parts[int(sizes[0].argmax())], float(row[0]),
            [float(v) for v in np.quantile(row[1:], [0.05, 0.5, 0.95])], float(rank[0]),
            float((least <= rank[0]).mean()),
        )
        for own, sizes, row, rank in zip(found, z, largest, p, strict=True)
    ]  # fmt: skip


class _Left:
    """What a fit leaves of impacts and flights, and what its parameters could still absorb."""

    def __init__(self, data: Data, fit: Fit) -> None:
        self._data, self._fit = data, fit
        self._world = fit.model.world(fit.p, data.impact_order)
        r, covariance = fit.residuals.impacts, fit.covariance()
        root = np.linalg.cholesky(covariance)
        whiten = np.linalg.inv(root)
        known = np.isfinite(r).all(axis=1)
        heavy = IMPACT_STUDENT_DF + r.shape[1]
        # weights of the robust likelihood; the last three columns of residuals are the rates
        self._weight = known * heavy / (IMPACT_STUDENT_DF + chi_square(r, covariance))
        self._z = np.einsum("nij,nj->ni", whiten, np.nan_to_num(r))
        self._sd = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))[:, -3:]
        self._rates = root[:, -3:] / self._sd[:, :, None]  # of whitened residuals, in standard deviations
        self._soil = whiten @ fit.slope.scatter
        low, high = fit.model.bounds()
        free = np.flatnonzero((fit.p > low) & (fit.p < high) & fit.free)
        self._slope = whiten @ fit.slope.impacts[..., free]
        self._flights = fit.residuals.flights
        self._flight_weight = (FLIGHT_STUDENT_DF + 1) / (FLIGHT_STUDENT_DF + self._flights**2)
        self._flight_slope = fit.slope.flights[..., free]

    def _summed(self, release: Array, values: Array) -> Array:
        """(releases, k) sums of values (n, k)."""
        out = np.zeros((len(self._data.order), values.shape[1]))
        np.add.at(out, release, values)
        return out

    @cached_property
    def _absorbing(self) -> Array:
        """(releases, P) by which the signs of the releases move the parameters."""
        j, jf, w, wf = self._slope, self._flight_slope, self._weight, self._flight_weight
        pull = self._summed(self._data.impact_release, np.einsum("n,nd,ndp->np", w, self._z, j))
        pull += self._summed(self._data.flight_release, np.einsum("mcd,mcdp->mp", wf * self._flights, jf))
        curve = np.einsum("n,ndp,ndq->pq", w, j, j, optimize=True)
        curve += np.einsum("mcd,mcdp,mcdq->pq", wf, jf, jf, optimize=True)
        size = np.sqrt(np.maximum(np.diag(curve), 1e-300))
        return pull / size @ np.linalg.pinv(curve / size / size[:, None], 1e-9, hermitian=True) / size

    def _patterns(
        self, name: str, compared: str, parts: Sequence[str], release: Array, sums: Array, absorbed: Array
    ) -> list[_Patterns]:
        """A check from `sums` (n, k) of each segment less what the parameters absorb, `absorbed` (releases, k); none
        where they absorb all."""
        own = self._summed(release, sums)
        left = own - absorbed
        kept = np.flatnonzero((left**2).sum(axis=0) > LEAST_LEFT * (own**2).sum(axis=0)).tolist()
        return [_Patterns(name, compared, [parts[k] for k in kept], left[:, kept])] if len(kept) else []

    # --- impacts ----------------------------------------------------------------------------------------

    @cached_property
    def _of_impacts(self) -> dict[str, tuple[Array, list[str]]]:
        """Dependence -> functions (n, k) of it and their names."""
        quantities = self._data.impact_quantities(self._world)
        wanted = {name for names in (*IMPACT_MEANS.values(), *SPREADS.values()) for name in names}
        entries = {name: parts for name, parts in IMPACT_DEPENDENCES.items() if name in wanted}
        return self._functions(entries, quantities, self._weight) if len(self._z) else {}

    def _functions(
        self, entries: dict[str, tuple[tuple[str, str], ...]], quantities: dict[str, Array], weight: Array
    ) -> dict[str, tuple[Array, list[str]]]:
        """Functions (n, k) of each dependence, of mean 0 unless it is a constant, and their names."""
        world, found = self._world, {}
        names = {BLOCK: list(world.blocks), ZONE: world.cross_section.zone_names}
        for name, basis in bases(entries, quantities).items():
            features = basis.features(quantities)
            parts = [f" with {SAID.get(name, name)}"] * features.shape[1]
            if not basis.curves:
                parts = [""]
            elif basis.curves[0].kind == KINDS:
                members = map(int, basis.curves[0].numbers)
                own = names.get(basis.curves[0].quantity)
                parts = [f" in {own[i]}" if own else f" in impact {i + 1}" for i in members]
            if basis.curves:
                features = features - weight @ features / max(weight.sum(), 1e-300)
            found[name] = features, parts
        return found

    def impact_means(self) -> list[_Patterns]:
        """What is left of velocities after impacts, and of their energy."""
        found, known = [], self._of_impacts
        for name, dependences in IMPACT_MEANS.items():
            own = [known[d] for d in dependences if d in known]
            if own:
                f = np.concatenate([features for features, _ in own], axis=1)
                parts = [c + part for _, parts in own for part in parts for c in IMPACT_CHANNELS]
                columns = np.einsum("nk,ncd->ndkc", f, self._rates).reshape(*self._z.shape, -1)
                found += self._impact_patterns(
                    name, "mean of what is left of velocities after impacts", parts, columns
                )
        return found + (self._energy() if known else [])

    def _impact_patterns(
        self, name: str, compared: str, parts: Sequence[str], columns: Array
    ) -> list[_Patterns]:
        """Weighted sums of whitened residuals times `columns` (n, d, k)."""
        pulled = self._weight[:, None, None] * columns
        moved = np.einsum("ndk,ndp->pk", pulled, self._slope, optimize=True)
        sums = np.einsum("ndk,nd->nk", pulled, self._z)
        return self._patterns(name, compared, parts, self._data.impact_release, sums, self._absorbing @ moved)

    def _energy(self) -> list[_Patterns]:
        """Energy that impacts leave to the blocks, in its standard deviations."""
        after = self._data.outcome_quantities(self._world)
        velocity = np.column_stack([after[VX_M_S], after[VY_M_S]])
        blocks = np.array([(b.mass_kg, b.inertia_kg_m2) for b in self._world.blocks.values()])
        mass, inertia = blocks[self._data.impact_block].T
        along, across = ground_axes(self._data.tangent, velocity)
        momentum = np.column_stack([mass * along, mass * across, inertia * after[OMEGA_RAD_S]])
        columns = np.einsum("nc,ncd->nd", momentum * self._sd, self._rates)
        columns /= np.maximum(np.linalg.norm(columns, axis=1, keepdims=True), 1e-300)
        words = "energy that impacts leave"
        return self._impact_patterns("energy lost in impacts", words, ["all impacts"], columns[:, :, None])

    def near_replicates(self, signs: Array) -> list[_Drawn]:
        """Whether impacts of different releases from nearly the same state miss in the same direction."""
        pairs = near_pairs(self._data, self._world)
        if not pairs:
            return []
        root = np.sqrt(self._weight)[:, None]
        # (n, d, releases) residuals as a function of the signs
        free = -np.einsum("ndp,rp->ndr", root[:, :, None] * self._slope, self._absorbing)
        free[np.arange(len(free)), :, self._data.impact_release] += root * self._z
        first, second = (free[own].reshape(-1, free.shape[-1]) for own in pairs[-1])
        agreed = ((signs @ (first.T @ second)) * signs).sum(axis=1)
        words = "agreement of what is left of impacts from nearly the same state"
        return [_Drawn("near-replicates", words, ["all pairs"], (agreed - agreed[1:].mean())[:, None])]

    def spreads(self) -> list[_Patterns]:
        """Sizes of what is left of impacts: channels against each other, and each by zone, block and release."""
        from scipy.special import ndtri
        from scipy.stats import rankdata

        known, found, release = self._of_impacts, [], self._data.impact_release
        valid = (self._weight > 0.0)[:, None]
        z = np.einsum("ncd,nd->nc", self._rates, self._z)
        # normal scores of the sizes: symmetric, as random signs need it
        size = ndtri((rankdata(np.abs(z), axis=None).reshape(z.shape) - 0.5) / max(z.size, 1))
        # slopes of the log likelihood by the scatter of the soil
        pulled = np.einsum("nd,ndk->nk", self._z, self._soil) ** 2
        soil = self._weight[:, None] * pulled - valid * (self._soil**2).sum(axis=1)
        for name, dependences in SPREADS.items():
            own = [known[d] for d in dependences if d in known]
            if own:
                middle = size.mean(axis=1, keepdims=True) if CONSTANT in dependences else size.mean(axis=0)
                f = np.concatenate([features for features, _ in own], axis=1)
                sums = np.einsum("nk,nc->nkc", f, valid * (size - middle)).reshape(len(z), -1)
                parts = [c + part for _, parts in own for part in parts for c in IMPACT_CHANNELS]
                by_soil = np.linalg.lstsq(soil, sums, rcond=1e-9)[0]
                words = "size of what is left of velocities after impacts"
                found += self._patterns(
                    name, words, parts, release, sums, self._summed(release, soil @ by_soil)
                )
        return found

    # --- flights ----------------------------------------------------------------------------------------

    def flight_means(self) -> list[_Patterns]:
        """How flights bend: the answer to an acceleration, of a film."""
        data, found = self._data, []
        if not isinstance(data, FilmData) or not len(self._flights):
            return []
        quantities = path_quantities(self._world, data.states(self._world).middle)
        quantities[BLOCK] = data.segmentation.flights.block.astype(float)
        quantities[SERIES] = data.order[data.flight_release].astype(float)
        wanted = {name: FLIGHT_DEPENDENCES[name] for names in FLIGHT_MEANS.values() for name in names}
        lever, weight = data.lever(), self._flight_weight[:, :, 0]
        known = self._functions(wanted, quantities, lever**2)
        for name, dependences in FLIGHT_MEANS.items():
            own = [known[d] for d in dependences if d in known]
            if own:
                f = lever[:, None] * np.concatenate([features for features, _ in own], axis=1)
                parts = [c + part for _, parts in own for part in parts for c in FLIGHT_CHANNELS]
                sums = np.einsum("mk,mc->mkc", f, weight * self._flights[:, :, 0]).reshape(len(f), -1)
                moved = np.einsum("mk,mc,mcp->pkc", f, weight, self._flight_slope[:, :, 0], optimize=True)
                absorbed = self._absorbing @ moved.reshape(len(moved), -1)
                words = "mean of the bend of flights that is left"
                found += self._patterns(name, words, parts, data.flight_release, sums, absorbed)
        return found
