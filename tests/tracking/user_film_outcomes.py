"""A film as users make it, tracked by the command as they do, and what came of it against the truth."""

import json
import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd
from click.testing import CliRunner

from rock2d.cli import cli
from rock2d.errors import InputError
from rock2d.files.experiment import load_experiment
from rock2d.kinematics.flights import CONTACT_MARGIN_FRAMES, FEWEST_FLIGHT_FRAMES
from tests.tracking.real_looks import REST_FRAMES, RealFrame
from tests.tracking.user_films import GRAVITY_M_S2, SUFFIXES, UserFilm, write_user_film

Array = np.ndarray

GROSS_PX = 3.0
SAME_BOUNCE_FRAMES = 3.0  # between a true bounce and the measured one
MEASURED_FRAMES = FEWEST_FLIGHT_FRAMES + 2 * CONTACT_MARGIN_FRAMES  # of a flight between two bounces
LEAST_RADII = 1.0  # median distance from which on something else was tracked


@dataclass
class FilmOutcome:
    """What was made of one film.

    Attributes
    ----------
    said : what the command said
    free, found : frames in which the ball is whole and free, and those of them that are trusted
    misses, ratios : (n, 2) errors of the trusted frames in px beside their median, and over their stated errors
    offset_px : length of this median
    g_sigmas : error of g over its standard error, NaN if g was not found
    rate_sigmas : (2,) error of the frame rate over its standard error, as the command proposes it to a user who stated
        a wrong one, and as `--fps gravity` finds it; NaN if the user stated the true one
    restitution : (n, 2) errors of the restitutions at true bounces, and their standard errors
    bounces : number of true bounces between flights that are long enough to be measured
    mid_air : impacts where there is none"""

    film: UserFilm
    said: str
    free: int = 0
    found: int = 0
    misses: Array = field(default_factory=lambda: np.empty((0, 2)))
    ratios: Array = field(default_factory=lambda: np.empty((0, 2)))
    offset_px: float = np.nan
    g_sigmas: float = np.nan
    rate_sigmas: Array = field(default_factory=lambda: np.full(2, np.nan))
    restitution: Array = field(default_factory=lambda: np.empty((0, 2)))
    bounces: int = 0
    mid_air: int = 0

    @property
    def tracked(self) -> bool:
        """Whether the ball was tracked."""
        return len(self.misses) > 0 and self.offset_px < LEAST_RADII * self.film.look.radius_px

    @property
    def gross(self) -> int:
        """Trusted frames that are off by more than `GROSS_PX`."""
        return int((np.hypot(*self.misses.T) > GROSS_PX).sum())


def tracked_by_command(film: UserFilm, folder: Path) -> FilmOutcome:
    """Film it, track it with `rock2d track` from scale and frame rate alone, and compare."""
    kind = film.camera
    path = folder / f"film{SUFFIXES[kind.file]}"
    truth = write_user_film(path, film)
    free = sum(f.free for f in truth)
    out = folder / "out"
    found = FilmOutcome(film, "", free, bounces=_measurable(film))
    try:
        found.said = _tracked(path, kind.metres_per_pixel, kind.stated_fps or kind.fps, out)
    except InputError as error:
        found.said = str(error)
        proposed = re.search(r"taken with ([\d.]+) ± ([\d.]+) frames/s", found.said)
        if not kind.stated_fps or proposed is None:
            return found
        value, sigma = map(float, proposed.groups())
        found.said = _tracked(path, kind.metres_per_pixel, "gravity", out)
        own = load_experiment(out)
        sigmas = sigma, own.fps * own.from_gravity.relative_error
        found.rate_sigmas = (np.array([value, own.fps]) - kind.fps) / sigmas
    _compare_places(found, truth, pd.read_csv(out / "frames.csv"))
    said = json.loads((out / "film.json").read_text())["gravity"]
    if said is not None:
        found.g_sigmas = (said["value_m_s2"] - GRAVITY_M_S2) / said["error_m_s2"]
    _compare_impacts(found, pd.read_csv(out / "measured_impacts.csv"), pd.read_csv(out / "frames.csv"))
    return found


def _tracked(path: Path, metres_per_pixel: float, fps: float | str, out: Path) -> str:
    words = ["track", path, "--metres-per-pixel", metres_per_pixel, "--fps", fps, "--out", out, "--quiet"]
    return CliRunner().invoke(cli, [str(w) for w in words], catch_exceptions=False, standalone_mode=False).output


def _measurable(film: UserFilm) -> int:
    begins = np.array([0.0, *(film.bounces - REST_FRAMES), film.camera.frames - 1.0 - REST_FRAMES])
    long = np.diff(begins) >= MEASURED_FRAMES
    return int((long[1:] & long[:-1]).sum())


def _compare_places(found: FilmOutcome, truth: list[RealFrame], frames: pd.DataFrame) -> None:
    own = frames[frames["reason"].isna() & (frames["frame"] < len(truth))]
    if not len(own):
        return
    off = own[["u_px", "v_px"]].to_numpy(float) - np.array([truth[k].pose[:2] for k in own["frame"]])
    offset = np.median(off, axis=0)
    found.offset_px = float(np.hypot(*offset))
    found.misses = off - offset
    found.ratios = found.misses / own[["u_error_px", "v_error_px"]].to_numpy(float)
    found.found = sum(truth[k].free for k in own["frame"].unique())


def _compare_impacts(found: FilmOutcome, impacts: pd.DataFrame, frames: pd.DataFrame) -> None:
    """Impacts at true bounces, and impacts in mid-air; those that are flagged as no impact count as neither."""
    instants = found.film.instants
    begins = frames.groupby("release")["frame"].min().clip(upper=len(instants) - 1)
    own = impacts[~impacts["flag"].fillna("").str.contains("mid-air")] if len(impacts) else impacts
    instant = instants[own["release"].map(begins)] + own["t_s"] * found.film.camera.fps
    when = np.interp(instant, instants, np.arange(len(instants)))
    rows = []
    for at, (_, row) in zip(when, own.iterrows(), strict=True):
        if not len(found.film.bounces) or np.abs(found.film.bounces - at).min() > SAME_BOUNCE_FRAMES:
            found.mid_air += 1
            continue
        rows.append((row["restitution"] - found.film.look.restitution, row["restitution_se"]))
    found.restitution = np.array(rows).reshape(-1, 2)


def outcome_line(name: str, outcomes: list[FilmOutcome]) -> str:
    """What was made of some films, on one line."""
    own = [o for o in outcomes if o.tracked]
    free, found = sum(o.free for o in outcomes), sum(o.found for o in own)
    off = np.concatenate([o.misses for o in own]) if own else np.empty((0, 2))
    ratios = np.concatenate([o.ratios for o in own]) if own else np.empty((0, 2))
    sigmas = np.array([o.g_sigmas for o in own if np.isfinite(o.g_sigmas) and not o.film.camera.lens])
    bounced = np.concatenate([o.restitution for o in own]) if own else np.empty((0, 2))
    rms, honest = (np.sqrt((a**2).mean()) if len(a) else np.nan for a in (off, ratios))
    middle = np.sqrt(np.median(ratios**2) / 0.4549) if len(ratios) else np.nan
    worst = np.abs(bounced[:, 0]).max() if len(bounced) else np.nan
    within = int((np.abs(bounced[:, 0]) < 2 * bounced[:, 1]).sum())
    usual = np.median(np.abs(bounced[:, 0])) if len(bounced) else np.nan
    offsets = [o.offset_px for o in own]
    rates = np.array([o.rate_sigmas for o in own if np.isfinite(o.rate_sigmas).all()]).reshape(-1, 2)
    rated = [f"{int((np.abs(r) <= 2).sum())}/{len(r)}" for r in rates.T] if len(rates) else []
    rate = f"rate proposed {rated[0]}, found {rated[1]} {rates[0].round(1)}  " if rated else ""
    off_g = f" ({sigmas[0]:+.1f} se)" if len(outcomes) == 1 and len(sigmas) else ""
    return (
        f"{name:36s} tracked {len(own)}/{len(outcomes)}  trusted {found:4d}/{free:4d} = {found / max(free, 1):.3f}  "
        f"offset {np.median(offsets) if offsets else np.nan:.2f}  rms {rms:.2f} px  "
        f"gross {sum(o.gross for o in own)}/{len(off)}  error/se {middle:.2f} {honest:.2f}  "
        f"g {int((np.abs(sigmas) <= 2).sum())}/{len(sigmas)}{off_g}  {rate}"
        f"restitution {usual:.3f} (worst {worst:.3f}, {within} in 2 se of {len(bounced)})  "
        f"of {sum(o.bounces for o in outcomes)}, mid-air {sum(o.mid_air for o in own)}"
    )
