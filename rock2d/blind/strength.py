"""Signal-to-noise of what a case hides: how far it stands above noise, soil and all that is free in any fit.

Every release is run to a little after its first impact with and without what is hidden, with each of the five
parameters of the law and each of its six incident values changed, and without the soil's scatter. What the camera would
record of each run is reduced to statistics: position and velocity before and after the first impact, and how the first
flight bends. Differences are divided by the standard deviation that noise and soil give them; what other incident
states and other parameters of the law could mimic is projected out. The length of what remains is the signal-to-noise:
standard errors by which the best linear test would see the effect.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from rock2d.blind.cases import Case

Array = np.ndarray

SHIFT = (
    0.003  # relative change of a parameter of the law, or of an incident value in units of the block's scale
)
AFTER = 3.0  # of the first impact: how long the flight after is looked at, in √(size / g)
ENOUGH = 40  # releases that are looked at; the result is that of all
CLIP = 30.0  # standard deviations that one statistic may count: other ways than the linear one lead farther


def signal_to_noise(case: Case) -> float:
    """Standard errors by which what is hidden shows in the first flights and impacts of all releases; 0 for nothing."""
    if not case.hidden:
        return 0.0
    from rock2d.blind.writing import record

    chosen = np.flatnonzero(~case.heldout)
    releases, chosen = len(chosen), chosen[:: -(-len(chosen) // ENOUGH)]
    arrays = ("block_ids", "states", "order", "heldout")
    case = replace(case, **{name: getattr(case, name)[chosen] for name in arrays})
    times = np.arange(int(case.duration_s * case.fps)) / case.fps
    calm = record(case, times, [], noisy=False)
    touch = _touch(case, calm, times)
    size = 2 * np.array([b.radius_m for b in case.blocks])[case.block_ids]
    window = (AFTER * np.sqrt(size / case.gravity_m_s2) * case.fps).astype(int)
    last = min(len(times), int((touch + window).max()) + 2)
    times, calm = times[:last], calm[:, :last]

    def statistics(film: Array) -> Array:
        return np.array([_statistics(f, k, w) for f, k, w in zip(film, touch, window, strict=True)])

    base = statistics(calm)
    # the statistics are coefficients of orthonormal polynomials, with the noise of a frame
    noise = np.array([case.position_noise_m, case.position_noise_m, case.angle_noise_rad] * 5)
    even = statistics(record(case, times, [], noisy=False, soil_sd=np.zeros(5)))
    soil = np.empty_like(base)
    for b in np.unique(case.block_ids):
        own = case.block_ids == b
        soil[own] = np.sqrt(np.mean((base[own] - even[own]) ** 2, axis=0))
    sd = np.hypot(noise, soil)

    def whitened(film: Array) -> Array:
        return np.clip((statistics(film) - base) / sd, -CLIP, CLIP)

    def shown(**changes: Any) -> Array:
        return whitened(record(replace(case, **changes), times, [], noisy=False))

    pace = np.sqrt(case.gravity_m_s2 * size)
    units = SHIFT * np.column_stack([size, size, np.ones_like(size), pace, pace, pace / size])
    starts = [shown(states=case.states + units * (np.arange(6) == k)) for k in range(6)]
    incident, _ = np.linalg.qr(
        np.stack(starts, axis=-1)
    )  # (releases, 15, 6) what a release's own start can mimic

    def projected(z: Array) -> Array:
        return (z - (incident @ (incident.transpose(0, 2, 1) @ z[..., None]))[..., 0]).ravel()

    mimics = []
    for name in ("k_l", "k_ul", "k_t", "mu", "k_r"):
        law = replace(case.law, **{name: getattr(case.law, name) * (1 + SHIFT)})
        mimics.append(projected(shown(law=law)))
    basis, seen = np.column_stack(mimics), projected(whitened(record(case, times, case.hidden, noisy=False)))
    left = seen - basis @ np.linalg.lstsq(basis, seen, rcond=None)[0]
    return float(np.linalg.norm(left) * np.sqrt(releases / len(chosen)))


def _touch(case: Case, film: Array, times: Array) -> Array:
    """(releases,) first frame at which a release is no longer in free flight."""
    t = times[:, None]
    x, v = case.states[:, None, :3], case.states[:, None, 3:]
    fall = x + v * t - 0.5 * case.gravity_m_s2 * t**2 * np.array([0.0, 1.0, 0.0])
    radius = np.array([b.radius_m for b in case.blocks])[case.block_ids][:, None]
    off = np.hypot(film[..., 0] - fall[..., 0], film[..., 1] - fall[..., 1]) > 1e-3 * radius
    return np.where(off.any(axis=1), off.argmax(axis=1), len(times) - 1)


def _statistics(film: Array, touch: int, window: int) -> Array:
    """(15,) mean, slope and bend of x, y, theta before the impact; mean and slope in the second half of the window
    after it."""
    before, after = film[:touch], film[touch + window // 2 : touch + window + 2]
    first = _basis(len(before), 2).T @ before if len(before) > 4 else np.zeros((3, 3))
    second = _basis(len(after), 1).T @ after if len(after) > 2 else np.zeros((2, 3))
    return np.concatenate([first.ravel(), second.ravel()])


def _basis(n: int, degree: int) -> Array:
    t = np.linspace(-1.0, 1.0, n)
    q, r = np.linalg.qr(np.vander(t, degree + 1, increasing=True))
    return q * np.sign(np.diag(r))
