"""Angles of reach and of the energy line: closed forms of a block that slides."""

import numpy as np
import pytest

from rock2d.records.track import Track
from rock2d.runs.indicators.reach import angle_of_reach_deg, energy_head_m, reach_table
from rock2d.runs.simulation import Simulation
from rock2d.scene.blocks import make_block
from tests.laboratory import FLOOR

GRAVITY = 9.81
BLOCK = make_block("block", "square", 2000.0, "uniform", side_m=1.0)


def slid(slope_deg: float, friction_deg: float, speed: float, release: int = 0, stop: str = "rest") -> Track:
    """A block that slides down a plane from (0, 0) with this speed until friction stops it."""
    slope, friction = np.deg2rad([slope_deg, friction_deg])
    slowed = GRAVITY * (np.cos(slope) * np.tan(friction) - np.sin(slope))
    way = speed**2 / (2.0 * slowed)
    down = np.array([np.cos(slope), -np.sin(slope)])
    start, end = np.zeros(7), np.zeros(7)
    start[4:6], end[0], end[1:3] = speed * down, speed / slowed, way * down
    return Track(release, "block", np.array([start, end]), np.array([False, False]), [], stop, GRAVITY)


def reach_of(*tracks: Track):
    return reach_table(Simulation("batch", FLOOR, {"block": BLOCK}, list(tracks)))


@pytest.mark.parametrize("slope_deg", [0.0, 12.0, 25.0])
def test_the_energy_line_of_a_sliding_block_has_the_friction_angle_and_the_reach_that_of_the_plane(slope_deg):
    table = reach_of(slid(slope_deg, 30.0, 15.0)).set_index("angle")
    assert table.loc["energy_line", "least_deg"] == pytest.approx(30.0, abs=1e-9)
    assert table.loc["reach", "least_deg"] == pytest.approx(slope_deg, abs=1e-9)


def test_a_block_from_rest_that_slides_on_over_any_ground_reaches_as_far_as_its_friction_angle():
    """Down a plane of 40 degrees, then on over the level: work of friction is tan(angle) m g for each metre in x."""
    drop, friction = 20.0, np.deg2rad(32.0)
    start, end = np.array([[0.0, drop]]), np.array([[drop / np.tan(friction), 0.0]])
    assert angle_of_reach_deg(start, end) == pytest.approx(32.0)
    assert angle_of_reach_deg(start * [-1, 1], end * [-1, 1]) == pytest.approx(32.0)


def test_the_energy_head_is_the_height_that_a_block_could_rise_to():
    state = np.array([[0.0, 3.0, 0.0, 3.0, 4.0, 2.0]])
    head = energy_head_m(state, np.array([0.5]), GRAVITY)
    assert head == pytest.approx(3.0 + (25.0 + 0.5 * 4.0) / (2.0 * GRAVITY))


def test_a_simulated_block_that_slides_has_an_energy_line_near_its_friction_angle():
    import rock2d

    slope, friction = np.deg2rad(15.0), 30.0
    ground = rock2d.CrossSection([[-10.0, 10.0 * np.tan(slope)], [90.0, -90.0 * np.tan(slope)]], ["rock"])
    law = rock2d.ContactParameters(2e8, 8e8, 5e7, friction, 0.0)
    plate = rock2d.make_block("plate", "rectangle", 3000.0, "uniform", length_m=3.0, height_m=0.4)
    state = [0.0, 0.2 / np.cos(slope), -slope, 14.0 * np.cos(slope), -14.0 * np.sin(slope), 0.0]
    found = rock2d.simulate(plate, ground, law, state, engine="batch")
    table = found.to_pandas("reach").set_index("angle")
    assert table.loc["energy_line", "not_stopped"] == 0
    assert table.loc["energy_line", "least_deg"] == pytest.approx(friction, abs=1.0)


def test_blocks_that_stay_do_not_count_and_those_that_leave_are_told():
    stayed = slid(10.0, 30.0, 1.0)
    tracks = [stayed, slid(10.0, 30.0, 12.0, 1), slid(10.0, 30.0, 20.0, 2, "exit")]
    table = reach_of(*tracks)
    assert table["left_source"].tolist() == [2, 2] and table["not_stopped"].tolist() == [1, 1]
    assert table["exceeded_by_95_deg"].isna().all()  # two blocks have no 95 % of them


def test_ninety_five_per_cent_of_the_blocks_stop_above_the_angle():
    tracks = [slid(5.0, 20.0 + 0.1 * i, 15.0, i) for i in range(101)]
    row = reach_of(*tracks).set_index("angle").loc["energy_line"]
    assert row["exceeded_by_95_deg"] == pytest.approx(20.5)
    assert row["low95_deg"] < 20.5 < row["high95_deg"] and row["least_deg"] == pytest.approx(20.0)
