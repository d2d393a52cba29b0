"""report.md: the page that holds the tables and figures of a reproduction together."""

import pandas as pd

from rock2d.reproduction import published
from rock2d.reproduction.results import Results
from rock2d.wording import spoken
from rock2d_figures.table_2 import markdown_rows


def report_text(results: Results, tables: dict[str, pd.DataFrame]) -> str:
    """The page report.md, in Markdown."""
    errors = [f"| {name} | {value:.1f} |" for name, value in results.errors.items()]
    paragraphs = [
        "# The paper's tables and figures, reproduced",
        "\n".join(f"- {line}" for line in results.conclusions),
        "## Table 2: passing frequencies in %",
        _markdown_rows(*markdown_rows(results.passing)),
        "Experiment: exact 95 % interval of 50 releases. This project's models: mean and 95 % interval over the\n"
        "hypotheses of each that explain the sphere and the statements on first impacts; the slope reductions of the\n"
        "probabilistic model were fitted to the cells of their own block, as in the paper.\n"
        "p: exact; of the filmed number under this project's predictions, of equal frequencies for the paper's\n"
        "models (Fisher).",
        "![passing frequencies](passing.png)",
        "## Influence of the unpublished incident states: RMSE in points by the data a model was fitted to",
        "\n".join(["| | RMSE |", "|---|---|", *errors]),
        *(_candidates(results) if results.held_out else ()),
        *_arrivals(results),
        "## What is identified",
        "Grey bars: prior ranges; right: the posterior's standard deviation over the prior's.",
        "![identified](identified.png)",
        "### Table 3",
        _markdown(tables["table_3"]),
        "### Table 4",
        _markdown(tables["table_4"]),
        "### Assumptions: what the paper did not publish",
        "\n".join(f"- {meaning}" for meaning in published.MEANINGS),
        _markdown(tables["assumptions"]),
        "## Figures",
        "![set-up](figure_1.png)",
        "Figure 1. The set-up of the likeliest hypothesis, with zones and measure lines; grey: other hypotheses.",
        "![at line 2](figure_2.png)",
        "Figure 2. The sphere at line 2; incidence above the horizontal. The paper's curves are not published as\n"
        "numbers.",
        "![trajectories](figure_3.png)",
        "Figure 3. Trajectories from paper_setup.yaml, with the laws of Tables 4 and 3; `rock2d run` accepts it.",
    ]
    return "\n\n".join(paragraphs) + "\n"


def _arrivals(results: Results) -> list[str]:
    """Paragraphs on what follows from the arrivals of the paper's simulations."""
    own = results.arrivals
    return [
        "## Arrivals from the paper's own simulations",
        "The paper's simulations started from the measured arrivals, with the parameters of Table 4. Set-up and\n"
        "arrivals are chosen so that Table 4 gives the paper's deterministic column. The law is then calibrated "
        "on the\n"
        "sphere's experimental row and predicts the cube and the parallelepiped. No experimental cell of these two\n"
        "blocks is used. Assumed: the paper's simulated releases and the filmed ones are independent draws.",
        "![arrivals](arrivals.png)",
        "The arrivals found. Grey: what the text says of the first impacts, and the speed of the drop.",
        "The paper's column, with the exact 95 % interval of its 50 releases, and Table 4 on the arrivals found:",
        _markdown(own.paper_column),
        "The experiment and the predictions:",
        _markdown(own.passing),
        "### Readings of Table 3",
        "Set-up and arrival within each reading, chosen so that Table 3 gives the sphere's row of the paper's\n"
        "probabilistic column: ranges allowed and (95 % intervals found), mean passing frequencies in %, and lines\n"
        "whose number in the paper is excluded (p < 0.05).",
        _markdown(_readings(own.table_3_readings)),
        "### What the models lack",
        "Candidates added to Table 4, and to a point mass that explains the sphere, on these arrivals. *over none*:\n"
        "log probability of the blocks that the candidate was not calibrated on, above that of no candidate; *error*:\n"
        "its standard error over hypotheses; *effective*: number of hypotheses that carry the weight.",
        _markdown(own.missing_effects),
    ]


def _readings(table: pd.DataFrame) -> pd.DataFrame:
    """The readings of Table 3 with each range in one column."""
    ranges = {
        name: [
            f"{row[f'{name}_from']:.0f} to {row[f'{name}_to']:.0f} "
            f"({row[f'{name}_low95']:.0f} to {row[f'{name}_high95']:.0f})"
            for row in table.to_dict("records")
        ]
        for name in ("facing_deg", "line_tilt_deg")
    }
    columns = ["reading", "momentum_factor", *ranges, *published.LINES, "excluded"]
    return table.assign(**ranges)[columns]


def _candidates(results: Results) -> list[str]:
    return [
        "One held-out cell at a time, predicted by hypotheses without a candidate effect fitted to the other cells:",
        _markdown(results.cells),
        "## Candidate physics",
        "Effects of the catalogue that change an impact, each compared with none, on hypotheses that were not fitted\n"
        "to the cells of one block. *share*: posterior probability; *share all cells*, *bayes factor*: the same once\n"
        "these cells are fitted too.",
        _markdown(results.candidates),
    ]


def _markdown(table: pd.DataFrame) -> str:
    rows = [[_cell(value) for value in row] for row in table.itertuples(index=False)]
    return _markdown_rows([spoken(str(column)) for column in table.columns], rows)


def _markdown_rows(head: list[str], rows: list[list[str]]) -> str:
    lines = [" | ".join(cells).join(("| ", " |")) for cells in (head, *rows)]
    return "\n".join([lines[0], "|" + "---|" * len(head), *lines[1:]])


def _cell(value: object) -> str:
    if not isinstance(value, float):
        return str(value)
    if value != value:
        return ""
    return f"{value:.0f}" if abs(value) >= 1000 else f"{value:.3g}"
