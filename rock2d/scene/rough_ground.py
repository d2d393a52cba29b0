"""Rough ground: a cross-section whose local slope varies about that of its facets."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from rock2d.scene.cross_section import CrossSection

LARGEST_SLOPE_SDS = 3.0  # standard deviations at which slopes are cut off
LEAST_PIECE_SHARE = 1e-3  # distance of a cut from the ends of its facet, as a share of the facet


class Roughness(NamedTuple):
    """How rough a zone is.

    Attributes
    ----------
    sd_rad : standard deviation of the local slope
    length_m : length of a piece of constant slope"""

    sd_rad: float
    length_m: float

    @property
    def rise_m(self) -> float:
        """Largest distance of rough ground from the facet."""
        return float(1.5 * self.length_m * np.tan(min(LARGEST_SLOPE_SDS * self.sd_rad, 1.5)))


def roughened(
    cross_section: CrossSection, roughness: Mapping[str, Roughness], rng: np.random.Generator
) -> CrossSection:
    """The cross-section with the facets of rough zones cut into pieces, whose slopes are normally distributed.

    Pieces come in pairs of equal and opposite deviation. So the rough surface returns to every vertex, and its distance
    from the facet is at most the rise of one piece. A facet shorter than `length_m` does not change.

    Raises CrossSectionError if the rough surface crosses itself."""
    length = np.hypot(*np.diff(cross_section.points_m, axis=0).T)
    pieces = np.array([_pieces(n, roughness.get(zone)) for n, zone in zip(length, cross_section.zones, strict=True)])
    if not pieces.any():
        return cross_section
    sd = np.array([roughness[zone].sd_rad if zone in roughness else 0.0 for zone in cross_section.zones])
    sd = sd.repeat(pieces // 2)
    limit = np.minimum(LARGEST_SLOPE_SDS * sd, 1.5)
    deviation = np.clip(sd * rng.standard_normal(len(sd)), -limit, limit)

    count = np.maximum(pieces, 1)  # a smooth facet is one piece
    last = np.cumsum(count) - 1
    facet = np.arange(len(count)).repeat(count)
    place = np.arange(len(facet)) - (last - count + 1)[facet]  # index of a piece within its facet
    step = (length / count)[facet]
    off = np.zeros(len(facet))
    odd = (pieces[facet] > 0) & (place % 2 == 0)
    off[odd] = step[odd] * np.tan(deviation)
    along = step * (place + 1)
    ends = cross_section.points_m[facet] + along[:, None] * cross_section.tangents[facet]
    ends += off[:, None] * cross_section.normals[facet]
    ends[last] = cross_section.points_m[1:]
    points = np.vstack([cross_section.points_m[:1], ends])
    zones = np.array(cross_section.zones, object)[facet]
    return CrossSection(points, zones.tolist(), cross_section.measure_lines)


def smooth_share(cross_section: CrossSection, zone: str, roughness: Roughness) -> float:
    """Share of the length of a rough zone in facets that do not change, because they are shorter than a piece."""
    length = np.hypot(*np.diff(cross_section.points_m, axis=0).T)[np.array(cross_section.zones, object) == zone]
    smooth = np.array([_pieces(n, roughness) == 0 for n in length])
    return float(length[smooth].sum() / length.sum())


def raised(cross_section: CrossSection, x_m: np.ndarray, height_m: np.ndarray) -> CrossSection:
    """The cross-section with heights (n,) above it at places x_m (n,) in ascending order, linear in between.

    Points above each other move alike, so that the surface cannot cross itself."""
    points, zones = list[np.ndarray](), list[str]()
    for a, b, zone in zip(cross_section.points_m[:-1], cross_section.points_m[1:], cross_section.zones, strict=True):
        left, right = min(a[0], b[0]), max(a[0], b[0])
        gap = LEAST_PIECE_SHARE * (right - left)
        cuts = x_m[(x_m > left + gap) & (x_m < right - gap)][:: 1 if b[0] >= a[0] else -1]
        share = (cuts - a[0])[:, None] / (b[0] - a[0]) if len(cuts) else np.empty((0, 1))
        points += [a, *(a + share * (b - a))]
        zones += [zone] * (1 + len(cuts))
    surface = np.array([*points, cross_section.points_m[-1]])
    surface[:, 1] += np.interp(surface[:, 0], x_m, height_m)
    return CrossSection(surface, zones, cross_section.measure_lines)


def _pieces(length_m: float, roughness: Roughness | None) -> int:
    """Number of pieces of a facet; 0 if it does not change."""
    return 0 if roughness is None else 2 * round(length_m / (2.0 * roughness.length_m))
