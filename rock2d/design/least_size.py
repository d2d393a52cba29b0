"""The least size that meets a target, by bisection over one number of a scenario, over all that is not known.

All sizes are judged on the same possible sites with the same releases (common random numbers), so that two sizes do not
differ by chance."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from rock2d.arrays import Array
from rock2d.cluster import JobRunner
from rock2d.design.possible_sites import IN_THIS_PROCESS, SiteResults, draw_sites, simulate_sites
from rock2d.design.shared_descents import SharedDescents, shares_descents
from rock2d.design.site_frequencies import further_site_quantile
from rock2d.errors import InputError
from rock2d.files.scenario import Scenario
from rock2d.files.scenario_variants import variant
from rock2d.progress import Bar, Bars
from rock2d.runs.engines import compiled_engine
from rock2d.scene.earthworks import CREST_LINE, numbered
from rock2d.statistics import Estimate

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

DEFAULT_RELEASES = 1000  # per block and site, for a scenario without the key `uncertainty`
STEPS_OF_RANGE = 50  # range over the default tolerance
LARGEST_STAGE, SMALLER_STAGE = "largest size", "smaller sizes"  # stages of a search
TICKS_PERCENT = (0, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100)
LATER_SHARE = 0.13  # time for a later size over the time for the first one, if they share descents


@dataclass(frozen=True)
class Target:
    """Target of a design: with this confidence, at most this share of the releases of each block passes the line.

    Attributes
    ----------
    line : name of a measure line
    frequency, confidence : shares from 0 to 1
    per : "released" or "arriving": share of all releases, or of those that come to the arrival line
    above_J, above_m : count only blocks that pass with more than this kinetic energy, and higher than this above the
        foot of the line"""

    line: str
    frequency: float
    confidence: float
    per: Literal["released", "arriving"] = "released"
    above_J: float = 0.0
    above_m: float | None = None

    @property
    def text(self) -> str:
        """The target in words."""
        limits = [f"with more than {1e-3 * self.above_J:.4g} kJ"] if self.above_J > 0.0 else []
        limits += [f"higher than {self.above_m:.4g} m"] if self.above_m is not None else []
        with_what = "".join(f", {limit}" for limit in limits)
        blocks = f"at most {100 * self.frequency:.3g} % of the {self.per} blocks"
        return f"{blocks} pass {self.line}{with_what}, at {100 * self.confidence:.3g} % confidence"

    def counts(self, results: SiteResults, block: int) -> tuple[Array, Array, Array]:
        """(sites, releases) bool each, for the block with that index: whether a release passes in the sense of the
        target, whether it passes or is unresolved, and whether it counts in the share. An unresolved release that has
        not arrived may count in it, too."""
        k = results.lines.index(self.line)
        passed, most = results.passed[:, block, k], results.unresolved[:, block, k]
        limits = {"kinetic_J": self.above_J or None, "passing_height_m": self.above_m}
        for quantity, least in limits.items():
            if least is not None:  # values are NaN if the block did not pass
                passed = passed & (results.crossings[quantity][:, block, k] > least)
        of = results.arrived[:, block, k] if self.per == "arriving" else np.ones_like(passed)
        return passed & of, passed & of | most, of


@dataclass(frozen=True)
class Judgement:
    """The judgement of one size: median frequency of each block over the sites, and bounds at the confidence of the
    target.

    Attributes
    ----------
    size : the number that was varied
    median, low, high : block -> frequency
    meets : whether every upper bound is at most the target
    unresolved : block -> share of the releases of all sites that were cut short or buried before the line; the upper
        bounds count them as passed"""

    size: float
    median: Mapping[str, float]
    low: Mapping[str, float]
    high: Mapping[str, float]
    meets: bool
    unresolved: Mapping[str, float] = field(default_factory=dict)

    @property
    def worst(self) -> str:
        """The block with the largest upper bound."""
        return max(self.high, key=lambda block: self.high[block])


@dataclass(frozen=True, repr=False)
class Answer:
    """Answer of a search for the least size.

    Attributes
    ----------
    place : place of the number that was varied
    target : the target
    least : the least size that meets the target, to within `tolerance`. If the smallest size of the range meets it, it
        is that size, and smaller ones may meet it, too. None if the largest size does not meet it
    judgements : judgements of all sizes that were tried, in ascending order"""

    place: str
    target: Target
    least: float | None
    tolerance: float
    judgements: tuple[Judgement, ...]

    def __repr__(self) -> str:
        least = "no size meets" if self.least is None else f"{self.least_text} meets"
        return f"<Answer for {self.place}: {least}: {self.target.text}; {len(self.judgements)} sizes tried>"

    @property
    def shown(self) -> Judgement:
        """The judgement of the least size, or of the largest if none meets the target."""
        return next((judged for judged in self.judgements if judged.size == self.least), self.judgements[-1])

    @property
    def is_bound(self) -> bool:
        """Whether the smallest size of the range meets the target, so that smaller sizes may meet it, too."""
        return self.least == self.judgements[0].size

    @property
    def least_text(self) -> str:
        """The least size in words, or a bound if the smallest size of the range meets the target."""
        if self.least is None:
            return f"none up to {self.judgements[-1].size:.4g}"
        if self.is_bound:
            return f"at most {self.least:.4g} (the range begins there)"
        return f"{self.least:.4g} (to within {self.tolerance:.2g})"

    @property
    def monotone(self) -> bool:
        """Whether every size above one that meets the target also meets it."""
        meets = [judgement.meets for judgement in self.judgements]
        return meets == sorted(meets)

    def to_pandas(self) -> pd.DataFrame:
        """One row for each size and block: size, block, median, low, high (shares), and whether the block meets the
        target. A size meets it if all blocks do."""
        import pandas as pd

        rows = [
            (j.size, block, median, j.low[block], j.high[block], j.high[block] <= self.target.frequency)
            for j in self.judgements
            for block, median in j.median.items()
        ]
        return pd.DataFrame(rows, columns=["size", "block", "median", "low", "high", "meets"])

    def plot(self) -> Figure:
        """Median and band of the share of each block that passes at every judged size, the target, and the least size
        that meets it."""
        from matplotlib.ticker import FuncFormatter, NullLocator

        from rock2d.graphics.figure_style import SMALL_PT, blank_figure, finish
        from rock2d.graphics.palette import INK, LINE_INK, block_colours

        figure = blank_figure(6.4, 4.0)
        axis = figure.subplots()
        sizes = [judged.size for judged in self.judgements]
        for block, colour in block_colours(self.judgements[0].median).items():
            low, median, high = (
                [100.0 * getattr(judged, bound)[block] for judged in self.judgements]
                for bound in ("low", "median", "high")
            )
            axis.fill_between(sizes, low, high, color=colour, alpha=0.18, lw=0)
            axis.plot(sizes, median, "o-", color=colour, ms=3.5, lw=1.4, label=block)
        target, confidence = 100.0 * self.target.frequency, 100.0 * self.target.confidence
        axis.axhline(target, color=INK, lw=1.0, ls=(0, (5, 2)))
        label: dict[str, Any] = {"xytext": (0, 3), "textcoords": "offset points", "fontsize": SMALL_PT}
        axis.annotate(f"target {target:.3g} %", (sizes[0], target), **label)
        linear = max(target, 0.1)
        axis.set_yscale("symlog", linthresh=linear)
        axis.set_ylim(0)
        top = axis.get_ylim()[1]
        axis.set_yticks([tick for tick in TICKS_PERCENT if tick == 0 or 0.2 * linear <= tick <= top], minor=False)
        axis.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.yaxis.set_minor_locator(NullLocator())
        if self.least is not None:
            axis.axvline(self.least, color=LINE_INK, lw=1.4)
            shown = f" {'≤ ' if self.is_bound else ''}{self.least:.4g}"
            at = (self.least, axis.get_ylim()[1])
            axis.annotate(shown, at, color=LINE_INK, va="top", fontsize=SMALL_PT + 1)
        axis.set_xlabel(self.place)
        band = f"{100.0 - confidence:.3g} to {confidence:.3g} %"
        axis.set_ylabel(f"passes {self.target.line} in % (median, {band})")
        axis.grid(color="#e4e4e4", lw=0.6)
        axis.legend(frameon=False, fontsize=SMALL_PT + 0.5)
        return finish(figure, "Share of blocks that pass")

    def _repr_html_(self) -> str:
        from rock2d.graphics.pages import notebook_figure, notebook_table

        return notebook_table(self.to_pandas()) + notebook_figure(self.plot())


@dataclass(frozen=True)
class Search:
    """A search for the least size that meets a target.

    Attributes
    ----------
    scenario : scenario of the site
    place : place in the scenario file of the number that is varied
    bounds : smallest and largest size
    target : the target
    engine, seed : engine and seed of the simulation
    over : places of further numbers that vary, with their bounds
    run_jobs : function that distributes the possible sites to workers; results do not depend on it"""

    scenario: Scenario
    place: str
    bounds: tuple[float, float]
    target: Target
    engine: str
    seed: int
    over: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    run_jobs: JobRunner = field(default=IN_THIS_PROCESS, repr=False, compare=False)

    def check(self) -> None:
        """Raise InputError if the places, the line or the bounds make no sense, or if the releases restart a film."""
        if self.scenario.experiment is not None:
            message = "a search draws its releases; these start from the measured states of an experiment"
            raise self.scenario.error(message, "incident", "default", at="key", code="wrong_kind")
        for place, (low, high) in self.ranges.items():
            if not low < high:
                raise InputError(f"the range of {place} must rise, found {low:g} to {high:g}")
            if self.scenario.uncertainty is not None and place in self.scenario.unknown():
                message = f"{place} is varied by the search and is also under uncertainty: remove one of the two"
                raise self.scenario.error(message, "uncertainty", "site", place, at="key", code="wrong_kind")
        variant(self.scenario, {place: low for place, (low, _) in self.ranges.items()})  # checks the places
        lines = self.scenario.make_cross_section().measure_lines
        if self.target.line not in lines:
            known = ", ".join(lines) or "none"
            message = f"no measure line {self.target.line}; there are: {known}"
            raise self.scenario.error(message, "cross_section", code="unknown_name")
        if not (0.0 < self.target.frequency < 1.0 and 0.5 <= self.target.confidence < 1.0):
            raise InputError("the target must lie between 0 and 100 %, the confidence between 50 and 100 %")

    @property
    def ranges(self) -> dict[str, tuple[float, float]]:
        """Bounds of each number that varies; `place` is the last one."""
        return {**self.over, self.place: self.bounds}

    @property
    def corners(self) -> list[dict[str, float]]:
        """Place -> bound, for each corner of `ranges`; the corner of all largest values is the last one."""
        return [dict(zip(self.ranges, corner, strict=True)) for corner in itertools.product(*self.ranges.values())]

    @cached_property
    def sites(self) -> list[tuple[dict[str, float], int]]:
        """Values and seed of the releases of each independent possible site; there are twice the base number of sites.
        If everything is known, one site without values."""
        if self.scenario.uncertainty is None:
            return [({}, self.seed)]
        sites = draw_sites(self.scenario, self.seed, 2 * self.scenario.uncertainty.base_sites)
        return [(sites[int(i)], sites.release_seed(int(i))) for i in sites.independent]

    @property
    def releases(self) -> int:
        """Releases of each block on each site."""
        uncertain = self.scenario.uncertainty
        return DEFAULT_RELEASES if uncertain is None else uncertain.releases

    def judge(
        self,
        size: float,
        on_progress: Callable[[int], Any] = lambda count: None,
        others: Mapping[str, float] = MappingProxyType({}),
    ) -> Judgement:
        """Simulate all possible sites with this size and these values of `over`, and judge the size."""
        variants = self._variants({**others, self.place: size})
        results = simulate_sites(
            variants, self.engine, self._seeds, self.releases, on_progress, self._descents, self.run_jobs
        )
        return judge(results, size, self.target)

    @property
    def _seeds(self) -> list[int]:
        return [seed for _, seed in self.sites]

    def _variants(self, sizes: Mapping[str, float]) -> list[Scenario]:
        return [variant(self.scenario, {**values, **sizes}) for values, _ in self.sites]

    @property
    def has_shared_descents(self) -> bool:
        """Whether the releases of all sizes share their descents, see `shared_descents`."""
        return self._descents is not None

    @cached_property
    def _descents(self) -> list[SharedDescents] | None:
        """The shared descents on each site; None if a size changes more than the ground."""
        engine = compiled_engine(self.engine).name
        if not all(shares_descents(self.scenario, place, engine) for place in self.ranges):
            return None
        extremes = zip(*map(self._variants, self.corners), strict=True)
        return [
            SharedDescents(of_site, seed, self.releases) for of_site, seed in zip(extremes, self._seeds, strict=True)
        ]


def judge(results: SiteResults, size: float, target: Target) -> Judgement:
    """Judge a size by the results at all sites. A block none of whose releases arrive does not meet a target for
    arriving blocks."""
    k = results.lines.index(target.line)
    bands: dict[str, Estimate] = {}
    unresolved: dict[str, float] = {}
    for b, block in enumerate(results.blocks):
        unresolved[block] = float(results.unresolved[:, b, k].mean())
        passed, most, of = target.counts(results, b)
        if not of.any():
            bands[block] = Estimate(0.0, 0.0, 1.0)
            continue
        possible = (of | most).sum(axis=1)
        some = possible > 0
        low, high = (
            further_site_quantile(counts.sum(axis=1)[some], possible[some], level)
            for counts, level in ((passed, 1.0 - target.confidence), (most, target.confidence))
        )
        counted = of.any(axis=1)
        middle = float(np.median(passed[counted].sum(axis=1) / of[counted].sum(axis=1)))
        bands[block] = Estimate(middle, min(low, middle), max(middle, high))
    median, low_of, high_of = ({block: band[i] for block, band in bands.items()} for i in range(3))
    return Judgement(size, median, low_of, high_of, max(high_of.values()) <= target.frequency, unresolved)


def line_of_place(place: str) -> str:
    """Default measure line for a number at this place: the crest of its embankment."""
    part, _, rest = place.partition(".")
    number = rest.partition(".")[0] if part in ("embankment", "ditch") else ""
    return numbered(CREST_LINE, int(number) if number.isdecimal() else None)


def most_sizes(bounds: tuple[float, float], tolerance: float | None = None) -> int:
    """Largest number of sizes that `least_size` judges."""
    low, high = bounds
    steps = STEPS_OF_RANGE if tolerance is None else (high - low) / tolerance
    return 2 + max(0, math.ceil(math.log2(max(steps, 1.0))))


def work_of_sizes(search: Search, tolerance: float | None = None) -> dict[str, float]:
    """Work of the stages of `size_bars`, in simulated releases."""
    each = len(search.sites) * search.releases * len(search.scenario.make_blocks())
    later = LATER_SHARE if search.has_shared_descents else 1.0
    return {LARGEST_STAGE: each, SMALLER_STAGE: later * each * (most_sizes(search.bounds, tolerance) - 1)}


@contextmanager
def size_bars(search: Search, bars: Bars, tolerance: float | None = None) -> Iterator[Callable[[float], Bar]]:
    """Give a function from a size to its progress bar. The largest size, which is judged first and simulates the shared
    descents, has its own bar."""
    sites = len(search.sites)
    with ExitStack() as stack:
        first = bar = stack.enter_context(bars.stage(LARGEST_STAGE, sites, "sites"))

        def bar_of(size: float) -> Bar:
            nonlocal bar
            if bar is first and size != search.bounds[1]:
                stack.close()
                others = most_sizes(search.bounds, tolerance) - 1
                bar = stack.enter_context(bars.stage(SMALLER_STAGE, others * sites, "sites"))
            bar.set_postfix_str(f"{search.place} = {size:.4g}")
            return bar

        yield bar_of


def least_size(search: Search, judged: Callable[[float], Judgement], tolerance: float | None = None) -> Answer:
    """Find the least size by bisection; `judged` returns the judgement of a size, for example by `Search.judge`.

    `tolerance` is 1/50 of the range by default. Raises InputError as `Search.check` does."""
    search.check()
    low, high = search.bounds
    tolerance = (high - low) / STEPS_OF_RANGE if tolerance is None else tolerance
    tried = {high: judged(high), low: judged(low)}
    if not tried[high].meets:
        least = None
    elif tried[low].meets:
        least = low
    else:
        while high - low > tolerance:
            middle = 0.5 * (low + high)
            tried[middle] = judged(middle)
            low, high = (low, middle) if tried[middle].meets else (middle, high)
        least = high
    return Answer(search.place, search.target, least, tolerance, tuple(tried[size] for size in sorted(tried)))
