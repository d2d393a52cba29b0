"""`rock2d demo`: the paper's set-up in a minute: three blocks, both models, table, figures, video."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

PYMUNK_RELEASES = 24  # per block; the point-mass engine runs the scenario's own number
VIDEO: dict[str, Any] = {"slow_motion": 8.0, "size_px": (960, 540)}


def run_demo(out: Path, progress: bool = True) -> None:
    """Run the paper's set-up with both engines, write everything under `out` and print the table."""
    import pandas as pd

    from rock2d.files.folders import check_folder
    from rock2d.files.scenario import load_scenario
    from rock2d.files.shipped_scenarios import scenario_file
    from rock2d.runs.run import run, run_bars
    from rock2d.runs.tables import passing_text

    begin = time.perf_counter()
    for engine in ("pymunk", "point_mass"):
        check_folder(out / engine)
    scenario = load_scenario(scenario_file("paper_setup.yaml"))
    passing = []
    for engine, releases in (("pymunk", PYMUNK_RELEASES), ("point_mass", scenario.releases)):
        bars = run_bars(scenario, engine, progress)
        result = run(scenario, engine=engine, releases=releases, progress=bars)
        tables = result.write(out / engine, progress=bars)
        table = tables["passing"]
        passing.append(table.assign(block=table["block"] + f" ({engine})"))
        if engine == "pymunk":
            result.write_video(
                out / engine / "trajectories.webm",
                releases=1,
                titles=(scenario.name,),
                progress=progress,
                **VIDEO,
            )
    print(passing_text(pd.concat(passing)))
    for sentence in scenario.assumed:
        print(f"  assumed: {sentence}")
    print(f"written: {out} in {time.perf_counter() - begin:.1f} s; open {out}/pymunk/trajectories.webm")
