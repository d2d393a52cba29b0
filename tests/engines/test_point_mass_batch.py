"""Ensembles of the point-mass engine: the single engine's bits, whatever the order."""

import numpy as np
import pytest

from rock2d.engines.point_mass import run_point_mass, run_point_mass_batch
from rock2d.files.scenario_reading import load_scenario
from rock2d.records.columns import STOPS
from rock2d.runs.conditions import incident_states
from rock2d.scene.cross_section import CrossSection
from tests.laboratory import AFTER
from tests.scenarios_of_tests import SHIPPED

BEFORE = ["t_s", "x_m", "y_m", "theta_rad", "vx_m_s", "vy_m_s", "omega_rad_s"]


def ensemble(name, block_name, n, cross_section=None, **more):
    """Arguments of an ensemble of one block of a scenario, and its result."""
    scenario = load_scenario(SHIPPED / f"{name}.yaml")
    block, cross_section = scenario.make_blocks()[block_name], cross_section or scenario.make_cross_section()
    states = np.array([s.state for s in incident_states(scenario, 3, n) if s.block == block_name])
    seeds = np.random.default_rng(4).integers(2**64, size=n, dtype=np.uint64)
    law = scenario.rebound_parameters(block)
    options = {"gravity_m_s2": scenario.gravity_m_s2, "time_limit_s": scenario.longest_release_s(), **more}
    given = block, cross_section, law, states, seeds
    return given, options, run_point_mass_batch(*given, **options, impact_room=40)


def tracks(given, options):
    """The releases of an ensemble, one by one."""
    *site, states, seeds = given
    for state, seed in zip(states, seeds, strict=True):
        yield run_point_mass(*site, state, seed=int(seed), **options)


def first_of(crossings):
    return crossings[0] if len(crossings) else np.full(7, np.nan)


def undulating(cross_section, pieces, height_m):
    """The cross-section with every facet cut and waves on it: many flights meet lines and joints."""
    fine = cross_section.subdivided(pieces)
    points = fine.points_m.copy()
    points[:, 1] += height_m * np.sin(np.arange(len(points)) * 2 * np.pi * 3 / pieces)
    return CrossSection(points, fine.zones, fine.measure_lines)


@pytest.mark.parametrize(
    ("name", "block_name"),
    [
        *(("paper_setup", b) for b in ("sphere", "cube", "parallelepiped")),
        *(("slope_embankment", b) for b in ("ball_1m", "cube_1m", "slab_2m")),
    ],
)
@pytest.mark.parametrize("fine", [False, True])
def test_a_release_has_the_same_bits_alone_and_in_an_ensemble(name, block_name, fine):
    cross_section = load_scenario(SHIPPED / f"{name}.yaml").make_cross_section()
    if fine:
        cross_section = undulating(cross_section, 60, 2e-3 * np.ptp(cross_section.points_m[:, 0]))
    given, options, batch = ensemble(name, block_name, 120, cross_section)
    lines = list(cross_section.measure_lines.values())
    for i, track in enumerate(tracks(given, options)):
        assert track.stop == STOPS[batch.stop[i]]
        assert np.array_equal(track.knots[-1], batch.ends[i])
        assert len(track.impacts) == batch.impact_count[i]
        for k, impact in enumerate(track.impacts[:40]):
            assert np.array_equal([impact[c] for c in BEFORE + AFTER], batch.impacts[i, k, :10])
            assert impact["zone"] == cross_section.zones[int(batch.impacts[i, k, 10])]
        assert np.isnan(batch.impacts[i, len(track.impacts) :]).all()
        for k, line in enumerate(lines):
            assert np.array_equal(first_of(track.crossings(line)), batch.crossings[i, k], equal_nan=True)
    assert np.isfinite(batch.crossings).any()


def test_lines_of_any_direction_are_met_where_the_track_says():
    scenario = load_scenario(SHIPPED / "slope_embankment.yaml")
    base, rng = scenario.make_cross_section(), np.random.default_rng(0)
    ends = rng.uniform([0, 0], [140, 70], (40, 2, 2))
    ends[:4, 1, 1] = ends[:4, 0, 1]  # level lines: a flight may cross one twice
    ends[4:8, 1, 0] = ends[4:8, 0, 0]  # upright ones
    cross_section = CrossSection(base.points_m, base.zones, {str(k): line for k, line in enumerate(ends)})
    given, options, batch = ensemble("slope_embankment", "ball_1m", 200, cross_section)
    twice = 0
    for i, track in enumerate(tracks(given, options)):
        for k, line in enumerate(ends):
            found = track.crossings(line)
            twice += len(found) > 1
            assert np.array_equal(first_of(found), batch.crossings[i, k], equal_nan=True)
    assert twice > 0


def test_without_lines_or_room_only_ends_are_kept_and_they_are_the_same():
    cross_section = load_scenario(SHIPPED / "paper_setup.yaml").make_cross_section()
    bare = CrossSection(cross_section.points_m, cross_section.zones)
    given, options, batch = ensemble("paper_setup", "cube", 50)
    lean = run_point_mass_batch(given[0], bare, *given[2:], **options)
    assert lean.crossings.shape == (50, 0, 7)
    assert lean.impacts.shape == (50, 0, 11)
    assert np.array_equal(lean.ends, batch.ends)
    none = run_point_mass_batch(*given[:3], np.empty((0, 6)), np.empty(0, np.uint64), **options)
    assert len(none.ends) == 0


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"states": [[0, 1, 0, np.nan, 0, 0]]}, "finite"),
        ({"states": [[0, 1, 0]]}, r"\(n, 6\)"),
        ({"seeds": [1, 2]}, "seeds"),
        ({"seeds": [-1]}, "seeds"),
        ({"seeds": [0.5]}, "seeds"),
        ({"time_limit_s": 0.0}, "time_limit_s"),
        ({"gravity_m_s2": -9.81}, "gravity_m_s2"),
        ({"impact_room": -1}, "impact_room"),
        ({"parameters": {}}, "zone 'slope'"),
    ],
)
def test_impossible_input_is_refused(wrong, said):
    scenario = load_scenario(SHIPPED / "paper_setup.yaml")
    cube = scenario.make_blocks()["cube"]
    given = {
        "parameters": scenario.rebound_parameters(cube), "states": [[0, 1, 0, 0, 0, 0]], "seeds": [1],
        "time_limit_s": 1.0,
    } | wrong  # fmt: skip
    with pytest.raises(ValueError, match=said):
        run_point_mass_batch(cube, scenario.make_cross_section(), **given)
