"""Campaigns: the same bytes whoever computed them, and however often they were stopped."""

import errno
import hashlib
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pandas as pd
import psutil
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rock2d.errors import InputError
from rock2d.files.folders import check_output_folder
from rock2d.files.scenario_reading import load_scenario
from rock2d.graphics.figure_files import NoFigures
from rock2d.runs.campaigns import group_outcomes, order_statistics
from rock2d.runs.campaigns.campaign import CampaignOptions, Workers, _chunk_releases, run_campaign
from rock2d.runs.conditions import incident_states
from rock2d.runs.incident_states import DRAW_GROUP, drawn_seeds, drawn_states
from rock2d.runs.indicators.crossings import crossings_table
from rock2d.runs.indicators.passing import percentile_table
from rock2d.runs.indicators.releases import impacts_table, stops_table
from rock2d.runs.results import KIND
from rock2d.runs.run import run
from rock2d.statistics import least_count, percentile_estimate, percentile_ranks
from tests.programs import cluster, commanded
from tests.scenarios_of_tests import SHIPPED
from tests.test_processes import heed_interrupts

CUT_SHORT = 4  # exit code
SETUP = load_scenario(SHIPPED / "paper_setup.yaml")


def campaign(
    folder: Path, *, scenario=SETUP, engine="batch", releases=60, chunk=20, workers=None, overwrite=False, **options
):
    """A campaign of small chunks; what it reported comes back beside its tables."""
    lines: list[str] = []
    chosen = CampaignOptions(engine=engine, releases=releases, chunk_releases=chunk, **options)
    said = {"progress": False, "report": lines.append}
    return run_campaign(scenario, folder, chosen, workers or Workers(), overwrite=overwrite, **said), lines


def digest(folder: Path) -> dict[str, str]:
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    return {str(p.relative_to(folder)): hashlib.sha256(p.read_bytes()).hexdigest() for p in files}


def kept(folder: Path, output: str) -> pd.DataFrame:
    files = sorted((folder / "chunks" / output).iterdir())
    return pd.concat([pd.read_parquet(file) for file in files], ignore_index=True)


def written(folder: Path) -> int:
    """Number of chunks of which every file is there; a chunk's files are written one after the other."""
    return min(len(list((folder / "chunks" / name).glob("[0-9]*.parquet"))) for name in ("ends", "crossings"))


def same(table: pd.DataFrame, other: pd.DataFrame, **tolerance: float) -> None:
    exact = tolerance or {"rtol": 0, "atol": 0}
    pd.testing.assert_frame_equal(table, other, check_dtype=False, **exact)


@pytest.mark.parametrize("engine", ["batch", "point_mass"])
def test_a_campaign_holds_what_single_runs_hold(tmp_path, engine, monkeypatch):
    monkeypatch.setattr(group_outcomes, "FIRST_IMPACT_ROOM", 3)  # so that some releases run a second time
    outputs = ["ends", "crossings", "impacts", *(["samples"] if engine == "batch" else [])]
    tables, _ = campaign(tmp_path / "out", engine=engine, releases=15, chunk=10, keep=outputs)
    result = run(SETUP, engine=engine, releases=15, workers=1, progress=False)
    # the ensemble adds up time in larger parts than a track
    same(kept(tmp_path / "out", "ends"), stops_table(result))
    impacts = impacts_table(result)
    assert impacts.groupby("release").size().max() > 3
    same(kept(tmp_path / "out", "impacts"), impacts)
    crossings, single = kept(tmp_path / "out", "crossings"), crossings_table(result)
    if engine == "point_mass":
        same(crossings, single)
    else:  # in contact a track's position is a cubic, the ensemble's a chord, of the same step
        place = ["block", "release", "line", "t_s", "x_m", "y_m"]
        same(crossings[place], single[place], rtol=0, atol=1e-5)
        sampled = kept(tmp_path / "out", "samples")
        same(sampled, result.to_pandas("trajectories")[list(sampled)], rtol=0, atol=1e-12)
    same(tables["passing"], result.to_pandas("passing"))
    same(tables["percentiles"], percentile_table(crossings))


def test_tables_are_those_of_all_values(tmp_path):
    slope = load_scenario(SHIPPED / "slope_embankment.yaml")
    tables, _ = campaign(tmp_path / "out", scenario=slope, engine="point_mass", releases=4000, chunk=1500)
    ends, crossings = kept(tmp_path / "out", "ends"), kept(tmp_path / "out", "crossings")
    order = {"by": ["block", "line", "quantity", "percentile"], "ignore_index": True}
    same(tables["percentiles"].sort_values(**order), percentile_table(crossings).sort_values(**order))
    for row in tables["runout"].itertuples():
        assert row.value == np.percentile(ends[ends["block"] == row.block]["runout_m"], row.percentile)
    counts = ends.groupby(["block", "stop", "zone"], dropna=False).size().reset_index(name="releases")
    places = ["block", "stop", "zone"]
    same(tables["stops"][[*places, "releases"]].sort_values(places, ignore_index=True), counts)
    passed = crossings.groupby(["block", "line"]).size()
    found = tables["passing"].set_index(["block", "line"])["passed"]
    assert found[found > 0].to_dict() == passed.to_dict() and (found == 0).any()


def test_tables_do_not_depend_on_the_size_of_chunks_or_on_how_much_is_in_memory(tmp_path, monkeypatch):
    slope = load_scenario(SHIPPED / "slope_embankment.yaml")
    many = {"scenario": slope, "engine": "point_mass", "releases": 3000}
    tables, _ = campaign(tmp_path / "large", chunk=3000, **many)
    monkeypatch.setattr(order_statistics, "MOST_COLLECTED", 100)
    others, _ = campaign(tmp_path / "small", chunk=700, **many)
    for name, table in tables.items():
        same(others[name], table)


@pytest.mark.usefixtures("all_threads")
def test_a_worker_writes_the_same_bytes_and_needs_no_dask(tmp_path, monkeypatch):
    """Two workers do so below, of whom one is killed."""
    monkeypatch.setitem(sys.modules, "distributed", None)
    campaign(tmp_path / "threads")
    campaign(tmp_path / "worker", workers=Workers(1))
    assert digest(tmp_path / "worker") == digest(tmp_path / "threads")
    assert written(tmp_path / "threads") == 9


def test_the_workers_of_a_scheduler_write_the_same_bytes(tmp_path):
    campaign(tmp_path / "threads")
    with cluster(2) as dask:
        campaign(tmp_path / "scheduler", workers=Workers(scheduler=dask.scheduler_address))
    assert digest(tmp_path / "scheduler") == digest(tmp_path / "threads")


def test_a_worker_killed_in_mid_run_loses_nothing(tmp_path):
    chunk_count, seen = 30, []

    def kill_one() -> None:
        while written(tmp_path / "killed") < 2:
            time.sleep(0.02)
        children = psutil.Process().children(recursive=True)
        workers = [child for child in children if "spawn_main" in " ".join(child.cmdline())]
        seen.append((len(workers), written(tmp_path / "killed")))
        os.kill(workers[0].pid, signal.SIGKILL)

    killer = threading.Thread(target=kill_one, daemon=True)
    killer.start()
    campaign(tmp_path / "killed", releases=300, chunk=30, workers=Workers(2))
    killer.join(timeout=1)
    ((workers, done),) = seen
    assert workers == 2 and done < chunk_count - 2
    campaign(tmp_path / "undisturbed", releases=300, chunk=30)
    assert written(tmp_path / "undisturbed") == chunk_count
    assert digest(tmp_path / "killed") == digest(tmp_path / "undisturbed")


def test_an_interrupted_campaign_goes_on_to_the_same_bytes(tmp_path):
    text = (SHIPPED / "paper_setup.yaml").read_text()
    (tmp_path / "short.yaml").write_text(text.replace("time_limit_s: 3\n", "time_limit_s: 0.08\n"))
    words = ["run", str(tmp_path / "short.yaml"), *["--engine", "batch", "--releases", "20001", "--quiet", "--out"]]
    whole = commanded(*words, tmp_path / "whole")
    assert whole.exit_code == CUT_SHORT and "NOT RESOLVED: of 20001 releases of cube 20001" in whole.stdout
    assert "campaign: 60003 releases in 9 chunks" in whole.stdout and "passing frequency" in whole.stdout
    cut, done = tmp_path / "cut" / "paper_setup_batch", 0
    for how in (signal.SIGINT, signal.SIGKILL):
        process = subprocess.Popen(
            [sys.executable, "-m", "rock2d.cli", *words, str(tmp_path / "cut")],
            stderr=subprocess.PIPE,
            text=True,
            preexec_fn=heed_interrupts,
        )
        while written(cut) == done and process.poll() is None:
            time.sleep(0.01)
        process.send_signal(how)
        _, errors = process.communicate(timeout=60)
        before, done = done, written(cut)
        assert before < done < 9 and not (cut / "passing.csv").exists()
        if how == signal.SIGINT:
            assert process.returncode == 130
            # the interrupt may come between a chunk's file and its being counted
            shown = [
                f"{n} of 9 chunks are done, the same command continues from there" in errors for n in (done - 1, done)
            ]
            assert any(shown)
            assert "Traceback" not in errors
            assert not list(cut.rglob(".*"))
    again = commanded(*words, tmp_path / "cut")
    assert again.exit_code == CUT_SHORT
    assert f"{done} of 9 chunks are done already" in again.stdout
    assert digest(cut) == digest(tmp_path / "whole" / "paper_setup_batch")


@pytest.mark.parametrize("engine", ["batch", "point_mass"])
def test_chunks_that_are_damaged_or_gone_are_computed_anew(tmp_path, engine):
    campaign(tmp_path, engine=engine)
    before = digest(tmp_path)
    first, second, *_ = sorted((tmp_path / "chunks" / "ends").iterdir())
    first.write_bytes(first.read_bytes()[:-100])
    second.unlink()
    _, lines = campaign(tmp_path, engine=engine)
    assert any("7 of 9 chunks are done already" in line for line in lines)
    assert digest(tmp_path) == before


def test_half_written_files_of_a_killed_campaign_are_removed(tmp_path):
    campaign(tmp_path)
    (tmp_path / "chunks" / "ends" / ".0000001.parquet.ab12cd34").write_bytes(b"half")
    (tmp_path / "chunks" / "ends" / "0000001.parquet").unlink()
    seen = []
    scenario = SETUP.model_copy()
    run_campaign(
        scenario, tmp_path, CampaignOptions(engine="batch", releases=60, chunk_releases=20), progress=False,
        report=lambda line: seen.append(list(tmp_path.rglob(".*"))),
    )  # fmt: skip
    assert seen and not any(seen)  # before the work, not only after it


def test_a_full_disk_says_how_far_it_came_and_leaves_no_half_written_file(tmp_path, monkeypatch):
    import pyarrow.parquet as pq

    whole, written = pq.ParquetWriter.write_table, []

    def full(writer, table, *arguments):
        if len(written) > 7:
            raise OSError(errno.ENOSPC, "No space left on device")
        written.append(whole(writer, table, *arguments))

    monkeypatch.setattr(pq.ParquetWriter, "write_table", full)
    with pytest.raises(OSError, match=r"No space left.*4 of 9 chunks are done") as caught:
        campaign(tmp_path)
    assert caught.value.filename == str(tmp_path) and not list(tmp_path.rglob(".*"))


def test_a_folder_of_something_else_is_refused(tmp_path):
    campaign(tmp_path / "one")
    with pytest.raises(InputError, match="different campaign: seed, keep differ"):
        campaign(tmp_path / "one", seed=2, keep=["ends"])
    with pytest.raises(InputError, match="different campaign: seed differs"):
        campaign(tmp_path / "one", seed=2)
    (tmp_path / "notes").mkdir()
    (tmp_path / "notes" / "mine.txt").write_text("mine")
    for overwrite in (False, True):
        with pytest.raises(InputError, match="not a rock2d result"):
            campaign(tmp_path / "notes", overwrite=overwrite)


def test_only_with_overwrite_does_a_campaign_replace_another(tmp_path):
    campaign(tmp_path / "one", seed=2)
    campaign(tmp_path / "other")
    campaign(tmp_path / "one", overwrite=True)
    assert digest(tmp_path / "one") == digest(tmp_path / "other")


def test_only_with_overwrite_does_a_campaign_replace_a_run(tmp_path):
    run(SETUP, engine="batch", releases=1, workers=1).write(tmp_path / "one", figures=NoFigures())
    with pytest.raises(InputError, match="earlier run; --overwrite replaces"):
        campaign(tmp_path / "one")
    campaign(tmp_path / "other")
    campaign(tmp_path / "one", overwrite=True)
    assert digest(tmp_path / "one") == digest(tmp_path / "other")


def test_only_with_overwrite_does_a_run_replace_a_campaign(tmp_path):
    campaign(tmp_path / "one")
    with pytest.raises(InputError, match="earlier run; --overwrite replaces"):
        check_output_folder(tmp_path / "one", False, KIND)
    check_output_folder(tmp_path / "one", True, KIND)
    run(SETUP, engine="batch", releases=1, workers=1).write(tmp_path / "one", figures=NoFigures())
    assert not (tmp_path / "one" / "campaign.json").exists()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"engine": "pymunk"}, "--engine batch"),
        ({"engine": "point_mass", "keep": ["samples"]}, "no samples"),
        ({"workers": Workers(scheduler="localhost")}, "tcp://host:8786"),
        ({"workers": Workers(scheduler="tcp://localhost:1")}, "no Dask scheduler answers"),
    ],
)
def test_what_cannot_be_a_campaign_is_said_plainly(tmp_path, options, words, monkeypatch):
    monkeypatch.setattr("rock2d.cluster.CONNECT_S", 1)
    with pytest.raises(InputError, match=words):
        campaign(tmp_path / "out", **options)


def test_measured_starts_are_not_for_campaigns(tmp_path, data_root):
    scenario = load_scenario(SHIPPED / "real_squares.yaml", data_root)
    with pytest.raises(InputError, match="measured"):
        campaign(tmp_path, scenario=scenario)


def test_missing_extras_are_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match=r"rock2d\[scale\]"):
        campaign(tmp_path / "a", workers=Workers(scheduler="tcp://localhost:8786"))
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(InputError, match=r"pyarrow.*rock2d\[scale\]"):
        campaign(tmp_path / "c")


@pytest.mark.parametrize(
    ("engine", "more", "chunk"),
    [("batch", {}, 10_000), ("point_mass", {}, 100_000), ("point_mass", {"populations": {"cube": None}}, 10_000)],
)
def test_chunks_are_as_large_as_what_is_lost_is_small(engine, more, chunk):
    scenario = SETUP.model_copy(update=more)
    assert _chunk_releases(scenario, CampaignOptions(engine=engine)) == chunk
    assert _chunk_releases(scenario, CampaignOptions(engine=engine, chunk_releases=7)) == 7


def test_crossings_alone_are_those_of_whole_releases(tmp_path):
    campaign(tmp_path / "whole")
    campaign(tmp_path / "spent", keep=["crossings"])
    same(kept(tmp_path / "spent", "crossings"), kept(tmp_path / "whole", "crossings"))


def test_a_campaign_says_how_many_audits_do_not_close(tmp_path, monkeypatch):
    from rock2d.engines import energy_balance

    _, quiet = campaign(tmp_path / "closed")
    assert not [line for line in quiet if "audit" in line]
    monkeypatch.setattr(energy_balance, "AUDIT_TOLERANCE", -1.0)  # no audit closes
    for _ in range(2):  # a campaign that is done still says it
        tables, lines = campaign(tmp_path / "open", keep=["ends"])
        assert lines[-1].endswith(f"DOES NOT CLOSE for {tables['stops']['releases'].sum()} of 180 releases")


def test_a_release_is_the_same_however_releases_are_shared_out():
    incident = SETUP.incident_of("cube")
    whole = drawn_states(incident, 1, 1, 0, 3 * DRAW_GROUP)
    assert np.array_equal(
        drawn_states(incident, 1, 1, DRAW_GROUP - 7, 2 * DRAW_GROUP + 5), whole[DRAW_GROUP - 7 : 2 * DRAW_GROUP + 5]
    )
    assert np.array_equal(
        drawn_seeds(1, 1, 5, DRAW_GROUP + 5), drawn_seeds(1, 1, 0, 2 * DRAW_GROUP)[5 : DRAW_GROUP + 5]
    )
    cube = [start for start in incident_states(SETUP, 1, 30) if start.block == "cube"]
    assert np.array_equal([start.state for start in cube], whole[:30])
    assert len(np.unique(whole, axis=0)) == 3 * DRAW_GROUP
    assert not np.array_equal(drawn_seeds(1, 0, 0, 5), drawn_seeds(1, 1, 0, 5))


UNTIMED = settings(deadline=None)  # a loaded machine is no fault


@UNTIMED
@given(st.integers(1, 600), st.sampled_from([5.0, 50.0, 95.0, 99.0]), st.integers(0, 2**32))
def test_percentiles_are_numpys_and_look_at_no_more_values_than_they_say(n, percentile, seed):
    ranked = np.sort(np.random.default_rng(seed).normal(size=n))
    seen = {rank: float(ranked[rank]) for rank in percentile_ranks(n, percentile)}
    value, low, high = percentile_estimate(seen, n, percentile)
    if n < least_count(percentile):
        assert seen == {} and np.isnan([value, low, high]).all()
    else:
        assert low <= value <= high and value == np.percentile(ranked, percentile)


@pytest.mark.parametrize("damage", ["[" * 100_000, "[]", "{"])
def test_a_damaged_manifest_is_refused(tmp_path, damage):
    campaign(tmp_path)
    (tmp_path / "campaign.json").write_text(damage)
    with pytest.raises(InputError, match=r"campaign\.json"):
        campaign(tmp_path)
