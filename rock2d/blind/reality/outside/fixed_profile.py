"""The ground has small hills and dips that the survey missed; they are the same for all releases."""

from __future__ import annotations

from rock2d.blind.reality.cause import Cause, Rng
from rock2d.blind.reality.scale import Scale


def sizes(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    # as of one wave with an amplitude of a tenth of a block
    return {
        "height_m": 0.07 * share * scale.size,
        "wavelength_m": 4.0 * scale.size,
        "profile": float(rng.integers(1 << 30)),
    }


CAUSE = Cause(sizes)
