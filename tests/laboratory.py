"""The set-up of the laboratory that tests of engines, effects and films share: blocks, laws, grounds, releases."""

from collections.abc import Sequence

import numpy as np

from rock2d.engines.batch import Ensemble
from rock2d.laws.contact import ContactParameters, contact_table
from rock2d.records.columns import I_AFTER, OMEGA, VX
from rock2d.records.track import Track
from rock2d.scene.blocks import Block, make_block
from rock2d.scene.cross_section import CrossSection

SPHERE = make_block("sphere", "circle", 0.022, "solid_sphere", diameter_m=0.025)
CUBE = make_block("cube", "square", 0.0233, side_m=0.019)
SLAB = make_block("parallelepiped", "rectangle", 0.0231, length_m=0.035, height_m=0.014)
EGG = make_block("egg", "ellipse", 0.0231, length_m=0.035, height_m=0.02)
STONE = make_block(
    "stone", "polygon", 0.0231, vertices_m=[[0, 0], [0.02, 0], [0.03, 0.01], [0.01, 0.025], [-0.005, 0.015]]
)
BLOCKS = {b.name: b for b in (SPHERE, CUBE, SLAB, EGG, STONE)}
LAW = ContactParameters()
FLOOR = CrossSection([[-5, 0], [5, 0]], ["floor"])
SETUP = CrossSection(
    [[-0.7, 0.547], [0, 0], [0.13, 0], [0.1819, 0.083], [0.2369, 0.083], [0.3599, 0], [0.86, 0]],
    ["slope", "ditch", "face", "crest", "back", "out"],
)
TO_CREST = CrossSection(SETUP.points_m, SETUP.zones, {"crest": [[0.1819, 0.083], [0.1819, 0.3]]})
CONTRAST = {
    "slope": ContactParameters(1e4, 1e5, 2.5e3, 35, 0.02),
    "ditch": ContactParameters(3e3, 9e3, 3e3, 20, 0.0),
    "face": ContactParameters(3e4, 9e4, 2e3, 40, 0.1),
    "default": ContactParameters(8e3, 2.4e4, 0.0, 30, 0.05, rolling_cap=True),
}
G = 9.81
AFTER = ["vx_after_m_s", "vy_after_m_s", "omega_after_rad_s"]
VELOCITIES_AFTER = slice(I_AFTER + VX, I_AFTER + OMEGA + 1)  # in a row of an impact


def rough(seed: int) -> CrossSection:
    """A rough slope with convex and concave corners, zones dealt at random."""
    rng = np.random.default_rng(seed)
    x = np.cumsum(rng.uniform(0.005, 0.04, 40))
    y = -0.6 * x + rng.normal(0, 0.003, 40)
    return CrossSection(np.column_stack([x - 0.1, y]), rng.choice(["slope", "ditch", "face", "other"], 39).tolist())


def random_state(seed: int) -> np.ndarray:
    """A release onto the set-up, near those of the paper."""
    rng = np.random.default_rng(seed)
    return np.array(
        [
            rng.normal(0.01, 0.02), rng.normal(0.1, 0.01), rng.uniform(0, 2 * np.pi),
            rng.normal(1.3, 0.2), rng.normal(-2.0, 0.2), rng.normal(-30, 20),
        ]
    )  # fmt: skip


def flight(
    release: int, block: str, state: Sequence[float], seconds: float, stop: str = "exit", aloft: bool = False
) -> Track:  # fmt: skip
    """A flight from this state (6,); `aloft`: it has not touched the ground at its end."""
    x, y, theta, vx, vy, omega = state
    t = seconds
    end = [t, x + vx * t, y + vy * t - 0.5 * G * t * t, theta + omega * t, vx, vy - G * t, omega]
    return Track(release, block, np.array([[0.0, *state], end]), np.array([True, aloft]), [], stop, G)


def ensemble(block: Block, ground: CrossSection = SETUP, *laws) -> Ensemble:
    """One block on one ground, for the batch engine, with `LAW` unless laws are given."""
    return Ensemble([block], [ground], [contact_table(law, ground.zone_names) for law in laws or (LAW,)])


def after(impact: dict) -> np.ndarray:
    """Velocities (3,) after an impact of the pymunk engine."""
    return np.array([impact[name] for name in AFTER])
