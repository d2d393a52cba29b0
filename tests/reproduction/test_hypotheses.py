"""Hypotheses of the paper's set-up: their starts, their cross-sections, and what both models make of them."""

import numpy as np
import pytest
import shapely

from rock2d.calibration.sequential_monte_carlo import prior_draws
from rock2d.files.scenario import scenario_file
from rock2d.files.scenario_reading import load_scenario
from rock2d.reproduction import calibrations, outcomes, published
from rock2d.reproduction.hypotheses import (
    DETERMINISTIC_SPACE,
    PROBABILISTIC_SPACE,
    hypothesis_cross_section,
    incident_distributions,
)
from rock2d.reproduction.outcomes import (
    DITCH_ID,
    FACING_ID,
    deterministic_first_impacts,
    deterministic_outcome,
    probabilistic_outcome,
)
from rock2d.reproduction.paper_setup import FoundSetup, scenario_text
from rock2d.runs.incident_states import drawn_states

RNG = np.random.default_rng(5)
HYPOTHESES = prior_draws(32, len(DETERMINISTIC_SPACE.quantities), RNG)
VALUES = DETERMINISTIC_SPACE.values(HYPOTHESES)
REBOUNDS = PROBABILISTIC_SPACE.values(prior_draws(32, len(PROBABILISTIC_SPACE.quantities), RNG))
MODELS = [(deterministic_outcome, VALUES), (probabilistic_outcome, REBOUNDS)]
DRAWS = RNG.standard_normal((30, 6))


def test_the_setup_has_what_the_paper_publishes():
    assert pytest.approx((0.083, 0.055)) == (published.HEIGHT_M, published.CREST_M)
    for i in range(len(HYPOTHESES)):
        rise = hypothesis_cross_section(VALUES, i).embankment
        assert rise is not None and rise.height_m == pytest.approx(0.083)


@pytest.mark.parametrize("name", published.BLOCKS)
def test_no_release_within_three_deviations_starts_in_the_ground(name):
    block = published.SETUP_BLOCKS[name]
    states = incident_distributions(VALUES, block).states(np.clip(DRAWS, -3, 3))
    for i, own in enumerate(states):
        ground = shapely.LineString(hypothesis_cross_section(VALUES, i).points_m)
        for x, y, *_ in own:
            assert shapely.Point(x, y).distance(ground) > block.radius_m


def test_a_block_that_loses_nothing_on_the_slope_has_the_speed_of_its_drop():
    values = {key: v[:1] for key, v in VALUES.items()}
    values |= {"cube.speed_along": np.ones(1), "cube.speed_across": np.ones(1), "cube.roll": np.zeros(1)}
    begin = incident_distributions(values, published.SETUP_BLOCKS["cube"])
    assert np.hypot(*begin.mean[0, 3:5]) == pytest.approx(np.sqrt(2 * 9.81 * 0.30))
    values["cube.roll"] = np.ones(1)
    assert begin.possible[0]
    assert not incident_distributions(values, published.SETUP_BLOCKS["cube"]).possible[0]


@pytest.mark.parametrize(("model", "values"), MODELS)
def test_a_hypothesis_does_not_depend_on_those_beside_it(model, values, monkeypatch):
    whole = model(values, "cube", DRAWS)
    monkeypatch.setattr(outcomes, "RELEASES_PER_CALL", 5 * len(DRAWS))
    alone = model({key: v[7:20] for key, v in values.items()}, "cube", DRAWS)
    assert (whole.crossed[7:20] == alone.crossed).all() and (whole.first_zone[7:20] == alone.first_zone).all()
    assert whole.by_last_line.sum(axis=1).tolist() == [len(DRAWS)] * len(HYPOTHESES)


@pytest.mark.parametrize(("model", "values"), MODELS)
@pytest.mark.parametrize("block", published.BLOCKS)
def test_lines_are_passed_beyond_the_slope_only(model, values, block):
    """Bounces on the slope are no passings, however far a line leans over it."""
    passed = model(values, block, DRAWS).at_line_2
    assert np.isfinite(passed[..., 1]).any() and np.nanmin(passed[..., 1]) > -1e-9


def test_a_release_that_can_reach_no_further_line_still_has_a_first_impact():
    """A cube that leaves the slope near its toe may be too slow for line 1; it lands in the ditch all the same."""
    values = {key: v[:1].copy() for key, v in VALUES.items()}
    values |= {"drop_up_slope_m": np.array([0.05]), "cube.speed_along": np.array([0.9]), "ditch_m": np.array([0.2])}
    values |= {"cube.speed_across": np.array([0.5]), "cube.roll": np.zeros(1), "cube.speed_spread": np.array([0.01])}
    values |= {"line_tilt_deg": np.zeros(1)}
    found = deterministic_outcome(values, "cube", DRAWS)
    assert found.possible[0] and (found.first_zone == DITCH_ID).all()


def test_landing_is_the_first_impact_of_falling():
    whole, landed = (
        model(VALUES, "parallelepiped", DRAWS) for model in (deterministic_outcome, deterministic_first_impacts)
    )
    assert (whole.first_zone == landed.first_zone).all() and (whole.possible == landed.possible).all()
    assert landed.off_normal_deg == pytest.approx(whole.off_normal_deg, nan_ok=True)
    assert whole.crossed.any() and not landed.crossed.any() and not whole.crossed[~whole.possible].any()


def test_the_angle_at_the_facing_is_that_of_a_throw():
    """A parallelepiped that leaves the slope level and fast meets the facing as its parabola says."""
    values = {key: v[:1].copy() for key, v in VALUES.items()}
    values |= {"slope_deg": np.array([45.0]), "facing_deg": np.array([60.0]), "ditch_m": np.array([0.05])}
    values |= {"drop_up_slope_m": np.array([0.05]), "parallelepiped.roll": np.zeros(1)}
    values |= {f"parallelepiped.speed_{way}": np.ones(1) for way in ("along", "across")}
    values |= {"parallelepiped.speed_spread": np.array([1e-6]), "drop_spread_m": np.array([1e-6])}
    found = deterministic_first_impacts(values, "parallelepiped", DRAWS)
    speed = np.sqrt(2 * 9.81 * 0.30)  # level, as the slope turns the whole of the fall round
    at = 0.075  # m from the start to the facing, about: gravity turns the flight by a few degrees
    down = np.degrees(np.arctan(9.81 * at / speed**2))
    assert (found.first_zone == FACING_ID).all()
    assert found.off_normal_deg[0] == pytest.approx(np.abs(30.0 - down), abs=4.0)


def test_none_is_half_of_the_prior_and_changes_nothing():
    u = np.hstack([HYPOTHESES, prior_draws(32, 4, RNG)])
    which = calibrations.candidate_indices(calibrations.CANDIDATE_SPACE.values(u))
    assert (which == 0).sum() == 16 and set(which) <= set(range(len(calibrations.CANDIDATES)))
    none = which == 0
    values = {key: v[none] for key, v in calibrations.CANDIDATE_SPACE.values(u).items()}
    with_candidate = calibrations.candidate_outcome(values, "cube", DRAWS)
    assert (with_candidate.crossed == deterministic_outcome(values, "cube", DRAWS).crossed).all()


def test_every_candidate_changes_something():
    n = len(calibrations.CANDIDATES)
    u = np.repeat(HYPOTHESES, n, axis=0)
    extra = np.full((len(u), 4), 0.9)
    extra[:, 0] = np.tile([calibrations.candidate_value(name) for name in calibrations.CANDIDATES], 32)
    values = calibrations.CANDIDATE_SPACE.values(np.hstack([u, extra]))
    assert (calibrations.candidate_indices(values) == np.tile(np.arange(n), 32)).all()
    found = calibrations.candidate_outcome(values, "cube", DRAWS).crossed.reshape(32, n, -1)
    assert (found[:, 1:] != found[:, :1]).any(axis=(0, 2)).all()


def test_the_scenario_of_a_hypothesis_is_its_set_up_and_arrivals_with_the_published_laws(tmp_path):
    path = tmp_path / "one.yaml"
    every = np.ones((3, 3), bool)
    reached = {model: np.stack([0 * every, 70 * every]) for model in ("deterministic", "probabilistic")}
    found = FoundSetup(3, 32, 30, {"deterministic": every, "probabilistic": ~every}, reached)
    path.write_text(scenario_text(VALUES, found, 2), encoding="utf-8")
    scenario = load_scenario(path)
    assert "deterministic 9 of 9; probabilistic 0 of 9 (not sphere line 1" in scenario.assumed[1]
    assert "sphere line_3, probabilistic: 40 % in the paper, 0 to 70 % over all hypotheses" in scenario.assumed[1]
    ground, shown = hypothesis_cross_section(VALUES, 3), scenario.make_cross_section()
    assert shown.points_m == pytest.approx(ground.points_m, abs=6e-5)
    for line, ends in ground.measure_lines.items():
        assert shown.measure_lines[line] == pytest.approx(np.asarray(ends), abs=6e-5)
    blocks, shipped = scenario.make_blocks(), load_scenario(scenario_file("paper_setup.yaml"))
    for name, block in blocks.items():
        assert block == shipped.make_blocks()[name] == published.SETUP_BLOCKS[name]
        assert shipped.contact_parameters(block) == scenario.contact_parameters(block)
        assert shipped.rebound_parameters(block) == scenario.rebound_parameters(block)
    law = scenario.contact_parameters(blocks["cube"])["default"]
    assert law.k_l_N_m / law.k_ul_N_m == pytest.approx(1 / 6)
    facing = scenario.rebound_parameters(blocks["cube"])["uphill_face"]
    assert (facing.slope_reduction_deg, facing.momentum_half_kg_m_s) == (6.0, 0.04)
    drawn = drawn_states(scenario.incident_of("cube"), 1, 1, 0, 4000)
    begin = incident_distributions(VALUES, published.SETUP_BLOCKS["cube"])
    rounded = np.array([6e-5, 6e-5, 6e-4, 6e-4, 6e-4, 0.06])
    assert (np.abs(drawn.mean(axis=0) - begin.mean[3]) <= 4 * begin.sd[3] / np.sqrt(4000) + rounded).all()
    assert drawn.std(axis=0) == pytest.approx(begin.sd[3], rel=0.06, abs=6e-5)


@pytest.mark.parametrize("name", published.BLOCKS)
def test_no_release_of_the_scenario_starts_in_the_slope(tmp_path, name):
    """Also of many releases, of which some are far from the mean."""
    block, every = published.SETUP_BLOCKS[name], np.ones((3, 3), bool)
    for place in range(8):
        path = tmp_path / f"{place}.yaml"
        found = FoundSetup(place, 32, 30, {"deterministic": every}, {})
        path.write_text(scenario_text(VALUES, found, 2), encoding="utf-8")
        scenario = load_scenario(path)
        slope = shapely.LineString(scenario.make_cross_section().points_m[:2])
        drawn = drawn_states(scenario.incident_of(name), 1, 0, 0, 4000)
        nearest = drawn[np.argmin(drawn[:, 0])]
        assert shapely.Point(*nearest[:2]).distance(slope) > block.radius_m
