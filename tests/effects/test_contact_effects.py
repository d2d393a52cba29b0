"""Effects in contact against their closed forms, in both engines."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import brentq

from rock2d.effects.columns import column
from rock2d.effects.ground import BASE_DAMPING_RATIO, embankment_recoil
from rock2d.effects.impact_law import ONSET_SHARE
from rock2d.engines.batch import run_batch_track
from rock2d.engines.pymunk_engine import run_pymunk
from rock2d.laws.contact import ContactParameters
from rock2d.records.columns import E_DISSIPATED, EFFECTS, I_ZONE
from rock2d.scene.cross_section import CrossSection
from rock2d.scene.world import World
from tests.effects.worlds import CATALOGUE, FLOOR, elastic, pymunk_release, run, with_effect, world
from tests.laboratory import CUBE, SPHERE, VELOCITIES_AFTER, after

M, R = SPHERE.mass_kg, SPHERE.radius_m
NO_ROLLING = {"k_r_Nm_rad": 0.0}
SMOOTH = ContactParameters(k_t_N_m=0.0, friction_angle_deg=0.0, **NO_ROLLING)


def weightless(law: ContactParameters = SMOOTH) -> World:
    """The ball above a floor, without gravity."""
    return world(FLOOR, (SPHERE,), law, gravity_m_s2=0.0)


def rebound(w, vx=0.0, vy=-2.0, omega=0.0, **options) -> dict[str, np.ndarray]:
    """Velocities of a ball after its first impact, by either engine; the ball starts just above y = 0."""
    state = np.array([0.0, R + 1e-4, 0.0, vx, vy, omega])
    batch = run(w, state[None], impact_limit=1, impact_room=1, **options).impacts[0, 0, VELOCITIES_AFTER]
    return {"batch": batch, "pymunk": after(first_impact(w, state))}


def taken_by_effects(result) -> float:
    """Energy in J that effects took in the first release of an ensemble."""
    return result.energy_J[0, E_DISSIPATED][EFFECTS]


def first_impact(w, state) -> dict:
    """The first impact, and the audit at its end, of the pymunk engine."""
    track = run_pymunk(SPHERE, w.cross_section, w.contact[0], state, gravity_m_s2=w.gravity_m_s2, impact_limit=1)
    return track.impacts[0] | {"residual": track.energy_J["residual"]}


def dashpot_restitution(c, m, k):
    """e of a mass on spring k and dashpot c, apart when the force vanishes: exp(-ζ/√(1-ζ²) atan2(2ζ√(1-ζ²), 2ζ²-1))
    with ζ = c / (2 √(k m)). Schwager & Pöschel (2007), Granular Matter 9, 465."""
    zeta = c / (2 * np.sqrt(k * m))
    root = np.sqrt(1 - zeta**2)
    return np.exp(-zeta / root * np.arctan2(2 * zeta * root, 2 * zeta**2 - 1))


@pytest.mark.parametrize("rate", [20.0, 150.0, 600.0])
def test_viscous_damping_of_an_elastic_ground_is_the_dashpot(rate):
    w = with_effect(weightless(elastic()), "viscous_damping", [rate, 0.0])
    expected = dashpot_restitution(rate * M, M, 1e4)
    found = rebound(w)
    assert found["pymunk"][1] / 2 == pytest.approx(expected, rel=2e-4)
    assert found["batch"][1] / 2 == pytest.approx(expected, rel=2e-3)
    fine = rebound(w, step_fraction=0.02)
    assert fine["batch"][1] / 2 == pytest.approx(expected, rel=1e-4)


def test_viscous_restitution_depends_on_no_speed_and_never_pulls():
    w = with_effect(weightless(elastic()), "viscous_damping", [400.0, 0.0])
    slow, fast = (rebound(w, vy=-v)["pymunk"][1] / v for v in (0.2, 5.0))
    assert slow == pytest.approx(fast, rel=1e-3)
    sim = pymunk_release(w, [0, R + 1e-4, 0, 0, -2, 0])
    speeds = []
    for _ in range(4000):
        sim.step()
        speeds.append(sim.q[4])
        if sim.time > 0.008:
            break
    assert (np.diff(speeds) > -1e-12).all()  # the ground pushes or lets go


def test_damping_that_grows_with_the_depth_is_hunt_and_crossleys():
    """m dv/dt = -δ (k + h v): G(v) = v / h - k / h² ln(1 + h v / k) has the same value before and after."""
    w = with_effect(weightless(elastic()), "viscous_damping", [0.0, 1500.0])
    h, k = w.contact[0, 0, column("viscous_Ns_m2")], 1e4

    def level(v):
        return v / h - k / h**2 * np.log1p(h * v / k)

    expected = brentq(lambda v: level(-v) - level(2.0), 1e-3, 2.0)
    found = rebound(w)
    assert found["pymunk"][1] == pytest.approx(expected, rel=2e-4)
    assert found["batch"][1] == pytest.approx(expected, rel=2e-3)
    slow = rebound(w, vy=-0.2)["pymunk"][1] / 0.2
    assert slow > found["pymunk"][1] / 2.0  # unlike the plain dashpot's, its restitution falls with the speed


def test_adhesion_takes_pull_times_way():
    """On the way out of its indentation a ball loses pull × (depth of the indentation), less the onset's half."""
    plain = weightless()
    w = with_effect(plain, "adhesion", [4.0])
    pull = w.contact[0, 0, column("adhesion_N")]
    indentation = 2.0 / np.sqrt(SMOOTH.k_l_N_m / M) * (1 - SMOOTH.k_l_N_m / SMOOTH.k_ul_N_m)
    before, later = rebound(plain), rebound(w)
    for engine, tolerance in (("pymunk", 1e-4), ("batch", 5e-3)):
        lost = 0.5 * M * (before[engine][1] ** 2 - later[engine][1] ** 2)
        assert lost == pytest.approx(pull * indentation * (1 - ONSET_SHARE / 2), rel=tolerance), engine


def test_a_strong_pull_keeps_the_block_in_its_indentation():
    w = with_effect(world(FLOOR, (SPHERE,), SMOOTH), "adhesion", [12.0])
    result = run(w, np.array([[0, R + 1e-4, 0, 0, -0.5, 0]]), time_limit_s=2.0)
    assert result.stop[0] == 1  # rest
    assert result.ends[0, 2] < R


def test_ploughing_slows_the_slip_with_depth():
    """Without friction, weight or rolling: m dv/dt = -c ∫δ dt on the half-sine of first loading, so that the loading
    phase leaves v exp(-c δmax / (m ω)), and the drag acts at the contact point: m becomes m_t = m q/(1+q) there."""
    law = ContactParameters(friction_angle_deg=0.0, **NO_ROLLING, k_ul_N_m=1e4)
    w = with_effect(weightless(law), "ploughing_drag", [500.0])
    c = w.contact[0, 0, column("ploughing_Ns_m2")]
    omega_l = np.sqrt(1e4 / M)
    m_t = M * 0.4 / 1.4
    # elastic: the depth is a whole half sine, its integral 2 δmax / ω
    left = np.exp(-c / m_t * 2 * (2.0 / omega_l) / omega_l)
    for engine, (vx, _, spin) in rebound(w, vx=1.0).items():
        assert vx + R * spin == pytest.approx(left, rel=1e-3), engine
        # angular momentum about the contact
        assert vx == pytest.approx(1 - (1 - left) * 0.4 / 1.4, rel=1e-3), engine


@pytest.mark.parametrize("change", [-0.6, 1.0])
def test_friction_that_changes_with_speed(change):
    """Fast gross slip: friction at full change; slow and stuck: as without the effect."""
    law = ContactParameters(**NO_ROLLING)
    plain = weightless(law)
    w = with_effect(plain, "slip_dependent_friction", [change, 0.2])
    e = np.sqrt(1e4 / 6e4)
    for engine, (vx, _, spin) in rebound(w, vx=30.0).items():
        drop = (1 + change) * np.tan(np.deg2rad(30)) * (1 + e) * 2.0
        assert 30 - vx == pytest.approx(drop, rel=5e-3), engine
        assert spin == pytest.approx(-drop * R * M / SPHERE.inertia_kg_m2, rel=5e-3), engine
    same = rebound(plain, vx=1.0, omega=-1.0 / R)["pymunk"], rebound(w, vx=1.0, omega=-1.0 / R)["pymunk"]
    assert same[0] == pytest.approx(same[1], abs=1e-4)


WALL = CrossSection([[-2, 0], [0, 0], [0, 0.5], [0.2, 0.5], [0.2, 0], [2, 0]], ["floor", *["bank"] * 3, "out"])


@pytest.mark.parametrize("ratio", [0.1, 0.5])
def test_an_embankment_that_slides_rebounds_as_two_bodies_do(ratio):
    """Head-on against an upright wall of mass M: e_eff = (e M - m) / (M + m)."""
    w = with_effect(world(WALL, (SPHERE,), SMOOTH, gravity_m_s2=0.0), "embankment_yield", [ratio, 0.0])
    mass = M / ratio
    e = np.sqrt(SMOOTH.k_l_N_m / SMOOTH.k_ul_N_m)
    expected = (e * mass - M) / (mass + M)
    state = np.array([-R - 1e-4, 0.25, 0.0, 2.0, 0.0, 0.0])
    result = run(w, state[None], impact_limit=1, impact_room=1)
    assert result.impacts[0, 0, 12] == pytest.approx(-2 * expected, rel=1e-3, abs=1e-4)
    assert result.ends[0, 4] == pytest.approx(-2 * expected, rel=1e-3, abs=1e-4)
    impulse = M * (2 + 2 * expected)
    # what the embankment carries away
    assert taken_by_effects(result) == pytest.approx(0.5 * impulse**2 / mass, rel=1e-3)
    impact = first_impact(w, state)
    assert impact["vx_after_m_s"] == pytest.approx(-2 * expected, rel=1e-4)
    assert abs(impact["residual"]) < 1e-6 * 0.5 * M * 4


@pytest.mark.parametrize("ratio", [0.1, 0.5])
def test_an_embankment_that_slides_takes_the_block_with_it(ratio):
    """On a linear spring, two bodies part after T = π / √(k (1/m + 1/M)). Their centre of mass keeps its velocity, so
    the wall moves by S = v T m / (M + m), and the poses of the block after the impact are those beside the moved
    wall."""
    w = with_effect(world(WALL, (SPHERE,), elastic(), gravity_m_s2=0.0), "embankment_yield", [ratio, 0.0])
    mass, v, gap = M / ratio, 2.0, 1e-4
    contact_s = np.pi / np.sqrt(1e4 * (1 / M + 1 / mass))
    shift = v * contact_s * M / (mass + M)
    times_s = gap / v + contact_s + np.array([0.01, 0.02])
    state = np.array([-R - gap, 0.25, 0.0, v, 0.0, 0.0])
    result = run(w, state[None], times_s=times_s[None], time_limit_s=0.1)
    assert result.ground_shift_m[0] == pytest.approx(shift, rel=1e-3)
    expected = -R + shift + v * (M - mass) / (mass + M) * np.array([0.01, 0.02])
    assert result.samples[0, :, 0] == pytest.approx(expected, rel=1e-3, abs=1e-6)
    for engine in (run_batch_track, run_pymunk):
        track = engine(SPHERE, w.cross_section, w.contact[0], state, gravity_m_s2=0.0, time_limit_s=0.1)
        assert track.states(times_s)[:, 0] == pytest.approx(expected, rel=1e-3, abs=1e-6), engine


@pytest.mark.parametrize("ratio, stiffness", [(0.5, 0.5), (0.1, 0.5), (0.6, 10.0)])
def test_an_embankment_on_an_elastic_base_swings(ratio, stiffness):
    """Two masses, the soil's spring between them, a spring and a dashpot below: the motion is linear until they part,
    and given by a matrix exponential."""
    w = with_effect(world(WALL, (SPHERE,), elastic(), gravity_m_s2=0.0), "embankment_yield", [ratio, stiffness])
    mass, v, gap, soil, base = M / ratio, 2.0, 1e-9, 1e4, stiffness * 1e4
    dashpot = 2 * BASE_DAMPING_RATIO * np.sqrt(base * mass)
    rates = np.zeros((4, 4))  # of (block, embankment, their velocities)
    rates[0, 2] = rates[1, 3] = 1.0
    rates[2, :2] = np.array([-soil, soil]) / M
    rates[3] = np.array([soil, -soil - base, 0.0, -dashpot]) / mass

    def moved(t_s):
        return expm(rates * t_s) @ [0.0, 0.0, v, 0.0]

    def depth_m(t_s):
        return moved(t_s) @ [1.0, -1.0, 0.0, 0.0]

    times_s = np.linspace(1e-4, 0.02, 400)
    first = np.flatnonzero([depth_m(t_s) < 0.0 for t_s in times_s])[0]
    parted_s = brentq(depth_m, times_s[first - 1], times_s[first])
    _, shift, after, _ = moved(parted_s)
    state = np.array([[-R - gap, 0.25, 0.0, v, 0.0, 0.0]])
    result = run(w, state, impact_limit=1, impact_room=1)
    assert result.ends[0, 4] == pytest.approx(after, rel=1e-3)
    assert result.ground_shift_m[0] == pytest.approx(shift, rel=2e-3, abs=1e-6)
    fine = run(w, state, impact_limit=1, impact_room=1, step_fraction=0.02)
    assert taken_by_effects(fine) == pytest.approx(0.5 * M * (v**2 - after**2), rel=1e-3)


def test_two_corners_push_one_embankment():
    """A square that strikes an upright wall with a whole side moves as a ball on a spring of twice the stiffness."""
    after = []
    for block, reach_m, soil_N_m, base_stiffness in (
        (CUBE, CUBE.inradius_m, 1e4, 1.0),
        (SPHERE, R, 2e4 * M / CUBE.mass_kg, 0.5),
    ):
        w = world(WALL, (block,), elastic(k_l_N_m=soil_N_m, k_ul_N_m=soil_N_m), gravity_m_s2=0.0)
        w = with_effect(w, "embankment_yield", [0.5, base_stiffness])
        state = np.array([-reach_m - 1e-9, 0.25, 0.0, 2.0, 0.0, 0.0])
        after.append(run(w, state[None], impact_limit=1, impact_room=1).ends[0, 4])
    assert after[0] == pytest.approx(after[1], rel=1e-3)


def test_friction_at_its_base_holds_an_embankment_under_a_light_push():
    """Beyond M times what friction can hold, the rest of the force accelerates it; it does not move under a ball that
    rolls down its face."""
    slides = 2.0, 5.0, 0.0
    assert embankment_recoil(*slides, 2.4, 0.1, 0.3) == embankment_recoil(*slides, -2.4, 0.1, 0.3) == 0.0
    assert embankment_recoil(*slides, 4.0, 0.1, 0.3) == -embankment_recoil(*slides, -4.0, 0.1, 0.3) == pytest.approx(3)
    face = CrossSection([[-2, 0], [0, 0], [1.0, 0.5], [1.5, 0.5], [2.5, 0], [4, 0]], ["floor", *["bank"] * 3, "out"])
    w = with_effect(world(face, (SPHERE,), elastic()), "embankment_yield", [0.3, 0.0])
    up = np.array([-np.sin(np.arctan(0.5)), np.cos(np.arctan(0.5))])
    lying = np.array([0.5, 0.25]) + (R - M * 9.81 * up[1] / 1e4) * up
    states = np.array([[*lying, 0.0, 0.0, 0.0, 0.0], [*lying, 0.0, *(-2.0 * up), 0.0]])
    rolls, strikes = run(w, states, time_limit_s=0.2).ground_shift_m
    assert rolls == 0.0 and strikes > 1e-3


def test_only_the_embankment_recoils():
    w = with_effect(world(), "embankment_yield")
    zones = np.array(w.cross_section.zone_names)
    assert set(zones[w.contact[0, :, column("recoil_1_kg")] > 0]) == {"face", "crest", "back"}
    plain = world(FLOOR)
    assert not with_effect(plain, "embankment_yield").contact[..., column("recoil_1_kg")].any()


def test_a_wall_that_recoiled_does_not_move_when_the_ball_strikes_the_floor():
    """Also where effects act in the second impact: those of the air."""
    w = with_effect(with_effect(world(WALL, (SPHERE,)), "embankment_yield", [0.3, 1.0]), "air_drag", [0.5])
    state = np.array([[-R - 1e-4, 0.25, 0.0, 2.0, 0.0, 0.0]])
    once, twice = (run(w, state, impact_limit=n, impact_room=n) for n in (1, 2))
    assert twice.impacts[0, 1, I_ZONE] != once.impacts[0, 0, I_ZONE] and twice.ends[0, 4] != once.ends[0, 4]
    assert twice.ground_shift_m[0] == once.ground_shift_m[0] != 0.0


def test_out_of_plane_turns_the_horizontal_velocity():
    plain = weightless()
    w = with_effect(plain, "out_of_plane", [0.5])
    for engine, (vx, vy, spin) in rebound(w, vx=3.0, omega=7.0).items():
        expected = rebound(plain, vx=3.0, omega=7.0)[engine]
        assert vx == pytest.approx(3.0 * np.cos(0.5), rel=1e-9), engine
        assert (vy, spin) == pytest.approx((expected[1], 7.0), rel=1e-9), engine
    result = run(w, np.array([[0, R + 1e-4, 0, 3.0, -2.0, 7.0]]), impact_limit=1)
    assert taken_by_effects(result) == pytest.approx(0.5 * M * 9.0 * np.sin(0.5) ** 2, rel=1e-6)


def test_an_effect_of_one_zone_stays_there():
    """A ball that lands in the ditch does not feel what acts on the face only."""
    base = world()
    w = with_effect(base, "viscous_damping", [600.0, 0.0])
    contact = w.contact.copy()
    contact[:, w.cross_section.zone_names.index("ditch"), column("viscous_Ns_m")] = 0.0
    state = np.array([[0.05, 0.05, 0, 0.1, -1.5, 0]])
    fine = {"impact_limit": 1, "impact_room": 1, "step_fraction": 0.03}  # steps are chosen by the stiffest zone
    here, plain = run(replace(w, contact=contact), state, **fine), run(base, state, **fine)
    assert here.impacts[0, 0, VELOCITIES_AFTER] == pytest.approx(plain.impacts[0, 0, VELOCITIES_AFTER], rel=1e-4)
    assert taken_by_effects(here) == 0.0


def test_parameters_that_choose_a_column_are_named_once():
    columns = [c for e in CATALOGUE.values() for c in e.columns]
    assert len(columns) == len(set(columns))
