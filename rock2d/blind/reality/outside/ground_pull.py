"""Close to its surface the ground attracts the block."""

from __future__ import annotations

from rock2d.blind.reality import parameters
from rock2d.blind.reality.cause import Cause, Rng
from rock2d.blind.reality.scale import Scale


def sizes(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    """Values of a form at `share` (0 to 1) of the largest plausible size."""
    return {"pull_m_s2": 2.0 * share * scale.gravity, "range_m": 1.5 * scale.size}


CAUSE = Cause(
    "ground_pull",
    sizes,
    columns={"pull_m_s2": parameters.ATTRACTION, "range_m": parameters.ATTRACTION_RANGE},
    sentence="Close to its surface the ground attracts the block.",
    draw_order=7,
)
