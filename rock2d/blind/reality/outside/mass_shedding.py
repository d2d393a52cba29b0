"""At its first lift-off the block leaves a part of its mass behind, at rest."""

from rock2d.blind.reality import parameters
from rock2d.blind.reality.cause import Cause, Rng, Scale


def sizes(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    return {"share": 0.3 * share}


CAUSE = Cause(sizes, columns={"share": parameters.SHED_SHARE}, draw_order=1)
