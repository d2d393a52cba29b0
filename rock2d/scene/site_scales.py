"""What follows from the size of a cross-section and of blocks: how long a release lasts, which lines it can cross."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from rock2d.scene.blocks import Block
from rock2d.scene.cross_section import CrossSection

TIME_LIMIT_FREE_FALLS = (
    10.0  # in √(2 L / g); the slowest of a thousand balls on a field slope takes a third of it
)
MOST_INRADII_ABOVE_FOOT = 3.0  # inradii above a line's foot: beside any usual facing a centroid crosses lower


def site_time_limit_s(cross_section: CrossSection, gravity_m_s2: float) -> float:
    """Time in s after which a release ends if nobody says otherwise: 10 √(2 L / g), L the length of the surface.

    √(2 L / g) is the time of a free fall over L. Raises ValueError without gravity.
    """
    if gravity_m_s2 <= 0.0:
        raise ValueError("without gravity nothing says how long a release lasts")
    length = float(np.hypot(*np.diff(cross_section.points_m, axis=0).T).sum())
    return float(TIME_LIMIT_FREE_FALLS * np.sqrt(2.0 * length / gravity_m_s2))


def line_remarks(cross_section: CrossSection, blocks: Iterable[Block]) -> list[str]:
    """A remark on each measure line that a block's centroid cannot cross, or only far above the line's foot.

    The centroid comes no closer to the surface than the block's inradius, except by what it sinks in. A line close in
    front of a steep facing is therefore crossed above the facing only.
    """
    import shapely

    surface = shapely.LineString(cross_section.points_m)
    lines = {
        name: (shapely.Point(cross_section.foot_and_head(ends)[0]), shapely.LineString(ends))
        for name, ends in cross_section.measure_lines.items()
    }
    remarks = []
    for block in blocks:
        kept_off = surface.buffer(block.inradius_m)
        for name, (foot, line) in lines.items():
            pieces = [
                piece
                for piece in shapely.get_parts(shapely.difference(line, kept_off))
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
