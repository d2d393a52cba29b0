"""The answer in plain words: it follows the judgement, shows the bound that is judged, and names what governs."""

from dataclasses import replace
from types import SimpleNamespace

import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rock2d.design.headline import answer_sentence, bound_text, first_sentence, norm_sentence, worst_blocks
from rock2d.design.least_size import Answer, Judgement, Target

SITE = SimpleNamespace(document=SimpleNamespace(data={"embankment": {"x_m": 86.0, "height_m": 4.0}}))
SHARES = st.floats(1e-5, 1.0)


def judgement(size: float, bounds: dict[str, float], target: float) -> Judgement:
    low = dict.fromkeys(bounds, 0.0)
    half = {block: 0.5 * high for block, high in bounds.items()}
    return Judgement(size, half, low, bounds, max(bounds.values()) <= target)


def answer(bounds, target=0.01, place="embankment.height_m", per="released"):
    """An answer over sizes 2, 3, ..., whose least size is the first that meets the target."""
    judged = tuple(judgement(2.0 + i, own, target) for i, own in enumerate(bounds))
    least = next((j.size for j in judged if j.meets), None)
    return Answer(place, Target("crest", target, 0.95, per), least, 0.1, judged)


def shown_bound(sentence: str) -> float:
    return float(sentence.split("up to ")[1].split(" %")[0]) / 100.0


@given(
    st.lists(st.fixed_dictionaries({"ball": SHARES, "cube": SHARES}), min_size=2, max_size=6),
    st.integers(1, 900).map(lambda permille: permille / 1000),
    st.sampled_from(["released", "arriving"]),
    st.sampled_from(["embankment.height_m", "ditch.width_m"]),
)
def test_the_first_sentence_follows_the_verdict_and_its_bound(bounds, target, per, place):
    found = answer(bounds, target, place, per)
    text = answer_sentence(found, SITE)
    met = found.least is not None
    assert ("does not meet the target" in text) is not met and ("meets the target" in text) is met
    assert (shown_bound(text) <= target * (1 + 1e-10)) is met
    assert f"of the {per} blocks" in text and "at 95 % confidence" in text
    shown = next(j for j in found.judgements if j.size == (found.least or found.judgements[-1].size))
    assert f"blocks of {max(shown.high, key=shown.high.get)} do" in text


def test_the_sentence_says_the_height_and_where_the_range_ends():
    met = answer_sentence(answer([{"ball": 0.5}, {"ball": 0.004}]), SITE)
    assert met.startswith("An embankment 3 m high at x = 86 m meets the target that at most 1 % of the released blocks")
    assert "where the range begins" in answer_sentence(answer([{"ball": 0.004}, {"ball": 0.0}]), SITE)
    assert "3 m high at x = 86 m, the largest of the range," in answer_sentence(answer([{"ball": 0.5}] * 2), SITE)


def test_releases_that_were_cut_short_are_named_where_they_decide():
    """3.3 % that sink before the line count as passed: no height brings the bound below 1 %."""
    found = answer([{"ball": 0.05}, {"ball": 0.043}])
    cut = replace(found, judgements=tuple(replace(j, unresolved={"ball": 0.033}) for j in found.judgements))
    text = answer_sentence(cut, SITE)
    assert "3.3 % of the releases of ball were cut short or buried before crest" in text
    assert text.endswith("count as passed; so no size can meet it.") and "cut short" not in answer_sentence(found, SITE)


@pytest.mark.parametrize(
    "bound, target, text", [(0.01004, 0.01, "1.004"), (0.00996, 0.01, "0.996"), (0.01, 0.01, "1.00")]
)
def test_a_bound_has_the_digits_that_show_its_side_of_the_target(bound, target, text):
    assert bound_text(bound, target) == text


def content(found: Answer | None, height: float):
    rows = [("ball", "arrival", "ONR 24810", "height_m", height - 0.5, height - 0.7, height - 0.3),
            ("ball", "arrival", "UNI 11211-4", "height_m", height, height - 0.2, height + 0.2),
            ("ball", "arrival", "UNI 11211-4", "energy_J", 2e6, 1.9e6, 2.1e6)]  # fmt: skip
    values = pd.DataFrame(rows, columns=["block", "line", "norm", "quantity", "design", "low95", "high95"])
    passing = pd.DataFrame({"block": ["ball", "cube"], "line": "crest", "frequency": [0.01, 0.02],
                            "low95": [0.0, 0.01], "high95": [0.05, 0.04]})  # fmt: skip
    tables = {"percentiles": values, "passing": passing}
    return SimpleNamespace(
        answer=found, scenario=SITE, tables=tables, design_values=values, assessment=None, uncertain=None, remarks=[]
    )


@pytest.mark.parametrize(
    "bounds, height, governs",
    [([0.5, 0.001], 4.2, "the norm"), ([0.5, 0.001], 2.5, "the target"), ([0.001, 0.0], 1.0, "begin the range lower"),
     ([0.5, 0.5], 2.5, "the target"), ([0.5, 0.5], 9.0, "enlarge the range")],
)  # fmt: skip
def test_the_higher_of_target_and_norm_governs(bounds, height, governs):
    """Both count from the ground below: the height of an embankment where it stands, that of a norm at the arrival
    line."""
    text = norm_sentence(content(answer([{"ball": high} for high in bounds]), height))
    assert "above the ground where the embankment stands" in text and "at the line arrival" in text
    assert f"UNI 11211-4 requires {height:.2f} [" in text and text.endswith(f"{governs}.")


def test_there_is_no_norm_sentence_if_another_size_was_sought():
    assert norm_sentence(content(answer([{"ball": 0.001}] * 2, place="ditch.width_m"), 3.0)) == ""
    assert norm_sentence(content(None, 3.0)) == ""


def test_without_a_target_the_sentence_gives_the_frequency_with_its_interval_and_the_design_values():
    text = first_sentence(content(None, 3.0))
    assert "blocks of ball" in text and "1.00 [0, 5.00] % pass crest" in text  # the highest bound, not the most passed
    assert "2000 [1900, 2100] kJ (UNI 11211-4, ball)" in text and "3.00 [2.80, 3.20] m" in text


def test_the_worst_block_of_a_search_is_the_one_that_was_judged():
    (worst,) = worst_blocks(content(answer([{"ball": 0.5, "cube": 0.2}, {"ball": 0.002, "cube": 0.007}]), 3.0))
    assert worst is not None and worst.block == "cube" and worst.frequency.high == 0.007
