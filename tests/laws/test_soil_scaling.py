"""Soil classes: similar impacts have similar results, in closed form and in the engines; the classes make sense."""

from dataclasses import replace

import numpy as np
import pytest

from rock2d.engines.batch import Ensemble, run_batch
from rock2d.engines.point_mass import run_point_mass
from rock2d.laws.contact import contact_table
from rock2d.laws.rebound import normal_restitution
from rock2d.laws.soil_scaling import SOIL_GRAVITY_M_S2, reference_speed_m_s, soil_contact, soil_rebound
from rock2d.records.columns import STOPS
from rock2d.scene.blocks import Block, make_block
from rock2d.scene.cross_section import CrossSection
from rock2d.scene.soils import SOIL_CLASSES
from tests.laws import closed_forms

RATIO = 3.0  # larger over smaller size
EXACT_RATIO = 4.0  # its root is a power of two, too
STEP_FRACTION = 0.1
DURATION_S = 3.0  # time that the smaller block moves: several impacts
BLOCKS = {
    "ball": {"shape": "circle", "diameter_m": 0.4, "mass_kg": 90.0, "inertia": "solid_sphere"},
    "cube": {"shape": "square", "side_m": 0.4, "mass_kg": 170.0},
    "slab": {"shape": "ellipse", "length_m": 0.6, "height_m": 0.3, "mass_kg": 130.0},
}
SIZED = {"diameter_m", "side_m", "length_m", "height_m"}
soils = pytest.mark.parametrize("soil", SOIL_CLASSES.values(), ids=list(SOIL_CLASSES))


def scaled(name: str, ratio: float) -> Block:
    """A block with all lengths times `ratio`, of the same density."""
    keys = dict(BLOCKS[name])
    keys["mass_kg"] *= ratio**3
    keys |= {key: ratio * keys[key] for key in SIZED & set(keys)}
    return make_block(name, **keys)


def released(ratio: float) -> np.ndarray:
    """States above the floor with lengths times `ratio` and speeds times √ratio."""
    reach = 0.6
    rows = [[0, reach + drop, turn, v, -0.5, spin] for drop, turn, v, spin in
            [(0.5, 0.3, 2.0, -3.0), (1.5, 1.1, 4.0, 5.0), (0.1, 2.0, 1.0, 0.0)]]  # fmt: skip
    speed = np.sqrt(ratio)
    return np.array(rows) * [ratio, ratio, 1, speed, speed, speed / ratio]


def floor(ratio: float) -> CrossSection:
    return CrossSection(np.array([[-100.0, 0.0], [200.0, 0.0]]) * ratio, ["floor"])


def samples(name: str, soil: object, ratio: float, law_of: Block | None = None) -> np.ndarray:
    """Poses (releases, times, 3) with lengths in units of the ratio, at times that have the ratio √ratio."""
    block, pace = scaled(name, ratio), np.sqrt(ratio)
    source = law_of or block
    table = contact_table(soil_contact(soil, source.mass_kg, source.size_m), ("floor",))
    ensemble = Ensemble([block], [floor(ratio)], [table])
    times = pace * np.linspace(0.0, DURATION_S, 40)
    result = run_batch(ensemble, released(ratio), times_s=times, time_limit_s=pace * DURATION_S,
                       step_fraction=STEP_FRACTION)  # fmt: skip
    return np.asarray(result.samples) / [ratio, ratio, 1.0]


@soils
@pytest.mark.parametrize("name", BLOCKS)
def test_blocks_of_two_sizes_move_alike_on_a_class(name, soil):
    """To the last bit: four times the size and twice the speed change no digits, so that no rounding grows."""
    small, large = samples(name, soil, 1.0), samples(name, soil, EXACT_RATIO)
    assert np.isfinite(small[:, :9]).all() and np.nanmax(small[..., 1]) - np.nanmin(small[..., 1]) > 1.0
    assert np.array_equal(small, large, equal_nan=True)


@soils
def test_balls_of_two_sizes_move_alike_at_any_ratio(soil):
    small, large = samples("ball", soil, 1.0), samples("ball", soil, RATIO)
    assert np.isfinite(small).all() and np.abs(small - large).max() < 1e-9


def test_stiffness_that_is_not_scaled_is_not_similar():
    """The test above can fail: the large block with the parameters of the small one moves otherwise."""
    soil = SOIL_CLASSES["medium_scree"]
    apart = np.abs(samples("ball", soil, 1.0) - samples("ball", soil, RATIO, scaled("ball", 1.0)))
    assert np.nanmax(apart) > 0.05


@soils
def test_the_point_mass_engine_moves_blocks_of_two_sizes_alike(soil):
    ends = []
    for ratio in (1.0, RATIO):
        block = scaled("ball", ratio)
        law = {"default": soil_rebound(soil, block.mass_kg, block.size_m)}
        tracks = [
            run_point_mass(block, floor(ratio), law, state, time_limit_s=60.0, seed=1) for state in released(ratio)
        ]
        speed = np.sqrt(ratio)
        unit = np.array([ratio / speed, ratio, ratio, 1.0, speed, speed, speed / ratio])
        assert {track.stop for track in tracks} == {"rest"} and min(len(t.impacts) for t in tracks) > 1
        ends.append([track.knots[-1][:7] / unit for track in tracks])
    assert np.abs(np.subtract(*ends)).max() < 1e-9 * np.abs(ends).max()


@pytest.mark.parametrize("rough", [True, False])
def test_roughness_keeps_a_point_mass_bouncing_down_a_talus(rough):
    """On a plane without roughness each rebound takes normal speed that nothing gives back, and even steep talus stops
    every block."""
    soil = SOIL_CLASSES["coarse_talus"]
    soil = soil if rough else replace(soil, slope_reduction_deg=0.0)
    slope = CrossSection([[0.0, 0.0], [100.0, -84.0]], ["talus"])  # 40°
    block = scaled("ball", 2.0)
    law = {"default": soil_rebound(soil, block.mass_kg, block.size_m)}
    stops = [
        run_point_mass(block, slope, law, [1, 2, 0, 2, 0, 0], time_limit_s=120.0, seed=seed).stop for seed in range(10)
    ]
    assert stops == ["exit" if rough else "rest"] * 10


@soils
def test_restitution_and_relative_penetration_are_those_of_the_class_at_any_size(soil):
    for mass_kg, size_m in ((0.022, 0.025), (300.0, 0.6), (20_000.0, 2.4)):
        law, speed = soil_contact(soil, mass_kg, size_m), 2.0 * np.sqrt(SOIL_GRAVITY_M_S2 * size_m)
        assert closed_forms.restitution(law) == pytest.approx(soil.restitution, rel=1e-12)
        relative = closed_forms.penetration_m(law, mass_kg, speed) / size_m
        assert relative == pytest.approx(2.0 / np.sqrt(soil.stiffness), rel=1e-12)


@soils
def test_both_laws_have_the_restitution_of_the_class_at_the_reference_impact(soil):
    block = make_block("ball", "circle", 1414.0, diameter_m=1.0)
    speed = reference_speed_m_s(block.size_m)
    rebound = soil_rebound(soil, block.mass_kg, block.size_m)
    r_n = normal_restitution(-speed, block.mass_kg, rebound.momentum_half_kg_m_s)
    assert r_n == pytest.approx(soil.restitution, rel=1e-12)
    # the engine without gravity: a single impact, straight down
    table = contact_table(replace(soil_contact(soil, block.mass_kg, block.size_m), k_t_N_m=0.0), ("floor",))
    result = run_batch(
        Ensemble([block], [floor(1.0)], [table]), np.array([[0, 0.6, 0, 0, -speed, 0]]), gravity_m_s2=0.0,
        time_limit_s=3.0, impact_limit=1, step_fraction=0.02,
    )  # fmt: skip
    assert STOPS[result.stop[0]] == "impacts"
    assert result.ends[0, 5] / speed == pytest.approx(soil.restitution, rel=1e-4)


@soils
def test_ranges_hold_the_value_and_numbers_lie_where_the_laws_make_sense(soil):
    for value, (low, high) in (
        (soil.restitution, soil.restitution_range),
        (soil.friction_angle_deg, soil.friction_range_deg),
        (soil.stiffness, soil.stiffness_range),
    ):
        assert 0 < low < value < high
    assert soil.restitution_range[1] < 1 and soil.friction_range_deg[1] < 90
    assert soil.description and soil.source and soil.assumed


def test_harder_ground_is_stiffer_and_gives_back_more():
    names = ["deep_soil", "shallow_soil", "medium_scree", "coarse_talus", "covered_bedrock", "bedrock"]
    order = [SOIL_CLASSES[name] for name in names]
    for quantity in ("restitution", "stiffness", "tangential_restitution"):
        values = [getattr(soil, quantity) for soil in order]
        assert values == sorted(set(values))


def test_contact_on_bedrock_lasts_as_long_as_measured_on_hard_ground():
    """Caviezel and Gerber (2018): 8 to 15 ms; a block of 0.35 m is assumed."""
    soil = SOIL_CLASSES["bedrock"]
    mass_kg, size_m = 60.0, 0.35
    durations_s = [
        closed_forms.contact_time_s(soil_contact(replace(soil, stiffness=kappa), mass_kg, size_m), mass_kg)
        for kappa in soil.stiffness_range
    ]
    assert durations_s == pytest.approx([0.015, 0.008], rel=0.02)


def test_tangential_restitution_without_slip_lies_where_wyllie_found_it():
    """Wyllie (2014): v_t' / v_t of 0.3 to 0.8. Without slip and spin the law gives 5/7 r_t."""
    for soil in SOIL_CLASSES.values():
        assert 0.3 <= 5 / 7 * soil.tangential_restitution <= 0.8


def test_compacted_fill_reaches_up_to_the_paper_s_soil():
    """Table 4 for the 22 g sphere: the dimensionless numbers are those of the class, or its greatest stiffness."""
    soil = SOIL_CLASSES["compacted_fill"]
    law = soil_contact(replace(soil, stiffness=soil.stiffness_range[1]), 0.022, 0.025)
    assert law.k_l_N_m == pytest.approx(1.0e4, rel=0.01)
    assert law.k_t_N_m == pytest.approx(2.5e3, rel=0.01) and law.k_r_Nm_rad == pytest.approx(0.025, rel=0.01)
    assert law.friction_angle_deg == 30
    assert soil.restitution_range[0] < np.sqrt(1 / 6) < soil.restitution_range[1]
