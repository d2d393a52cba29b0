"""The independent integrator against closed forms, and the engine against the integrator."""

from __future__ import annotations

import numpy as np
import pytest

from rock2d.laws import closed_forms
from rock2d.laws.contact import ContactParameters
from rock2d.scene.blocks import make_block
from rock2d.scene.cross_section import CrossSection
from tests.hunt.cases import Case, Site
from tests.hunt.impact_check import FINE, LARGEST, batch_impact, compared_impacts, difference
from tests.hunt.integrator import Impact

RADIUS_M, SPEED_M_S, MASS_KG = 0.02, 1.5, 0.05


def plane_impact(law: ContactParameters, slip_m_s: float, omega_rad_s: float):
    """Outcome of a ball that falls on a plane without gravity, with this slip of its lowest point."""
    block = make_block("ball", "circle", MASS_KG, diameter_m=2 * RADIUS_M)
    site = Site(block, {}, CrossSection([[-1.0, 0.0], [1.0, 0.0]], ["floor"]), {"floor": law})
    state = np.array([0.0, 2 * RADIUS_M, 0.3, slip_m_s - RADIUS_M * omega_rad_s, -SPEED_M_S, omega_rad_s])
    return block, Impact(site, state, gravity_m_s2=0.0).run()


@pytest.mark.parametrize("friction_angle_deg", [0.0, 30.0, 90.0])
def test_normal_impact(friction_angle_deg):
    law = ContactParameters(friction_angle_deg=friction_angle_deg, k_r_Nm_rad=0.0)
    _, impact = plane_impact(law, 0.0, 0.0)
    assert impact.after[4] == pytest.approx(closed_forms.restitution(law) * SPEED_M_S, rel=1e-9)
    assert impact.after[[3, 5]] == pytest.approx([0.0, 0.0], abs=1e-12)
    assert impact.penetration_m == pytest.approx(
        closed_forms.penetration_m(law, MASS_KG, SPEED_M_S), rel=1e-9
    )
    taken = impact.after_s - impact.touch_s
    assert taken == pytest.approx(closed_forms.contact_time_s(law, MASS_KG), rel=1e-8)


def test_friction_and_rolling():
    holding = ContactParameters(friction_angle_deg=90.0, k_r_Nm_rad=0.0)
    block, impact = plane_impact(holding, 0.4, 0.0)
    slip = impact.after[3] + RADIUS_M * impact.after[5]
    expected = closed_forms.stick_slip_velocity_m_s(holding, MASS_KG, block.inertia_kg_m2, RADIUS_M, 0.4)
    assert slip == pytest.approx(expected, rel=1e-7)
    slipping = ContactParameters(friction_angle_deg=10.0, k_t_N_m=1e5, k_r_Nm_rad=0.0)
    _, impact = plane_impact(slipping, 30.0, 0.0)
    change = closed_forms.gross_slip_change_m_s(slipping, SPEED_M_S, 30.0)
    assert impact.after[3] - 30.0 == pytest.approx(change, rel=1e-4)  # the spring winds up first
    rolling = ContactParameters(friction_angle_deg=0.0, k_r_Nm_rad=0.5)
    block, impact = plane_impact(rolling, 0.0, 20.0)
    spin = closed_forms.rolling_spin_rad_s(rolling, MASS_KG, block.inertia_kg_m2, 20.0)
    assert impact.after[5] == pytest.approx(spin, rel=1e-7)


def test_engine_against_integrator():
    """Random impacts of every shape with fine steps of the batch engine."""
    done, _ = compared_impacts(15, 7, FINE)
    assert {one.case.site.block.shape for one in done} >= {
        "circle",
        "ellipse",
        "square",
        "rectangle",
        "polygon",
    }
    for one in done:
        assert one.batch[0] < LARGEST, one
        assert one.batch[1] < LARGEST, one


def test_contact_of_a_fast_spinning_ellipse_begins_at_the_surface():
    """Its foot passes a vertex within the step that touches: found only at the end of the step, the contact began
    0.03 radii deep."""
    block = make_block("rock", "ellipse", 350.0, inertia=12.5, length_m=0.616, height_m=0.436)
    ground = CrossSection(
        [[0.0, -0.4], [1.53922, -0.87064], [2.39217, -1.16254], [3.58597, -1.14784], [6.26655, -1.5364]],
        ["soil"] * 4,
    )
    law = ContactParameters(254e3, 377e3, 158e3, 32.3, 0.0)
    before = np.array([3.5868471, -0.92983521, 15.74988555, 5.11246814, -5.02829369, 54.99262645])
    for ago_s in np.linspace(0.0, 0.005, 6):  # the touch falls anywhere within a step
        way = np.array([before[3], before[4] + 0.5 * 9.81 * ago_s, before[5], 0.0, -9.81, 0.0])
        case = Case(Site(block, {}, ground, {"soil": law}), before - (0.05 + ago_s) * way)
        impact = batch_impact(case, FINE)
        assert difference(case, impact, Impact(case.site, case.state).run())[0] < LARGEST
