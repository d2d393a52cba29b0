"""Sizes of the known effects that change the motion; `s` is the share of the largest plausible size."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from rock2d.blind.reality.scale import Scale

Rng = np.random.Generator
IMPACT_SPEED = 4.0  # √(gravity × size): typical speed of an impact


def sign(rng: Rng) -> float:
    """-1 or 1."""
    return 1.0 if rng.random() < 0.5 else -1.0


def air_drag(form: int, s: float, rng: Rng, at: Scale) -> dict[str, float]:
    """Quadratic, or with the power 1.7."""
    power = (2.0, 1.7)[form]
    per_length = 0.012 / at.size
    return {"drag": s * per_length * (IMPACT_SPEED * at.speed) ** (2.0 - power), "power": power}


def flight_damping(form: int, s: float, rng: Rng, at: Scale) -> dict[str, float]:
    """The spin decays as fast as the velocity, or at 0.7 of its rate."""
    rate = 0.1 * s * np.sqrt(at.gravity / at.size)
    return {"rate_1_s": rate, "spin_rate_1_s": (1.0, 0.7)[form] * rate}


def magnus_lift(form: int, s: float, rng: Rng, at: Scale) -> dict[str, float]:
    """Linear in the spin, or saturating with the ratio of the rim's speed to the block's."""
    return {"lift": sign(rng) * (0.03, 0.04)[form] * s, "arm_m": (0.0, 0.5 * at.size)[form]}


def mass_eccentricity(form: int, s: float, rng: Rng, at: Scale) -> dict[str, float]:
    """The centre of mass lies off along the block's own x, or diagonally."""
    offset = 0.15 * s * at.size * sign(rng)
    return (
        {"x_m": offset, "y_m": 0.0} if form == 0 else {"x_m": 0.7 * offset, "y_m": 0.7 * sign(rng) * offset}
    )


def inertia_error(form: int, s: float, rng: Rng, at: Scale) -> dict[str, float]:
    """The same factor for all blocks, or another for each."""
    whole = sign(rng) * np.log(2.0) * s
    shares = np.ones(at.blocks) if form == 0 else rng.uniform(0.2, 1.0, at.blocks)
    return {f"factor_{i}": float(np.exp(whole * share)) for i, share in enumerate(shares)}


def rounded_edges(form: int, s: float, rng: Rng, at: Scale) -> dict[str, float]:
    """Corners are circular, or cut off; the share of half the width of the block that this takes."""
    return {"share": (0.9, 0.7)[form] * s}


def geometry_error(form: int, s: float, rng: Rng, at: Scale) -> dict[str, float]:
    """The facing is turned about its foot, or the ditch is raised."""
    return {"turn_rad": 0.2 * s * sign(rng)} if form == 0 else {"rise": 0.15 * s * sign(rng)}


def surface_roughness(form: int, s: float, rng: Rng, at: Scale) -> dict[str, float]:
    """The slope is drawn anew for each impact, or the ground has a rough profile."""
    if form == 0:
        return {"sd_rad": 0.2 * s}
    return {"sd_rad": 0.2 * s, "spacing_m": 1.5 * at.size, "profile": float(rng.integers(1 << 30))}


def zone_contrast(form: int, s: float, rng: Rng, at: Scale) -> dict[str, float]:
    """Loading stiffness of the facing, or stiffness and friction of the whole embankment."""
    stiffness = float(np.exp(sign(rng) * np.log(5.0) * s))
    if form == 0:
        return {"k_l": stiffness, "k_ul": 1.0, "mu": 1.0}
    return {"k_l": stiffness, "k_ul": stiffness, "mu": float(np.exp(sign(rng) * np.log(2.2) * s))}


def soil_compaction(form: int, s: float, rng: Rng, at: Scale) -> dict[str, float]:
    """Stiffness grows and saturates with the blows, or grows with the logarithm of their number."""
    return {"growth": 3.0 * s, "blows": 12.0} if form == 0 else {"growth": 1.0 * s, "blows": 0.0}


def embankment_yield(form: int, s: float, rng: Rng, at: Scale) -> dict[str, float]:
    """The embankment slides back as a body on a base with friction, or gives on spring and dashpot."""
    mass = at.mass / (0.6 * s)
    if form == 0:
        return {"mass_kg": mass, "spring_1_s2": 0.0, "dashpot_1_s": 0.0, "grip_m_s2": 0.5 * at.gravity}
    rate = 0.25 * at.spring
    return {"mass_kg": mass, "spring_1_s2": rate**2, "dashpot_1_s": 0.6 * rate, "grip_m_s2": 0.0}


def viscous_damping(form: int, s: float, rng: Rng, at: Scale) -> dict[str, float]:
    """A dashpot beside the spring, or one whose strength grows with the depth (Hunt and Crossley)."""
    dashpot = 0.9 * s * at.mass * at.spring
    depth = IMPACT_SPEED * at.speed / at.spring
    return {"dashpot": dashpot, "hunt": 0.0} if form == 0 else {"dashpot": 0.0, "hunt": 1.6 * dashpot / depth}


def adhesion(form: int, s: float, rng: Rng, at: Scale) -> dict[str, float]:
    """Tension on the way out of the indentation: constant, or fading with the rise."""
    pull = (12.0, 18.0)[form] * s * at.mass * at.gravity
    return {"pull_N": pull, "fades": float(form), "onset_m_s": 0.05 * at.speed}


def ploughing_drag(form: int, s: float, rng: Rng, at: Scale) -> dict[str, float]:
    """Resistance with depth × slip, or depth × slip²."""
    linear = 6.0 * s * at.spring * at.mass / at.size
    speed = IMPACT_SPEED * at.speed
    return {"linear": linear, "square": 0.0} if form == 0 else {"linear": 0.0, "square": 1.5 * linear / speed}


def slip_dependent_friction(form: int, s: float, rng: Rng, at: Scale) -> dict[str, float]:
    """From rest to high slip by an exponential, or a hyperbola."""
    change = 1.5 * s if rng.random() < 0.5 else -0.8 * s
    return {"change": change, "speed_m_s": 2.0 * at.speed, "hyperbolic": float(form)}


def out_of_plane(form: int, s: float, rng: Rng, at: Scale) -> dict[str, float]:
    """Share of the horizontal speed that each impact takes: drawn anew each time, or always the same."""
    return {"share": (0.3, 0.45)[form] * s, "random": float(form == 0)}


WORLD: dict[str, Callable[[int, float, Rng, Scale], dict[str, float]]] = {
    law.__name__: law
    for law in (
        air_drag, flight_damping, magnus_lift, mass_eccentricity, inertia_error, rounded_edges, geometry_error,
        surface_roughness, zone_contrast, soil_compaction, embankment_yield, viscous_damping, adhesion,
        ploughing_drag, slip_dependent_friction, out_of_plane,
    )
}  # fmt: skip
