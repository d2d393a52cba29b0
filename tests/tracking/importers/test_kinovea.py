"""Kinovea: CSV and text with decimal points or commas; mistakes are reported with their place."""

import pytest
from rock2d_tracking.importing import read_points

from tests.programs import refusal
from tests.tracking.tracked_files import KINOVEA_CSV, KINOVEA_TEXT, values


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
    old = "#Kinovea Trajectory data export\n#T X Y\n0:00:00:00 8 3 \n0:00:00:04 7 3 \n\n\n0:00:00:04 1 4 \n\n\n"
    points = read_points(put(old), "kinovea")
    assert values(points, "track 1") == [[8, 3], [7, 3]] and values(points, "track 2") == [[1, 4]]


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
