"""`rock2d demo`: the paper's set-up in a minute: three blocks, both models, table, figures, video."""

from __future__ import annotations

import time
from pathlib import Path

RELEASES = 24  # of each block with the pymunk engine; the point-mass engine runs the scenario's own number
VIDEO = {"slow_motion": 8.0, "size_px": (960, 540)}


def run_demo(out: Path, progress: bool = True) -> None:
    """Run the paper's set-up with both engines, write everything under `out` and print the table."""
    import pandas as pd

    from rock2d.files.scenario import load_scenario
    from rock2d.files.shipped_scenarios import scenario_file
    from rock2d.runs.run import simulate, write_results, write_video
    from rock2d.runs.tables import passing_text

    begin = time.perf_counter()
    scenario = load_scenario(scenario_file("paper_setup.yaml"))
    passing = []
    for engine, releases in (("pymunk", RELEASES), ("point_mass", scenario.releases)):
        result = simulate(scenario, engine=engine, releases=releases, progress=progress)
        tables = write_results(result, out / engine, progress=progress)
        passing.append(tables["passing"].assign(block=lambda t, e=engine: t["block"] + f" ({e})"))
        if engine == "pymunk":
            result.scenario.outputs.video_releases = 1
            write_video(result, out / engine / "trajectories.webm", scenario.name, progress=progress, **VIDEO)
    print(passing_text(pd.concat(passing)))
    for sentence in scenario.assumed:
        print(f"  assumed: {sentence}")
    print(f"written: {out} in {time.perf_counter() - begin:.1f} s; open {out}/pymunk/trajectories.webm")
