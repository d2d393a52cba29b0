"""A first track from scale and frame rate alone, and what a failure leaves behind."""

import re
import shutil

import numpy as np
import pandas as pd
import pytest
from rock2d_tracking import tracked_film
from rock2d_tracking.command import TrackSettings, track
from rock2d_tracking.film_reading import FilmFile
from rock2d_tracking.film_scale import FilmScale
from rock2d_tracking.first_setup import FirstSetup
from rock2d_tracking.motion import Motion
from rock2d_tracking.setup_file import Setup

from rock2d.errors import InputError
from rock2d.files.experiment import load_experiment
from tests.tracking.thrown_ball import FLOOR_PX, FPS, RADIUS_PX, SCALE, write_thrown_ball


@pytest.fixture(scope="module")
def thrown(tmp_path_factory):
    path = tmp_path_factory.mktemp("film") / "thrown ball.avi"
    return path, write_thrown_ball(path)


@pytest.fixture(scope="module")
def first(thrown, tmp_path_factory):
    """The folder of a first track, and what was said. Tests must not change it."""
    said: list[str] = []
    out = tmp_path_factory.mktemp("first") / "out"
    track(thrown[0], FilmScale(SCALE, FPS), out, TrackSettings(explain=True, report=said.append))
    return out, said


def test_scale_and_frame_rate_are_enough(thrown, first):
    (_, places), (out, said) = thrown, first
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


def test_a_set_up_file_that_is_refined_in_its_folder_stays_there(thrown, first, tmp_path):
    out = tmp_path / "out"
    shutil.copytree(first[0], out)
    refined = (out / "setup.yaml").read_text().replace('name: "thrown_ball"', "name: refined")
    (out / "setup.yaml").write_text(refined)
    track(thrown[0], out / "setup.yaml", out, TrackSettings())
    assert (out / "setup.yaml").read_text() == refined
    assert "name: refined" in (out / "experiment.yaml").read_text()


@pytest.mark.parametrize(
    ("stem", "name"),
    [
        *((stem, stem) for stem in ("20240512_143022", "20240512", "1e5", "0x1F", "true", "null", "2024-05-12")),
        ("block no. 3", "block_no__3"),
        ("long" * 50, "long" * 25),
        ("...", "film"),
    ],
)
def test_any_name_of_a_film_makes_a_set_up_file_that_is_read(thrown, stem, name):
    film = FilmFile(thrown[0])
    film.path = film.path.with_name(f"{stem}.mp4")
    scale = FilmScale(SCALE, FPS)
    assert FirstSetup(film, Motion(), scale, scale).setup().keys.name == name


@pytest.mark.parametrize("factor", [0.15, 4])
def test_a_wrong_frame_rate_is_named_where_nothing_can_be_tracked(thrown, tmp_path, factor):
    out = tmp_path / "out"
    with pytest.raises(
        InputError, match=r"nothing was seen to fall .* rate 30 lies .* `--fps 30`, .* camera\.fps"
    ) as raised:
        track(thrown[0], FilmScale(SCALE, factor * FPS), out, TrackSettings())
    assert not out.exists()
    value, error = map(float, re.search(r"with ([\d.]+) ± ([\d.]+) frames/s", str(raised.value)).groups())
    assert abs(value - FPS) < 3 * error < 0.1 * FPS
    metres = float(re.search(r"--metres-per-pixel ([\d.]+)`", str(raised.value)).group(1))
    assert metres == pytest.approx(SCALE / factor**2, rel=0.1)
    text = (tmp_path / "out_explained" / "explanation.txt").read_text()
    assert "write fps: gravity" in text
    assert text.count("\n1. ") == text.count("\n2. ") == text.count("\n3. ") == 1
    left = {p.name for p in (tmp_path / "out_explained").iterdir()}
    assert left >= {"candidates.png", "candidates.webm", "setup.yaml"}
    Setup(tmp_path / "out_explained" / "setup.yaml")  # a file that can be used


@pytest.mark.parametrize(("asked", "key"), [(FilmScale(SCALE, None), "fps"), (FilmScale(None, FPS), "scale")])
def test_gravity_gives_the_frame_rate_or_the_scale(thrown, tmp_path, asked, key):
    said: list[str] = []
    track(thrown[0], asked, tmp_path / "out", TrackSettings(report=said.append))
    found = load_experiment(tmp_path / "out")
    assert found.from_gravity.which == key and "film: the" in said[1] and "taken from gravity" in said[1]
    setup = Setup(tmp_path / "out" / "setup.yaml")
    assert setup.scale == asked  # a better scale, written into this file, gives a better frame rate
    off = found.from_gravity.relative_error
    if key == "fps":
        assert abs(found.fps / FPS - 1.0) < 3 * off < 0.03
    else:
        floor_m = (320 - 1 - FLOOR_PX - RADIUS_PX) * SCALE
        assert found.cross_section.points_m[0, 1] == pytest.approx(floor_m, abs=6 * SCALE)
        way_m = np.ptp(found.trajectories["x_m"])
        assert abs(way_m / (np.ptp(thrown[1][:, 0]) * SCALE) - 1.0) < 0.05
    assert pd.read_csv(tmp_path / "out" / "flights.csv")["gravity_m_s2"].isna().all()
    track(thrown[0], tmp_path / "out" / "setup.yaml", tmp_path / "again", TrackSettings(report=said.append))
    again = load_experiment(tmp_path / "again")
    assert again.from_gravity.which == key and again.fps == pytest.approx(found.fps, rel=0.01)


def test_a_block_that_is_followed_but_not_trusted_is_told_with_numbers(thrown, tmp_path, monkeypatch):
    monkeypatch.setattr(tracked_film, "LARGEST_STATED_ERROR_PX", 0.0)
    monkeypatch.setattr(tracked_film, "LARGEST_STATED_ERROR_RADII", 0.0)
    with pytest.raises(InputError, match=r"followed from frame \d+ to \d+, .*known to .* px .*'unsure'.*camera\.scale"):
        track(thrown[0], FilmScale(SCALE, FPS), tmp_path / "out", TrackSettings())
    left = {p.name for p in (tmp_path / "out_explained").iterdir()}
    assert left >= {"candidates.png", "candidates.webm", "setup.yaml", "overlay.webm", "explanation.txt"}
