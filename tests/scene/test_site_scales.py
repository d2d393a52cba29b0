"""What the size of a site says: how long a release lasts, which measure lines a centroid can cross."""

import numpy as np
import pytest

from rock2d.scene.blocks import make_block
from rock2d.scene.cross_section import CrossSection
from rock2d.scene.site_scales import line_remarks, site_time_limit_s

POINTS = np.array([[0, 40], [60, 0], [80, 0], [80, 4], [83, 4], [83, 0], [110, 0]], float)
ZONES = ["slope", "ditch", "facing", "crest", "back", "run_out"]
BALL = make_block("ball", "circle", 1400, diameter_m=1.0)
SLAB = make_block("slab", "rectangle", 5400, length_m=2.0, height_m=1.0)


def site(**lines) -> CrossSection:
    return CrossSection(POINTS, ZONES, lines)


def test_the_time_limit_is_similar_for_similar_sites():
    """Times of similar motions under gravity go with the square root of the size."""
    small = CrossSection(POINTS / 25.0, ZONES)
    assert site_time_limit_s(site(), 9.81) == pytest.approx(5.0 * site_time_limit_s(small, 9.81))
    assert site_time_limit_s(site(), 9.81) == pytest.approx(site_time_limit_s(small, 9.81 / 25.0))
    with pytest.raises(ValueError, match="gravity"):
        site_time_limit_s(site(), 0.0)


def test_a_line_close_before_a_vertical_facing_cannot_be_crossed():
    ground = site(close=[[79.9, 0], [79.9, 4]], off=[[79.0, 0], [79.0, 4]])
    (remark,) = line_remarks(ground, [BALL])
    assert "block ball cannot cross measure line close" in remark and "0.5 m" in remark


def test_a_line_that_can_be_crossed_above_the_facing_only_says_how_high():
    """0.3 m before the facing a centroid 0.5 m from the surface is at the crest's height plus √(0.5² - 0.3²) m."""
    (remark,) = line_remarks(site(close=[[79.7, 0], [79.7, 30]]), [SLAB])
    assert "block slab can cross measure line close only 4.4 m or more above its foot" in remark


def test_usual_lines_are_not_remarked():
    """Upright from the ground, up a facing of 60 degrees, from above the ground, and a sloping one."""
    lines = {"ditch": [[70, 0], [70, 20]], "crest": [[80, 4], [80, 20]], "high": [[79.9, 6], [79.9, 20]],
             "slope": [[30, 20], [30, 40]], "across": [[30, 20], [40, 40]]}  # fmt: skip
    assert not line_remarks(site(**lines), [BALL, SLAB])
    points = [[0, 0], [10, 0], [12, 2 * np.sqrt(3)], [14, 2 * np.sqrt(3)]]
    inclined = CrossSection(points, ["ditch", "facing", "crest"], {"low": [[11, np.sqrt(3)], [11, 9]]})
    assert not line_remarks(inclined, [BALL, SLAB])
