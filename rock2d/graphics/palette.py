"""Colours of videos and figures: the set of Okabe & Ito for blocks, muted earth tones for zones."""

from collections.abc import Iterable

BLOCK_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#9C4F86", "#B07C00", "#3A9BC9")
MEASURED_COLOUR = "#333333"
SIMULATED_COLOUR = "#D55E00"
ZONE_TONES = ("#d9c7a3", "#b9c9b0", "#d7b7a2", "#b7bfd2", "#ded39a", "#c5b2c4", "#a9c7c7", "#cdbfae")
DEEP_GROUND = "#ebe6dc"
SKY = "#f8fafb"
INK = "#2b2b2b"
LINE_INK = "#00707a"
NAME_INK = "#5b5346"
LEADER_INK = "#8a8578"


def block_colours(names: Iterable[str]) -> dict[str, str]:
    """A colour for each block, in the order of `names`."""
    return {name: BLOCK_COLOURS[i % len(BLOCK_COLOURS)] for i, name in enumerate(dict.fromkeys(names))}


def zone_tones(names: Iterable[str]) -> dict[str, str]:
    """A muted tone for each zone."""
    return {name: ZONE_TONES[i % len(ZONE_TONES)] for i, name in enumerate(names)}


def rgb(colour: str) -> tuple[int, int, int]:
    """ "#rrggbb" as three integers 0-255."""
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)


def mixed(colour: str, other: str, share: float) -> str:
    """The mixture of (1 - share) `colour` and `share` `other`, for `share` from 0 to 1."""
    pairs = zip(rgb(colour), rgb(other), strict=True)
    return "#" + "".join(f"{round((1 - share) * a + share * b):02x}" for a, b in pairs)
