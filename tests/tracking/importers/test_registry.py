"""The importers are found by their files; each refuses files of the others and reports mistakes with their place."""

import pytest
from rock2d_tracking import importers
from rock2d_tracking.importers import find_importer, importer_names
from rock2d_tracking.importing import read_points

from tests.docs.test_recipes import EXAMPLES
from tests.programs import printed, refusal
from tests.tracking.tracked_files import FILES, values


@pytest.mark.parametrize("chosen", importer_names())
@pytest.mark.parametrize("real", importer_names())
def test_the_wrong_kind_is_told_and_the_right_one_named(put, chosen, real):
    assert real in FILES, f"tracked_files.FILES has no file of {real}"
    path = put(FILES[real])
    if chosen == real:
        assert not read_points(path, chosen).table.empty
        return
    assert not find_importer(chosen).looks_like(FILES[real]), f"a file of {real} looks like one of {chosen}, too"
    error = refusal(read_points, path, chosen)
    assert f"looks like {real}" in error.message and (error.file, error.line) == (path, 1)


@pytest.mark.parametrize("kind", importer_names())
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


def test_a_format_is_added_as_one_file(put, tmp_path, monkeypatch):
    known = importer_names()
    (tmp_path / "plain.py").write_text(EXAMPLES["plain"])
    monkeypatch.setattr(importers, "__path__", [*importers.__path__, str(tmp_path)])
    assert importer_names() == tuple(sorted([*known, "plain"]))
    path = put("image,u,v\n3,1.5,2.5\n")
    assert values(read_points(path, "plain"), "point") == [[1.5, 2.5]]
    assert "looks like plain" in refusal(read_points, path, "kinovea").message
    chosen = printed(
        f"from rock2d_tracking import importers; importers.__path__.append({str(tmp_path)!r})\n"
        "from rock2d.cli import cli\n"
        "print(*next(p for p in cli.commands['import'].params if p.name == 'kind').type.choices)"
    ).split()
    assert chosen == list(importer_names())


def test_the_command_line_names_the_formats_without_heavy_imports():
    heavy = ("numpy", "pandas", "cv2", "numba", "pydantic")
    assert printed(f"import sys, rock2d.cli; print(*(m for m in {heavy} if m in sys.modules))") == ""
