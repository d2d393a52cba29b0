"""Indicators against closed forms, published intervals and simulated coverage."""

import numpy as np
import pytest

from rock2d.records.track import Track
from rock2d.runs.indicators.crossings import crossings_table
from rock2d.runs.indicators.passing import passing_table, percentile_table
from rock2d.runs.indicators.releases import stops_table
from rock2d.runs.release_remarks import source_remarks
from rock2d.runs.simulation import Simulation, indicators
from rock2d.scene.blocks import make_block
from rock2d.scene.cross_section import CrossSection
from rock2d.statistics import wilson_interval
from tests import laboratory

G = 9.81
CUBE = make_block("cube", "square", 0.5, side_m=0.1)
GROUND = CrossSection(
    [[0, 0], [4, 0], [6, 2]],
    ["ditch", "face"],
    {"upright": [[2, 0], [2, 3]], "across_face": [[4, 2], [5, 1]]},  # the second is drawn head first
)


def flight(release, x, y, vx, vy, omega=0.0, stop="exit"):
    return laboratory.flight(release, "cube", [x, y, 0.0, vx, vy, omega], 1.0, stop)


def flown(*tracks, ground=GROUND):
    return Simulation("batch", ground, {"cube": CUBE}, list(tracks))


def test_the_state_at_an_upright_line_is_that_of_the_parabola():
    row = crossings_table(flown(flight(3, 0, 1, 4.0, 2.0, omega=-6.0))).iloc[0]
    vy = 2 - G * 0.5  # 2 m at 4 m/s
    inertia = 0.5 * 0.1**2 / 6
    want = {
        "t_s": 0.5,
        "passing_height_m": 1 + 2 * 0.5 - 0.5 * G * 0.25,
        "vx_m_s": 4,
        "vy_m_s": vy,
        "speed_m_s": np.hypot(4, vy),
        "omega_rad_s": -6,
        "theta_rad": -3,
        "incidence_angle_deg": np.degrees(np.arctan2(-vy, 4)),  # below the horizontal
        "translational_J": 0.25 * (16 + vy**2),
        "rotational_J": 0.5 * inertia * 36,
        "kinetic_J": 0.25 * (16 + vy**2) + 0.5 * inertia * 36,
    }
    assert row[list(want)].to_dict() == pytest.approx(want, rel=1e-12)
    assert (row["block"], row["release"], row["line"]) == ("cube", 3, "upright")


def test_heights_and_angles_at_an_inclined_line_are_measured_from_the_face():
    # straight down at x = 4.5: crosses the line from (5, 1) to (4, 2) half way, 45° off its normal
    track = flight(0, 4.5, 3.0, 0.0, 0.0)
    row = crossings_table(flown(track)).iloc[0]
    assert row["line"] == "across_face"
    assert row["passing_height_m"] == pytest.approx(0.5 * np.sqrt(2), rel=1e-12)
    assert row["incidence_angle_deg"] == pytest.approx(45.0, rel=1e-12)  # toward the foot


def test_only_the_first_crossing_counts():
    up_and_back = flight(0, 4.5, 1.0, 0.0, 5.0)
    table = crossings_table(flown(up_and_back))
    assert len(table) == 1
    assert table["vy_m_s"][0] > 0
    assert table["incidence_angle_deg"][0] == pytest.approx(-45.0)


def test_passing_frequencies_count_every_release():
    tracks = [flight(i, 0, 1, 4.0 if i < 43 else 0.5, 2.0) for i in range(50)]
    table = passing_table(flown(*tracks)).set_index("line")
    assert table.loc["upright", ["releases", "passed", "frequency"]].tolist() == [50, 43, 0.86]
    assert table.loc["across_face", "passed"] == 0
    assert table.loc["across_face", ["low95", "high95"]].tolist() == pytest.approx([0, 0.0713], abs=5e-5)


def test_what_was_cut_short_could_have_passed_or_not():
    """The interval holds the frequency whatever the unresolved releases would have done."""
    over, short, cut = (4.0, "exit"), (0.5, "rest"), (0.5, "time")
    kinds = [over] * 10 + [short] * 80 + [cut] * 10
    tracks = [flight(i, 0, 1, vx, 2.0, stop=stop) for i, (vx, stop) in enumerate(kinds)]
    row = passing_table(flown(*tracks)).set_index("line").loc["upright"]
    assert row[["passed", "unresolved", "frequency"]].tolist() == [10, 10, 0.1]
    assert row["low95"] == wilson_interval(10, 100)[0] and row["high95"] == wilson_interval(20, 100)[1]


def test_shares_of_the_blocks_that_arrive_leave_out_those_that_stay():
    """60 of 100 blocks come to the first line, 15 of them to the second: 15 % of the released, 25 % of the arriving;
    of the 40 others 30 stay where they start."""
    ground = CrossSection([[0, 0], [20, 0]], ["floor"], {"far": [[9, 0], [9, 9]], "near": [[4, 0], [4, 9]]})
    ends = [0.2] * 30 + [2.0] * 10 + [6.0] * 45 + [12.0] * 15
    tracks = [flight(i, 0.0, 1.0, x, 5.0, stop="rest") for i, x in enumerate(ends)]
    table = passing_table(flown(*tracks, ground=ground)).set_index("line")
    assert table.loc["far", ["releases", "left_source", "arrived", "passed"]].tolist() == [100, 70, 60, 15]
    assert table.loc["far", ["frequency", "per_arriving"]].tolist() == [0.15, 0.25]
    assert table.loc["far", ["per_arriving_low95", "per_arriving_high95"]].tolist() == list(wilson_interval(15, 60))
    assert table.loc["near", ["arrived", "passed", "per_arriving"]].tolist() == [60, 60, 1.0]
    cut = [flight(100 + i, 0.0, 1.0, 2.0, 5.0, stop="buried") for i in range(10)]  # before the first line
    row = passing_table(flown(*tracks, *cut, ground=ground)).set_index("line").loc["far"]
    assert row[["arrived", "unresolved", "per_arriving"]].tolist() == [60, 10, 0.25]
    assert row["per_arriving_low95"] == wilson_interval(15, 70)[0]
    assert row["per_arriving_high95"] == wilson_interval(25, 70)[1]
    gone = passing_table(flown(*tracks[:40], ground=ground))
    assert gone["arrived"].tolist() == [0, 0] and gone["per_arriving"].isna().all()
    told = [" ".join(source_remarks({"passing": rows})) for rows in (table.reset_index(), gone)]
    assert ["comes as far as a measure line (far, near)" in words for words in told] == [False, True]


def test_percentiles_of_those_that_passed():
    tracks = [flight(i, 0, 1, 4.0 + 0.01 * i, 2.0) for i in range(101)]
    crossings = crossings_table(flown(*tracks))
    table = percentile_table(crossings).set_index(["line", "quantity", "percentile"])
    at_line = np.sort(crossings.loc[crossings["line"] == "upright", "kinetic_J"])
    row = table.loc[("upright", "kinetic_J", 95.0)]
    assert row["value"] == pytest.approx(at_line[95])
    assert row["low95"] < row["value"] < row["high95"]
    assert percentile_table(crossings.iloc[:0]).empty


def test_stops_name_the_zone_and_the_runout():
    rolled = Track(0, "cube", np.array([[0, 1, 0.05, 0, 1, 0, 0], [2, 3, 0.05, 0, 0, 0, 0.0]]),
                   np.array([False, False]), [], "rest", G)  # fmt: skip
    on_face = Track(1, "cube", np.array([[0, 5, 1.05, 0, 0, 0, 0.0]]), np.array([False]), [], "rest", G)
    left = flight(2, 1, 1, 9, 2)
    table = stops_table(flown(rolled, on_face, left))
    assert table["zone"].tolist()[:2] == ["ditch", "face"]
    assert table["zone"].isna().tolist() == [False, False, True]
    assert table["runout_m"].tolist() == pytest.approx([2, 0, 9])


def test_every_file_of_an_indicator_is_found_under_its_name():
    kept = {"crossings", "energy", "envelopes", "impacts", "passing", "percentiles", "stops"}
    assert set(indicators()) >= kept, "names of files do not change"
    for name, indicator in indicators().items():
        assert indicator.name == name and indicator.columns
