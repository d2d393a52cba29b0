"""Figures show the numbers that they were given."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from rock2d.errors import InputError
from rock2d.graphics.plots import (
    energy_figure,
    overlay_figure,
    residuals_figure,
    save_figure,
    trajectories_figure,
)
from rock2d.records.track import Track
from rock2d.scene.blocks import make_block
from rock2d.scene.cross_section import CrossSection

G = 9.81
FLOOR = CrossSection([[-2, 0], [2, 0]], ["floor"], {"gate": [[0.5, 0], [0.5, 0.4]]})
BLOCKS = {
    "ball": make_block("ball", "circle", 0.02, "solid_sphere", diameter_m=0.05),
    "cube": make_block("cube", "square", 0.02, side_m=0.04),
}


def flight(block: str, release: int, vx_m_s: float = 1.0, seconds: float = 0.4) -> Track:
    """A free flight from 1 m."""
    start = np.array([0.0, 0.0, 1.0, 0.2, vx_m_s, 0.0, 3.0])
    t = seconds
    end = [t, vx_m_s * t, 1 - 0.5 * G * t * t, 0.2 + 3 * t, vx_m_s, -G * t, 3.0]
    return Track(release, block, np.array([start, end]), np.array([True, True]), [], "exit", G)


def rows_of(track: Track, dx_m: float = 0.0) -> pd.DataFrame:
    t = np.arange(0, 0.4, 0.01)
    x, y, theta = track.states(t)[:, :3].T
    columns = {"t_s": t, "x_m": x - dx_m, "y_m": y, "theta_rad": theta}
    return pd.DataFrame({"release": track.release, "block": track.block, **columns})


def test_trajectories_have_a_panel_a_block_with_every_release_on_it():
    tracks = [flight("ball", i, 1 + 0.1 * i) for i in range(3)] + [flight("cube", 0)]
    figure = trajectories_figure(FLOOR, BLOCKS, tracks, "two blocks")
    assert [a.get_title(loc="left") for a in figure.axes] == ["ball, 3 releases", "cube, 1 release"]
    long_lines = [line for line in figure.axes[0].lines if len(line.get_xdata()) > 100]
    assert [line.get_xdata()[-1] for line in long_lines] == pytest.approx([0.4, 0.44, 0.48])
    for axis in figure.axes:
        assert axis.get_aspect() == 1.0
        assert {t.get_text() for t in axis.texts} >= {"floor", "gate"}


def test_overlay_takes_the_closest_and_the_farthest_release():
    tracks = [flight("ball", i) for i in range(21)]
    measured = pd.concat([rows_of(t, dx_m=1e-3 * t.release) for t in tracks])
    figure = overlay_figure(FLOOR, BLOCKS, measured, tracks)
    titles = [a.get_title().split("\n") for a in figure.axes[:4]]
    assert [t[0] for t in titles] == [
        "release 0, closest", "release 10, median", "release 18, 90th percentile", "release 20, farthest"
    ]  # fmt: skip
    assert [t[1] for t in titles] == [f"rms distance {d:.1f} mm" for d in (0, 10, 18, 20)]
    chosen = overlay_figure(FLOOR, BLOCKS, measured, tracks, releases=[4, 7])
    assert [a.get_title().split("\n")[0] for a in chosen.axes[:2]] == ["release 4", "release 7"]
    with pytest.raises(InputError, match="99"):
        overlay_figure(FLOOR, BLOCKS, measured, tracks, releases=[99])
    with pytest.raises(InputError, match="no measured release"):
        overlay_figure(FLOOR, BLOCKS, measured.assign(release=500), tracks)


def test_residuals_show_the_median_since_each_release_began():
    parts = []
    for release in range(11):
        t = 5.0 * release + np.arange(20) * 0.004  # every release starts at another time of the clock
        parts.append(
            pd.DataFrame(
                {
                    "release": release,
                    "block": "cube",
                    "t_s": t,
                    "dx_m": 1e-3 * release,
                    "dy_m": 0.0,
                    "dtheta_rad": 0.1 * release * np.arange(20) / 19,
                }
            )
        )
    figure = residuals_figure(pd.concat(parts))
    x_median, _, theta_median = (axis.lines[0].get_xydata() for axis in figure.axes[:3])
    assert x_median[:, 0] == pytest.approx(np.arange(20) * 0.004)
    assert x_median[:, 1] == pytest.approx(np.full(20, 5.0))  # mm
    assert theta_median[-1, 1] == pytest.approx(0.5)
    counts = [patch.get_height() for patch in figure.axes[3].patches]
    assert sum(counts) == 11
    with pytest.raises(InputError, match="no residuals"):
        residuals_figure(pd.concat(parts).iloc[:0])


def test_energy_of_a_free_flight_is_level():
    axis = energy_figure(flight("ball", 0), BLOCKS["ball"]).axes[0]
    total = next(line for line in axis.lines if line.get_label() == "sum").get_ydata()
    assert total == pytest.approx(np.full(len(total), total[0]), rel=1e-12)
    assert total[0] > 0


def test_a_figure_is_saved_whole_or_not_at_all(tmp_path):
    figure = trajectories_figure(FLOOR, BLOCKS, [flight("ball", 0)])
    for suffix in ("png", "pdf"):
        assert save_figure(figure, tmp_path / f"a.{suffix}", dpi=60).stat().st_size > 1000
    with pytest.raises(InputError, match=r"\.doc"):
        save_figure(figure, tmp_path / "a.doc")
    figure.axes[0].set_title("$\\broken$")  # drawing fails midway
    with pytest.raises(ValueError, match="broken"):
        save_figure(figure, tmp_path / "b.png")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.pdf", "a.png"]
