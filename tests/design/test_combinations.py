"""The least size over other numbers: each combination is the search of its own scenario, and is kept."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from rock2d.design import command
from rock2d.design.combinations import run_combinations
from rock2d.design.command import run_design
from rock2d.design.least_size import Target
from rock2d.errors import InputError
from tests.scenarios_of_tests import small_site

PLACE, BOUNDS, TARGET = "embankment.height_m", (0.6, 3.0), Target("crest", 0.3, 0.9)
OVER = [("embankment.uphill_deg", 40.0, 90.0)]


@pytest.fixture(scope="module", autouse=True)
def no_page():
    """The page of an answer, which takes longer than the search; `test_least_size.py` has one."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(command, "_write_page", lambda *of: [])
        yield


@pytest.fixture(scope="module")
def searched(tmp_path_factory):
    folder = tmp_path_factory.mktemp("combinations")
    small_site(folder)
    options = {"tolerance": 0.4, "progress": False, "report": str}
    found = run_combinations(folder / "small.yaml", PLACE, BOUNDS, OVER, TARGET, folder / "out", **options)
    return folder, found, options


def test_a_combination_is_the_search_of_its_own_scenario(searched):
    folder, found, options = searched
    assert [values["embankment.uphill_deg"] for values, _ in found] == [40.0, 65.0, 90.0]
    text = (folder / "small.yaml").read_text().replace("uphill_deg: 60", "uphill_deg: 65")
    (folder / "own.yaml").write_text(text)
    own = run_design(folder / "own.yaml", PLACE, BOUNDS, TARGET, folder / "own", **options)
    assert own.least == found[1][1].least
    assert [j.high for j in own.judgements] == [j.high for j in found[1][1].judgements]
    assert own.least is not None
    table = pd.read_csv(folder / "out" / "combinations.csv")
    expected = [np.nan if answer.least is None else answer.least for _, answer in found]
    assert table[f"least {PLACE}"].to_numpy() == pytest.approx(np.array(expected), nan_ok=True)


def test_a_search_that_is_done_is_not_done_again(searched, monkeypatch):
    folder, found, options = searched

    def never(*arguments, **others):
        raise AssertionError("judged again")

    monkeypatch.setattr("rock2d.design.least_size.Search.judge", never)
    again = run_combinations(folder / "small.yaml", PLACE, BOUNDS, OVER, TARGET, folder / "out", **options)
    assert again == found


def test_what_makes_no_sense_is_refused_before_any_work(searched):
    folder, _, options = searched
    for over, said in (
        ([(PLACE, 1.0, 2.0)], "is sought and varied over"),
        ([("embankment.uphill_deg", 60.0, 95.0)], "uphill_deg"),
        ([("embankment.widht", 1.0, 2.0)], "no number"),
        (
            [("embankment.crest_m", 1, 2), ("embankment.x_m", 26, 27), ("releases", 5, 9), ("seed", 1, 3)],
            "too many",
        ),
    ):
        with pytest.raises(InputError, match=said):
            run_combinations(folder / "small.yaml", PLACE, BOUNDS, over, TARGET, folder / "none", **options)
    assert not (folder / "none").exists()
