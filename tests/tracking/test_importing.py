"""What other trackers export, in the layouts they really use, becomes trajectories; mistakes are told with place."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from rock2d_tracking.importers.importing import KINDS, import_tracks, read_points
from rock2d_tracking.importers.tracker_text import write_tracker

from rock2d.errors import InputError
from rock2d.files.experiment import TRAJECTORY_COLUMNS, read_trajectories
from rock2d.scene.blocks import make_block

SPHERE = make_block("sphere", shape="circle", diameter_m=0.025, mass_kg=0.022, inertia="solid_sphere")
CUBE = make_block("cube", shape="square", side_m=0.019, mass_kg=0.0233, inertia="uniform")
SCALE = {"metres_per_unit": 1.0, "y": "up", "fps": 1000.0}

TRACKER = """\
,mass A,,,
t,frame,x,y,
0.000000E0,1.200000E2,-3.500000E0,4.250000E0,
3.333333E-2,1.210000E2,-3.000000E0,4.500000E0,
6.666667E-2,1.220000E2,,,
1.000000E-1,1.230000E2,-2.000000E0,5.000000E0,
"""
MULTI = """\
#multi:
\tA\t\t\tB\t\t\t
t\tframe\tx\ty\tframe\tx\ty\t
0.0\t0\t1.0\t2.0\t0\t2.0\t2.0\t
0.1\t1\t1.0\t2.0\t1\t1.0\t3.0\t
0.2\t2\t1.0\t2.0\t\t\t\t
0.3\t3\t1.0\t2.0\t3\t0.0\t2.0\t
0.4\t4\t1.0\t2.0\t4\t1.0\t1.0\t
0.5\t5\t1.0\t2.0\t5\t2.0\t2.0\t
"""
KINOVEA_TEXT = """\
#Kinovea Trajectory data export
#T X Y

# ball
0.000 77,20 -21,97\x20
0.033 72,19 -25,96\x20
0.067 68,20 -29,94\x20

# red mark
0.033 70,00 -25,00\x20
"""
KINOVEA_CSV = """\
"Time","ball/0/X","ball/0/Y","red mark/0/X","red mark/0/Y"
"0","77.20","-21.97",,
"0.033","72.19","-25.96","70.00","-25.00"
"0.067","68.20","-29.94",,
"""
DLTDV = """\
pt1_cam1_X,pt1_cam1_Y,pt2_cam1_X,pt2_cam1_Y
NaN,NaN,NaN,NaN
100.500000,200.250000,110.500000,200.250000
101.500000,199.250000,NaN,NaN
102.500000,198.250000,112.500000,208.250000
"""
SPARSE = """\
pt1_cam1_X\tpt1_cam1_Y\tpt2_cam1_X\tpt2_cam1_Y
4\t4\t10
2\t1\t100.500000
3\t1\t101.500000
4\t1\t102.500000
2\t2\t200.250000
3\t2\t199.250000
4\t2\t198.250000
2\t3\t110.500000
4\t3\t112.500000
2\t4\t200.250000
4\t4\t208.250000
"""
DEEPLABCUT = """\
scorer,DLC_resnet50,DLC_resnet50,DLC_resnet50,DLC_resnet50,DLC_resnet50,DLC_resnet50
bodyparts,centre,centre,centre,edge,edge,edge
coords,x,y,likelihood,x,y,likelihood
0,10.0,20.0,0.99,11.0,20.0,0.98
1,10.5,21.0,0.40,11.5,21.0,0.97
2,11.0,22.0,0.60,12.0,22.0,0.95
3,11.5,23.0,0.99,12.5,23.0,0.02
"""
FILES = dict(zip(KINDS, (TRACKER, KINOVEA_TEXT, DLTDV, DEEPLABCUT), strict=True))


@pytest.fixture
def put(tmp_path):
    def write(text: str, name: str = "seen.csv"):
        path = tmp_path / name
        path.write_text(text, encoding="utf-8")
        return path

    return write


def values(points, track):
    table = points.table
    return table.loc[table["track"] == track, ["u", "v"]].to_numpy().tolist()


def refusal(function, *args, **kwargs) -> InputError:
    with pytest.raises(InputError) as caught:
        function(*args, **kwargs)
    return caught.value


def test_trackers_time_is_not_believed_but_its_frames_are(put):
    seen = import_tracks([put(TRACKER)], "tracker", **SCALE, block=SPHERE, report=lambda _: None)
    assert tuple(seen.columns) == TRAJECTORY_COLUMNS
    assert seen["t_s"].tolist() == [0.120, 0.121, 0.123]  # the lost frame is a missing row
    assert seen["x_m"].tolist() == [-3.5, -3.0, -2.0] and seen["y_m"].tolist() == [4.25, 4.5, 5.0]


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


def test_two_marks_tell_an_unwrapped_orientation_and_both_must_be_seen(put):
    seen = import_tracks(put(MULTI), "tracker", **SCALE, block=CUBE, marks=("A", "B"))
    quarters = np.array([0, 1, 2, 3, 4]) * np.pi / 2
    assert seen["theta_rad"].to_numpy() == pytest.approx(quarters, abs=1e-12)
    assert seen["t_s"].tolist() == [0.0, 0.001, 0.003, 0.004, 0.005]
    assert set(zip(seen["x_m"], seen["y_m"], strict=True)) == {(1.0, 2.0)}  # the first mark
    both = import_tracks(put(MULTI), "tracker", **SCALE, block=CUBE, marks=("A", "B"), centroid=("A", "B"))
    assert both["x_m"].tolist() == [1.5, 1.0, 0.5, 1.0, 1.5]


def test_y_down_is_mirrored_in_place_and_in_turning(put):
    path = put(MULTI)
    say = {"metres_per_unit": 0.01, "fps": 500.0, "block": CUBE, "marks": ("A", "B"), "origin": (1.0, 1.0)}
    up = import_tracks(path, "tracker", y="up", origin_m=(0.5, 0.25), **say)
    down = import_tracks(path, "tracker", y="down", origin_m=(0.5, 0.25), **say)
    assert up["y_m"].tolist() == [0.26] * 5 and down["y_m"].tolist() == [0.24] * 5
    assert up["x_m"].tolist() == down["x_m"].tolist() == [0.5] * 5
    assert down["theta_rad"].to_numpy() == pytest.approx(-up["theta_rad"].to_numpy())


def test_marks_may_lie_in_files_of_their_own(put):
    lines = MULTI.splitlines()[3:]
    a, b = (
        put(
            f"mark_{name}\nt\tframe\tx\ty\n"
            + "".join(
                "\t".join([line.split("\t")[0], *line.split("\t")[k : k + 3]]) + "\n" for line in lines
            ),
            f"{name}.txt",
        )
        for name, k in (("A", 1), ("B", 4))
    )
    apart = import_tracks([(a, b)], "tracker", **SCALE, block=CUBE, marks=("mark_A", "mark_B"))
    together = import_tracks(put(MULTI), "tracker", **SCALE, block=CUBE, marks=("A", "B"))
    pd.testing.assert_frame_equal(apart, together, check_exact=True)
    assert "is also in" in refusal(import_tracks, [(a, a)], "tracker", **SCALE, block=CUBE).message


def test_one_mark_shows_no_spin(put):
    heard = []
    seen = import_tracks([put(TRACKER)], "tracker", **SCALE, block=SPHERE, report=heard.append)
    assert seen["theta_rad"].tolist() == [0.0] * 3
    assert len(heard) == 1 and "sphere" in heard[0] and "spin" in heard[0]
    error = refusal(import_tracks, [put(TRACKER)], "tracker", **SCALE, block=CUBE)
    assert "cube" in error.message and error.line == 2


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
    block = make_block("the cube", shape="square", side_m=0.019, mass_kg=0.0233, inertia="uniform")
    say = {"metres_per_unit": 1.0, "y": "up", "fps": 333.0}
    again = import_tracks(path, "tracker", **say, block=block, first_release=4)
    pd.testing.assert_frame_equal(again, kept, check_exact=True)


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


@pytest.mark.parametrize(
    "text",
    [
        KINOVEA_CSV,
        KINOVEA_CSV.replace(",", ";").replace(".", ","),  # decimal commas between semicolons
        KINOVEA_CSV.replace(".", ","),  # and in quotes between commas
        KINOVEA_CSV.replace('"', ""),
        KINOVEA_CSV.replace("Time", "Time (ms)").replace('"0.0', '"').replace('"33"', '"33.0"'),
        KINOVEA_TEXT.replace(",", "."),
        KINOVEA_TEXT.replace("0.033", "0:00:00:033").replace("0.067", "0:00:00:067"),
    ],
)
def test_in_kinovea_a_decimal_comma_is_a_decimal_point_in_every_layout(put, text):
    points = read_points(put(text), "kinovea")
    assert values(points, "ball") == [[77.20, -21.97], [72.19, -25.96], [68.20, -29.94]]
    assert values(points, "red mark") == [[70.0, -25.0]]
    times = points.table.loc[points.table["track"] == "ball", "time"]
    assert times.tolist() == pytest.approx([0.0, 0.033, 0.067])


def test_old_kinovea_text_has_tracks_without_names(put):
    old = (
        "#Kinovea Trajectory data export\n#T X Y\n0:00:00:00 8 3 \n0:00:00:04 7 3 \n\n\n0:00:00:04 1 4 \n\n\n"
    )
    points = read_points(put(old), "kinovea")
    assert values(points, "track 1") == [[8, 3], [7, 3]] and values(points, "track 2") == [[1, 4]]


def test_the_files_times_count_its_frames_and_the_true_frame_rate_tells_the_time(put):
    path = put(KINOVEA_TEXT)
    say = {**SCALE, "metres_per_unit": 0.01, "block": SPHERE, "marks": ("ball",), "report": lambda _: None}
    seen = import_tracks(path, "kinovea", **say, file_fps=30)
    assert seen["t_s"].tolist() == [0.0, 0.001, 0.002]
    assert "file_fps" in refusal(import_tracks, path, "kinovea", **say).message
    wrong = refusal(import_tracks, path, "kinovea", **say, file_fps=45)
    assert "between frames" in wrong.message and wrong.line == 6
    assert "second point in frame 0" in refusal(import_tracks, path, "kinovea", **say, file_fps=10).message


def test_dltdv_rows_are_frames_and_nan_is_lost(put):
    points = read_points(put(DLTDV), "dltdv")
    assert points.table["frame"].tolist() == [1, 1, 2, 3, 3]
    say = {"metres_per_unit": 0.001, "fps": 250.0, "block": CUBE, "marks": ("pt1_cam1", "pt2_cam1")}
    up, down = (import_tracks(put(DLTDV), "dltdv", y=y, **say) for y in ("up", "down"))
    assert up["t_s"].tolist() == [1 / 250, 3 / 250]
    assert up["y_m"].tolist() == [-y for y in down["y_m"]] == [0.20025, 0.19825]
    assert up["theta_rad"].to_numpy() == pytest.approx([0, np.pi / 4])
    assert down["theta_rad"].to_numpy() == pytest.approx([0, -np.pi / 4])


def test_dltdvs_sparse_form_and_names_without_a_camera_hold_the_same_points(put):
    dense = read_points(put(DLTDV), "dltdv").table.sort_values(["track", "frame"])
    sparse = read_points(put(SPARSE, "data_xypts.tsv"), "dltdv").table.sort_values(["track", "frame"])
    bare = read_points(put(DLTDV.replace("_cam1", "")), "dltdv").table.sort_values(["track", "frame"])
    for other in (sparse, bare):
        assert (
            other[["frame", "u", "v"]].to_numpy().tolist() == dense[["frame", "u", "v"]].to_numpy().tolist()
        )
    assert set(sparse["track"]) == {"pt1_cam1", "pt2_cam1"} and set(bare["track"]) == {"pt1", "pt2"}


def test_below_the_given_likelihood_a_frame_is_lost(put):
    path, say = put(DEEPLABCUT), {**SCALE, "y": "down", "block": CUBE, "marks": ("centre", "edge")}
    assert "min_confidence" in refusal(import_tracks, path, "deeplabcut", **say).message
    for least, frames in ((0, [0, 1, 2, 3]), (0.6, [0, 2]), (0.61, [0])):
        seen = import_tracks(path, "deeplabcut", **say, min_confidence=least)
        assert seen["t_s"].tolist() == [frame / 1000 for frame in frames]
    assert "no frame" in refusal(import_tracks, path, "deeplabcut", **say, min_confidence=0.995).message


def test_with_several_animals_deeplabcut_names_them_all(put):
    lines = DEEPLABCUT.splitlines(keepends=True)
    text = "".join([lines[0], "individuals,stone1,stone1,stone1,stone2,stone2,stone2\n", *lines[1:]])
    points = read_points(put(text), "deeplabcut")
    assert list(dict.fromkeys(points.table["track"])) == ["stone1/centre", "stone2/edge"]
    assert points.line == 4 and points.table["confidence"].iloc[0] == 0.99


def test_releases_are_parted_by_long_gaps_or_by_files(put, tmp_path):
    rows = "".join(f"0,{frame},{frame},0\n" for frame in (0, 1, 4, 5, 9, 10))
    path = put("A\nt,frame,x,y\n" + rows)
    say = {**SCALE, "block": SPHERE, "report": lambda _: None}
    for gap, releases in ((None, [0] * 6), (3, [0] * 6), (2, [0, 0, 0, 0, 1, 1]), (1, [0, 0, 1, 1, 2, 2])):
        assert import_tracks(path, "tracker", **say, gap_frames=gap)["release"].tolist() == releases
    two = import_tracks([path, put(TRACKER, "b.csv")], "tracker", **say, first_release=7)
    assert two["release"].tolist() == [7] * 6 + [8] * 3
    two.to_csv(tmp_path / "trajectories.csv", index=False)
    pd.testing.assert_frame_equal(read_trajectories(tmp_path / "trajectories.csv", {"sphere"}), two)


def test_a_turn_is_not_lost_between_releases(put):
    path = put(
        "pt1_X,pt1_Y,pt2_X,pt2_Y\n0,0,-1,0.1\n0,0,-1,-0.1\n" + "NaN,NaN,NaN,NaN\n" * 9 + "0,0,-1,-0.1\n"
    )
    seen = import_tracks(path, "dltdv", **SCALE, block=CUBE, marks=("pt1", "pt2"), gap_frames=3)
    assert seen["release"].tolist() == [0, 0, 1]
    assert np.diff(seen["theta_rad"])[0] == pytest.approx(2 * np.arctan(0.1))  # on through half a turn


@pytest.mark.parametrize("chosen", KINDS)
@pytest.mark.parametrize("real", KINDS)
def test_the_wrong_kind_is_told_and_the_right_one_named(put, chosen, real):
    path = put(FILES[real])
    if chosen == real:
        assert not read_points(path, chosen).table.empty
        return
    error = refusal(read_points, path, chosen)
    assert f"looks like {real}" in error.message and (error.file, error.line) == (path, 1)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("text", "line"), [("", 1), ("\n\n", 1), ("what,ever\n1,2\n", 1)])
def test_a_file_that_is_empty_or_something_else_is_told(put, kind, text, line):
    error = refusal(read_points, put(text), kind)
    assert error.line == line and str(error.file).endswith("seen.csv")


@pytest.mark.parametrize(
    ("kind", "old", "new", "line", "words"),
    [
        ("tracker", "-3.000000E0", "-3.0.0", 4, "column x: expected a number, found '-3.0.0'"),
        ("tracker", "4.500000E0", "inf", 4, "column y: expected a number"),
        ("tracker", "1.210000E2", "1.215000E2", 4, "121.5 is no frame"),
        ("tracker", "1.210000E2", "", 4, "is no frame"),
        ("tracker", "4.500000E0,", "4.5,6.7,8.9,", 4, "expected 5 cells, found 7"),
        ("tracker", "t,frame,x,y", "t,frame,x,vy", 2, "track 'mass A' has no column y"),
        ("kinovea", "72,19 -25,96", "72,19", 6, "expected a time, x and y, found 2 cells"),
        ("kinovea", "72,19", "1.072,19", 6, "column x: expected a number"),
        ("dltdv", "101.500000", "1O1.5", 4, "column pt1_cam1_X: expected a number"),
        ("dltdv", "101.500000,", "", 4, "expected 4 cells, found 3"),
        ("dltdv", "pt2_cam1_Y", "pt3_cam1_Y", 1, "pt2_cam1 has no column pt2_cam1_Y"),
        ("dltdv", "pt2_cam1_Y", "pt1_cam1_Z", 1, "points in space"),
        ("dltdv", "pt2_cam1_Y", "offset", 1, "column 'offset'"),
        ("deeplabcut", "0.40", "high", 5, "column centre likelihood: expected a number, found 'high'"),
        ("deeplabcut", "1,10.5,", "10.5,", 5, "expected 7 cells, found 6"),
        ("deeplabcut", "1,10.5,", "labeled-data/film/img1.png,10.5,", 5, "for training"),
        ("deeplabcut", "coords,x,y,", "coords,x,z,", 3, "points in space"),
        ("deeplabcut", "bodyparts,", "parts,", 1, "no line bodyparts"),
    ],
)
def test_a_mistake_is_told_with_file_and_line(put, kind, old, new, line, words):
    assert old in FILES[kind]
    path = put(FILES[kind].replace(old, new, 1))
    error = refusal(read_points, path, kind)
    assert words in error.message and (error.file, error.line) == (path, line)


@pytest.mark.parametrize(
    ("old", "new", "line", "words"),
    [
        ('"ball/0/X"', '"ball speed"', 1, "no coordinate"),
        ('"red mark/0/Y"', '"mark/0/Y"', 1, "'red mark' has no column Y"),
        ('"72.19"', "72,19", 3, "expected 5 cells, found 6; decimal commas"),
        ('"0.033"', "", 3, "is no time"),
        ('"0.033"', '"soon"', 3, "column time: expected a number, found 'soon'"),
    ],
)
def test_a_mistake_in_kinoveas_csv_is_told_with_file_and_line(put, old, new, line, words):
    error = refusal(read_points, put(KINOVEA_CSV.replace(old, new, 1)), "kinovea")
    assert words in error.message and error.line == line


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"marks": ("A", "C")}, "no track 'C'"),
        ({"marks": ("A", "B"), "centroid": ("middle",)}, "no track 'middle'; there is 'A', 'B'"),
        ({"marks": ()}, "name the marks: there is 'A', 'B'"),
        ({"marks": ("A", "B", "A")}, "one or two marks"),
        ({"y": "left"}, "up or down"),
        ({"metres_per_unit": 0.0}, "metres_per_unit"),
        ({"fps": float("nan")}, "fps: expected a positive number"),
        ({"file_fps": -1.0}, "file_fps: expected a positive number"),
    ],
)
def test_what_is_said_of_a_file_must_be_possible(put, change, words):
    say = {**SCALE, "block": CUBE, "marks": ("A", "B"), **change}
    assert words in refusal(import_tracks, put(MULTI), "tracker", **say).message


def test_marks_at_one_point_and_no_file_and_no_such_kind_are_refused(put):
    say = {**SCALE, "block": CUBE, "marks": ("A", "B")}
    error = refusal(import_tracks, put(MULTI.replace("1.0\t3.0", "1.0\t2.0")), "tracker", **say)
    assert "no direction" in error.message and error.line == 5
    assert "at least one file" in refusal(import_tracks, [], "tracker", **say).message
    assert "did you mean 'tracker'" in refusal(read_points, put(MULTI), "traker").message
    assert "cannot be read" in refusal(read_points, "nowhere.csv", "tracker").message
