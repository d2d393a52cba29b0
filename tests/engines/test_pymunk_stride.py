"""What the pymunk engine notes between its calls: which facets are near, and every knot of a stride."""

import numpy as np
import pytest

from rock2d.engines.pymunk_engine import PymunkRelease
from rock2d.engines.pymunk_stride import N_ROW
from tests.laboratory import BLOCKS, CONTRAST, random_state, rough


def strides_of(sim: PymunkRelease, time_limit_s: float = 0.25) -> list:
    found = []
    while sim.time < time_limit_s:
        found.append(sim.step())
    return found


@pytest.mark.parametrize("name", BLOCKS)
def test_the_facets_near_are_those_that_a_query_of_the_space_finds(name):
    sim = PymunkRelease(BLOCKS[name], rough(1), CONTRAST, random_state(1))
    sizes = []
    while sim.time < 0.25:
        sim.step()
        hits = sim.space.shape_query(sim._shape)
        assert sim._near_facets == {sim._facet_of[hit.shape] for hit in hits if hit.shape}
        sizes.append(len(sim._near_facets))
    assert 0 in sizes and max(sizes) > 1  # the block flew, and met several facets at once


def test_a_stride_of_many_knots_is_the_same_in_several_calls():
    whole, parts = (PymunkRelease(BLOCKS["cube"], rough(1), CONTRAST, random_state(1)) for _ in range(2))
    parts._rows = np.empty((2, N_ROW))  # one law step a call
    one, other = strides_of(whole), strides_of(parts)
    assert max(map(len, one)) > 1 and [len(knots) for knots in one] == [len(knots) for knots in other]
    assert np.array_equal(np.concatenate(one), np.concatenate(other))
