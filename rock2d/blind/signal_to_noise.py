"""Signal-to-noise of what a case hides: how far it stands above noise, soil and all that is free in any fit.

Every release is run to a little after its first impact with and without what is hidden, with each of the five
parameters of the law and each of its six incident values changed, and without the soil's scatter. What the camera would
record of each run is reduced to statistics: position and velocity before and after the first impact, and how the first
flight bends. Differences are divided by the standard deviation that noise and soil give them; what other incident
states and other parameters of the law could mimic is projected out. The length of what remains is the signal-to-noise:
standard errors by which the best linear test would see the effect.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from rock2d.blind import reality
from rock2d.blind.cases import Case

Array = np.ndarray

SHIFT = (
    0.003  # relative change of a parameter of the law, or of an incident value in units of the block's scale
)
AFTER = 3.0  # of the first impact: how long the flight after is looked at, in √(size / g)
ENOUGH = 40  # releases that are looked at; the result is that of all
STRENGTHS = (0.1, 0.5)  # of the largest plausible size, at which another effect is held against a case
SOILS = 8  # draws of the soil that its scatter is read from
SHRINK = 0.3  # of the covariance that so few draws give, toward its diagonal
CLIP = 30.0  # standard deviations that one statistic may count: other ways than the linear one lead farther


def signal_to_noise(case: Case) -> float:
    """Standard errors by which what is hidden shows in the first flights and impacts of all releases; 0 for nothing."""
    return float(np.linalg.norm(signatures(case, [case.hidden])[0])) if case.hidden else 0.0


def likeness(case: Case, name: str) -> float:
    """|cos| of the angle between the signature of what a case hides and that of the effect `name`, in that of its forms
    which is the more alike; 1: nothing that is free in a fit tells them apart here, 0: nothing confuses them."""
    rng = np.random.default_rng(case.seed)
    others = [
        [reality.draw(name, form, rng, case.setup, case.law, case.blocks, case.gravity_m_s2, strength)]
        for form in range(reality.FORMS[name])
        for strength in STRENGTHS
    ]
    own, *rest = signatures(case, [case.hidden, *others])
    lengths = np.linalg.norm(rest, axis=1) * np.linalg.norm(own)
    return float(np.abs(np.asarray(rest) @ own / np.maximum(lengths, 1e-12)).max())


def signatures(case: Case, causes: Sequence[list[reality.Hidden]]) -> list[Array]:
    """What each cause shows in the statistics of all releases, in standard errors, less all that is free in a fit."""
    from rock2d.blind.case_files import record

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
    # the statistics are coefficients of orthonormal polynomials, with the noise of a frame; what is correlated from
    # frame to frame averages out less
    slow = np.sqrt((1.0 + case.colour) / (1.0 - case.colour))
    noise = slow * np.array([case.position_noise_m, case.position_noise_m, case.angle_noise_rad] * 5)
    even = statistics(record(case, times, [], noisy=False, soil_sd=np.zeros(5)))
    # a release near an edge of what may happen is scattered far more by the soil than its like
    others = [
        statistics(record(replace(case, seed=case.seed + k), times, [], noisy=False)) for k in range(1, SOILS)
    ]
    scattered = np.array([base, *others]) - even
    soil = np.empty_like(base)
    for b in np.unique(case.block_ids):
        own, square = case.block_ids == b, scattered[:, case.block_ids == b] ** 2
        soil[own] = np.sqrt(np.maximum(square.mean(axis=0), square.mean(axis=(0, 1))))
    sd = np.hypot(noise, soil)
    # and it moves all statistics of a release together
    z = (scattered / sd).transpose(1, 0, 2)
    together = (1.0 - SHRINK) * z.transpose(0, 2, 1) @ z / len(z[0])
    rest = np.maximum(1.0 - np.diagonal(together, axis1=1, axis2=2), 0.0)
    whiten = np.linalg.inv(np.linalg.cholesky(together + np.eye(base.shape[1]) * rest[:, None, :]))

    def whitened(film: Array) -> Array:
        z = np.clip((statistics(film) - base) / sd, -CLIP, CLIP)
        return np.asarray((whiten @ z[..., None])[..., 0])

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
    basis = np.column_stack(mimics)
    out = []
    for cause in causes:
        seen = projected(whitened(record(case, times, cause, noisy=False)))
        left = seen - basis @ np.linalg.lstsq(basis, seen, rcond=None)[0]
        out.append(left * np.sqrt(releases / len(chosen)))
    return out


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
