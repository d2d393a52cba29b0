"""Causes outside the catalogue of effects."""

import numpy as np

from rock2d.blind.reality import parameters
from rock2d.blind.reality.cause import Array, Cause, Rng, Scale, Values, View, random_sign


def side_wind(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    """The block is pushed sideways while it passes a band of heights."""
    floor = scale.low[1] + 1.5 * scale.size
    return {
        "push_m_s2": 0.8 * share * scale.gravity * random_sign(rng),
        "low_m": floor,
        "high_m": floor + 2.5 * scale.size,
    }


def mass_shedding(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    """At its first lift-off the block leaves a part of its mass behind, at rest."""
    return {"share": 0.3 * share}


def soft_strips(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    """Strips of the ground are much softer than the zone they lie in."""
    left = scale.low[0] + rng.uniform(0.0, 8.0) * scale.size
    return {
        "factor": float(np.exp(-2.0 * share)),
        "left_m": left,
        "width_m": 3.0 * scale.size,
        "period_m": 8.0 * scale.size,
    }


def shaking_ground(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    """All ground swings up and down like a shaking table."""
    rate = 2.0 * np.pi * rng.uniform(1.0, 3.0) * np.sqrt(scale.gravity / scale.size)
    return {
        "amplitude_m": 0.6 * share * scale.speed / rate,
        "rate_rad_s": rate,
        "phase_rad": rng.uniform(0.0, 2.0 * np.pi),
    }


def soft_side(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    """One side of the block is much softer than the others."""
    return {"log_ratio": 2.5 * share, "angle_rad": rng.uniform(-np.pi, np.pi)}


def late_angle(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    """The recorded orientation lags behind the recorded position."""
    return {"lag_s": 0.4 * share * np.sqrt(scale.size / scale.gravity)}


def late_angle_recorded(poses: Array, view: View, values: Values) -> Array:
    out = poses.copy()
    for i, release in enumerate(poses):
        out[i, :, 2] = np.interp(view.times_s - values["lag_s"], view.times_s, release[:, 2])
    return out


def sliding_camera(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    """The camera slides during each release, each time in another direction."""
    return {"speed_m_s": 0.5 * share * scale.speed}


def sliding_camera_recorded(poses: Array, view: View, values: Values) -> Array:
    direction = np.random.default_rng([view.seed, 13]).uniform(0.0, 2.0 * np.pi, len(poses))
    slide = values["speed_m_s"] * np.stack([np.cos(direction), np.sin(direction)], axis=-1)
    out = poses.copy()
    out[..., :2] -= slide[:, None, :] * (view.times_s - view.times_s[0])[:, None]
    return out


def ground_pull(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    """Close to its surface the ground attracts the block."""
    return {"pull_m_s2": 2.0 * share * scale.gravity, "range_m": 1.5 * scale.size}


def spin_kick(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    """At lift-off the block gains speed off the ground in proportion to its spin."""
    return {"kick": 0.3 * share}


def updraught(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    """Air rises in a band of the set-up and carries the block."""
    # narrow, because a wide band would act like another gravity
    left = scale.low[0] + rng.uniform(0.0, 4.0) * scale.size
    return {"lift_m_s2": 1.2 * share * scale.gravity, "left_m": left, "right_m": left + 3.0 * scale.size}


def place_restitution(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    """The unloading stiffness of the ground, and so its restitution, changes along the section in one slow wave."""
    return {
        "log_factor": 1.2 * share,
        "wave_number_rad_m": 2.0 * np.pi / (scale.high[0] - scale.low[0]),
        "phase_rad": rng.uniform(0.0, 2.0 * np.pi),
    }


def speed_dependent_friction(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    """Friction falls with the normal speed at which a contact begins."""
    # at share 1 as measured on squares of 2 cm: impulse ratio 0.15 at 0.7 m/s, 0.066 at 2.3 m/s
    return {"fall_s_m": share / (1.26 * scale.speed)}


# in the order in which a seed assigns them to cases: a new one comes last
CAUSES = {
    "side_wind": Cause(
        side_wind, columns={"push_m_s2": parameters.WIND, "low_m": parameters.WIND_LOW, "high_m": parameters.WIND_HIGH}
    ),
    "mass_shedding": Cause(mass_shedding, columns={"share": parameters.SHED_SHARE}),
    "soft_strips": Cause(
        soft_strips,
        columns={
            "factor": parameters.STRIP_FACTOR,
            "left_m": parameters.STRIP_LEFT,
            "width_m": parameters.STRIP_WIDTH,
            "period_m": parameters.STRIP_PERIOD,
        },
    ),
    "shaking_ground": Cause(
        shaking_ground,
        columns={
            "amplitude_m": parameters.SHAKE_AMPLITUDE,
            "rate_rad_s": parameters.SHAKE_RATE,
            "phase_rad": parameters.SHAKE_PHASE,
        },
    ),
    "soft_side": Cause(soft_side, columns={"log_ratio": parameters.SIDE_LOG_RATIO, "angle_rad": parameters.SIDE_ANGLE}),
    "late_angle": Cause(late_angle, recorded=late_angle_recorded),
    "sliding_camera": Cause(sliding_camera, recorded=sliding_camera_recorded),
    "ground_pull": Cause(
        ground_pull, columns={"pull_m_s2": parameters.ATTRACTION, "range_m": parameters.ATTRACTION_RANGE}
    ),
    "spin_kick": Cause(spin_kick, columns={"kick": parameters.SPIN_KICK}),
    "updraught": Cause(
        updraught,
        columns={
            "lift_m_s2": parameters.UPDRAUGHT,
            "left_m": parameters.UPDRAUGHT_LEFT,
            "right_m": parameters.UPDRAUGHT_RIGHT,
        },
    ),
    "place_restitution": Cause(
        place_restitution,
        columns={
            "log_factor": parameters.WAVE_LOG_FACTOR,
            "wave_number_rad_m": parameters.WAVE_NUMBER,
            "phase_rad": parameters.WAVE_PHASE,
        },
    ),
    "speed_dependent_friction": Cause(speed_dependent_friction, columns={"fall_s_m": parameters.FRICTION_FALL}),
}
