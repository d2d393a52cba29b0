"""`rock2d.track`: a film and a set-up in, a result out that shows itself, is written and can be diagnosed."""

import webbrowser

import numpy as np
import pandas as pd
import pytest
from ruamel.yaml import YAML

import rock2d
from rock2d.errors import InputError
from tests.programs import printed, refusal
from tests.tracking.thrown_ball import FPS, RESTITUTION, SCALE, write_thrown_ball


@pytest.fixture(scope="module")
def film(tmp_path_factory):
    path = tmp_path_factory.mktemp("film") / "thrown.avi"
    write_thrown_ball(path)
    return path


@pytest.fixture(scope="module")
def found(film):
    return rock2d.track(film, metres_per_pixel=SCALE, fps=FPS)


@pytest.fixture(scope="module")
def written(found, tmp_path_factory):
    """The folder of the result. Tests must not change it."""
    folder = tmp_path_factory.mktemp("track") / "out"
    found.write(folder)
    return folder


def test_a_track_has_frames_flights_impacts_and_an_experiment(found):
    frames = found.to_pandas()
    trusted = frames["reason"] == ""
    assert trusted.sum() > 38 and frames.loc[~trusted, ["x_m", "y_m"]].isna().all(axis=None)
    for axis, column, sign in (("x_m", "u_px", 1), ("y_m", "v_px", -1)):  # pixels times the scale, from some origin
        metres = frames.loc[trusted, axis] - sign * SCALE * frames.loc[trusted, column]
        np.testing.assert_allclose(metres, metres.iloc[0], atol=1e-9)
    pd.testing.assert_series_equal(frames.loc[trusted, "x_m"], found.experiment.trajectories["x_m"], check_index=False)
    assert found.impacts["restitution"].iloc[0] == pytest.approx(RESTITUTION, abs=0.03)
    assert found.flights["gravity_m_s2"].mean() == pytest.approx(9.81, rel=0.01)
    assert any(text.startswith("g = ") for text in found.remarks)
    frames["x_m"] = 0.0
    assert found.to_pandas()["x_m"].max() > 0  # a table that is given away is a copy


def test_its_experiment_is_diagnosed_as_the_written_one_is(found, written):
    of_memory, of_folder = (rock2d.diagnose(e, workers=1).to_dict() for e in (found.experiment, written))
    assert of_memory["film"]["said"] == of_folder["film"]["said"] and of_memory["film"]["said"]
    assert of_memory["sanity"]["fault_codes"] == of_folder["sanity"]["fault_codes"] == ["few_releases"]


def test_it_is_written_as_the_command_writes_it(found, written):
    names = {path.name for path in written.iterdir()}
    assert names >= {
        "experiment.yaml", "frames.csv", "setup.yaml", "overlay.webm", "tracking.html", "track.json",
    }  # fmt: skip
    back = rock2d.load_experiment(written)
    np.testing.assert_allclose(back.trajectories["x_m"], found.experiment.trajectories["x_m"], atol=1e-8)
    seen = pd.read_csv(written / "frames.csv", keep_default_na=False)
    assert seen["reason"].tolist() == found.to_pandas()["reason"].tolist()


def test_a_set_up_is_a_file_or_its_keys(film, written):
    path = written / "setup.yaml"
    keys = YAML(typ="safe").load(path)
    keys["cross_section"]["points_m"] = np.array(keys["cross_section"]["points_m"])
    for setup in (path, keys):
        again = rock2d.track(film, setup, frames=20)
        assert 0 < len(again.to_pandas()) <= 20
    keys["camera"]["fps"] = -3
    error = refusal(rock2d.track, film, keys)
    assert str(error).startswith("setup: camera.fps: ") and error.line is None


def test_what_cannot_be_tracked_is_refused_and_explained(film, tmp_path):
    assert refusal(rock2d.track, film).code == "wrong_kind"
    assert refusal(rock2d.track, film, metres_per_pixel=0.1).code == "wrong_kind"
    assert refusal(rock2d.track, film, {}, fps=30.0).code == "wrong_kind"
    assert refusal(rock2d.track, film, metres_per_pixel=0.0, fps=30.0).fields == {"key": "metres_per_pixel"}
    assert refusal(rock2d.track, film, {"name": object()}).code == "wrong_kind"
    with pytest.raises(InputError, match=r"nothing was seen to fall .* camera\.fps"):
        rock2d.track(film, metres_per_pixel=SCALE, fps=4 * FPS, explained=tmp_path / "why")
    assert "write fps: gravity" in (tmp_path / "why" / "explanation.txt").read_text()
    count = refusal(rock2d.track, film, metres_per_pixel=SCALE, fps=FPS, frames="gravity")
    assert count.message == "expected frames > 0, found 'gravity'"
    both = refusal(rock2d.track, film, metres_per_pixel="gravity", fps="gravity")
    assert "not both" in str(both)
    assert refusal(rock2d.track, film, metres_per_pixel="soon", fps=30.0).fields == {"key": "metres_per_pixel"}


def test_gravity_gives_the_frame_rate(film):
    own = rock2d.track(film, metres_per_pixel=SCALE, fps="gravity").experiment
    assert own.from_gravity.which == "fps" and own.fps == pytest.approx(FPS, rel=0.02)


def test_it_shows_itself_in_few_words_and_opens_its_page(found, monkeypatch):
    html, text = found._repr_html_(), repr(found)
    assert len(text) < 500 and text.startswith("<TrackResult of thrown: 1 release, ")
    assert len(html) < 5000 and "<table" in html and "g = " in html
    opened = []
    monkeypatch.setattr(webbrowser, "open", opened.append)
    page = found.view()
    assert opened == [page.as_uri()] and "thrown: tracked" in page.read_text(encoding="utf-8")
    assert (page.parent / "overlay.webm").stat().st_size > 0


def test_the_tracker_is_imported_when_a_film_is_tracked():
    heavy = "[name for name in sys.modules if name.startswith(('rock2d_tracking', 'cv2'))]"
    code = f"import sys, rock2d; rock2d.track; print({heavy})"
    assert printed(code) == "[]"
