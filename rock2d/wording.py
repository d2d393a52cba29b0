"""Numbers and names as words of a sentence."""

from collections.abc import Sequence
from itertools import zip_longest

import numpy as np

from rock2d.arrays import Array

# ends of names, and the units that they say; the longest first
UNITS = {
    "m2_s2": "m²/s²", "rad_s": "rad/s", "m_s2": "m/s²", "m_s": "m/s", "rad": "rad", "kg": "kg", "J": "J", "m": "m",
    "s": "s",
}  # fmt: skip


def spoken(name: str) -> str:
    """The name of an effect, a block or a zone as text."""
    return name.replace("_", " ")


def listed(names: Sequence[str], last: str = "and") -> str:
    """ "a, b and c"."""
    words = [spoken(name) for name in names]
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} {last} {words[-1]}" if words else ""


def sentence(text: str) -> str:
    """The text with a full stop, unless it is a question."""
    return text if text.endswith("?") else f"{text}."


def aligned(rows: Sequence[Sequence[str]]) -> list[str]:
    """Rows of cells as lines of a terminal, with columns as wide as their longest cell."""
    widths = [max(map(len, column)) for column in zip_longest(*rows, fillvalue="")]
    return ["  ".join(map(str.ljust, row, widths)).rstrip() for row in rows]


def percent(share: float) -> str:
    """A probability; never 0 or 100 % if it is only near to it."""
    if share > 0.99:
        return "more than 99 %"
    return "less than 1 %" if share < 0.01 else f"{100 * share:.0f} %"


def number(value: float, half_width: float | None = None) -> str:
    """A number with the digits that its uncertainty justifies (or three), thousands separated, with a minus sign."""
    if not np.isfinite(value):
        return "–"
    size = half_width if half_width else abs(value) / 20.0
    decimals = int(np.clip(1 - np.floor(np.log10(size)), 0, 8)) if size > 0 else 0
    rounded = round(value, decimals) + 0.0  # no minus before a zero
    return f"{rounded:,.{decimals}f}".replace(",", " ").replace("-", "−")


def plus_minus(value: float, error: float) -> str:
    """ "12.3 ± 0.4"."""
    size = max(2.0 * error, 1.0)
    return f"{number(value, size)} ± {number(error, size)}"


def interval(low: float, high: float) -> str:
    """ "1.2 to 1.4"."""
    half = 0.5 * (high - low)
    return f"{number(low, half)} to {number(high, half)}"


def plain(value: float, half_width: float | None = None) -> str:
    """A number for a file: its digits as the uncertainty justifies, without signs that YAML does not know."""
    return number(value, half_width).replace("−", "-").replace("\N{NO-BREAK SPACE}", "").replace(" ", "")


def point(values: Array, half_widths: Array) -> str:
    """A point for a file, "[x, y]"."""
    return f"[{', '.join(plain(v, h or None) for v, h in zip(values, half_widths, strict=True))}]"


def length(value_m: float) -> str:
    """A length with a suitable unit: "12.3 mm" or "1.23 m"."""
    return f"{1e3 * value_m:.1f} mm" if value_m < 1 else f"{value_m:.2f} m"


def without_unit(name: str) -> tuple[str, str]:
    """("vx", "m/s") of "vx_m_s"; the unit is empty if the name says none."""
    end = next((end for end in UNITS if name.endswith(f"_{end}")), None)
    return (name, "") if end is None else (name.removesuffix(f"_{end}"), UNITS[end])


def energy_unit(largest_J: float) -> tuple[float, str]:
    """Factor for energies in J and the resulting unit, kJ from 1000 J on."""
    return (1e-3, "kJ") if largest_J >= 1000.0 else (1.0, "J")


def three_digits(value: float) -> str:
    """A number with three significant digits, without exponent where it is neither huge nor tiny."""
    if not np.isfinite(value):
        return "-"
    rounded = float(f"{value:.3g}")
    if rounded == 0.0:
        return "0"
    if not 1e-3 <= abs(rounded) < 1e6:
        return f"{rounded:.2e}"
    return f"{rounded:.{max(2 - int(np.floor(np.log10(abs(rounded)))), 0)}f}"


def with_interval(value: float, low: float, high: float, factor: float = 1.0) -> str:
    """ "12.3 [11.0, 14.2]"; a bound that is not known is a dash."""
    return f"{three_digits(factor * value)} [{three_digits(factor * low)}, {three_digits(factor * high)}]"
