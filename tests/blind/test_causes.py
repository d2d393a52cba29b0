"""Causes are found by their files, new ones after the published ones."""

import pytest

from rock2d.blind import reality
from rock2d.blind.reality.catalogue import causes_in


def test_tables_keep_their_order_and_files_of_one_cause_follow_by_name(tmp_path, monkeypatch):
    folder = tmp_path / "some_causes"
    folder.mkdir()
    (folder / "__init__.py").write_text("")
    for name, text in (
        ("b_cause", "CAUSE = 'b'"), ("a_cause", "CAUSE = 'a'"), ("table", "CAUSES = {'wind': 'd', 'rain': 'c'}"),
    ):  # fmt: skip
        (folder / f"{name}.py").write_text(f"{text}\n")
    monkeypatch.syspath_prepend(tmp_path)
    assert list(causes_in("some_causes", folder)) == ["wind", "rain", "a_cause", "b_cause"]


def test_published_trials_keep_their_order():
    """Seeds assign causes by their place: an addition comes last."""
    assert list(reality.FORMS)[:3] == ["air_drag", "flight_damping", "magnus_lift"]
    assert list(reality.FORMS)[21:23] == ["mirrored_axis", "keystone_distortion"], "a new cause comes last"
    assert next(iter(reality.OUTSIDE)) == "side_wind"
    assert list(reality.OUTSIDE)[10:12] == ["place_restitution", "speed_dependent_friction"]


def test_two_causes_of_one_name_are_refused(tmp_path, monkeypatch):
    folder = tmp_path / "doubled_causes"
    folder.mkdir()
    for name in ("__init__", "first", "second"):
        (folder / f"{name}.py").write_text("" if name == "__init__" else "CAUSES = {'wind': None}\n")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(ValueError, match="two causes of doubled_causes are named wind"):
        causes_in("doubled_causes", folder)
