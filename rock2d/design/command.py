"""The command `rock2d design`: find the least size that meets a target, and write it with a page."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from rock2d.cluster import THIS_PROCESS, Workers, job_runner
from rock2d.design.least_size import Answer, Judgement, Search, Target, least_size, size_bars, work_of_sizes
from rock2d.design.least_volume import (
    COMBINATIONS,
    Combination,
    check_varied,
    combination_table,
    least_volume,
    volume_text,
)
from rock2d.design.norms import norm_remarks
from rock2d.errors import counted
from rock2d.files.folders import atomic_folder, check_output_folder, make_folder, path_inside, write_whole
from rock2d.files.saved_arrays import fingerprint
from rock2d.files.scenario_checks import engine_remarks
from rock2d.files.scenario_reading import load_scenario
from rock2d.files.scenario_variants import scenario_text, variant
from rock2d.files.text_files import read_json
from rock2d.graphics.pages import check_printer
from rock2d.runs.diagnosis_remarks import diagnosis_remarks
from rock2d.runs.printed_tables import table_note

if TYPE_CHECKING:
    from rock2d.progress import Bar, Bars
    from rock2d.runs.results import RunResult

FLOOR_OF_TARGET = 0.5  # share of the target: if no size has a lower bound, more releases may help
KIND = "design"  # of a folder of results
MOST_SHOWN = 1000  # releases of each block on the page
PAGE_STAGE, PAGE_WORK = "page", 8000.0  # name of the stage, and its work in simulated releases


def run_design(
    path: Path,
    place: str,
    bounds: tuple[float, float],
    target: Target,
    out: Path,
    *,
    over: Sequence[tuple[str, float, float]] = (),
    engine: str | None = None,
    seed: int | None = None,
    tolerance: float | None = None,
    data_root: Path | None = None,
    overwrite: bool = False,
    progress: bool = True,
    workers: Workers = THIS_PROCESS,
    command: str = "rock2d.design in Python",
    pdf: bool = False,
    report: Callable[[str], Any] = print,
) -> Answer:
    """Find the least size, write the folder `out` (design.json, design.csv, least.yaml, page and figures), and report
    the answer.

    The page, report.html and with `pdf` report.pdf, shows the least size, or the largest if none meets the target; it
    also shows the `command`. With further numbers to vary, `over` (place, low, high), the answer is the combination of
    least volume of earth, and combinations.csv and combinations.png are written.

    The same call continues an interrupted search. The answer does not depend on the workers. Raises InputError for a
    mistake in the scenario or in the arguments."""
    from rock2d.progress import Bars

    if pdf:
        check_printer()
    scenario = load_scenario(path, data_root)
    ranges = {name: (low, high) for name, low, high in over}
    check_varied(place, ranges)
    check_output_folder(out, overwrite, KIND)
    for remark in (*diagnosis_remarks(scenario), *engine_remarks(scenario, engine)):
        report(remark)
    seed = scenario.seed if seed is None else seed
    with job_runner(workers) as run_jobs:
        search = Search(scenario, place, bounds, target, engine or scenario.engine, seed, ranges, run_jobs)
        search.check()
        bars = Bars(progress, {} if over else {**work_of_sizes(search, tolerance), PAGE_STAGE: PAGE_WORK})
        combinations: list[Combination] = []
        with KeptSizes(search, out) as kept:
            if over:
                combinations = least_volume(search, kept.judged, bars, tolerance)
                answer = combinations[0].answer
            else:
                with size_bars(search, bars, tolerance) as bar_of:
                    answer = least_size(search, lambda size: kept.judged(size, bar_of(size)), tolerance)
            with atomic_folder(out, KIND) as partial:
                text = _write_results(partial, search, answer, command, bars, combinations, pdf)
    report(f"{text}\nwritten: {out}")
    return answer


class KeptSizes:
    """The judgements of a search, kept in a hidden folder until the search ends, so that the same search can continue
    after an interruption."""

    def __init__(self, search: Search, out: Path) -> None:
        import numpy as np

        self._search, self._folder = search, out.parent / f".{out.name}.judged"
        scenario = search.scenario
        diagnosis = scenario.diagnosed.fingerprint if scenario.diagnosed else ""
        drawn = fingerprint(scenario.posterior.draws) if scenario.posterior else ""
        text = json.dumps(
            [scenario_text(scenario), search.place, asdict(search.target), search.engine, search.seed, diagnosis,
             drawn, search.over]
        )  # fmt: skip
        self._key = fingerprint(np.frombuffer(text.encode(), np.uint8))

    def __enter__(self) -> KeptSizes:
        make_folder(self._folder)
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: Any) -> None:
        if kind is None:
            shutil.rmtree(self._folder, ignore_errors=True)
            return
        with suppress(OSError):  # a folder that keeps sizes stays
            self._folder.rmdir()
        if kind is KeyboardInterrupt:
            done = len(list(self._folder.glob(f"{self._key}_*.json")))
            message = f"{done} sizes are judged, the same command continues from there"
            raise KeyboardInterrupt(message) from None

    def judged(self, size: float, bar: Bar, others: Mapping[str, float] = MappingProxyType({})) -> Judgement:
        """The judgement of a size with these values of `Search.over`, read from the folder or computed."""
        name = "_".join(f"{value:.12g}" for value in (*others.values(), size))
        file = self._folder / f"{self._key}_{name}.json"
        if file.is_file():
            bar.omit(len(self._search.sites))
            return Judgement(**read_json(file))
        found = self._search.judge(size, bar.update, others)
        write_whole(file, json.dumps(asdict(found)))
        return found


def _write_results(
    folder: Path,
    search: Search,
    answer: Answer,
    command: str,
    bars: Bars,
    combinations: Sequence[Combination],
    pdf: bool,
) -> str:
    """Write design.json, design.csv, combinations.csv, least.yaml and the page of an answer. Returns the answer as
    text. If several numbers were varied, the answer must be that of the first of the `combinations`."""
    from rock2d.version import __version__

    volume = []
    if combinations:
        table = combination_table(combinations)
        table.to_csv(folder / COMBINATIONS, index=False, lineterminator="\n")
        rows = table.to_string(index=False, na_rep="none", float_format=lambda value: f"{value:.4g}")
        volume = [f"{volume_text(combinations)}\n{rows}\n"]
        best = variant(search.scenario, combinations[0].values, uncertain=True)
        search = replace(search, scenario=best, over={})
    scenario = search.scenario
    answer.to_pandas().to_csv(folder / "design.csv", index=False, lineterminator="\n")
    facts = {
        "scenario": scenario.name, "engine": search.engine, "seed": search.seed, "sites": len(search.sites),
        **asdict(answer), "rock2d": __version__,
    }  # fmt: skip
    (folder / "design.json").write_text(json.dumps(facts, indent=2) + "\n", encoding="utf-8")
    if answer.least is not None:
        chosen = variant(scenario, {answer.place: answer.least}, uncertain=True)
        (folder / "least.yaml").write_text(scenario_text(chosen), encoding="utf-8")
        for named in (scenario.diagnosed, scenario.posterior):
            if named is not None:  # the scenario refers to it by a relative path
                copied = path_inside(folder, named.given)
                if copied.name != named.file.name:  # it names the folder of a diagnosis
                    copied /= named.file.name
                copied.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(named.file, copied)
    with bars.stage(PAGE_STAGE, 1, "step") as bar:
        demands = _write_page(folder, search, answer, command, combinations, pdf)
        bar.update()
    return "\n".join([*volume, answer_text(answer, search), *demands, *norm_remarks(search.scenario)])


def answer_text(answer: Answer, search: Search) -> str:
    """The answer as text."""
    target = answer.target
    worst = [
        f"  {each.size:10.4g}  {round(100 * each.median[each.worst], 3):8.3g}  {100 * each.high[each.worst]:8.3g}"
        f"  {'yes' if each.meets else 'no':5s}  {each.worst}"
        for each in answer.judgements
    ]
    if answer.least is None:
        head = f"no {answer.place} up to {answer.shown.size:.4g} meets the target: {target.text}"
    else:
        head = f"least {answer.place}: {answer.least_text}: {target.text}"
    warning = "a larger size fails above one that meets the target: look at design.png"
    notes = [] if answer.monotone else [warning]
    notes += [
        f"{100 * share:.2g} % of the releases of {block} were cut short or buried; the bounds count them as passed"
        for block, share in answer.shown.unresolved.items()
        if share > 0.0
    ]
    largest = answer.judgements[-1]
    floor = largest.high[largest.worst]
    if not any(largest.median.values()) and floor > FLOOR_OF_TARGET * target.frequency:
        notes.append(
            f"with so few releases, the bound is at least {100 * floor:.3g} % although hardly any block passes: more "
            "releases (uncertainty.releases) may allow a smaller size"
        )
    known = "twice uncertainty.sites" if search.scenario.uncertainty else "nothing is uncertain: sampling only"
    left_out = f"; {note}" if (note := table_note(search.scenario)) else ""
    sites = counted(len(search.sites), "possible site")
    of = f"{sites} ({known}), {search.releases} releases of each block on each{left_out}"
    columns = f"  {'size':>10s}  {'median %':>8s}  {'bound %':>8s}  meets  worst block"
    return "\n".join([head, of, columns, *worst, *notes])


def _write_page(
    folder: Path, search: Search, answer: Answer, command: str, combinations: Sequence[Combination], pdf: bool
) -> list[str]:
    """Write the page about the least size, or the largest if none meets the target. Its live view has some releases of
    every judged size.

    Returns in words what the embankment must withstand and which height governs."""
    from rock2d.design.headline import bound_text, norm_sentence
    from rock2d.design.live_slope import SHOWN_OF_OTHERS, ShownRun
    from rock2d.design.report import demand_tiles, write_report
    from rock2d.design.report_sections import REPORTED_TABLES, ReportContent
    from rock2d.runs.engines import compiled_engine
    from rock2d.runs.run import run

    size = answer.shown.size
    engine, releases = compiled_engine(search.engine).name, min(search.scenario.releases, MOST_SHOWN)

    def simulated(size: float, releases: int) -> RunResult:
        chosen = variant(search.scenario, {answer.place: size}, uncertain=True)
        return run(chosen, engine=engine, seed=search.seed, releases=releases)

    sample = simulated(size, releases)
    tables = {name: sample.to_pandas(name) for name in REPORTED_TABLES}
    views = [
        ShownRun(
            f"{judged.size:.4g}",
            sample if judged.size == size else simulated(judged.size, min(releases, SHOWN_OF_OTHERS)),
            f"judged bound {bound_text(judged.high[judged.worst], answer.target.frequency)} %, the target is "
            f"{'met' if judged.meets else 'not met'}",
        )
        for judged in answer.judgements
    ]
    results = ReportContent(sample, tables, answer=answer, combinations=combinations, views=views)
    write_report(results, folder, command, pdf)
    demands = [f"{what}: {value} ({block})" for what, value, block in demand_tiles(results)]
    return [*demands, *filter(None, [norm_sentence(results)])]
