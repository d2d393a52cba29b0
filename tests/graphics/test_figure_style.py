"""Figures are written whole, and names from files are plain text in them."""

import numpy as np
import pytest

from rock2d.diagnosis.report.figures import Misses, section_figure
from rock2d.errors import InputError
from rock2d.graphics.figure_style import save_figure
from rock2d.graphics.overlays import overlay_figure, residuals_figure
from rock2d.graphics.trajectories import trajectories_figure
from rock2d.scene.blocks import make_block
from rock2d.scene.cross_section import CrossSection
from tests.graphics.flights import BLOCKS, FLOOR, flight, rows_of


def test_a_figure_is_saved_whole_or_not_at_all(tmp_path):
    figure = trajectories_figure(FLOOR, BLOCKS, [flight("ball", 0)])
    for suffix in ("png", "pdf"):
        assert save_figure(figure, tmp_path / f"a.{suffix}", dpi=60).stat().st_size > 1000
    with pytest.raises(InputError, match=r"\.doc"):
        save_figure(figure, tmp_path / "a.doc")
    figure.axes[0].set_title("\ud800")  # a character that cannot be drawn
    with pytest.raises((TypeError, UnicodeError)):
        save_figure(figure, tmp_path / "b.png")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.pdf", "a.png"]


def test_a_dollar_in_a_name_is_no_mathematics(tmp_path):
    floor = CrossSection([[-2, 0], [2, 0]], ["a$_{b$"], {"$^{g$": [[0.5, 0], [0.5, 0.4]]})
    name = "ball$\\frac$"
    block = make_block(name, "circle", 0.02, "solid_sphere", diameter_m=0.05)
    track = flight(name, 0)
    way = track.states(np.array([0.0, 0.4]))[:, :2]
    figures = (
        trajectories_figure(floor, {name: block}, [track], "$x^$"),
        overlay_figure(floor, {name: block}, rows_of(track), [track], title="$x^$"),
        residuals_figure(rows_of(track).assign(dx_m=0.1, dy_m=0.0, dtheta_rad=0.0), "$x^$"),
        section_figure(
            floor, {name: block, "$^_$": block}, [way], Misses(way, np.zeros(2, int), np.ones(2)), {"a$_{b$": 1.0}
        ),
    )
    for k, figure in enumerate(figures):
        assert save_figure(figure, tmp_path / f"{k}.png", dpi=60).stat().st_size > 1000
