"""Trajectories on the cross-section: a panel for each block, names beside lines and zones."""

from dataclasses import replace

import pytest
from matplotlib.collections import LineCollection

from rock2d.graphics.trajectories import STOP_MARKERS, trajectories_figure
from rock2d.records.columns import STOPS
from tests.graphics.flights import BLOCKS, FLOOR, flight


def test_trajectories_have_a_panel_a_block_with_every_release_on_it():
    tracks = [flight("ball", i, 1 + 0.1 * i) for i in range(3)] + [flight("cube", 0)]
    figure = trajectories_figure(FLOOR, BLOCKS, tracks, "two blocks")
    assert [a.get_title(loc="left") for a in figure.axes] == ["ball, 3 releases", "cube, 1 release"]
    (ways,) = (c for c in figure.axes[0].collections if isinstance(c, LineCollection))
    assert [len(way) > 100 for way in ways.get_segments()] == [True] * 3
    assert [way[-1, 0] for way in ways.get_segments()] == pytest.approx([0.4, 0.44, 0.48])
    for axis in figure.axes:
        assert axis.get_aspect() == 1.0
        assert {t.get_text() for t in axis.texts} >= {"floor", "gate"}


@pytest.mark.parametrize("stop", STOPS)
def test_every_stop_has_a_mark_and_an_entry_of_the_legend(stop):
    figure = trajectories_figure(FLOOR, BLOCKS, [replace(flight("ball", 0), stop=stop)])
    assert [text.get_text() for text in figure.legends[0].get_texts()] == [STOP_MARKERS[stop][1]]
