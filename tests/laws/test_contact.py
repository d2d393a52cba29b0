"""The deterministic contact law without any engine: closed forms, reference values, energy."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rock2d.laws.contact import (
    ContactParameters,
    change_feature,
    cross_zone,
    elastic_energy,
    normal_force,
    plastic_work,
    residual_indentation,
    rolling_energy,
    rolling_moment,
    tangential_force,
)
from rock2d.scene.blocks import make_block
from tests.hunt.integrator import on_plane
from tests.laws import closed_forms

MASS, RADIUS = 0.022, 0.0125
INERTIA = 0.4 * MASS * RADIUS**2
BALL = make_block("ball", "circle", MASS, "solid_sphere", diameter_m=2 * RADIUS)
QUICK = settings(deadline=None, max_examples=25)
MANY = settings(deadline=None, max_examples=200)

stiffness = st.floats(3.0, 7.0).map(lambda e: 10.0**e)
ratio = st.floats(1.0, 20.0)
speed = st.floats(0.1, 20.0)


def law(phi=30.0, k_r=0.0, **others):
    return ContactParameters(friction_angle_deg=phi, k_r_Nm_rad=k_r, **others)


# name, (φ, k_r), (v_t, ω), gravity, expected; to the digits printed in the reference table
REFERENCE = {
    "normal only": ((0, 0), (0, 0), 0, {"e": 0.40825, "time_s": 3.2811e-3, "penetration_m": 2.9665e-3,
                    "residual_indentation_m": 2.472e-3, "peak_force_N": 29.66}),
    "sticking": ((90, 0), (1, 0), 0, {"v_t_m_s": 0.57770, "omega_rad_s": -84.459, "u": -0.47804}),
    "v_t 1, 30 deg": ((30, 0), (1, 0), 0, {"v_t_m_s": 0.5879, "omega_rad_s": -82.42}),
    "v_t 10, 30 deg": ((30, 0), (10, 0), 0, {"v_t_m_s": 8.37389, "omega_rad_s": -325.22}),
    "rolling in": ((30, 0), (1, -80), 0, {"v_t_m_s": 1.0, "omega_rad_s": -80.0}),
    "rolling spring": ((0, 0.025), (0, 100), 0, {"omega_rad_s": 90.371}),
    "with gravity": ((0, 0), (0, 0), 9.81, {"e": 0.40825, "time_s": 3.296e-3, "penetration_m": 2.988e-3}),
}  # fmt: skip


@pytest.mark.parametrize("case", REFERENCE)
def test_the_law_gives_the_reference_values_of_table_4_on_the_22_g_sphere(case):
    (phi, k_r), (v_t, omega), gravity, expected = REFERENCE[case]
    p = law(phi, k_r)
    out = on_plane(p, BALL, 2.0, v_t, omega, gravity)
    v, v_n, spin = out.after[3:]
    found = {
        "e": v_n / 2.0, "u": v + RADIUS * spin, "v_t_m_s": v, "omega_rad_s": spin, "time_s": out.after_s - out.touch_s,
        "penetration_m": out.penetration_m, "residual_indentation_m": RADIUS - out.after[1],
        "peak_force_N": p.k_l_N_m * out.penetration_m,
    }  # fmt: skip
    for name, value in expected.items():
        assert found[name] == pytest.approx(value, rel=2e-4), name


@given(stiffness, ratio, speed, st.floats(-3, 4).map(lambda e: 10.0**e))
@QUICK
def test_restitution_time_and_depth_follow_the_closed_forms_at_any_speed_and_mass(k_l, k, v, mass):
    p = law(0, k_l_N_m=k_l, k_ul_N_m=k_l * k)
    depth = closed_forms.penetration_m(p, mass, v)
    radius = 10.0 * depth
    out = on_plane(p, make_block("ball", "circle", mass, diameter_m=2 * radius), v)
    v_n = out.after[4]
    assert v_n / v == pytest.approx(closed_forms.restitution(p), rel=1e-7)
    assert out.after_s - out.touch_s == pytest.approx(closed_forms.contact_time_s(p, mass), rel=1e-7)
    assert out.penetration_m == pytest.approx(depth, rel=1e-7)
    residual = closed_forms.residual_indentation_m(p, mass, v)
    assert radius - out.after[1] == pytest.approx(residual, rel=1e-7, abs=1e-9 * depth)
    assert p.k_l_N_m * out.penetration_m == pytest.approx(closed_forms.peak_force_N(p, mass, v), rel=1e-7)
    lost = 0.5 * mass * (v**2 - v_n**2)
    assert lost == pytest.approx(closed_forms.normal_loss_J(p, mass, v), rel=1e-6, abs=1e-7 * mass * v * v)


@pytest.mark.parametrize("phi", [30.0, 90.0])
def test_friction_takes_nothing_from_an_impact_without_slip(phi):
    p = law(phi)
    v_t, v_n, spin = on_plane(p, BALL, 1.5).after[3:]
    assert v_n == pytest.approx(1.5 * closed_forms.restitution(p), rel=1e-9)
    assert (v_t, spin) == pytest.approx((0.0, 0.0), abs=1e-12)


@given(st.floats(0.01, 1.0), ratio, st.floats(-5, 5), st.floats(-300, 300))
@QUICK
def test_a_contact_that_never_slips_turns_its_slip_velocity_by_the_tangential_phase(k_t, k, v_t, omega):
    p = law(90, k_ul_N_m=1e4 * k, k_t_N_m=1e4 * k_t)
    u = v_t + RADIUS * omega
    v, _, spin = on_plane(p, BALL, 2.0, v_t, omega).after[3:]
    after = v + RADIUS * spin
    expected = closed_forms.stick_slip_velocity_m_s(p, MASS, INERTIA, RADIUS, u)
    assert after == pytest.approx(expected, rel=1e-7, abs=1e-9)
    # the moment of momentum about the contact point is kept
    assert MASS * RADIUS * v - INERTIA * spin == pytest.approx(MASS * RADIUS * v_t - INERTIA * omega, abs=1e-12)


@given(st.floats(1, 40), ratio, st.sampled_from([-1.0, 1.0]))
@QUICK
def test_a_contact_that_slips_throughout_takes_tan_phi_times_the_normal_impulse(phi, k, sign):
    p = law(phi, k_ul_N_m=1e4 * k)
    v, _, spin = on_plane(p, BALL, 2.0, sign * 60.0).after[3:]
    change = closed_forms.gross_slip_change_m_s(p, 2.0, sign * 60.0)
    assert v - sign * 60.0 == pytest.approx(change, rel=1e-6)
    assert spin == pytest.approx(change * RADIUS * MASS / INERTIA, rel=1e-6)


@given(st.floats(0.0, 0.3), st.floats(-300, 300))
@QUICK
def test_the_rolling_spring_alone_turns_the_spin_by_its_phase(k_r, omega):
    p = law(0, k_r)
    out = on_plane(p, BALL, 2.0, 0.0, omega)
    expected = closed_forms.rolling_spin_rad_s(p, MASS, INERTIA, omega)
    assert out.after[5] == pytest.approx(expected, rel=1e-7, abs=1e-7)


@given(st.lists(st.floats(-0.2, 1.0), min_size=2, max_size=8), stiffness, ratio)
@MANY
def test_work_done_into_the_ground_is_what_it_stores_and_what_plasticity_took(path, k_l, k):
    k_ul, peak, work = k_l * k, 0.0, 0.0
    for start, end in pairwise([0.0, *path]):
        # between these depths the force is linear, so that trapezia are exact
        events = np.clip([0.0, residual_indentation(peak, k_l, k_ul), peak], min(start, end), max(start, end))
        legs = [start, *(events if end > start else events[::-1]), end]
        for a, b in pairwise(legs):
            f0 = normal_force(a, peak, k_l, k_ul)
            peak = max(peak, b)
            f1 = normal_force(b, peak, k_l, k_ul)
            work += 0.5 * (f0 + f1) * (b - a)
            assert f1 >= 0.0  # soil does not pull
    row = law(k_l_N_m=k_l, k_ul_N_m=k_ul).row()
    stored = elastic_energy(f1, 0.0, row)
    assert work == pytest.approx(stored + plastic_work(peak, k_l, k_ul), rel=1e-6, abs=1e-9 * k_l * (peak + 1e-6) ** 2)


@given(stiffness, ratio, st.floats(1e-6, 1.0), st.floats(0.0, 1.0))
@MANY
def test_unloading_starts_at_the_virgin_line_and_ends_at_the_residual_depth(k_l, k, peak, share):
    k_ul = k_l * k
    assert normal_force(peak, peak, k_l, k_ul) == k_l * peak
    left = residual_indentation(peak, k_l, k_ul)
    assert normal_force(left, peak, k_l, k_ul) == pytest.approx(0.0, abs=1e-9 * k_ul * peak)
    depth = left + share * (peak - left)
    assert normal_force(depth, peak, k_l, k_ul) == pytest.approx(
        k_ul * (depth - left), rel=1e-6, abs=1e-9 * k_ul * peak
    )


@given(st.floats(-1, 1), st.floats(0, 1e3), stiffness, st.floats(0, 89), st.booleans())
@MANY
def test_friction_and_capped_rolling_never_exceed_what_the_normal_force_allows(s, force, k, phi, cap):
    p = law(phi, k_t_N_m=k).row()
    assert abs(tangential_force(s, force, p[2], p[3])) <= np.tan(np.deg2rad(phi)) * force * (1 + 1e-12)
    assert tangential_force(s, 0.0, p[2], p[3]) == 0.0
    moment = rolling_moment(s, force, 0.01, k, float(cap), 0.0)
    assert abs(moment) <= (0.01 * force if cap else k * abs(s)) * (1 + 1e-12)
    assert moment * s >= 0.0


zone = st.builds(
    lambda k_l, k, k_t, phi, k_r: ContactParameters(k_l, k_l * k, k_t, phi, k_r),
    stiffness, ratio, st.one_of(st.just(0.0), stiffness), st.floats(0, 89),
    st.one_of(st.just(0.0), st.floats(1e-3, 1e3)),
)  # fmt: skip


@given(zone, zone, st.floats(1e-3, 1e3), st.floats(-1, 1), st.floats(-3, 3), st.floats(0.0, 1.0))
@MANY
def test_sliding_into_another_zone_never_raises_the_stored_energy(old, new, force_n, share, rotation, depth):
    a, b = old.row(), new.row()
    force_t = share * a[3] * force_n if a[2] > 0 else 0.0
    peak, stretch, turned = cross_zone(force_n, force_t, rotation, depth, a, b)
    before = elastic_energy(force_n, force_t, a) + rolling_energy(rotation, a)
    after = elastic_energy(b[0] * peak, b[2] * stretch, b) + rolling_energy(turned, b)
    assert after <= before * (1 + 1e-9)
    assert b[0] * peak <= force_n * (1 + 1e-12)
    assert peak <= depth * (1 + 1e-12)  # no soil is pressed in deeper than the contact point lies


@given(zone, st.floats(1e-5, 1.0), st.floats(0.0, 1.0), st.floats(0.0, 1.0), st.floats(-1, 1), st.floats(-1, 1))
@MANY
def test_another_feature_never_raises_the_stored_energy(law, peak, pressed, offset, share, jump):
    """Deeper ground leaves the penetration as it is, less deep ground unloads it."""
    p = law.row()
    delta = pressed * peak
    force_n = normal_force(delta, peak, p[0], p[1])
    force_t = share * min(p[3], 1.0) * force_n if p[2] > 0 else 0.0
    depth = delta + offset + jump
    new_offset, new_n, new_t, lost = change_feature(p, depth, jump, (offset, peak), (force_n, force_t))
    before, after = elastic_energy(force_n, force_t, p), elastic_energy(new_n, new_t, p)
    assert after <= before * (1 + 1e-9)
    assert lost == pytest.approx(before - after, abs=1e-12 * max(before, 1.0))
    assert new_offset >= 0.0
    if offset + jump >= 0.0:
        assert depth - new_offset == pytest.approx(delta, abs=1e-12)


@pytest.mark.parametrize(
    "bad", [{"k_ul_N_m": 9e3}, {"k_l_N_m": 0.0}, {"friction_angle_deg": 91}, {"k_t_N_m": -1}, {"k_r_Nm_rad": -1}]
)
def test_parameters_for_which_the_law_creates_energy_or_has_no_sense_are_refused(bad):
    with pytest.raises(ValueError, match=next(iter(bad))):
        ContactParameters(**bad)
