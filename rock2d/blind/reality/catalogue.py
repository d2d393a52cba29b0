"""All causes that can be hidden, and the draw of their sizes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rock2d.blind.reality.data_model import Hidden
from rock2d.blind.reality.known import known_causes
from rock2d.blind.reality.outside import outside_causes
from rock2d.blind.reality.scale import scale_of

if TYPE_CHECKING:
    import numpy as np

    from rock2d.blind.reality.data_model import World

CAUSES = {**known_causes(), **outside_causes()}
FORMS = {name: cause.forms for name, cause in known_causes().items()}  # number of forms of each effect
OUTSIDE = tuple(outside_causes())
LEAST_SHARE_OF_STRENGTH = 0.85  # sizes are drawn between this share of `strength` and all of it


def draw_hidden(name: str, form: int, rng: np.random.Generator, world: World, strength: float) -> Hidden:
    """A cause of `strength` (0 to 1) times the largest plausible size in this world; the rng draws its sign.

    Raises KeyError for an unknown name, ValueError for a form that does not exist.
    """
    forms = CAUSES[name].forms
    if not 0 <= form < forms:
        raise ValueError(f"{name} has forms 0 to {forms - 1}, got {form}")
    share = strength * float(rng.uniform(LEAST_SHARE_OF_STRENGTH, 1.0))
    values = CAUSES[name].sizes(form, share, rng, scale_of(world))
    return Hidden(name, form, {key: float(value) for key, value in values.items()})
