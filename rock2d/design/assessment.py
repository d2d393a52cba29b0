"""Results over all possible sites of a scenario with the key `uncertainty`: tables and a tornado figure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rock2d.design.possible_sites import draw_sites, simulate_sites, variants_of
from rock2d.design.uncertainty import FREQUENCY, SHARES, sensitivity_table, uncertain_table
from rock2d.errors import comma_list, counted
from rock2d.files.csv_tables import write_tables
from rock2d.files.folders import write_whole
from rock2d.files.scenario import Scenario
from rock2d.wording import with_interval

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from rock2d.graphics.figure_files import Figures
    from rock2d.graphics.pages import Picture, Section

LONGEST_LABEL = 44
BAR_HIGH_IN, PANEL_WIDE_IN = 0.3, 3.2  # of the tornado figure


@dataclass(frozen=True, repr=False)
class Assessment:
    """Results over all possible sites, and the influence of each unknown value; returned by `rock2d.assess`.

    Attributes
    ----------
    uncertain : one row for each block, measure line and quantity: median over the sites, 95 % interval, and the shares
        of the variance from what is not known and from sampling
    sensitivity : Sobol indices of the unknown values, one row for each block, line, quantity and value
    sites : one row for each simulated site, one column for each value"""

    uncertain: pd.DataFrame
    sensitivity: pd.DataFrame
    sites: pd.DataFrame

    def write(self, folder: Path, figures: Figures | None = None) -> None:
        """Write uncertainty.csv, sensitivity.csv, sites.csv and, if the errors of the indices are small enough,
        tornado.png. `figures` determines when it is drawn (default: at once)."""
        from rock2d.graphics.figure_files import Figures

        write_tables(folder, {"uncertainty": self.uncertain, "sensitivity": self.sensitivity, "sites": self.sites})
        if len(self.told_apart):
            (figures or Figures()).save(folder / "tornado.png", Assessment.plot, self)

    @property
    def told_apart(self) -> pd.DataFrame:
        """The rows of `sensitivity` for blocks and lines whose errors are small enough to tell the values apart: the
        largest total index is larger than every 95 % error."""
        panels = self.sensitivity.groupby(["block", "line"])
        return self.sensitivity[panels["total"].transform("max") > panels["total_error95"].transform("max")]

    def plot(self) -> Figure:
        """Tornado figure of the rows `told_apart`: the total Sobol index of each unknown value, its share in the
        variance of the passing frequency, with the 95 % error; a row of panels for each line, a column for each block.
        An index that is not larger than its error has no bar."""
        from rock2d.graphics.figure_style import SMALL_PT, blank_figure, finish
        from rock2d.graphics.palette import block_colours

        shown = self.told_apart
        blocks, lines = shown["block"].unique(), shown["line"].unique()
        mean = shown.groupby("parameter")["total"].mean().sort_values()
        names = list(mean.index)
        wide = 2.4 + PANEL_WIDE_IN * len(blocks)
        figure = blank_figure(wide, 0.9 + len(lines) * (0.7 + BAR_HIGH_IN * len(names)))
        axes = figure.subplots(len(lines), len(blocks), squeeze=False, sharex=True, sharey=True)
        colours = block_colours(blocks)
        for row, line in zip(axes, lines, strict=True):
            for axis, block in zip(row, blocks, strict=True):
                chosen = (shown["line"] == line) & (shown["block"] == block)
                own = shown[chosen].set_index("parameter").reindex(names)
                at = np.arange(len(names))
                known = own["total"].where(own["total"] > own["total_error95"])
                axis.barh(at, known, color=colours[block], height=0.62)
                axis.errorbar(own["total"], at, xerr=own["total_error95"], fmt="none", ecolor="#333333", lw=1)
                axis.set_title(f"{block}, {line}", fontsize=SMALL_PT + 1, loc="left")
                if not chosen.any():
                    style = {"transform": axis.transAxes, "ha": "center", "fontsize": SMALL_PT}
                    axis.text(0.5, 0.5, "not known, or does not vary", **style)
                axis.set_yticks(at, [_shortened(name) for name in names])
        axes[0, 0].set_xlim(0.0, 1.05 * max(1.0, (shown["total"] + shown["total_error95"]).max()))
        for axis in axes[-1]:
            axis.set_xlabel("share of the variance (total)")
        return finish(figure, "What the spread of the passing frequency comes from")

    def view(self) -> Path:
        """Open a page with table and tornado figure in the browser; returns its path, in a temporary folder."""
        from rock2d.graphics.pages import PAGE, Section, drawn, page, view

        def write(folder: Path) -> None:
            pictures = [drawn(self.plot(), tornado_words(self))] if len(self.told_apart) else []
            sections = [Section(items=self.remarks()), certainty_section(self, pictures)]
            write_whole(folder / PAGE, page("Possible sites", sections))

        return view(write, PAGE)

    def sampling_remark(self) -> str:
        """Advice if the errors of the sensitivity are too large somewhere; else empty."""
        missing = self.sensitivity.drop(self.told_apart.index)
        if not len(missing):
            return ""
        where = list(dict.fromkeys(missing["block"] + " at " + missing["line"]))
        rows = self.uncertain[self.uncertain["quantity"] == FREQUENCY]
        size = f"{rows['sites'].iloc[0]} independent sites with {rows['releases'].iloc[0]} releases"
        return (
            f"Which unknown value matters is not known for {comma_list(where)}: with {size} each, the errors of the "
            "Sobol indices are as large as the indices. Increase `uncertainty.sites`, and also `uncertainty.releases` "
            "if most of the variance is sampling."
        )

    def __repr__(self) -> str:
        return (
            f"<Assessment of {counted(len(self.sites), 'site')}\n"
            f" blocks: {comma_list(self.uncertain['block'].unique())}\n unknown: {comma_list(self.sites.columns)}\n"
            " tables: uncertain, sensitivity, sites>"
        )

    def _repr_html_(self) -> str:
        from rock2d.graphics.pages import notebook_figure, notebook_table

        return notebook_table(self.uncertain) + (notebook_figure(self.plot()) if len(self.told_apart) else "")

    def text(self) -> str:
        """Passing frequencies with their intervals as text."""
        known = self.uncertain.dropna(subset="value")
        tables = []
        for key, words in SHARES.items():
            rows = known[known["quantity"] == key]
            if not len(rows):
                continue
            records: list[Any] = list(rows.itertuples())
            cells = [
                with_interval(r.value, r.low95, r.high95, 100.0)
                + ("" if np.isnan(r.share_not_known) else f", {100 * r.share_not_known:.0f} % not known")
                for r in records
            ]
            table = rows.assign(cell=cells).pivot(index="line", columns="block", values="cell")
            table = table.loc[rows["line"].unique()]
            tables.append(
                f"{words}, in % over {rows['sites'].iloc[0]} possible sites: median [95 % interval], share of the "
                f"variance that is not known rather than sampling\n{table.fillna('-').to_string()}"
            )
        return "\n".join([*tables, *self.remarks()])

    def remarks(self) -> list[str]:
        """A sentence on each block with releases that were cut short or buried on the possible sites."""
        rows = self.uncertain[self.uncertain["quantity"] == FREQUENCY]
        largest = rows.groupby("block", sort=False)["unresolved"].max()
        return [
            f"on the possible sites {100 * share:.2g} % of the releases of {block} were cut short or buried; the upper "
            "bounds count them as passed"
            for block, share in largest.items()
            if share > 0.0
        ]


def assess(scenario: Scenario, engine: str, seed: int, progress: bool = False) -> Assessment:
    """Simulate the possible sites of a scenario.

    Raises InputError if it has no `uncertainty`, or if a drawn value makes no sense."""
    import pandas as pd

    from rock2d.progress import Bars

    sites = draw_sites(scenario, seed)
    variants = variants_of(scenario, sites)
    assert scenario.uncertainty is not None
    with Bars(progress).stage("possible sites", len(variants), "sites") as bar:
        seeds = [sites.release_seed(i) for i in range(len(variants))]
        results = simulate_sites(variants, engine, seeds, scenario.uncertainty.releases, bar.update)
    return Assessment(
        uncertain_table(sites, results, seed), sensitivity_table(sites, results, seed),
        pd.DataFrame(sites.values, columns=list(sites.places)),
    )  # fmt: skip


def tornado_words(assessment: Assessment) -> str:
    """Alternative text of the tornado figure of an assessment."""
    table: Any = assessment.told_apart
    alt = "Tornado figure: share of each unknown value in the variance of the passing frequency"
    if len(table):
        first = table.loc[table["total"].idxmax()]
        alt += f"; the largest is {first['parameter']} with a total index of {first['total']:.2f}"
    return alt


def certainty_section(assessment: Assessment, pictures: Sequence[Picture]) -> Section:
    """The section of an assessment; `pictures`: its tornado figure, if it has one."""
    from rock2d.design.report_tables import uncertain_page_table
    from rock2d.graphics.pages import Section

    texts = [remark] if (remark := assessment.sampling_remark()) else []
    return Section("How sure is that", texts, pictures=pictures, tables=[uncertain_page_table(assessment.uncertain)])


def _shortened(name: str) -> str:
    """A short form of a key of the scenario file; for a law parameter, its name and where it applies."""
    parts = name.split(".")
    text = f"{parts[-1]} ({', '.join(parts[2:-1])})" if parts[0] == "model" else name
    return text if len(text) <= LONGEST_LABEL else "..." + text[3 - LONGEST_LABEL :]
