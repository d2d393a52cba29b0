"""What to do about each effect: how to correct the set-up file or the record, with sign and number; what to measure, to
state, and to add to the model.

Keys of files stand in backticks.
"""

from __future__ import annotations

import numpy as np

from rock2d.diagnosis.report import text
from rock2d.diagnosis.report.fitted import Fitted, plain, point
from rock2d.effects.air_drag import coefficient
from rock2d.effects.effect import STANDARD_GRAVITY_M_S2
from rock2d.effects.mirrored_axis import MIRROR_THETA, MIRROR_X, MIRROR_Y
from rock2d.effects.zone_contrast import FACE
from rock2d.scene.cross_section import embankment_facets, face_facets, facet_zones
from rock2d.scene.world import World

Array = np.ndarray

AGAIN = "Track the film again and diagnose again."
AXES = {MIRROR_X: ("x_m", "vx_m_s"), MIRROR_Y: ("y_m", "vy_m_s"), MIRROR_THETA: ("theta_rad", "omega_rad_s")}

# --- the camera: correct the set-up file or the record --------------------------------------------------


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


# --- the blocks and the ground: measure, then state it --------------------------------------------------


def mass_eccentricity(fitted: Fitted) -> str:
    """Centre of mass less centroid, in the block's own axes."""
    along, across = (fitted.number(key, 1e3 * fitted.size_m) for key in ("along", "across"))
    return (
        f"Balance the blocks on an edge: the centre of mass should lie {along} mm along the block's own x and "
        f"{across} mm along its own y from the centroid. No key of experiment.yaml states it. Make the blocks of one "
        "material, or track the centre of mass instead of the centroid."
    )


def inertia_error(fitted: Fitted) -> str:
    """I true = factor × I stated."""
    inertias = {name: block.inertia_kg_m2 for name, block in fitted.experiment.blocks.items()}
    stated = ", ".join(f"{name} `inertia: {fitted.values['factor'] * v:.4g}`" for name, v in inertias.items())
    return (
        f"The moment of inertia is {fitted.number('factor')} times the stated one. Set in experiment.yaml: {stated} "
        "(kg m²), and diagnose again. Measure it, for example as a pendulum: are the blocks hollow, cored or of two "
        "materials?"
    )


def rounded_edges(fitted: Fitted) -> str:
    """The radius is a share of the largest that fits into every block with corners."""
    sizes = [b.largest_rounding_m for b in fitted.experiment.blocks.values() if not b.smooth]
    radius = fitted.number("radius", 1e3 * min(sizes, default=0.0))
    return (
        f"Measure the corners with a radius gauge: {radius} mm are expected. Then state blocks as `shape: polygon` "
        "with `vertices_m` along the rounded outline, four or more to a corner, and diagnose again."
    )


def geometry_error(fitted: Fitted) -> str:
    """The cross-section as built, from the fitted turn and rise."""
    built = fitted.world().cross_section
    turn, width = np.rad2deg([fitted.values["facing_rad"], fitted.half["facing_rad"]])
    more, less = "steeper", "flatter"
    rise = fitted.experiment.cross_section.embankment
    height = 1e3 * (rise.height_m if rise is not None else fitted.size_m)
    level, fine = height * fitted.values["ditch_level"], height * fitted.half["ditch_level"]
    what = "the facing", "the ditch"
    if rise is None:
        what, more, less = ("the ground", "it"), "turned, up to the right", "turned, down to the right"
    points = ", ".join(f"[{x:.4g}, {y:.4g}]" for x, y in built.points_m)
    return (
        f"Survey the cross-section again. Expected: {what[0]} is {text.number(abs(turn), width)}° "
        f"{more if turn > 0 else less} and {what[1]} lies {text.number(abs(level), fine)} mm "
        f"{'higher' if level > 0 else 'lower'} than stated. If the survey confirms it, set `points_m: [{points}]` in "
        "the cross-section and diagnose again."
    )


def zone_contrast(fitted: Fitted) -> str:
    """The law of the embankment's zones, or of its face alone, as a scenario states it."""
    stiffness, restitution, friction = (fitted.values[k] for k in ("stiffness", "restitution", "friction"))
    section, law = fitted.experiment.cross_section, fitted.law
    where, facets = "embankment", embankment_facets
    if round(fitted.values["place"]) == FACE:
        where, facets = "face of the embankment", face_facets
    differ = facet_zones(section, facets(section))
    zones = ", ".join(f"`{name}`" for name, own in zip(section.zone_names, differ, strict=True) if own)
    k_l = law["k_l_N_m"] * stiffness
    k_ul = max(k_l, law["k_ul_N_m"] * stiffness / restitution**2)
    angle = np.rad2deg(np.arctan(np.tan(np.deg2rad(law["friction_angle_deg"])) * friction))
    return (
        f"Give the {where} its own soil in the scenario: `k_l_N_m: {plain(k_l)}`, `k_ul_N_m: {plain(k_ul)}`, "
        f"`friction_angle_deg: {angle:.3g}` for the zones {zones} under `deterministic`, and `k_l_N_m: "
        f"{plain(law['k_l_N_m'])}`, `k_ul_N_m: {plain(law['k_ul_N_m'])}`, `friction_angle_deg: "
        f"{law['friction_angle_deg']:.3g}` under `default`. To check, drop blocks vertically on both soils and "
        "compare the rebound."
    )


def soil_compaction(fitted: Fitted) -> str:
    """Growth of the stiffness with each release of the same block."""
    return (
        f"The stiffness grows by {fitted.number('rate', 100)} % of its first value with each "
        "release of the same block. Loosen and level the soil before every release, and film the blocks in random "
        "order. To check, repeat the first release at the end of the series: it should rebound otherwise."
    )


def embankment_yield(fitted: Fitted) -> str:
    """The mass ratio gives the mass that moves."""
    moving = fitted.mass_kg / max(fitted.values["mass_ratio"], 1e-9)
    return (
        f"Look whether the embankment slides: film a mark on its crest. A moving mass of {text.number(moving)} kg is "
        "expected. Fix the embankment to its base and film again, or weigh it and state that it moves."
    )


def surface_roughness(fitted: Fitted) -> str:
    """A scatter: no mean to correct."""
    slope = np.rad2deg(fitted.values["sd_rad"])
    return (
        "There is no mean to correct. Survey the surface at distances of a block's size: a standard deviation of "
        f"the slope of {text.number(slope)}° is expected. Level it before every release, or count the scatter as "
        "part of the soil and film more releases."
    )


# --- forces: measure them, or add them to the model -----------------------------------------------------


def air_drag(fitted: Fitted) -> str:
    """c / m: the share of the speed that is lost on a metre."""
    value = fitted.values["drag_per_mass_1_m"]
    blocks, each = fitted.experiment.blocks, fitted.each.get("drag_per_mass_1_m", {})
    drag = {name: text.number(coefficient(block, value)) for name, block in blocks.items()}
    differ = ""
    if each:
        found = {name: own["drag_coefficient"] for name, own in each.items()}
        drag = {b: f"{text.number(c['value'])} ({text.interval(*c['ci95'])})" for b, c in found.items()}
        low, high = np.array([c["ci95"] for c in found.values()]).T
        differ = " (surely not the same)" if low.max() > high.min() else ""
    listed = ", ".join(f"{text.spoken(name)} {c}" for name, c in drag.items())
    return (
        f"Blocks lose {fitted.number('drag_per_mass_1_m', 100)} % of their speed on a metre of flight. In air this is "
        f"a drag coefficient of {listed}{differ}; 0.5 of a ball and 1 to 2 of a body with edges is usual. If it is, "
        "the model lacks the air. If it is larger, look for what else brakes: a wire, dust, wind. Film a long free "
        "fall, and a heavier block of the same shape, which air slows less."
    )


def flight_damping(fitted: Fitted) -> str:
    """Share of velocity and spin that is lost in a second."""
    return (
        f"Velocity and spin decay by {fitted.number('rate_1_s', 100)} % a second in flight. If the film was "
        "simulated, switch off the global damping of that program. If not, film a spinning block in a long flight: "
        "only this effect slows the spin, too."
    )


def magnus_lift(fitted: Fitted) -> str:
    """The path turns at this share of the spin."""
    value, half = fitted.values["lift_per_mass"], fitted.half["lift_per_mass"]
    way = "counter-clockwise" if value > 0 else "clockwise"
    return (
        f"The path of a block with counter-clockwise spin turns {way}, at {text.number(abs(value), half)} times the "
        "spin. Film the same throw with forward spin and with backspin: the paths must bend to opposite sides. If "
        "they do not, look for wind."
    )


def out_of_plane(fitted: Fitted) -> str:
    """cos(angle) of the horizontal velocity stays in the plane."""
    lost = 1 - np.cos(fitted.values["angle_rad"])
    return (
        "Film from above as well: the horizontal velocity should turn by about "
        f"{fitted.number('angle_rad', np.rad2deg(1))}° at an impact, which takes {text.number(100 * lost)} % of it out "
        "of the plane. Guide the blocks between two plates, use cylinders, or leave out releases that swerve."
    )


def viscous_damping(fitted: Fitted) -> str:
    """Dashpots, the same for every block, so that light blocks feel them more."""
    constant = fitted.values["rate_1_s"] * fitted.mass_kg
    deep = fitted.values["deep_rate_1_s"] * fitted.mass_kg / fitted.size_m
    return (
        "Drop a light and a heavy block of one shape vertically on the flat soil, from several heights: the lighter "
        "one should rebound less. If so, add a dashpot beside the normal spring: F = (c + h δ) dδ/dt with c = "
        f"{text.number(constant)} N s/m and h = {text.number(deep)} N s/m²."
    )


def adhesion(fitted: Fitted) -> str:
    """The pull in N."""
    pull = fitted.number("pull_per_weight", fitted.mass_kg * STANDARD_GRAVITY_M_S2)
    return (
        "Press a block into the soil and lift it with a spring balance: beside its weight a pull of "
        f"{pull} N is expected. Dry the soil or clean the blocks and film again, or add "
        "the pull to the contact law while the block leaves."
    )


def ploughing_drag(fitted: Fitted) -> str:
    """The drag coefficient of the ploughed front."""
    drag = fitted.values["rate_1_s"] * fitted.mass_kg / fitted.size_m
    return (
        "Measure depth and length of the grooves: deep, fast ones should brake the block more than friction does. "
        f"Then add a tangential force F = c δ u against the slip u, with c = {text.number(drag)} N s/m² and the "
        "depth δ. Shallow throws at two speeds separate it from friction, which does not grow with the speed."
    )


def slip_dependent_friction(fitted: Fitted) -> str:
    """The friction angle at rest and at high speed."""
    change, speed = fitted.values["change"], fitted.values["speed_m_s"]
    rest = float(fitted.law["friction_angle_deg"])
    fast = np.rad2deg(np.arctan(np.tan(np.deg2rad(rest)) * max(0.05, 1.0 + change)))
    return (
        f"Drag a block over the soil at speeds well below and above {text.number(speed)} m/s: the friction angle "
        f"should {'grow' if change > 0 else 'fall'} from {text.number(rest)}° to {text.number(float(fast))}°. If it "
        "does, make the friction of the contact law depend on the sliding speed."
    )


INSTRUCTIONS = {
    rule.__name__: rule
    for rule in (
        camera_tilt, scale_error, frame_rate_error, lens_distortion, angle_offset, mirrored_axis, mass_eccentricity,
        inertia_error, rounded_edges, geometry_error, zone_contrast, soil_compaction, embankment_yield,
        surface_roughness, air_drag, flight_damping, magnus_lift, out_of_plane, viscous_damping, adhesion,
        ploughing_drag, slip_dependent_friction,
    )
}  # fmt: skip
