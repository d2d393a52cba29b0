"""The page of a scored trial: one HTML file with its figures."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rock2d.blind.scoring import (
    ABSENT_SIGNAL_TO_NOISE,
    CALIBRATION_BINS,
    CLAIMED_PROBABILITY,
    CLEAR_SIGNAL_TO_NOISE,
    CLOSURE_MARGIN,
    LABEL_KINDS,
    PRESENT_SIGNAL_TO_NOISE,
    SIGNAL_TO_NOISE_EDGES,
    SURE_PROBABILITY,
    ScoredCase,
    inclusion_pairs,
    known_closures,
)
from rock2d.blind.size_errors import LARGEST_ERROR
from rock2d.files.folders import write_whole
from rock2d.graphics.pages import PAGE_ACCENT, PAGE_INK, PAGE_RULE, PAGE_WARM, Section, Table, blank_axes, drawn, page
from rock2d.statistics import share_text, wilson_interval

if TYPE_CHECKING:
    from matplotlib.figure import Figure

CALIBRATION_COLUMNS = ("pairs", "present", "auroc", "brier", "ece", "ece_if_calibrated")
CALIBRATION_HEAD = ("", "pairs", "present", "AUROC", "Brier", "ECE", "ECE of chance alone")
KIND_COLOURS = (PAGE_INK, PAGE_ACCENT, "#009e73", PAGE_WARM)  # in the order of LABEL_KINDS
_MARGIN = f"{100 * CLOSURE_MARGIN:.0f} points"
CLOSURE_HEAD = ("closure: median of claimed less true", f"within {_MARGIN}", f"claimed more than {_MARGIN} too much")
PREDICTED_CLOSURE = (
    "The true closure here is the share of the gap of the typical miss that is closed in the held-out film. The floor "
    "is what the diagnosed model would miss in that film if it were exact, at most what it reaches."
)
GROUP_NAMES = {"all": "all cases", "without_outside": "no outside cause", "with_outside": "with an outside cause"}


def write_page(cases: Sequence[ScoredCase], found: dict[str, Any], digest: str, path: Path) -> None:
    """Write the page; `found`: `summary` of the cases; `digest`: SHA-256 of the sealed labels."""
    write_whole(path, page(f"Blind trial of {found['cases']} cases", list(_sections(cases, found, digest))))


def _sections(cases: Sequence[ScoredCase], found: dict[str, Any], digest: str) -> Iterator[Section]:
    yield Section(texts=[
        f"SHA-256 of the sealed labels: `{digest}`",
        "The named set of a case holds the effects that the diagnosis names. A named effect is right if it, or one "
        "that it shares its name with, is hidden, whatever its strength. Brackets are 95 % Wilson intervals.",
    ])  # fmt: skip
    yield from _base_section(found.get("by_base", {}))
    yield Section(
        "Single verdicts",
        tables=[Table((), [(name.replace("_", " "), share_text(own)) for name, own in found["verdict"].items()])],
    )
    yield _calibration_section(found["inclusion"])
    title = "Stated and actual inclusion"
    yield Section(title, pictures=[drawn(_reliability_figure(cases), title, "svg")])
    yield _recall_section(found)
    yield Section(
        "Named effects that are hidden",
        [f"Cases without cause of which one is named: {share_text(found['nulls_with_a_cause_named'])}"],
        tables=[Table((), [(GROUP_NAMES[k], share_text(v)) for k, v in found["precision"].items()])],
    )
    yield _releases_section(found["by_releases"])
    yield _outside_section(found["outside"])
    yield Section(
        f"Wrong effects with a probability above {SURE_PROBABILITY:g}",
        items=[_wrong_text(wrong) for wrong in found["wrong_and_sure"]] or ["none"],
    )
    yield from _closure_section(cases, found["closure"])
    yield from _prediction_section(found["predicted"])
    yield from _sizes_section(found["sizes"])
    yield Section(texts=[f"Median time for a case: {found['median_seconds']:.0f} s"])


def _base_section(found: dict[str, dict[str, Any]]) -> Iterator[Section]:
    """Section on made cases and on cases from each real record; none if all are made."""
    if not found:
        return
    rows = [
        (
            base, *(_clear_text(groups) for groups in (own["recall"], {"": {"": own["first_right_single"]}})),
            share_text(own["precision"]["all"]), share_text(own["nulls_with_a_cause_named"]),
            f"{100 * own['sizes']['all']['median_absolute']:.0f} %",
        )
        for base, own in found.items()
    ]  # fmt: skip
    head = ("base", f"named (signal-to-noise from {CLEAR_SIGNAL_TO_NOISE:g})", "single causes of these named first",
            "named effects right", "nulls with a cause named", "median size of the error")  # fmt: skip
    yield Section("By base of the cases", tables=[Table(head, rows)])


def _clear_text(groups: dict[str, dict[str, dict[str, list[float]]]]) -> str:
    """Number of clear effects that were named, and of all clear ones, from shares by signal-to-noise."""
    clear = [f"{low:g} to {high:g}" for low, high in itertools.pairwise(SIGNAL_TO_NOISE_EDGES)
             if low >= CLEAR_SIGNAL_TO_NOISE]  # fmt: skip
    shares = [levels[name] for counts in groups.values() for levels in counts.values() for name in clear]
    hits = sum(round(share[0] * share[3]) for share in shares if share[3])
    return f"{hits} of {sum(share[3] for share in shares):.0f}"


def _prediction_section(found: dict[str, Any]) -> Iterator[Section]:
    """Section on predictions of held-out films; none without predictions."""
    rows = [
        (
            name, f"{100 * own['median_smaller']:.0f} %", share_text(own["tail_not_worse"]),
            share_text(own["stated"]), *_closure_cells(own),
        )
        for name, own in found.items()
        if own["tail_not_worse"][3]
    ]  # fmt: skip
    head = ("hidden", "typical miss smaller by (median)", "tail not worse than the base law's", "closure stated",
            *CLOSURE_HEAD)  # fmt: skip
    if rows:
        yield Section("Predictions of held-out films", [PREDICTED_CLOSURE], tables=[Table(head, rows)])


def _closure_cells(own: dict[str, Any]) -> tuple[str, str, str]:
    """The cells below CLOSURE_HEAD; empty without a closure."""
    if not own["within_15_points"][3]:
        return "", "", ""
    median = f"{100 * own['median_claimed_less_true']:+z.1f} points"
    return median, share_text(own["within_15_points"]), share_text(own["claimed_too_much"])


def _calibration_section(found: dict[str, Any]) -> Section:
    rows = {"all": found, **found["by_effect"]}
    return Section(
        "Inclusion probabilities",
        [f"Every case with every effect of the catalogue is a pair. A hidden effect with a signal-to-noise of its own "
         f"of at least {PRESENT_SIGNAL_TO_NOISE:g} is present, one below {ABSENT_SIGNAL_TO_NOISE:g} is absent. "
         f"{found['undecidable']} pairs between them are undecidable and left out. ECE: expected calibration error."],
        tables=[Table(CALIBRATION_HEAD, [
            (name, *(f"{own[key]:.4g}" for key in CALIBRATION_COLUMNS)) for name, own in rows.items()
        ])],
    )  # fmt: skip


def _recall_section(found: dict[str, Any]) -> Section:
    groups = [
        (f"{count} hidden, {GROUP_NAMES[beside]}", own)
        for beside, counts in found["recall"].items()
        for count, own in counts.items()
    ] + [("named first (single causes)", found["first_right_single"])]
    rows = [(level, *(share_text(own[level]) for _, own in groups)) for level in found["first_right_single"]]
    head = ("signal-to-noise", *(name for name, _ in groups))
    return Section("Hidden effects that are named", tables=[Table(head, rows)])


def _releases_section(found: dict[str, dict[str, list[float]]]) -> Section:
    head = ("releases", f"present effects named (signal-to-noise from {PRESENT_SIGNAL_TO_NOISE:g})",
            "named effects right", "nulls with a cause named")  # fmt: skip
    rows = [(name, *map(share_text, own.values())) for name, own in found.items()]
    return Section("By number of releases", tables=[Table(head, rows)])


def _outside_section(found: dict[str, Any]) -> Section:
    return Section(
        "Causes from outside the catalogue",
        [f"Clear ones (signal-to-noise at least {CLEAR_SIGNAL_TO_NOISE:g}) against cases without."],
        tables=[Table((), [
            ("AUROC", f"{found['auroc']:.3g}"),
            (f"clear ones with a probability of at least {CLAIMED_PROBABILITY:g}", share_text(found["recall_clear"])),
            ("false alarms", share_text(found["false_alarms"])),
        ])],
    )  # fmt: skip


def _wrong_text(wrong: dict[str, Any]) -> str:
    hidden = {**wrong["hidden"]} | ({} if wrong["outside"] is None else {"outside cause": wrong["outside"]})
    truth = ", ".join(f"{name} (signal-to-noise {z:.1f})" for name, z in hidden.items()) or "nothing"
    return f"case {wrong['case']}: {wrong['effect']} (probability {wrong['p']:.2f}); hidden {truth}"


def _closure_section(cases: Iterable[ScoredCase], found: dict[str, Any]) -> Iterator[Section]:
    """Section on claimed and true closure; none if no case has both."""
    rows = [(name, *_closure_cells(own)) for name, own in found.items() if own["within_15_points"][3] > 0]
    if rows:
        title, head = "Claimed and true closure", ("hidden", *CLOSURE_HEAD)
        yield Section(title, pictures=[drawn(_closure_figure(cases), title, "svg")], tables=[Table(head, rows)])


def _sizes_section(found: dict[str, dict[str, Any]]) -> Iterator[Section]:
    """Section on sizes of named effects and hidden sizes; none if no sizes can be compared."""
    if not found["all"]["count"]:
        return
    rows = [
        (
            name, f"{own['count']}", f"{100 * own['median']:+z.0f} %", f"{100 * own['median_absolute']:.0f} %",
            share_text(own["within"]), share_text(own["covered"]),
        )
        for name, own in found.items()
    ]  # fmt: skip
    head = ("effect", "compared", "median error", "median size of the error", f"within {100 * LARGEST_ERROR:.0f} %",
            "95 % intervals that hold the hidden size")  # fmt: skip
    text = ("Where a parameter means the same in the catalogue and in the reality engine. Errors are relative to the "
            "hidden size; of factors, their logarithms are compared.")  # fmt: skip
    yield Section("Sizes of named effects", [text], tables=[Table(head, rows)])


def _reliability_figure(cases: Sequence[ScoredCase]) -> Figure:
    """Share of present effects over their probability, in bins with equal numbers of pairs with a probability above
    0."""
    figure, (axes,) = blank_axes(4.2, 4.0)
    axes.plot([0, 1], [0, 1], color=PAGE_RULE)
    pairs = [(p, present) for _, p, present in inclusion_pairs(cases) if p > 0.0]
    p, present = np.array([pair[0] for pair in pairs]), np.array([pair[1] for pair in pairs])
    for part in np.array_split(np.argsort(p, kind="stable"), max(1, min(CALIBRATION_BINS, len(p)))):
        if len(part):
            low, high = wilson_interval(int(present[part].sum()), len(part))
            share = present[part].mean()
            axes.errorbar(p[part].mean(), share, [[share - low], [high - share]], fmt="o", color=PAGE_ACCENT)
    axes.set_xlabel("inclusion probability of a listed effect")
    axes.set_ylabel("share present")
    return figure


def _closure_figure(cases: Iterable[ScoredCase]) -> Figure:
    figure, (axes,) = blank_axes(5.2, 4.6)
    known = known_closures(cases)
    axes.plot([0, 1], [0, 1], color=PAGE_RULE)
    for shift in (-CLOSURE_MARGIN, CLOSURE_MARGIN):
        axes.plot([0, 1], [shift, 1 + shift], color=PAGE_RULE, linestyle=":")
    for kind, colour, marker in zip(LABEL_KINDS, KIND_COLOURS, "osD^", strict=True):
        own = [(true, claimed) for k, claimed, true in known if k == kind]
        if own:
            axes.plot(*np.array(own).T, marker, color=colour, markersize=4, label=kind)
    axes.set_xlabel("true closure")
    axes.set_ylabel("claimed closure")
    axes.legend(frameon=False)
    return figure
