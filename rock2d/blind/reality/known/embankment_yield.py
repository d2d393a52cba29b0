"""Yielding embankment: it slides on a base with friction, or moves on a spring with a dashpot."""

from rock2d.blind.reality import parameters
from rock2d.blind.reality.cause import Cause, Rng, Scale


def sizes(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    mass = scale.mass / (0.6 * share)
    if form == 0:
        return {"mass_kg": mass, "spring_1_s2": 0.0, "dashpot_1_s": 0.0, "grip_m_s2": 0.5 * scale.gravity}
    rate = 0.25 * scale.spring
    return {"mass_kg": mass, "spring_1_s2": rate**2, "dashpot_1_s": 0.6 * rate, "grip_m_s2": 0.0}


CAUSE = Cause(
    sizes,
    forms=2,
    columns={
        "mass_kg": parameters.RECOIL_MASS,
        "spring_1_s2": parameters.RECOIL_SPRING,
        "dashpot_1_s": parameters.RECOIL_DASHPOT,
        "grip_m_s2": parameters.RECOIL_FRICTION,
    },
    draw_order=10,
)
