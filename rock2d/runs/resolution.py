"""What the shares of a run rest on: releases that came to rest or left, and those whose end is not known.

A release is *unresolved* if it was cut short (time limit, limit of impacts) or sank into ground too soft for the law
(buried): it could still have crossed a measure line, or run farther.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from rock2d.errors import listed
from rock2d.records.columns import UNRESOLVED_STOPS
from rock2d.statistics import DESIGN_PERCENTILE, least_count

if TYPE_CHECKING:
    import pandas as pd

FEWEST_LEFT = 0.5  # share of a block's releases that leave their source in a usual run
LARGEST_UNRESOLVED = 0.01  # share of a block's releases up to which a run counts as resolved
REASONS = {
    "time": "ran out of time (time_limit_s is {time_limit_s:.3g})",
    "impacts": "reached the limit of impacts",
    "buried": "sank into the ground of {zones} (too soft for the law; a stiffer soil there: model.soils)",
}


def stop_counts(stops: pd.DataFrame) -> pd.DataFrame:
    """Releases by block (rows) and kind of stop (columns) of a run's or a campaign's stops."""
    if "releases" in stops:
        return stops.pivot_table(
            index="block", columns="stop", values="releases", aggfunc="sum", fill_value=0
        )
    return stops.groupby(["block", "stop"]).size().unstack(fill_value=0)


def unresolved_remarks(tables: Mapping[str, Any], time_limit_s: float) -> list[str]:
    """A sentence on each block of which more than 1 % of the releases are unresolved, from a run's or a campaign's
    tables: by its stops, or, where only crossings were kept, by the line at which most are."""
    remarks = []
    if "stops" in tables:
        counts = stop_counts(tables["stops"])
        for block, own in counts.iterrows():
            cut = {stop: int(own.get(stop, 0)) for stop in UNRESOLVED_STOPS}
            if sum(cut.values()) > LARGEST_UNRESOLVED * own.sum():
                ends = tables["stops"].query("block == @block")
                why = " and ".join(
                    f"{n} {REASONS[stop].format(time_limit_s=time_limit_s, zones=_zones(ends, stop))}"
                    for stop, n in cut.items()
                    if n
                )
                remarks.append(f"NOT RESOLVED: of {own.sum()} releases of {block} {why}")
    elif "passing" in tables:
        passing = tables["passing"]
        for block, own in passing.groupby("block", sort=False):
            unresolved, releases = own["unresolved"].max(), own["releases"].iloc[0]
            if unresolved > LARGEST_UNRESOLVED * releases:
                why = f"{unresolved} were cut short (time_limit_s is {time_limit_s:.3g}) or buried"
                remarks.append(f"NOT RESOLVED: of {releases} releases of {block} {why}")
    return remarks


def _zones(ends: pd.DataFrame, stop: str) -> str:
    """The zones in which releases ended this way, in words."""
    return listed(sorted(ends.loc[ends["stop"] == stop, "zone"].dropna().unique()))


def source_remarks(tables: Mapping[str, Any]) -> list[str]:
    """A sentence on each block of which most releases stay where they start."""
    if "passing" not in tables:
        return []
    return [
        f"{own.releases - own.left_source:.0f} of {own.releases} releases of {own.block} stay where they start: read "
        "the shares of the arriving blocks, or start blocks where they come loose (incident)"
        for own in tables["passing"].drop_duplicates("block").itertuples()
        if own.left_source < FEWEST_LEFT * own.releases
    ]


def few_remarks(tables: Mapping[str, Any]) -> list[str]:
    """A sentence if there are too few releases for the interval of any 95th percentile."""
    if "passing" not in tables or not len(tables["passing"]):
        return []
    releases = int(tables["passing"]["releases"].max())
    least = least_count(DESIGN_PERCENTILE)
    text = f"{releases} releases of a block are too few for design values: the interval of a {DESIGN_PERCENTILE:g}th"
    return [f"{text} percentile needs {least} passings or more"] if releases < least else []
