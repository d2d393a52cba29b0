"""What may be true of the paper's set-up: the unknowns with their ranges, and the worlds and starts they make.

Known are the blocks, the embankment's height and crest, the drop; all else is an unknown of a hypothesis. A release
starts as it leaves the slope for the last time: with what the slope left of the drop's speed, 0 to 1 of it along and
across the slope, and a spin between none and rolling; on average with no more energy than the drop gave.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rock2d.calibration.sequential_monte_carlo import Quantity, Space
from rock2d.reproduction.published import BLOCKS, DROP_M, LINES
from rock2d.scene.blocks import Block
from rock2d.scene.cross_section import CrossSection

Array = np.ndarray
Values = Mapping[str, Array]

ZONES = ("slope", "ditch", "uphill_face", "crest", "downhill_face", "run_out")
RANGE, BOUNDS = "the plausible range", "physical bounds"
DOWNHILL_DEG, SLOPE_M, RUN_OUT_M = 34.0, 1.3, 0.6  # nothing depends on them
LINE_M = (
    0.6  # of a measure line, or less: none reaches over the slope, where blocks bounce before they arrive
)

SETUP = (
    Quantity("slope_deg", 30.0, 45.0, source=RANGE),
    Quantity("ditch_m", 0.05, 0.20, source=RANGE),
    Quantity("facing_deg", 55.0, 75.0, source=RANGE),
    Quantity("line_1_height", 0.28, 0.39, source="about 1/3 of the embankment's height"),
    Quantity("line_2_height", 0.61, 0.72, source="about 2/3 of the embankment's height"),
    Quantity("line_tilt_deg", 0.0, 45.0, source="from upright toward the facing's normal"),
    Quantity("drop_up_slope_m", 0.05, 0.80, source="where blocks leave the slope, from its toe"),
    Quantity("drop_spread_m", 1e-3, 1e-2, log=True, source="of that place, 1 sd"),
)
CONTACT = (
    Quantity("k_l_N_m", 2e3, 5e4, log=True, source="Table 4 times 1/5 to 5"),
    Quantity("restitution", 0.2, 0.8, source="√(k_l / k_ul); Table 4: 0.41"),
    Quantity("k_t_N_m", 5e2, 1.25e4, log=True, source="Table 4 times 1/5 to 5"),
    Quantity("friction_angle_deg", 10.0, 50.0, source="Table 4: 30"),
    Quantity("k_r_Nm_rad", 2.5e-3, 0.25, log=True, source="Table 4 times 1/10 to 10"),
)
REBOUND = tuple(
    Quantity(f"{zone}.{name}", low, high, log, source)
    for zone in ("ditch", "facing")
    for name, low, high, log, source in (
        ("momentum_half_kg_m_s", 4e-3, 0.4, True, "Table 3 times 1/10 to 10"),
        ("tangential_restitution", 0.3, 1.0, False, "Table 3: 0.85, 0.89"),
        ("friction_angle_deg", 0.0, 45.0, False, "Table 3: 0, 11"),
    )
)


def arrival(block: str) -> tuple[Quantity, ...]:
    """The unknowns of how a block leaves the slope."""
    speeds = (
        Quantity(f"{block}.speed_across", 0.0, 1.0, source=BOUNDS),  # over the drop's speed across the slope
        Quantity(f"{block}.speed_along", 0.0, 1.0, source=BOUNDS),
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


ARRIVALS = tuple(q for block in BLOCKS for q in arrival(block))
DETERMINISTIC_SPACE = Space((*SETUP, *CONTACT, *ARRIVALS))
PROBABILISTIC_SPACE = Space((*SETUP, *REBOUND, *ARRIVALS))


@dataclass(frozen=True)
class Starts:
    """Normal distributions of the states at the start: means and standard deviations (n, 6: x, y, theta, vx, vy, omega
    in SI), and whether the drop's energy allows the mean."""

    mean: Array
    sd: Array
    possible: Array

    def states(self, draws: Array) -> Array:
        """(n, releases, 6) states from standard normal `draws` (releases, 6)."""
        return self.mean[:, None] + self.sd[:, None] * draws


def starts(values: Values, block: Block, gravity_m_s2: float) -> Starts:
    """How releases of a block leave the slope."""
    own = {key.split(".")[1]: v for key, v in values.items() if key.startswith(f"{block.name}.")}
    slope = np.radians(values["slope_deg"])
    c, s = np.cos(slope), np.sin(slope)
    speed = np.sqrt(2.0 * gravity_m_s2 * DROP_M)
    along, across = own["speed_along"] * speed * s, own["speed_across"] * speed * c
    omega = -own["roll"] * along / (0.5 * block.size_m)
    spread = values["drop_spread_m"]
    clear = 1.02 * block.radius_m + 3.0 * spread * s  # so that hardly any starts in the slope
    mean, sd = np.zeros((len(slope), 6)), np.zeros((len(slope), 6))
    mean[:, 0] = -values["drop_up_slope_m"] * c + clear * s
    mean[:, 1] = values["drop_up_slope_m"] * s + clear * c
    mean[:, 3], mean[:, 4] = along * c + across * s, across * c - along * s
    mean[:, 5] = omega
    sd[:, 0] = spread
    sd[:, 3] = sd[:, 4] = own["speed_spread"] * np.hypot(along, across)
    sd[:, 5] = own["spin_spread_rad_s"]
    if "orientation" in own:
        period = 0.5 * np.pi if block.shape == "square" else np.pi
        mean[:, 2], sd[:, 2] = own["orientation"] * period, np.radians(own["orientation_spread_deg"])
    inertia = block.inertia_kg_m2 / block.mass_kg
    possible = along**2 + across**2 + inertia * omega**2 <= speed**2
    return Starts(mean, sd, possible)


def cross_section(values: Values, i: int, height_m: float, crest_m: float) -> CrossSection:
    """The cross-section of hypothesis `i` round an embankment of the known height and crest width."""
    slope, facing, tilt = (
        float(np.radians(values[k][i])) for k in ("slope_deg", "facing_deg", "line_tilt_deg")
    )
    foot = float(values["ditch_m"][i])
    run = height_m / np.tan(facing)
    crest = foot + run
    end = crest + crest_m + height_m / np.tan(np.radians(DOWNHILL_DEG))
    points = [
        [-SLOPE_M * np.cos(slope), SLOPE_M * np.sin(slope)], [0.0, 0.0], [foot, 0.0], [crest, height_m],
        [crest + crest_m, height_m], [end, 0.0], [end + RUN_OUT_M, 0.0],
    ]  # fmt: skip
    lines = {}
    for line, share in zip(LINES, (values["line_1_height"][i], values["line_2_height"][i], 1.0), strict=True):
        x, y = foot + share * run, share * height_m
        length = min(LINE_M, x / max(np.sin(tilt), 1e-9))
        lines[line] = [[x, y], [x - length * np.sin(tilt), y + length * np.cos(tilt)]]
    return CrossSection(points, ZONES, lines)


def contact_table(values: Values) -> Array:
    """(n, zones, 7) rows of the contact law, one soil for all zones as in the paper."""
    columns = [
        values["k_l_N_m"], values["k_l_N_m"] / values["restitution"] ** 2, values["k_t_N_m"],
        np.tan(np.radians(values["friction_angle_deg"])), values["k_r_Nm_rad"],
    ]  # fmt: skip
    row = np.column_stack([*columns, np.zeros((len(columns[0]), 2))])
    return np.repeat(row[:, None], len(ZONES), axis=1)
