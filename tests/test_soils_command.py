"""The command `rock2d soils`: every class with its ranges and source; the parameters of a block."""

import pytest

from rock2d.commands.soils import list_soils
from rock2d.errors import InputError
from rock2d.laws.soil_scaling import soil_contact, soil_rebound
from rock2d.scene.soils import SOIL_CLASSES
from tests.programs import commanded

REBOUND_NUMBERS = ("friction_angle_deg", "momentum_half_kg_m_s", "tangential_restitution", "slope_reduction_deg")


def printed(*options: str) -> str:
    result = commanded("soils", *options)
    assert result.exit_code == 0
    return result.output


@pytest.mark.parametrize("soil", SOIL_CLASSES.values(), ids=list(SOIL_CLASSES))
def test_every_class_is_listed_with_ranges_source_and_what_is_assumed(soil):
    text = printed()
    (row,) = [line for line in text.splitlines() if line.startswith(f"{soil.name} ")]
    for bounds in (soil.restitution_range, soil.friction_range_deg, soil.stiffness_range):
        numbers = row.replace("(", " ").replace(")", " ").split()
        assert {float(bound) for bound in bounds} <= {float(n) for n in numbers if n[0].isdigit()}
    for words in (soil.description, soil.source, soil.assumed):
        assert words in text


@pytest.mark.parametrize("soil", SOIL_CLASSES.values(), ids=list(SOIL_CLASSES))
def test_the_parameters_of_a_block_are_those_that_a_scenario_takes(soil):
    lines = [line.split() for line in printed("--mass-kg", "300", "--size-m", "0.6").splitlines()]
    contact, rebound = (line for line in lines if line[:1] == [soil.name])
    law, point = soil_contact(soil, 300.0, 0.6), soil_rebound(soil, 300.0, 0.6)
    assert [float(cell) for cell in contact[1:6]] == pytest.approx(
        [law.k_l_N_m, law.k_ul_N_m, law.k_t_N_m, law.friction_angle_deg, law.k_r_Nm_rad], rel=0.01
    )
    assert [float(cell) for cell in rebound[1:]] == pytest.approx(
        [getattr(point, name) for name in REBOUND_NUMBERS], rel=0.01
    )


@pytest.mark.parametrize(("mass_kg", "size_m"), [(300.0, None), (None, 1.0), (-1.0, 1.0), (1.0, float("nan"))])
def test_half_a_block_or_none_at_all_is_refused(mass_kg, size_m):
    with pytest.raises(InputError, match=r"--mass-kg|--size-m"):
        list_soils(mass_kg, size_m)
