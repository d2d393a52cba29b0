"""Thinned paths: close to the tracks, few points, and the same when they are unpacked as the script of a page does."""

import base64
import zlib

import numpy as np
import pytest

import rock2d
from rock2d.graphics.live_data import STEPS
from rock2d.graphics.thinned_paths import ThinnedPaths, thinned_paths
from tests.scenarios_of_tests import small_site


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return rock2d.run(small_site(tmp_path_factory.mktemp("thinned"), unknown=""), releases=5)


def places(thinned: ThinnedPaths, path: int, t_s, gravity: float):
    """(m, 2) places of a path at times, between its points as the script draws them."""
    first = int(thinned.counts[:path].sum())
    own = slice(first, first + thinned.counts[path])
    t, x, y = thinned.instants[own].T
    i = np.clip(np.searchsorted(t, t_s, side="right") - 1, 0, len(t) - 2)
    lasts = t[i + 1] - t[i]
    share = np.divide(t_s - t[i], lasts, out=np.ones_like(t_s), where=lasts > 0)
    sag = np.where(thinned.arc[own][i], 0.5 * gravity * lasts**2 * share * (1 - share), 0.0)
    return np.column_stack([x[i] + share * (x[i + 1] - x[i]), y[i] + share * (y[i + 1] - y[i]) + sag])


@pytest.mark.parametrize("tolerance_m", [0.02, 0.2])
def test_paths_stay_near_their_tracks_at_every_time(run, tolerance_m):
    thinned = thinned_paths(run.tracks, tolerance_m)
    assert len(thinned.counts) == len(run.tracks) and thinned.arc.any()
    assert thinned.counts.sum() < 0.1 * sum(len(track.knots) for track in run.tracks)
    for path, track in enumerate(run.tracks):
        t = np.linspace(track.knots[0, 0], track.end_s, 999)
        miss = np.hypot(*(places(thinned, path, t, track.gravity_m_s2) - track.states(t)[:, :2]).T)
        assert miss.max() < 3.0 * tolerance_m


def test_packed_points_are_those_that_were_packed(run):
    thinned = thinned_paths(run.tracks, 0.1).subset([1, 3])
    assert len(thinned.counts) == 2
    text, scales = thinned.packed()
    rows = np.frombuffer(zlib.decompress(base64.b64decode(text)), np.uint8).reshape(7, -1).astype(np.int64)
    for (low, span), high_byte, low_byte, column in zip(
        scales, rows[:6:2], rows[1:6:2], thinned.instants.T, strict=True
    ):
        steps = np.cumsum(256 * high_byte + low_byte) % (STEPS + 1)
        assert low + span * steps / STEPS == pytest.approx(column, abs=span / STEPS)
    assert (rows[6] == thinned.arc).all()
