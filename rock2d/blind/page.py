"""The page of a scored trial: one HTML file with its figures."""

from __future__ import annotations

import html
import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rock2d.blind.scoring import (
    CALIBRATION_BINS,
    CLEAR_SIGNAL_TO_NOISE,
    CONFIDENT_PROBABILITY,
    SIGNAL_TO_NOISE_EDGES,
    confusion,
    share_text,
)
from rock2d.blind.set_page import set_section
from rock2d.blind.set_scoring import SetCase
from rock2d.files.folders import write_whole
from rock2d.graphics.pages import (
    PAGE_ACCENT,
    PAGE_INK,
    PAGE_RULE,
    PAGE_WARM,
    blank_axes,
    html_figure,
    html_list,
    html_page,
    html_table,
)
from rock2d.statistics import wilson_interval

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

RELEASE_EDGES, NOISE_EDGES = (20, 40, 80, 119), (0.004, 0.008, 0.015)


def write_page(
    cases: pd.DataFrame, summary: dict[str, Any], digest: str, path: Path, sets: Sequence[SetCase] = ()
) -> None:
    """Write the page of a scored trial; `sets`: its cases whose results name sets."""
    panels = [
        ("Hidden cause and verdict", _confusion_matrix(cases)),
        (
            "By signal-to-noise ratio",
            _share_right(cases, "signal_to_noise", SIGNAL_TO_NOISE_EDGES[1:-1], "signal-to-noise"),
        ),
        (
            "By number of releases",
            _share_right(_clear_cases(cases), "releases", RELEASE_EDGES, "releases of the fit"),
        ),
        (
            "By noise",
            _share_right(_clear_cases(cases), "noise", NOISE_EDGES, "position noise over block size"),
        ),
        ("Stated and actual probability", _reliability(cases)),
    ]
    rows = [
        (name, _text(value))
        for name, value in summary.items()
        if name not in ("wrong_and_sure", "confused", "sets")
    ]
    wrong = [
        f"case {w['case']}: hidden {w['label']}, verdict {w['verdict']} (probability {w['p']:.2f}, signal-to-noise "
        f"{w['signal_to_noise']:.1f})"
        for w in summary["wrong_and_sure"]
    ]
    pairs = html_table(
        [_pair_cells(pair) for pair in summary["confused"]],
        head=("hidden", "verdict", "cases", "signal-to-noise", "cosine"),
    )
    body = (
        f"<h1>Blind trial of {summary['cases']} cases</h1>"
        f"<p>SHA-256 of the sealed labels: <code>{html.escape(digest)}</code></p>{html_table(rows)}"
        f"<h2>Wrong verdicts with a probability above {CONFIDENT_PROBABILITY:.0%}</h2>{html_list(wrong or ['none'])}"
        "<h2>Wrong verdicts that occurred more than once</h2><p>The cosine is that of the angle between the signatures "
        "of the two effects, without the part that a fit can imitate (median over the cases). Near 1 no method could "
        "distinguish the two; a smaller value shows a weakness of the diagnosis.</p>"
        f"{pairs}{''.join(html_figure(title, figure, image_format='svg') for title, figure in panels)}"
        f"{set_section(sets, summary['sets']) if sets else ''}"
    )
    write_whole(path, html_page("Blind trial", body))


def _pair_cells(confused: dict[str, Any]) -> list[str]:
    """One row of the table of confused pairs."""
    alike = "" if confused["cosine"] is None else f"{confused['cosine']:.2f}"
    strength = f"{confused['median_signal_to_noise']:.1f}"
    return [confused["label"], confused["verdict"], str(confused["count"]), strength, alike]


def _clear_cases(cases: pd.DataFrame) -> pd.DataFrame:
    return cases[(cases["signal_to_noise"] >= CLEAR_SIGNAL_TO_NOISE) | (cases["label"] == "none")]


def _text(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.3g}"
    if isinstance(value, list) and len(value) == 4:
        return share_text(value)
    if isinstance(value, dict):
        return "; ".join(f"{k}: {_text(v)}" for k, v in value.items())
    return str(value)


def _confusion_matrix(cases: pd.DataFrame) -> Figure:
    table = confusion(cases)
    figure, (axes,) = blank_axes(9.5, 8.0)
    share = table.to_numpy() / table.to_numpy().sum(axis=1, keepdims=True)
    axes.imshow(share, cmap="Blues", vmin=0, vmax=1)
    axes.set_xticks(range(table.shape[1]), table.columns, rotation=60, ha="right")
    axes.set_yticks(range(table.shape[0]), table.index)
    axes.set_xlabel("verdict")
    axes.set_ylabel("hidden")
    for (i, k), count in np.ndenumerate(table.to_numpy()):
        if count:
            axes.text(
                k, i, str(count), ha="center", va="center", color="white" if share[i, k] > 0.5 else PAGE_INK
            )
    return figure


def _share_right(cases: pd.DataFrame, column: str, edges: Sequence[float], label: str) -> Figure:
    """Share of right verdicts in bins of a column, with 95 % Wilson intervals."""
    figure, (axes,) = blank_axes(7.0, 3.4)
    groups = (
        (
            "one effect",
            ~cases["label"].isin(["none", "unknown"]) & ~cases["label"].str.contains("+", regex=False),
        ),
        ("outside the catalogue", cases["label"] == "unknown"),
        ("nothing", cases["label"] == "none"),
    )
    bounds = [-np.inf, *edges, np.inf]
    markers = ((-0.12, "o", PAGE_ACCENT), (0.0, "s", PAGE_INK), (0.12, "D", PAGE_WARM))
    for (shift, marker, colour), (name, own) in zip(markers, groups, strict=True):
        for i, (low, high) in enumerate(itertools.pairwise(bounds)):
            part = cases[own & (cases[column] > low) & (cases[column] <= high)]
            if len(part):
                hits = int(part["right"].sum())
                a, b = wilson_interval(hits, len(part))
                share = hits / len(part)
                axes.errorbar(i + shift, share, [[share - a], [b - share]], fmt=marker, color=colour,
                              label=name if name not in axes.get_legend_handles_labels()[1] else None)  # fmt: skip
                axes.annotate(str(len(part)), (i + shift, 0.02), ha="center", fontsize=7, color=colour)
    axes.set_xticks(
        range(len(bounds) - 1), [f"{_edge_text(a)} to {_edge_text(b)}" for a, b in itertools.pairwise(bounds)]
    )
    axes.set_ylim(0, 1.03)
    axes.set_xlabel(label)
    axes.set_ylabel("share right")
    axes.legend(frameon=False, loc="lower right")
    return figure


def _edge_text(value: float) -> str:
    return "…" if not np.isfinite(value) else f"{value:g}"


def _reliability(cases: pd.DataFrame) -> Figure:
    figure, (axes,) = blank_axes(4.2, 4.0)
    p, right = cases["p"].to_numpy(), cases["right"].to_numpy(float)
    axes.plot([0, 1], [0, 1], color=PAGE_RULE)
    for part in np.array_split(np.argsort(p, kind="stable"), min(CALIBRATION_BINS, len(p))):
        low, high = wilson_interval(int(right[part].sum()), len(part))
        share = right[part].mean()
        axes.errorbar(p[part].mean(), share, [[share - low], [high - share]], fmt="o", color=PAGE_ACCENT)
    axes.set_xlabel("probability stated for the verdict")
    axes.set_ylabel("share right")
    return figure
