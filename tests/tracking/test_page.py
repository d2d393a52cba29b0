"""The page of a tracked film is written for whatever the film shows."""

import numpy as np
import pandas as pd
import pytest
from rock2d_tracking.live_frames import live_frames
from rock2d_tracking.looks import Looks
from rock2d_tracking.outline import outline_of
from rock2d_tracking.page import write_page
from rock2d_tracking.setup_file import Setup, write_setup
from rock2d_tracking.tracked_film import TrackedFilm

from rock2d.files.experiment import Experiment
from rock2d.kinematics.film_findings import film_findings
from rock2d.kinematics.film_segments import FilmSegments
from rock2d.kinematics.flights import load_film
from rock2d.kinematics.setup_world import setup_world
from tests.tracking.falls import BLOCKS, CAMERA, CROSS_SECTION, SIZE_PX, falls


def tossed(setup: Setup, frames: int, gravity: float = 9.81) -> TrackedFilm:
    """One toss of a sphere that is still in the air at the end, as tracked."""
    rng = np.random.default_rng(np.random.SeedSequence(4))
    t = np.arange(frames) / 100.0
    x, y = 0.3 * t, 0.1 + 1.5 * t - 0.5 * gravity * t**2
    table = pd.DataFrame({"release": 0, "block": "sphere", "t_s": t, "x_m": x, "y_m": y, "theta_rad": 0.0})
    table[["x_m", "y_m"]] += rng.normal(size=(frames, 2)) * 1e-4
    experiment = Experiment("toss", 9.81, 100.0, 1e-4, 0.01, CROSS_SECTION, dict(BLOCKS), trajectories=table)
    pixels = CAMERA.to_pixel(table[["x_m", "y_m"]].to_numpy())
    frame = pd.DataFrame({
        "release": 0, "block": "sphere", "frame": np.arange(frames), "t_s": t, "u_px": pixels[:, 0],
        "v_px": pixels[:, 1], "angle_px_rad": 0.0, "u_error_px": 0.1, "v_error_px": 0.1, "angle_error_rad": np.nan,
        "confidence": 0.9, "reason": "", **table[["x_m", "y_m", "theta_rad"]],
    })  # fmt: skip
    world = setup_world(experiment)
    data = FilmSegments.of(load_film(experiment), world)
    findings = film_findings(data, world, experiment.fps)
    return TrackedFilm(setup, frame, experiment, data, findings, [], {"sphere": 0.4})


@pytest.mark.parametrize("frames", [25, 5])
def test_a_film_without_an_impact_or_a_flight_gets_its_page(tmp_path, frames):
    write_setup(tmp_path / "setup.yaml", falls(), CAMERA, ["sphere"])
    found = tossed(Setup(tmp_path / "setup.yaml"), frames)
    assert len(found.impacts) == 0 and len(found.flights) == (frames > 8)
    still = np.zeros(SIZE_PX[::-1], np.uint8)
    looks = {"sphere": Looks("outline", outline_of(BLOCKS["sphere"], CAMERA.metres_per_pixel, CAMERA.up))}
    live = live_frames([still] * frames, found, np.arange(frames), looks, still)
    write_page(tmp_path / "page.html", found, still, live)
    page = (tmp_path / "page.html").read_text()
    assert "angle not measured" in page
    assert f"{len(found.flights)}, 0" in page and page.count("<img") == 5 and "nan" not in page
