"""Tracker: every layout that it exports is read, and what is written for it is read back."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from rock2d_tracking.importers.tracker import write_tracker
from rock2d_tracking.importing import read_points

from tests.laboratory import CUBE
from tests.programs import refusal
from tests.tracking.tracked_files import TRACKER, imported, values


@pytest.mark.parametrize(
    "other",
    [
        TRACKER.replace(",", "\t"),
        TRACKER.replace(",", ";").replace(".", ","),
        TRACKER.replace(",mass A,,,", "mass A").replace(",\n", "\n"),  # version 5
        TRACKER.replace("t,frame,x,y", "t (s),frame,x (m),y (m)").replace("\n", "\r\n"),
    ],
)
def test_every_layout_of_tracker_says_the_same(put, other):
    one, two = read_points(put(TRACKER), "tracker"), read_points(put(other, "other.csv"), "tracker")
    pd.testing.assert_frame_equal(one.table, two.table, check_exact=True)


def test_without_a_title_tracker_is_named_after_the_file_and_pixels_do_if_nothing_else_is_there(put):
    points = read_points(put("t,frame,pixelx,pixely\n0,5,100.5,80.5\n", "fall.txt"), "tracker")
    assert values(points, "fall") == [[100.5, 80.5]] and points.table["frame"].tolist() == [5]


def test_what_is_written_for_tracker_is_read_back_to_the_last_digit(tmp_path):
    rng = np.random.default_rng(3)
    frames = np.array([7, 8, 9, 12, 13])
    rows = pd.DataFrame({"release": 4, "block": "the cube", "t_s": frames / 333.0})
    rows[["x_m", "y_m", "theta_rad"]] = rng.normal(size=(5, 3)) * [1e-6, 1.0, 100.0]
    rows.loc[1, ["x_m", "y_m", "theta_rad"]] = np.nan
    kept = rows.drop(index=1).reset_index(drop=True)
    (path,) = write_tracker(tmp_path / "out.txt", rows, 333.0)
    table = read_points(path, "tracker").table
    assert table["frame"].tolist() == [7, 9, 12, 13] and set(table["track"]) == {"the_cube_release_4"}
    back = table[["time", "u", "v", "theta_rad"]].to_numpy()
    assert (back == kept[["t_s", "x_m", "y_m", "theta_rad"]].to_numpy()).all()
    block = replace(CUBE, name="the cube")
    say = {"metres_per_unit": 1.0, "y": "up", "fps": 333.0}
    again = imported(path, "tracker", **say, block=block)
    pd.testing.assert_frame_equal(again, kept.assign(release=0), check_exact=True)


def test_tracker_can_read_what_is_written_as_a_data_track(tmp_path):
    rows = pd.DataFrame({"release": [0, 0, 2], "block": "cube", "t_s": [0.0, 0.002, 0.005]})
    rows[["x_m", "y_m", "theta_rad"]] = [[1.0, 2.0, 0.5], [1.5, 2.5, 0.25], [3.0, 4.0, 0.125]]
    first, second = write_tracker(tmp_path / "out.txt", rows, 1000)
    assert (first.name, second.name) == ("out_0.txt", "out_2.txt")
    title, header, *lines = first.read_text().splitlines()
    assert title == "cube_release_0" and header.split("\t")[:4] == ["t", "frame", "x", "y"]
    assert lines == ["0.0\t0\t1.0\t2.0\t0.5", "0.001\t1\t\t\t", "0.002\t2\t1.5\t2.5\t0.25"]  # a line a frame
    assert "release 2: t_s 0.005" in refusal(write_tracker, tmp_path / "not.txt", rows, 500).message
    assert not list(tmp_path.glob("not*"))
