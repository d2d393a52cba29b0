"""A first track from scale and frame rate alone, and what a failure leaves behind."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from rock2d_tracking import tracked_film
from rock2d_tracking.command import FirstScale, TrackSettings, track
from rock2d_tracking.setup_file import Setup

from rock2d.errors import InputError
from tests.tracking.thrown_ball import FLOOR_PX, FPS, RADIUS_PX, SCALE, write_thrown_ball


@pytest.fixture(scope="module")
def thrown(tmp_path_factory):
    path = tmp_path_factory.mktemp("film") / "thrown ball.avi"
    return path, write_thrown_ball(path)


def test_scale_and_frame_rate_are_enough(thrown, tmp_path):
    film, places = thrown
    said: list[str] = []
    out = tmp_path / "out"
    track(film, FirstScale(SCALE, FPS), out, TrackSettings(explain=True, report=said.append))
    frames = pd.read_csv(out / "frames.csv")
    seen = frames[frames["reason"].isna()]
    assert len(seen) > 38
    off = seen[["u_px", "v_px"]].to_numpy() - places[seen["frame"]]
    assert np.sqrt((off**2).mean()) < 0.3
    setup = Setup(out / "setup.yaml")
    assert setup.blocks["ball"].size_m / 2 / SCALE == pytest.approx(RADIUS_PX, rel=0.03)
    floor = FLOOR_PX + RADIUS_PX
    assert (319 - setup.cross_section.points_m[0, 1] / SCALE) == pytest.approx(floor, abs=6.0)
    text = (out / "explanation.txt").read_text()
    assert "releases that arcs show: 1" in text
    assert (out / "candidates.webm").stat().st_size > 0 and (out / "candidates.png").stat().st_size > 0
    assert any("set-up file to refine" in line for line in said)


def test_a_set_up_file_that_is_refined_in_its_folder_stays_there(thrown, tmp_path):
    out = tmp_path / "out"
    track(thrown[0], FirstScale(SCALE, FPS), out, TrackSettings())
    refined = (out / "setup.yaml").read_text().replace("name: thrown_ball", "name: refined")
    (out / "setup.yaml").write_text(refined)
    track(thrown[0], out / "setup.yaml", out, TrackSettings())
    assert (out / "setup.yaml").read_text() == refined
    assert "name: refined" in (out / "experiment.yaml").read_text()


def test_a_wrong_frame_rate_is_named_where_nothing_can_be_tracked(thrown, tmp_path):
    out = tmp_path / "out"
    with pytest.raises(InputError, match=r"nothing was seen to fall .* camera\.fps"):
        track(thrown[0], FirstScale(SCALE, 4 * FPS), out, TrackSettings())
    assert not out.exists()
    text = (tmp_path / "out_explained" / "explanation.txt").read_text()
    assert "0.25 times the frame rate" in text
    assert text.count("\n1. ") == text.count("\n2. ") == text.count("\n3. ") == 1
    left = {p.name for p in (tmp_path / "out_explained").iterdir()}
    assert left >= {"candidates.png", "candidates.webm", "setup.yaml"}
    Setup(tmp_path / "out_explained" / "setup.yaml")  # a file that can be used


def test_a_block_that_is_followed_but_not_trusted_is_told_with_numbers(thrown, tmp_path, monkeypatch):
    monkeypatch.setattr(tracked_film, "LARGEST_STATED_ERROR_PX", 0.0)
    monkeypatch.setattr(tracked_film, "LARGEST_ERROR_RADII", 0.0)
    with pytest.raises(
        InputError, match=r"followed from frame \d+ to \d+, .*known to .* px .*'unsure'.*camera\.scale"
    ):
        track(thrown[0], FirstScale(SCALE, FPS), tmp_path / "out", TrackSettings())
    left = {p.name for p in (tmp_path / "out_explained").iterdir()}
    assert left >= {"candidates.png", "candidates.webm", "setup.yaml", "overlay.webm", "explanation.txt"}
