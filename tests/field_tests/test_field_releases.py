"""The table of a field test, and the sections of its terrain."""

from dataclasses import replace

import numpy as np
import pytest

from rock2d.errors import InputError
from rock2d.files.field_releases import read_releases
from rock2d.files.scenario_reading import load_scenario
from rock2d.files.surveys.terrain_sections import EDGE_ZONE
from tests.field_tests.small_field import HEADER, write_field
from tests.programs import refusal

IDS = {"cube": 1, "box": 2}
STOPS = {"cube": [60.0, 70.0, 80.0], "box": [55.0, 65.0]}


@pytest.fixture
def field(tmp_path):
    return load_scenario(write_field(tmp_path, STOPS), tmp_path)


def test_distances_are_those_of_the_table(field):
    known = field.terrain.known
    assert known.distances_m == pytest.approx([60, 70, 80, 55, 65], abs=1e-4)
    assert known.of_blocks("box").tolist() == [False, False, False, True, True]


def test_a_release_that_repeats_another_in_every_digit_counts_once(put):
    table = put(f"{HEADER}\na,1,1,0,0,0,5,6,0\nb,1,1,0,0,0,5,6,0\nc,2,1,0,0,0,5,6,0\n")
    assert read_releases(table, IDS).names == ("a", "c")
    assert read_releases(table, IDS, stops=False).names == ("a", "b", "c")


@pytest.mark.parametrize(
    ("text", "line", "said"),
    [
        ("release,block_id\n", 1, "missing column release_x_m"),
        (f"{HEADER}\na,7,1,0,0,0,5,6,0\n", 2, "unknown block_id 7; block_ids of the scenario: 1, 2"),
        (f"{HEADER}\na,1,1,0,0,0,5,x,0\n", 2, "expected numbers"),
        (f"{HEADER}\na,1,1,0,0,0,5,inf,0\n", 2, "finite"),
        (f"{HEADER}\na,1,1,0,0,0,5,,0\n", 2, "column stop_y_m is empty"),
        (f"{HEADER}\na,1,1,0,0,0,5,6,0\na,1,1,0,0,0,5,7,0\n", 3, "release a stands twice"),
        (f"{HEADER}\n", 1, "no releases"),
    ],
)
def test_a_table_with_a_mistake_is_refused_with_its_line(put, text, line, said):
    assert refusal(read_releases, put(text), IDS, said=said).line == line


def test_a_section_down_the_slope_has_its_inclination_and_its_zones(field):
    section = field.terrain.section(np.zeros(2), 0.0)
    x, y = section.points_m.T
    at = (x > 0) & (x < 45)
    assert np.diff(y[at]) / np.diff(x[at]) == pytest.approx(-np.tan(np.radians(35.0)))
    assert y[x > 60] == pytest.approx(0.0, abs=1e-9)
    middle = 0.5 * (x[1:] + x[:-1])
    zones = np.array(section.zones)
    assert set(zones[middle < 2.4]) == {EDGE_ZONE}
    assert set(zones[(middle > 6) & (middle < 47)]) == {"slope"} and set(zones[middle > 60]) == {"run_out"}


def test_ground_that_rises_belongs_to_the_steepest_zone_that_holds(field):
    """Backwards up the slope of 35 degrees from its foot."""

    def zones(**own: float) -> set[str]:
        terrain = replace(field.terrain, zones=own, edge_m=0.0)
        section = terrain.section(np.array([60.0, 0.0]), np.pi)
        middle = 0.5 * (section.points_m[1:, 0] + section.points_m[:-1, 0])
        return set(np.array(section.zones)[(middle > 15) & (middle < 40)])

    assert zones(meadow=0, counter=-90) == {"counter"}
    assert zones(slope=15, run_out=0) == {"run_out"}  # the lowest holds below it, too


def test_a_section_across_the_slope_is_less_steep(field):
    turn = np.radians(60.0)
    section = field.terrain.section(np.array([0.0, -10.0]), turn)
    x, y = section.points_m.T
    at = (x >= 0) & (x < 8)
    assert np.diff(y[at]) / np.diff(x[at]) == pytest.approx(-np.tan(np.radians(35.0)) * np.cos(turn))


def test_beyond_the_known_stops_the_ground_has_the_given_inclination(field):
    from rock2d.files.scenario_variants import variant

    rising = variant(field, {"field_test.beyond_deg": 20.0})
    section = rising.terrain.section(np.zeros(2), 0.0)
    x, y = section.points_m.T
    beyond = x > 90
    assert np.diff(y[beyond]) / np.diff(x[beyond]) == pytest.approx(np.tan(np.radians(20.0)))
    assert y[(x > 60) & (x < 80)] == pytest.approx(0.0, abs=1e-9)


def test_directions_point_to_the_mean_stop_and_spread_as_measured(field):
    assert field.terrain.direction_rad(np.zeros(2)) == pytest.approx(0.0, abs=0.05)
    assert np.degrees(field.terrain.lateral_sd_rad) == pytest.approx(5.0, rel=0.1)


def test_a_start_beside_the_terrain_is_refused(field):
    with pytest.raises(InputError, match="no height is known around the start"):
        field.terrain.section(np.array([1000.0, 0.0]), 0.0)


def test_the_data_may_be_named_by_their_folder_or_one_above(tmp_path):
    file = write_field(tmp_path, STOPS)
    for root in (tmp_path, tmp_path / "small"):
        assert len(load_scenario(file, root).terrain.known) == 5


def test_missing_data_are_said(tmp_path, monkeypatch):
    monkeypatch.delenv("ROCK2D_DATA", raising=False)
    file = write_field(tmp_path, STOPS)
    with pytest.raises(InputError, match=r"no data root: give the folder that contains .*small.* with --data"):
        load_scenario(file)
    with pytest.raises(InputError, match=r"no releases\.csv in"):
        load_scenario(file, tmp_path.parent / "nowhere")


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("calibrate_on: [cube]", "calibrate_on: [bal]", "unknown block"),
        ("{cube: 1, box: 2}", "{cube: 1, bix: 2}", "unknown block"),
        ("{cube: 1, box: 2}", "{cube: 1, box: 1}", r"small.yaml:9:29: .*block_id 1 is also that of cube"),
        ("{slope: 15, run_out: -90}", "{slope: 15, run_out: 5}", "must begin at 0 degrees or less"),
        ("folder: small", "folder: ../small", "expected a path inside"),
    ],
)
def test_keys_that_make_no_sense_are_refused(tmp_path, old, new, said):
    file = write_field(tmp_path, STOPS)
    file.write_text(file.read_text().replace(old, new))
    with pytest.raises(InputError, match=said):
        load_scenario(file, tmp_path)
