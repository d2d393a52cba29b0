"""Rough ground: a cross-section whose local slope varies about that of its facets."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from rock2d.scene.cross_section import CrossSection

LARGEST_DEVIATION = 3.0  # standard deviations, beyond which slopes are cut off


class Roughness(NamedTuple):
    """How rough a zone is.

    Attributes
    ----------
    sd_rad : standard deviation of the local slope
    length_m : length of a piece of constant slope
    """

    sd_rad: float
    length_m: float

    @property
    def rise_m(self) -> float:
        """The farthest that rough ground lies from the facet."""
        return float(1.5 * self.length_m * np.tan(min(LARGEST_DEVIATION * self.sd_rad, 1.5)))


def roughened(
    cross_section: CrossSection, roughness: Mapping[str, Roughness], rng: np.random.Generator
) -> CrossSection:
    """The cross-section with the facets of rough zones cut into pieces whose slopes vary, normally distributed.

    Pieces come in pairs of equal and opposite deviation, so that the surface leaves the mean one by no more than the
    rise of one piece, and returns to every vertex of it. A facet shorter than `length_m` stays as it is.

    Raises CrossSectionError if the rough surface crosses itself.
    """
    length = np.hypot(*np.diff(cross_section.points_m, axis=0).T)
    points: list[np.ndarray] = [cross_section.points_m[:1]]
    zones: list[str] = []
    for i, zone in enumerate(cross_section.zones):
        own = roughness.get(zone)
        pieces = 0 if own is None else 2 * round(length[i] / (2.0 * own.length_m))
        if own is None or pieces == 0:
            points.append(cross_section.points_m[i + 1 : i + 2])
            zones.append(zone)
            continue
        deviation = rng.normal(0.0, own.sd_rad, pieces // 2)
        limit = min(LARGEST_DEVIATION * own.sd_rad, 1.5)
        step = length[i] / pieces
        offset = np.zeros(pieces)
        offset[::2] = step * np.tan(np.clip(deviation, -limit, limit))
        along = step * np.arange(1, pieces + 1)
        piece = cross_section.points_m[i] + along[:, None] * cross_section.tangents[i]
        points.append(piece + offset[:, None] * cross_section.normals[i])
        points[-1][-1] = cross_section.points_m[i + 1]
        zones += [zone] * pieces
    return CrossSection(np.vstack(points), zones, cross_section.measure_lines)
