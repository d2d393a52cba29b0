"""Result of a blind trial in one figure: right verdicts by signal-to-noise ratio, and their probabilities.

`python -m rock2d_figures.blind_trial TRIAL` draws a scored trial (`rock2d blind score`) into figures/blind.png."""

import itertools
import sys
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rock2d.blind.scoring import CALIBRATION_BINS, SIGNAL_TO_NOISE_EDGES
from rock2d.graphics.figure_style import blank_figure, handle
from rock2d.statistics import wilson_interval
from rock2d_figures.style import finish_with_legend

ONE_EFFECT, SEVERAL_EFFECTS = "one effect", "several effects, one named"
OUTSIDE_CAUSE, NO_CAUSE = "outside the catalogue", "nothing"
STYLES = {
    ONE_EFFECT: ("#0072b2", "o"),
    SEVERAL_EFFECTS: ("#56b4e9", "^"),
    OUTSIDE_CAUSE: ("#d55e00", "s"),
    NO_CAUSE: ("#555555", "D"),
}
GROUP_SHIFT = 0.13  # between the symbols of neighbouring groups


def group(label: str) -> str:
    """The group of a case."""
    if label in ("none", "unknown"):
        return NO_CAUSE if label == "none" else OUTSIDE_CAUSE
    return SEVERAL_EFFECTS if "+" in label else ONE_EFFECT


def figure(cases: pd.DataFrame) -> Figure:
    """Share right with 95 % Wilson intervals, by what was hidden and its signal-to-noise, and against the probability
    stated; `cases` as `rock2d.blind.scoring.case_table` gives them."""
    drawn = blank_figure(7.2, 3.0)
    left, right = drawn.subplots(1, 2, width_ratios=(1.7, 1.0))
    kinds = cases["label"].map(group)
    steps = list(itertools.pairwise(SIGNAL_TO_NOISE_EDGES))
    for k, name in enumerate((ONE_EFFECT, SEVERAL_EFFECTS, OUTSIDE_CAUSE)):
        for i, (low, high) in enumerate(steps):
            own = cases[(kinds == name) & cases["signal_to_noise"].between(low, high, inclusive="left")]
            _share(left, i + (k - 1) * GROUP_SHIFT, own["right"], name)
    _share(left, len(steps), cases["right"][kinds == NO_CAUSE], NO_CAUSE)
    ends = [f"{low:g} to {high:g}" for low, high in steps[:-1]]
    left.set_xticks(range(len(steps) + 1), [*ends, f"above {steps[-1][0]:g}", "nothing\nhidden"])
    left.set_xlabel("signal-to-noise of what is hidden")
    left.set_ylabel("right verdicts (%)")
    p = cases["p"].to_numpy()
    right.plot([0, 100], [0, 100], color="#bbbbbb", lw=0.8)
    for part in np.array_split(np.argsort(p, kind="stable"), CALIBRATION_BINS):
        _share(right, 100 * p[part].mean(), cases["right"].iloc[part], ONE_EFFECT)
    right.set_xlabel("probability stated (%)")
    right.set_xlim(30, 102)
    for axes in (left, right):
        axes.set_ylim(-3, 103)
        axes.grid(axis="y", color="#e4e4e4", lw=0.6)
    handles = [handle(name, color=c, marker=m, ls="-", ms=5, lw=1.1) for name, (c, m) in STYLES.items()]
    return finish_with_legend(drawn, handles, 4)


def _share(axes: Axes, x: float, right: pd.Series, name: str) -> None:
    if not len(right):
        return
    colour, marker = STYLES[name]
    low, high = wilson_interval(int(right.sum()), len(right))
    axes.vlines(x, 100 * low, 100 * high, color=colour, lw=1.1)
    axes.plot(x, 100 * right.mean(), marker, color=colour, ms=5)


if __name__ == "__main__":
    found = pd.read_csv(
        Path(sys.argv[1]) / "score.csv", dtype={"case": str}, keep_default_na=False, na_values=[""]
    ).dropna(subset=["right"])  # left out: verdicts that say what a real record holds anyway
    figure(found.astype({"right": bool})).savefig(Path(__file__).parents[1] / "blind.png", dpi=160)
