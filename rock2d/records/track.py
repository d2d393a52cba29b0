"""The motion of one release as an engine computed it: exact knots, impacts, and how it ended.

Between two knots a block is either in flight (on an exact parabola) or in contact (cubic Hermite interpolation of
positions and velocities of contact steps). All engines return tracks; measure lines, videos and figures read them."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from rock2d.arrays import Array
from rock2d.errors import counted
from rock2d.records.columns import I_ZONE, IMPACT_NAMES, INSTANT_VX, INSTANT_VY, INSTANT_X, INSTANT_Y, TIME


@dataclass(repr=False)
class Track:
    """One simulated release.

    Attributes
    ----------
    knots : (n, 7) rows t_s, x_m, y_m, theta_rad, vx_m_s, vy_m_s, omega_rad_s; times never decrease (an
        instantaneous rebound is two knots at one time)
    flight : (n,) bool, True where the block flies freely from this knot to the next
    impacts : one mapping for each impact, keys of IMPACT_NAMES; values after an impact that had not ended when the
        track stopped are NaN
    stop : "rest" | "exit" (left the cross-section) | "time" (time limit) | "impacts" (their limit) | "buried"
        (the centroid sank below the surface)
    energy_J : final energy balance, keys of ENERGY_NAMES; empty if the engine computes none
    gravity_m_s2 : gravity"""

    release: int
    block: str
    knots: Array
    flight: Array
    impacts: list[dict[str, Any]]
    stop: str
    gravity_m_s2: float
    energy_J: dict[str, float] = field(default_factory=dict)

    def __repr__(self) -> str:
        impacts = counted(len(self.impacts), "impact")
        return f"<Track of release {self.release}, {self.block}: {impacts}, {self.stop} after {self.end_s:.3g} s>"

    @property
    def end_s(self) -> float:
        """Time of the last knot."""
        return float(self.knots[-1, TIME])

    def shift_time(self, offset_s: float) -> None:
        """Add `offset_s` to all times."""
        self.knots[:, TIME] += offset_s
        for impact in self.impacts:
            impact["t_s"] += offset_s
            impact["t_after_s"] += offset_s

    def states(self, t_s: Array) -> Array:
        """States at times `t_s`, shape (m, 6): x, y, theta, vx, vy, omega. Before the first knot the flight
        is extended backwards; after the last the block stays where it stopped."""
        t = np.asarray(t_s, float)
        k = self.knots
        if len(k) == 1:
            out = np.repeat(k[:, 1:], t.size, axis=0)
            out[:, 3:] = np.where((t > k[0, TIME])[:, None], 0.0, out[:, 3:])
            return out
        i = np.clip(np.searchsorted(k[:, TIME], t, side="right") - 1, 0, len(k) - 2)
        before, free = t < k[-1, TIME], self.flight[i]
        out = np.empty((t.size, k.shape[1] - 1))
        flies, touches = np.flatnonzero(before & free), np.flatnonzero(before & ~free)
        a = k[i[flies]]
        out[flies] = ballistic(a, t[flies] - a[:, TIME], self.gravity_m_s2)
        out[touches] = _hermite(k[i[touches]], k[i[touches] + 1], t[touches])
        out[~before] = np.where(
            (t[~before] == k[-1, TIME])[:, None], k[-1, 1:], np.concatenate([k[-1, 1:4], np.zeros(3)])
        )
        return out

    def crossings(self, line: Array) -> Array:
        """States (m, 7: t first) at which the centroid crosses the segment `line` (2, 2), in order of time.

        Sums are written out, so that the compiled code of `point_mass` gives the same bits."""
        origin, along = line[0], line[1] - line[0]
        normal = np.array([-along[1], along[0]]) / np.hypot(*along)
        side = (self.knots[:, INSTANT_X] - origin[0]) * normal[0] + (self.knots[:, INSTANT_Y] - origin[1]) * normal[1]
        length2 = along[0] * along[0] + along[1] * along[1]
        found: list[Array] = []
        # only intervals in which the centroid comes as far as the line
        span = np.diff(self.knots[:, TIME])
        speed = np.hypot(self.knots[:-1, INSTANT_VX], self.knots[:-1, INSTANT_VY])
        near = np.abs(side[:-1]) <= 1.001 * (speed + self.gravity_m_s2 * span) * span
        reaches = (side[:-1] * side[1:] < 0.0) | ((side[:-1] == 0.0) & (side[1:] != 0.0))
        for i in np.flatnonzero(np.where(self.flight[: len(span)], near, reaches) & (span > 0.0)):
            a, b = self.knots[i], self.knots[i + 1]
            if self.flight[i]:
                across = a[INSTANT_VX] * normal[0] + a[INSTANT_VY] * normal[1]
                times = _roots(-0.5 * self.gravity_m_s2 * normal[1], across, side[i], span[i])
                states = ballistic(np.repeat(a[None], len(times), 0), np.array(times), self.gravity_m_s2)
            else:
                times = [span[i] * side[i] / (side[i] - side[i + 1])]
                states = _hermite(a[None], b[None], np.array(times) + a[TIME])
            for tau, state in zip(times, states, strict=True):
                at = ((state[0] - origin[0]) * along[0] + (state[1] - origin[1]) * along[1]) / length2
                if 0.0 <= at <= 1.0:
                    found.append(np.concatenate([[a[TIME] + tau], state]))
        return np.array(found).reshape(-1, 7)


def impact_mappings(rows: Iterable[Array], zones: Sequence[str]) -> list[dict[str, Any]]:
    """`Track.impacts` of rows (N_IMPACT,); `zones`: names by the ids that the rows hold."""
    return [{**dict(zip(IMPACT_NAMES, row.tolist(), strict=True)), "zone": zones[int(row[I_ZONE])]} for row in rows]


def ballistic(knot: Array, tau_s: Array, gravity_m_s2: float) -> Array:
    """States (m, 6) a time `tau_s` (m,) after `knot` (m, 7) in free flight: x + v t - g t²/2, exact."""
    tau = np.asarray(tau_s, float)[:, None]
    out = np.empty((len(knot), 6))
    out[:, :3] = knot[:, 1:4] + knot[:, 4:7] * tau
    out[:, 3:] = knot[:, 4:7]
    out[:, 1] -= 0.5 * gravity_m_s2 * tau[:, 0] ** 2
    out[:, 4] -= gravity_m_s2 * tau[:, 0]
    return out


def _hermite(a: Array, b: Array, t: Array) -> Array:
    span = np.where(b[:, TIME] > a[:, TIME], b[:, TIME] - a[:, TIME], 1.0)[:, None]
    s = (t - a[:, TIME])[:, None] / span
    p, q, v, w = a[:, 1:4], b[:, 1:4], a[:, 4:7] * span, b[:, 4:7] * span
    pos = p * (1 + 2 * s) * (1 - s) ** 2 + v * s * (1 - s) ** 2 + q * s * s * (3 - 2 * s) + w * s * s * (s - 1)
    vel = ((q - p) * 6 * s * (1 - s) + v * (1 - s) * (1 - 3 * s) + w * s * (3 * s - 2)) / span
    return np.concatenate([pos, vel], axis=1)


def _roots(a: float, b: float, c: float, span: float) -> list[float]:
    """Roots of a t² + b t + c in (0, span], in order; stable for small a."""
    if a == 0.0:
        roots = [] if b == 0.0 else [-c / b]
    else:
        disc = b * b - 4 * a * c
        if disc <= 0.0:
            return []
        q = -0.5 * (b + np.copysign(np.sqrt(disc), b))
        roots = sorted([q / a, c / q] if q != 0.0 else [0.0])
    return [float(r) for r in roots if 0.0 < r <= span]
