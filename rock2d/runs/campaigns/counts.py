"""Counts of a chunk, from which the tables of a campaign follow, except for exact percentiles."""

from __future__ import annotations

import json
from dataclasses import dataclass, fields

import numpy as np

from rock2d.arrays import Array
from rock2d.records.columns import STOPS
from rock2d.runs.campaigns.job import Job
from rock2d.runs.campaigns.order_statistics import DIGITS, leading_digits
from rock2d.runs.indicators.crossings import CROSSING_VALUES
from rock2d.runs.indicators.passing import LINE_QUANTITIES, PassingCounts


@dataclass(frozen=True)
class Counts:
    """Counts of releases, and of values by their leading digits.

    Attributes
    ----------
    unclosed : () releases whose energy audit does not close
    left_source : () releases that left their source, if ends are kept
    passed, unresolved, arrived, may_arrive : (lines,) see `PassingCounts`
    stops : (STOPS, zones + 1) releases by kind and zone of their stop; last column: outside the cross-section
    runouts : (DIGITS,) distances from start to end
    crossings : (lines, LINE_QUANTITIES, DIGITS) values at a line"""

    unclosed: Array
    left_source: Array
    passed: Array
    unresolved: Array
    arrived: Array
    may_arrive: Array
    stops: Array
    runouts: Array
    crossings: Array

    @staticmethod
    def none(job: Job) -> Counts:
        """Counts that are all 0."""
        lines, zones = len(job.cross_section.measure_lines), len(job.cross_section.zone_names)
        shapes = (
            (), (), (lines,), (lines,), (lines,), (lines,),
            (len(STOPS), zones + 1), (DIGITS,), (lines, len(LINE_QUANTITIES), DIGITS),
        )  # fmt: skip
        return Counts(*(np.zeros(shape, np.int64) for shape in shapes))

    @property
    def passing(self) -> PassingCounts:
        """Passing counts at each line."""
        return PassingCounts(self.passed, self.unresolved, self.arrived, self.may_arrive)

    def add_ends(self, stop: Array, zone: Array, runout_m: Array) -> None:
        """Count ends (n,): index into STOPS, index of the zone or -1, distance from the start."""
        counts, zones = np.ravel(self.stops), self.stops.shape[1]
        np.add.at(counts, stop * zones + zone % zones, 1)
        np.add.at(self.runouts, leading_digits(runout_m), 1)

    def add_crossings(self, line: Array, values: Array) -> None:
        """Count crossings (n,) of lines with the index `line`; `values` (CROSSING_VALUES, n)."""
        counts, n = np.ravel(self.crossings), len(LINE_QUANTITIES)
        for k, quantity in enumerate(LINE_QUANTITIES):
            digits = leading_digits(values[CROSSING_VALUES.index(quantity)])
            np.add.at(counts, (line * n + k) * DIGITS + digits, 1)  # much faster than with several indices

    def text(self) -> str:
        """JSON with the flat indices and the counts of all nonzero entries of each array."""
        arrays = {each.name: np.ravel(getattr(self, each.name)) for each in fields(self)}
        places = {name: np.flatnonzero(array) for name, array in arrays.items()}
        return json.dumps({name: [at.tolist(), arrays[name][at].tolist()] for name, at in places.items()})

    def add_text(self, text: str | bytes) -> None:
        """Add counts of other releases in the form of `text`."""
        for name, entries in json.loads(text).items():
            places, counts = np.array(entries, np.int64)
            np.ravel(getattr(self, name))[places] += counts
