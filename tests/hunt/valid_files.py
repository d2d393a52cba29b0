"""Valid files of every kind that a hunt damages. A set of files is a mapping from names to contents."""

import json
import os
import tempfile
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from rock2d.effects import catalogue
from rock2d.files.experiment import REQUIRED_IMPACT_COLUMNS, Experiment, load_experiment, write_experiment
from rock2d.scene.blocks import make_block
from rock2d.scene.cross_section import CrossSection
from tests.diagnosed_files import CLOSED, GAIN, content
from tests.kinematics.synthetic_films import POINTS, SOIL, ZONES, film, world
from tests.scenarios_of_tests import SHIPPED

Files = Mapping[str, bytes]
MEASURED = (b"from_experiment", b"field_test")  # keys of scenarios that need measured data
FEW_RELEASES = 8  # per film of the data folder: enough for a diagnosis, few enough to be read often


def scenarios() -> list[Files]:
    """The shipped scenarios, without those that need measured data."""
    texts = [path.read_bytes() for path in sorted(SHIPPED.glob("*.yaml"))]
    return [{"scenario.yaml": text} for text in texts if not any(key in text for key in MEASURED)]


@cache
def experiments() -> list[Files]:
    """Small experiments, a film and a table of impacts, and the first releases of those under ROCK2D_DATA."""
    own = [film(world(), 4, seed=1, duration_s=0.25), _impacts()]
    root = os.environ.get("ROCK2D_DATA")
    for path in sorted(Path(root).glob("practice/*/fit")) if root else []:
        own.append(_first_releases(load_experiment(path)))
    return [_files(experiment) for experiment in own]


def small_film() -> Experiment:
    """A film that can be predicted quickly."""
    return film(world(), 3, seed=1, duration_s=0.2)


def diagnoses() -> list[Files]:
    """Diagnoses with a verdict, with an effect beside it, and without any."""
    known = catalogue()
    names = ("camera_tilt", "air_drag", "geometry_error", "mirrored_axis", "surface_roughness")
    contents = [_diagnosis(name, known) for name in names] + [_diagnosis("none", known)]
    beside = _diagnosis("air_drag", known)
    both = {name: _parameters(name, known) for name in ("air_drag", "camera_tilt")}
    beside["beside"] = [{"effect": "camera_tilt", "base": SOIL, "parameters": both, **GAIN}]
    return [{"diagnosis.json": json.dumps(own, indent=1).encode()} for own in [*contents, beside]]


def _parameters(name: str, known: Mapping[str, Any]) -> dict[str, Any]:
    return {
        p.name: {"value": p.choices[-1] if p.choices else 0.3 * p.high, "ci95": [p.low, p.high], "unit": p.unit}
        for p in known[name].parameters
    }


def _diagnosis(verdict: str, known: Mapping[str, Any]) -> dict[str, Any]:
    parts = () if verdict == "none" else (verdict,)
    found = {name: {"parameters": _parameters(name, known), "base": SOIL, **GAIN, **CLOSED} for name in parts}
    return content(
        verdict, found, base=SOIL, next_release="", unexplained=[], beside=[],
        probabilities=dict.fromkeys(("none", "unknown", *known), 0.0) | {verdict: 1.0},
        series={"sphere": 3, "cube": 3}, assumptions=[],
        sanity={"faults": [], "fault_codes": [], "remarks": []},
    )  # fmt: skip


def _impacts() -> Experiment:
    """A table of random impacts that lose energy, with a measure line and a block that no release has."""
    rng, n = np.random.default_rng(1), 40
    before = rng.normal([0.05, 0.012, 0, 1, -1.5, -40], [0.03, 0.001, 2, 0.2, 0.2, 10], (n, 6))
    after = before[:, 3:] * [0.7, -0.4, 0.8]
    table = pd.DataFrame(np.column_stack([before, after]), columns=list(REQUIRED_IMPACT_COLUMNS[2:]))
    table.insert(0, "release", np.arange(n) // 2)
    table.insert(1, "block", np.where(np.arange(n) < n // 2, "sphere", "cube"))
    own = film(world(), 1, duration_s=0.01)
    stone = make_block("stone", "polygon", 0.02, vertices_m=[[0.0, 0.0], [0.02, 0.0], [0.015, 0.02]])
    ground = CrossSection(POINTS, ZONES, {"line_1": [[0.14, 0.02], [0.14, 0.3]]})
    return replace(
        own, trajectories=None, impacts=table, cross_section=ground, blocks={**own.blocks, stone.name: stone}
    )


def _first_releases(experiment: Experiment) -> Experiment:
    rows = experiment.trajectories
    assert rows is not None
    return replace(experiment, trajectories=rows[rows["release"].isin(sorted(set(rows["release"]))[:FEW_RELEASES])])


def _files(experiment: Experiment) -> Files:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "film"
        write_experiment(folder, experiment)
        return {path.name: path.read_bytes() for path in folder.iterdir() if path.suffix in (".yaml", ".csv")}
