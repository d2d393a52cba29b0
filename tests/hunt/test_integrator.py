"""The engines against the independent integrator, which `tests/laws/test_contact.py` holds to closed forms."""

import numpy as np

from rock2d.laws.contact import ContactParameters
from rock2d.scene.blocks import make_block
from rock2d.scene.cross_section import CrossSection
from tests.hunt.cases import SHAPES, Case, Site
from tests.hunt.impact_check import FINE, LARGEST, batch_impact, compared_impacts, difference
from tests.hunt.integrator import Impact


def test_engines_against_integrator():
    """Random impacts of every shape with fine steps of the batch engine, and some in the pymunk engine."""
    done, _ = compared_impacts(15, 7, FINE, 4)
    assert {one.case.site.block.shape for one in done} == set(SHAPES)
    for one in done:
        assert one.batch[0] < LARGEST, one
        assert one.batch[1] < LARGEST, one
        assert not one.pymunk[0] > LARGEST, one  # NaN where it was not run


def test_contact_of_a_fast_spinning_ellipse_begins_at_the_surface():
    """Its foot passes a vertex within the step that touches: found only at the end of the step, the contact began
    0.03 radii deep."""
    block = make_block("rock", "ellipse", 350.0, inertia=12.5, length_m=0.616, height_m=0.436)
    ground = CrossSection(
        [[0.0, -0.4], [1.53922, -0.87064], [2.39217, -1.16254], [3.58597, -1.14784], [6.26655, -1.5364]], ["soil"] * 4
    )
    law = ContactParameters(254e3, 377e3, 158e3, 32.3, 0.0)
    before = np.array([3.5868471, -0.92983521, 15.74988555, 5.11246814, -5.02829369, 54.99262645])
    for ago_s in np.linspace(0.0, 0.005, 6):  # the touch falls anywhere within a step
        way = np.array([before[3], before[4] + 0.5 * 9.81 * ago_s, before[5], 0.0, -9.81, 0.0])
        case = Case(Site(block, {}, ground, {"soil": law}), before - (0.05 + ago_s) * way)
        impact = batch_impact(case, FINE)
        assert difference(case, impact, Impact(case.site, case.state).run())[0] < LARGEST
