"""Sizes of the known flaws of the record; `s` is the share of the largest plausible size."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from rock2d.blind.reality.scale import Scale
from rock2d.blind.reality.world_effects import sign

Rng = np.random.Generator


def camera_tilt(form: int, s: float, rng: Rng, at: Scale) -> dict[str, float]:
    """The image is turned about its middle, or about another point (in extents) with a little keystone."""
    turn = 0.12 * s * sign(rng)
    if form == 0:
        return {"turn_rad": turn, "off_x": 0.0, "off_y": 0.0, "keystone": 0.0}
    off_x, off_y = rng.uniform(-0.2, 0.2, 2)
    return {"turn_rad": turn, "off_x": off_x, "off_y": off_y, "keystone": 0.02 * s * sign(rng)}


def scale_error(form: int, s: float, rng: Rng, at: Scale) -> dict[str, float]:
    """Lengths are off alike in x and y, or with a twentieth of the error of opposite sign in them."""
    error = 0.14 * s * sign(rng)
    uneven = 0.05 * error if form == 1 else 0.0
    return {"x": 1.0 + error + uneven, "y": 1.0 + error - uneven}


def frame_rate_error(form: int, s: float, rng: Rng, at: Scale) -> dict[str, float]:
    """True over recorded time; in the second form frames also come early or late by shares of their distance."""
    factor = float(np.exp(0.14 * s * sign(rng)))
    return {"factor": factor, "jitter": 0.0 if form == 0 else 0.5 * s}


def lens_distortion(form: int, s: float, rng: Rng, at: Scale) -> dict[str, float]:
    """r (1 + k r²), or r / (1 - k r²); r over the extent of the image."""
    return {"k": 0.05 * s * sign(rng), "division": float(form)}


def angle_offset(form: int, s: float, rng: Rng, at: Scale) -> dict[str, float]:
    """Constant, or varying by a tenth from release to release."""
    offset = 0.4 * s * sign(rng)
    return {"offset_rad": offset, "jitter_rad": 0.1 * abs(offset) if form == 1 else 0.0}


def mirrored_axis(form: int, s: float, rng: Rng, at: Scale) -> dict[str, float]:
    """x is recorded with the wrong sign and nothing else, or the angle; it has no size."""
    return {"x": -1.0, "theta": 1.0} if form == 0 else {"x": 1.0, "theta": -1.0}


CAMERA: dict[str, Callable[[int, float, Rng, Scale], dict[str, float]]] = {
    flaw.__name__: flaw
    for flaw in (camera_tilt, scale_error, frame_rate_error, lens_distortion, angle_offset, mirrored_axis)
}
