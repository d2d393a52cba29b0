"""Forces of the air against their closed forms."""

from dataclasses import replace

import numpy as np
import pytest

from rock2d.records.columns import BEFORE, E_DISSIPATED, EFFECTS
from rock2d.scene.cross_section import CrossSection
from tests.effects.worlds import energies, pymunk_release, run, with_effect, world
from tests.laboratory import CUBE, SETUP, SPHERE

ABYSS = CrossSection([[-1000, -1000], [1000, -1000]], ["floor"])
TIMES = np.linspace(0.05, 3.0, 40)


def flight(name, values, state, gravity, times=TIMES):
    """Sampled path (k, 3) and end state of a free flight."""
    w = with_effect(world(ABYSS, (SPHERE,), gravity_m_s2=gravity), name, values)
    result = run(w, np.array([state], float), times_s=times, time_limit_s=times[-1])
    return result.samples[0], result.ends[0, 1:]


def test_drag_of_a_fall_from_rest_is_the_log_cosh():
    """y = -(1/k) ln cosh(t √(g k)), v = √(g/k) tanh(t √(g k)) with k = c/m; it tends to the terminal speed √(g/k)."""
    k, g = 0.5, 9.81
    path, end = flight("air_drag", [k], [0, 0, 0, 0, 0, 0], g)
    assert path[:, 1] == pytest.approx(-np.log(np.cosh(TIMES * np.sqrt(g * k))) / k, rel=2e-6)
    assert end[4] == pytest.approx(-np.sqrt(g / k) * np.tanh(3 * np.sqrt(g * k)), rel=1e-6)
    assert abs(end[4]) == pytest.approx(np.sqrt(g / k), rel=3e-3)


def test_drag_without_weight():
    """x = ln(1 + k v t) / k."""
    path, end = flight("air_drag", [0.5], [0, 0, 0, 4, 0, 0], 0.0)
    assert path[:, 0] == pytest.approx(np.log1p(0.5 * 4 * TIMES) / 0.5, rel=1e-5)
    assert end[3] == pytest.approx(4 / (1 + 0.5 * 4 * 3), rel=1e-5)


def test_damping_decays_exponentially():
    """v and ω as exp(-λ t); with weight v_y tends to -g/λ."""
    rate, g = 1.5, 9.81
    path, end = flight("flight_damping", [rate], [0, 0, 0, 3, 2, 40], g)
    decay = np.exp(-rate * TIMES)
    assert path[:, 0] == pytest.approx(3 / rate * (1 - decay), rel=1e-5)
    assert path[:, 2] == pytest.approx(40 / rate * (1 - decay), rel=1e-5)
    fall = (2 + g / rate) / rate * (1 - decay) - g / rate * TIMES
    assert path[:, 1] == pytest.approx(fall, rel=1e-5, abs=1e-5)
    assert end[[3, 5]] == pytest.approx(np.array([3, 40]) * np.exp(-rate * 3), rel=1e-5)


def test_magnus_lift_bends_the_path_into_a_circle():
    """Without weight: radius m v / (c ω), turned with the spin, no energy taken."""
    share, omega, v = 0.02, 50.0, 2.0
    radius, turn = v / (share * omega), share * omega
    path, end = flight("magnus_lift", [share], [0, 0, 0, v, 0, omega], 0.0)
    assert path[:, 0] == pytest.approx(radius * np.sin(turn * TIMES), abs=1e-4)
    assert path[:, 1] == pytest.approx(radius * (1 - np.cos(turn * TIMES)), abs=1e-4)
    assert np.hypot(end[3], end[4]) == pytest.approx(v, rel=1e-6)


@pytest.mark.parametrize("name", ["air_drag", "flight_damping", "magnus_lift"])
def test_both_engines_fly_alike_and_account_for_the_energy(name):
    w = with_effect(world(ABYSS, (CUBE,)), name)
    state = np.array([0, 0, 0.3, 2.0, 1.0, -40.0])
    start = energies(w, state)[0]
    result = run(w, state[None], time_limit_s=1.0, times_s=[1.0])
    sim = pymunk_release(w, state)
    while sim.time < 1.0:
        sim.step()
    scale = energies(w, [0, 0, 0, 2.0, 1.0, 0])[0]
    assert abs(sim.energy_balance()["residual"]) < 1e-6 * scale
    assert energies(w, result.ends[0, 1:])[0] + result.energy_J[0, E_DISSIPATED].sum() == pytest.approx(
        start, abs=1e-6 * scale
    )
    assert (result.energy_J[0, E_DISSIPATED][EFFECTS] > 1e-4 * scale) == (name != "magnus_lift")
    at = run(w, state[None], time_limit_s=sim.time).ends[0]
    assert sim.q == pytest.approx(at[1:], rel=2e-6)


@pytest.mark.parametrize("block", [0, 1])
def test_a_flight_through_air_meets_the_ground_as_finer_strides_do(block):
    """Time and state of the first touch do not depend on how the flight is cut: the ground is never overshot."""
    w = with_effect(world(SETUP, (SPHERE, CUBE)), "air_drag", [0.6])
    states = np.array([[0.0, 0.3, a, 0.4, 0.5, -20.0] for a in np.linspace(0, 6, 12)])
    coarse = run(w, states, block, impact_limit=1, impact_room=1)
    for i, state in enumerate(states):
        touch = coarse.impacts[i, 0]
        q, flown = state[None], (1 - 1e-3) * touch[1]
        for _ in range(50):
            q = run(w, q, block, time_limit_s=flown / 50).ends[:, 1:]
        again = run(w, q, block, impact_limit=1, impact_room=1).impacts[0, 0]
        assert again[1] + flown == pytest.approx(touch[1], rel=1e-6)
        assert again[BEFORE] == pytest.approx(touch[BEFORE], rel=1e-5, abs=1e-6)


def test_lines_are_crossed_where_the_path_lies():
    setup = CrossSection([[-1, -50], [100, -50]], ["floor"], {"upright": [[1.0, -20], [1.0, 20]]})
    w = with_effect(world(setup, (SPHERE,)), "air_drag", [0.5])
    state = np.array([[0, 0, 0, 4.0, 1.0, 0]])
    crossing = run(w, state, time_limit_s=1.0).crossings[0, 0]
    at = run(w, state, time_limit_s=crossing[0]).ends[0, 1:]
    assert crossing[1] == pytest.approx(1.0, abs=1e-7)
    assert crossing[1:] == pytest.approx(at, abs=1e-7)


def test_a_block_without_air_in_the_ensemble_flies_its_parabola():
    w = with_effect(world(ABYSS, (SPHERE, CUBE)), "air_drag")
    mixed = replace(w, blocks={**w.blocks, "cube": CUBE})
    state = np.array([[0, 0, 0, 2.0, 1.0, 5.0]])
    assert np.array_equal(
        run(mixed, state, 1, time_limit_s=1.0).ends, run(world(ABYSS), state, 1, time_limit_s=1.0).ends
    )
