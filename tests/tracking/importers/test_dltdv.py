"""DLTdv: tables with and without gaps, dense and sparse."""

import numpy as np
import pytest
from rock2d_tracking.importing import read_points

from tests.laboratory import CUBE
from tests.tracking.tracked_files import DLTDV, SPARSE, imported


def test_dltdv_rows_are_frames_and_nan_is_lost(put):
    points = read_points(put(DLTDV), "dltdv")
    assert points.table["frame"].tolist() == [1, 1, 2, 3, 3]
    say = {"metres_per_unit": 0.001, "fps": 250.0, "block": CUBE, "marks": ("pt1_cam1", "pt2_cam1")}
    up, down = (imported(put(DLTDV), "dltdv", y=y, **say) for y in ("up", "down"))
    assert up["t_s"].tolist() == [1 / 250, 3 / 250]
    assert up["y_m"].tolist() == [-y for y in down["y_m"]] == [0.20025, 0.19825]
    assert up["theta_rad"].to_numpy() == pytest.approx([0, np.pi / 4])
    assert down["theta_rad"].to_numpy() == pytest.approx([0, -np.pi / 4])


def test_dltdvs_sparse_form_and_names_without_a_camera_hold_the_same_points(put):
    dense = read_points(put(DLTDV), "dltdv").table.sort_values(["track", "frame"])
    sparse = read_points(put(SPARSE, "data_xypts.tsv"), "dltdv").table.sort_values(["track", "frame"])
    bare = read_points(put(DLTDV.replace("_cam1", "")), "dltdv").table.sort_values(["track", "frame"])
    for other in (sparse, bare):
        assert other[["frame", "u", "v"]].to_numpy().tolist() == dense[["frame", "u", "v"]].to_numpy().tolist()
    assert set(sparse["track"]) == {"pt1_cam1", "pt2_cam1"} and set(bare["track"]) == {"pt1", "pt2"}
