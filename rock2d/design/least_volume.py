"""Earthworks of least volume that meet a target, over several of their numbers (`rock2d design --over`).

For given values of the other numbers, bisection finds the least size, and so the volume of earth that is moved. This
volume is minimised over the other numbers: first at the corners and in the middle of their ranges, then from the best
of these with COBYQA, a derivative-free method with bounds (Ragonneau & Zhang 2024, in scipy). All combinations are
judged on the same possible sites with the same releases, so that two combinations do not differ by chance."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from rock2d.design.least_size import Answer, Judgement, Search, least_size, most_sizes
from rock2d.design.shared_descents import EARTHWORKS
from rock2d.errors import InputError, comma_list
from rock2d.files.scenario_variants import variant
from rock2d.scene.earthworks import earth_moved_m2

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from rock2d.progress import Bar, Bars

MOST_OTHERS = 3
MOST_COMBINATIONS = 40
FIRST_STEP, LAST_STEP = 0.25, 0.02  # parts of a range
COMBINATIONS = "combinations.csv"


@dataclass(frozen=True)
class Combination:
    """Values of the other numbers, the answer for them, and fill and cut of the earthworks of its least size (of the
    largest if none meets the target), in m³ per metre of embankment."""

    values: Mapping[str, float]
    answer: Answer
    fill_m2: float
    cut_m2: float

    @property
    def earth_m2(self) -> float:
        """Sum of fill and cut."""
        return self.fill_m2 + self.cut_m2

    @property
    def objective(self) -> float:
        """Objective of the minimisation: the volume; if no size meets the target, it grows with the excess of the
        bound."""
        if self.answer.least is not None:
            return self.earth_m2
        target, largest = self.answer.target, self.answer.judgements[-1]
        return self.earth_m2 * (2.0 + math.log10(max(largest.high.values()) / target.frequency))


def check_varied(place: str, over: Mapping[str, tuple[float, float]]) -> None:
    """Raise InputError if too many numbers vary in addition to `place`, or if they do not belong to the earthworks."""
    if place in over:
        raise InputError(f"{place} is given to --vary and to --over")
    if len(over) > MOST_OTHERS:
        raise InputError(f"{len(over)} numbers are too many: vary at most {MOST_OTHERS} in addition to {place}")
    for name in (place, *over) if over else ():
        if name.split(".")[0] not in EARTHWORKS:
            raise InputError(
                f"{name} is not a number of the earthworks; --over varies numbers of embankment and ditch to find the "
                "least volume. Values that are not known belong under uncertainty"
            )


def least_volume(
    search: Search, judged: Callable[[float, Bar, Mapping[str, float]], Judgement], bars: Bars, tolerance: float | None
) -> list[Combination]:
    """All combinations of `search.over` that were tried; the first one has the least volume. Raises InputError at once
    if a corner of the ranges makes no sense."""
    for corner in search.corners:
        variant(search.scenario, corner)
    sizes = MOST_COMBINATIONS * most_sizes(search.bounds, tolerance)
    with bars.stage("combinations", sizes * len(search.sites), "sites") as bar:

        def found(values: Mapping[str, float]) -> Combination:
            answer = least_size(search, lambda size: judged(size, bar, values), tolerance)
            built = variant(search.scenario, {**values, answer.place: answer.shown.size}).make_cross_section()
            return Combination(values, answer, *earth_moved_m2(search.scenario.natural_ground(), built))

        return minimised(found, search.over)


def minimised(
    found: Callable[[Mapping[str, float]], Combination], over: Mapping[str, tuple[float, float]]
) -> list[Combination]:
    """All combinations that were tried, the best first: corners and middle of the ranges, then steps of COBYQA from the
    best of these."""
    from scipy.optimize import minimize

    low, high = np.array(list(over.values())).T
    known: dict[tuple[float, ...], Combination] = {}

    def at(part: np.ndarray) -> float:
        values = tuple(float(f"{value:.6g}") for value in low + np.round(part, 3) * (high - low))
        if values not in known:
            known[values] = found(dict(zip(over, values, strict=True)))
        return known[values].objective

    starts = [np.array(corner) for corner in itertools.product((0.0, 1.0), repeat=len(over))]
    starts.append(np.full(len(over), 0.5))
    best = min(starts, key=at)
    options = {"maxfev": MOST_COMBINATIONS - len(starts), "initial_tr_radius": FIRST_STEP, "final_tr_radius": LAST_STEP}
    minimize(at, best, method="COBYQA", bounds=[(0.0, 1.0)] * len(over), options=options)
    return sorted(known.values(), key=lambda combination: combination.objective)


def combination_table(combinations: Sequence[Combination]) -> pd.DataFrame:
    """One row for each combination: the values, the least size (NaN if none meets the target), fill, cut and their sum
    in m³ per metre of embankment."""
    import pandas as pd

    rows = [
        {**each.values, f"least {each.answer.place}": each.answer.least, "fill_m3_m": each.fill_m2,
         "cut_m3_m": each.cut_m2, "earth_m3_m": each.earth_m2}
        for each in combinations
    ]  # fmt: skip
    return pd.DataFrame(rows).astype(float)


def volume_text(combinations: Sequence[Combination]) -> str:
    """The best combination, which is the first one, in words."""
    best = combinations[0]
    if best.answer.least is None:
        return f"no combination meets the target: {best.answer.target.text}"
    values = {**best.values, best.answer.place: best.answer.least}
    head = f"least volume: {best.earth_m2:.3g} m³ per metre (fill {best.fill_m2:.3g}, cut {best.cut_m2:.3g}) with "
    bound = "; the range begins there, so smaller sizes may also meet the target" if best.answer.is_bound else ""
    tried = {name: [each.values[name] for each in combinations] for name in best.values}
    at_end = [name for name, values in tried.items() if best.values[name] in (min(values), max(values))]
    end = f"; the range of {comma_list(at_end)} ends there, so a wider range may give less" if at_end else ""
    return f"{head}{', '.join(f'{name} = {value:.4g}' for name, value in values.items())}{bound}{end}"


def volume_figure(combinations: Sequence[Combination]) -> Figure:
    """The volume against each number, and for each pair of the other numbers a map of the volume."""
    from rock2d.graphics.figure_style import SMALL_PT, blank_figure, finish
    from rock2d.graphics.palette import INK, LINE_INK

    best = combinations[0]
    meets = np.array([each.answer.least is not None for each in combinations])
    earth = np.array([each.earth_m2 for each in combinations])
    names = list(best.values)
    pairs = list(itertools.combinations(names, 2))
    panels = len(names) + 1 + len(pairs)
    figure = blank_figure(7.0, 2.6 * math.ceil(panels / 2))
    grid = figure.subplots(math.ceil(panels / 2), 2, squeeze=False).ravel()
    axes = grid[:panels]
    for unused in grid[panels:]:
        unused.set_axis_off()

    def of(name: str) -> np.ndarray:
        return np.array([each.values.get(name, each.answer.least) for each in combinations], float)

    for axis, name in zip(axes, (*names, best.answer.place), strict=False):
        axis.scatter(of(name)[meets], earth[meets], s=14, color=INK, alpha=0.6, lw=0)
        axis.set_xlabel(name if name in names else f"least {name}", fontsize=SMALL_PT)
        axis.set_ylabel("earth moved, m³ per metre", fontsize=SMALL_PT)
        axis.grid(color="#e4e4e4", lw=0.6)
        if best.answer.least is not None:
            axis.plot(best.values.get(name, best.answer.least), best.earth_m2, "o", ms=7, mfc="none", mec=LINE_INK)
    for axis, (x, y) in zip(axes[len(names) + 1 :], pairs, strict=True):
        if meets.sum() > 3:  # triangles need three points that are not on a line
            surface = axis.tricontourf(
                of(x)[meets], of(y)[meets], earth[meets], np.geomspace(earth[meets].min(), earth[meets].max(), 9),
                norm="log", cmap="cividis",
            )  # fmt: skip
            bar = figure.colorbar(surface, ax=axis, label="earth moved, m³ per metre", format="%.3g")
            bar.ax.minorticks_off()
        axis.plot(of(x), of(y), ".", color=INK, ms=3)
        axis.plot(of(x)[~meets], of(y)[~meets], "x", color=LINE_INK, ms=6)
        axis.plot(best.values[x], best.values[y], "o", ms=8, mfc="none", mec=LINE_INK)
        axis.set_xlabel(x, fontsize=SMALL_PT)
        axis.set_ylabel(y, fontsize=SMALL_PT)
    return finish(figure, "Least volume that meets the target")
