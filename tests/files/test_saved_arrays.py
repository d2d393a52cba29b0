"""Saved arrays come back as they were; anything that cannot be read counts as missing."""

import numpy as np

from rock2d.files.saved_arrays import fingerprint, load_arrays, save_arrays
from rock2d.files.scenario import scenario_file


def test_saved_arrays_come_back(tmp_path):
    path = tmp_path / "some.npz"
    save_arrays(path, a=np.arange(3), name=np.array("one"))
    found = load_arrays(path)
    assert found is not None and found["a"].tolist() == [0, 1, 2] and str(found["name"]) == "one"
    assert [p.name for p in tmp_path.iterdir()] == ["some.npz"]


def test_a_missing_or_damaged_file_is_none(tmp_path):
    assert load_arrays(tmp_path / "none.npz") is None
    (tmp_path / "bad.npz").write_bytes(b"PK\x03\x04 damaged")
    assert load_arrays(tmp_path / "bad.npz") is None


def test_the_fingerprint_follows_the_arrays():
    assert fingerprint(np.arange(3)) == fingerprint(np.arange(3)) != fingerprint(np.arange(4))


def test_shipped_scenarios_are_found():
    assert scenario_file("paper_setup.yaml").is_file()
