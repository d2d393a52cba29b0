"""Residuals between a film and the simulated releases that were restarted from it: tables, figures, video."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rock2d.files.experiment import seen_frames

if TYPE_CHECKING:
    import pandas as pd

    from rock2d.files.experiment import Experiment
    from rock2d.graphics.figure_files import Figures
    from rock2d.records.track import Track

CHANNELS = {"x": "dx_m", "y": "dy_m", "theta": "dtheta_rad"}


def residual_table(measured: pd.DataFrame, simulated: pd.DataFrame) -> pd.DataFrame:
    """Simulated minus measured poses at every frame: release, block, t_s (since the first frame of the release), dx_m,
    dy_m, dtheta_rad. The angle is unwrapped along the film; the symmetry of the block is not used."""
    import pandas as pd

    key = ["release", "block"]
    rows = measured.dropna().merge(simulated, on=[*key, "t_s"], suffixes=("", "_sim"))
    rows = rows.sort_values(key, kind="stable", ignore_index=True)
    of_release = rows.groupby(key)
    return pd.DataFrame(
        {
            "release": rows["release"],
            "block": rows["block"],
            "t_s": rows["t_s"] - of_release["t_s"].transform("first"),
            "dx_m": rows["x_m_sim"] - rows["x_m"],
            "dy_m": rows["y_m_sim"] - rows["y_m"],
            "dtheta_rad": rows["theta_rad_sim"] - of_release["theta_rad"].transform(np.unwrap),
        }
    )


def residual_summary(residuals: pd.DataFrame, tracks: list[Track], noise: dict[str, float]) -> pd.DataFrame:
    """Residuals by stage and channel. Stages: before the first impact, between the end of it and the second impact,
    whole film, last frame. Columns stage, channel, unit, releases, median_abs, rms, noise (1 sigma of the camera)."""
    import pandas as pd

    first, after, second = {}, {}, {}
    for track in tracks:
        start = float(track.knots[0, 0])
        times = [(i["t_s"] - start, i["t_after_s"] - start) for i in track.impacts]
        first[track.release] = times[0][0] if times else np.inf
        after[track.release] = times[0][1] if times else np.inf
        second[track.release] = times[1][0] if len(times) > 1 else np.inf
    t, release = residuals["t_s"], residuals["release"]
    stages = {
        "flight before first impact": t < release.map(first),
        "flight after first impact": (t > release.map(after)) & (t < release.map(second)),
        "whole film": t >= 0,
        "last frame": ~release.duplicated(keep="last"),
    }
    rows = []
    for stage, chosen in stages.items():
        for channel, column in CHANNELS.items():
            values = residuals.loc[chosen, column].to_numpy(float)
            rows.append(
                {
                    "stage": stage,
                    "channel": channel,
                    "unit": column.rsplit("_", 1)[1],
                    "releases": int(residuals.loc[chosen, "release"].nunique()),
                    "median_abs": float(np.median(np.abs(values))) if values.size else np.nan,
                    "rms": float(np.sqrt(np.mean(values**2))) if values.size else np.nan,
                    "noise": noise[channel],
                }
            )
    return pd.DataFrame(rows)


def write_film_residuals(
    film: Experiment,
    simulated: Experiment,
    tracks: list[Track],
    folder: Path,
    *,
    slow_motion: float,
    progress: bool,
    figures: Figures,
) -> dict[str, pd.DataFrame]:
    """The residual tables of a film and its restarted releases by name. If figures are wanted, also writes overlay and
    residual figures and a side-by-side video into `folder`."""
    from rock2d.graphics.clips import clip_from_measured, clip_from_track
    from rock2d.graphics.overlays import overlay_figure, residuals_figure
    from rock2d.graphics.palette import SIMULATED_COLOUR
    from rock2d.graphics.video import render_video
    from rock2d.graphics.video_frames import VideoOptions
    from rock2d.progress import Bars

    assert film.trajectories is not None and simulated.trajectories is not None
    cross_section, blocks = simulated.cross_section, simulated.blocks
    seen = seen_frames(film)
    measured = seen[seen["release"].isin([t.release for t in tracks])]
    residuals = residual_table(measured, simulated.trajectories)
    noise = {"x": film.position_noise_m, "y": film.position_noise_m, "theta": film.angle_noise_rad}
    summary = residual_summary(residuals, tracks, noise)
    tables = {"residuals": residuals, "residual_summary": summary}
    if not figures.wanted:
        return tables
    title = f"{film.name}: measured against simulated"
    overlay = partial(overlay_figure, title=title)
    figures.save(folder / "overlay.png", overlay, cross_section, dict(blocks), measured, tracks)
    figures.save(folder / "residuals.png", residuals_figure, residuals, title)
    shown = _median_release(residuals)
    track = next(t for t in tracks if t.release == shown)
    with Bars(progress).stage("side by side", 0, "frames") as bar:
        film_clip = clip_from_measured(measured[measured["release"] == shown])
        scene = [[film_clip], [clip_from_track(track, colour=SIMULATED_COLOUR)]]
        render_video(
            folder / "side_by_side.webm", cross_section, blocks, [scene], ("measured", "simulated"),
            VideoOptions(slow_motion=slow_motion, titles=(f"{film.name}, release {shown}",)), bar.reach,
        )  # fmt: skip
    return tables


def _median_release(residuals: pd.DataFrame) -> int:
    """The release with the median rms distance."""
    distance = residuals["dx_m"] ** 2 + residuals["dy_m"] ** 2
    rms = distance.groupby(residuals["release"]).mean().sort_values()
    return int(rms.index[len(rms) // 2])
