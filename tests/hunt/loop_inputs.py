"""The files that a user brings or edits between two commands: scenarios, films, surveys, exports of other programs."""

import csv
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import yaml

from rock2d.files.experiment import REQUIRED_IMPACT_COLUMNS, Experiment, load_experiment, write_experiment
from tests.field_tests.small_field import write_releases, write_terrain
from tests.hunt import loop_cases as cases
from tests.hunt.loop_cases import ANGLE_NOISE_RAD, SMALL, Loop
from tests.scenarios_of_tests import SHIPPED

SHARE_LOST = 0.05  # share of the frames
FIELD_STOPS_M = {"cube": [60.0, 70.0], "box": [55.0, 65.0]}  # block -> where its releases stop


def document(loop: Loop, name: str) -> dict[str, Any]:
    """The shipped scenario of a loop, made small: short, few frames, with noise."""
    shipped = loop.scenario.partition(":")[0]
    text = (SHIPPED / f"{shipped}.yaml").read_text(encoding="utf-8")
    found: dict[str, Any] = yaml.safe_load(text)
    limit_s, fps, noise_m = SMALL[shipped]
    still = {cases.NO_NOISE, cases.NO_POSITION_NOISE} & set(loop.quirks)
    unturned = {cases.NO_NOISE, cases.NO_ANGLE_NOISE} & set(loop.quirks)
    found |= {"name": name, "time_limit_s": limit_s, "engine": loop.engine}
    found["outputs"] = {
        "fps": fps,
        "position_noise_m": 0 if still else noise_m,
        "angle_noise_rad": 0 if unturned else ANGLE_NOISE_RAD,
    }
    found["releases"] = cases.FEWEST  # `--releases` says how many run
    if shipped == "tschamut":  # its fourteen unknown numbers take most of the time
        found.pop("uncertainty")
    if "uncertainty" in found:
        found["uncertainty"] |= {"sites": 4, "releases": 20}
    if "blocks" in found and "field_test" not in found:
        _keep_blocks(found, 1 if cases.ONE_BLOCK in loop.quirks or loop.kind == "import" else 3)
    _edit_law(found["model"], loop)
    return found


def _keep_blocks(found: dict[str, Any], count: int) -> None:
    """Keep the first blocks, and what is said of them."""
    names = list(found["blocks"])[:count]
    kept = {*names, "default"}
    found["blocks"] = {name: found["blocks"][name] for name in names}
    found["incident"] = {name: own for name, own in found["incident"].items() if name in kept}
    if table := found["model"].get("probabilistic"):
        found["model"]["probabilistic"] = {name: own for name, own in table.items() if name in kept}


def _edit_law(model: dict[str, Any], loop: Loop) -> None:
    change = {}
    if cases.NO_TANGENTIAL in loop.quirks:
        change["k_t_N_m"] = 0.0
    if cases.NEVER_SLIPS in loop.quirks:
        change["friction_angle_deg"] = 90.0
    if change:
        table = model.setdefault("deterministic", {"default": {}})
        for zone in table.values():
            zone |= change


def releases_of_each(loop: Loop, found: dict[str, Any]) -> int:
    """Releases of each block."""
    if cases.ONE_RELEASE in loop.quirks:
        return 1
    if cases.FEW_RELEASES in loop.quirks:
        return 2
    blocks = len(found.get("blocks", ())) + len(found.get("populations", ()))
    return max(1, round(loop.releases / max(blocks, 1)))


def write_yaml(path: Path, content: dict[str, Any]) -> Path:
    """Write a file with these keys."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    return path


def write_field_test(data: Path) -> None:
    """A field test at the place where the scenario tschamut expects its own."""
    folder = data / "data" / "tschamut"
    folder.mkdir(parents=True)
    write_terrain(folder)
    write_releases(folder / "releases.csv", FIELD_STOPS_M)
    rows = pd.read_csv(folder / "releases.csv")
    rows["block_id"] = np.resize([1, 2, 4], len(rows))
    rows.to_csv(folder / "releases.csv", index=False)


def spoil_film(folder: Path, impacts: pd.DataFrame, loop: Loop) -> None:
    """Take out of a film what its quirks say: angles, what follows the first impact, frames here and there."""
    path, rng = folder / "trajectories.csv", np.random.default_rng(loop.seed)
    rows = pd.read_csv(path)
    if cases.NO_IMPACT in loop.quirks:
        first = impacts.groupby("release")["t_s"].min()
        rows = rows[~(rows["t_s"] >= rows["release"].map(first))]
    if cases.LOST_FRAMES in loop.quirks:
        lost = rng.random(len(rows)) < SHARE_LOST
        rows.loc[lost, ["x_m", "y_m", "theta_rad"]] = np.nan
        rows = rows[~lost | (rng.random(len(rows)) < 0.5)]  # an empty row or none
    if cases.NO_ANGLES in loop.quirks:
        round_ = [name for name, own in load_experiment(folder).blocks.items() if own.shape == "circle"]
        rows.loc[rows["block"].isin(round_) | (not round_), "theta_rad"] = np.nan
    rows.to_csv(path, index=False)


def write_impact_table(film: Path, impacts: pd.DataFrame, folder: Path, loop: Loop) -> None:
    """The experiment of a film as a table of its impacts, with the noise of the camera."""
    experiment = load_experiment(film)
    table = impacts[list(REQUIRED_IMPACT_COLUMNS)].copy()
    rng = np.random.default_rng(loop.seed)
    for column in REQUIRED_IMPACT_COLUMNS[2:]:
        sd = experiment.angle_noise_rad if "rad" in column else experiment.position_noise_m
        table[column] += rng.normal(0.0, sd * (20.0 if column.endswith("_s") else 1.0), len(table))
    if cases.NO_IMPACT in loop.quirks:
        table = table.iloc[:0]
    write_experiment(folder, replace(experiment, trajectories=None, impacts=table))


# what other programs write -----------------------------------------------------------------------------------


def foreign_files(kind: str, film: Experiment, block: str, folder: Path) -> tuple[list[Path], list[str]]:
    """The releases of a block as another program exports them, one file each, in m; and the options of the import."""
    rows = film.trajectories
    assert rows is not None
    rows = rows[rows["block"] == block].dropna(subset=["x_m", "y_m"])
    arm = film.blocks[block].radius_m * np.column_stack([np.cos(rows["theta_rad"]), np.sin(rows["theta_rad"])])
    rows = rows.assign(frame=np.rint(rows["t_s"] * film.fps).astype(int), u=rows["x_m"] + arm[:, 0],
                       v=rows["y_m"] + arm[:, 1])  # fmt: skip
    marked = not rows["u"].isna().any()
    columns = ["x_m", "y_m", "u", "v"] if marked else ["x_m", "y_m"]
    paths = []
    for release, own in rows.groupby("release"):
        path = folder / f"foreign_{release}.{'txt' if kind == 'tracker' else 'csv'}"
        path.write_text(WRITERS[kind](own, columns), encoding="utf-8")
        paths.append(path)
    options = [word for mark in MARKS[kind][: len(columns) // 2] for word in ("--mark", mark)]
    if kind == "kinovea":
        options += ["--file-fps", str(film.fps)]
    if kind == "deeplabcut":
        options += ["--min-confidence", "0.5"]
    return paths, options


def _tracker(rows: pd.DataFrame, columns: list[str]) -> str:
    edge = len(columns) > 2
    head = f",,centre,,{'edge,,' * edge}\nt,frame,x,y{',x,y' * edge}\n"
    return head + rows[["t_s", "frame", *columns]].to_csv(index=False, header=False)


def _kinovea(rows: pd.DataFrame, columns: list[str]) -> str:
    names = ["Time", "centre/0/X", "centre/0/Y", "edge/0/X", "edge/0/Y"][: 1 + len(columns)]
    form = {"index": False, "float_format": "%.9f", "quoting": csv.QUOTE_ALL}
    return rows[["t_s", *columns]].to_csv(header=names, **form)


def _dltdv(rows: pd.DataFrame, columns: list[str]) -> str:
    names = ["pt1_cam1_X", "pt1_cam1_Y", "pt2_cam1_X", "pt2_cam1_Y"][: len(columns)]
    every = rows.set_index("frame")[columns].reindex(range(int(rows["frame"].max()) + 1))
    return every.to_csv(index=False, header=names, float_format="%.9f", na_rep="NaN")


def _deeplabcut(rows: pd.DataFrame, columns: list[str]) -> str:
    points = ["centre", "edge"][: len(columns) // 2]
    lines = [",".join(["scorer"] + ["net"] * 3 * len(points)),
             ",".join(["bodyparts"] + [name for name in points for _ in range(3)]),
             ",".join(["coords"] + ["x", "y", "likelihood"] * len(points))]  # fmt: skip
    table = rows[["frame", *columns]].copy()
    for k, name in enumerate(points):
        table.insert(3 * k + 3, name, 0.99)
    return "\n".join(lines) + "\n" + table.to_csv(index=False, header=False, float_format="%.9f")


WRITERS: dict[str, Callable[[pd.DataFrame, list[str]], str]] = {
    "tracker": _tracker, "kinovea": _kinovea, "dltdv": _dltdv, "deeplabcut": _deeplabcut,
}  # fmt: skip
MARKS = {
    "tracker": ("centre", "edge"), "kinovea": ("centre", "edge"), "dltdv": ("pt1_cam1", "pt2_cam1"),
    "deeplabcut": ("centre", "edge"),
}  # fmt: skip


# surveys -----------------------------------------------------------------------------------------------------


def write_survey(kind: str, folder: Path, seed: int) -> tuple[Path, list[str]]:
    """A random slope that ends in level ground, as a table, a drawing or a terrain model; and the options that read
    it."""
    rng = np.random.default_rng(seed)
    widths, slopes = rng.uniform(8.0, 20.0, 5), np.sort(rng.uniform(0.05, 1.2, 5))[::-1]
    widths[-1], slopes[-1] = 30.0, min(slopes[-1], 0.2)  # room for an embankment
    x = np.concatenate([[0.0], np.cumsum(widths)])
    y = np.concatenate([[0.0], np.cumsum(widths * slopes)])[-1] - np.concatenate([[0.0], np.cumsum(widths * slopes)])
    folder.mkdir(parents=True, exist_ok=True)
    if kind == "table":
        path = folder / "survey.csv"
        pd.DataFrame({"x": x, "y": y}).to_csv(path, index=False)
        return path, []
    if kind == "dxf":
        import ezdxf

        path, drawing = folder / "survey.dxf", ezdxf.new()
        drawing.modelspace().add_lwpolyline(np.column_stack([x, y]).tolist())
        drawing.saveas(path)
        return path, []
    path, cells = folder / "survey.asc", np.arange(0.5, x[-1])
    row = " ".join(f"{height:.4f}" for height in np.interp(cells, x, y))
    head = f"ncols {len(cells)}\nnrows 8\nxllcorner 0\nyllcorner 0\ncellsize 1\nnodata_value -9999\n"
    path.write_text(head + (row + "\n") * 8)
    return path, ["--line", "1", "4", f"{x[-1] - 1:.1f}", "4", "--tolerance", "0.05"]


# films of the reality engine ---------------------------------------------------------------------------------

CASE_FPS = {"laboratory": 300.0, "flat": 300.0, "field": 60.0}


def write_outside_case(cause: str, releases: int, seed: int, folder: Path) -> None:
    """A film of few releases with a cause of full size from outside the catalogue, in folder/fit, and another of the
    same bench in folder/heldout."""
    from rock2d.blind import reality
    from rock2d.blind.case_files import write_case
    from rock2d.blind.cases import draw_case

    case = draw_case((cause,), np.random.SeedSequence(seed), smallest=True)
    case.fps = CASE_FPS[case.kind]
    rng = np.random.default_rng(seed)
    case.hidden = [reality.draw_hidden(cause, 0, rng, case.world, 1.0)]
    write_case(case, folder)
    for name in ("twin", "twin_fit"):
        for path in (folder / name).iterdir():
            path.unlink()
        (folder / name).rmdir()
    for name in ("fit", "heldout"):
        path = folder / name / "trajectories.csv"
        rows = pd.read_csv(path)
        rows[rows["release"].isin(sorted(set(rows["release"]))[:releases])].to_csv(path, index=False)


def scenario_of_film(experiment: Experiment, diagnosis: str) -> dict[str, Any]:
    """A scenario on the ground of a film, whose blocks start as in their first release, with a diagnosis."""
    rows = experiment.trajectories
    assert rows is not None
    incident, blocks = {}, {}
    described = yaml.safe_load((Path(str(experiment.folder)) / "experiment.yaml").read_text(encoding="utf-8"))
    for name, own in rows.dropna().groupby("block"):
        first = own[own["release"] == own["release"].iloc[0]].head(3)
        t = first["t_s"].to_numpy()
        x, y, theta = first[["x_m", "y_m", "theta_rad"]].to_numpy().T
        start = {"x_m": x[0], "y_m": y[0], "theta_rad": theta[0], "vx_m_s": (x[2] - x[0]) / (t[2] - t[0]),
                 "vy_m_s": (y[2] - y[0]) / (t[2] - t[0])}  # fmt: skip
        incident[name] = {"fixed": {key: float(value) for key, value in start.items()}}
        blocks[name] = described["blocks"][name]
    return {
        "name": "again", "engine": "batch", "releases": 2, "seed": 1,
        "time_limit_s": float(rows["t_s"].max()), "gravity_m_s2": experiment.gravity_m_s2,
        "cross_section": described["cross_section"], "blocks": blocks, "model": {"diagnosis": diagnosis},
        "incident": incident, "outputs": {"fps": experiment.fps},
    }  # fmt: skip
