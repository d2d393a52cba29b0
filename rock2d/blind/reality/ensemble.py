"""Many releases on a set-up, in parallel."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numba
import numpy as np

from rock2d.blind.reality.data_model import Array, Block, Hidden, Setup, Soil
from rock2d.blind.reality.ground import CONVEX, patches, turns
from rock2d.blind.reality.motion import CENTROID_X, CENTROID_Y, release
from rock2d.blind.reality.motion_inputs import setting_of, stiffening

IMPACTS = 64  # with draws of their own; later ones share the last
STEEPEST_TILT = 0.3  # rad


def fall(
    setup: Setup,
    law: Soil,
    blocks: Sequence[Block],
    block_ids: Array,
    states: Array,
    order: Array,
    times_s: Array,
    *,
    gravity_m_s2: float,
    soil_sd: Array,
    hidden: Sequence[Hidden],
    seed: int,
) -> Array:
    """(n, frames, 3) true poses x, y, theta of the centroid at the camera's instants.

    states : (n, 6) of the centroid at the first instant: x, y, theta, vx, vy, omega in SI
    order : (n,) how many releases of the same block were before
    times_s : the instants that the camera states; with a frame-rate error those of the poses differ
    soil_sd : (5,) standard deviations of the logarithms of k_l, k_ul / k_l, k_t, mu, k_r, drawn anew for each impact;
        the draws depend on `seed`, the release and the impact alone
    """
    states = np.array(np.atleast_2d(states), float)
    n = len(states)
    order = np.asarray(order, float)
    world = setting_of(setup, law, blocks, hidden)
    factors, tilts, shares = _luck(n, np.asarray(soil_sd, float), hidden, seed)
    slopes = np.diff(world.points, axis=0)
    room = min(STEEPEST_TILT, np.deg2rad(88.0) - np.abs(np.arctan2(slopes[:, 1], slopes[:, 0])).max())
    tilts = np.clip(tilts, -room, room)  # no facet overhangs when the ground is tilted
    soil = np.repeat(world.soil[None], n, axis=0)
    soil[:, :, :2] *= stiffening(hidden, order)[:, None, None]
    bodies = np.array(world.bodies)
    ids = np.asarray(block_ids, np.int64)
    for i in range(n):
        body, (_, _, theta, _, _, omega) = bodies[ids[i]], states[i]
        c, s = np.cos(theta), np.sin(theta)
        dx = c * body[CENTROID_X] - s * body[CENTROID_Y]
        dy = s * body[CENTROID_X] + c * body[CENTROID_Y]
        states[i, :2] -= dx, dy  # the centroid lies at (dx, dy) from the centre of mass
        states[i, 3:5] -= -omega * dy, omega * dx
    counts = np.array([len(corners) for corners in world.corners])
    corners = np.zeros((len(blocks), counts.max(), 2))
    for i, own in enumerate(world.corners):
        corners[i, : counts[i]] = own
    ridges = (turns(world.points) < -CONVEX).astype(float)
    poses = np.full((n, len(times_s), 3), np.nan)
    _releases(
        states, _true_times(np.asarray(times_s, float), n, hidden, seed), world.points, world.zone,
        patches(world.points), ridges, world.yielding, corners, counts, bodies, ids, soil, world.indentation,
        float(gravity_m_s2), factors, tilts, shares, world.dial, poses,
    )  # fmt: skip
    return poses


def _true_times(times: Array, n: int, hidden: Sequence[Hidden], seed: int) -> Array:
    """(n, frames) the instants at which the camera really takes its frames."""
    true = np.repeat(times[None], n, axis=0)
    for effect in hidden:
        if effect.name == "frame_rate_error":
            frame = float(np.median(np.diff(times)))
            late = np.array(
                [np.random.default_rng([seed, i, 3]).uniform(-0.45, 0.45, len(times)) for i in range(n)]
            )
            late[:, 0] = 0.0
            true = times[0] + effect.values["factor"] * (
                true - times[0] + effect.values["jitter"] * frame * late
            )
    return true


def _luck(n: int, sd: Array, hidden: Sequence[Hidden], seed: int) -> tuple[Array, Array, Array]:
    """For each impact: factors on the soil (n, 64, 5), tilt of the ground in rad and share of speed lost (n, 64)."""
    values = {effect.name: effect.values for effect in hidden}
    rough = values.get("surface_roughness", {})
    tilt_sd = 0.0 if "spacing_m" in rough else rough.get("sd_rad", 0.0)
    leaves = values.get("out_of_plane", {"share": 0.0, "random": 0.0})
    factors, tilts, shares = np.ones((n, IMPACTS, 5)), np.zeros((n, IMPACTS)), np.zeros((n, IMPACTS))
    for i in range(n):
        factors[i] = np.exp(sd * np.random.default_rng([seed, i, 0]).normal(size=(IMPACTS, 5)))
        tilts[i] = tilt_sd * np.random.default_rng([seed, i, 1]).normal(size=IMPACTS)
        luck = np.random.default_rng([seed, i, 2]).uniform(0.0, 2.0, IMPACTS)
        shares[i] = leaves["share"] * (luck if leaves["random"] > 0.0 else 1.0)
    return factors, tilts, shares


def _compiled(sources: int) -> Any:
    """The loop over releases, kept on disk under the fingerprint of all `sources`: numba alone would go on using
    what it compiled before a function of another file was edited."""

    @numba.njit(cache=True, parallel=True)
    def releases(
        states: Array, times: Array, points: Array, zone: Array, patch: Array, ridges: Array, yielding: Array,
        corners: Array, counts: Array, bodies: Array, ids: Array, soil: Array, indentation: bool, gravity: float,
        factors: Array, tilts: Array, shares: Array, dial: Array, poses: Array,
    ) -> None:  # fmt: skip
        if sources == 0:
            return
        for i in numba.prange(len(states)):
            b = ids[i]
            release(
                states[i], times[i], points, zone, patch, ridges, yielding, corners[b, : counts[b]], bodies[b], soil[i],
                indentation, gravity, factors[i], tilts[i], shares[i], dial, poses[i],
            )  # fmt: skip

    return releases


def _fingerprint() -> int:
    digest = hashlib.sha256(numba.__version__.encode())
    for source in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(source.read_bytes())
    return 1 + int(digest.hexdigest()[:12], 16)


_releases = _compiled(_fingerprint())
