"""The command `rock2d run`: scenario files in, result folders out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from rock2d.errors import InputError
from rock2d.files.folders import check_folder
from rock2d.files.scenario import Scenario, load_scenario
from rock2d.runs.campaigns.campaign import CampaignOptions, Workers, is_campaign, run_campaign
from rock2d.runs.run import run
from rock2d.runs.tables import print_campaign, print_tables


def run_scenarios(
    scenarios: Sequence[Path],
    out: Path,
    options: CampaignOptions,
    workers: Workers,
    *,
    engines: Sequence[str] = (),
    data_root: Path | None = None,
    video: bool = False,
    progress: bool = True,
    report: Callable[[str], Any] = print,
) -> None:
    """Run scenario files with every one of `engines` (default: the scenario's own), each into a folder of its own
    under `out`.

    A run of more than 10,000 releases, or with a scheduler, is a campaign.

    Raises InputError for a mistake in a file, or for options that are not for such a run.
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
            check_folder(out / f"{scenario.name}_{engine}")
    for scenario in loaded:
        large = workers.scheduler is not None or is_campaign(scenario, options.releases)
        for engine in engines or [scenario.engine]:
            folder = out / f"{scenario.name}_{engine}"
            chosen = replace(options, engine=engine)
            if large:
                tables = run_campaign(scenario, folder, chosen, workers, progress=progress, report=report)
                print_campaign(scenario, engine, tables)
            else:
                _run_in_memory(scenario, folder, chosen, workers, video, progress)
            report(f"written: {folder}")


def _run_in_memory(
    scenario: Scenario, folder: Path, options: CampaignOptions, workers: Workers, video: bool, progress: bool
) -> None:
    result = run(
        scenario, engine=options.engine, seed=options.seed, releases=options.releases,
        workers=workers.processes, progress=progress,
    )  # fmt: skip
    print_tables(result, result.write(folder, video, progress=progress))
