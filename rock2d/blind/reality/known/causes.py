"""The known effects in the reality engine, in forms that differ from those of the toolkit."""

import numpy as np

from rock2d.blind.reality import parameters
from rock2d.blind.reality.cause import IMPACT_SPEED, Array, Cause, Rng, Scale, Values, View, random_sign


def air_drag(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    """Air drag: quadratic in the speed, or with the power 1.7."""
    power = (2.0, 1.7)[form]
    per_length = 0.012 / scale.size
    return {"drag": share * per_length * (IMPACT_SPEED * scale.speed) ** (2.0 - power), "power": power}


def flight_damping(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    """Damping in flight: the spin decays at the same rate as the velocity, or at 0.7 of it."""
    rate = 0.1 * share * np.sqrt(scale.gravity / scale.size)
    return {"rate_1_s": rate, "spin_rate_1_s": (1.0, 0.7)[form] * rate}


def magnus_lift(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    """Magnus lift: linear in the spin, or saturating with the ratio of rim speed to block speed."""
    return {"lift": random_sign(rng) * (0.03, 0.04)[form] * share, "arm_m": (0.0, 0.5 * scale.size)[form]}


def mass_eccentricity(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    """Eccentric mass: the centre of mass is displaced along the x axis of the block, or diagonally."""
    offset = 0.15 * share * scale.size * random_sign(rng)
    return {"x_m": offset, "y_m": 0.0} if form == 0 else {"x_m": 0.7 * offset, "y_m": 0.7 * random_sign(rng) * offset}


def inertia_error(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    """Wrong inertia: the same factor for all blocks, or a different one for each."""
    whole = random_sign(rng) * np.log(2.0) * share
    shares = np.ones(scale.n_blocks) if form == 0 else rng.uniform(0.2, 1.0, scale.n_blocks)
    return {f"factor_{i}": float(np.exp(whole * part)) for i, part in enumerate(shares)}


def rounded_edges(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    """Rounded edges: corners are circular, or cut off; `share` is relative to half the width of the block."""
    return {"share": (0.9, 0.7)[form] * share}


def geometry_error(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    """Wrong geometry: the facing is turned about its foot, or the ditch is raised."""
    return {"turn_rad": 0.2 * share * random_sign(rng)} if form == 0 else {"rise": 0.15 * share * random_sign(rng)}


def surface_roughness(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    """Rough surface: each impact draws a slope, or the ground has a rough or a hilly profile, the same for all
    releases."""
    if form == 0:
        return {"sd_rad": 0.2 * share}
    profile = float(rng.integers(1 << 30))
    if form == 1:
        return {"sd_rad": 0.2 * share, "spacing_m": 1.5 * scale.size, "profile": profile}
    # the root mean square of one wave with an amplitude of a tenth of a block
    return {"height_m": 0.07 * share * scale.size, "wavelength_m": 4.0 * scale.size, "profile": profile}


def zone_contrast(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    """Contrast between zones: loading stiffness of the facing, or stiffness and friction of the whole embankment."""
    stiffness = float(np.exp(random_sign(rng) * np.log(5.0) * share))
    if form == 0:
        return {"k_l": stiffness, "k_ul": 1.0, "mu": 1.0}
    return {"k_l": stiffness, "k_ul": stiffness, "mu": float(np.exp(random_sign(rng) * np.log(2.2) * share))}


def soil_compaction(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    """Compaction: the stiffness grows with the blows and saturates, or grows with the logarithm of their number."""
    return {"growth": 3.0 * share, "blows": 12.0} if form == 0 else {"growth": 1.0 * share, "blows": 0.0}


def embankment_yield(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    """Yielding embankment: it slides on a base with friction, or moves on a spring with a dashpot."""
    mass = scale.mass / (0.6 * share)
    if form == 0:
        return {"mass_kg": mass, "spring_1_s2": 0.0, "dashpot_1_s": 0.0, "grip_m_s2": 0.5 * scale.gravity}
    rate = 0.25 * scale.spring
    return {"mass_kg": mass, "spring_1_s2": rate**2, "dashpot_1_s": 0.6 * rate, "grip_m_s2": 0.0}


def viscous_damping(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    """Viscous damping: a dashpot parallel to the spring, or one that grows with the depth (Hunt and Crossley)."""
    dashpot = 0.9 * share * scale.mass * scale.spring
    depth = IMPACT_SPEED * scale.speed / scale.spring
    return {"dashpot": dashpot, "hunt": 0.0} if form == 0 else {"dashpot": 0.0, "hunt": 1.6 * dashpot / depth}


def adhesion(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    """Adhesion: tension during unloading, constant, or fading with the rise."""
    pull = (12.0, 18.0)[form] * share * scale.mass * scale.gravity
    return {"pull_N": pull, "fades": float(form), "onset_m_s": 0.05 * scale.speed}


def ploughing_drag(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    """Ploughing: a resistance proportional to depth × slip, or to depth × slip²."""
    linear = 6.0 * share * scale.spring * scale.mass / scale.size
    speed = IMPACT_SPEED * scale.speed
    return {"linear": linear, "square": 0.0} if form == 0 else {"linear": 0.0, "square": 1.5 * linear / speed}


def slip_dependent_friction(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    """Friction that changes with the slip velocity, by an exponential or a hyperbola."""
    change = 1.5 * share if rng.random() < 0.5 else -0.8 * share
    return {"change": change, "speed_m_s": 2.0 * scale.speed, "hyperbolic": float(form)}


def out_of_plane(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    """Motion out of the plane: each impact takes a share of the horizontal speed, random or constant."""
    return {"share": (0.3, 0.45)[form] * share, "random": float(form == 0)}


def camera_tilt(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    """Tilted camera: the image is turned about its centre, or about another point."""
    turn = 0.12 * share * random_sign(rng)
    off_x, off_y = rng.uniform(-0.2, 0.2, 2) if form == 1 else (0.0, 0.0)
    return {"turn_rad": turn, "off_x": off_x, "off_y": off_y}


def camera_tilt_recorded(poses: Array, view: View, values: Values) -> Array:
    pivot = view.centre_m + view.extent_m * np.array([values["off_x"], values["off_y"]])
    c, s = np.cos(values["turn_rad"]), np.sin(values["turn_rad"])
    turned = (poses[..., :2] - pivot) @ np.array([[c, s], [-s, c]])
    out = poses.copy()
    out[..., :2] = pivot + turned
    out[..., 2] += values["turn_rad"]
    return out


def scale_error(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    """Wrong scale: the same in x and y, or with a difference of a tenth of the error between them."""
    error = 0.14 * share * random_sign(rng)
    uneven = 0.05 * error if form == 1 else 0.0
    return {"x": 1.0 + error + uneven, "y": 1.0 + error - uneven}


def scale_error_recorded(poses: Array, view: View, values: Values) -> Array:
    out = poses.copy()
    out[..., :2] = view.centre_m + (poses[..., :2] - view.centre_m) * np.array([values["x"], values["y"]])
    return out


def frame_rate_error(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    """Wrong frame rate; in the second form the frames also come early or late by random times."""
    factor = float(np.exp(0.14 * share * random_sign(rng)))
    return {"factor": factor, "jitter": 0.0 if form == 0 else 0.5 * share}


def lens_distortion(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    """Lens distortion: r (1 + k r²), or r / (1 - k r²); r over the extent of the image."""
    return {"k": 0.05 * share * random_sign(rng), "division": float(form)}


def lens_distortion_recorded(poses: Array, view: View, values: Values) -> Array:
    offset = poses[..., :2] - view.centre_m
    square = np.sum((offset / view.extent_m) ** 2, axis=-1, keepdims=True)
    distortion = values["k"] * square
    divided = values["division"] > 0.0
    out = poses.copy()
    out[..., :2] = view.centre_m + offset * (1.0 / np.maximum(1.0 - distortion, 0.2) if divided else 1.0 + distortion)
    return out


def keystone_distortion(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    """Camera aslant, by the equations of a pinhole: turned about the vertical, or about both axes and shifted.

    It is calibrated with a small square in the middle of embankment and ditch, which is a square in the record."""
    yaw, pitch = 0.2 * share * random_sign(rng), 0.2 * share * random_sign(rng)
    off_x, off_y = rng.uniform(-0.2, 0.2, 2) if form == 1 else (0.0, 0.0)
    turns = {"yaw_rad": 0.7 * yaw, "pitch_rad": 0.7 * pitch} if form == 1 else {"yaw_rad": yaw, "pitch_rad": 0.0}
    x_m, y_m = (float(v) for v in 0.5 * (scale.low + scale.high))
    return {**turns, "off_x": off_x, "off_y": off_y, "square_x_m": x_m, "square_y_m": y_m}


def keystone_distortion_recorded(poses: Array, view: View, values: Values) -> Array:
    """The camera stands at twice the extent of the image. The angle is that of a short line along the x axis of the
    block."""
    far, aim = 2.0 * view.extent_m, view.centre_m + view.extent_m * np.array([values["off_x"], values["off_y"]])
    yaw, pitch = values["yaw_rad"], values["pitch_rad"]
    ahead = np.array([np.sin(yaw) * np.cos(pitch), np.sin(pitch), -np.cos(yaw) * np.cos(pitch)])
    right = np.array([-ahead[2], 0.0, ahead[0]]) / np.hypot(ahead[0], ahead[2])
    axes = np.stack([right, np.cross(right, ahead), ahead])

    def picture(points: Array) -> Array:
        seen = (np.concatenate([points - aim, np.zeros_like(points[..., :1])], axis=-1) + far * ahead) @ axes.T
        return np.asarray(far * seen[..., :2] / seen[..., 2:])

    unit, square = 0.01 * view.extent_m, np.array([values["square_x_m"], values["square_y_m"]])
    calibrated = unit * np.linalg.inv(picture(square + unit * np.eye(2)) - picture(square))
    place, theta = poses[..., :2], poses[..., 2]
    c, s = np.cos(theta), np.sin(theta)
    line = (picture(place + unit * np.stack([c, s], axis=-1)) - picture(place)) @ calibrated
    turned = np.arctan2(c * line[..., 1] - s * line[..., 0], c * line[..., 0] + s * line[..., 1])
    seen = square + (picture(place) - picture(square)) @ calibrated
    return np.concatenate([seen, (theta + turned)[..., None]], axis=-1)


def angle_offset(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    """Offset of the angle: constant, or varying by a tenth from release to release."""
    offset = 0.4 * share * random_sign(rng)
    return {"offset_rad": offset, "jitter_rad": 0.1 * abs(offset) if form == 1 else 0.0}


def angle_offset_recorded(poses: Array, view: View, values: Values) -> Array:
    jitter = np.random.default_rng([view.seed, 12]).normal(0.0, 1.0, len(poses))
    out = poses.copy()
    out[..., 2] += values["offset_rad"] + values["jitter_rad"] * jitter[:, None]
    return out


def mirrored_axis(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    """Mirrored axis: x is recorded with the wrong sign, or the angle. There is no size."""
    return {"x": -1.0, "theta": 1.0} if form == 0 else {"x": 1.0, "theta": -1.0}


def mirrored_axis_recorded(poses: Array, view: View, values: Values) -> Array:
    out = poses.copy()
    out[..., 0] *= values["x"]
    out[..., 2] *= values["theta"]
    return out


# in the order in which a seed assigns them to cases: a new one comes last
CAUSES = {
    "air_drag": Cause(air_drag, forms=2, columns={"drag": parameters.DRAG, "power": parameters.DRAG_POWER}),
    "flight_damping": Cause(
        flight_damping, forms=2, columns={"rate_1_s": parameters.VELOCITY_DECAY, "spin_rate_1_s": parameters.SPIN_DECAY}
    ),
    "magnus_lift": Cause(magnus_lift, forms=2, columns={"lift": parameters.LIFT, "arm_m": parameters.LIFT_ARM}),
    "mass_eccentricity": Cause(mass_eccentricity, forms=2),
    "inertia_error": Cause(inertia_error, forms=2),
    "rounded_edges": Cause(rounded_edges, forms=2),
    "geometry_error": Cause(geometry_error, forms=2),
    "surface_roughness": Cause(surface_roughness, forms=3),
    "zone_contrast": Cause(zone_contrast, forms=2),
    "soil_compaction": Cause(soil_compaction, forms=2),
    "embankment_yield": Cause(
        embankment_yield,
        forms=2,
        columns={
            "mass_kg": parameters.RECOIL_MASS,
            "spring_1_s2": parameters.RECOIL_SPRING,
            "dashpot_1_s": parameters.RECOIL_DASHPOT,
            "grip_m_s2": parameters.RECOIL_FRICTION,
        },
    ),
    "viscous_damping": Cause(
        viscous_damping, forms=2, columns={"dashpot": parameters.DASHPOT, "hunt": parameters.DEPTH_DASHPOT}
    ),
    "adhesion": Cause(
        adhesion,
        forms=2,
        columns={
            "pull_N": parameters.TENSION,
            "fades": parameters.TENSION_FADES,
            "onset_m_s": parameters.TENSION_SPEED,
        },
    ),
    "ploughing_drag": Cause(
        ploughing_drag, forms=2, columns={"linear": parameters.PLOUGHING, "square": parameters.PLOUGHING_SQUARE}
    ),
    "slip_dependent_friction": Cause(
        slip_dependent_friction,
        forms=2,
        columns={
            "change": parameters.SLIP_CHANGE,
            "speed_m_s": parameters.SLIP_SPEED,
            "hyperbolic": parameters.SLIP_HYPERBOLIC,
        },
    ),
    "out_of_plane": Cause(out_of_plane, forms=2, switches=(parameters.SPEED_LOSS,)),
    "camera_tilt": Cause(camera_tilt, forms=2, recorded=camera_tilt_recorded),
    "scale_error": Cause(scale_error, forms=2, recorded=scale_error_recorded),
    "frame_rate_error": Cause(frame_rate_error, forms=2),
    "lens_distortion": Cause(lens_distortion, forms=2, recorded=lens_distortion_recorded),
    "angle_offset": Cause(angle_offset, forms=2, recorded=angle_offset_recorded),
    "mirrored_axis": Cause(mirrored_axis, forms=2, recorded=mirrored_axis_recorded),
    "keystone_distortion": Cause(keystone_distortion, forms=2, recorded=keystone_distortion_recorded),
}
