"""Flaws that no catalogue of effects names, with their sizes; `s` is the share of the largest plausible size."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from rock2d.blind.reality.scale import Scale
from rock2d.blind.reality.world_effects import sign

Rng = np.random.Generator
Sizes = Callable[[int, float, Rng, Scale], dict[str, float]]


def _side_wind(form: int, s: float, rng: Rng, at: Scale) -> dict[str, float]:
    floor = at.low[1] + 1.5 * at.size
    return {"push_m_s2": 0.8 * s * at.gravity * sign(rng), "low_m": floor, "high_m": floor + 2.5 * at.size}


def _mass_shedding(form: int, s: float, rng: Rng, at: Scale) -> dict[str, float]:
    return {"share": 0.3 * s}


def _soft_strips(form: int, s: float, rng: Rng, at: Scale) -> dict[str, float]:
    left = at.low[0] + rng.uniform(0.0, 8.0) * at.size
    return {
        "factor": float(np.exp(-2.0 * s)),
        "left_m": left,
        "width_m": 3.0 * at.size,
        "period_m": 8.0 * at.size,
    }


def _shaking_ground(form: int, s: float, rng: Rng, at: Scale) -> dict[str, float]:
    rate = 2.0 * np.pi * rng.uniform(1.0, 3.0) * np.sqrt(at.gravity / at.size)
    return {
        "amplitude_m": 0.6 * s * at.speed / rate,
        "rate_rad_s": rate,
        "phase_rad": rng.uniform(0.0, 2.0 * np.pi),
    }


def _soft_side(form: int, s: float, rng: Rng, at: Scale) -> dict[str, float]:
    return {"log_ratio": 2.5 * s, "angle_rad": rng.uniform(-np.pi, np.pi)}


def _late_angle(form: int, s: float, rng: Rng, at: Scale) -> dict[str, float]:
    return {"lag_s": 0.4 * s * np.sqrt(at.size / at.gravity)}


def _sliding_camera(form: int, s: float, rng: Rng, at: Scale) -> dict[str, float]:
    return {"speed_m_s": 0.5 * s * at.speed}


def _ground_pull(form: int, s: float, rng: Rng, at: Scale) -> dict[str, float]:
    return {"pull_m_s2": 2.0 * s * at.gravity, "range_m": 1.5 * at.size}


def _spin_kick(form: int, s: float, rng: Rng, at: Scale) -> dict[str, float]:
    return {"kick": 0.3 * s}


def _updraught(form: int, s: float, rng: Rng, at: Scale) -> dict[str, float]:
    # narrow, or the flights that it carries would show no more than another gravity
    left = at.low[0] + rng.uniform(0.0, 4.0) * at.size
    return {"lift_m_s2": 1.2 * s * at.gravity, "left_m": left, "right_m": left + 3.0 * at.size}


KINDS: dict[str, tuple[str, Sizes]] = {
    "side_wind": ("The block is pushed sideways while it passes a band of heights.", _side_wind),
    "mass_shedding": (
        "At its first lift-off the block leaves a part of its mass behind, at rest.",
        _mass_shedding,
    ),
    "soft_strips": ("Strips of the ground are much softer than the zone they lie in.", _soft_strips),
    "shaking_ground": ("All ground swings up and down like a shaking table.", _shaking_ground),
    "soft_side": ("One side of the block is much softer than the others.", _soft_side),
    "late_angle": ("The recorded orientation lags behind the recorded position.", _late_angle),
    "sliding_camera": (
        "The camera slides during each release, each time in another direction.",
        _sliding_camera,
    ),
    "ground_pull": ("Close to its surface the ground attracts the block.", _ground_pull),
    "spin_kick": ("At lift-off the block gains speed off the ground in proportion to its spin.", _spin_kick),
    "updraught": ("Air rises in a band of the set-up and carries the block.", _updraught),
}

# where each shows: in free flight, in impacts, or in both
PHASES = {
    "side_wind": "flight",
    "mass_shedding": "impact",
    "soft_strips": "impact",
    "shaking_ground": "impact",
    "soft_side": "impact",
    "late_angle": "impact",
    "sliding_camera": "all",
    "ground_pull": "flight",
    "spin_kick": "impact",
    "updraught": "flight",
}
