"""Default time limit of a release."""

import numpy as np

from rock2d.scene.cross_section import CrossSection

TIME_LIMIT_FREE_FALLS = 10.0  # in √(2 L / g); the slowest of 1000 balls on a field slope took a third of it


def site_time_limit_s(cross_section: CrossSection, gravity_m_s2: float) -> float:
    """Default time limit in s: 10 √(2 L / g), with the length L of the surface.

    √(2 L / g) is the time of a free fall over L. Raises ValueError without gravity."""
    if gravity_m_s2 <= 0.0:
        raise ValueError("without gravity there is no default time limit")
    length = float(np.hypot(*np.diff(cross_section.points_m, axis=0).T).sum())
    return float(TIME_LIMIT_FREE_FALLS * np.sqrt(2.0 * length / gravity_m_s2))
