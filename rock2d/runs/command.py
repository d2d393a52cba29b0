"""The command `rock2d run`: scenario files in, result folders out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rock2d.errors import InputError
from rock2d.files.folders import check_replaced, write_whole
from rock2d.files.scenario import Scenario, load_scenario
from rock2d.files.scenario_checks import check_engine
from rock2d.runs.before_after import before_after, before_after_text, campaign_before_after
from rock2d.runs.campaigns.campaign import CampaignOptions, Workers, is_campaign, run_campaign
from rock2d.runs.diagnosis_remarks import diagnosis_remarks
from rock2d.runs.resolution import unresolved_remarks
from rock2d.runs.run import run
from rock2d.runs.tables import print_campaign, print_tables, residual_text
from rock2d.scene.site_scales import line_remarks

if TYPE_CHECKING:
    import pandas as pd

    from rock2d.design.assessment import Assessment


def run_scenarios(
    scenarios: Sequence[Path],
    out: Path,
    options: CampaignOptions,
    workers: Workers,
    *,
    engines: Sequence[str] = (),
    data_root: Path | None = None,
    video: bool = False,
    overwrite: bool = False,
    progress: bool = True,
    report: Callable[[str], Any] = print,
) -> bool:
    """Run scenario files with every one of `engines` (default: the scenario's own), each into a folder of its own
    under `out`; False if more than 1 % of the releases of a block are unresolved (see `runs.resolution`).

    A run of more than 10,000 releases, or with a scheduler, is a campaign. Only with `overwrite` does a run replace an
    earlier one.

    Raises InputError for a mistake in a file, for options that are not for such a run, or for a folder that cannot be
    used.
    """
    loaded = [load_scenario(path, data_root) for path in scenarios]
    for scenario in loaded:  # before any work
        large = workers.scheduler is not None or is_campaign(scenario, options.releases)
        if options.keep and not large:
            message = "--keep is for campaigns: more than 10,000 releases, or --scheduler"
            raise InputError(message, code="wrong_kind", option="keep")
        if video and large:
            message = "--video is not for campaigns: they keep no full tracks"
            raise InputError(message, code="wrong_kind", option="video")
        for engine in () if large else engines or [scenario.engine]:
            check_replaced(out / f"{scenario.name}_{engine}", overwrite)
        for engine in engines or [scenario.engine]:
            check_engine(scenario, engine)
    resolved = True
    for scenario in loaded:
        for remark in line_remarks(scenario.make_cross_section(), scenario.make_blocks().values()):
            report(f"warning: {remark}")
        for remark in diagnosis_remarks(scenario):
            report(remark)
        large = workers.scheduler is not None or is_campaign(scenario, options.releases)
        for engine in engines or [scenario.engine]:
            folder = out / f"{scenario.name}_{engine}"
            chosen = replace(options, engine=engine)
            if large:
                tables = run_campaign(scenario, folder, chosen, workers, progress=progress, report=report)
                print_campaign(scenario, engine, tables)
                if scenario.diagnosed is not None:
                    compared = campaign_before_after(scenario, engine, options.seed, options.releases)
                    _shown(compared)(folder)
                if scenario.uncertainty is not None:
                    _assessed(scenario, engine, options.seed, progress).write(folder)
            else:
                tables = _run_in_memory(scenario, folder, chosen, workers, video, progress)
            if scenario.experiment is None:  # a restarted release ends with its film
                remarks = unresolved_remarks(tables, scenario.longest_release_s())
                resolved = resolved and not remarks
                for remark in remarks:
                    report(remark)
            report(f"written: {folder}")
    return resolved


def _run_in_memory(
    scenario: Scenario, folder: Path, options: CampaignOptions, workers: Workers, video: bool, progress: bool
) -> dict[str, pd.DataFrame]:
    """Run, print the tables, then write the folder; the tables that it holds."""
    result = run(
        scenario, engine=options.engine, seed=options.seed, releases=options.releases,
        workers=workers.processes, progress=progress,
    )  # fmt: skip
    print_tables(result)
    also: list[Callable[[Path], None]] = []
    if scenario.diagnosed is not None:
        also.append(_shown(before_after(scenario, result, workers=workers.processes)))
    if scenario.uncertainty is not None:
        also.append(_assessed(scenario, result.engine, result.seed, progress).write)

    def write_all(inside: Path) -> None:
        for write in also:
            write(inside)

    tables = result.write(folder, video, progress=progress, also=write_all)
    if "residual_summary" in tables:
        print(residual_text(tables["residual_summary"]))
    return tables


def _shown(compared: pd.DataFrame) -> Callable[[Path], None]:
    """Print design values before and after a diagnosis; writes before_after.csv into a folder."""
    print(before_after_text(compared))
    text = compared.to_csv(index=False, lineterminator="\n")
    return lambda folder: write_whole(folder / "before_after.csv", text)


def _assessed(scenario: Scenario, engine: str, seed: int | None, progress: bool) -> Assessment:
    """What the possible sites of the scenario say, printed."""
    from rock2d.design.assessment import assess

    assessment = assess(scenario, engine, scenario.seed if seed is None else seed, progress)
    print(assessment.text())
    return assessment
