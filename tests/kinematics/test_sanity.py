"""What is said before a diagnosis: units, time step, axes, ground, numbers."""

import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from rock2d.diagnosis.diagnose import check_and_segment, diagnose
from rock2d.diagnosis.diagnosis_content import diagnosis_json
from rock2d.effects import catalogue
from rock2d.files.experiment import Experiment, load_experiment
from rock2d.kinematics.film_findings import rest_remarks, shape_remarks
from rock2d.kinematics.film_segments import FilmSegments
from rock2d.kinematics.flights import load_film
from rock2d.kinematics.impacts import AFTER_COLUMNS, ImpactTable
from rock2d.kinematics.sanity import FEWEST_IMPACTS, FEWEST_REBOUNDS, check_film, check_table
from rock2d.kinematics.setup_world import setup_world
from rock2d.kinematics.window_gravity import window_gravity
from rock2d.records.columns import STATE_NAMES
from rock2d.scene.blocks import make_block
from rock2d.scene.cross_section import CrossSection
from tests.kinematics.synthetic_films import BLOCKS, POINTS, ZONES, film, world, yielded

STICKY = catalogue()["adhesion"].apply(world(), [12.0])
NOTHING = {"angle_offset": catalogue()["angle_offset"]}


@pytest.fixture(scope="module")
def plain():
    return film(world(), 8, seed=4)


@pytest.fixture(scope="module")
def many():
    return film(world(), 40, seed=4)


def changed(experiment, **columns):
    """The experiment with columns of its trajectories changed."""
    return replace(experiment, trajectories=experiment.trajectories.assign(**columns))


def faults(experiment) -> str:
    return " ".join(fault.message for fault in check_film(experiment, load_film(experiment)).faults)


def test_a_sound_film_has_no_faults(plain):
    found = check_film(plain, load_film(plain))
    assert not found.faults and not found.remarks and found.mirror == ""


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda t: {"x_m": 1e3 * t.x_m, "y_m": 1e3 * t.y_m}, "millimetres"),
        (lambda t: {"theta_rad": np.rad2deg(t.theta_rad)}, "degrees"),
        (lambda t: {"t_s": 4.0 * t.t_s}, "frames/s"),
        (lambda t: {"y_m": t.y_m - 0.2}, "inside the ground"),
        (lambda t: {"y_m": t.y_m + 0.2}, "no closer to the ground"),
        (lambda t: {"x_m": t.x_m + 9.0}, "outside the cross-section"),
        (lambda t: {"theta_rad": 0.3}, "angle of block cube never changes"),
        (lambda t: {"x_m": 0.0 * t.x_m, "y_m": 0.1 + 0.0 * t.y_m}, "never moved"),
    ],
)
def test_faults_are_said_in_words(plain, change, said):
    assert said in faults(changed(plain, **change(plain.trajectories)))


@pytest.mark.parametrize("factor", [0.1, 0.3, 2.0, 3.0, 10.0, 25.4])
def test_a_wrong_scale_is_said_with_its_factor(plain, factor):
    t = plain.trajectories
    said = faults(changed(plain, x_m=factor * t.x_m, y_m=factor * t.y_m))
    found = float(re.search(r"lengths would be wrong by a factor ([\d.e+]+)", said)[1])
    assert found == pytest.approx(factor, rel=0.03)


@pytest.mark.parametrize("factor", [0.1, 0.5, 2.0, 4.0])
def test_a_wrong_frame_rate_is_said_with_its_factor(plain, factor):
    slow = changed(plain, t_s=factor * plain.trajectories.t_s)
    slow.fps = plain.fps / factor
    found = float(re.search(r"or the frame rate by ([\d.e+]+)", faults(slow))[1])
    assert found == pytest.approx(factor, rel=0.03)


def test_gravity_of_zero_is_a_fault(plain):
    assert "gravity_m_s2 is 0" in faults(replace(plain, gravity_m_s2=0.0))


def test_a_constant_angle_of_a_circle_is_remarked(plain):
    t = plain.trajectories
    found = check_film(still := changed(plain, theta_rad=t.theta_rad.where(t.block != "sphere", 0.0)), load_film(still))
    assert not found.faults and "angle of block sphere never changes" in found.remarks[0]


def test_a_film_a_little_too_high_is_remarked(plain):
    high = changed(plain, y_m=plain.trajectories.y_m + 0.05)
    found = check_film(high, load_film(high))
    assert any("comes no closer to the ground than" in text for text in [*found.remarks, *map(str, found.faults)])


@pytest.mark.parametrize(("side_m", "said"), [(0.05, "sinks"), (0.007, "comes no closer")])
def test_a_block_of_another_size_is_remarked(plain, side_m, said):
    other = {**plain.blocks, "cube": make_block("cube", "square", 0.0233, side_m=side_m)}
    found = check_film(wrong := replace(plain, blocks=other), load_film(wrong))
    assert not found.faults and len(found.remarks) == 1 and f"block cube {said}" in found.remarks[0]


@pytest.mark.parametrize(
    ("name", "stated"),
    [
        ("cube", {"shape": "circle", "diameter_m": 0.019}),
        ("cube", {"shape": "rectangle", "length_m": 0.03, "height_m": 0.01}),
        ("sphere", {"shape": "square", "side_m": 0.022}),
    ],
)
def test_a_block_of_another_shape_is_remarked(many, name, stated):
    blocks = {**many.blocks, name: make_block(name, mass_kg=0.0233, **stated)}
    wrong, film = replace(many, blocks=blocks), load_film(many)
    (remark,) = shape_remarks(FilmSegments.of(film, setup_world(wrong)), setup_world(wrong))
    assert f"block {name}" in remark and stated["shape"] in remark


@pytest.mark.parametrize("diameters", [1.0, 4.0 / np.pi, np.sqrt(2.0)])
def test_real_squares_are_no_circles_of_their_size(data_root, diameters):
    """Neither as wide as the side, nor with the square's perimeter, nor around it."""
    squares = load_experiment(data_root / "data" / "squares")
    ((name, block),) = squares.blocks.items()
    circle = make_block(name, "circle", block.mass_kg, diameter_m=diameters * np.sqrt(2.0) * block.radius_m)
    wrong, tracks = replace(squares, blocks={name: circle}), load_film(squares)
    for experiment, remarks in ((squares, 0), (wrong, 1)):
        world = setup_world(experiment)
        assert len(shape_remarks(FilmSegments.of(tracks, world), world)) == remarks


def test_the_right_shapes_are_not_remarked(many):
    assert not shape_remarks(FilmSegments.of(load_film(many), setup_world(many)), setup_world(many))


@pytest.mark.parametrize("raised_m", [0.0, 0.0008])
def test_a_block_that_rests_above_the_ground_is_remarked(raised_m):
    """Releases that end at rest on level ground, recorded as they are or too high."""
    rng = np.random.default_rng(2)
    rows = []
    for release in range(8):
        for frame in range(40):
            y = 0.0095 + raised_m + (0.05 - 0.5 * 9.81 * (frame / 200) ** 2 if frame < 20 else 0.0)
            noise = rng.normal(0.0, 1e-4, 2)
            rows.append((release, "cube", frame / 200, 0.5 + noise[0], y + noise[1], 0.0))
    table = pd.DataFrame(rows, columns=["release", "block", "t_s", "x_m", "y_m", "theta_rad"])
    experiment = replace(film(world(), 2), trajectories=table, fps=200.0)
    remarks = rest_remarks(FilmSegments.of(load_film(experiment), setup_world(experiment)), setup_world(experiment))
    assert len(remarks) == (raised_m > 0.0)
    if remarks:
        assert "block cube lies 0.8" in remarks[0] and "8 releases" in remarks[0]


def test_a_fault_that_an_effect_could_have_made_is_not_surely_unknown(plain):
    slow = changed(plain, t_s=4.0 * plain.trajectories.t_s)
    slow.fps = plain.fps / 4.0
    content = diagnosis_json(diagnose(slow, effects=NOTHING))
    assert content["verdict"] == "unknown"
    assert content["probabilities"]["unknown"] == 0.5
    assert content["probabilities"]["frame_rate_error"] == content["probabilities"]["scale_error"] == 0.25


@pytest.mark.parametrize("column", ["x_m", "y_m"])
def test_mirrored_axis_is_seen_and_named(plain, column):
    mirrored = changed(plain, **{column: -plain.trajectories[column]})
    assert check_film(mirrored, load_film(mirrored)).mirror == column[0]
    content = diagnosis_json(diagnose(mirrored, effects=NOTHING | {"mirrored_axis": catalogue()["mirrored_axis"]}))
    assert content["verdict"] == "mirrored_axis"
    assert content["effects"]["mirrored_axis"]["parameters"]["axis"]["value"] == "xy".index(column[0]) + 1
    assert content["gap"]["closure"] > 0.9


def test_a_scale_that_sinks_the_film_into_the_ground_is_undone_for_the_cut(plain):
    t, factor, axis = plain.trajectories, 1.08, np.array([0.3, 0.3])
    x, y = axis[0] + factor * (t.x_m - axis[0]), axis[1] + factor * (t.y_m - axis[1])
    found = check_film(scaled := changed(plain, x_m=x, y_m=y), load_film(scaled))
    assert not found.faults and "inside the ground" in " ".join(found.remarks)
    assert found.registered.view.scale == pytest.approx(factor, rel=0.04)
    back = found.registered.view.true(np.column_stack([x, y, t.theta_rad]))
    assert np.abs(back[:, 1] - t.y_m).max() < 0.5 * min(b.radius_m for b in plain.blocks.values())


@pytest.mark.parametrize("scale", [0.85, 1.0, 1.15])
def test_gravity_is_read_from_flights_not_from_blocks_that_roll_back_down_the_facing(scale):
    sticky = film(STICKY, 12, seed=3, duration_s=0.8)
    t = sticky.trajectories
    scaled = changed(sticky, x_m=scale * t.x_m, y_m=scale * t.y_m)
    assert window_gravity(scaled, load_film(scaled)) == pytest.approx([0.0, -9.81 * scale], abs=0.4)


def test_blocks_that_only_slide_say_nothing_about_gravity(plain):
    """Straight down a slope of 40° at half of gravity, in every release."""
    rng, t = np.random.default_rng(3), plain.trajectories
    way = (0.1 + rng.normal(0.0, 0.05, 16)[t.release]) * t.t_s + 0.5 * 0.5 * 9.81 * t.t_s**2
    noise = rng.normal(0.0, 3e-4, (2, len(t)))
    x, y = -0.5 + 0.77 * way + noise[0], 0.45 - 0.64 * way + noise[1]
    sliding = changed(plain, x_m=x, y_m=y)
    assert window_gravity(sliding, load_film(sliding)) is None


@pytest.mark.parametrize("scale", [0.85, 1.15])
def test_a_scale_that_an_effect_explains_is_a_remark(plain, scale):
    true = catalogue()["scale_error"].apply(world(), [scale, 1.0, 0.0, 0.0])
    found = check_film(scaled := film(true, 8, seed=4), load_film(scaled))
    said = re.search(r"lengths would be wrong by a factor ([\d.]+)", " ".join(found.remarks))
    assert not found.faults and "scale_error" in found.suspects
    assert float(said[1]) == pytest.approx(scale, rel=0.03)


def test_blocks_that_stick_where_they_land_are_no_fault():
    sticky = film(STICKY, 6, seed=3, duration_s=0.5)
    found, data = check_and_segment(sticky, setup_world(sticky))
    assert not found.faults and len(data.impacts) < FEWEST_IMPACTS
    assert "12 more end the flight of a block for good" in " ".join(found.remarks)


@pytest.mark.parametrize("shift_m", [0.01, 0.02, 0.04])
@pytest.mark.parametrize("law", [world(), STICKY], ids=["dry", "sticky"])
def test_an_embankment_that_has_yielded_is_no_fault(shift_m, law):
    """Blocks come to rest where the embankment was."""
    moved = film(yielded(law, shift_m), 12, seed=3, fps=500.0, duration_s=0.8)
    found, data = check_and_segment(moved, setup_world(moved))
    assert not found.faults and len(data.impacts) > FEWEST_REBOUNDS
    assert any("inside the ground" in remark or "into the ground" in remark for remark in found.remarks)


def test_a_film_from_the_top_of_the_image_down_is_no_camera_on_its_head(plain):
    fallen = changed(plain, y_m=0.03 - plain.trajectories.y_m)
    assert "upwards" in faults(fallen) or "inside the ground" in faults(fallen)


def test_a_cross_section_that_sinks_the_blocks_is_built_as_they_show_it():
    true = catalogue()["geometry_error"].apply(world(), [0.0, -0.12])
    experiment = film(true, 8, seed=4, duration_s=1.0)
    found = check_film(experiment, load_film(experiment))
    assert not found.faults and "geometry_error" in found.remarks[0]
    ditch = [w.cross_section.points_m[1, 1] for w in (true, found.registered)]
    assert ditch[1] == pytest.approx(ditch[0], abs=0.3 * min(b.radius_m for b in true.blocks.values()))


def test_too_little_to_diagnose_is_said(plain):
    one = plain.trajectories[plain.trajectories.release == 1]
    content = diagnosis_json(diagnose(replace(plain, trajectories=one)))
    assert content["verdict"] == "unknown" and content["probabilities"]["unknown"] == 0.5
    assert "too few" in content["sanity"]["faults"][0]


@pytest.mark.parametrize(
    ("velocity", "spin", "said"),
    [(1.0, 1.0, ""), (1e3, 1.0, "velocities in millimetres per second"), (1.0, np.rad2deg(1.0), "angles in degrees")],
)
def test_the_units_of_the_velocities_of_a_table_are_checked(velocity, spin, said):
    rng, columns = np.random.default_rng(5), ["release", "block", *STATE_NAMES, *AFTER_COLUMNS]
    rows = []
    for k in range(20):
        vx, vy, omega = rng.uniform([0.5, -2.0, -90.0], [1.5, -1.0, -30.0])
        linear, turning = velocity * np.array([vx, vy, vx, -0.4 * vy]), spin * np.array([omega, 0.8 * omega])
        rows.append((k % 4, "cube", 0.05, 0.02, 0.3, *linear[:2], turning[0], *linear[2:], turning[1]))
    impacts, ground = pd.DataFrame(rows, columns=columns), CrossSection(POINTS, ZONES)
    table = Experiment("table", 9.81, 1000.0, 3e-4, 0.02, ground, dict(BLOCKS), impacts=impacts)
    found = check_table(table, ImpactTable.of(table))
    assert said in " ".join(fault.message for fault in found.faults) and bool(found.faults) == bool(said)


def test_lost_frames_are_remarked(plain):
    rng = np.random.default_rng(0)
    kept = plain.trajectories[rng.random(len(plain.trajectories)) > 0.1]
    lost = 100 * (1 - len(kept) / len(plain.trajectories))
    found = check_film(plain, load_film(replace(plain, trajectories=kept)))
    assert not found.faults and f"{lost:.0f} %" in found.remarks[0]
