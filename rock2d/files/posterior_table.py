"""The posterior of a calibration as a table: equally likely draws of numbers of a scenario file."""

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rock2d.arrays import Array
from rock2d.errors import InputError
from rock2d.files.text_files import read_text

ROW = "posterior"  # name of the row number among the unknown values of a site
FEWEST_DRAWS, MOST_DRAWS = 10, 100_000


@dataclass(frozen=True)
class Posterior:
    """Joint draws of several numbers.

    Attributes
    ----------
    given, file : the path as the scenario gives it, and where the table lies
    places : (p,) of the numbers in the scenario file
    draws : (n, p) values"""

    given: str
    file: Path
    places: tuple[str, ...]
    draws: Array

    def row(self, u: Array) -> Array:
        """Row numbers, as floats, at quantiles `u` in (0, 1) of a uniform choice of rows."""
        return np.floor(np.asarray(u) * len(self.draws))

    def values(self, row: float) -> dict[str, float]:
        """Place -> value in a row."""
        return dict(zip(self.places, self.draws[int(row)].tolist(), strict=True))


def read_posterior(given: str, file: Path) -> Posterior:
    """Read a table (CSV) with a column for each place and a row for each draw.

    Raises InputError with the line if there are no numbers, or too few or too many rows."""
    lines = enumerate(csv.reader(read_text(file).splitlines()), 1)
    rows = [(n, row) for n, row in lines if any(cell.strip() for cell in row)]
    top, header = rows[0] if rows else (1, [])
    places = tuple(cell.strip() for cell in header)
    if not places or len(set(places)) != len(places) or not all(places):
        raise InputError("expected a first line with a different place in each column", file, top, 1, code="bad_table")
    draws = []
    for n, row in rows[1:]:
        try:
            draws.append([float(cell) for cell in row])
        except ValueError:
            raise InputError("expected numbers", file, n, 1, code="bad_table") from None
        if len(row) != len(places) or not np.isfinite(draws[-1]).all():
            raise InputError(f"expected {len(places)} finite numbers", file, n, 1, code="bad_table")
    if not FEWEST_DRAWS <= len(draws) <= MOST_DRAWS:
        message = f"expected {FEWEST_DRAWS} to {MOST_DRAWS} draws, found {len(draws)}"
        raise InputError(message, file, code="bad_table")
    return Posterior(given, file, places, np.array(draws))
