"""Experiment folders: valid ones load, damaged ones get one clear message, writing is whole or not at all.

Random damage is done to them in `tests/hunt/test_files.py`."""

import shutil
import warnings

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rock2d.errors import InputError, UnusualWarning
from rock2d.files.experiment import REQUIRED_IMPACT_COLUMNS, Experiment, FromGravity, load_experiment, write_experiment
from rock2d.files.folders import atomic_folder
from rock2d.scene.blocks import make_block
from rock2d.scene.cross_section import CrossSection
from tests.programs import commanded, place_of, refusal

SETUP = """\
name: set-up
gravity_m_s2: 9.81
camera:
  fps: 1000
  position_noise_m: 3.0e-4
  angle_noise_rad: 0.02
cross_section:
  points_m: [[-0.7, 0.55], [0.0, 0.0], [0.13, 0.0], [0.17, 0.083]]
  zones: [slope, ditch, uphill_face]
  measure_lines:
    line_1: [[0.14, 0.02], [0.14, 0.3]]
blocks:
  sphere: {shape: circle, diameter_m: 0.025, mass_kg: 0.022, inertia: solid_sphere}
  cube: {shape: square, side_m: 0.019, mass_kg: 0.0233, inertia: uniform}
  stone: {shape: polygon, vertices_m: [[0, 0], [0.02, 0], [0.015, 0.02]], mass_kg: 0.02, inertia: 4.0e-7}
trajectories: seen.csv
"""
ROWS = """\
release,block,t_s,x_m,y_m,theta_rad
0,sphere,0.000,-0.01,0.1,0.5
0,sphere,0.001,,,
0,sphere,0.003,-0.008,0.098,0.4
3,cube,0.000,-0.02,0.11,-2
3,cube,0.001,-0.018,0.109,-2.01
"""
IMPACTS = ",".join(REQUIRED_IMPACT_COLUMNS) + "\n0,sphere,0.05,0.0125,1,1.5,-1.6,-50,0.9,0.6,-60\n"


@pytest.fixture
def folder(tmp_path):
    path = tmp_path / "seen"
    path.mkdir()
    (path / "experiment.yaml").write_text(SETUP)
    (path / "seen.csv").write_text(ROWS)
    return path


@pytest.mark.parametrize(
    ("right", "wrong", "said"),
    [
        ("mass_kg: 0.0233", "mass_kg: 23.3", r"experiment.yaml:14:3: blocks.cube: .* Is the mass in g instead of kg"),
        ("side_m: 0.019", "side_m: 19", "blocks.cube: .* Is the size in mm instead of m"),
    ],
)
def test_a_block_in_a_wrong_unit_is_told(folder, right, wrong, said):
    (folder / "experiment.yaml").write_text(SETUP.replace(right, wrong))
    with pytest.warns(UnusualWarning, match=said):
        load_experiment(folder)


def test_a_ball_of_steel_or_foam_is_nothing_unusual(folder):
    (folder / "experiment.yaml").write_text(SETUP.replace("mass_kg: 0.022", "mass_kg: 0.064").replace("0.0233", "2e-4"))
    with warnings.catch_warnings(action="error"):
        load_experiment(folder)


def refused(folder) -> str:
    return str(refusal(load_experiment, folder))


def test_reads_what_was_measured_and_keeps_lost_frames_as_nan(folder):
    experiment = load_experiment(folder)
    assert experiment.fps == 1000 and experiment.cross_section.zones == ("slope", "ditch", "uphill_face")
    assert experiment.blocks["sphere"].inertia_kg_m2 == pytest.approx(0.4 * 0.022 * 0.0125**2)
    assert experiment.blocks["stone"].inertia_kg_m2 == 4.0e-7
    seen = experiment.trajectories
    assert seen["release"].tolist() == [0, 0, 0, 3, 3]
    assert seen.loc[1, ["x_m", "y_m", "theta_rad"]].isna().all() and seen.notna().sum().sum() == 27


def test_impacts_may_stand_in_for_trajectories(folder):
    (folder / "experiment.yaml").write_text(SETUP.replace("trajectories: seen.csv", "impacts: seen.csv"))
    (folder / "seen.csv").write_text(IMPACTS)
    experiment = load_experiment(folder)
    assert experiment.trajectories is None
    assert experiment.impacts.loc[0, "vx_after_m_s"] == 0.9


@pytest.mark.parametrize(
    ("old", "new", "at", "words"),
    [
        ("gravity_m_s2: 9.81", "gravity: 9.81", "gravity", "did you mean 'gravity_m_s2'"),
        ("1000", "'1000'", "'1000'", "expected a number, found '1000'; write it without quotes"),
        ("1000", "yes", "yes", "expected a number"),
        ("1000", "true", "true", "expected a number, found true"),
        ("1000", ".nan", ".nan", "expected a finite number"),
        ("1000", "0", "0\n", "greater than 0, found 0"),
        ("  fps: 1000\n", "", "camera", "missing key 'fps'"),
        ("  fps: 1000", "  fps: 1000\n  fps: 500", "fps: 500", "stands twice (first in line 4)"),
        ("camera:\n", "camera: &c\n  again: *c\n", "&c", "alias that contains itself"),
        ("[0.13, 0.0]", "[0.13]", "[0.13]", "at least 2 items"),
        ("[0.13, 0.0]", "[0.0, 0.0]", "[0.0, 0.0], [0.17", "zero length"),
        ("[0.17, 0.083]", "[-0.8, 0.083]", "[[-0.7", "left to right"),
        ("[0.17, 0.083]", "[-0.2, -0.1], [0.3, 0.1]", "[0.3, 0.1]", "crosses itself"),
        ("ditch, uphill_face]", "ditch]", "[slope, ditch]", "3 facets, 2 names"),
        ("[0.14, 0.3]]", "[0.14, 0.02]]", "[[0.14, 0.02]", "two different"),
        ("circle", "cirle", "cirle", "did you mean 'circle'"),
        ("side_m", "side", "side", "did you mean 'side_m'"),
        ("solid_sphere", "solid_spere", "solid_spere", "did you mean 'solid_sphere'"),
        ("inertia: uniform", "inertia: solid_sphere", "solid_sphere}\n  stone", "needs shape circle"),
        ("4.0e-7", "1.0", "1.0}", "impossible"),
        ("[0.015, 0.02]", "[0.015, 0.02], [0.012, 0.001]", "[[0, 0]", "convex"),
        ("0.022,", "-0.022,", "-0.022", "found -0.022"),
        ("seen.csv", "../seen/seen.csv", "../seen", "found '..'"),
        ("seen.csv", "/etc/passwd", "/etc", "absolute"),
        ("seen.csv", "gone.csv", "gone.csv", "no file 'gone.csv'"),
        ("seen.csv", "seen.csv\nimpacts: seen.csv", "impacts", "not both"),
        ("name: set-up", "name: [set-up", "gravity_m_s2", "not YAML"),
    ],
)
def test_a_mistake_in_the_yaml_gets_its_place_and_what_was_expected(folder, old, new, at, words):
    file = folder / "experiment.yaml"
    assert old in SETUP
    damaged = SETUP.replace(old, new, 1)
    file.write_text(damaged)
    message = refused(folder)
    assert words in message
    if words != "not YAML":  # where a parser loses the thread is its own affair
        assert message.startswith(f"{file}:{place_of(at, damaged)}: "), message


@pytest.mark.parametrize(
    ("old", "new", "line", "words"),
    [
        ("0.003,-0.008", "0.003,zero", 4, "column x_m: expected a finite number, found 'zero'"),
        ("0.003,-0.008", "0.003,nan", 4, "column x_m"),
        ("0.003,-0.008", "0.003,inf", 4, "column x_m"),
        ("0.003,-0.008", "0.001,-0.008", 4, "times must increase"),
        ("0,sphere,0.003", "0.5,sphere,0.003", 4, "column release: expected a whole number"),
        ("0,sphere,0.003", "0,spere,0.003", 4, "'spere' is not in experiment.yaml (did you mean 'sphere'?)"),
        ("0,sphere,0.003", "0,cube,0.003", 4, "release 0 was 'sphere', here 'cube'"),
        ("0,sphere,0.003", ",sphere,0.003", 4, "column release: an empty cell"),
        (",-2.01\n", "", 6, "expected 6 cells, found 5"),
        ("theta_rad", "theta", 1, "did you mean 'theta_rad'"),
        ("t_s", "t", 1, "did you mean 't_s'"),
        (",theta_rad", "", 1, "column theta_rad is missing"),
        ("y_m", "x_m", 1, "stands twice"),
        ("0.003,-0.008", "0,003,-0,008", 4, "expected 6 cells, found 8; '0,003' looks like a decimal comma"),
        ("0.003,-0.008", '"0,003",-0.008', 4, "'0,003' has a decimal comma"),
        ("0.003,-0.008", '"a,b",-0.008', 4, "must not contain a comma"),
    ],
)
def test_a_mistake_in_the_csv_gets_its_line_and_column(folder, old, new, line, words):
    assert old in ROWS
    (folder / "seen.csv").write_text(ROWS.replace(old, new, 1))
    message = refused(folder)
    assert message.startswith(f"{folder / 'seen.csv'}:{line}: ") and words in message, message


def test_of_several_unknown_blocks_the_first_is_named(folder):
    rows = [f"{i},unknown_{i},0.0,0,0,0" for i in range(16)]
    (folder / "seen.csv").write_text("\n".join([ROWS.splitlines()[0], *rows]))
    assert ":2: column block: 'unknown_0'" in refused(folder)


def test_a_table_of_a_spreadsheet_with_decimal_commas_is_named(folder):
    (folder / "seen.csv").write_text("release;block;t_s;x_m;y_m;theta_rad\n0;sphere;0,001;1;2;3\n")
    assert "numbers need a decimal point" in refused(folder)


def test_a_film_without_any_whole_frame_is_refused(folder):
    rows = ROWS.splitlines()
    lost = [",".join([*row.split(",")[:4], "", ""]) for row in rows[1:]]
    (folder / "seen.csv").write_text("\n".join([rows[0], *lost]))
    assert "every frame is lost" in refused(folder)


def test_quotes_bom_and_windows_lines_are_read(folder):
    plain = load_experiment(folder).trajectories
    quoted = ROWS.replace("sphere", '"sphere"').replace("release,", '"release",').replace("\n", "\r\n")
    (folder / "seen.csv").write_bytes(b"\xef\xbb\xbf" + quoted.encode())
    pd.testing.assert_frame_equal(load_experiment(folder).trajectories, plain)


def test_a_link_out_of_the_folder_is_refused(folder, tmp_path):
    (folder / "seen.csv").rename(tmp_path / "outside.csv")
    (folder / "seen.csv").symlink_to(tmp_path / "outside.csv")
    assert "leads out" in refused(folder)


finite = st.floats(-1e3, 1e3)


@settings(max_examples=30, deadline=None)
@given(
    rows=st.lists(st.tuples(finite, finite, finite | st.just(np.nan)), max_size=20),
    size=st.floats(1e-3, 10.0),
    mass=st.floats(1e-3, 1e4),
)
def test_what_is_written_is_read_back_identical(tmp_path_factory, rows, size, mass):
    x, y, theta = map(np.array, zip((0.0, 0.0, 0.0), *rows, strict=True))
    n = len(x)
    time = np.arange(n) / 3
    blocks = [
        make_block("a", "circle", mass, "solid_sphere", diameter_m=size),
        make_block("b", "square", mass, side_m=size),
        make_block("c", "rectangle", mass, length_m=size, height_m=size / 3),
        make_block("null", "ellipse", mass, length_m=size, height_m=size / 3),
    ]
    seen = pd.DataFrame({"release": 7, "block": "null", "t_s": time, "x_m": x, "y_m": y, "theta_rad": theta})
    cross_section = CrossSection(
        [[-size, 0.1], [size / 7, 0.0], [size, mass]], ["1", "yes"], {"no": [[0, 0], [0, size]]}
    )
    given = Experiment("3", 9.81, 1000 / 3, 1e-5, 0.0, cross_section, {b.name: b for b in blocks}, seen,
                       from_gravity=FromGravity(which="scale", relative_error=size / 10))  # fmt: skip
    folder = tmp_path_factory.mktemp("round") / "trip"
    write_experiment(folder, given)
    back = load_experiment(folder)
    pd.testing.assert_frame_equal(back.trajectories, seen, check_exact=True)
    assert (back.name, back.fps, back.position_noise_m) == ("3", 1000 / 3, 1e-5)
    assert back.from_gravity == given.from_gravity
    assert (back.cross_section.points_m == cross_section.points_m).all()
    assert back.cross_section.zones == cross_section.zones
    assert (back.cross_section.measure_lines["no"] == cross_section.measure_lines["no"]).all()
    for name, block in given.blocks.items():
        other = back.blocks[name]
        assert (other.shape, other.mass_kg, other.semi_axes_m) == (block.shape, block.mass_kg, block.semi_axes_m)
        assert other.inertia_kg_m2 == block.inertia_kg_m2 and (other.corners_m == block.corners_m).all()
    shutil.rmtree(folder)


def test_an_interrupted_write_leaves_the_old_result_and_no_rest(tmp_path):
    target = tmp_path / "out"
    with atomic_folder(target) as partial:
        (partial / "a.txt").write_text("old")
    with pytest.raises(KeyboardInterrupt), atomic_folder(target) as partial:
        (partial / "a.txt").write_text("half")
        raise KeyboardInterrupt
    assert (target / "a.txt").read_text() == "old"
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_an_old_result_is_replaced_and_anything_else_refused(tmp_path, folder):
    target = tmp_path / "out"
    for text in ("old", "new"):
        with atomic_folder(target) as partial:
            (partial / f"{text}.txt").write_text(text)
    assert {path.name for path in target.glob("*.txt")} == {"new.txt"}
    (tmp_path / "file").write_text("mine")
    for precious in (folder, tmp_path / "file", tmp_path / "file" / "below"):
        with pytest.raises(InputError), atomic_folder(precious):
            pass
    assert (folder / "seen.csv").read_text() == ROWS


def test_the_real_and_the_practice_experiments_load_unchanged(data_root):
    """The other halves of the practice films are read and checked in `tests/hunt/test_files.py`."""
    folders = [data_root / "data" / "squares", *sorted(data_root.glob("practice/*/heldout/"))]
    assert len(folders) > 1
    for path in folders:
        experiment = load_experiment(path)
        assert len(experiment.trajectories) > 1000 and experiment.trajectories["release"].nunique() > 50


def test_the_folder_above_experiments_names_them(tmp_path, folder):
    write_experiment(tmp_path / "deep" / "er", load_experiment(folder))
    said = r"no experiment.yaml in this folder; .*: 'deep/er', 'seen'$"
    assert refusal(load_experiment, tmp_path, said=said).code == "missing_file"
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="in this folder or below it"):
        load_experiment(tmp_path / "empty")


@pytest.mark.parametrize("command", ["diagnose {} --out {}/o", "predict {} --diagnosis {}/d.json --out {}/p.csv"])
def test_commands_name_the_experiments_below_a_folder(tmp_path, folder, command):
    error = commanded(*command.replace("{}", str(tmp_path)).split()).exception
    assert isinstance(error, InputError) and "'seen'" in str(error)
    assert [path.name for path in tmp_path.iterdir()] == ["seen"]
