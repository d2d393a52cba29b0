"""At its first lift-off the block leaves a part of its mass behind, at rest."""

from __future__ import annotations

from rock2d.blind.reality import parameters
from rock2d.blind.reality.cause import Cause, Rng
from rock2d.blind.reality.scale import Scale


def sizes(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    """Values of a form at `share` (0 to 1) of the largest plausible size."""
    return {"share": 0.3 * share}


CAUSE = Cause(
    "mass_shedding",
    sizes,
    columns={"share": parameters.SHED_SHARE},
    sentence="At its first lift-off the block leaves a part of its mass behind, at rest.",
    draw_order=1,
)
