"""The command `rock2d design`: a scenario and a range in, the least size that meets a target out."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path
from types import MappingProxyType
from typing import Any

from rock2d.design.least_size import Answer, Judgement, Search, Target, least_size, size_bars, work_of_sizes
from rock2d.files.folders import atomic_folder, check_replaced, make_folder, path_inside, write_whole
from rock2d.files.saved_arrays import fingerprint
from rock2d.files.scenario import Scenario, load_scenario
from rock2d.files.scenario_variants import scenario_text, variant
from rock2d.files.text_files import read_json
from rock2d.runs.diagnosis_remarks import diagnosis_remarks
from rock2d.runs.tables import table_note

FLOOR_OF_TARGET = 0.5  # share of the target: if the largest size has a higher bound, sampling decides
MOST_SHOWN = 1000  # releases of each block on the page
PAGE, PAGE_WORK = "page", 8000.0  # stage, and its work in simulated releases


def run_design(
    path: Path,
    place: str,
    bounds: tuple[float, float],
    target: Target,
    out: Path,
    *,
    engine: str | None = None,
    seed: int | None = None,
    tolerance: float | None = None,
    overwrite: bool = False,
    progress: bool = True,
    command: str = "rock2d.design in Python",
    changed: Mapping[str, float] = MappingProxyType({}),
    report: Callable[[str], Any] = print,
) -> Answer:
    """Find the least size, write the folder `out` (design.json, design.csv, least.yaml, page and figures), and report.

    The page, report.html, shows the least size, or the largest if none meets the target; it names the `command`.
    `changed` are numbers of the scenario (place -> value) that are other than in its file.

    An interrupted search goes on where it was. Raises InputError for a mistake in the scenario or the question.
    """
    import numpy as np

    from rock2d.progress import Bars

    scenario = load_scenario(path)
    if changed:
        scenario = variant(scenario, changed, uncertain=True)
    engine, seed = engine or scenario.engine, scenario.seed if seed is None else seed
    stages = out.parent / f".{out.name}.judged"
    diagnosis = scenario.diagnosed.fingerprint if scenario.diagnosed else ""
    drawn = fingerprint(scenario.posterior.draws) if scenario.posterior else ""
    text = json.dumps([scenario_text(scenario), place, asdict(target), engine, seed, diagnosis, drawn])
    key = fingerprint(np.frombuffer(text.encode(), np.uint8))
    question = f"{key} {bounds} {tolerance}"
    if changed and not overwrite and (known := _known_answer(out, question)) is not None:
        report(f"known from an earlier search: {out}")
        return known
    check_replaced(out, overwrite)
    for remark in diagnosis_remarks(scenario):
        report(remark)
    search = Search(scenario, place, bounds, target, engine, seed)
    search.check()
    sites, bars = len(search.sites), Bars(progress, {**work_of_sizes(search, tolerance), PAGE: PAGE_WORK})
    make_folder(stages)
    try:
        with size_bars(search, bars, tolerance) as bar_of:

            def judged(size: float) -> Judgement:
                file, bar = stages / f"{key}_{size:.12g}.json", bar_of(size)
                if file.is_file():
                    bar.omit(sites)
                    return Judgement(**read_json(file))
                found = search.judge(size, bar.update)
                write_whole(file, json.dumps(asdict(found)))
                return found

            answer = least_size(search, judged, tolerance)
    except KeyboardInterrupt:
        done = len(list(stages.glob(f"{key}_*.json")))
        raise KeyboardInterrupt(f"{done} sizes are judged, the same command goes on from there") from None
    with atomic_folder(out) as partial:
        _write(
            partial, scenario, answer, {"question": question, "engine": engine, "seed": seed, "sites": sites}
        )
        with bars.stage(PAGE, 1, "step") as bar:
            taken = _write_page(partial, scenario, answer, (engine, seed), command)
            bar.update()
    shutil.rmtree(stages, ignore_errors=True)
    report("\n".join([answer_text(answer, search), *taken]))
    report(f"written: {out}")
    return answer


def _known_answer(folder: Path, question: str) -> Answer | None:
    """The answer that a folder holds, if it is that to this question."""
    file = folder / "design.json"
    if not file.is_file():
        return None
    found = read_json(file)
    if found.get("question") != question:
        return None
    judgements = tuple(Judgement(**own) for own in found["judgements"])
    return Answer(found["place"], Target(**found["target"]), found["least"], found["tolerance"], judgements)


def answer_text(answer: Answer, search: Search) -> str:
    """The answer as a person reads it."""
    target, worst = answer.target, []
    for judged in answer.judgements:
        block = max(judged.high, key=lambda name: judged.high[name])
        worst.append(
            f"  {judged.size:10.4g}  {100 * judged.median[block]:8.3g}  {100 * judged.high[block]:8.3g}"
            f"  {'yes' if judged.meets else 'no':5s}  {block}"
        )
    if answer.least is None:
        head = f"no {answer.place} up to {answer.judgements[-1].size:.4g} meets the target: {target.text}"
    else:
        head = f"least {answer.place}: {answer.least_text}: {target.text}"
    notes = (
        [] if answer.monotone else ["a larger size fails above one that meets the target: look at design.png"]
    )
    shown = next((j for j in answer.judgements if j.size == answer.least), answer.judgements[-1])
    notes += [
        f"{100 * share:.2g} % of the releases of {block} were cut short or buried; the bounds count them as passed"
        for block, share in shown.unresolved.items()
        if share > 0.0
    ]
    largest = answer.judgements[-1]
    floor = max(largest.high.values())
    if not any(largest.median.values()) and floor > FLOOR_OF_TARGET * target.frequency:
        notes.append(
            f"with so few releases the bound does not fall below {100 * floor:.3g} % although hardly a block passes: "
            "more releases (uncertainty.releases) may allow a smaller size"
        )
    known = "" if search.scenario.uncertainty else " (nothing is said to be unknown: sampling only)"
    note = table_note(search.scenario)
    left_out = f"; {note}" if note else ""
    return "\n".join(
        [
            head,
            f"{len(search.sites)} possible sites{known}, {search.releases} releases of each block on each{left_out}",
            f"  {'size':>10s}  {'median %':>8s}  {'bound %':>8s}  meets  worst block",
            *worst, *notes,
        ]
    )  # fmt: skip


def _write(folder: Path, scenario: Scenario, answer: Answer, about: dict[str, Any]) -> None:
    from rock2d.version import __version__

    answer.to_pandas().to_csv(folder / "design.csv", index=False, lineterminator="\n")
    facts = {"scenario": scenario.name, **about, **asdict(answer), "rock2d": __version__}
    (folder / "design.json").write_text(json.dumps(facts, indent=2) + "\n", encoding="utf-8")
    if answer.least is not None:
        chosen = variant(scenario, {answer.place: answer.least}, uncertain=True)
        (folder / "least.yaml").write_text(scenario_text(chosen), encoding="utf-8")
        for named in (scenario.diagnosed, scenario.posterior):
            if named is not None:  # the scenario names it by its path from there
                copied = path_inside(folder, named.given)
                copied.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(named.file, copied)


def _write_page(
    folder: Path, scenario: Scenario, answer: Answer, engine_and_seed: tuple[str, int], command: str
) -> list[str]:
    """The page about the least size, or the largest if none meets the target, with the releases of its scenario.

    Returns what the embankment must take, in words.
    """
    from rock2d.design.report import REPORTED_TABLES, ReportContent, demand_tiles, write_report
    from rock2d.runs.engines import compiled_engine
    from rock2d.runs.resolution import unresolved_remarks
    from rock2d.runs.run import run

    engine, seed = engine_and_seed
    size = answer.judgements[-1].size if answer.least is None else answer.least
    chosen = variant(scenario, {answer.place: size}, uncertain=True)
    releases = min(chosen.releases, MOST_SHOWN)
    sample = run(chosen, engine=compiled_engine(engine).name, seed=seed, releases=releases)
    tables = {name: sample.to_pandas(name) for name in REPORTED_TABLES}
    remarks = unresolved_remarks(tables, chosen.longest_release_s())
    results = ReportContent(chosen, sample, tables, remarks, answer=answer)
    write_report(results, folder, command)
    return [f"{what}: {value} ({block})" for what, value, block in demand_tiles(results)]
