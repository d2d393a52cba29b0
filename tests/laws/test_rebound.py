"""The Bourrier-Hungr law by itself: its two regimes, its invariant, energy, and the slope reduction."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from rock2d.laws.rebound import ReboundParameters, normal_restitution, rebound, rebound_local, slope_reduction

UNTIMED = settings(deadline=None)  # the first example waits for the compiler
MASS, RADIUS = 0.022, 0.0125  # the paper's sphere
BODY = (MASS, RADIUS)

parameters = st.builds(
    ReboundParameters,
    friction_angle_deg=st.floats(0, 90),
    momentum_half_kg_m_s=st.floats(1e-6, 1e3),
    tangential_restitution=st.floats(0, 1),
    slope_reduction_deg=st.floats(0, 89),
)
speeds = st.floats(-50, 50)


def law(phi_deg=0.0, m_half=0.025, r_t=0.85, alpha_deg=0.0, reading="constant"):
    return ReboundParameters(phi_deg, m_half, r_t, alpha_deg, reading)


def energy(v_t, v_n, omega):
    return 0.5 * (v_t**2 + v_n**2 + 0.4 * (RADIUS * omega) ** 2)


@pytest.mark.parametrize(("m_half", "v_n"), [(0.025, 1.65), (0.04, 2.64)])
def test_normal_restitution_meets_the_deterministic_models_in_ditch_and_on_face(m_half, v_n):
    e = np.sqrt(1e4 / 6e4)
    crossing = m_half / MASS * (1 / e - 1)
    assert crossing == pytest.approx(v_n, abs=0.005)
    assert normal_restitution(-crossing, MASS, m_half) == pytest.approx(e, rel=1e-12)


def test_normal_restitution_is_half_at_the_half_momentum_and_one_for_a_faint_touch():
    assert normal_restitution(-2.0, 0.5, 1.0) == 0.5
    assert normal_restitution(-1e-12, MASS, 0.025) == pytest.approx(1.0, abs=1e-9)
    assert normal_restitution(-1e6, MASS, 0.025) < 1e-5


def test_no_slip_gives_the_rolling_ball_of_the_formula():
    v_t, v_n, omega, r_t = 0.4, -3.0, 20.0, 0.89
    got = rebound_local(v_t, v_n, omega, MASS, RADIUS, law(phi_deg=80.0, r_t=r_t).row())
    rolling = r_t * (5 / 7 * v_t - 2 / 7 * RADIUS * omega)
    assert got == pytest.approx((rolling, 0.025 / (0.025 + MASS * 3) * 3, -rolling / RADIUS), rel=1e-12)


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_slip_follows_the_formula_and_friction_opposes_the_foot(direction):
    v_t, v_n, omega, r_t = 8.0 * direction, -1.0, 30.0 * direction, 0.89
    p = law(phi_deg=11.0, m_half=0.04, r_t=r_t)
    jump = np.tan(np.deg2rad(11)) * (1 + 0.04 / (0.04 + MASS)) * 1.0
    got = rebound_local(v_t, v_n, omega, MASS, RADIUS, p.row())
    want = (r_t * v_t - direction * jump, 0.04 / (0.04 + MASS), r_t * omega - direction * 2.5 * jump / RADIUS)
    assert got == pytest.approx(want, rel=1e-12)


@UNTIMED
@given(speeds, st.floats(-50, -0.01), speeds, st.floats(0.01, 1))
def test_regimes_meet_at_the_angle_psi(v_t, v_n, u, r_t):
    assume(abs(u) > 1e-3)
    omega = (u - v_t) / RADIUS
    r_n = normal_restitution(v_n, MASS, 0.025)
    psi = np.degrees(np.arctan(2 * r_t * abs(u) / (7 * (1 + r_n) * abs(v_n))))
    assume(psi < 89)
    more, less = psi * (1 + 1e-9), psi * (1 - 1e-9)
    sticks, slips = (rebound_local(v_t, v_n, omega, MASS, RADIUS, law(angle, r_t=r_t).row()) for angle in (more, less))
    # on the sticking side the foot is at rest, on the slipping side it is just not
    rounding = 1e-12 * (abs(v_t) + abs(u))
    assert sticks[0] + RADIUS * sticks[2] == pytest.approx(0.0, abs=rounding)
    assert (slips[0] + RADIUS * slips[2]) * u > 0
    # the friction between the two angles, in m/s, is all that lies between the regimes
    jump = (1 + r_n) * abs(v_n) * (np.tan(np.radians(more)) - np.tan(np.radians(less)))
    assert slips[0] == pytest.approx(sticks[0], abs=jump + rounding) and slips[1] == sticks[1]
    assert RADIUS * slips[2] == pytest.approx(RADIUS * sticks[2], abs=2.5 * jump + rounding)


@UNTIMED
@given(parameters, speeds, st.floats(-50, -1e-6), st.floats(-5e3, 5e3))
def test_friction_leaves_v_t_minus_two_fifths_r_omega_to_the_restitution_alone(p, v_t, v_n, omega):
    v_t1, _, omega1 = rebound_local(v_t, v_n, omega, MASS, RADIUS, p.row())
    was, scale = v_t - 0.4 * RADIUS * omega, abs(v_t) + abs(RADIUS * omega)
    kept = v_t1 - 0.4 * RADIUS * omega1
    assert kept == pytest.approx(p.tangential_restitution * was, abs=1e-12 * scale + 1e-300)


@UNTIMED
@given(parameters, speeds, st.floats(-50, -1e-6), st.floats(-5e3, 5e3))
def test_a_rebound_never_gains_energy(p, v_t, v_n, omega):
    after = rebound_local(v_t, v_n, omega, MASS, RADIUS, p.row())
    assert energy(*after) <= energy(v_t, v_n, omega) * (1 + 1e-12)
    assert after[1] > 0


def test_without_friction_the_ball_slips_and_keeps_its_spin_but_for_the_restitution():
    v_t1, _, omega1 = rebound_local(2.0, -3.0, -40.0, MASS, RADIUS, law(r_t=0.85).row())
    assert (v_t1, omega1) == pytest.approx((0.85 * 2.0, 0.85 * -40.0), rel=1e-15)


@UNTIMED
@given(parameters, st.floats(-np.pi, np.pi), st.floats(-np.pi, 0), st.floats(1e-3, 50), st.floats(-5e3, 5e3))
def test_on_a_reduced_slope_energy_never_rises_and_the_block_leaves_the_ground(p, slope, down, speed, omega):
    tx, ty = np.cos(slope), np.sin(slope)
    v_t, v_n = speed * np.cos(down), speed * np.sin(down)
    vx, vy = v_t * tx - v_n * ty, v_t * ty + v_n * tx
    assume(vy * tx - vx * ty < 0)
    row = p.row()
    vx1, vy1, omega1 = rebound((vx, vy, omega), (tx, ty), slope_reduction(row, 0.5), BODY, row)
    assert energy(vx1, vy1, omega1) <= energy(vx, vy, omega) * (1 + 1e-12)
    assert vy1 * tx - vx1 * ty >= -1e-12 * speed


@UNTIMED
@given(parameters, st.floats(-1.5, 1.5), speeds, st.floats(-50, -1e-3), st.floats(-5e3, 5e3))
def test_the_mirrored_impact_is_the_mirror_of_the_impact(p, slope, vx, vy, omega):
    tx, ty, row = np.cos(slope), np.sin(slope), p.row()
    assume(vy * tx - vx * ty < -1e-6)
    alpha = slope_reduction(row, 0.0)
    here = rebound((vx, vy, omega), (tx, ty), alpha, BODY, row)
    there = rebound((-vx, vy, -omega), (tx, -ty), alpha, BODY, row)
    assert (-there[0], there[1], -there[2]) == here


@pytest.mark.parametrize("travel", [1.0, -1.0])
def test_slope_reduction_turns_the_ground_against_the_motion(travel):
    # r_t = 1, no friction, r_n ~ 1: a mirror. 45° down onto level ground turned by 10° leaves 20° steeper.
    p = law(0.0, 1e9, 1.0, 10.0).row()
    vx, vy, _ = rebound((travel, -1.0, 0.0), (1.0, 0.0), np.deg2rad(10), BODY, p)
    assert np.degrees(np.arctan2(vy, travel * vx)) == pytest.approx(45 + 20, abs=1e-6)


def test_a_vertical_fall_counts_as_travel_down_the_slope():
    p = law(0.0, 1e9, 1.0, 10.0).row()
    for down in (1.0, -1.0):  # 30° slope down to the right, then to the left
        tx, ty = np.cos(np.deg2rad(30)), -down * np.sin(np.deg2rad(30))
        vx, vy, _ = rebound((0.0, -1.0, 0.0), (tx, ty), np.deg2rad(10), BODY, p)
        assert np.degrees(np.arctan2(vy, down * vx)) == pytest.approx(90 - 2 * 20, abs=1e-6)


def test_a_turned_facet_that_would_not_be_hit_leaves_the_facet_as_it_lies():
    slope = np.deg2rad(65)  # an uphill face, met from almost straight above
    velocity = (0.5, -5.0, 10.0)
    args = (velocity, (np.cos(slope), np.sin(slope)))
    p = law(11.0, 0.04, 0.89, 40.0).row()
    assert rebound(*args, np.deg2rad(40), BODY, p) == rebound(*args, 0.0, BODY, p)


def test_a_rebound_off_the_turned_facet_into_the_ground_is_followed_by_one_on_the_ground():
    # level ground turned by 60°: a fast flat block slips along the turned facet, backwards and down
    p = law(0.0, 1e-9, 1.0, 60.0).row()
    args = ((1.0, -5.0, 0.0), (1.0, 0.0))
    turned = np.deg2rad(60)
    along = 1.0 * np.cos(turned) - 5.0 * np.sin(turned)  # all that is left after the first rebound
    vx, vy, _ = rebound(*args, turned, BODY, p)
    assert vx == pytest.approx(along * np.cos(turned), rel=1e-6)
    assert 0 < vy < 1e-6


def test_the_two_readings_of_alpha():
    constant, uniform = law(alpha_deg=40).row(), law(alpha_deg=40, reading="uniform").row()
    assert slope_reduction(constant, 0.25) == pytest.approx(np.deg2rad(40), rel=1e-15)
    assert slope_reduction(uniform, 0.25) == pytest.approx(np.deg2rad(10), rel=1e-15)
    assert law(alpha_deg=40, reading="uniform").random
    assert not law(alpha_deg=40).random


@pytest.mark.parametrize(
    "wrong",
    [
        {"phi_deg": -1.0},
        {"phi_deg": 91.0},
        {"m_half": 0.0},
        {"m_half": np.inf},
        {"r_t": 1.01},
        {"r_t": np.nan},
        {"alpha_deg": 90.0},
        {"reading": "normal"},
    ],
)
def test_impossible_parameters_are_refused(wrong):
    with pytest.raises(ValueError, match=r"must"):
        law(**wrong)
