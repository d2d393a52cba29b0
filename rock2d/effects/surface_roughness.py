"""The local slope varies from impact to impact."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rock2d.effects.effect import Effect, Parameter
from rock2d.scene.cross_section import CrossSection
from rock2d.scene.world import World


def apply(world: World, values: Sequence[float]) -> World:
    """The normal of the ground turns by β from impact to impact, β normally distributed with mean 0 and standard
    deviation `sd_rad`. `values[0]` is one β for all releases, or one for each."""
    return replace(world, slope_rad=np.atleast_1d(np.asarray(values[0], float)))


def roughened(
    cross_section: CrossSection, sd_rad: float, length_m: float, rng: np.random.Generator
) -> CrossSection:
    """The cross-section cut into pieces of about `length_m` whose slopes vary with `sd_rad` (1 sigma, normal).

    Pieces come in pairs of equal and opposite deviation, so that the surface leaves the mean one by no more than the
    rise of one piece, and returns to every vertex of it.
    """
    length = np.hypot(*np.diff(cross_section.points_m, axis=0).T)
    points, zones = [cross_section.points_m[:1]], []
    for i, zone in enumerate(cross_section.zones):
        pairs = max(1, round(length[i] / (2.0 * length_m)))
        pieces = 2 * pairs
        offset = np.zeros(pieces)
        offset[::2] = length[i] / pieces * np.tan(rng.normal(0.0, sd_rad, pairs))
        along = length[i] / pieces * np.arange(1, pieces + 1)
        points.append(
            cross_section.points_m[i]
            + along[:, None] * cross_section.tangents[i]
            + offset[:, None] * cross_section.normals[i]
        )
        points[-1][-1] = cross_section.points_m[i + 1]
        zones += [zone] * pieces
    return CrossSection(np.vstack(points), zones, cross_section.measure_lines)


EFFECT = Effect(
    name="surface_roughness",
    summary="the local slope varies from impact to impact: scatter of the rebound, no mean",
    source="random slope of the impact surface, as in Pfeiffer & Bowen (1989), Computer simulation of rockfalls",
    phase="impact",
    parameters=(Parameter("sd_rad", "rad", 0.0, 0.0, 0.3, "standard deviation of the local slope"),),
    apply=apply,
    scatter=True,
)
