"""The trial's page: one HTML file with its figures, no network and no script."""

from __future__ import annotations

import base64
import html
import io
import itertools
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rock2d.blind.scoring import BINS, CLEAR, LEVELS, confusion
from rock2d.files.folders import write_whole
from rock2d.statistics import wilson_interval

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INK, ACCENT, WARM = "#2b2b2b", "#0072b2", "#d55e00"
STYLE = (
    "body{font:15px/1.5 system-ui,sans-serif;max-width:62rem;margin:2rem auto;color:#2b2b2b;padding:0 1rem}"
    "td{padding:.15rem .8rem .15rem 0;border-bottom:1px solid #eee;vertical-align:top}img{max-width:100%}"
)


def write_page(cases: pd.DataFrame, summary: dict[str, Any], digest: str, path: Path) -> None:
    """Write the page of a scored trial."""
    figures = [
        ("Which was hidden, which was named", _matrix(cases)),
        ("By signal-to-noise", _curve(cases, "signal_to_noise", np.array(LEVELS[1:-1]), "signal-to-noise")),
        (
            "By number of releases",
            _curve(_clear(cases), "releases", np.array([20, 40, 80, 119]), "releases of the fit"),
        ),
        (
            "By noise",
            _curve(_clear(cases), "noise", np.array([0.004, 0.008, 0.015]), "position noise over block size"),
        ),
        ("Stated and actual probability", _reliability(cases)),
    ]
    rows = "".join(f"<tr><td>{html.escape(k)}</td><td>{html.escape(_text(v))}</td></tr>" for k, v in summary.items()
                   if k not in ("wrong_and_sure", "confused"))  # fmt: skip
    wrong = "".join(
        f"<li>case {w['case']}: {w['label']} taken for {w['verdict']} (p {w['p']:.2f}, signal-to-noise "
        f"{w['signal_to_noise']:.1f})</li>"
        for w in summary["wrong_and_sure"]
    )
    pairs = "".join(
        f"<tr>{''.join(f'<td>{html.escape(t)}</td>' for t in _pair(c))}</tr>" for c in summary["confused"]
    )
    heads = "".join(f"<td><b>{t}</b></td>" for t in ("hidden", "named", "cases", "signal-to-noise", "alike"))
    pictures = "".join(f"<h2>{title}</h2><img alt='{title}' src='{_embedded(f)}'>" for title, f in figures)
    seal = f"SHA-256 of the sealed labels: <code>{digest}</code>"
    write_whole(
        path,
        f"<!doctype html><html lang='en'><meta charset='utf-8'><title>Blind trial</title><style>{STYLE}</style>"
        f"<h1>Blind trial of {summary['cases']} cases</h1><p>{seal}</p><table>{rows}</table>"
        f"<h2>Wrong with more than 80 %</h2><ul>{wrong or '<li>none</li>'}</ul>"
        f"<h2>Confused more than once</h2><p>“Alike” is the cosine of the angle between the two signatures once all "
        f"that is free in a fit is projected out (median over the cases): near 1 none could tell them apart there; "
        f"well below, it is a weakness of this one.</p><table><tr>{heads}</tr>{pairs}</table>{pictures}</html>\n",
    )


def _pair(confused: dict[str, Any]) -> list[str]:
    """One line of the table of confused pairs."""
    alike = "" if confused["cosine"] is None else f"{confused['cosine']:.2f}"
    strength = f"{confused['median_signal_to_noise']:.1f}"
    return [confused["label"], confused["verdict"], str(confused["count"]), strength, alike]


def _clear(cases: pd.DataFrame) -> pd.DataFrame:
    return cases[(cases["signal_to_noise"] >= CLEAR) | (cases["label"] == "none")]


def _text(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.3g}"
    if isinstance(value, list) and len(value) == 4:
        return f"{100 * value[0]:.1f} % [{100 * value[1]:.1f}, {100 * value[2]:.1f}] of {value[3]}"
    if isinstance(value, dict):
        return "; ".join(f"{k}: {_text(v)}" for k, v in value.items())
    return str(value)


def _axes(width: float, height: float) -> tuple[Figure, Axes]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    axes = figure.subplots()
    axes.spines[["top", "right"]].set_visible(False)
    return figure, axes


def _matrix(cases: pd.DataFrame) -> Figure:
    table = confusion(cases)
    figure, axes = _axes(9.5, 8.0)
    share = table.to_numpy() / table.to_numpy().sum(axis=1, keepdims=True)
    axes.imshow(share, cmap="Blues", vmin=0, vmax=1)
    axes.set_xticks(range(table.shape[1]), table.columns, rotation=60, ha="right")
    axes.set_yticks(range(table.shape[0]), table.index)
    axes.set_xlabel("named")
    axes.set_ylabel("hidden")
    for (i, k), count in np.ndenumerate(table.to_numpy()):
        if count:
            axes.text(k, i, str(count), ha="center", va="center", color="white" if share[i, k] > 0.5 else INK)
    return figure


def _curve(cases: pd.DataFrame, column: str, edges: np.ndarray, label: str) -> Figure:
    """Share of right verdicts in bins of a column, with 95 % Wilson intervals."""
    figure, axes = _axes(7.0, 3.4)
    groups = (
        (
            "one effect",
            ~cases["label"].isin(["none", "unknown"]) & ~cases["label"].str.contains("+", regex=False),
        ),
        ("outside the catalogue", cases["label"] == "unknown"),
        ("nothing", cases["label"] == "none"),
    )
    bounds = [-np.inf, *edges, np.inf]
    looks = ((-0.12, "o", ACCENT), (0.0, "s", INK), (0.12, "D", WARM))
    for (shift, marker, colour), (name, own) in zip(looks, groups, strict=True):
        for i, (low, high) in enumerate(itertools.pairwise(bounds)):
            part = cases[own & (cases[column] > low) & (cases[column] <= high)]
            if len(part):
                hits = int(part["right"].sum())
                a, b = wilson_interval(hits, len(part))
                share = hits / len(part)
                axes.errorbar(i + shift, share, [[share - a], [b - share]], fmt=marker, color=colour,
                              label=name if i == len(bounds) - 2 else None)  # fmt: skip
                axes.annotate(str(len(part)), (i + shift, 0.02), ha="center", fontsize=7, color=colour)
    axes.set_xticks(
        range(len(bounds) - 1), [f"{_edge(a)} to {_edge(b)}" for a, b in itertools.pairwise(bounds)]
    )
    axes.set_ylim(0, 1.03)
    axes.set_xlabel(label)
    axes.set_ylabel("share right")
    axes.legend(frameon=False, loc="lower right")
    return figure


def _edge(value: float) -> str:
    return "…" if not np.isfinite(value) else f"{value:g}"


def _reliability(cases: pd.DataFrame) -> Figure:
    figure, axes = _axes(4.2, 4.0)
    p, right = cases["p"].to_numpy(), cases["right"].to_numpy(float)
    axes.plot([0, 1], [0, 1], color="#bbbbbb")
    for part in np.array_split(np.argsort(p, kind="stable"), min(BINS, len(p))):
        low, high = wilson_interval(int(right[part].sum()), len(part))
        share = right[part].mean()
        axes.errorbar(p[part].mean(), share, [[share - low], [high - share]], fmt="o", color=ACCENT)
    axes.set_xlabel("probability stated for the verdict")
    axes.set_ylabel("share right")
    return figure


def _embedded(figure: Figure) -> str:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="svg", metadata={"Date": None})
    return "data:image/svg+xml;base64," + base64.b64encode(buffer.getvalue()).decode()
