"""The page of diagnostics of a tracked film: how far it can be trusted, and where not."""

from __future__ import annotations

import base64
import html
import io
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from rock2d.files.folders import write_whole
from rock2d.kinematics.film_segments import FilmSegments
from rock2d_tracking.recording import Record

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = np.ndarray

INK, ACCENT, WARM = "#2b2b2b", "#0072b2", "#d55e00"
STYLE = (
    "body{font:15px/1.5 system-ui,sans-serif;max-width:62rem;margin:2rem auto;color:#2b2b2b;padding:0 1rem}"
    "td,th{padding:.15rem .8rem .15rem 0;border-bottom:1px solid #eee;text-align:left}img,video{max-width:100%}"
)
BINS = 10  # of the sub-pixel position


def write_page(
    path: Path,
    record: Record,
    flights: pd.DataFrame,
    impacts: pd.DataFrame,
    data: FilmSegments,
    background: Array,
) -> None:
    """Write the page; `overlay.webm` lies beside it."""
    frames = record.frames
    lost = frames[frames["reason"] != ""]
    reasons = lost["reason"].value_counts()
    rows = {
        "releases": f"{frames['release'].nunique()}",
        "frames trusted": f"{(frames['reason'] == '').sum()} of {len(frames)}",
        "flights, impacts": f"{len(flights)}, {len(impacts)}",
        "noise of a frame": f"{1e3 * record.experiment.position_noise_m:.3g} mm, "
        f"{np.rad2deg(record.experiment.angle_noise_rad):.2g}°",
        "misfit of the parabolas, over the noise": f"{flights['misfit'].median():.2f} (1 is what noise makes)",
        "impacts flagged": f"{(impacts['flag'] != '').sum()} "
        f"(deep {impacts['flag'].str.contains('deep').sum()}, low rebound {impacts['flag'].str.contains('low').sum()})",
    } | {f"lost: {reason}": f"{count} frames" for reason, count in reasons.items()}  # fmt: skip
    table = "".join(f"<tr><td>{html.escape(k)}</td><td>{html.escape(v)}</td></tr>" for k, v in rows.items())
    figures = [
        ("Tracks", "Trusted frames on the still picture of the film.", _tracks(frames, background)),
        ("Flights", "What the parabolas leave, in px, against time within the flight. A pattern is a lens, a tilt, a "
         "wrong frame rate or air; mere noise is a good track.", _residuals(record, data)),
        ("Sub-pixel bias", "Mean of what the parabolas leave, by the place of the centre within its pixel. A wave "
         "would mean that the tracker favours some places.", _bias(record, data)),
        ("Trust", "Confidence of every frame, release after release; lost ones at 0.", _trust(frames)),
    ]  # fmt: skip
    remarks = "".join(f"<li>{html.escape(r)}</li>" for r in record.remarks)
    pictures = "".join(
        f"<h2>{title}</h2><p>{text}</p><img alt='{title}' src='{_embedded(f)}'>" for title, text, f in figures
    )
    name = html.escape(record.experiment.name)
    write_whole(
        path,
        f"<!doctype html><html lang='en'><meta charset='utf-8'><title>{name}: tracked</title><style>{STYLE}</style>"
        f"<h1>{name}: tracked</h1><ul>{remarks}</ul><table>{table}</table>"
        f"<video controls src='overlay.webm'></video>{pictures}</html>\n",
    )


def _axes(width: float, height: float, columns: int = 1) -> tuple[Figure, list[Axes]]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    axes = np.atleast_1d(figure.subplots(1, columns))
    for own in axes:
        own.spines[["top", "right"]].set_visible(False)
    return figure, list(axes)


def _tracks(frames: pd.DataFrame, background: Array) -> Figure:
    figure, (axes,) = _axes(9.0, 9.0 * background.shape[0] / background.shape[1])
    axes.imshow(background, cmap="gray", vmin=0, vmax=255)
    for _, own in frames[frames["reason"] == ""].groupby("release"):
        axes.plot(own["u_px"], own["v_px"], lw=0.8)
    axes.set_xlabel("u (px)")
    axes.set_ylabel("v (px)")
    return figure


def _flight_residuals(record: Record, data: FilmSegments) -> tuple[Array, Array, Array]:
    """What parabolas leave of each frame of the flights: (n, 3) in m, m, rad; time within the flight (-1 to 1); row of
    the frame among those trusted."""
    left, when, rows = [], [], []
    for a, b in zip(data.segmentation.flights.first, data.segmentation.flights.last, strict=True):
        t = np.linspace(-1.0, 1.0, b - a)
        basis = np.linalg.qr(np.vander(data.film.t_s[a:b] - data.film.t_s[a:b].mean(), 3))[0]
        pose = data.film.pose[a:b]
        left.append(pose - basis @ (basis.T @ pose))
        when.append(t)
        rows.append(np.arange(a, b))
    return np.concatenate(left), np.concatenate(when), np.concatenate(rows)


def _residuals(record: Record, data: FilmSegments) -> Figure:
    figure, axes = _axes(9.0, 2.8, 3)
    if not len(data.segmentation.flights):
        return figure
    left, when, _ = _flight_residuals(record, data)
    scale = [1.0 / _pixel(record), 1.0 / _pixel(record), 180 / np.pi]
    for k, (own, name) in enumerate(zip(axes, ("x (px)", "y (px)", "angle (°)"), strict=True)):
        own.plot(when, left[:, k] * scale[k], ".", ms=1.5, color=ACCENT, alpha=0.3)
        own.set_xlabel("begin to end of a flight")
        own.set_ylabel(name)
    return figure


def _bias(record: Record, data: FilmSegments) -> Figure:
    figure, axes = _axes(7.0, 2.8, 2)
    if not len(data.segmentation.flights):
        return figure
    left, _, rows = _flight_residuals(record, data)
    seen = record.frames[record.frames["reason"] == ""].sort_values(["release", "t_s"], kind="stable")
    for own, column, k in zip(axes, ("u_px", "v_px"), (0, 1), strict=True):
        within = seen[column].to_numpy(float)[rows] % 1.0
        which = np.minimum((within * BINS).astype(int), BINS - 1)
        own.axhline(0.0, color="#bbbbbb")
        for i in range(BINS):
            part = left[which == i, k] / _pixel(record)
            if len(part) > 2:
                error = part.std() / np.sqrt(len(part))
                own.errorbar((i + 0.5) / BINS, part.mean(), 1.96 * error, fmt="o", ms=3, color=ACCENT)
        own.set_xlabel(f"place of {column[0]} within its pixel")
        own.set_ylabel("mean left (px)")
    return figure


def _trust(frames: pd.DataFrame) -> Figure:
    figure, (axes,) = _axes(9.0, 2.6)
    axes.plot(np.arange(len(frames)), frames["confidence"], lw=0.5, color=ACCENT)
    for start in np.flatnonzero(np.diff(frames["release"].to_numpy()) != 0):
        axes.axvline(float(start) + 1.0, color="#bbbbbb", lw=0.5)
    axes.set_ylim(0, 1.02)
    axes.set_xlabel("frame")
    axes.set_ylabel("confidence")
    return figure


def _pixel(record: Record) -> float:
    """Metres per pixel, from the record itself."""
    seen = record.frames[record.frames["reason"] == ""]
    table = record.experiment.trajectories
    assert table is not None
    return float(np.ptp(table["x_m"]) / max(np.ptp(seen["u_px"]), 1e-9))


def _embedded(figure: Figure) -> str:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=110)
    return "data:image/png;base64," + base64.b64encode(buffer.getvalue()).decode()
