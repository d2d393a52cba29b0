"""`rock2d track`, `film`, `import`, `export`: the whole way, and what is said of input that cannot be used."""

from dataclasses import replace

import click
import cv2
import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from rock2d_tracking.camera import PixelMap
from rock2d_tracking.film_reading import FilmFile
from rock2d_tracking.importers.tracker import write_tracker
from rock2d_tracking.setup_file import Setup, write_setup
from rock2d_tracking.synthetic.faults import CLEAN
from rock2d_tracking.synthetic.film import FilmOptions, film_frames, write_film
from ruamel.yaml import YAML

from rock2d.cli import cli
from rock2d.errors import InputError
from rock2d.files.checked_yaml import yaml_text
from rock2d.files.experiment import Experiment, load_experiment, write_experiment
from tests.programs import commanded
from tests.tracking.falls import BLOCKS, CAMERA, CROSS_SECTION, SIZE_PX, falls
from tests.tracking.tracked_files import TRACKER


def run(*arguments: object) -> str:
    result = CliRunner().invoke(cli, [str(a) for a in arguments], catch_exceptions=False, standalone_mode=False)
    return result.output


def tracked(film, setup, out, *options: object) -> str:
    return run("track", film, "--config", setup, *options, "--out", out, "--quiet")


@pytest.fixture(scope="module")
def filmed(tmp_path_factory):
    """A folder with film.avi (quality 90), its setup.yaml, and the experiment filmed."""
    folder = tmp_path_factory.mktemp("film")
    experiment = falls(140)
    write_experiment(folder / "truth", experiment)
    shots = film_frames(experiment, CAMERA, SIZE_PX, FilmOptions(seed=1, faults=CLEAN, rest_frames=40))
    write_film(folder / "film.avi", shots, SIZE_PX, 25, 90)
    write_setup(folder / "setup.yaml", experiment, CAMERA, ["sphere", "cube", "slab"])
    return folder


def test_from_film_to_experiment(filmed, tmp_path):
    said = tracked(filmed / "film.avi", filmed / "setup.yaml", tmp_path / "out")
    assert "3 releases, 420 of 420 frames trusted" in said
    found, truth = load_experiment(tmp_path / "out"), load_experiment(filmed / "truth")
    off = found.trajectories[["x_m", "y_m"]].to_numpy() - truth.trajectories[["x_m", "y_m"]].to_numpy()
    assert np.sqrt((off**2).mean()) < 0.1 * CAMERA.metres_per_pixel
    for name in ("frames.csv", "flights.csv", "measured_impacts.csv", "tracking.html", "overlay.webm"):
        assert (tmp_path / "out" / name).stat().st_size > 0
    page = (tmp_path / "out" / "tracking.html").read_text()
    assert page.count("<img") == 5 and "://" not in page


def test_film_writes_its_truth_and_a_setup_that_tracks_it(filmed, tmp_path):
    run("film", filmed / "truth", "--out", tmp_path / "f.avi", "--size", 480, 320, "--releases", 1, "--quiet")
    assert list(Setup(tmp_path / "f.yaml").blocks) == ["sphere"]  # the others are not in the film
    said = tracked(tmp_path / "f.avi", tmp_path / "f.yaml", tmp_path / "out")
    assert "1 release, 140 of 140 frames trusted" in said
    assert (tmp_path / "f.csv").read_text().count("\n") == 1 + 60 + 140


@pytest.mark.parametrize("command, own", [("film", "film.avi"), ("film", "film.yaml"), ("export", "film_1.avi")])
def test_a_file_of_the_user_is_not_replaced(filmed, tmp_path, command, own):
    (tmp_path / own).write_text("made by hand")
    options = ["--size", 480, 320, "--quiet"] if command == "film" else []
    refused = commanded(command, filmed / "truth", "--out", tmp_path / "film.avi", *options)
    assert isinstance(refused.exception, InputError) and f"{own}: exists" in str(refused.exception)
    assert [p.name for p in tmp_path.iterdir()] == [own] and (tmp_path / own).read_text() == "made by hand"


def test_a_film_and_an_export_are_made_again(filmed, tmp_path):
    for _ in range(2):
        run("film", filmed / "truth", "--out", tmp_path / "f.avi", "--size", 64, 64, "--releases", 1, "--quiet")
        run("export", filmed / "truth", "--out", tmp_path / "t.txt")
    assert len(list(tmp_path.iterdir())) == 6


def test_export_and_import_give_the_same_motion(filmed, tmp_path):
    run("export", filmed / "truth", "--out", tmp_path / "t.txt")
    metres = PixelMap(1.0, (0.0, 0.0))  # the file's own unit, and its own origin
    truth = load_experiment(filmed / "truth")
    write_setup(tmp_path / "setup.yaml", truth, metres, ["cube"])
    run("import", tmp_path / "t_1.txt", "--kind", "tracker", "--config", tmp_path / "setup.yaml", "--y", "up",
        "--out", tmp_path / "out")  # fmt: skip
    found = load_experiment(tmp_path / "out")
    own = truth.trajectories[truth.trajectories["release"] == 1]
    columns = ["t_s", "x_m", "y_m", "theta_rad"]
    np.testing.assert_allclose(found.trajectories[columns], own[columns], atol=1e-9)


def test_import_does_not_guess_of_which_block_the_tracks_are(tmp_path):
    path = tmp_path / "setup.yaml"
    stated = Experiment("film", 9.81, 1000.0, 0.0, 0.0, CROSS_SECTION, BLOCKS, impacts=pd.DataFrame())
    write_setup(path, stated, CAMERA, ["sphere", "cube", "cube"])
    (tmp_path / "t.txt").write_text(TRACKER)
    result = commanded("import", tmp_path / "t.txt", "--kind", "tracker", "--config", path, "--y", "up", "--out",
                       tmp_path / "out")  # fmt: skip
    assert isinstance(result.exception, InputError) and result.exception.file == path
    assert "--block: the releases are of several blocks, expected one of sphere, cube" in result.exception.message


@pytest.mark.parametrize("y", ["up", "down"])
@pytest.mark.parametrize("up", [-1, 1])
def test_import_sees_through_the_camera_of_the_set_up_file(filmed, tmp_path, up, y):
    """A turned film, and one upside down, give the motion in the world."""
    camera = PixelMap(6e-4, (100.0, 320.0), (0.1, 0.05), up, np.deg2rad(8.0))
    truth = load_experiment(filmed / "truth")
    own = truth.trajectories[truth.trajectories["release"] == 1].reset_index(drop=True)
    u, v = camera.to_pixel(own[["x_m", "y_m"]].to_numpy()).T
    angle, sign = camera.angle_to_pixel(own["theta_rad"].to_numpy()), -1.0 if y == "up" else 1.0
    write_tracker(tmp_path / "t.txt", own.assign(x_m=u, y_m=sign * v, theta_rad=sign * angle), truth.fps)
    in_file = replace(camera, origin_px=(100.0, sign * 320.0))
    write_setup(tmp_path / "setup.yaml", truth, in_file, ["cube"])
    run("import", tmp_path / "t.txt", "--kind", "tracker", "--config", tmp_path / "setup.yaml", "--y", y,
        "--out", tmp_path / "out")  # fmt: skip
    columns = ["t_s", "x_m", "y_m", "theta_rad"]
    np.testing.assert_allclose(load_experiment(tmp_path / "out").trajectories[columns], own[columns], atol=1e-9)


def test_import_refuses_a_lens_that_it_cannot_take_out(filmed, tmp_path):
    text = (filmed / "setup.yaml").read_text()
    (tmp_path / "setup.yaml").write_text(text.replace("  up: up", "  distortion: {k: -0.1}\n  up: up"))
    (tmp_path / "t.txt").write_text(TRACKER)
    result = commanded("import", tmp_path / "t.txt", "--kind", "tracker", "--config", tmp_path / "setup.yaml", "--y",
                       "down", "--block", "cube", "--out", tmp_path / "out")  # fmt: skip
    assert isinstance(result.exception, InputError) and "camera.distortion" in result.exception.message
    assert result.exception.line == text[: text.index("  up: up")].count("\n") + 1
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda data: b"", "empty"),
        (lambda data: b"no video at all" * 100, "cannot be read"),
        (lambda data: data[: len(data) // 2], "ends early|cannot be read"),
    ],
)
def test_files_that_are_no_whole_film_are_refused(filmed, tmp_path, spoil, said):
    (tmp_path / "bad.avi").write_bytes(spoil((filmed / "film.avi").read_bytes()))
    with pytest.raises(InputError, match=said):
        tracked(tmp_path / "bad.avi", filmed / "setup.yaml", tmp_path / "out")
    assert not (tmp_path / "out").exists() and not list(tmp_path.glob(".*"))


def test_a_set_up_file_that_names_a_picture_is_used_again_from_the_results(filmed, tmp_path):
    squares = (np.indices((8, 11)).sum(axis=0) % 2 * 255).astype(np.uint8)
    board = np.kron(squares, np.ones((24, 24), np.uint8))
    (height, width), (wide, high) = board.shape, SIZE_PX
    board = np.pad(board, ((40, high - 40 - height), (40, wide - 40 - width)), constant_values=255)
    cv2.imwrite(str(tmp_path / "board.png"), board)
    scale = "{checkerboard: board.png, columns: 10, rows: 7, square_m: 0.0144}"
    text, stated = (filmed / "setup.yaml").read_text(), "{metres_per_pixel: 0.0006}"
    assert stated in text
    (tmp_path / "setup.yaml").write_text(text.replace(stated, scale))
    for setup, out in (("setup.yaml", "out"), ("out/setup.yaml", "again")):  # the first release is enough
        tracked(filmed / "film.avi", tmp_path / setup, tmp_path / out, "--frames", 180)
    first, again = ((tmp_path / name / "frames.csv").read_text() for name in ("out", "again"))
    assert first == again


@pytest.mark.parametrize(
    ("true", "wrong", "frames", "said"),
    [
        ("metres_per_pixel: 0.0006", "metres_per_pixel: 0.0001", 180, "no block was seen"),
        (
            "metres_per_pixel: 0.0006",
            "metres_per_pixel: 0.0000006",
            180,
            "px wide in a picture of .* sizes of blocks in m",
        ),
        ("fps: 1000.0", "fps: 250.0", 540, "accelerate by"),
        ("up: up", "up: down", 180, r"no block was seen .* `up`"),
    ],
)
def test_a_setup_that_is_not_the_films_is_reported(filmed, tmp_path, true, wrong, frames, said):
    text = (filmed / "setup.yaml").read_text()
    assert true in text
    setup, out = tmp_path / "setup.yaml", tmp_path / "out"
    setup.write_text(text.replace(true, wrong))
    with pytest.raises(InputError, match=said):
        tracked(filmed / "film.avi", setup, out, "--frames", frames)
    assert not out.exists()


def test_of_the_first_frames_the_first_releases_are_seen(filmed, tmp_path):
    """Also where the block of a later release has just the size that is seen. The remark says what was taken."""
    keys = YAML(typ="safe").load(filmed / "setup.yaml")
    size_m = keys["blocks"]["sphere"]["diameter_m"]
    keys["blocks"]["slab"] = {**keys["blocks"]["sphere"]}
    keys["blocks"]["sphere"]["diameter_m"] = 1.04 * size_m
    (tmp_path / "setup.yaml").write_text(yaml_text(keys))
    said = tracked(filmed / "film.avi", tmp_path / "setup.yaml", tmp_path / "out", "--frames", 180)
    assert "1 release seen and taken for sphere, but the key releases of the set-up file lists 3, sphere, cube" in said
    assert set(load_experiment(tmp_path / "out").trajectories["block"]) == {"sphere"}


def test_a_set_up_file_and_a_frame_rate_contradict_each_other(filmed, tmp_path):
    with pytest.raises(click.UsageError, match="either --config, or"):
        tracked(filmed / "film.avi", filmed / "setup.yaml", tmp_path / "out", "--fps", 30)


def test_frames_are_read_in_turn_and_as_many_as_asked_for(filmed):
    assert sum(1 for _ in FilmFile(filmed / "film.avi").frames()) == 3 * (40 + 140)
    assert sum(1 for _ in FilmFile(filmed / "film.avi").frames(10)) == 10
    with pytest.raises(InputError, match="no such video"):
        FilmFile(filmed / "nothing.avi")
