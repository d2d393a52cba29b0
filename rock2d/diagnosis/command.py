"""The commands `rock2d diagnose`, `rock2d predict` and `rock2d compare`: files in, files out."""

import gc
import json
import os
import shlex
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

from rock2d.diagnosis.detection import EXPECTED, detection_curves, limits_of, read_limits
from rock2d.diagnosis.diagnose import Diagnosis, diagnose
from rock2d.diagnosis.diagnosis_content import diagnosis_json, film_sentences
from rock2d.diagnosis.evidence import NAMED_PROBABILITY
from rock2d.diagnosis.known_causes import effects_of_size
from rock2d.diagnosis.predict import COLUMNS, TABLE_COLUMNS, predict, read_for_prediction, setup_remarks
from rock2d.diagnosis.workload import DiagnosisBars
from rock2d.effects import catalogue
from rock2d.errors import InputError, counted
from rock2d.files.csv_tables import write_csv
from rock2d.files.diagnosis import DIAGNOSIS, diagnosis_text, is_diagnosis, read_diagnosis
from rock2d.files.diagnosis_keys import BlockScale
from rock2d.files.experiment import kind_and_table, load_experiment
from rock2d.files.folders import atomic_file, atomic_folder, check_file, check_own_file, make_folder, write_whole
from rock2d.files.text_files import read_json
from rock2d.runs.diagnosis_remarks import NOT_FITTED_WARNING, scale_remarks

COMPARISON, COMPARISON_PAGE = "comparison.json", "comparison.html"
FITS = ".fits"  # folder of finished fits, removed at the end


def run_diagnosis(
    experiment: Path,
    out: Path,
    *,
    seed: int,
    workers: int | None,
    limits: Path | None = None,
    progress: bool,
    report: Callable[[str], None],
) -> dict[str, Any]:
    """Diagnose an experiment folder. Writes diagnosis.json and report.html, and returns the content of the former.

    `limits`: folder of a study of known causes, whose limits the report shows; Path(): the expected limits"""
    from rock2d.diagnosis.report.page import write_report
    from rock2d.graphics.rendering import page_date

    page_date()  # raises for an invalid date before the work starts
    read = load_experiment(experiment)
    _refuse_foreign(out)
    studied = read_limits(limits, read) if limits not in (None, Path()) else None
    names = list(catalogue())
    _, rows = kind_and_table(read)
    releases, length = counted(rows["release"].nunique(), "release"), counted(len(rows), "row")
    report(f"{read.name}: {releases}, {length}; {counted(len(names), 'effect')} to try")
    make_folder(out)
    gc.collect()
    gc.freeze()  # modules stay: the garbage collector need not walk over them
    processes = workers or os.cpu_count() or 1
    bars = DiagnosisBars(progress, len(names), processes)
    result = diagnose(read, seed=seed, workers=processes, folder=out / FITS, bars=bars)
    content = diagnosis_json(result)
    words = ["rock2d", "diagnose", str(experiment), "--out", str(out), "--seed", str(seed)]
    if limits is not None and result.found is not None:
        content["limits"] = studied if studied is not None else limits_of(detection_curves(result, effects_of_size("")))
        content["assumptions"] += [] if studied is not None else [EXPECTED]
        words += ["--limits"] if studied is None else ["--limits", str(limits)]
    text = diagnosis_text(content)
    write_report(result, content, out, bars=bars, command=shlex.join(words))
    write_whole(out / DIAGNOSIS, text)
    shutil.rmtree(out / FITS, ignore_errors=True)
    report(f"written: {out / DIAGNOSIS}, {out / 'report.html'}")
    for line in film_sentences(result):
        report(f"film: {line}")
    for line in result.sanity.remarks:
        report(f"remark: {line}")
    if result.found is None:
        raise InputError(f"not diagnosed: {'; '.join(content['sanity']['faults'])}", experiment, code="not_diagnosed")
    for line in summary(result, content):
        report(line)
    return content


def _refuse_foreign(out: Path) -> None:
    """Raise InputError for a folder with files that are neither a diagnosis nor the fits of an interrupted one."""
    if not out.is_dir() or not any(out.iterdir()) or (out / FITS).is_dir():
        return
    try:
        content = read_json(out / DIAGNOSIS)
    except InputError:
        content = None
    if not is_diagnosis(content):
        message = "exists and is not a diagnosis; choose another output folder"
        raise InputError(message, out, code="not_a_result")


def summary(result: Diagnosis, content: dict[str, Any]) -> list[str]:
    """The diagnosis in a few lines, and what to do."""
    from rock2d.diagnosis.report.sections import checks_sentence
    from rock2d.diagnosis.report.text import (
        common_words,
        has_significant_place,
        physical_misses,
        predicted_words,
        share_closed,
        unseen_words,
    )
    from rock2d.diagnosis.report.what_to_do import what_to_do

    verdict = content["verdict"]
    lines = [f"verdict: {verdict} (p = {content['probabilities'][verdict]:.2f})"]
    if len(content["group"]) > 1:
        lines.append("not separated: " + ", ".join(content["group"]))
    gap = content["gap"]
    closed = f"share closed {share_closed(gap['closure'], gap['closure_ci95'])}"
    if gap["closure"] == 0.0 and gap["closure_ci95"][1] == 0.0:
        closed = "no significant gap" if verdict == "none" else "nothing closes a part of it"
    found = "" if verdict == "none" else f"{gap['augmented']:.3g} with what was found, "
    lines.append(f"gap: {gap['base']:.3g} base, {found}{gap['noise_floor']:.3g} floor; {closed}")
    if (own := content["predicted"]) is not None and verdict != "none":
        closed = share_closed(own["typical"]["closure"], own["typical"]["closure_ci95"])
        lines.append(f"closed by predictions: {closed}, {predicted_words(own)}")
    if verdict != "none" and (misses := physical_misses(content)):
        lines.append("misses, without → with it: " + ", ".join(map(" ".join, misses)))
    for cause in content["causes"]:
        if cause["closes"] is not None:
            rivals = f"; not separated from {', '.join(cause['group'])}" if cause["group"] else ""
            rivals += common_words(content, cause["effect"])
            lines.append(
                f"cause: {cause['effect']} ({cause['origin']}, p = {cause['p']:.2f}{rivals}) closes {_shares(cause)}"
            )
    outside = content["outside"]
    if outside and outside["p"] >= NAMED_PROBABILITY:
        percent = round(100 * outside["share"])
        share = f"{percent} % of the gap" if percent else "no measurable part of the gap"
        dependence = f", depending on the {outside['depends_on'][0]}" if outside["depends_on"] else ""
        learnt = outside["learnt"]
        beside = f" with {', '.join(learnt['effects'])} (not certain)" if learnt and learnt["effects"] else ""
        closes = f"; learnt changes{beside} close {_shares(learnt)}" if learnt else ""
        lines.append(f"outside the catalogue (p = {outside['p']:.2f}): {share}{dependence}{closes}")
    elif outside and outside["learnt"]:
        changes = " and ".join(outside["learnt"]["changes"])
        lines.append(f"learnt, {changes}: closes {_shares(outside['learnt'])}")
    if result.checks is not None:
        lines.append(f"checks: {checks_sentence(result.checks)}")
    for cell in content["where"][:3] if has_significant_place(content) else []:
        lines.append(
            f"where: {100 * cell['share']:.0f} % {cell['phase']}, {cell['zone']}, {cell['block']}, {cell['channel']}"
        )
    lines += [f"cannot be seen: {', '.join(names)} ({why})" for why, names in unseen_words(content)]
    lines.append(f"next release: {content['next_release']}")
    advice = what_to_do(content, result.experiment)
    return lines + [f"what to do: {line}".replace("\n", " ") for line in advice]


def _shares(part: dict[str, Any]) -> str:
    low, high = part["closes_ci95"]
    return f"{100 * part['closes']:z.0f} % ({100 * low:z.0f} to {100 * high:z.0f} %)"


def _diagnosis_file(given: Path) -> Path:
    return given / DIAGNOSIS if given.is_dir() else given


def run_comparison(first: Path, second: Path, out: Path, *, report: Callable[[str], None]) -> dict[str, Any]:
    """Compare two diagnoses (folders or files); writes comparison.json and comparison.html, returns the first."""
    from rock2d.diagnosis.comparison import comparison
    from rock2d.diagnosis.report.comparison_page import comparison_lines, comparison_page
    from rock2d.graphics.rendering import Made

    given = [_diagnosis_file(path) for path in (first, second)]
    a, b = (read_diagnosis(path)[1] for path in given)
    files = dict(zip("ab", map(str, given), strict=True))
    content = {**comparison(a, b), "files": files}
    words = ["rock2d", "compare", str(first), str(second), "--out", str(out)]
    with atomic_folder(out, "comparison") as partial:
        page = comparison_page(content, files, Made.now(shlex.join(words), None))
        (partial / COMPARISON_PAGE).write_text(page, encoding="utf-8")
        text = json.dumps(content, indent=1, allow_nan=False) + "\n"
        (partial / COMPARISON).write_text(text, encoding="utf-8")
    for line in comparison_lines(content):
        report(line)
    report(f"written: {out / COMPARISON}, {out / COMPARISON_PAGE}")
    return content


def run_prediction(
    experiment: Path, diagnosis: Path, out: Path, *, base_only: bool, report: Callable[[str], None]
) -> None:
    """Predict the film or impact table of an experiment folder with a diagnosis (folder or file); writes a CSV file."""
    read, content = load_experiment(experiment), read_for_prediction(_diagnosis_file(diagnosis))
    check_file(out)
    check_own_file(out, ",".join(TABLE_COLUMNS if read.trajectories is None else COLUMNS))
    known = {name: BlockScale.model_validate(scale) for name, scale in content.get("blocks", {}).items()}
    fitted = content.get("law", {}).get("fitted", True)
    remarks = [*setup_remarks(read, content), *scale_remarks(known, read.blocks)]
    for remark in remarks if fitted else [NOT_FITTED_WARNING, *remarks]:
        report(remark)
    table = predict(read, content, base_only=base_only)
    with atomic_file(out) as partial:
        write_csv(partial, table)
    report(f"written: {out} ({len(table)} rows, {len(table.groupby(['release', 'segment']))} segments)")
