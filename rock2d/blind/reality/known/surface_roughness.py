"""Rough surface: each impact draws a slope, or the ground has a rough or a hilly profile, the same for all releases."""

from rock2d.blind.reality.cause import Cause, Rng, Scale


def sizes(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    if form == 0:
        return {"sd_rad": 0.2 * share}
    profile = float(rng.integers(1 << 30))
    if form == 1:
        return {"sd_rad": 0.2 * share, "spacing_m": 1.5 * scale.size, "profile": profile}
    # the root mean square of one wave with an amplitude of a tenth of a block
    return {"height_m": 0.07 * share * scale.size, "wavelength_m": 4.0 * scale.size, "profile": profile}


CAUSE = Cause(sizes, forms=3, draw_order=7)
