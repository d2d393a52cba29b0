"""Inputs of the compiled motion: ground, blocks, soil and parameters, with the hidden causes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rock2d.blind.reality import parameters
from rock2d.blind.reality.as_built import block_outline, hilly_profile, rough_profile, setup_as_built
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
from rock2d.blind.reality.data_model import Array, Hidden, Law, Setup, World, mean_size_m
from rock2d.blind.reality.ground import RIDGE_TURN_RAD, ground_patches, ground_turns


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
