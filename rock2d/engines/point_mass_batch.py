"""Ensembles of the point-mass engine: all releases of a block in one compiled call, on all threads.

`run_point_mass` uses the same kernel, so a release has the same bits in both, in any order and on any number of
threads."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rock2d.compiled import in_threads, njit
from rock2d.engines.parabola_intersection import make_surface
from rock2d.engines.point_mass import Releases, kernel_inputs, line_rows, new_outputs, point_mass_release
from rock2d.laws.rebound import ReboundParameters
from rock2d.scene.blocks import Block
from rock2d.scene.cross_section import CrossSection

Array = np.ndarray

MOST_ON_ONE_THREAD = 500  # so few releases take less time than starting busy threads


@dataclass
class PointMassBatch:
    """Results of an ensemble of n releases.

    Attributes
    ----------
    stop : (n,) index into `point_mass.STOPS`
    ends : (n, 7) t and state at the end of each release
    impact_count : (n,) number of impacts of each release
    crossings : (n, lines, 7) t and state at the first crossing of each measure line, NaN if there is none
    impacts : (n, room, 11) t and state before, velocities after, facet; rows beyond the last impact are NaN
    """

    stop: Array
    ends: Array
    impact_count: Array
    crossings: Array
    impacts: Array


def run_point_mass_batch(
    block: Block,
    cross_section: CrossSection,
    parameters: Mapping[str, ReboundParameters],
    states: Array,
    seeds: Array,
    *,
    gravity_m_s2: float = 9.81,
    time_limit_s: float,
    impact_room: int = 0,
    stop_speed_m_s: float | None = None,
) -> PointMassBatch:
    """Run n releases from `states` (n, 6: x, y, theta, vx, vy, omega of the centroid; SI); see `run_point_mass`.

    `seeds` (n,) are whole numbers in [0, 2^64), each the `seed` of its release in `run_point_mass`; `impact_room` is
    the largest number of impacts that are recorded of a release.

    Raises ValueError if states are not finite, if seeds are not n such numbers, if `impact_room` is negative, if
    gravity, time limit or stop speed is not positive, or if a zone has no parameters.
    """
    states = np.ascontiguousarray(np.atleast_2d(states), float)
    n = len(states)
    if states.shape != (n, 6) or not np.isfinite(states).all():
        raise ValueError("states must be an (n, 6) array of finite numbers")
    given = np.asarray(seeds)
    if given.shape != (n,) or given.dtype.kind not in "iu" or (given < 0).any():
        raise ValueError(f"seeds must be {n} whole numbers in [0, 2^64), one for each release")
    if impact_room < 0:
        raise ValueError(f"impact_room must not be negative, got {impact_room}")
    inputs = kernel_inputs(block, cross_section, parameters, gravity_m_s2, time_limit_s, stop_speed_m_s)
    surface = make_surface(cross_section)
    lines = line_rows(cross_section.measure_lines.values(), surface.reach_m)
    outputs = new_outputs(n, impact_room, len(lines))
    releases = Releases(states, np.ascontiguousarray(given, np.uint64))
    in_threads(_run_releases, n, (releases, inputs, surface, lines, outputs), MOST_ON_ONE_THREAD + 1)
    return PointMassBatch(
        outputs.stop, outputs.ends[:, 1].copy(), outputs.impact_count, outputs.crossings, outputs.impacts
    )


@njit(nogil=True)
def _run_releases(low, high, releases, inputs, surface, lines, outputs):
    for i in range(low, high):
        point_mass_release(i, releases, inputs, surface, lines, outputs)
