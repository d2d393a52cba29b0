"""Films of many releases in one world: their motion, in parallel, and what a camera with its flaws records of it."""

import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numba
import numpy as np

from rock2d.blind.reality.catalogue import CAUSES
from rock2d.blind.reality.cause import View
from rock2d.blind.reality.compiled_records import (
    CENTROID_X,
    CENTROID_Y,
    GROUP,
    INERTIA,
    MASS,
    REACH,
    ROUNDING,
    SIZE,
    Body,
    Ground,
    ImpactDraws,
    MotionInputs,
    SoilLaw,
)
from rock2d.blind.reality.data_model import Array, Camera, Hidden, Releases, World
from rock2d.blind.reality.motion import simulate_release
from rock2d.blind.reality.motion_inputs import motion_inputs, stiffening

IMPACTS_WITH_OWN_DRAWS = 64  # later ones share the last
LARGEST_TILT_RAD = 0.3


def simulate_poses(
    world: World, releases: Releases, times_s: Array, *, soil_sd: Array, hidden: Sequence[Hidden], seed: int
) -> Array:
    """(n, frames, 3) true poses x, y, theta of the centroid at the instants of the camera.

    times_s : the instants that the camera states; with a frame-rate error those of the poses differ
    soil_sd : (5,) standard deviations of the logarithms of k_l, k_ul / k_l, k_t, mu, k_r, drawn for each impact;
        the draws depend on `seed`, the release and the impact alone"""
    n = len(np.atleast_2d(releases.states))
    inputs = motion_inputs(world, hidden)
    draws = _impact_draws(n, np.asarray(soil_sd, float), hidden, seed, inputs.ground.points)
    soil = np.repeat(inputs.law.soil[None], n, axis=0)
    soil[:, :, :2] *= stiffening(hidden, np.asarray(releases.order, float))[:, None, None]
    ids = np.asarray(releases.block_ids, np.int64)
    states = _states_of_mass_centres(np.array(np.atleast_2d(releases.states), float), inputs.bodies[ids])
    times = _true_times(np.asarray(times_s, float), n, hidden, seed)
    poses = np.full((n, len(times_s), 3), np.nan)
    _simulate_releases(states, times, ids, soil, inputs, draws, poses)
    return poses


def _states_of_mass_centres(states: Array, bodies: Array) -> Array:
    """States (n, 6) of the centres of mass from those of the centroids, in place."""
    for state, body in zip(states, bodies, strict=True):
        _, _, theta, _, _, omega = state
        c, s = np.cos(theta), np.sin(theta)
        dx = c * body[CENTROID_X] - s * body[CENTROID_Y]
        dy = s * body[CENTROID_X] + c * body[CENTROID_Y]
        state[:2] -= dx, dy  # the centroid lies at (dx, dy) from the centre of mass
        state[3:5] -= -omega * dy, omega * dx
    return states


def _true_times(times: Array, n: int, hidden: Sequence[Hidden], seed: int) -> Array:
    """(n, frames) the instants at which the camera really takes its frames."""
    true = np.repeat(times[None], n, axis=0)
    for cause in hidden:
        if cause.name == "frame_rate_error":
            frame = float(np.median(np.diff(times)))
            late = np.array([np.random.default_rng([seed, i, 3]).uniform(-0.45, 0.45, len(times)) for i in range(n)])
            late[:, 0] = 0.0
            true = times[0] + cause.values["factor"] * (true - times[0] + cause.values["jitter"] * frame * late)
    return true


def _impact_draws(n: int, sd: Array, hidden: Sequence[Hidden], seed: int, points: Array) -> ImpactDraws:
    """Draws of each impact of n releases: soil factors (n, 64, 5), tilts of the ground and shares of speed (n, 64)."""
    values = {cause.name: cause.values for cause in hidden}
    rough = values.get("surface_roughness", {})
    tilt_sd = 0.0 if "profile" in rough else rough.get("sd_rad", 0.0)
    out_of_plane = values.get("out_of_plane", {"share": 0.0, "random": 0.0})
    shape = (n, IMPACTS_WITH_OWN_DRAWS)
    factors, tilts, losses = np.ones((*shape, 5)), np.zeros(shape), np.zeros(shape)
    for i in range(n):
        factors[i] = np.exp(sd * np.random.default_rng([seed, i, 0]).normal(size=(IMPACTS_WITH_OWN_DRAWS, 5)))
        tilts[i] = tilt_sd * np.random.default_rng([seed, i, 1]).normal(size=IMPACTS_WITH_OWN_DRAWS)
        random = np.random.default_rng([seed, i, 2]).uniform(0.0, 2.0, IMPACTS_WITH_OWN_DRAWS)
        losses[i] = out_of_plane["share"] * (random if out_of_plane["random"] > 0.0 else 1.0)
    slopes = np.diff(points, axis=0)
    steepest = np.abs(np.arctan2(slopes[:, 1], slopes[:, 0])).max()
    limit = min(LARGEST_TILT_RAD, np.deg2rad(88.0) - steepest)  # a tilted facet must not overhang
    return ImpactDraws(factors, np.clip(tilts, -limit, limit), losses)


def _compiled(sources: int) -> Any:
    """The loop over releases, cached on disk by the fingerprint of all `sources`.

    Numba alone does not notice that a function in another file was edited."""

    @numba.njit(cache=True, parallel=True)
    def releases(
        states: Array, times: Array, ids: Array, soil: Array, inputs: MotionInputs, draws: ImpactDraws, poses: Array
    ) -> None:
        if sources == 0:
            return
        # a parallel loop of numba takes arrays and numbers alone: tuples are taken apart before it
        points, zone, patch, ridges, yielding = inputs.ground
        corners, counts, bodies = inputs.corners, inputs.corner_counts, inputs.bodies
        indentation, gravity, values = inputs.law.indentation, inputs.law.gravity, inputs.law.values
        factors, tilts, losses = draws
        for i in numba.prange(len(states)):
            b = ids[i]
            row = bodies[b]
            body = Body(
                corners[b, : counts[b]], row[MASS], row[INERTIA], row[REACH], row[ROUNDING], row[CENTROID_X],
                row[CENTROID_Y], int(row[GROUP]), row[SIZE],
            )  # fmt: skip
            simulate_release(
                states[i], times[i], Ground(points, zone, patch, ridges, yielding), body,
                SoilLaw(soil[i], indentation, gravity, values), ImpactDraws(factors[i], tilts[i], losses[i]), poses[i],
            )  # fmt: skip

    return releases


def _fingerprint() -> int:
    digest = hashlib.sha256(numba.__version__.encode())
    for source in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(source.read_bytes())
    return 1 + int(digest.hexdigest()[:12], 16)


_simulate_releases = _compiled(_fingerprint())


def record_poses(poses: Array, times_s: Array, camera: Camera, hidden: Sequence[Hidden], seed: int) -> Array:
    """The recording of true poses (n, frames, 3) at the stated instants.

    A frame-rate error acts on the true poses already, see `simulate_poses`: the recording keeps the stated instants."""
    record = np.array(poses, float)
    view = View(np.array(times_s, float), np.asarray(camera.centre_m, float), camera.extent_m, seed)
    # an axis is mirrored by software, after the lens
    for cause in sorted(hidden, key=lambda own: own.name == "mirrored_axis"):
        recorded = CAUSES[cause.name].recorded
        if recorded is not None:
            record = recorded(record, view, cause.values)
    sd = np.array([camera.position_noise_m, camera.position_noise_m, camera.angle_noise_rad])
    for i, release in enumerate(record):
        rng = np.random.default_rng([seed, i, 11])
        release += sd * _correlated(rng.normal(size=release.shape), camera.noise_correlation)
        release[rng.random(len(release)) < camera.lost] = np.nan
    return record


def _correlated(white: Array, correlation: float) -> Array:
    """Noise (frames, 3) of unit variance with this correlation from frame to frame."""
    if correlation == 0.0:
        return white
    noise = white.copy()
    for k in range(1, len(noise)):
        noise[k] = correlation * noise[k - 1] + np.sqrt(1.0 - correlation**2) * white[k]
    return noise
