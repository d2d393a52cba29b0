"""Tracks of other programs become trajectories: time, scale, orientation, releases; mistakes are reported."""

import numpy as np
import pandas as pd
import pytest
from rock2d_tracking.importing import read_points

from rock2d.files.experiment import TRAJECTORY_COLUMNS, read_trajectories
from tests.laboratory import CUBE, SPHERE
from tests.programs import refusal
from tests.tracking.tracked_files import DEEPLABCUT, KINOVEA_TEXT, MULTI, SCALE, TRACKER, imported


def test_trackers_time_is_not_believed_but_its_frames_are(put):
    seen = imported([put(TRACKER)], "tracker", **SCALE, block=SPHERE, report=lambda _: None)
    assert tuple(seen.columns) == TRAJECTORY_COLUMNS
    assert seen["t_s"].tolist() == [0.120, 0.121, 0.123]  # the lost frame is a missing row
    assert seen["x_m"].tolist() == [-3.5, -3.0, -2.0] and seen["y_m"].tolist() == [4.25, 4.5, 5.0]


def test_two_marks_tell_an_unwrapped_orientation_and_both_must_be_seen(put):
    seen = imported(put(MULTI), "tracker", **SCALE, block=CUBE, marks=("A", "B"))
    quarters = np.array([0, 1, 2, 3, 4]) * np.pi / 2
    assert seen["theta_rad"].to_numpy() == pytest.approx(quarters, abs=1e-12)
    assert seen["t_s"].tolist() == [0.0, 0.001, 0.003, 0.004, 0.005]
    assert set(zip(seen["x_m"], seen["y_m"], strict=True)) == {(1.0, 2.0)}  # the first mark
    both = imported(put(MULTI), "tracker", **SCALE, block=CUBE, marks=("A", "B"), centroid=("A", "B"))
    assert both["x_m"].tolist() == [1.5, 1.0, 0.5, 1.0, 1.5]


def test_y_down_is_mirrored_in_place_and_in_turning(put):
    path = put(MULTI)
    say = {"metres_per_unit": 0.01, "fps": 500.0, "block": CUBE, "marks": ("A", "B"), "origin": (1.0, 1.0)}
    up = imported(path, "tracker", y="up", origin_m=(0.5, 0.25), **say)
    down = imported(path, "tracker", y="down", origin_m=(0.5, 0.25), **say)
    assert up["y_m"].tolist() == [0.26] * 5 and down["y_m"].tolist() == [0.24] * 5
    assert up["x_m"].tolist() == down["x_m"].tolist() == [0.5] * 5
    assert down["theta_rad"].to_numpy() == pytest.approx(-up["theta_rad"].to_numpy())


def test_one_mark_shows_no_spin(put):
    heard = []
    seen = imported([put(TRACKER)], "tracker", **SCALE, block=SPHERE, report=heard.append)
    assert seen["theta_rad"].isna().all()
    assert len(heard) == 1 and "sphere" in heard[0] and "spin" in heard[0]
    error = refusal(imported, [put(TRACKER)], "tracker", **SCALE, block=CUBE)
    assert "cube" in error.message and error.line == 2


def test_the_files_times_count_its_frames_and_the_true_frame_rate_tells_the_time(put):
    path = put(KINOVEA_TEXT)
    say = {**SCALE, "metres_per_unit": 0.01, "block": SPHERE, "marks": ("ball",), "report": lambda _: None}
    seen = imported(path, "kinovea", **say, file_fps=30)
    assert seen["t_s"].tolist() == [0.0, 0.001, 0.002]
    assert "file_fps" in refusal(imported, path, "kinovea", **say).message
    wrong = refusal(imported, path, "kinovea", **say, file_fps=45)
    assert "between frames" in wrong.message and wrong.line == 6
    assert "second point in frame 0" in refusal(imported, path, "kinovea", **say, file_fps=10).message


def test_below_the_given_likelihood_a_frame_is_lost(put):
    path, say = put(DEEPLABCUT), {**SCALE, "y": "down", "block": CUBE, "marks": ("centre", "edge")}
    assert "min_confidence" in refusal(imported, path, "deeplabcut", **say).message
    for least, frames in ((0, [0, 1, 2, 3]), (0.6, [0, 2]), (0.61, [0])):
        seen = imported(path, "deeplabcut", **say, min_confidence=least)
        assert seen["t_s"].tolist() == [frame / 1000 for frame in frames]
    assert "no frame" in refusal(imported, path, "deeplabcut", **say, min_confidence=0.995).message


def test_releases_are_parted_by_long_gaps_or_by_files(put, tmp_path):
    rows = "".join(f"0,{frame},{frame},0\n" for frame in (0, 1, 4, 5, 9, 10))
    path = put("A\nt,frame,x,y\n" + rows)
    say = {**SCALE, "block": SPHERE, "report": lambda _: None}
    for gap, releases in ((None, [0] * 6), (3, [0] * 6), (2, [0, 0, 0, 0, 1, 1]), (1, [0, 0, 1, 1, 2, 2])):
        assert imported(path, "tracker", **say, gap_frames=gap)["release"].tolist() == releases
    two = imported([path, put(TRACKER, "b.csv")], "tracker", **say)
    assert two["release"].tolist() == [0] * 6 + [1] * 3
    two.to_csv(tmp_path / "trajectories.csv", index=False)
    pd.testing.assert_frame_equal(read_trajectories(tmp_path / "trajectories.csv", {"sphere"}), two)


def test_a_turn_is_not_lost_between_releases(put):
    path = put("pt1_X,pt1_Y,pt2_X,pt2_Y\n0,0,-1,0.1\n0,0,-1,-0.1\n" + "NaN,NaN,NaN,NaN\n" * 9 + "0,0,-1,-0.1\n")
    seen = imported(path, "dltdv", **SCALE, block=CUBE, marks=("pt1", "pt2"), gap_frames=3)
    assert seen["release"].tolist() == [0, 0, 1]
    assert np.diff(seen["theta_rad"])[0] == pytest.approx(2 * np.arctan(0.1))  # on through half a turn


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"marks": ("A", "C")}, "no track 'C'"),
        ({"marks": ("A", "B"), "centroid": ("middle",)}, "no track 'middle'; the tracks are 'A', 'B'"),
        ({"marks": ()}, "marks: name one or two of the tracks 'A', 'B'"),
        ({"marks": ("A", "B", "A")}, "marks: expected one or two"),
        ({"file_fps": -1.0}, "file_fps: expected a positive number"),
    ],
)
def test_what_is_said_of_a_file_must_be_possible(put, change, words):
    say = {**SCALE, "block": CUBE, "marks": ("A", "B"), **change}
    assert words in refusal(imported, put(MULTI), "tracker", **say).message


def test_marks_at_one_point_and_no_such_kind_are_refused(put):
    say = {**SCALE, "block": CUBE, "marks": ("A", "B")}
    error = refusal(imported, put(MULTI.replace("1.0\t3.0", "1.0\t2.0")), "tracker", **say)
    assert "no direction" in error.message and error.line == 5
    assert "did you mean 'tracker'" in refusal(read_points, put(MULTI), "traker").message
    assert "cannot be read" in refusal(read_points, "nowhere.csv", "tracker").message
