"""Causes are found by their files, new ones after the published ones."""

import pytest

from rock2d.blind import reality
from rock2d.blind.reality.catalogue import KNOWN, OUTSIDE_CAUSES, causes_in

FILE = "from rock2d.blind.reality.cause import Cause\n\nCAUSE = Cause(None, draw_order={order})\n"


def test_files_are_found_in_draw_order(tmp_path, monkeypatch):
    folder = tmp_path / "some_causes"
    folder.mkdir()
    (folder / "__init__.py").write_text("")
    for name, order in (("b_cause", 1), ("a_cause", 1), ("c_cause", 0)):
        (folder / f"{name}.py").write_text(FILE.format(order=order))
    monkeypatch.syspath_prepend(tmp_path)
    assert list(causes_in("some_causes", folder)) == ["c_cause", "a_cause", "b_cause"]


def test_published_trials_keep_their_order():
    """Seeds assign causes by their place: an addition comes last."""
    assert list(reality.FORMS)[:3] == ["air_drag", "flight_damping", "magnus_lift"]
    assert list(reality.FORMS)[21] == "mirrored_axis", "a new cause sets no draw_order"
    assert next(iter(reality.OUTSIDE)) == "side_wind"
    for causes in (KNOWN, OUTSIDE_CAUSES):
        places = [cause.draw_order for cause in causes.values()]
        assert places == sorted(places)


def test_two_causes_of_one_name_are_refused(tmp_path, monkeypatch):
    folder = tmp_path / "doubled_causes"
    folder.mkdir()
    for name in ("__init__", "first", "second"):
        (folder / f"{name}.py").write_text("" if name == "__init__" else "CAUSES = {'wind': None}\n")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(ValueError, match="two causes of doubled_causes are named wind"):
        causes_in("doubled_causes", folder)
