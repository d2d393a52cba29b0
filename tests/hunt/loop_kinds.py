"""The kinds of loop: which commands follow each other, on the files that the commands before wrote."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from rock2d.files.experiment import load_experiment
from tests.hunt import loop_cases as cases
from tests.hunt.loop_cases import Loop
from tests.hunt.loop_commands import Chain, film_of, read
from tests.hunt.loop_files import diagnosis_page_faults, page_faults
from tests.hunt.loop_inputs import (
    document,
    foreign_files,
    releases_of_each,
    scenario_of_film,
    spoil_film,
    write_field_test,
    write_impact_table,
    write_outside_case,
    write_survey,
    write_yaml,
)
from tests.hunt.loop_predictions import prediction_faults

FILM_SIZE = (480, 320)
FILM_LIMIT_S, FILM_RELEASES = 0.6, 6
SAME_M = 1e-6  # to which imported positions are those of the export


def run_loop(chain: Chain) -> None:
    """run -> diagnose -> predict -> compare -> run with the diagnosis -> its page."""
    film, other = _films(chain)
    diagnosis = diagnosed(chain, film, "diagnosis")
    for name, experiment in (("same", film), ("other", other)):
        predicted(chain, experiment, diagnosis, name)
    second = diagnosis
    if cases.OTHER_DIAGNOSIS in chain.loop.quirks:
        second = diagnosed(chain, other, "second")
    compared(chain, diagnosis, second)
    again(chain, document(chain.loop, "again"))


def _films(chain: Chain) -> tuple[Path, Path]:
    """A run of the loop's scenario, whose film `spoil_film` has changed, and one with another seed."""
    keys = document(chain.loop, "site")
    data = _measured(chain) if chain.loop.scenario in ("real_squares", "tschamut") else ()
    return simulated(chain, keys, "site", 0, *data), simulated(chain, keys, "other", 1, *data)


def _measured(chain: Chain) -> tuple[str, str]:
    """The option of the folder with the data that a scenario needs, which a run of another one has written."""
    data = chain.folder / "measured"
    if chain.loop.scenario == "tschamut":
        write_field_test(data)
    else:
        keys = document(Loop("run", "flat_floor", "batch", chain.loop.releases, chain.loop.seed), "squares")
        keys["blocks"] = {"square": keys["blocks"]["square"]}
        keys["incident"] = {"default": keys["incident"]["default"]}
        path = write_yaml(chain.folder / "squares.yaml", keys)
        chain("run", path, "--releases", cases.MOST, "--quiet", "--workers", 1, "--engine", "batch",
              "--out", data / "data")  # fmt: skip
        (data / "data" / "squares_batch").rename(data / "data" / "squares")
    return "--data", str(data)


def simulated(chain: Chain, keys: dict[str, Any], name: str, seed: int, *options: str) -> Path:
    """The folder of a run, whose film has what the loop's quirks say."""
    loop, path = chain.loop, write_yaml(chain.folder / f"{name}.yaml", {**keys, "name": name})
    count = releases_of_each(loop, keys)
    chain("run", path, "--engine", loop.engine, "--seed", loop.seed + seed, "--releases", count, "--quiet",
          "--workers", 1, "--out", chain.folder, *options)  # fmt: skip
    folder = chain.folder / f"{name}_{loop.engine}"
    impacts = pd.read_csv(folder / "impacts.csv")
    if "t_after_s" not in impacts:
        impacts["t_after_s"] = impacts["t_s"]
    spoil_film(folder, impacts, loop)
    if chain.film is None:
        chain.film = film_of(folder, impacts, float(keys["outputs"]["fps"]))
    return folder


def diagnosed(chain: Chain, film: Path, name: str) -> Path:
    """The folder of the diagnosis of a film."""
    folder = chain.folder / name
    chain("diagnose", film, "--out", folder, "--workers", 1, "--quiet", "--seed", chain.loop.seed)
    if faults := diagnosis_page_faults(folder):
        chain.note("diagnose: the page differs from the file", "; ".join(faults[:5]))
    return folder


def predicted(chain: Chain, film: Path, diagnosis: Path, name: str) -> None:
    """Predict a film with and without what was diagnosed; check both."""
    file, tables = diagnosis / "diagnosis.json", []
    for option in (["--base-only"], []):
        out = chain.folder / f"{name}{'_base' if option else ''}.csv"
        chain("predict", film, "--diagnosis", file, *option, "--out", out)
        tables.append(pd.read_csv(out))
    for cause, facts in prediction_faults(load_experiment(film), read(file), *tables):
        chain.note(f"predict: {cause}", facts)


def compared(chain: Chain, first: Path, second: Path) -> None:
    """Compare two diagnoses."""
    out = chain.folder / "comparison"
    chain("compare", first, second, "--out", out)
    content = read(out / "comparison.json")
    if first == second and not content["verdict"]["same"]:
        chain.note("compare: a diagnosis differs from itself", str(content["verdict"]))


def again(chain: Chain, keys: dict[str, Any]) -> None:
    """Run a scenario with the diagnosis, and read its page."""
    # a slope takes the other engine minutes, and the law of points knows no diagnosis
    quick = chain.loop.engine == "pymunk" and chain.loop.scenario in (*cases.BENCH, "real_squares")
    engine = "pymunk" if quick else "batch"
    options = ("--data", str(chain.folder / "measured")) if (chain.folder / "measured").exists() else ()
    keys = {**keys, "name": "again", "engine": engine, "model": {"diagnosis": "diagnosis/diagnosis.json"}}
    keys.pop("uncertainty", None)
    keys.pop("scatter", None)
    restarts = chain.loop.scenario == "real_squares"
    path = write_yaml(chain.folder / "again.yaml", keys)
    chain("run", path, "--engine", engine, "--releases", releases_of_each(chain.loop, keys), "--quiet",
          "--workers", 1, "--out", chain.folder, *options, *(() if restarts else ("--report",)))  # fmt: skip
    if not restarts and (faults := page_faults(chain.folder / f"again_{engine}")):
        chain.note("run: the page differs from the tables", "; ".join(faults[:5]))


def table_loop(chain: Chain) -> None:
    """run -> a table of its impacts -> diagnose -> predict -> run with the diagnosis."""
    film, folder = simulated(chain, document(chain.loop, "site"), "site", 0), chain.folder / "table"
    impacts = pd.read_csv(film / "impacts.csv")
    write_impact_table(film, impacts, folder, chain.loop)
    assert chain.film is not None
    chain.film.releases, chain.film.rebounds = impacts["release"].nunique(), len(impacts)
    diagnosis = diagnosed(chain, folder, "diagnosis")
    predicted(chain, folder, diagnosis, "same")
    again(chain, document(chain.loop, "again"))


def import_loop(chain: Chain) -> None:
    """run -> export, or the files of another program -> import -> diagnose -> predict."""
    film = simulated(chain, document(chain.loop, "site"), "site", 0)
    experiment = load_experiment(film)
    kind, block = chain.loop.scenario.partition(":")[2], next(iter(experiment.blocks))
    setup = _setup_in_metres(chain, film)
    chain("export", film, "--out", chain.folder / "exported.txt")
    if kind == "tracker" and chain.loop.seed % 2:
        own = experiment.trajectories
        assert own is not None
        numbers = sorted(set(own.loc[own["block"] == block, "release"]))
        files = [chain.folder / f"exported_{number}.txt" for number in numbers]
        files, options = ([path for path in files if path.is_file()] or [chain.folder / "exported.txt"]), []
    else:
        files, options = foreign_files(kind, experiment, block, chain.folder)
    out = chain.folder / "imported"
    chain("import", *files, "--kind", kind, "--config", setup, "--y", "up", "--block", block, *options,
          "--out", out)  # fmt: skip
    _check_import(chain, film, out, block)
    assert chain.film is not None
    impacts = pd.read_csv(film / "impacts.csv")
    impacts = impacts[impacts["block"] == block]
    chain.film = film_of(out, _renumbered(impacts), experiment.fps)
    diagnosis = diagnosed(chain, out, "diagnosis")
    predicted(chain, out, diagnosis, "same")


def _renumbered(rows: pd.DataFrame) -> pd.DataFrame:
    """Rows with releases counted from 0."""
    return rows.assign(release=rows["release"].rank(method="dense").astype(int) - 1)


def _setup_in_metres(chain: Chain, film: Path) -> Path:
    """The set-up file of a film whose tracks are in metres."""
    from rock2d_tracking.camera import PixelMap
    from rock2d_tracking.setup_file import write_setup

    experiment, path = load_experiment(film), chain.folder / "metres.yaml"
    rows = experiment.trajectories
    assert rows is not None
    blocks = rows.groupby("release")["block"].first()
    write_setup(path, experiment, PixelMap(1.0, (0.0, 0.0)), [str(name) for name in blocks])
    return path


def _check_import(chain: Chain, film: Path, out: Path, block: str) -> None:
    """Imported positions are those of the film."""
    columns = ["x_m", "y_m"]
    before, after = (pd.read_csv(path / "trajectories.csv").dropna(subset=columns) for path in (film, out))
    before = before[before["block"] == block]
    a, b = before[columns].to_numpy(), after[columns].to_numpy()
    if a.shape != b.shape or np.abs(a - b).max(initial=0.0) > SAME_M:
        chain.note("import: other positions than those of the film", f"{a.shape} and {b.shape}")


def film_loop(chain: Chain) -> None:
    """run -> film -> track -> diagnose -> predict."""
    loop, keys = chain.loop, document(chain.loop, "site")
    keys["time_limit_s"] = FILM_LIMIT_S
    film = simulated(chain, keys, "site", 0)
    avi = chain.folder / "film.avi"
    chain("film", film, "--out", avi, "--size", *FILM_SIZE, "--releases", FILM_RELEASES, "--seed", loop.seed,
          "--quiet")  # fmt: skip
    tracked = chain.folder / "tracked"
    chain("track", avi, "--config", avi.with_suffix(".yaml"), "--out", tracked, "--quiet")
    impacts = pd.read_csv(film / "impacts.csv")
    chain.film = film_of(tracked, _renumbered(impacts[impacts["release"] < FILM_RELEASES]), keys["outputs"]["fps"])
    diagnosis = diagnosed(chain, tracked, "diagnosis")
    predicted(chain, tracked, diagnosis, "same")


def profile_loop(chain: Chain) -> None:
    """profile -> run -> design -> page."""
    import yaml

    loop = chain.loop
    survey, options = write_survey(loop.scenario, chain.folder / "survey", loop.seed)
    path = chain.folder / "slope.yaml"
    chain("profile", survey, *options, "--out", path)
    common = ("--engine", loop.engine, "--quiet", "--seed", loop.seed)
    chain("run", path, *common, "--workers", 1, "--releases", loop.releases, "--out", chain.folder, "--report")
    keys = yaml.safe_load(path.read_text(encoding="utf-8"))
    foot = keys["cross_section"]["points_m"][-2]
    keys |= {
        "name": "dam", "releases": loop.releases,
        "embankment": {"x_m": foot[0] + 3.0, "height_m": 2.0, "crest_m": 1.0, "uphill_deg": 60, "downhill_deg": 34},
        "uncertainty": {
            "sites": 4, "releases": 20,
            "site": {"incident.default.above_ground.vx_m_s": {"times": {"uniform": {"low": 0.8, "high": 1.2}}}},
        },
    }  # fmt: skip
    dam = write_yaml(chain.folder / "dam.yaml", keys)
    chain("run", dam, *common, "--workers", 1, "--out", chain.folder, "--report")
    if faults := page_faults(chain.folder / f"dam_{loop.engine}"):
        chain.note("run: the page differs from the tables", "; ".join(faults[:5]))
    out = chain.folder / "design"
    chain("design", dam, "--range", 1, 3, "--tolerance", 1, *common, "--out", out)
    answer = read(out / "design.json")
    if answer["least"] is not None:
        least = out / "least.yaml"
        chain("run", least, *common, "--workers", 1, "--out", chain.folder / "least")


def outside_loop(chain: Chain) -> None:
    """A film of the reality engine with an outside cause -> diagnose -> predict -> compare -> run again."""
    loop, case = chain.loop, chain.folder / "case"
    write_outside_case(loop.scenario, loop.releases, loop.seed, case)
    nothing = pd.DataFrame({"release": [], "t_s": [], "t_after_s": []})
    for name in ("fit", "heldout"):
        spoil_film(case / name, nothing, loop)
    experiment = load_experiment(case / "fit")
    chain.film = film_of(case / "fit", nothing, experiment.fps)
    diagnosis = diagnosed(chain, case / "fit", "diagnosis")
    for name in ("fit", "heldout"):
        predicted(chain, case / name, diagnosis, name)
    compared(chain, diagnosis, diagnosis)
    again(chain, scenario_of_film(experiment, "diagnosis/diagnosis.json"))


KINDS: dict[str, Callable[[Chain], None]] = {
    "run": run_loop, "table": table_loop, "import": import_loop, "film": film_loop, "profile": profile_loop,
    "outside": outside_loop,
}  # fmt: skip
