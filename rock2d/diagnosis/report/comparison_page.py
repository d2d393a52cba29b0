"""The page that compares two diagnoses, and the same as lines for a terminal."""

from collections.abc import Callable, Mapping
from typing import Any

from rock2d.diagnosis.comparison import PLACE_KEYS
from rock2d.diagnosis.report import text
from rock2d.graphics.bar_charts import SHAPES, Axis, Mark, axis_over, bar, chart, share_mark, tick_labels
from rock2d.graphics.pages import Download, download
from rock2d.graphics.rendering import Made, rendered
from rock2d.wording import aligned, interval, number, percent, spoken

SIDES = {"a": "base", "b": "effect"}  # side -> its mark and colour in charts
FOLDED_PROBABILITY = 0.005  # answers with a smaller probability in both are folded away
SHOWN_PLACES = 10
TERMINAL_PLACES, TERMINAL_PROBABILITY = 5, 0.01
NOTHING = "–"
JUDGED = {True: "agree", False: "differ", None: NOTHING}


def comparison_page(content: Mapping[str, Any], files: Mapping[str, str], made: Made) -> str:
    """The page as text; `content` is that of comparison.json, `files` the path of each side."""
    shown = [p for p in content["probabilities"] if _largest(p) >= FOLDED_PROBABILITY]
    folded = [p for p in content["probabilities"] if _largest(p) < FOLDED_PROBABILITY]
    axis = Axis(0.0, 1.0)
    closures = [_closure_row(row) for row in content["closures"]]
    closure_axis = axis_over([v for row in closures for mark in row["marks"] for v in (mark.low, mark.high)] + [100.0])
    parameters = [_parameter_row(row) for row in content["parameters"]]
    verdicts = {side: _verdict_text(content, side) for side in SIDES}
    gaps = {side: _gap_texts(content["gap"][side]) for side in SIDES}
    return rendered("rock2d.diagnosis.report", "comparison.html.j2", {
        "content": content, "made": made, "sides": SIDES, "verdicts": verdicts, "gaps": gaps,
        "shapes": SHAPES, "marks": [(side.upper(), mark) for side, mark in SIDES.items()],
        "key_figures": [
            (f"{side.upper()}: {content['experiment'][side]}", verdicts[side],
             f"gap closed: {gaps[side]['closed']}; schema {content['diagnosis_schema'][side]}; {files[side]}")
            for side in SIDES
        ],
        "bars": [_probability_row(axis, p) for p in shown],
        "folded": [_probability_row(axis, p) for p in folded],
        "probability_scale": tick_labels(Axis(0.0, 100.0)),
        "closures": [(row["name"], chart(closure_axis, row["marks"]), row["text"]) for row in closures if row["marks"]],
        "closure_scale": tick_labels(closure_axis),
        "wanted": [row for row in parameters if row["of_interest"]],
        "others": [row for row in parameters if not row["of_interest"]],
        "base": list(map(_law_row, content["base"])),
        "places": content["where"][:SHOWN_PLACES],
        "more_places": content["where"][SHOWN_PLACES:],
        "data": _downloads(content),
    })  # fmt: skip


def comparison_lines(content: Mapping[str, Any]) -> list[str]:
    """The comparison as lines for a terminal: verdicts, gap, probabilities, parameters, places, and notes."""
    rows: list[tuple[str, ...]] = [
        ("", "A", "B"),
        ("experiment", *(content["experiment"][side] for side in SIDES)),
        ("verdict", *(_verdict_text(content, side) for side in SIDES)),
        ("group", *(", ".join(content["group"][side]) or NOTHING for side in SIDES)),
        ("gap closed", *(_gap_texts(content["gap"][side])["closed"] for side in SIDES)),
    ]
    for pair in content["probabilities"]:
        if _largest(pair) >= TERMINAL_PROBABILITY:
            rows.append((f"p({pair['name']})", *(_known(pair[side], percent) for side in SIDES)))
    for row in content["parameters"]:
        if row["of_interest"]:
            shown = _parameter_row(row)
            rows.append((f"{row['effect']}.{row['parameter']}", shown["a"], shown["b"], JUDGED[row["agree"]]))
    for place in content["where"][:TERMINAL_PLACES]:
        name = ", ".join(place[key] for key in PLACE_KEYS)
        rows.append((name, *(f"{100 * place[side]:.0f} %" for side in SIDES)))
    lines = aligned([[_printable(cell) for cell in row] for row in rows])
    return [*lines, *(_printable(f"note: {note}") for note in content["notes"])]


def _printable(said: str) -> str:
    """Replace control characters, which a terminal would interpret."""
    return "".join(sign if sign.isprintable() else "?" for sign in said)


def _largest(pair: Mapping[str, Any]) -> float:
    return max(pair["a"] or 0.0, pair["b"] or 0.0)


def _known(value: Any, words: Callable[[Any], str]) -> str:
    """A value in words; a dash if it is not known."""
    return NOTHING if value is None else words(value)


def _verdict_text(content: Mapping[str, Any], side: str) -> str:
    if not content["diagnosed"][side]:
        return "not diagnosed"
    verdict = content["verdict"][side]
    chance = next(pair[side] for pair in content["probabilities"] if pair["name"] == verdict)
    return f"{spoken(verdict)} ({percent(chance)})"


def _gap_texts(gap: Mapping[str, Any]) -> dict[str, str]:
    """Base, with the effect, floor, and the share closed, as text."""
    keys = ("base", "augmented", "noise_floor")
    numbers = {key: _known(gap[key], "{:.3g}".format) for key in keys}
    known = gap["closure"] is not None and gap["closure_ci95"] is not None
    return numbers | {"closed": text.share_closed(gap["closure"], gap["closure_ci95"]) if known else NOTHING}


def _probability_row(axis: Axis, pair: Mapping[str, Any]) -> tuple[str, Any, list[str]]:
    marks = [
        bar(mark, p, f"{side.upper()}, {spoken(pair['name'])}: {percent(p)}")
        for side, mark in SIDES.items()
        if (p := pair[side]) is not None
    ]
    return spoken(pair["name"]), chart(axis, marks), [_known(pair[side], percent) for side in SIDES]


def _closure_row(row: Mapping[str, Any]) -> dict[str, Any]:
    marks, said = [], []
    for side, mark in SIDES.items():
        own = row[side]
        said.append(NOTHING if own is None else text.share_closed(own["closure"], own["ci95"]))
        if own is not None:
            marks.append(share_mark(mark, own["closure"], own["ci95"], f"{side.upper()}: {said[-1]}"))
    return {"name": spoken(row["effect"]), "marks": marks, "text": said}


def _parameter_row(row: Mapping[str, Any]) -> dict[str, Any]:
    """Texts, and a chart on an axis of its own."""
    known = {side: row[side] for side in SIDES if row[side] is not None}
    axis = axis_over([v for own in known.values() for v in (own["value"], *own["ci95"])], zero=False)
    marks = [
        Mark(SIDES[side], own["value"], own["ci95"][0], own["ci95"][1], f"{side.upper()}: {_value_text(own)}")
        for side, own in known.items()
    ]
    units = {own["unit"] for own in known.values()}
    return {
        **row, **{side: _known(row[side], _value_text) for side in SIDES}, "chart": chart(axis, marks),
        "judged": JUDGED[row["agree"]], "unit": " / ".join(sorted(units - {"1", "choice"})),
    }  # fmt: skip


def _value_text(own: Mapping[str, Any]) -> str:
    low, high = own["ci95"]
    half = 0.5 * abs(high - low)
    return f"{number(own['value'], half or None)}" + (f" ({interval(low, high)})" if half else "")


def _law_row(pair: Mapping[str, Any]) -> tuple[str, ...]:
    """Name, both values, and their ratio."""
    a, b = pair["a"], pair["b"]
    ratio = f"{b / a:.3g}" if a and b is not None else NOTHING
    return pair["name"], _known(a, "{:.4g}".format), _known(b, "{:.4g}".format), ratio


def _downloads(content: Mapping[str, Any]) -> dict[str, Download]:
    """The tables of the page as CSV."""

    def cells(row: Mapping[str, Any], key: str) -> list[Any]:
        known = [row[side] or {key: None, "ci95": (None, None)} for side in SIDES]
        return [cell for own in known for cell in (own[key], *own["ci95"])]

    ends = ("a", "a_low95", "a_high95", "b", "b_low95", "b_high95")
    places = (*PLACE_KEYS, "a", "b")
    return {
        "probabilities": download("probabilities.csv", ("answer", "a", "b"), [
            (p["name"], p["a"], p["b"]) for p in content["probabilities"]]),
        "parameters": download("parameters.csv", ("effect", "parameter", *ends, "agree"), [
            (r["effect"], r["parameter"], *cells(r, "value"), r["agree"]) for r in content["parameters"]]),
        "base": download("law.csv", ("parameter", "a", "b"), [(p["name"], p["a"], p["b"]) for p in content["base"]]),
        "closures": download("closures.csv", ("effect", *ends), [
            (r["effect"], *cells(r, "closure")) for r in content["closures"]]),
        "places": download("where.csv", places, [[place[key] for key in places] for place in content["where"]]),
    }  # fmt: skip
