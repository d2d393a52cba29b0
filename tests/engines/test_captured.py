"""Blocks that are counted as captured on a slope: nearly all would have stayed there, and none would have passed."""

import numpy as np
import pytest

from rock2d.engines.batch import run_batch
from rock2d.engines.rest import REST_DRIFT
from rock2d.files.scenario_reading import load_scenario
from rock2d.runs.campaigns.group_outcomes import _ensemble
from rock2d.runs.conditions import Conditions
from tests.scenarios_of_tests import SHIPPED

RELEASES = 300
SCENARIO = load_scenario(SHIPPED / "slope_embankment.yaml")


@pytest.mark.parametrize("number, block", list(enumerate(SCENARIO.make_blocks())))
def test_a_captured_block_stays_and_passes_what_it_would_have_passed(number, block):
    group = Conditions(SCENARIO, "batch", 1).group(number, 0, RELEASES)
    ensemble, ids = _ensemble(group.conditions)
    early, late = (
        run_batch(
            ensemble, group.states, block_ids=ids[0], cross_section_ids=ids[1], table_ids=ids[2],
            gravity_m_s2=SCENARIO.gravity_m_s2, time_limit_s=SCENARIO.longest_release_s(), stop_when_captured=c,
        )
        for c in (True, False)
    )  # fmt: skip
    radius = ensemble.blocks[0].radius_m
    moved = np.hypot(*(early.ends[:, 1:3] - late.ends[:, 1:3]).T) / radius
    assert (early.ends[:, 0] <= late.ends[:, 0]).all()
    assert np.array_equal(np.isfinite(early.crossings[..., 0]), np.isfinite(late.crossings[..., 0]))
    assert np.mean(moved < REST_DRIFT) > 0.94
    assert np.mean(moved < 1.0) > 0.98
