"""Order statistics of numbers that come in parts: those of sorting, with few numbers in memory."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rock2d.runs.campaigns.order_statistics import DIGITS, OrderStatistics, find_order_statistics, leading_digits

UNTIMED = settings(deadline=None)  # a loaded machine is no fault
numbers = st.floats(allow_nan=False, allow_infinity=False, width=64)
ties = st.sampled_from([0.0, -0.0, 1.0, -1.0, 1.0 + 2**-52, 5e-324, -5e-324])
NONE, ALL = 0, 1 << 22  # numbers that may be collected


def statistics(values: np.ndarray, ranks: list[int]) -> OrderStatistics:
    return OrderStatistics(ranks, np.bincount(leading_digits(values), minlength=DIGITS))


@UNTIMED
@given(st.lists(st.lists(numbers | ties, max_size=20), min_size=1, max_size=5), st.sampled_from([NONE, 3, ALL]))
def test_order_statistics_are_those_of_sorting(parts, most_collected):
    values = np.concatenate([np.array(part, float) for part in parts])
    own = statistics(values, list(range(len(values))))
    find_order_statistics(
        {"x": own}, lambda: ({"x": np.array(part, float)} for part in reversed(parts)), most_collected
    )
    assert list(own.values().values()) == np.sort(values).tolist()


@pytest.mark.parametrize("most_collected", [NONE, 2000, ALL])
@pytest.mark.parametrize("decimals", [16, 1, 0])
def test_values_that_are_tied_and_negative_have_their_ranks(most_collected, decimals):
    rng = np.random.default_rng(4)
    values = {name: rng.normal(mean, 3.0, 20_000).round(decimals) for name, mean in {"a": 0.0, "b": -20.0}.items()}
    ranks = [0, 1, 9_999, 10_000, 18_998, 19_999]
    sought = {name: statistics(own, ranks) for name, own in values.items()}
    firsts = range(0, 20_000, 999)
    parts = [{name: own[i : i + 999] for name, own in values.items()} for i in firsts]
    find_order_statistics(sought, lambda: parts, most_collected)
    for name, own in sought.items():
        assert own.values() == {rank: np.sort(values[name])[rank] for rank in ranks}


def test_few_numbers_are_in_memory_and_are_looked_at_again_only_where_they_are_too_many():
    values = 1.0 + np.random.default_rng(4).uniform(size=100_000)  # 16 leading digits
    for most_collected, passes in {ALL: 1, 10_000: 1, 6_000: 2}.items():
        own, looks = statistics(values, [95_000]), []

        def look(numbers, collect, own=own, looks=looks, most=most_collected):
            looks.append(collect)
            assert not collect or own.candidates <= most
            OrderStatistics.add(own, numbers, collect)

        own.add = look  # type: ignore[method-assign]
        find_order_statistics({"x": own}, lambda: iter([{"x": values}]), most_collected)
        assert looks == [False] * (passes - 1) + [True]
        assert own.values() == {95_000: np.sort(values)[95_000]}
