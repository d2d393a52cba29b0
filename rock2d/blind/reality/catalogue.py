"""What can be hidden, and how large it can be.

`FORMS` are the effects that a diagnosis knows, each in two physically different forms; `OUTSIDE` are flaws that it
does not know. `draw` chooses the sizes: `strength` 1 is the largest plausible one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from rock2d.blind.reality.camera_effects import CAMERA
from rock2d.blind.reality.data_model import Block, Hidden, Setup, Soil
from rock2d.blind.reality.outside import KINDS
from rock2d.blind.reality.scale import Scale, scale_of
from rock2d.blind.reality.world_effects import WORLD

Sizes = Callable[[int, float, np.random.Generator, Scale], dict[str, float]]

KNOWN: dict[str, Sizes] = {**WORLD, **CAMERA}
FORMS: dict[str, int] = dict.fromkeys(KNOWN, 2)
OUTSIDE: dict[str, str] = {name: sentence for name, (sentence, _) in KINDS.items()}
LEAST_SHARE = 0.85  # sizes are drawn between this share of `strength` and all of it


def draw(
    name: str,
    form: int,
    rng: np.random.Generator,
    setup: Setup,
    law: Soil,
    blocks: Sequence[Block],
    gravity: float,
    strength: float,
) -> Hidden:
    """An effect of `strength` (0 to 1) times the largest plausible size for this set-up; signs are drawn.

    Raises KeyError for a name that is neither in FORMS nor OUTSIDE, ValueError for a form that does not exist.
    """
    if not 0 <= form < FORMS.get(name, 1):
        raise ValueError(f"{name} has forms 0 to {FORMS.get(name, 1) - 1}, got {form}")
    share = strength * float(rng.uniform(LEAST_SHARE, 1.0))
    sizes: Sizes = KNOWN[name] if name in KNOWN else KINDS[name][1]
    values = sizes(form, share, rng, scale_of(setup, law, blocks, gravity))
    return Hidden(name, form, {key: float(value) for key, value in values.items()})
