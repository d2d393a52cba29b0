"""Effects of the camera: tilt, scale, clock, lens, slant, zero of the angle, sign of an axis. The motion stays."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rock2d.effects.changes import AIM_PARAMETERS, KEPT_PARAMETERS, aim_and_width, moved_point, with_view
from rock2d.effects.effect import Effect, Parameter
from rock2d.effects.fitted_effect import TRACK_AGAIN, FittedEffect
from rock2d.records.columns import after
from rock2d.scene.world import World
from rock2d.wording import number, plain


def with_camera_tilt(world: World, values: Sequence[float]) -> World:
    """(x, y) recorded = c + R(tilt) ((x, y) - c), θ recorded = θ + tilt: R turns counter-clockwise, c is the point
    that stays in its place."""
    kept = moved_point(world, world.view.kept_m, values[1:])
    return with_view(world, kept_m=kept, tilt_rad=world.view.tilt_rad + values[0])


def camera_tilt_remedy(fitted: FittedEffect) -> str:
    """Set `tilt_deg`, by which the tracker turns the picture back, or correct the record."""
    value, half = fitted.values["tilt_rad"], fitted.half["tilt_rad"]
    turn, width = np.rad2deg([value, half])
    way = "counter-clockwise" if value > 0 else "clockwise"
    x, y = fitted.world().view.fixed_m
    turned = (
        f"turn every position by {plain(-turn, width)}° about ({plain(x)}, {plain(y)}) m, counter-clockwise "
        f"positive, and add {plain(-value, half)} to every `theta_rad`"
    )
    return (
        f"The picture is turned by {number(abs(turn), width)}° {way} against the vertical. Set `tilt_deg: "
        f"{plain(turn, width)}` in the set-up file (add it, if `tilt_deg` is not 0 there; where `up` is down, with the "
        f"other sign). {fitted.origin()} "
        f"{TRACK_AGAIN}{fitted.by_hand(turned, f'{turned}; turn the velocities, too')} Level the camera before the "
        "next film."
    )


CAMERA_TILT = Effect(
    name="camera_tilt",
    summary="the image axes are turned against the vertical: gravity seems to have a part along the image's x",
    source="rigid rotation of the image, `rock2d.scene.world.View`",
    phase="all",
    origin="camera",
    parameters=(
        Parameter("tilt_rad", "rad", 0.0, -0.15, 0.15, "rotation of the record, counter-clockwise"),
        *KEPT_PARAMETERS,
    ),
    apply=with_camera_tilt,
    remedy=camera_tilt_remedy,
)


# half widths of its interval (about four standard errors) from which on different scales along x and y are corrected
CLEAR_ASPECT = 2.0


def with_scale_error(world: World, values: Sequence[float]) -> World:
    """(x, y) recorded = c + scale (aspect (x - c_x), y - c_y), c the point that stays in its place."""
    scale, aspect, *shift = values
    kept = moved_point(world, world.view.kept_m, shift)
    return with_view(world, kept_m=kept, scale=world.view.scale * scale, aspect=world.view.aspect * aspect)


def scale_error_remedy(fitted: FittedEffect) -> str:
    """Correct the calibration length, or the record; only the record if the scales along x and y differ."""
    uneven = abs(fitted.values["aspect"] - 1.0) > CLEAR_ASPECT * fitted.half.get("aspect", np.inf)
    if not uneven:
        fitted = replace(fitted, values={**fitted.values, "aspect": 1.0}, half={**fitted.half, "aspect": 0.0})
    x, y = (plain(place) for place in fitted.world().view.fixed_m)
    (of_x, of_y), (width_x, width_y) = fitted.propagated(lambda world: 1.0 / world.view.scales)
    again = (
        "Measure the calibration length again, in the plane of motion: one nearer to the camera gives too short "
        "lengths."
    )
    if uneven:
        scaled = (
            f"Multiply the distance of every position from ({x}, {y}) m by {plain(of_x, width_x)} along x and by "
            f"{plain(of_y, width_y)} along y"
        )
        return (
            f"The scales along x and y differ by {_deviation(fitted, 'aspect')}: the camera does not look at the plane "
            "of motion at a right angle. No key of the set-up file corrects this. "
            f"{scaled}, and the velocities by the same factors. Turn the camera before the next film. {again}"
        )
    way = "long" if fitted.values["scale"] > 1 else "short"
    scaled = f"multiply the distance of every position from ({x}, {y}) m by {plain(of_y, width_y)}"
    return (
        f"The calibration length is stated {_deviation(fitted, 'scale')} too {way}: what is stated as 1 m is "
        f"{number(of_y, width_y)} m. Multiply `metres_per_pixel`, `distance_m` or `square_m` in the set-up file, "
        f"whichever is given there, by {plain(of_y, width_y)}. {fitted.origin()} "
        f"{TRACK_AGAIN}{fitted.by_hand(scaled, f'{scaled}, and the velocities by the same factor')} {again}"
    )


def _deviation(fitted: FittedEffect, name: str) -> str:
    """The deviation of a factor from 1."""
    return f"{number(100 * abs(fitted.values[name] - 1), 100 * fitted.half[name])} %"


# A camera that looks more than 14° aslant (cos 14° = 0.97) shows nearer parts clearly larger, which no aspect does.
SCALE_ERROR = Effect(
    name="scale_error",
    summary="metres per pixel are wrong: all lengths, speeds and accelerations are too large or too small",
    source="similarity of the image, with a foreshortened x, `rock2d.scene.world.View`",
    phase="all",
    origin="camera",
    parameters=(
        Parameter("scale", "1", 1.0, 0.85, 1.15, "recorded length along y over true length"),
        Parameter("aspect", "1", 1.0, 0.97, 1.03, "scale along x over the scale along y", optional=True),
        *KEPT_PARAMETERS,
    ),
    apply=with_scale_error,
    remedy=scale_error_remedy,
)


def with_frame_rate_error(world: World, values: Sequence[float]) -> World:
    """t recorded = t true / time_scale."""
    return with_view(world, time_scale=world.view.time_scale * values[0])


def frame_rate_error_remedy(fitted: FittedEffect) -> str:
    """Set the true frame rate, the stated one over time_scale, or correct the record."""
    value, half = fitted.values["time_scale"], fitted.half["time_scale"]
    stated = fitted.fps
    true, width = stated / value, stated * half / value**2
    film = f"multiply every `t_s` by {plain(value, half)} and set `fps: {plain(true, width)}` in experiment.yaml"
    table = f"divide all velocities and spins by {plain(value, half)}"
    lost = (
        f", or {number(100 * (1 - 1 / value), 100 * half / value**2)} % of its frames are missing" if value > 1 else ""
    )
    return (
        f"The film was taken with {number(true, width)} frames/s, not with {stated:g}{lost}. Set `fps: "
        f"{plain(true, width)}` in the set-up file. {TRACK_AGAIN}{fitted.by_hand(film, table)} Film a clock to check."
    )


FRAME_RATE_ERROR = Effect(
    name="frame_rate_error",
    summary="the true frame rate differs from the stated one: gravity goes with its square, contact times with it",
    source="the camera's clock, `rock2d.scene.world.View`",
    phase="all",
    origin="camera",
    parameters=(
        Parameter("time_scale", "1", 1.0, 0.85, 1.15, "true duration over recorded one: stated over true rate"),
    ),
    apply=with_frame_rate_error,
    remedy=frame_rate_error_remedy,
)


def with_lens_distortion(world: World, values: Sequence[float]) -> World:
    """d recorded = d (1 + k |d|²) with d = (x, y) - c, k = edge / W²: c is the point that the camera aims at, W the
    width of embankment and ditch."""
    lens_per_m2 = world.view.lens_per_m2 + values[0] / aim_and_width(world.cross_section)[1] ** 2
    return with_view(world, aim_m=moved_point(world, world.view.aim_m, values[1:]), lens_per_m2=lens_per_m2)


def lens_distortion_remedy(fitted: FittedEffect) -> str:
    """Set `distortion` in the set-up file, where k refers to half the picture's diagonal instead of W."""
    value, half = fitted.values["edge"], fitted.half["edge"]
    view = fitted.world().view
    per_m2 = view.lens_per_m2
    width = abs(per_m2 / value) * half if value else 0.0
    way = "outward" if value > 0 else "inward"
    x, y = view.axis_m
    return (
        f"The lens moves points {way}. Set `distortion: {{k: K}}` in the set-up file with K = "
        f"{plain(per_m2, width or None)} × D², where D is half the picture's diagonal in m; `centre_px` is the pixel "
        f"that shows ({plain(x)}, {plain(y)}) m. {TRACK_AGAIN} Better: film a checkerboard at the edge of the picture "
        "and measure k."
    )


LENS_DISTORTION = Effect(
    name="lens_distortion",
    summary="radial distortion of the image: points away from its middle are recorded too far out or in",
    source="first term of D. C. Brown (1971), Close-range camera calibration: r (1 + k r²), `rock2d.scene.world.View`",
    phase="all",
    origin="camera",
    parameters=(
        Parameter(
            "edge",
            "1",
            0.0,
            -0.05,
            0.05,
            "k W²: displacement over distance at the width W of embankment and ditch from the image's middle",
        ),
        *AIM_PARAMETERS,
    ),
    apply=with_lens_distortion,
    remedy=lens_distortion_remedy,
)


def with_keystone_distortion(world: World, values: Sequence[float]) -> World:
    """u recorded = scale · u / (1 + keystone · u / W), u = (x, y) - c, where c is the point that the camera aims at and
    W the width of embankment and ditch. Areas in the middle of the set-up stay: a keystone is no error of the scale."""
    middle, width = aim_and_width(world.cross_section)
    x, y = np.array(values[:2]) / width + world.view.keystone_per_m
    aim = moved_point(world, world.view.aim_m, values[2:])
    return with_view(world, aim_m=aim, keystone_per_m=(float(x), float(y)), middle_m=middle)


def keystone_distortion_remedy(fitted: FittedEffect) -> str:
    """Divide the distances of the record from the camera's axis by a linear function of the place."""
    ways = [("right", "to the right", "to the left"), ("up", "upwards", "downwards")]
    shrinks = " and ".join(
        f"{number(100 * abs(fitted.values[name]), 100 * fitted.half[name])} % "
        + (ahead if fitted.values[name] > 0 else back)
        for name, ahead, back in [way for way in ways if abs(fitted.values[way[0]]) > fitted.half[way[0]]] or ways
    )
    view, width = fitted.world().view, aim_and_width(fitted.setup.cross_section)[1]
    (x, y), (a, b) = view.axis_m, view.keystone_per_m
    return (
        f"Over {width:.2g} m, lengths in the picture shrink by {shrinks}: the camera does not look at the plane of "
        "motion at a right angle. No key of the set-up file corrects this. In the record (turned back, if the picture "
        f"is turned), divide the distance (u, v) of every position from ({x:.4g}, {y:.4g}) m by "
        f"{view.slant_scale:.5g} − ({_linear(a, b)}), and subtract {_linear(0.5 * b, -0.5 * a)} from its `theta_rad`. "
        "Turn the camera before the next film."
    )


def _linear(a: float, b: float) -> str:
    """a u + b v as text."""
    return f"{a:.4g} u {'−' if b < 0.0 else '+'} {abs(b):.4g} v"


KEYSTONE_DISTORTION = Effect(
    name="keystone_distortion",
    summary="the camera looks at the plane of motion aslant: farther parts look smaller",
    source="projection of a plane by a pinhole camera: R. Hartley and A. Zisserman (2004), Multiple View Geometry in "
    "Computer Vision, section 2.3, `rock2d.scene.world.View`",
    phase="all",
    origin="camera",
    parameters=(
        Parameter("right", "1", 0.0, -0.2, 0.2, "loss of scale to the right over the width W of embankment and ditch"),
        Parameter("up", "1", 0.0, -0.2, 0.2, "loss of scale upwards over the same length"),
        *AIM_PARAMETERS,
    ),
    apply=with_keystone_distortion,
    remedy=keystone_distortion_remedy,
)


def with_angle_offset(world: World, values: Sequence[float]) -> World:
    """θ recorded = θ true + offset."""
    return with_view(world, theta_offset_rad=world.view.theta_offset_rad + values[0])


def angle_offset_remedy(fitted: FittedEffect) -> str:
    """Correct the angles."""
    value, half = fitted.values["offset_rad"], fitted.half["offset_rad"]
    degrees, width = np.rad2deg([value, half])
    way = "counter-clockwise" if value > 0 else "clockwise"
    return (
        f"Add {plain(-value, half)} to every `theta_rad` ({number(-degrees, width)}°) and diagnose again. The "
        f"tracked angle lies {number(abs(degrees), width)}° {way} of the block's own x axis. If it comes from "
        "two marks, choose marks on a line along that axis."
    )


ANGLE_OFFSET = Effect(
    name="angle_offset",
    summary="the recorded orientation has a constant offset: corners meet the ground elsewhere than they seem to",
    source="the tracker's zero of the angle, `rock2d.scene.world.View`",
    phase="impact",
    origin="camera",
    parameters=(Parameter("offset_rad", "rad", 0.0, -0.4, 0.4, "recorded less true angle, counter-clockwise"),),
    apply=with_angle_offset,
    remedy=angle_offset_remedy,
)


MIRROR_NONE, MIRROR_X, MIRROR_Y, MIRROR_THETA = range(4)
MIRRORED_COLUMNS = {
    MIRROR_X: ("x_m", "vx_m_s"),
    MIRROR_Y: ("y_m", "vy_m_s"),
    MIRROR_THETA: ("theta_rad", "omega_rad_s"),
}


def with_mirrored_axis(world: World, values: Sequence[float]) -> World:
    """x, y or θ recorded = -x, -y or -θ. `values[0]` is a choice: 0 none, 1 x (about x = 0), 2 y (about y = 0), 3 θ."""
    mirror = list(world.view.mirror)
    axis = round(float(values[0]))
    if axis != MIRROR_NONE:
        mirror[axis - 1] *= -1.0
    return with_view(world, mirror=tuple(mirror))


def mirrored_axis_remedy(fitted: FittedEffect) -> str:
    """Change the sign of the column."""
    if round(fitted.values["axis"]) not in MIRRORED_COLUMNS:
        return "No axis is mirrored: correct nothing."
    place, speed = MIRRORED_COLUMNS[round(fitted.values["axis"])]
    column = f"`{place}` and of every `{speed}` and `{after(speed)}`" if fitted.impacts_only else f"`{place}`"
    return (
        f"Change the sign of every {column} and diagnose again. Then look for the cause: y grows upward, x to the "
        "right, angles counter-clockwise. In the set-up file, `up` turns y and the angle together; in `rock2d "
        "import`, so does `--y`."
    )


MIRRORED_AXIS = Effect(
    name="mirrored_axis",
    summary="an axis, or the sense of rotation, is recorded with the wrong sign",
    source="handedness of the image axes (y down in most image formats), `rock2d.scene.world.View`",
    phase="all",
    origin="camera",
    parameters=(
        Parameter(
            "axis",
            "choice",
            float(MIRROR_NONE),
            float(MIRROR_NONE),
            float(MIRROR_THETA),
            "the axis whose sign is wrong (1 x, 2 y, 3 theta)",
            choices=(float(MIRROR_X), float(MIRROR_Y), float(MIRROR_THETA)),
            choice_names=("x", "y", "theta"),
        ),
    ),
    apply=with_mirrored_axis,
    remedy=mirrored_axis_remedy,
)


EFFECTS = (
    CAMERA_TILT, SCALE_ERROR, FRAME_RATE_ERROR, LENS_DISTORTION, KEYSTONE_DISTORTION, ANGLE_OFFSET, MIRRORED_AXIS,
)  # fmt: skip
