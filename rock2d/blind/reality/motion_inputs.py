"""Everything that the compiled motion reads: ground, blocks, soil and dials, with what is hidden in them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rock2d.blind.reality import parameters
from rock2d.blind.reality.as_built import profile, reshaped, with_facing
from rock2d.blind.reality.data_model import Array, Block, Hidden, Setup, Soil, mean_size_m, soil_of
from rock2d.blind.reality.motion import CENTROID_X, CENTROID_Y, GROUP, INERTIA, MASS, REACH, ROUNDING, SIZE

# where the values of an effect go
DIALS: dict[str, dict[str, int]] = {
    "air_drag": {"drag": parameters.DRAG, "power": parameters.POWER},
    "flight_damping": {"rate_1_s": parameters.DAMP_V, "spin_rate_1_s": parameters.DAMP_W},
    "magnus_lift": {"lift": parameters.LIFT, "arm_m": parameters.LIFT_ARM},
    "viscous_damping": {"dashpot": parameters.VISCOUS, "hunt": parameters.HUNT},
    "adhesion": {
        "pull_N": parameters.TENSION,
        "fades": parameters.TENSION_FADES,
        "onset_m_s": parameters.TENSION_SPEED,
    },
    "ploughing_drag": {"linear": parameters.PLOUGH, "square": parameters.PLOUGH_SQUARE},
    "slip_dependent_friction": {
        "change": parameters.SLIP_CHANGE,
        "speed_m_s": parameters.SLIP_SPEED,
        "hyperbolic": parameters.SLIP_FORM,
    },
    "embankment_yield": {
        "mass_kg": parameters.RECOIL_MASS,
        "spring_1_s2": parameters.RECOIL_SPRING,
        "dashpot_1_s": parameters.RECOIL_DASHPOT,
        "grip_m_s2": parameters.RECOIL_GRIP,
    },
    "side_wind": {"push_m_s2": parameters.PUSH, "low_m": parameters.PUSH_LOW, "high_m": parameters.PUSH_HIGH},
    "mass_shedding": {"share": parameters.SHEDS},
    "soft_strips": {
        "factor": parameters.STRIP_FACTOR,
        "left_m": parameters.STRIP_LEFT,
        "width_m": parameters.STRIP_WIDTH,
        "period_m": parameters.STRIP_PERIOD,
    },
    "shaking_ground": {
        "amplitude_m": parameters.SHAKE,
        "rate_rad_s": parameters.SHAKE_RATE,
        "phase_rad": parameters.SHAKE_PHASE,
    },
    "soft_side": {"log_ratio": parameters.SIDE, "angle_rad": parameters.SIDE_ANGLE},
    "ground_pull": {"pull_m_s2": parameters.PULL, "range_m": parameters.PULL_RANGE},
    "spin_kick": {"kick": parameters.KICK},
    "updraught": {
        "lift_m_s2": parameters.DRAUGHT,
        "left_m": parameters.DRAUGHT_LEFT,
        "right_m": parameters.DRAUGHT_RIGHT,
    },
}


@dataclass
class Setting:
    """Arrays of the motion.

    points (m, 2), zone (m - 1,), yielding (m - 1,) : the ground; soil (zones, 5); indentation : of the rolling spring
    corners : per block (k, 2) from the centre of mass (a circle: its middle); bodies : per block a row of `motion`
    """

    points: Array
    zone: Array
    yielding: Array
    soil: Array
    indentation: bool
    corners: list[Array]
    bodies: list[Array]
    dial: Array


def setting_of(setup: Setup, law: Soil, blocks: Sequence[Block], hidden: Sequence[Hidden]) -> Setting:
    """The arrays of a set-up with what is hidden in it."""
    known = {effect.name: effect.values for effect in hidden}
    size = mean_size_m(blocks)
    if "geometry_error" in known:
        setup = with_facing(setup, known["geometry_error"], size)
    soil, zone = _soil(setup, law, known.get("zone_contrast"))
    points = np.array(setup.points_m, float)
    yielding = np.zeros(len(zone))
    if setup.embankment is not None:
        yielding[slice(*setup.embankment)] = 1.0
    if "surface_roughness" in known and "spacing_m" in known["surface_roughness"]:
        points, pieces = profile(points, known["surface_roughness"])
        zone, yielding = zone[pieces], yielding[pieces]
    bodies, corners = [], []
    for i, block in enumerate(blocks):
        shape, rounding, group = reshaped(block, known.get("rounded_edges"), _form(hidden, "rounded_edges"))
        off = known.get("mass_eccentricity", {"x_m": 0.0, "y_m": 0.0})
        offset = np.array([off["x_m"], off["y_m"]])
        shape = shape - offset
        body = np.zeros(8)
        body[MASS] = block.mass_kg
        body[INERTIA] = block.inertia_kg_m2 * known.get("inertia_error", {}).get(f"factor_{i}", 1.0)
        body[INERTIA] -= block.mass_kg * float(offset @ offset)  # the stated one is about the centroid
        body[REACH] = np.hypot(*shape.T).max() + rounding
        body[ROUNDING], body[GROUP], body[SIZE] = rounding, group, block.size_m
        body[CENTROID_X], body[CENTROID_Y] = -offset
        bodies.append(body)
        corners.append(np.ascontiguousarray(shape))
    indentation = soil_of(law, setup.zones[0]).indentation
    return Setting(points, zone, yielding, soil, indentation, corners, bodies, _dial(hidden, size))


def stiffening(hidden: Sequence[Hidden], order: Array) -> Array:
    """(n,) factor on the soil's stiffness after `order` releases of the same block."""
    factor = np.ones(len(order))
    for effect in hidden:
        if effect.name == "soil_compaction":
            growth, blows = effect.values["growth"], effect.values["blows"]
            factor = 1.0 + growth * (1.0 - np.exp(-order / blows) if blows > 0.0 else np.log1p(order))
    return factor


def _form(hidden: Sequence[Hidden], name: str) -> int:
    return next((effect.form for effect in hidden if effect.name == name), 0)


def _soil(setup: Setup, law: Soil, contrast: dict[str, float] | None) -> tuple[Array, Array]:
    """(facets, 5) rows of the law, one a facet, and the row of each facet."""
    rows = []
    for name in setup.zones:
        own = soil_of(law, name)
        rows.append([own.k_l, own.k_ul, own.k_t, own.mu, own.k_r])
    soil = np.array(rows, float)
    if contrast is not None:
        where = setup.face if contrast["k_ul"] == 1.0 else setup.embankment
        if where is not None:
            soil[slice(*where), :2] *= np.array([contrast["k_l"], contrast["k_ul"]])
            soil[slice(*where), 3] *= contrast["mu"]
    soil[:, 1] = np.maximum(soil[:, 0], soil[:, 1])
    return soil, np.arange(len(soil))


def _dial(hidden: Sequence[Hidden], size: float) -> Array:
    dial = np.zeros(parameters.N_DIALS)
    for effect in hidden:
        for name, column in DIALS.get(effect.name, {}).items():
            dial[column] = effect.values[name]
        if effect.name == "out_of_plane":
            dial[parameters.LEAVES] = 1.0
    rate = dial[parameters.VISCOUS] + 0.5 * size * (dial[parameters.HUNT] + dial[parameters.PLOUGH])
    if dial[parameters.TENSION] > 0.0:
        rate += dial[parameters.TENSION] / dial[parameters.TENSION_SPEED]
    dial[parameters.STIFFENING_RATE] = rate
    return dial
