"""The default time limit of a release."""

import pytest

from rock2d.scene.cross_section import CrossSection
from rock2d.scene.time_limit import site_time_limit_s


def test_the_time_limit_is_similar_for_similar_sites():
    """Times of similar motions under gravity go with the square root of the size."""
    site, small = (CrossSection([[0, 40 * k], [60 * k, 0], [110 * k, 0]], ["slope", "ditch"]) for k in (1.0, 0.04))
    assert site_time_limit_s(site, 9.81) == pytest.approx(5.0 * site_time_limit_s(small, 9.81))
    assert site_time_limit_s(site, 9.81) == pytest.approx(site_time_limit_s(small, 9.81 / 25.0))
    with pytest.raises(ValueError, match="gravity"):
        site_time_limit_s(site, 0.0)
