"""What to do about the effects of the camera: how to correct the set-up file or the record, with sign and number.

Keys of files stand in backticks.
"""

from __future__ import annotations

import numpy as np

from rock2d.diagnosis.report import text
from rock2d.diagnosis.report.fitted import Fitted, plain, point
from rock2d.effects.mirrored_axis import MIRROR_THETA, MIRROR_X, MIRROR_Y
from rock2d.scene.world import World

Array = np.ndarray

AGAIN = "Track the film again and diagnose again."
AXES = {MIRROR_X: ("x_m", "vx_m_s"), MIRROR_Y: ("y_m", "vy_m_s"), MIRROR_THETA: ("theta_rad", "omega_rad_s")}


def _origin(fitted: Fitted) -> str:
    """Where the point of the default origin truly is; the camera's axis is part of what was fitted."""

    def place(world: World) -> Array:
        return np.asarray(world.view.true(np.zeros(3))[:2])

    at, half = fitted.propagated(place)
    x, y = fitted.world().view.axis_m
    return (
        f"Set `origin_m: {point(at, half)}` if it was [0, 0]: the record changes about the camera's axis, which "
        f"meets the plane at ({plain(x)}, {plain(y)}) m, and so does any other `origin_m`."
    )


def _by_hand(fitted: Fitted, film: str, table: str) -> str:
    """How to correct the record where there is no film to track again: a film, or a table of impacts."""
    return f"\nWithout a set-up file: {table if fitted.experiment.impacts is not None else film}."


def camera_tilt(fitted: Fitted) -> str:
    """θ recorded = θ + tilt; the tracker turns the picture back by `tilt_deg`."""
    value, half = fitted.values["tilt_rad"], fitted.half["tilt_rad"]
    turn, width = np.rad2deg([value, half])
    way = "counter-clockwise" if value > 0 else "clockwise"
    x, y = fitted.world().view.axis_m
    turned = (
        f"turn every position by {plain(-turn, width)}° about ({plain(x)}, {plain(y)}) m, counter-clockwise "
        f"positive, and add {plain(-value, half)} to every `theta_rad`"
    )
    return (
        f"The picture is turned by {text.number(abs(turn), width)}° {way} against the vertical. Set `tilt_deg: "
        f"{plain(turn, width)}` in the set-up file (add it, if `tilt_deg` is not 0 there). {_origin(fitted)} "
        f"{AGAIN}{_by_hand(fitted, turned, f'{turned}; turn the velocities, too')} Level the camera before the next "
        "film."
    )


def scale_error(fitted: Fitted) -> str:
    """length recorded = scale × true length."""
    value, half = fitted.values["scale"], fitted.half["scale"]
    factor, width = 1.0 / value, half / value**2
    way = "long" if value > 1 else "short"
    x, y = fitted.world().view.axis_m
    scaled = (
        f"multiply the distance of every position from ({plain(x)}, {plain(y)}) m by {plain(factor, width)}"
    )
    return (
        f"The calibration length is stated {text.number(100 * abs(value - 1), 100 * half)} % too {way}: what is "
        f"stated as 1 m is {text.number(factor, width)} m. Multiply `metres_per_pixel`, `distance_m` or `square_m` "
        f"in the set-up file, whichever is given there, by {plain(factor, width)}. {_origin(fitted)} "
        f"{AGAIN}{_by_hand(fitted, scaled, f'{scaled}, and the velocities by the same factor')} Measure the "
        "calibration length again, in the plane of motion: one nearer to the camera gives too short lengths."
    )


def frame_rate_error(fitted: Fitted) -> str:
    """true duration = time_scale × recorded duration; the true rate is the stated one over time_scale."""
    value, half = fitted.values["time_scale"], fitted.half["time_scale"]
    stated = fitted.experiment.fps
    true, width = stated / value, stated * half / value**2
    film = (
        f"multiply every `t_s` by {plain(value, half)} and set `fps: {plain(true, width)}` in experiment.yaml"
    )
    table = f"divide all velocities and spins by {plain(value, half)}"
    return (
        f"The film was taken with {text.number(true, width)} frames/s, not with {stated:g}. Set `fps: "
        f"{plain(true, width)}` in the set-up file. {AGAIN}{_by_hand(fitted, film, table)} Film a clock to check."
    )


def lens_distortion(fitted: Fitted) -> str:
    """d recorded = d (1 + edge |d|² / W²); the set-up file's k refers to half the picture's diagonal instead of W."""
    value, half = fitted.values["edge"], fitted.half["edge"]
    view = fitted.world().view
    per_m2 = view.lens_per_m2
    width = abs(per_m2 / value) * half if value else 0.0
    way = "outward" if value > 0 else "inward"
    x, y = view.axis_m
    return (
        f"The lens moves points {way}. Set `distortion: {{k: K}}` in the set-up file with K = "
        f"{plain(per_m2, width or None)} × D², where D is half the picture's diagonal in m; `centre_px` is the pixel "
        f"that shows ({plain(x)}, {plain(y)}) m. {AGAIN} Better: film a checkerboard at the edge of the picture and "
        "measure k."
    )


def angle_offset(fitted: Fitted) -> str:
    """θ recorded = θ true + offset."""
    value, half = fitted.values["offset_rad"], fitted.half["offset_rad"]
    degrees, width = np.rad2deg([value, half])
    way = "counter-clockwise" if value > 0 else "clockwise"
    return (
        f"Add {plain(-value, half)} to every `theta_rad` ({text.number(-degrees, width)}°) and diagnose again. The "
        f"tracked angle lies {text.number(abs(degrees), width)}° {way} of the block's own x axis. If it comes from "
        "two marks, choose marks on a line along that axis."
    )


def mirrored_axis(fitted: Fitted) -> str:
    """x, y or θ recorded with the other sign."""
    if round(fitted.values["axis"]) not in AXES:
        return "No axis is mirrored: correct nothing."
    place, speed = AXES[round(fitted.values["axis"])]
    column = (
        f"`{place}` and of every `{speed}` and `{speed.replace('_', '_after_', 1)}`"
        if fitted.experiment.impacts is not None
        else f"`{place}`"
    )
    return (
        f"Change the sign of every {column} and diagnose again. Then look for the cause: y grows upward, x to the "
        "right, angles counter-clockwise. In the set-up file, `up` turns y and the angle together; in `rock2d "
        "import`, so does `--y`."
    )


CAMERA_INSTRUCTIONS = {
    rule.__name__: rule
    for rule in (
        camera_tilt, scale_error, frame_rate_error, lens_distortion, angle_offset, mirrored_axis,
    )
}  # fmt: skip
