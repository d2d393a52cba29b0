"""Default time limit of a site, and remarks on measure lines that blocks cannot cross."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from rock2d.scene.blocks import Block
from rock2d.scene.cross_section import CrossSection

TIME_LIMIT_FREE_FALLS = 10.0  # in √(2 L / g); the slowest of 1000 balls on a field slope took a third of it
MOST_INRADII_ABOVE_FOOT = 3.0  # inradii above the foot of a line: at usual facings, centroids cross lower


def site_time_limit_s(cross_section: CrossSection, gravity_m_s2: float) -> float:
    """Default time limit of a release in s: 10 √(2 L / g), with the length L of the surface.

    √(2 L / g) is the time of a free fall over L. Raises ValueError without gravity.
    """
    if gravity_m_s2 <= 0.0:
        raise ValueError("without gravity there is no default time limit")
    length = float(np.hypot(*np.diff(cross_section.points_m, axis=0).T).sum())
    return float(TIME_LIMIT_FREE_FALLS * np.sqrt(2.0 * length / gravity_m_s2))


def line_remarks(cross_section: CrossSection, blocks: Iterable[Block]) -> list[str]:
    """A remark on each measure line that the centroid of a block cannot cross, or only far above its foot.

    The centroid stays at least the inradius of the block away from the surface, except for the penetration. So blocks
    cross a line close to a steep facing only above the facing.
    """
    import shapely

    surface = shapely.LineString(cross_section.points_m)
    lines = {
        name: (shapely.Point(cross_section.foot_and_head(ends)[0]), shapely.LineString(ends))
        for name, ends in cross_section.measure_lines.items()
    }
    remarks = []
    for block in blocks:
        out_of_reach = surface.buffer(block.inradius_m)
        for name, (foot, line) in lines.items():
            pieces = [
                piece
                for piece in shapely.get_parts(shapely.difference(line, out_of_reach))
                if not piece.is_empty
                and not cross_section.covers(np.array(piece.interpolate(0.5, normalized=True).coords))[0]
            ]
            lowest = min((foot.distance(piece) for piece in pieces), default=np.inf)
            if not pieces:
                remarks.append(
                    f"the centroid of block {block.name} cannot cross measure line {name}: the whole line is closer to "
                    f"the ground than {block.inradius_m:.3g} m"
                )
            elif (
                lowest > MOST_INRADII_ABOVE_FOOT * block.inradius_m
                and foot.distance(surface) < block.inradius_m
            ):
                remarks.append(
                    f"the centroid of block {block.name} can cross measure line {name} only {lowest:.3g} m or more "
                    f"above its foot: below, the line is closer to the ground than {block.inradius_m:.3g} m"
                )
    return remarks
