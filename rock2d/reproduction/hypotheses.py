"""Hypotheses on the paper's set-up: unknowns with their ranges, and the resulting cross-sections and incident states.

The paper gives the blocks, the height and crest width of the embankment and the drop height; all other quantities are
unknowns. A simulated release starts when the block leaves the slope for the last time. Its speeds along and across the
slope are fractions (0 to 1) of the speed of the drop, its rotation rate lies between zero and rolling, and its mean
energy is at most that of the drop."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from rock2d.arrays import Array
from rock2d.calibration.sequential_monte_carlo import Quantity, Space
from rock2d.records.columns import OMEGA, THETA, VX, VY, X, Y
from rock2d.reproduction import published
from rock2d.reproduction.published import BLOCKS, CREST_M, DROP_M, GRAVITY_M_S2, HEIGHT_M, LINES
from rock2d.scene.blocks import Block
from rock2d.scene.cross_section import CrossSection

Values = Mapping[str, Array]

ZONES = ("slope", "ditch", "uphill_face", "crest", "downhill_face", "run_out")
PLAUSIBLE_RANGE, PHYSICAL_BOUNDS = "the plausible range", "physical bounds"
DOWNHILL_FACE_DEG, SLOPE_LENGTH_M, RUN_OUT_LENGTH_M = 34.0, 1.3, 0.6  # results do not depend on them
# longest measure line; lines end before the slope, so that rebounds on the slope do not count as crossings
MEASURE_LINE_M = 0.6

SETUP_QUANTITIES = (
    Quantity("slope_deg", 30.0, 45.0, source=PLAUSIBLE_RANGE),
    Quantity("ditch_m", 0.05, 0.20, source=PLAUSIBLE_RANGE),
    Quantity("facing_deg", 35.0, 75.0, source=PLAUSIBLE_RANGE),
    Quantity("line_1_height", 0.28, 0.39, source="about 1/3 of the embankment's height"),
    Quantity("line_2_height", 0.61, 0.72, source="about 2/3 of the embankment's height"),
    Quantity("line_tilt_deg", 0.0, 90.0, source="from upright to level, over the ditch"),
    Quantity("drop_up_slope_m", 0.05, 0.80, source="where blocks leave the slope, from its toe"),
    Quantity("drop_spread_m", 1e-3, 1e-2, log=True, source="of that place, 1 sd"),
)
CONTACT_QUANTITIES = (
    Quantity("k_l_N_m", 2e3, 5e4, log=True, source="Table 4 times 1/5 to 5"),
    Quantity("restitution", 0.2, 0.8, source="√(k_l / k_ul); Table 4: 0.41"),
    Quantity("k_t_N_m", 5e2, 1.25e4, log=True, source="Table 4 times 1/5 to 5"),
    Quantity("friction_angle_deg", 10.0, 50.0, source="Table 4: 30"),
    Quantity("k_r_Nm_rad", 2.5e-3, 0.25, log=True, source="Table 4 times 1/10 to 10"),
)
REBOUND_QUANTITIES = tuple(
    Quantity(f"{zone}.{name}", low, high, log, source)
    for zone in ("ditch", "facing")
    for name, low, high, log, source in (
        ("momentum_half_kg_m_s", 4e-3, 0.4, True, "Table 3 times 1/10 to 10"),
        ("tangential_restitution", 0.3, 1.0, False, "Table 3: 0.85, 0.89"),
        ("friction_angle_deg", 0.0, 45.0, False, "Table 3: 0, 11"),
    )
)


def arrival_quantities(block: str) -> tuple[Quantity, ...]:
    """The unknowns of the state in which a block leaves the slope."""
    speeds = (
        # divided by the component of the drop speed
        Quantity(f"{block}.speed_across", 0.0, 1.0, source=PHYSICAL_BOUNDS),
        Quantity(f"{block}.speed_along", 0.0, 1.0, source=PHYSICAL_BOUNDS),
        Quantity(f"{block}.roll", 0.0, 1.0, source="spin from none to rolling"),
        Quantity(f"{block}.speed_spread", 0.01, 0.2, log=True, source="1 sd over the speed"),
        Quantity(f"{block}.spin_spread_rad_s", 2.0, 40.0, log=True, source="1 sd"),
    )
    if block == "sphere":
        return speeds
    return (
        *speeds,
        Quantity(f"{block}.orientation", 0.0, 1.0, source="of the profile's period"),
        Quantity(f"{block}.orientation_spread_deg", 1.0, 30.0, log=True, source="1 sd"),
    )


ARRIVAL_QUANTITIES = tuple(q for block in BLOCKS for q in arrival_quantities(block))
DETERMINISTIC_SPACE = Space((*SETUP_QUANTITIES, *CONTACT_QUANTITIES, *ARRIVAL_QUANTITIES))
PROBABILISTIC_SPACE = Space((*SETUP_QUANTITIES, *REBOUND_QUANTITIES, *ARRIVAL_QUANTITIES))


@dataclass(frozen=True)
class IncidentDistributions:
    """Normal distributions of the incident states of n hypotheses.

    Attributes
    ----------
    mean, sd : (n, 6) x, y, theta, vx, vy, omega in SI
    possible : (n,) whether the energy of the mean state is at most that of the drop"""

    mean: Array
    sd: Array
    possible: Array

    def states(self, draws: Array) -> Array:
        """(n, releases, 6) states from standard normal `draws` (releases, 6)."""
        return self.mean[:, None] + self.sd[:, None] * draws


def incident_distributions(values: Values, block: Block) -> IncidentDistributions:
    """The distribution of the incident states of a block for each hypothesis."""
    own = {key.split(".")[1]: v for key, v in values.items() if key.startswith(f"{block.name}.")}
    slope = np.radians(values["slope_deg"])
    c, s = np.cos(slope), np.sin(slope)
    speed = np.sqrt(2.0 * GRAVITY_M_S2 * DROP_M)
    along, across = own["speed_along"] * speed * s, own["speed_across"] * speed * c
    omega = -own["roll"] * along / (0.5 * block.size_m)
    spread = values["drop_spread_m"]
    offset = 1.02 * block.radius_m + 3.0 * spread * s  # distance from the slope: blocks must not start inside it
    mean, sd = np.zeros((len(slope), 6)), np.zeros((len(slope), 6))
    mean[:, X] = -values["drop_up_slope_m"] * c + offset * s
    mean[:, Y] = values["drop_up_slope_m"] * s + offset * c
    mean[:, VX], mean[:, VY] = along * c + across * s, across * c - along * s
    mean[:, OMEGA] = omega
    sd[:, X] = spread
    sd[:, VX] = sd[:, VY] = own["speed_spread"] * np.hypot(along, across)
    sd[:, OMEGA] = own["spin_spread_rad_s"]
    if "orientation" in own:
        period = 0.5 * np.pi if block.shape == "square" else np.pi
        mean[:, THETA], sd[:, THETA] = own["orientation"] * period, np.radians(own["orientation_spread_deg"])
    inertia = block.inertia_kg_m2 / block.mass_kg
    possible = along**2 + across**2 + inertia * omega**2 <= speed**2
    return IncidentDistributions(mean, sd, possible)


def hypothesis_cross_section(values: Values, i: int) -> CrossSection:
    """The cross-section of hypothesis `i`, with an embankment of the published height and crest width."""
    names = ("slope_deg", "facing_deg", "line_tilt_deg", "ditch_m", "line_1_height", "line_2_height")
    return _cross_section(*(float(values[name][i]) for name in names))


@lru_cache(maxsize=2**12)  # most moves of a sampler do not change the set-up
def _cross_section(
    slope_deg: float, facing_deg: float, tilt_deg: float, foot: float, line_1: float, line_2: float
) -> CrossSection:
    slope, facing, tilt = (float(np.radians(angle)) for angle in (slope_deg, facing_deg, tilt_deg))
    run = HEIGHT_M / np.tan(facing)
    crest = foot + run
    end = crest + CREST_M + HEIGHT_M / np.tan(np.radians(DOWNHILL_FACE_DEG))
    points = [
        [-SLOPE_LENGTH_M * np.cos(slope), SLOPE_LENGTH_M * np.sin(slope)], [0.0, 0.0], [foot, 0.0], [crest, HEIGHT_M],
        [crest + CREST_M, HEIGHT_M], [end, 0.0], [end + RUN_OUT_LENGTH_M, 0.0],
    ]  # fmt: skip
    lines = {}
    for line, share in zip(LINES, (line_1, line_2, 1.0), strict=True):
        x, y = foot + share * run, share * HEIGHT_M
        length = min(MEASURE_LINE_M, x / max(np.sin(tilt), 1e-9))
        lines[line] = [[x, y], [x - length * np.sin(tilt), y + length * np.cos(tilt)]]
    return CrossSection(points, ZONES, lines)


def table_4(values: Values) -> dict[str, Array]:
    """The hypotheses with their contact parameters replaced by those of Table 4."""
    ones, paper = np.ones(len(values["slope_deg"])), published.CONTACT_PARAMETERS
    own = {name: value * ones for name, value in paper.items() if name != "k_ul_N_m"}
    return {**values, **own, "restitution": np.sqrt(paper["k_l_N_m"] / paper["k_ul_N_m"]) * ones}


def table_3(values: Values, momentum_factor: float = 1.0) -> dict[str, Array]:
    """The hypotheses with their rebound parameters replaced by those of Table 3, without slope reductions; both
    thresholds of the momentum are multiplied by a factor."""
    ones = np.ones(len(values["slope_deg"]))
    own = {
        name: value * ones * (momentum_factor if "momentum" in name else 1.0)
        for name, value in published.REBOUND_PARAMETERS.items()
    }
    return {**values, **own}


def contact_table(values: Values) -> Array:
    """(n, zones, 7) parameters of the contact law; all zones have the same parameters, as in the paper."""
    columns = [
        values["k_l_N_m"], values["k_l_N_m"] / values["restitution"] ** 2, values["k_t_N_m"],
        np.tan(np.radians(values["friction_angle_deg"])), values["k_r_Nm_rad"],
    ]  # fmt: skip
    row = np.column_stack([*columns, np.zeros((len(columns[0]), 2))])
    return np.repeat(row[:, None], len(ZONES), axis=1)
