"""Releases without arcs do not shift the blocks of the others."""

from rock2d_tracking.release_order import releases_shown

STATED = [500.0, 500.0, 360.0, 360.0, 800.0]


def test_what_was_seen_gets_the_releases_of_its_size_in_their_order():
    assert releases_shown([490.0, 370.0, 790.0], STATED) == [0, 2, 4]
    assert releases_shown([350.0, 365.0], STATED) == [2, 3]
    assert releases_shown([520.0, 510.0, 340.0, 370.0, 760.0], STATED) == [0, 1, 2, 3, 4]
    assert releases_shown([790.0, 350.0], STATED) == [0, 2]  # no order has the large one before the small one
    assert releases_shown([], STATED) == []
