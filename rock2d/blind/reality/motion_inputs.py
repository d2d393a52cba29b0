"""Inputs of the compiled motion: ground, blocks, soil and parameters, with the hidden causes. Shapes as they are
built may differ from the stated ones: cross-section, roughness, corners of the blocks."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rock2d.blind.reality import parameters
from rock2d.blind.reality.catalogue import CAUSES
from rock2d.blind.reality.compiled_records import (
    BODY_WIDTH,
    CENTROID_X,
    CENTROID_Y,
    GROUP,
    INERTIA,
    K_L,
    K_UL,
    MASS,
    MU,
    REACH,
    ROUNDING,
    SIZE,
    Ground,
    MotionInputs,
    SoilLaw,
)
from rock2d.blind.reality.contact_detection import RIDGE_TURN_RAD, ground_patches, ground_turns
from rock2d.blind.reality.data_model import Array, Block, Hidden, Law, Setup, World, mean_size_m

STEEPEST_FACING_RAD = np.deg2rad(85.0)
HILL_WAVES = 5
HILL_PIECES = 8  # straight pieces of ground in a wavelength of hills


def motion_inputs(world: World, hidden: Sequence[Hidden]) -> MotionInputs:
    """Inputs of the motion in a world with the hidden causes."""
    values = {cause.name: cause.values for cause in hidden}
    size = mean_size_m(world.blocks)
    setup = world.setup
    if "geometry_error" in values:
        setup = setup_as_built(setup, values["geometry_error"], size)
    soil, zone = _soil_rows(setup, world.law, values.get("zone_contrast"))
    points = np.array(setup.points_m, float)
    yielding = np.zeros(len(zone))
    if setup.embankment is not None:
        yielding[slice(*setup.embankment)] = 1.0
    rough = values.get("surface_roughness", {})
    if "profile" in rough:  # else each impact draws a slope
        points, pieces = (hilly_profile if "wavelength_m" in rough else rough_profile)(points, rough)
        zone, yielding = zone[pieces], yielding[pieces]
    ridges = (ground_turns(points) < -RIDGE_TURN_RAD).astype(float)
    ground = Ground(points, zone, ground_patches(points), ridges, yielding)
    bodies, outlines = _bodies(world, hidden)
    counts = np.array([len(outline) for outline in outlines])
    corners = np.zeros((len(outlines), counts.max(), 2))
    for i, outline in enumerate(outlines):
        corners[i, : counts[i]] = outline
    law = SoilLaw(soil, world.law.indentation, float(world.gravity_m_s2), _parameter_values(hidden, size))
    return MotionInputs(ground, corners, counts, bodies, law)


def _bodies(world: World, hidden: Sequence[Hidden]) -> tuple[Array, list[Array]]:
    """Rows of the columns of bodies, and the corners of each block from its centre of mass."""
    values = {cause.name: cause.values for cause in hidden}
    edges_form = next((cause.form for cause in hidden if cause.name == "rounded_edges"), 0)
    eccentricity = values.get("mass_eccentricity", {"x_m": 0.0, "y_m": 0.0})
    offset = np.array([eccentricity["x_m"], eccentricity["y_m"]])
    bodies, outlines = np.zeros((len(world.blocks), BODY_WIDTH)), []
    for i, (block, body) in enumerate(zip(world.blocks, bodies, strict=True)):
        outline, rounding, group = block_outline(block, values.get("rounded_edges"), edges_form)
        outline = outline - offset
        body[MASS] = block.mass_kg
        body[INERTIA] = block.inertia_kg_m2 * values.get("inertia_error", {}).get(f"factor_{i}", 1.0)
        body[INERTIA] -= block.mass_kg * float(offset @ offset)  # the stated one is about the centroid
        body[REACH] = np.hypot(*outline.T).max() + rounding
        body[ROUNDING], body[GROUP], body[SIZE] = rounding, group, block.size_m
        body[CENTROID_X], body[CENTROID_Y] = -offset
        outlines.append(outline)
    return bodies, outlines


def stiffening(hidden: Sequence[Hidden], order: Array) -> Array:
    """(n,) factor on the stiffness of the soil after `order` releases of the same block."""
    factor = np.ones(len(order))
    for cause in hidden:
        if cause.name == "soil_compaction":
            growth, blows = cause.values["growth"], cause.values["blows"]
            factor = 1.0 + growth * (1.0 - np.exp(-order / blows) if blows > 0.0 else np.log1p(order))
    return factor


def _soil_rows(setup: Setup, law: Law, contrast: dict[str, float] | None) -> tuple[Array, Array]:
    """(facets, 5) rows of the law, one for each facet, and the row of each facet."""
    soil = np.tile([law.k_l, law.k_ul, law.k_t, law.mu, law.k_r], (len(setup.zones), 1))
    if contrast is not None:
        facets = setup.face if contrast["k_ul"] == 1.0 else setup.embankment
        if facets is not None:
            soil[slice(*facets), K_L] *= contrast["k_l"]
            soil[slice(*facets), K_UL] *= contrast["k_ul"]
            soil[slice(*facets), MU] *= contrast["mu"]
    soil[:, K_UL] = np.maximum(soil[:, K_L], soil[:, K_UL])
    return soil, np.arange(len(soil))


def _parameter_values(hidden: Sequence[Hidden], size: float) -> Array:
    """The row of `parameters`."""
    row = np.zeros(parameters.N_PARAMETERS)
    for cause in hidden:
        for name, column in CAUSES[cause.name].columns.items():
            row[column] = cause.values[name]
        for column in CAUSES[cause.name].switches:
            row[column] = 1.0
    rate = row[parameters.DASHPOT] + 0.5 * size * (row[parameters.DEPTH_DASHPOT] + row[parameters.PLOUGHING])
    if row[parameters.TENSION] > 0.0:
        rate += row[parameters.TENSION] / row[parameters.TENSION_SPEED]
    row[parameters.DAMPING_RATE] = rate
    return row


def setup_as_built(setup: Setup, error: dict[str, float], size_m: float) -> Setup:
    """The set-up with its facing turned about its foot, or its ditch raised by `rise` times the embankment's height.

    Without an embankment all ground is inclined about its centre, or raised by `rise` times the size of a block."""
    points = np.array(setup.points_m, float)
    turn, rise = error.get("turn_rad", 0.0), error.get("rise", 0.0)
    if setup.face is None:
        points[:, 1] += rise * size_m + np.tan(turn) * (points[:, 0] - points[:, 0].mean())
        return replace(setup, points_m=points)
    foot, crest = setup.face
    run, height = points[crest] - points[foot]
    angle = np.clip(np.arctan2(height, run) + turn, np.deg2rad(5.0), STEEPEST_FACING_RAD)
    shear = height / np.tan(angle) - run
    if crest + 1 < len(points):
        shear = min(shear, 0.9 * (points[crest + 1, 0] - points[crest, 0]))
    share = (points[foot : crest + 1, 1] - points[foot, 1]) / height
    points[foot : crest + 1, 0] += shear * share
    if setup.ditch is not None:
        points[setup.ditch[0] : setup.ditch[1] + 1, 1] += rise * height
    return replace(setup, points_m=points)


def rough_profile(points: Array, rough: dict[str, float]) -> tuple[Array, Array]:
    """A rough profile through the vertices of the set-up, and the facet of the set-up below each of its pieces.

    Neighbouring heights are correlated; the slopes of the pieces have the standard deviation `sd_rad`."""
    rng = np.random.default_rng(int(rough["profile"]))
    memory = 0.5
    out, pieces = [points[:1]], []
    for f in range(len(points) - 1):
        edge = points[f + 1] - points[f]
        length = float(np.hypot(*edge))
        count = max(2, round(length / rough["spacing_m"]))
        height = np.zeros(count + 1)
        sd = np.tan(rough["sd_rad"]) * length / count / np.sqrt(2.0 * (1.0 - memory))
        for k in range(1, count):
            height[k] = memory * height[k - 1] + np.sqrt(1.0 - memory**2) * rng.normal(0.0, sd)
        share = np.arange(1, count + 1)[:, None] / count
        out.append(points[f] + share * edge + height[1:, None] * np.array([-edge[1], edge[0]]) / length)
        pieces += [f] * count
    rough_points = np.concatenate(out)
    steps = np.maximum(np.diff(rough_points[:, 0]), 1e-3 * rough["spacing_m"])
    rough_points[1:, 0] = rough_points[0, 0] + np.cumsum(steps)
    return rough_points, np.array(pieces)


def hilly_profile(points: Array, hills: dict[str, float]) -> tuple[Array, Array]:
    """The ground with smooth hills and dips along x, and the facet of `points` below each of its pieces.

    Waves of random phase, with wavelengths of 0.6 to 1.4 `wavelength_m`, make the heights; their root mean square is
    about `height_m`."""
    rng = np.random.default_rng(int(hills["profile"]))
    spread = 0.6 + 0.8 * (np.arange(HILL_WAVES) + rng.random(HILL_WAVES)) / HILL_WAVES
    numbers = 2.0 * np.pi / (hills["wavelength_m"] * spread)
    phases = rng.uniform(0.0, 2.0 * np.pi, HILL_WAVES)
    lengths = np.hypot(*np.diff(points, axis=0).T)
    counts = np.ceil(HILL_PIECES * lengths / hills["wavelength_m"]).astype(int)
    pieces = np.repeat(np.arange(len(counts)), counts)
    share = np.concatenate([np.arange(count) / count for count in counts])[:, None]
    out = np.vstack([points[pieces] + share * (points[pieces + 1] - points[pieces]), points[-1:]])
    waves = np.cos(out[:, :1] * numbers + phases).sum(axis=1)
    out[:, 1] += hills["height_m"] * np.sqrt(2.0 / HILL_WAVES) * waves
    return out, pieces


def block_outline(block: Block, edges: dict[str, float] | None, form: int) -> tuple[Array, float, int]:
    """Corners in m, radius of the circles that they carry, and number of corners that share a contact (0: a circle).

    A circle gives its centre and radius. With rounded edges (form 0) a polygon gives the inset polygon, with cut edges
    (form 1) twice as many corners."""
    if block.vertices_m is None:
        return np.zeros((1, 2)), block.radius_m, 0
    corners = np.array(block.vertices_m, float)
    if edges is None:
        return corners, 0.0, 1
    cut = edges["share"] * block.half_width_m
    ahead, behind = np.roll(corners, -1, axis=0) - corners, np.roll(corners, 1, axis=0) - corners
    ahead /= np.hypot(*ahead.T)[:, None]
    behind /= np.hypot(*behind.T)[:, None]
    if form == 1:
        half = 0.5 * cut
        return np.stack([corners + half * behind, corners + half * ahead], axis=1).reshape(-1, 2), 0.0, 2
    sine = np.abs(ahead[:, 0] * behind[:, 1] - ahead[:, 1] * behind[:, 0])
    return corners + cut * (ahead + behind) / sine[:, None], cut, 1
