"""Hops of a ball within its own indentation: one exact parabola each, and the same motion as with many steps."""

import numpy as np
import pytest

from rock2d import make_block
from rock2d.engines.batch import run_batch, run_batch_track
from rock2d.engines.pymunk_engine import run_pymunk
from rock2d.laws.contact import ContactParameters, contact_table
from rock2d.scene.cross_section import CrossSection
from tests.laboratory import ensemble

BALL = make_block("ball", "circle", mass_kg=1414.0, diameter_m=1.0)
LAW = ContactParameters(
    k_l_N_m=1.2e7, k_ul_N_m=9.3e7, k_t_N_m=3.0e6, friction_angle_deg=30, k_r_Nm_rad=4.8e4, rolling_cap=True
)
# 38.7 deg
SLOPE = CrossSection([[-10.0, 8.0], [90.0, -72.0]], ["scree"], {"line": [[25.0, -20.0], [25.0, 0.0]]})
ONE, TABLE = ensemble(BALL, SLOPE, LAW), contact_table(LAW, SLOPE.zone_names)
END_S = 4.0
STARTS = np.array([[0.0, 0.8 + 0.1 * i, 0.0, 4.0 + 0.5 * (i % 5), -3.0 - 0.5 * (i % 3), -10.0 - i] for i in range(12)])


@pytest.fixture(scope="module")
def fine():
    """t and state of each release after END_S, computed with a tenth of the contact step."""
    return run_batch(ONE, STARTS, time_limit_s=END_S, step_fraction=0.02).ends


def test_a_hopping_ball_moves_as_in_the_pymunk_engine(fine):
    """A hop that leaves the ground loses its indentation: one that is missed shows in the way by decimetres."""
    reference = np.array([run_pymunk(BALL, SLOPE, LAW, state, time_limit_s=END_S).knots[-1] for state in STARTS])
    assert (fine[:, 1] > 20.0).all()
    assert np.abs(fine[:, 1:3] - reference[:, 1:3]).max() < 0.03


def test_contact_steps_do_not_brake_a_rolling_ball(fine):
    """Steps that damp the tremor press the ball down for longer and brake it (by 0.4 m of 40 m here, if the oscillation
    of a pressed ball is not taken from its closed form)."""
    ends = run_batch(ONE, STARTS, time_limit_s=END_S).ends
    assert abs(np.median(ends[:, 1] - fine[:, 1])) < 0.1


def test_samples_and_tracks_agree_on_hops():
    """Between two contacts a track and the samples of an ensemble follow the same parabola, step by step."""
    times = np.linspace(0.05, END_S - 0.05, 80)
    run = run_batch(ONE, STARTS, times_s=times, time_limit_s=END_S)
    hops = 0
    for i, state in enumerate(STARTS):
        track = run_batch_track(BALL, SLOPE, TABLE, state, time_limit_s=END_S)
        assert np.array_equal(track.knots[-1], run.ends[i])
        assert np.abs(track.states(times)[:, :3] - run.samples[i]).max() < 1e-9
        hops += track.flight.sum() - len(track.impacts)
    assert hops > 5 * len(STARTS)


def test_a_hop_crosses_a_measure_line_where_its_parabola_does():
    run = run_batch(ONE, STARTS, time_limit_s=END_S)
    seen = 0
    for i, state in enumerate(STARTS):
        track = run_batch_track(BALL, SLOPE, TABLE, state, time_limit_s=END_S)
        crossing = track.crossings(SLOPE.measure_lines["line"])[0]
        if track.flight[np.searchsorted(track.knots[:, 0], crossing[0]) - 1]:
            assert np.abs(crossing - run.crossings[i, 0]).max() < 1e-9
            seen += 1
    assert seen > 0
