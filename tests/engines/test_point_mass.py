"""The point-mass engine: exact flights, no tunnelling, symmetry, energy, and the ways a release ends."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rock2d.engines.parabola_intersection import facet_impact, make_surface, next_impact
from rock2d.engines.point_mass import run_point_mass, spin_radius_m, uniform
from rock2d.laws.rebound import ReboundParameters
from rock2d.records.columns import INSTANT_X, INSTANT_Y, TIME
from rock2d.scene.cross_section import CrossSection
from tests.laboratory import CUBE, FLOOR, SPHERE

G = 9.81
DITCH, FACE = ReboundParameters(0.0, 0.025, 0.85), ReboundParameters(11.0, 0.04, 0.89)
SPHERE_LAW = {"default": DITCH, "face": FACE}
RANDOM_LAW = {
    "default": ReboundParameters(0.0, 0.025, 0.85, 40, "uniform"),
    "face": ReboundParameters(11.0, 0.04, 0.89, 40, "uniform"),
}
# slope, ditch, embankment with an upright facing and a nose that overhangs it, tail
POINTS = [[-0.8, 0.6], [0, 0], [0.1, 0], [0.1, 0.05], [0.08, 0.09], [0.16, 0.1], [0.25, 0], [0.6, 0]]
ZONES = ["slope", "ditch", "face", "face", "crest", "tail", "tail"]
SETUP = CrossSection(POINTS, ZONES)


def run(state, cross_section=SETUP, law=SPHERE_LAW, seed=0, block=SPHERE, time_limit_s=20.0, **more):
    return run_point_mass(
        block, cross_section, law, np.array(state, float), time_limit_s=time_limit_s, seed=seed, **more
    )


def random_states(n, seed=0):
    rng = np.random.default_rng(seed)
    low, high = [-0.7, 0.61, -3, -1, -6, -200], [0.3, 0.9, 3, 4, 0, 200]
    return rng.uniform(low, high, (n, 6))


def energy_J(knots, block=SPHERE):
    r = spin_radius_m(block)
    _, _, y, _, vx, vy, omega = knots.T
    return block.mass_kg * (0.5 * (vx**2 + vy**2 + 0.4 * (r * omega) ** 2) + G * y)


def inside_ground(cross_section, x, y, depth):
    """Which points lie deeper than `depth` in the ground, as a polygon closed far below: no engine code."""
    import shapely

    points = cross_section.points_m
    ground = shapely.Polygon([*points, [points[-1, 0], -9], [points[0, 0], -9]])
    return shapely.contains_xy(ground.buffer(-depth), x, y)


def test_the_impact_of_a_thrown_block_on_a_slope_is_that_of_the_closed_form():
    slope = CrossSection([[-10, 10 * np.tan(0.5)], [10, -10 * np.tan(0.5)]], ["slope"])
    vx, vy = 2.0, 1.0
    hit = run([0, 0, 0.3, vx, vy, -7], slope).impacts[0]
    t = 2 * (vy + vx * np.tan(0.5)) / G  # v_y t - g t²/2 = -tan(0.5) v_x t
    want = {"t_s": t, "x_m": vx * t, "y_m": -np.tan(0.5) * vx * t, "theta_rad": 0.3 - 7 * t}
    assert {k: hit[k] for k in want} == pytest.approx(want, rel=1e-13)
    assert (hit["vx_m_s"], hit["vy_m_s"]) == pytest.approx((vx, vy - G * t), rel=1e-13)


def test_bounces_on_a_floor_follow_the_hyperbolic_restitution():
    impacts = run([0, 1, 0, 0.1, 0, 0], FLOOR).impacts
    v = np.sqrt(2 * G)
    for hit in impacts[:10]:
        assert hit["vy_m_s"] == pytest.approx(-v, rel=1e-12)
        v *= 0.025 / (0.025 + 0.022 * v)
        assert hit["vy_after_m_s"] == pytest.approx(v, rel=1e-12)


def test_a_flight_knows_only_the_facets_in_its_way():
    # over a pit, and up against the ceiling of a cave from below
    pit = CrossSection([[-1, 0], [0, 0], [0, -1], [1, -1], [1, 0], [2, 0]], ["left", "wall", "pit", "wall", "right"])
    assert run([-0.5, 0.1, 0, 8, 0, 0], pit).impacts[0]["zone"] == "wall"
    assert run([-0.5, 0.1, 0, 12, 0, 0], pit).impacts[0]["zone"] == "right"
    cave = CrossSection(
        [[-1, 0], [1, 0], [1, 0.5], [0, 0.5], [0, 0.6], [2, 0.6]], ["floor", "wall", "ceiling", "nose", "top"]
    )
    assert run([0.2, 0.2, 0, 1, 5, 0], cave).impacts[0]["zone"] == "ceiling"
    assert run([0.2, 0.2, 0, 9, 0, 0], cave).impacts[0]["zone"] == "wall"
    assert run([-0.5, 0.55, 0, 5, 0, 0], cave).impacts[0]["zone"] == "nose"
    assert run([0.5, 0.9, 0, 0, 0, 0], cave).impacts[0]["zone"] == "top"


@pytest.mark.parametrize("law", [SPHERE_LAW, RANDOM_LAW])
def test_no_release_of_a_thousand_gets_into_the_ground(law):
    x, y = [], []
    for seed, state in enumerate(random_states(1000)):
        track = run(state, law=law, seed=seed)
        knots = track.knots[:, TIME]
        within = knots[:-1, None] + np.diff(knots)[:, None] * [0.0, 0.25, 0.5, 0.75]
        times = np.concatenate([within.ravel(), np.linspace(0, track.end_s, 50)])
        states = track.states(times)
        x.append(states[:, 0])
        y.append(states[:, 1])
        assert track.stop != "time"
    assert not inside_ground(SETUP, np.concatenate(x), np.concatenate(y), 1e-9).any()


@pytest.mark.parametrize("pieces", [1, 7, 40])
@pytest.mark.parametrize("mirrored", [False, True])
def test_the_tree_finds_the_impact_that_a_look_at_every_facet_finds(pieces, mirrored):
    cross_section = SETUP.subdivided(pieces)
    if mirrored:
        cross_section = CrossSection(cross_section.points_m[::-1] * [-1, 1], cross_section.zones[::-1])
    surface, rng, stack, hits = (make_surface(cross_section), np.random.default_rng(5), np.empty(64, np.int64), 0)
    for _ in range(300):  # off a facet, hops of micrometres to flights of metres
        current = int(rng.integers(len(cross_section.zones)))
        x, y = (
            cross_section.points_m[current]
            + rng.uniform() * np.diff(cross_section.points_m[current : current + 2], axis=0)[0]
        )
        direction = (
            rng.uniform(-1, 1) * cross_section.tangents[current] + rng.uniform() * cross_section.normals[current]
        )
        vx, vy = 10 ** rng.uniform(-2.5, 1) * direction
        each = [
            facet_impact(surface.facets, j, (x, y, vx, vy), G, j == current, surface.reach_m)[0]
            for j in range(len(cross_section.zones))
        ]
        first = min([tau for tau in each if tau >= 0.0], default=5.0)
        found = next_impact(surface, stack, (x, y, vx, vy), G, current, 5.0)
        assert found[0] == min(first, 5.0)
        assert found[1] == -1 or each[found[1]] == first
        hits += found[1] >= 0
    assert hits > 200


def test_flights_through_joints_meet_a_facet():
    # aimed straight at every vertex of a rough floor, and dropped right onto it
    rng = np.random.default_rng(3)
    x = np.sort(rng.uniform(0, 1, 200))
    rough = CrossSection(np.column_stack([x, 0.02 * rng.uniform(size=200)]), ["rough"] * 199)
    for px, py in rough.points_m[20:-20]:
        for vx in (0.0, 0.7, -0.9):
            fall = 0.05
            start = [px - vx * fall, py + 0.5 * G * fall**2 + 0.4 * fall, 0, vx, -0.4, 0]
            hit = run(start, rough).impacts[0]
            assert hit["t_s"] <= fall * (1 + 1e-9)


@pytest.mark.parametrize("law", [SPHERE_LAW, {"default": ReboundParameters(25, 0.5, 0.95, 30)}])
def test_the_mirrored_release_is_the_mirror_of_the_release(law):
    mirrored = CrossSection(SETUP.points_m[::-1] * [-1, 1], ZONES[::-1])
    flip = np.array([-1, 1, -1, -1, 1, -1])
    for state in random_states(50, seed=1):
        # 2 s: later the bounces have blown rounding up
        here, there = run(state, law=law, time_limit_s=2), run(state * flip, mirrored, law, time_limit_s=2)
        assert (here.stop, len(here.impacts)) == (there.stop, len(there.impacts))
        np.testing.assert_allclose(there.knots[:, 1:] * flip, here.knots[:, 1:], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("pieces", [10, 97])
def test_cutting_the_facets_changes_nothing(pieces):
    fine = SETUP.subdivided(pieces)
    for seed, state in enumerate(random_states(50, seed=2)):
        coarse_track, fine_track = (run(state, cross_section, RANDOM_LAW, seed) for cross_section in (SETUP, fine))
        assert [i["zone"] for i in coarse_track.impacts] == [i["zone"] for i in fine_track.impacts]
        np.testing.assert_allclose(fine_track.knots, coarse_track.knots, rtol=1e-9, atol=1e-9)


@given(
    phi=st.floats(0, 90),
    half=st.floats(1e-4, 10),
    r_t=st.floats(0, 1),
    alpha=st.floats(0, 89),
    state=st.tuples(*(st.floats(*r) for r in [(-0.7, 0.5), (0.61, 1), (-3, 3), (-5, 5), (-5, 5), (-300, 300)])),
    seed=st.integers(0, 1000),
)
@settings(max_examples=200, deadline=None)
def test_energy_never_rises_over_a_whole_descent(phi, half, r_t, alpha, state, seed):
    law = {"default": ReboundParameters(phi, half, r_t, alpha, "uniform")}
    for block in (SPHERE, CUBE):
        energy = energy_J(run(state, law=law, seed=seed, block=block, time_limit_s=5).knots, block)
        assert (np.diff(energy) <= 1e-12 * np.abs(energy[0])).all()


def test_in_flight_energy_is_kept_and_the_block_turns_freely():
    track = run([-0.5, 0.7, 0.2, 1.5, 0.5, 30], law=RANDOM_LAW)
    energy, flying = energy_J(track.knots), np.flatnonzero(track.flight)
    np.testing.assert_allclose(energy[flying + 1], energy[flying], rtol=1e-12)
    turned = track.knots[flying, 3] + track.knots[flying, 6] * np.diff(track.knots[:, TIME])[flying]
    np.testing.assert_allclose(track.knots[flying + 1, 3], turned, rtol=1e-12)


def test_another_seed_gives_another_release():
    one, other = (run([-0.5, 0.7, 0.2, 1.5, 0.5, 30], law=RANDOM_LAW, seed=seed).knots for seed in (7, 8))
    assert not np.array_equal(one, other)


def test_drawn_slope_reductions_are_uniform():
    numbers = np.array([uniform(np.uint64(seed), k) for seed in range(100) for k in range(100)])
    assert np.abs(np.sort(numbers) - np.arange(1e4) / 1e4).max() < 1.63 / 100  # Kolmogorov, 1 %
    assert abs(np.corrcoef(numbers[:-1], numbers[1:])[0, 1]) < 0.03


def test_without_a_drawn_reduction_no_seed_is_needed_and_with_one_it_is():
    run_point_mass(SPHERE, SETUP, SPHERE_LAW, np.array([-0.5, 0.7, 0, 1, 0, 0]), time_limit_s=1)
    with pytest.raises(ValueError, match="a seed is needed"):
        run_point_mass(SPHERE, SETUP, RANDOM_LAW, np.array([-0.5, 0.7, 0, 1, 0, 0]), time_limit_s=1)


def test_ways_to_end():
    assert run([0, 0.1, 0, 0, 0, 0], FLOOR).stop == "rest"
    gone = run([0, 1, 0, 30, 0, 0], FLOOR)
    assert (gone.stop, gone.knots[-1, INSTANT_X]) == ("exit", pytest.approx(5, abs=1e-9))
    late = run([0, 1, 0, 0.5, 0, 0], FLOOR, time_limit_s=0.1)
    assert (late.stop, late.end_s) == ("time", 0.1)
    assert late.knots[-1, INSTANT_Y] == pytest.approx(1 - 0.5 * G * 0.01, rel=1e-14)


def test_bounces_too_many_to_follow_end_at_rest():
    # r_n so small that a bounce off the slope takes a nanosecond: the block loses its way along it at once
    slope = CrossSection([[-10, 10], [10, -10]], ["slope"])
    track = run([0, 1, 0, 0, 0, 0], slope, {"default": ReboundParameters(0, 1e-12, 1.0)}, stop_speed_m_s=1e-6)
    assert track.stop == "rest"
    assert np.hypot(*(track.knots[-1, 1:3] - [track.impacts[0]["x_m"], track.impacts[0]["y_m"]])) < SPHERE.size_m


def test_a_block_does_not_come_to_rest_on_a_wall():
    wall = CrossSection([[-1, 0], [0, 0], [0, 1]], ["floor", "wall"])
    track = run([-0.0002, 0.5, 0, 0.02, 0, 0], wall, {"default": ReboundParameters(0, 0.025, 0.1)})
    slow = track.impacts[0]["vx_after_m_s"], track.impacts[0]["vy_after_m_s"]
    assert np.hypot(*slow) < 0.5 * 0.1 * np.sqrt(G * SPHERE.size_m)
    assert track.impacts[0]["zone"] == "wall"
    assert track.knots[-1, INSTANT_Y] == 0.0


def test_a_start_in_the_ground_is_lifted_onto_it_and_one_in_an_overhang_is_left_in_the_air():
    assert run([-0.4, -0.1, 0, 0.5, 0.5, 0]).knots[0, INSTANT_Y] == pytest.approx(0.3, abs=1e-12)
    under_the_nose = run([0.095, 0.01, 0, 0, 0, 0])
    assert under_the_nose.knots[0, INSTANT_Y] == 0.01
    assert under_the_nose.impacts[0]["zone"] == "ditch"
    on_it = run([-0.4, 0.3, 0, 0.5, -1, 0])
    assert on_it.impacts[0]["t_s"] == 0.0
    assert run([9, 1, 0, -1, 0, 0]).stop == "exit"


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"state": [0, 1, 0, np.nan, 0, 0]}, "six finite"),
        ({"state": [0, 1, 0]}, "six finite"),
        ({"state": [0, 1, 0, 0, 0, 0], "time_limit_s": 0.0}, "time_limit_s"),
        ({"state": [0, 1, 0, 0, 0, 0], "gravity_m_s2": -9.81}, "gravity_m_s2"),
        ({"state": [0, 1, 0, 0, 0, 0], "law": {"face": FACE}}, "zone 'slope'"),
    ],
)
def test_impossible_input_is_refused(wrong, said):
    with pytest.raises(ValueError, match=said):
        run(**wrong)
