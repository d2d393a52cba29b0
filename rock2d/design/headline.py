"""The head of a report in words: the target, the answer, and the bound that decides."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

from rock2d.design.report_tables import quantity_text
from rock2d.design.uncertainty import FREQUENCY
from rock2d.files.places import number_at
from rock2d.scene.earthworks import ARRIVAL_LINE, CREST_LINE, is_line
from rock2d.statistics import Estimate
from rock2d.wording import three_digits, with_interval

if TYPE_CHECKING:
    from rock2d.design.least_size import Answer
    from rock2d.design.report_sections import ReportContent
    from rock2d.files.scenario import Scenario


class Worst(NamedTuple):
    """The block that passes a line most often, and its frequency."""

    block: str
    line: str
    frequency: Estimate


def worst_blocks(content: ReportContent) -> list[Worst]:
    """The block with the largest upper bound, at the crest of each embankment from uphill to downhill, or at the last
    line; for a search at the line of its target, by the judged bounds. Empty without a measure line."""
    if content.answer is not None:
        shown = content.answer.shown
        found = Estimate(*(of_block[shown.worst] for of_block in (shown.median, shown.low, shown.high)))
        return [Worst(shown.worst, content.answer.target.line, found)]
    table: Any = content.tables.get("passing")
    if (uncertain := content.uncertain) is not None:
        table = uncertain[uncertain["quantity"] == FREQUENCY].rename(columns={"value": "frequency"})
    if table is None or not len(table):
        return []
    lines = list(map(str, table["line"].unique()))
    worst = []
    for line in [line for line in lines if is_line(line, CREST_LINE)] or lines[-1:]:
        row = table.loc[table[table["line"] == line]["high95"].idxmax()]
        share = Estimate(*map(float, row[["frequency", "low95", "high95"]]))
        worst.append(Worst(str(row["block"]), line, share))
    return worst


def headline(content: ReportContent) -> str:
    """The answer in a few words."""
    if content.answer is not None:
        return f"{_subject(content.answer, content.scenario)} {_verb(content.answer)} the target"
    if content.remarks:
        return "Not resolved"
    if not (worst := worst_blocks(content)):
        return "Where blocks go"
    return f"{with_interval(*worst[-1].frequency, 100.0)} % of {worst[-1].block} pass {worst[-1].line}"


def first_sentence(content: ReportContent) -> str:
    """The answer and its uncertainty in one sentence; empty without a measure line."""
    if content.answer is not None:
        return answer_sentence(content.answer, content.scenario)
    if not (found := worst_blocks(content)):
        return ""
    worst = found[-1]
    over = "sampling" if content.assessment is None else "sampling and what is not known"
    often = ", which pass most often," if worst.frequency.value > 0.0 else ""
    text = (
        f"Of the released blocks of {worst.block}{often} {with_interval(*worst.frequency, 100.0)} % "
        f"pass {worst.line} (95 % interval over {over})"
    )
    loads = [_governing(content, quantity) for quantity in ("energy_J", "height_m")]
    if all(loads):
        text += f"; the arriving blocks require a design energy of {loads[0]} and a design height of {loads[1]}"
    return f"{text}."


def answer_sentence(answer: Answer, scenario: Scenario) -> str:
    """The answer of a search with its target and the judged upper bound."""
    target, shown = answer.target, answer.shown
    asked = target.text.rpartition(", at ")[0]
    others = ", and no more of the others" if len(shown.high) > 1 else ""
    return (
        f"{_subject(answer, scenario)} {_verb(answer)} the target that {asked}: at {100 * target.confidence:.3g} % "
        f"confidence, up to {bound_text(shown.high[shown.worst], target.frequency)} % of the {target.per} blocks of "
        f"{shown.worst} do{others}.{_unresolved_text(answer)}"
    )


def _unresolved_text(answer: Answer) -> str:
    """A sentence on unresolved releases of the worst block, if no size meets the target; else empty."""
    shown = answer.shown
    share = shown.unresolved.get(shown.worst, 0.0)
    if answer.least is not None or share == 0.0:
        return ""
    size = "; so no size can meet it" if share > answer.target.frequency else ""
    return (
        f" {100 * share:.2g} % of the releases of {shown.worst} were cut short or buried before {answer.target.line}, "
        f"and count as passed{size}."
    )


def bound_text(bound: float, target: float) -> str:
    """An upper bound in %, with enough digits to show on which side of the target it lies."""
    shown = three_digits(100.0 * bound)
    return shown if (float(shown) <= 100.0 * target) == (bound <= target) else f"{100.0 * bound:.12g}"


def norm_sentence(content: ReportContent) -> str:
    """The least height of a search, the height that the norms require, and which one governs; empty if the search did
    not vary a height, or if no block arrives."""
    answer, height = content.answer, _largest(content, "height_m")
    if answer is None or height is None or not _is_height(answer):
        return ""
    asked, shown = height.design, answer.shown.size
    if answer.least is None:
        own = f"more than {shown:.4g} m"
        governs = "the target" if asked <= shown else "not known: enlarge the range"
    else:
        own = answer.least_text.replace(" (", " m (", 1)
        governs = "not known: begin the range lower" if answer.is_bound else "the target"
        governs = "the norm" if asked > shown else governs
    return (
        f"Height: the target requires {own} above the ground where the embankment stands, {height.norm} requires "
        f"{_estimate_text(height)} above the ground at the line {height.line}. What governs, if blocks follow "
        f"the ground between the two: {governs}."
    )


def _subject(answer: Answer, scenario: Scenario) -> str:
    """The shown size as the subject of a sentence."""
    size = answer.shown.size
    text = f"{answer.place} = {size:.4g}"
    if _is_height(answer):
        x_m = number_at(scenario.document.data, f"{answer.place.removesuffix('height_m')}x_m")
        text = f"An embankment {size:.4g} m high" + ("" if x_m is None else f" at x = {x_m:.4g} m")
    if answer.least is None:
        return f"{text}, the largest of the range,"
    return f"{text}, where the range begins," if answer.is_bound else text


def _verb(answer: Answer) -> str:
    return "does not meet" if answer.least is None else "meets"


def _is_height(answer: Answer) -> bool:
    return answer.place.startswith("embankment.") and answer.place.endswith(".height_m")


def _largest(content: ReportContent, quantity: str) -> Any:
    """The row of the largest design value of a quantity over blocks and norms at the arrival line; None without one."""
    if "percentiles" not in content.tables:
        return None
    table = content.design_values
    arriving = table["line"].isin([line for line in table["line"].unique() if is_line(line, ARRIVAL_LINE)])
    rows = table[arriving & (table["quantity"] == quantity)].dropna(subset="design")
    return next(rows.sort_values("design", ascending=False, kind="stable").itertuples(), None)


def _estimate_text(row: Any) -> str:
    return quantity_text(row.quantity, row.design, row.low95, row.high95)


def _governing(content: ReportContent, quantity: str) -> str:
    """The largest design value with its interval, norm and block; empty without one."""
    row = _largest(content, quantity)
    return "" if row is None else f"{_estimate_text(row)} ({row.norm}, {row.block})"
