"""The page of a tracked film is written for whatever the film shows."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from rock2d_tracking.page import write_page
from rock2d_tracking.tracked_film import TrackedFilm
from rock2d_tracking.velocities import flights_and_impacts

from rock2d.files.experiment import Experiment
from rock2d.kinematics.flights import load_film
from tests.tracking.falls import BLOCKS, CAMERA, CROSS_SECTION, SIZE_PX


def tossed(frames: int, gravity: float = 9.81) -> TrackedFilm:
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
        "v_px": pixels[:, 1], "angle_error_rad": np.nan, "confidence": 0.9, "reason": "",
    })  # fmt: skip
    return TrackedFilm(experiment, frame, [], {"sphere": 0.4})


@pytest.mark.parametrize("frames", [25, 5])
def test_a_film_without_an_impact_or_a_flight_gets_its_page(tmp_path, frames):
    found = tossed(frames)
    flights, impacts, data = flights_and_impacts(load_film(found.experiment), found.experiment)
    assert len(impacts) == 0 and len(flights) == (frames > 8)
    write_page(tmp_path / "page.html", found, flights, impacts, data, np.zeros(SIZE_PX[::-1], np.uint8))
    page = (tmp_path / "page.html").read_text()
    assert "angle not measured" in page
    assert f"{len(flights)}, 0" in page and page.count("<img") == 5 and "nan" not in page
