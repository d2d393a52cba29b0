"""The page of diagnostics of a tracked film: its accuracy and its problems."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from rock2d.arrays import Array
from rock2d.errors import counted
from rock2d.files.folders import write_whole
from rock2d.graphics.pages import PAGE_ACCENT, PAGE_RULE, Section, Table, blank_axes, drawn, live_page
from rock2d.kinematics.film_segments import FilmSegments
from rock2d_tracking.film_tables import FLAGS, MID_AIR
from rock2d_tracking.live_frames import LiveFrames
from rock2d_tracking.tracked_film import TrackedFilm

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LISTED_IMPACTS = 8  # up to this many, the restitution of each impact is listed
SUBPIXEL_BINS = 10  # bins of the position of a centre within its pixel


def write_page(path: Path, film: TrackedFilm, still: Array, live: LiveFrames) -> None:
    """Write the page; `overlay.webm` must be in the same folder."""
    frames, name = film.frames, film.experiment.name
    figures = [
        ("Tracks", "Trusted frames on the still picture of the film.", _tracks(frames, still)),
        ("Gravity", "Acceleration of each flight that shows it, with its 95 % interval. The band is what all flights "
         "say together, the line the stated gravity: beside the band, scale or frame rate is wrong.",
         _gravity(film)),
        ("Flights", "Residuals of the parabolas against the time within the flight. A pattern means a lens, a tilt, a "
         "wrong frame rate or air; noise alone means a good track.", _residuals(film)),
        ("Sub-pixel bias", "Mean residuals of the parabolas by the place of the centre within its pixel. A wave means "
         "that the tracker prefers some places.", _bias(film)),
        ("Trust", "Confidence of every frame, release after release; lost frames have 0.", _trust(frames)),
    ]  # fmt: skip
    above = [
        Section(items=film.remarks),
        Section("What the film says of itself", items=film.findings.sentences(), video="overlay.webm",
                tables=[Table((), list(_summary(film).items()))]),
    ]  # fmt: skip
    below = [Section(title, [text], pictures=[drawn(figure, title)]) for title, text, figure in figures]
    write_whole(path, live_page(f"{name}: tracked", above, "live_frames", live, below))


def _summary(film: TrackedFilm) -> dict[str, str]:
    """Label -> value of the table at the top of the page."""
    flights, impacts = film.flights, film.impacts
    frames, experiment, beside = film.frames, film.experiment, int((impacts["flag"] == MID_AIR).sum())
    own = impacts[impacts["flag"] != MID_AIR].astype({"flag": str})
    lost = frames.loc[frames["reason"] != "", "reason"].value_counts()
    angles = frames["angle_error_rad"].notna().any()
    angle_noise = f"{np.rad2deg(experiment.angle_noise_rad):.2g}°" if angles else "angle not measured"
    return {
        "releases": f"{frames['release'].nunique()}",
        "frames trusted": f"{(frames['reason'] == '').sum()} of {len(frames)}",
        "flights, impacts": f"{len(flights)}, {len(own)}" + (f"; changes in mid-air: {beside}" if beside else ""),
        "restitution, across the ground": _restitution(own),
        "error that all positions share": ", ".join(
            f"{name} {offset:.2g} px ({1e3 * offset * _pixel_m(film):.2g} mm)"
            for name, offset in film.offset_px.items()
        ),
        "noise of a frame": f"{1e3 * experiment.position_noise_m:.3g} mm, {angle_noise}",
        "residuals of the parabolas, over the noise": f"{flights['misfit'].median():.2f} (noise alone makes 1)"
        if len(flights)
        else "no flight was seen",
        "impacts of less precise velocity": f"{(own['flag'] != '').sum()} of {len(own)} ("
        + ", ".join(f"{word} {own['flag'].str.contains(word).sum()}" for word in FLAGS)
        + "; flags of measured_impacts.csv, which a diagnosis does not use)",
    } | {f"lost: {reason}": counted(count, "frame") for reason, count in lost.items()}


def _restitution(impacts: pd.DataFrame) -> str:
    """The restitution of each impact with its standard error; of many impacts, the range of the middle half."""
    seen = impacts.dropna(subset=["restitution", "restitution_se"])
    if not len(seen):
        return "no impact shows it"
    if len(seen) <= LISTED_IMPACTS:
        pairs = zip(seen["restitution"], seen["restitution_se"], strict=True)
        return ", ".join(f"{value:.3f} ± {error:.3f}" for value, error in pairs)
    low, middle, high = seen["restitution"].quantile([0.25, 0.5, 0.75])
    error = seen["restitution_se"].median()
    return f"{middle:.2f} (half of them {low:.2f} to {high:.2f}), each ± {error:.3f} (medians of {len(seen)} impacts)"


def _tracks(frames: pd.DataFrame, still: Array) -> Figure:
    figure, (axes,) = blank_axes(9.0, 9.0 * still.shape[0] / still.shape[1])
    axes.imshow(still, cmap="gray", vmin=0, vmax=255)
    for _, own in frames[frames["reason"] == ""].groupby("release"):
        axes.plot(own["u_px"], own["v_px"], lw=0.8)
    axes.set_xlabel("u (px)")
    axes.set_ylabel("v (px)")
    return figure


def _flight_residuals(data: FilmSegments) -> tuple[Array, Array, Array]:
    """Residuals of the parabolas in each frame of the flights: (n, 3) in m, m, rad; time within the flight (-1 to 1);
    row of the frame among the trusted ones."""
    residuals, when, rows = [], [], []
    for a, b in zip(data.flights.first, data.flights.last, strict=True):
        t = np.linspace(-1.0, 1.0, b - a)
        basis = np.linalg.qr(np.vander(data.film.t_s[a:b] - data.film.t_s[a:b].mean(), 3))[0]
        pose = data.film.pose[a:b]
        residuals.append(pose - basis @ (basis.T @ pose))
        when.append(t)
        rows.append(np.arange(a, b))
    return np.concatenate(residuals), np.concatenate(when), np.concatenate(rows)


def _residuals(film: TrackedFilm) -> Figure:
    figure, axes = blank_axes(9.0, 2.8, 3)
    if not len(film.segments.flights):
        return figure
    residuals, when, _ = _flight_residuals(film.segments)
    scale = [1.0 / _pixel_m(film), 1.0 / _pixel_m(film), 180 / np.pi]
    for k, (own, name) in enumerate(zip(axes, ("x (px)", "y (px)", "angle (°)"), strict=True)):
        own.plot(when, residuals[:, k] * scale[k], ".", ms=1.5, color=PAGE_ACCENT, alpha=0.3)
        own.set_xlabel("time within the flight (-1 to 1)")
        own.set_ylabel(name)
    return figure


def _bias(film: TrackedFilm) -> Figure:
    figure, axes = blank_axes(7.0, 2.8, 2)
    if not len(film.segments.flights):
        return figure
    residuals, _, rows = _flight_residuals(film.segments)
    seen = film.frames[film.frames["reason"] == ""].sort_values(["release", "t_s"], kind="stable")
    for own, column, k in zip(axes, ("u_px", "v_px"), (0, 1), strict=True):
        within = seen[column].to_numpy(float)[rows] % 1.0
        which = np.minimum((within * SUBPIXEL_BINS).astype(int), SUBPIXEL_BINS - 1)
        own.axhline(0.0, color=PAGE_RULE)
        for i in range(SUBPIXEL_BINS):
            part = residuals[which == i, k] / _pixel_m(film)
            if len(part) > 2:
                error = part.std() / np.sqrt(len(part))
                own.errorbar((i + 0.5) / SUBPIXEL_BINS, part.mean(), 1.96 * error, fmt="o", ms=3, color=PAGE_ACCENT)
        own.set_xlabel(f"place of {column[0]} within its pixel")
        own.set_ylabel("mean residual (px)")
    return figure


def _gravity(film: TrackedFilm) -> Figure:
    from matplotlib.ticker import MaxNLocator

    figure, (axes,) = blank_axes(7.0, 2.8)
    stated = film.experiment.gravity_m_s2
    found = film.findings.gravity
    axes.axhline(stated, color=PAGE_RULE)
    axes.set_xlabel("flight")
    axes.set_ylabel("g (m/s²)")
    if found is None:
        return figure
    axes.axhspan(*found.gravity_m_s2.ci95, color=PAGE_ACCENT, alpha=0.2, lw=0)
    used = np.flatnonzero(found.used)
    axes.errorbar(used + 1, found.each[used], 1.96 * found.each_error[used], fmt="o", ms=3, color=PAGE_ACCENT)
    axes.set_xlim(0.5, len(found.used) + 0.5)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    return figure


def _trust(frames: pd.DataFrame) -> Figure:
    figure, (axes,) = blank_axes(9.0, 2.6)
    axes.plot(np.arange(len(frames)), frames["confidence"], lw=0.5, color=PAGE_ACCENT)
    for start in np.flatnonzero(np.diff(frames["release"].to_numpy()) != 0):
        axes.axvline(float(start) + 1.0, color=PAGE_RULE, lw=0.5)
    axes.set_ylim(0, 1.02)
    axes.set_xlabel("frame")
    axes.set_ylabel("confidence")
    return figure


def _pixel_m(film: TrackedFilm) -> float:
    """Metres per pixel, from the tracked frames."""
    seen = film.frames[film.frames["reason"] == ""]
    metres, pixels = (np.ptp(seen[list(names)], axis=0) for names in (("x_m", "y_m"), ("u_px", "v_px")))
    return float(np.hypot(*metres) / max(np.hypot(*pixels), 1e-9))
