"""The least volume over several numbers of the earthworks: each combination is the search of its own scenario."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from rock2d.design import command, least_volume
from rock2d.design.command import run_design
from rock2d.design.least_size import Answer, Judgement, Search, Target
from rock2d.design.least_volume import Combination, minimised, volume_text
from rock2d.design.report_sections import _volume_section
from rock2d.errors import InputError
from rock2d.files.scenario_reading import load_scenario
from tests.scenarios_of_tests import small_site

PLACE, BOUNDS, TARGET = "embankment.height_m", (0.6, 3.0), Target("crest", 0.3, 0.9)
OVER = [("embankment.uphill_deg", 50.0, 90.0)]
OPTIONS = {"tolerance": 0.4, "progress": False, "report": str}


@pytest.fixture(scope="module", autouse=True)
def no_page():
    """The page of an answer, which takes longer than the search; `test_least_size.py` has one."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(command, "_write_page", lambda *of: [])
        yield


@pytest.fixture
def few(monkeypatch):
    monkeypatch.setattr(least_volume, "MOST_COMBINATIONS", 6)


@pytest.fixture(scope="module")
def searched(tmp_path_factory):
    folder = tmp_path_factory.mktemp("least_volume")
    small_site(folder)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(least_volume, "MOST_COMBINATIONS", 6)
        answer = run_design(folder / "small.yaml", PLACE, BOUNDS, TARGET, folder / "out", over=OVER, **OPTIONS)
    return folder, answer


def test_the_best_is_the_search_of_its_own_scenario(searched):
    folder, answer = searched
    table = pd.read_csv(folder / "out" / "combinations.csv")
    found = table.dropna()
    assert table["earth_m3_m"].iloc[0] == pytest.approx(found["earth_m3_m"].min())
    assert {50.0, 70.0, 90.0} <= set(table["embankment.uphill_deg"]) and 3 < len(table) <= 6
    text = (folder / "small.yaml").read_text()
    angle = table["embankment.uphill_deg"].iloc[0]
    (folder / "own.yaml").write_text(text.replace("uphill_deg: 60", f"uphill_deg: {angle}"))
    own = run_design(folder / "own.yaml", PLACE, BOUNDS, TARGET, folder / "own", **OPTIONS)
    assert own.least == answer.least is not None
    high = [[j.high["ball"] for j in one.judgements] for one in (own, answer)]
    assert high[0] == pytest.approx(high[1], abs=0.03)  # a release in 40 may stand on a knife edge
    least = load_scenario(folder / "out" / "least.yaml").embankment
    assert least is not None and (least.height_m, least.uphill_deg) == (answer.least, angle)


def test_an_interrupted_search_goes_on_to_the_same_combinations(searched, few, monkeypatch):
    folder, _ = searched
    question = (folder / "small.yaml", PLACE, BOUNDS, TARGET, folder / "cut")
    judge, count = Search.judge, [0]

    def interrupted(*given):
        count[0] += 1
        if count[0] == 4:
            raise KeyboardInterrupt
        return judge(*given)

    monkeypatch.setattr(Search, "judge", interrupted)
    with pytest.raises(KeyboardInterrupt, match="3 sizes are judged"):
        run_design(*question, over=OVER, **OPTIONS)
    run_design(*question, over=OVER, **OPTIONS)
    text = [(folder / name / "combinations.csv").read_text() for name in ("out", "cut")]
    assert text[0] == text[1]
    assert not list(folder.glob(".cut*"))


@pytest.mark.parametrize("best", [(0.0, 1.0), (0.62, 0.31), (1.0, 0.55)])
def test_the_least_volume_is_found_inside_and_at_the_ends_of_ranges(best):
    """A smooth valley, and corners where nothing meets the target."""

    def found(values):
        x, y = values["x"] / 10.0 - 1.0, (values["y"] + 5.0) / 2.0
        volume = 20.0 + 9.0 * (x - best[0]) ** 2 + 6.0 * (y - best[1]) ** 2 + 3.0 * (x - best[0]) * (y - best[1])
        meets = x + y > 0.4
        judged = Judgement(5.0, {"ball": 0.0}, {"ball": 0.0}, {"ball": 0.0 if meets else 0.9}, meets)
        return Combination(values, Answer(PLACE, TARGET, 5.0 if meets else None, 0.1, (judged,)), volume, 0.0)

    tried = minimised(found, {"x": (10.0, 20.0), "y": (-5.0, -3.0)})
    least = min(tried, key=lambda own: own.objective)
    assert len(tried) <= least_volume.MOST_COMBINATIONS
    assert least.earth_m2 < 20.1


def test_where_none_holds_the_objective_leads_to_those_that_nearly_do():
    def with_bound(high):
        judged = Judgement(5.0, {"ball": high}, {"ball": high}, {"ball": high}, False)
        return Combination({}, Answer(PLACE, TARGET, None, 0.1, (judged,)), 10.0, 2.0).objective

    objectives = [with_bound(high) for high in (0.31, 0.5, 1.0)]
    assert objectives == sorted(objectives) and objectives[0] > 24.0


@pytest.mark.parametrize(("best", "ends"), [((1.0, 5.0), ["x"]), ((2.0, 5.0), []), ((3.0, 4.0), ["x", "y"])])
def test_a_least_volume_at_the_end_of_a_range_is_told(best, ends):
    def of(x, y, volume):
        judged = Judgement(5.0, {"ball": 0.0}, {"ball": 0.0}, {"ball": 0.0}, True)
        return Combination({"x": x, "y": y}, Answer(PLACE, TARGET, 5.0, 0.1, (judged,)), volume, 0.0)

    tried = [of(*best, 10.0), *(of(x, y, 20.0) for x in (1.0, 3.0) for y in (4.0, 6.0))]
    said = volume_text(tried).partition("the range of ")[2]
    assert said == (f"{', '.join(ends)} ends there, so a wider range may give less" if ends else "")


def test_the_page_writes_names_and_units_as_they_are():
    judged = Judgement(5.0, {"ball": 0.9}, {"ball": 0.9}, {"ball": 0.9}, False)
    target = Target("Crest", 0.3, 0.9, above_J=5000.0)
    none = Combination({"x": 1.0}, Answer(PLACE, target, None, 0.1, (judged,)), 10.0, 0.0)
    section = _volume_section(SimpleNamespace(combinations=[none]), {})
    assert section is not None and section.texts[0].startswith(f"No combination meets the target: {target.text}.")


@pytest.mark.parametrize(
    ("over", "said"),
    [
        ([(PLACE, 1.0, 2.0)], "is given to --vary and to --over"),
        ([("embankment.uphill_deg", 60.0, 95.0)], "uphill_deg"),
        ([("embankment.uphill_deg", 80.0, 60.0)], "must rise"),
        ([("embankment.widht", 1.0, 2.0)], "no number"),
        ([("blocks.ball.mass_kg", 1.0, 2.0)], "is not a number of the earthworks"),
        ([(f"embankment.{key}", 1, 2) for key in ("crest_m", "x_m", "uphill_deg", "downhill_deg")], "too many"),
    ],
)
def test_what_makes_no_sense_is_refused_before_any_work(searched, over, said):
    folder, _ = searched
    with pytest.raises(InputError, match=said):
        run_design(folder / "small.yaml", PLACE, BOUNDS, TARGET, folder / "none", over=over, **OPTIONS)
    assert not (folder / "none").exists()


def test_the_earth_of_an_embankment_is_its_trapezium_and_that_of_a_ditch_its_hole(tmp_path):
    """On level ground: h (crest + h / 2 (cot uphill + cot downhill)); the facing of the ditch goes on below."""
    from rock2d.scene.cross_section import CrossSection
    from rock2d.scene.earthworks import DitchSizes, EmbankmentSizes, earth_moved_m2, with_earthworks

    level = CrossSection([(-50.0, 0.0), (50.0, 0.0)], ["soil"])
    bank = EmbankmentSizes(x_m=0.0, height_m=3.0, crest_m=2.0, uphill_deg=60.0, downhill_deg=45.0)
    cot = 1.0 / np.tan(np.radians([60.0, 45.0]))
    fill, cut = earth_moved_m2(level, with_earthworks(level, bank))
    assert fill == pytest.approx(3.0 * 2.0 + 4.5 * cot.sum()) and cut == 0.0
    both = with_earthworks(level, bank, DitchSizes(width_m=4.0, depth_m=1.5, uphill_deg=45.0))
    assert earth_moved_m2(level, both) == pytest.approx((fill, 1.5 * 4.0 + 1.125 * cot.sum()))
