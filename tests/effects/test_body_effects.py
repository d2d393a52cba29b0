"""Rounded corners and a centre of mass off the centroid: contact geometry, energy, limits."""

from dataclasses import replace

import numpy as np
import pytest

from rock2d.engines import contact_state
from rock2d.engines.contact_search import find_features
from rock2d.engines.geometry import WorldArrays, block_arrays, ground_arrays
from rock2d.engines.pymunk_engine import PymunkRelease, run_pymunk
from rock2d.laws.contact import ContactParameters, contact_table
from rock2d.scene.blocks import make_block, states_at
from rock2d.scene.cross_section import CrossSection
from tests.effects.worlds import FLOOR, elastic, run, with_effect, world
from tests.laboratory import BLOCKS, CUBE, LAW, SETUP, SLAB, SPHERE, VELOCITIES_AFTER, after

SIDE = 0.019
RIDGE = CrossSection([[-1, -0.6], [0, 0], [1, -0.9]], ["left", "right"])
ROUND_CUBE = replace(CUBE, rounding_m=0.003)
ROUND_SLAB = replace(SLAB, rounding_m=0.004)
OFF_SPHERE = replace(SPHERE, centre_of_mass_m=(0.002, -0.001))
OFF_CUBE = replace(CUBE, centre_of_mass_m=(0.0015, 0.001))
OFF_EGG = replace(BLOCKS["egg"], centre_of_mass_m=(-0.002, 0.001))
BODIES = {"round_cube": ROUND_CUBE, "round_slab": ROUND_SLAB, "off_sphere": OFF_SPHERE, "off_cube": OFF_CUBE,
          "off_egg": OFF_EGG, "both": replace(ROUND_SLAB, centre_of_mass_m=(0.002, 0.001))}  # fmt: skip


def closest(block, cross_section, pose):
    """Features of all contacts at a pose: kind, depth, rate of depth per unit of motion in x, y, theta."""
    compiled = WorldArrays(block_arrays(block), ground_arrays(cross_section), np.zeros((1, 1)), 0.0)
    n = contact_state.contact_count(block)
    rates = []
    for axis in range(3):
        memory, found = contact_state.new_contacts(n), contact_state.new_contacts(n)
        q = np.concatenate([pose, np.eye(3)[axis]])
        find_features(q, 1.0, (0, len(cross_section.zones)), compiled, memory, found)
        rates.append(found.reals[:, contact_state.RATE].copy())
    depth = found.reals[:, contact_state.DEPTH]
    kept = depth > contact_state.NOWHERE
    assert n == len(depth)
    return np.where(kept, depth, -np.inf), np.array(rates).T


@pytest.mark.parametrize("name", BODIES)
def test_depth_rates_are_the_gradient_of_the_depth(name):
    """The rate is minus the normal velocity of the material, and it is the derivative of the depth: a force k δ along
    the normal is conservative."""
    block, rng = BODIES[name], np.random.default_rng(1)
    checked = 0
    for _ in range(300):
        pose = np.array([rng.normal(0, 0.015), rng.uniform(0.0, 0.02), rng.uniform(-np.pi, np.pi)])
        depth, rates = closest(block, RIDGE, pose)
        step = 1e-7
        for axis in range(3):
            ahead, _ = closest(block, RIDGE, pose + step * np.eye(3)[axis])
            back, _ = closest(block, RIDGE, pose - step * np.eye(3)[axis])
            with np.errstate(invalid="ignore"):
                slope = (ahead - back) / (2 * step)
            scale = np.array([1, 1, block.reach_m])[axis]
            good = np.isfinite(slope) & (depth > 0)
            error = np.abs(slope[good] - rates[good, axis]) / scale
            checked += good.sum()
            assert np.sum(error > 1e-4) <= 1 and np.all(error < 2.5)  # an event between the two poses is rare
    assert checked > 200


@pytest.mark.parametrize("block", [ROUND_CUBE, ROUND_SLAB], ids=lambda b: b.name)
def test_deepest_point_is_continuous_as_a_rounded_block_slides_and_turns_over_a_ridge(block):
    """No step of the greatest depth larger than the motion, where circle, face and ground corner take turns."""
    for tilt in np.linspace(-np.pi, np.pi, 6):
        path = np.linspace(-0.03, 0.03, 601)
        deepest = [closest(block, RIDGE, np.array([x, 0.008, tilt + 5 * x]))[0].max() for x in path]
        assert np.abs(np.diff(deepest)).max() < 1.5 * 1e-4 * (1 + 5 * block.reach_m)


def test_without_rounding_or_offset_results_are_the_same_bits():
    bare = replace(CUBE, rounding_m=0.0, centre_of_mass_m=(0.0, 0.0))
    state = np.array([[0.05, 0.08, 0.3, 1.0, -1.5, -20.0]])
    a, b = (run(world(SETUP, (block,)), state, impact_room=5, impact_limit=5) for block in (CUBE, bare))
    assert np.array_equal(a.impacts, b.impacts, equal_nan=True)


@pytest.mark.parametrize("engine", ["batch", "pymunk"])
def test_a_square_rounded_to_a_circle_moves_as_one(engine):
    square = replace(CUBE, rounding_m=SIDE / 2)
    circle = make_block("circle", "circle", CUBE.mass_kg, CUBE.inertia_kg_m2, diameter_m=SIDE)
    state = np.array([0.05, 0.05, 0.3, 0.3, -1.0, -60.0])
    ends = []
    for block in (square, circle):
        w = world(SETUP, (block,))
        if engine == "batch":
            ends.append(run(w, state[None], impact_limit=1, impact_room=1, step_fraction=0.03).impacts[0, 0, 1:17])
        else:
            impact = run_pymunk(block, SETUP, LAW, state, impact_limit=1).impacts[0]
            ends.append([v for k, v in impact.items() if k != "zone"])
    assert ends[0] == pytest.approx(ends[1], rel=2e-4, abs=1e-6)


def test_rounding_leaves_faces_mass_and_inertia_and_cuts_corners():
    """Lying on a face the block has its height; on a corner it is lower by ρ (√2 - 1)."""
    block = block_arrays(ROUND_CUBE)
    assert (block.mass, block.inertia) == (CUBE.mass_kg, CUBE.inertia_kg_m2)
    flat, _ = closest(ROUND_CUBE, FLOOR, np.array([0, SIDE / 2, 0.0]))
    edge, _ = closest(ROUND_CUBE, FLOOR, np.array([0, SIDE / np.sqrt(2), np.pi / 4]))
    assert sorted(flat)[-2:] == pytest.approx([0, 0], abs=1e-15)
    assert edge.max() == pytest.approx(-0.003 * (np.sqrt(2) - 1), rel=1e-9)


def test_a_radius_that_no_corner_has_room_for_is_refused():
    with pytest.raises(ValueError, match=r"rounded with up to 0\.0095"):
        replace(CUBE, rounding_m=0.0096)
    assert with_effect(world(), "rounded_edges", [0.95]).blocks["cube"].rounding_m == pytest.approx(0.95 * 0.007)


@pytest.mark.parametrize("name", BODIES)
@pytest.mark.parametrize("cross_section", [SETUP, RIDGE], ids=["setup", "ridge"])
def test_springs_alone_keep_the_energy(name, cross_section):
    """Elastic, frictionless: kinetic, potential and elastic energy stay, wherever the block hits."""
    rng = np.random.default_rng(5)
    block, worst = BODIES[name], []
    for _ in range(5):
        x = rng.uniform(-0.02, 0.2) if cross_section is SETUP else rng.normal(0, 0.01)
        top = 0.13 if cross_section is SETUP else 0.03
        state = np.array([x, top, rng.uniform(0, 6), rng.normal(0.2, 0.3), -1.0, rng.normal(0, 20)])
        sim = PymunkRelease(block, cross_section, elastic(), state)
        while sim.time < 0.12:
            sim.step()
        balance = sim.energy_balance()
        worst.append(abs(balance["residual"]) / (balance["kinetic"] + balance["elastic"]))
    assert np.median(worst) < 2e-6
    assert max(worst) < 2e-4  # a corner that leaves a face's end passes on with its memory


def test_states_of_another_point_of_the_body_and_back():
    rng = np.random.default_rng(2)
    states, offset = rng.normal(size=(7, 6)), (0.003, -0.002)
    moved = states_at(states, offset)
    assert states_at(moved, (-0.003, 0.002)) == pytest.approx(states, abs=1e-15)
    step = 1e-6
    later = states.copy()
    later[:, :3] += step * states[:, 3:]
    assert (states_at(later, offset)[:, :3] - moved[:, :3]) / step == pytest.approx(moved[:, 3:], abs=1e-5)


def test_the_centre_of_mass_flies_the_parabola_and_the_centroid_circles_it():
    w = world(FLOOR, (OFF_SPHERE,))
    centroid = np.array([[0, 2.0, 0.4, 1.0, 0.5, 30.0]])
    start = states_at(centroid, OFF_SPHERE.centre_of_mass_m)
    end = run(w, start, time_limit_s=0.3).ends[0, 1:]
    assert end[0] == pytest.approx(start[0, 0] + 0.3 * start[0, 3], rel=1e-12)
    away = states_at(end, tuple(-np.array(OFF_SPHERE.centre_of_mass_m)))[0, :2] - end[:2]
    assert np.hypot(*away) == pytest.approx(np.hypot(*OFF_SPHERE.centre_of_mass_m), rel=1e-9)


def test_a_ball_with_its_mass_low_swings_as_a_pendulum():
    """Rolling without slip about its lowest point: T = 2 π √((I + m (r - e)²) / (m g e)) for small swings."""
    e, r = 0.003, SPHERE.radius_m
    low = replace(SPHERE, centre_of_mass_m=(0.0, -e))
    law = ContactParameters(k_l_N_m=4e4, k_ul_N_m=4e4, k_t_N_m=4e4, friction_angle_deg=90, k_r_Nm_rad=0.0)
    tilt = 0.05
    period = 2 * np.pi * np.sqrt((low.inertia_kg_m2 + low.mass_kg * (r - e) ** 2) / (low.mass_kg * 9.81 * e))
    state = states_at(np.array([[0, r + 1e-7, tilt, 0, 0, 0]]), low.centre_of_mass_m)[0]
    sim = PymunkRelease(low, FLOOR, law, state)
    times, theta = [], []
    while sim.time < 0.9 * period:
        sim.step()
        times.append(sim.time)
        theta.append(sim.q[2])
    sign = np.sign(theta)
    through = np.array(times)[np.flatnonzero(np.diff(sign))]
    assert len(through) == 2
    assert 2 * (through[1] - through[0]) == pytest.approx(period, rel=0.01)
    assert np.abs(theta).max() < 1.02 * tilt


@pytest.mark.parametrize("name", BODIES)
def test_both_engines_agree(name):
    rng, block = np.random.default_rng(8), BODIES[name]
    states = np.array(
        [[rng.uniform(0, 0.1), 0.09, rng.uniform(0, 6), 1.2, -1.4, rng.normal(-20, 15)] for _ in range(12)]
    )
    table = contact_table(LAW, SETUP.zone_names)
    batch = run(replace(world(SETUP, (block,)), contact=table[None]), states, impact_limit=1, impact_room=1,
                step_fraction=0.03)  # fmt: skip
    errors = []
    for i, state in enumerate(states):
        impact = run_pymunk(block, SETUP, LAW, state, impact_limit=1).impacts[0]
        scale = np.hypot(state[3], state[4]) / np.array([1, 1, block.reach_m])
        errors.append(np.abs((batch.impacts[i, 0, VELOCITIES_AFTER] - after(impact)) / scale).max())
    assert np.median(errors) < 2e-4
    assert np.mean(np.array(errors) < 1e-3) >= 0.9
