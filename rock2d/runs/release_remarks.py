"""Remarks on the releases of a run: unresolved releases, releases that do not leave their source, too few releases.

A release is *unresolved* if it was cut short (time limit, limit of impacts) or sank into ground too soft for the law
(buried): it could still have crossed a measure line, or run farther."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from rock2d.errors import comma_list
from rock2d.records.columns import UNRESOLVED_STOPS
from rock2d.statistics import DESIGN_PERCENTILE, least_count

if TYPE_CHECKING:
    import pandas as pd

LEAST_LEAVING_SHARE = 0.5  # least share of the releases of a block that leave their source without a remark
LARGEST_UNRESOLVED_SHARE = 0.01  # largest share of unresolved releases of a block without a remark
REASON_OF_STOP = {
    "time": "ran out of time (time_limit_s is {time_limit_s:.3g})",
    "impacts": "reached the limit of impacts",
    "buried": "sank into the ground of {zones} (too soft for the law; choose a stiffer soil there: model.soils)",
}


def stop_counts(stops: pd.DataFrame) -> pd.DataFrame:
    """Numbers of releases by block (rows) and kind of stop (columns), from the table stops of a run or a campaign."""
    if "releases" in stops:
        return stops.pivot_table(index="block", columns="stop", values="releases", aggfunc="sum", fill_value=0)
    return stops.groupby(["block", "stop"]).size().unstack(fill_value=0)


def unresolved_remarks(tables: Mapping[str, Any], time_limit_s: float) -> list[str]:
    """A sentence on each block with more than 1 % unresolved releases, from the tables of a run or a campaign: from its
    stops or, if only crossings were kept, from the line with most of them."""
    remarks = []
    if "stops" in tables:
        counts = stop_counts(tables["stops"])
        for block, by_stop in counts.iterrows():
            cut = {stop: int(by_stop.get(stop, 0)) for stop in UNRESOLVED_STOPS}
            if sum(cut.values()) > LARGEST_UNRESOLVED_SHARE * by_stop.sum():
                ends = tables["stops"].query("block == @block")
                why = " and ".join(
                    f"{n} {REASON_OF_STOP[stop].format(time_limit_s=time_limit_s, zones=_zones(ends, stop))}"
                    for stop, n in cut.items()
                    if n
                )
                remarks.append(f"NOT RESOLVED: of {by_stop.sum()} releases of {block} {why}")
    elif "passing" in tables:
        passing = tables["passing"]
        for block, at_lines in passing.groupby("block", sort=False):
            unresolved, releases = at_lines["unresolved"].max(), at_lines["releases"].iloc[0]
            if unresolved > LARGEST_UNRESOLVED_SHARE * releases:
                why = f"{unresolved} were cut short (time_limit_s is {time_limit_s:.3g}) or buried"
                remarks.append(f"NOT RESOLVED: of {releases} releases of {block} {why}")
    return remarks


def _zones(ends: pd.DataFrame, stop: str) -> str:
    """The zones in which releases ended with this stop, in words."""
    return comma_list(sorted(ends.loc[ends["stop"] == stop, "zone"].dropna().unique()))


def source_remarks(tables: Mapping[str, Any]) -> list[str]:
    """A sentence on each block most of whose releases stay where they start, or of which none comes to a line."""
    if "passing" not in tables:
        return []
    at_lines = tables["passing"].groupby("block", sort=False)
    return [
        f"none of the {rows['releases'].iloc[0]} releases of {block} comes as far as a measure line "
        f"({comma_list(rows['line'])}): none arrived, and there are no heights and energies of it there"
        for block, rows in at_lines
        if not rows["passed"].any()
    ] + [
        f"{row.releases - row.left_source:.0f} of {row.releases} releases of {row.block} stay where they start: use "
        "the shares of the arriving blocks, or let blocks start where the slope is steeper (incident)"
        for row in tables["passing"].drop_duplicates("block").itertuples()
        if row.left_source < LEAST_LEAVING_SHARE * row.releases
    ]


def precision_remarks(tables: Mapping[str, Any]) -> list[str]:
    """A sentence if there are too few releases for the interval of a 95th percentile."""
    if "passing" not in tables or not len(tables["passing"]):
        return []
    releases = int(tables["passing"]["releases"].max())
    least = least_count(DESIGN_PERCENTILE)
    text = f"too few releases of a block for design values ({releases}): the interval of a {DESIGN_PERCENTILE:g}th"
    return [f"{text} percentile needs at least {least} passing blocks"] if releases < least else []
