"""The contact law integrated by scipy, with its changes of regime as events: knows nothing of the engines.

One smooth contact of a circle on a horizontal plane. Only the force functions of `rock2d.laws.contact` are shared
with the engines; steps, memory and events are not.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

from rock2d.laws.contact import (
    K_L,
    K_R,
    K_T,
    K_UL,
    MU,
    ROLLING_CAP,
    ROLLING_IN_INDENTATION,
    ContactParameters,
    normal_force,
    residual_indentation,
    rolling_moment,
    tangential_force,
)

DEPTH, RATE, V_T, OMEGA, STRETCH, ROTATION = range(6)


@dataclass(frozen=True)
class Rebound:
    """What a contact made of the velocities, and how it went."""

    v_n_m_s: float
    v_t_m_s: float
    omega_rad_s: float
    time_s: float
    penetration_m: float
    residual_indentation_m: float
    peak_force_N: float


def rebound(
    law: ContactParameters,
    mass_kg: float,
    inertia_kg_m2: float,
    radius_m: float,
    v_n_m_s: float,
    v_t_m_s: float = 0.0,
    omega_rad_s: float = 0.0,
    gravity_m_s2: float = 0.0,
) -> Rebound:
    """One contact from first touch to the instant at which the ground presses no more (v_n > 0 is inward)."""
    p = law.row()

    def force_n(y, peak):
        return normal_force(y[DEPTH], max(peak, y[DEPTH]) if peak is not None else y[DEPTH], p[K_L], p[K_UL])

    def rates(peak, slip):
        def f(_, y):
            n = force_n(y, peak)
            t = tangential_force(slip * np.inf if slip else y[STRETCH], n, p[K_T], p[MU])
            moment = rolling_moment(
                y[ROTATION], n, radius_m, p[K_R], p[ROLLING_CAP], p[ROLLING_IN_INDENTATION]
            )
            u = y[V_T] + radius_m * y[OMEGA]
            return [
                y[RATE],
                gravity_m_s2 - n / mass_kg,
                -t / mass_kg,
                (-t * radius_m - moment) / inertia_kg_m2,
                u,
                y[OMEGA],
            ]

        return f

    def sticks_longer(peak, slip):
        """> 0 while a slipping spring is driven harder than its limit grows."""
        stiffness = p[K_L] if peak is None else p[K_UL]

        def f(_, y):
            u = y[V_T] + radius_m * y[OMEGA]
            return p[K_T] * slip * u - p[MU] * stiffness * y[RATE]

        f.terminal, f.direction = True, -1
        return f

    def limit(peak):
        def f(_, y):
            return p[K_T] * abs(y[STRETCH]) - p[MU] * force_n(y, peak)

        f.terminal, f.direction = True, 1
        return f

    def deepest(_, y):
        return y[RATE]

    def lifted(_, y):
        return y[DEPTH] - residual_indentation(deep, p[K_L], p[K_UL])

    deepest.terminal, deepest.direction = True, -1
    lifted.terminal, lifted.direction = True, -1
    y, time, deep, peak = np.array([0, v_n_m_s, v_t_m_s, omega_rad_s, 0, 0.0]), 0.0, 0.0, None
    u = v_t_m_s + radius_m * omega_rad_s
    slip = float(np.sign(u)) if p[K_T] * abs(u) > p[MU] * p[K_L] * v_n_m_s else 0.0
    longest = 10 * (mass_kg / p[K_L]) ** 0.5
    for _ in range(50):
        turning = deepest if peak is None else lifted
        friction = sticks_longer(peak, slip) if slip else limit(peak)
        events = [turning, friction] if 0.0 < p[MU] < np.inf else [turning]
        out = solve_ivp(
            rates(peak, slip), (time, time + longest), y, "DOP853", events=events, rtol=1e-12, atol=1e-15
        )
        time, y = out.t[-1], out.y[:, -1]
        if slip and p[MU] > 0.0:
            y[STRETCH] = slip * p[MU] * force_n(y, peak) / p[K_T]
        if len(out.t_events[0]):
            if peak is None:
                deep = peak = y[DEPTH]
            else:
                return Rebound(
                    -y[RATE],
                    y[V_T],
                    y[OMEGA],
                    time,
                    deep,
                    residual_indentation(deep, p[K_L], p[K_UL]),
                    p[K_L] * deep,
                )
        else:
            assert len(out.t_events[1]), "the contact neither turned nor changed its regime"
            slip = 0.0 if slip else float(np.sign(y[STRETCH]))
    raise AssertionError("no end of changes between sticking and slipping")
