"""The independent reality: independence, physics of its motion without causes, and visibility of every cause."""

import ast
import math
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rock2d.blind import reality
from rock2d.blind.reality import (
    FORMS,
    OUTSIDE,
    Block,
    Camera,
    Hidden,
    Law,
    Releases,
    Setup,
    World,
    draw_hidden,
    record_poses,
    simulate_poses,
)
from rock2d.blind.reality.cause import View
from rock2d.blind.reality.known.causes import keystone_distortion_recorded
from rock2d.blind.reality.motion_inputs import motion_inputs

G = 9.81
MAY_IMPORT = {"numpy", "numba", *sys.stdlib_module_names}
EMBANKMENT_ONLY = {"zone_contrast", "embankment_yield"}


def _rectangle(length: float, height: float) -> np.ndarray:
    return 0.5 * np.array([[-length, -height], [length, -height], [length, height], [-length, height]])


SPHERE = Block("sphere", 0.0125, None, 0.022, 0.4 * 0.022 * 0.0125**2)
CUBE = Block("cube", 0.019 / math.sqrt(2), _rectangle(0.019, 0.019), 0.0233, 0.0233 * 0.019**2 / 6)
SLAB = Block("slab", math.hypot(0.0175, 0.007), _rectangle(0.035, 0.014), 0.0231, 0.0231 * (0.035**2 + 0.014**2) / 12)
BLOCKS = [SPHERE, CUBE, SLAB]
LAW = Law(1.0e4, 6.0e4, 2.5e3, math.tan(math.radians(30)), 0.025)
FLOOR = Setup(np.array([[-1.0, 0.0], [1.0, 0.0]]), ("floor",))
_PROFILE = [[-0.695, 0.571], [0, 0], [0.148, 0], [0.184, 0.083], [0.239, 0.083], [0.3625, 0], [0.8625, 0]]
SETUP = Setup(
    np.array(_PROFILE),
    ("slope", "ditch", "uphill_face", "crest", "downhill_face", "run_out"),
    face=(2, 3), embankment=(2, 5), ditch=(1, 2),
)  # fmt: skip


def _simulate(
    setup: Setup, blocks: list[Block], states: np.ndarray, times: np.ndarray, hidden: list[Hidden] | None = None,
    *, law: Law = LAW, gravity: float = G, soil_sd: float = 0.0, seed: int = 1,
) -> np.ndarray:  # fmt: skip
    states = np.atleast_2d(states)
    n = np.arange(len(states))
    world, releases = World(setup, law, blocks, gravity), Releases(n % len(blocks), states, n // len(blocks))
    return simulate_poses(world, releases, times, soil_sd=np.full(5, soil_sd), hidden=hidden or [], seed=seed)


def _states(n: int, size: float = 0.02) -> np.ndarray:
    rng = np.random.default_rng(5)
    pace = math.sqrt(G * size)
    low = [0.5 * size, 4.0 * size, 0.0, 2.0 * pace, -4.5 * pace, -3.0 * pace / size]
    high = [6.5 * size, 5.0 * size, 2 * math.pi, 3.5 * pace, -3.5 * pace, 1.0 * pace / size]
    return rng.uniform(low, high, (n, 6))


def _rebound(law: Law, speed: float, omega: float) -> np.ndarray:
    """Velocity after the sphere hits the floor with 2 m/s down, `speed` along and `omega`, without gravity."""
    times = np.arange(300) * 1e-4
    poses = _simulate(FLOOR, [SPHERE], np.array([0, 0.02, 0, speed, -2, omega]), times, law=law, gravity=0.0)[0]
    return (poses[-1] - poses[-100]) / (99 * 1e-4)


def test_imports_nothing_of_the_toolkit() -> None:
    package = Path(reality.__file__).parent
    modules = sorted(package.rglob("*.py"))
    assert len(modules) > 5
    for path in modules:
        for node in ast.walk(ast.parse(path.read_text())):
            names = []
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom):
                assert node.level == 0, f"{path.name}: relative import"
                package_name = node.module or ""
                names = [package_name]
                if package_name in ("rock2d", "rock2d.blind"):
                    names = [f"{package_name}.{alias.name}" for alias in node.names]
            for name in names:
                own = f"{name}.".startswith("rock2d.blind.reality.")
                assert own or name.split(".")[0] in MAY_IMPORT, f"{path.name} imports {name}"


@pytest.mark.parametrize("k_ul", [1.5e4, 6e4, 2e5])
def test_head_on_restitution(k_ul: float) -> None:
    assert _rebound(replace(LAW, k_ul=k_ul), 0.0, 0.0)[1] / 2.0 == pytest.approx(math.sqrt(LAW.k_l / k_ul), rel=0.01)


@pytest.mark.parametrize(
    ("change", "speed", "omega", "along", "spin"),
    [
        ({"mu": 1e9, "k_r": 0.0}, 1.0, 0.0, 0.57770, -84.459),
        ({"k_r": 0.0}, 1.0, 0.0, 0.5879, -82.42),
        ({"k_r": 0.0}, 10.0, 0.0, 8.37389, -325.22),
        ({"k_r": 0.0}, 1.0, -80.0, 1.0, -80.0),
        ({"mu": 0.0}, 0.0, 100.0, 0.0, 90.371),
    ],
)
def test_oblique_impact_of_a_circle(
    change: dict[str, float], speed: float, omega: float, along: float, spin: float
) -> None:
    after = _rebound(replace(LAW, **change), speed, omega)
    assert after[0] == pytest.approx(along, rel=0.01, abs=1e-3)
    assert after[2] == pytest.approx(spin, rel=0.01)


@pytest.mark.parametrize("block", BLOCKS, ids=lambda b: b.name)
def test_flight_is_a_parabola(block: Block) -> None:
    times = np.arange(100) * 1e-3
    state = np.array([0.1, 0.4, 0.3, 1.0, 0.5, -20.0])
    poses = _simulate(SETUP, [block], state, times)[0]
    assert poses[:, 0] == pytest.approx(0.1 + times, abs=1e-12)
    assert poses[:, 1] == pytest.approx(0.4 + 0.5 * times - 0.5 * G * times**2, abs=1e-12)
    assert poses[:, 2] == pytest.approx(0.3 - 20.0 * times, abs=1e-12)


def _clear(pose: np.ndarray, block: Block, setup: Setup) -> bool:
    """Whether no part of the block can touch the ground, which is where springs would hold energy."""
    start, way = setup.points_m[:-1], np.diff(setup.points_m, axis=0)
    share = np.clip(((pose[:2] - start) * way).sum(axis=1) / (way**2).sum(axis=1), 0.0, 1.0)
    gap = np.hypot(*(start + share[:, None] * way - pose[:2]).T).min()
    return bool(gap > block.radius_m)


@pytest.mark.parametrize("setup", [SETUP, FLOOR], ids=["setup", "floor"])
@pytest.mark.parametrize("indentation", [False, True])
def test_energy_of_flights_never_rises(setup: Setup, indentation: bool) -> None:
    dt = 5e-4
    states = _states(30)
    poses = _simulate(setup, BLOCKS, states, np.arange(900) * dt, law=replace(LAW, indentation=indentation))
    for i, path in enumerate(poses):
        block = BLOCKS[i % 3]
        speed = (path[2:] - path[:-2]) / (2 * dt)
        free = np.array([_clear(pose, block, setup) for pose in path])
        free = free[2:] & free[1:-1] & free[:-2]
        energy = block.mass_kg * (0.5 * speed[:, 0] ** 2 + 0.5 * speed[:, 1] ** 2 + G * path[1:-1, 1])
        energy = (energy + 0.5 * block.inertia_kg_m2 * speed[:, 2] ** 2)[free]
        assert free.sum() > 20
        assert (np.diff(energy) < 1e-3 * energy[0]).all()


def test_same_seed_same_bits_whatever_the_other_releases() -> None:
    times = np.arange(300) * 1e-3
    states = _states(9)
    first, again = (_simulate(SETUP, BLOCKS, states, times, soil_sd=0.1) for _ in range(2))
    assert np.array_equal(first, again)
    assert np.array_equal(first[:3], _simulate(SETUP, BLOCKS, states[:3], times, soil_sd=0.1))
    assert not np.array_equal(first, _simulate(SETUP, BLOCKS, states, times, soil_sd=0.1, seed=2))


def test_effects_follow_their_closed_forms() -> None:
    times = np.arange(200) * 5e-4

    def after(name: str, form: int, values: dict[str, float], state: list[float], law: Law = LAW) -> np.ndarray:
        poses = _simulate(FLOOR, [SPHERE], np.array(state), times, [Hidden(name, form, values)], law=law, gravity=0.0)[
            0
        ]
        return (poses[-1] - poses[-3]) / 1e-3

    t = times[-2]
    drag = after("air_drag", 0, {"drag": 0.5, "power": 2.0}, [0, 0.5, 0, 3, 0, 0])
    assert drag[0] == pytest.approx(3 / (1 + 0.5 * 3 * t), rel=1e-3)
    damped = after("flight_damping", 1, {"rate_1_s": 2.0, "spin_rate_1_s": 1.4}, [0, 0.5, 0, 3, 0, 10])
    assert damped[[0, 2]] == pytest.approx([3 * math.exp(-2 * t), 10 * math.exp(-1.4 * t)], rel=1e-3)
    lifted = after("magnus_lift", 0, {"lift": 0.03, "arm_m": 0.0}, [0, 0.5, 0, 3, 0, 100])
    assert math.atan2(lifted[1], lifted[0]) == pytest.approx(3.0 * t, rel=1e-3)
    # the way out of the indentation costs pull × depth, except for half of its first tenth
    bottom = 2.0 / math.sqrt(LAW.k_l / SPHERE.mass_kg) * (1 - LAW.k_l / LAW.k_ul)
    wet = {"pull_N": 2.0, "fades": 0.0, "onset_m_s": 0.01}
    plain = replace(LAW, mu=0.0, k_r=0.0)
    pulled = after("adhesion", 0, wet, [0, 0.02, 0, 0, -2, 0], plain)
    work = 2.0 * bottom * 0.95 / SPHERE.mass_kg
    assert pulled[1] == pytest.approx(math.sqrt(4 * LAW.k_l / LAW.k_ul - 2 * work), rel=0.01)


def test_friction_falls_with_the_speed_at_which_a_contact_begins() -> None:
    """Impulse along over impulse across of a sliding sphere: mu / (1 + fall × normal speed)."""
    fall = Hidden("speed_dependent_friction", 0, {"fall_s_m": 1.8})
    times = np.arange(400) * 1e-4
    for speed, sliding in ((0.7, 20.0), (0.7, 5.0), (2.3, 20.0)):
        state = np.array([0.0, 0.0125 + 0.01 * speed, 0.0, sliding, -speed, 0.0])
        poses = _simulate(FLOOR, [SPHERE], state, times, [fall], law=replace(LAW, mu=0.3, k_r=0.0), gravity=0.0)[0]
        after = (poses[-1] - poses[-100]) / (99 * 1e-4)
        ratio = (sliding - after[0]) / (speed + after[1])
        assert ratio == pytest.approx(0.3 / (1.0 + 1.8 * speed), rel=0.01), (speed, sliding)


def test_restitution_follows_the_place() -> None:
    wave = Hidden("place_restitution", 0, {"log_factor": 1.0, "wave_number_rad_m": 10.0, "phase_rad": 0.3})
    times = np.arange(300) * 1e-4
    for x in (-0.1, 0.0, 0.1, 0.2):
        state = np.array([x, 0.02, 0.0, 0.0, -2.0, 0.0])
        poses = _simulate(FLOOR, [SPHERE], state, times, [wave], gravity=0.0)[0]
        restitution = (poses[-1, 1] - poses[-100, 1]) / (99 * 1e-4) / 2.0
        stiffening = np.exp(np.sin(10.0 * x + 0.3))
        assert restitution == pytest.approx(math.sqrt(LAW.k_l / LAW.k_ul / stiffening), rel=0.01), x


def test_hills_turn_a_rebound_by_their_slope() -> None:
    """The same in every release: a smooth sphere that hits a piece of ground head-on returns along its normal."""
    hills = Hidden("surface_roughness", 2, {"height_m": 0.004, "wavelength_m": 0.2, "profile": 7.0})
    ground = motion_inputs(World(FLOOR, LAW, [SPHERE], G), [hills]).ground.points
    assert np.std(ground[:, 1]) == pytest.approx(0.004, rel=0.2)
    times = np.arange(400) * 1e-4
    middle, way = 0.5 * (ground[1:] + ground[:-1]), np.diff(ground, axis=0)
    normals = np.column_stack([-way[:, 1], way[:, 0]]) / np.hypot(*way.T)[:, None]
    pieces = np.arange(20, 60, 4)
    assert np.ptp(np.arctan2(way[pieces, 1], way[pieces, 0])) > 0.2
    starts = middle[pieces] + (0.0125 + 0.01) * normals[pieces]
    states = np.column_stack([starts, 0.0 * pieces, -2.0 * normals[pieces], 0.0 * pieces])
    poses = _simulate(FLOOR, [SPHERE], states, times, [hills], law=replace(LAW, mu=0.0), gravity=0.0)
    after = (poses[:, -1, :2] - poses[:, -100, :2]) / (99 * 1e-4)
    assert after == pytest.approx(2.0 * math.sqrt(LAW.k_l / LAW.k_ul) * normals[pieces], abs=0.03)


def _filmed(setup: Setup, hidden: list[Hidden], n: int = 9) -> np.ndarray:
    times = np.arange(160) * 1e-3
    poses = _simulate(setup, BLOCKS, _states(n), times, hidden, soil_sd=0.05)
    camera = Camera(0.0, 0.0, 0.0, 0.0, centre_m=np.array([0.18, 0.05]), extent_m=0.36)
    return record_poses(poses, times, camera, hidden, 3)


CASES = [(name, form) for name, forms in FORMS.items() for form in range(forms)] + [(k, 0) for k in OUTSIDE]


@pytest.mark.parametrize("setup", [SETUP, FLOOR], ids=["setup", "floor"])
def test_every_cause_shows_and_vanishes_with_its_size(setup: Setup) -> None:
    clean = _filmed(setup, [])
    for name, form in CASES:
        gaps = []
        for strength in (1.0, 1e-7):
            hidden = draw_hidden(name, form, np.random.default_rng(4), World(setup, LAW, BLOCKS, G), strength)
            record = _filmed(setup, [hidden])
            assert np.isfinite(record).all(), (name, form, strength)
            gaps.append(float(np.median(np.abs(record - clean).max(axis=(1, 2)))))
        if name in EMBANKMENT_ONLY and setup is FLOOR:
            assert gaps == [0.0, 0.0], name
        else:
            assert gaps[0] > 1e-4, f"{name}, form {form}: the film does not show it"
        if name != "mirrored_axis":
            assert gaps[1] < 0.02, f"{name}, form {form}: does not vanish with its size, {gaps}"


def test_forms_of_an_effect_differ() -> None:
    for name, forms in FORMS.items():
        records = [
            _filmed(SETUP, [draw_hidden(name, form, np.random.default_rng(4), World(SETUP, LAW, BLOCKS, G), 1.0)], 6)
            for form in range(forms)
        ]
        assert forms >= 2
        assert not np.allclose(records[0], records[1], atol=1e-6), f"{name}: the forms give the same film"
    assert len(OUTSIDE) >= 8
    assert not set(OUTSIDE) & set(FORMS)


def test_a_camera_aslant_keeps_straight_lines_and_their_cross_ratios() -> None:
    """A projection keeps both; the small square by which the camera is calibrated stays as it is."""
    view = View(np.zeros(1), np.array([0.2, 0.1]), 0.4, 0)
    values = {"yaw_rad": 0.2, "pitch_rad": -0.1, "off_x": 0.1, "off_y": 0.2, "square_x_m": 0.3, "square_y_m": 0.0}
    place = np.array([0.0, 0.1, 0.25, 0.4])
    line = np.column_stack([place - 0.1, 0.3 - 0.5 * place, np.full(4, np.arctan(-0.5))])
    seen = keystone_distortion_recorded(line[None], view, values)[0]
    way = np.diff(seen[:, :2], axis=0)
    assert way[:, 0] * way[0, 1] == pytest.approx(way[:, 1] * way[0, 0], abs=1e-12)
    # a line seen along the body's own axis has the recorded angle of the body
    assert seen[:, 2] == pytest.approx(np.full(4, np.arctan2(way[0, 1], way[0, 0])), abs=1e-9)

    def cross_ratio(x: np.ndarray) -> float:
        return float((x[2] - x[0]) * (x[3] - x[1]) / ((x[2] - x[1]) * (x[3] - x[0])))

    assert cross_ratio(seen[:, 0]) == pytest.approx(cross_ratio(place), rel=1e-9)
    assert np.diff(seen[:, 0]) / np.diff(seen[:, 0])[0] != pytest.approx(np.diff(place) / 0.1, rel=0.01)
    square = np.array([0.3, 0.0])
    corners = np.column_stack([square + 1e-4 * np.array([[0, 0], [1, 0], [0, 1]]), np.zeros(3)])
    assert keystone_distortion_recorded(corners[None], view, values)[0, :, :2] == pytest.approx(
        corners[:, :2], abs=5e-6
    )


def test_noise_and_lost_frames() -> None:
    poses = np.zeros((20, 2000, 3))
    camera = Camera(3e-4, 0.02, noise_correlation=0.5, lost=0.1, centre_m=np.zeros(2), extent_m=1.0)
    record = record_poses(poses, np.arange(2000) * 1e-3, camera, [], 0)
    lost = np.isnan(record)
    assert (lost.any(axis=2) == lost.all(axis=2)).all()
    assert lost.mean() == pytest.approx(0.1, abs=0.01)
    assert np.nanstd(record, axis=(0, 1)) == pytest.approx([3e-4, 3e-4, 0.02], rel=0.03)
    pairs = record[:, 1:, 0] * record[:, :-1, 0]
    assert np.nanmean(pairs) / np.nanvar(record[..., 0]) == pytest.approx(0.5, abs=0.03)


def test_field_scale() -> None:
    """Boulders of 1 m and 2.5 t: the same reality 50 times as large, in time √50 as long."""
    grow = 50.0
    mass, k = 2500.0, 2500.0 / 0.0233 / grow
    blocks = [
        Block("ball", 0.0125 * grow, None, mass, 0.4 * mass * (0.0125 * grow) ** 2),
        Block("cube", 0.95 / math.sqrt(2), _rectangle(0.95, 0.95), mass, mass * 0.95**2 / 6),
    ]
    law = Law(1e4 * k, 6e4 * k, 2.5e3 * k, LAW.mu, 0.025 * k * grow**2)
    setup = replace(SETUP, points_m=SETUP.points_m * grow)
    times = np.arange(200) * 8e-3
    clean = _simulate(setup, blocks, _states(6, 1.0), times, law=law)
    assert clean[:, -1, 1].max() < 10.0
    for name, form in CASES:
        if name in OUTSIDE or form == 1:
            hidden = draw_hidden(name, form, np.random.default_rng(1), World(setup, law, blocks, G), 0.5)
            assert np.isfinite(_simulate(setup, blocks, _states(6, 1.0), times, [hidden], law=law)).all(), name
