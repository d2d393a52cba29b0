"""Wrong inertia: the same factor for all blocks, or a different one for each."""

import numpy as np

from rock2d.blind.reality.cause import Cause, Rng, Scale, random_sign


def sizes(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    whole = random_sign(rng) * np.log(2.0) * share
    shares = np.ones(scale.n_blocks) if form == 0 else rng.uniform(0.2, 1.0, scale.n_blocks)
    return {f"factor_{i}": float(np.exp(whole * part)) for i, part in enumerate(shares)}


CAUSE = Cause(sizes, forms=2, draw_order=4)
