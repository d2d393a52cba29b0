"""The examples of CONTRIBUTING.md do what the text says."""

import importlib.util
import re
from types import SimpleNamespace

import numpy as np
import pytest
from rock2d_tracking.importers import find_importer, importer_names

from rock2d.errors import InputError
from tests.docs.sources import ROOT

EXAMPLE = re.compile(r"`(?:rock2d|tracking)/[\w/]+/(\w+)\.py`:\n\n```python\n(.*?)```", re.DOTALL)
EXAMPLES = dict(EXAMPLE.findall((ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")))


@pytest.fixture
def example(tmp_path):
    """Imports the example of this name."""

    def read(name: str):
        path = tmp_path / f"{name}.py"
        path.write_text(EXAMPLES[name], encoding="utf-8")
        spec = importlib.util.spec_from_file_location(name, path)
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        return module

    return read


def test_effect(example):
    module = example("speed_lift")
    assert module.EFFECT.name == "speed_lift"
    law = getattr(module.flight, "py_func", module.flight)
    assert law(0.2, 3.0, 4.0, 0.0, 2.0, 1.0) == pytest.approx((-2.0, 1.5, 0.0))


def test_shape(example):
    shape = example("hexagon").SHAPE
    profile = shape.profile("stone", {"side_m": 0.5})
    x, y = profile.corners_m.T
    twice_area = np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))
    assert twice_area == pytest.approx(3 * np.sqrt(3) * 0.5**2)  # counter-clockwise
    assert shape.sizes_of(profile.semi_axes_m, profile.corners_m) == {"side_m": pytest.approx(0.5)}


def test_importer(example, tmp_path):
    importer = example("plain").IMPORTER
    text = "image,u,v\n0,1.5,2\n\n1,2.5,3\n"
    assert importer.looks_like(text)
    table = importer.read(tmp_path / "seen.csv", text).table
    assert table[["line", "frame", "u", "v"]].to_numpy().tolist() == [[2, 0, 1.5, 2], [4, 1, 2.5, 3]]
    assert not any(find_importer(name).looks_like(text) for name in importer_names())
    with pytest.raises(InputError, match="expected 3 cells, found 2"):
        importer.read(tmp_path / "seen.csv", "image,u,v\n0,1.5\n")
    with pytest.raises(InputError, match="names of columns") as caught:
        importer.read(tmp_path / "seen.csv", "what,ever\n1,2\n")
    assert caught.value.line == 1


def test_indicator(example):
    indicator = example("top_speeds").INDICATOR
    knots = np.array([[0, 0, 0, 0, 3, -4, 9], [1, 3, -4, 9, 3, 0, 9.0]])
    run = SimpleNamespace(tracks=[SimpleNamespace(block="cube", release=2, knots=knots)])
    table = indicator.table(run)
    assert tuple(table.columns) == indicator.columns and table.iloc[0].tolist() == ["cube", 2, 5.0]


def test_cause(example):
    cause = example("shaking_camera").CAUSE
    scale = SimpleNamespace(size=0.02, gravity=9.81)
    values = cause.sizes(0, 1.0, np.random.default_rng(1), scale)
    poses = np.zeros((2, 5, 3))
    seen = cause.recorded(poses, SimpleNamespace(times_s=np.linspace(0, 0.01, 5)), values)
    assert np.ptp(seen[..., 1]) > 0 and not poses.any() and not seen[..., [0, 2]].any()
    assert set(EXAMPLES) == {"speed_lift", "hexagon", "plain", "top_speeds", "shaking_camera"}
