"""DeepLabCut: several individuals in one file."""

from rock2d_tracking.importing import read_points

from tests.tracking.tracked_files import DEEPLABCUT


def test_with_several_animals_deeplabcut_names_them_all(put):
    lines = DEEPLABCUT.splitlines(keepends=True)
    text = "".join([lines[0], "individuals,stone1,stone1,stone1,stone2,stone2,stone2\n", *lines[1:]])
    points = read_points(put(text), "deeplabcut")
    assert list(dict.fromkeys(points.table["track"])) == ["stone1/centre", "stone2/edge"]
    assert points.line == 4 and points.table["confidence"].iloc[0] == 0.99
