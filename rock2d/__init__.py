"""rock2d: 2D rigid-body simulation of rockfall against embankments.

SI units; x towards the embankment, y up, angles counter-clockwise positive. `docs/glossary.md` explains the terms.

Simulate one release and draw it:

>>> import rock2d
>>> cube = rock2d.make_block("cube", "square", mass_kg=0.0233, side_m=0.019)
>>> ground = rock2d.CrossSection(
...     points_m=[[-0.7, 0.55], [0.0, 0.0], [0.13, 0.0], [0.17, 0.083], [0.4, 0.083]],
...     zones=["slope", "ditch", "facing", "crest"],
... )
>>> soil = rock2d.ContactParameters(k_l_N_m=1.0e4, k_ul_N_m=6.0e4, friction_angle_deg=30)
>>> result = rock2d.simulate(cube, ground, soil, states=[-0.05, 0.15, 0.3, 1.0, -1.0, 20.0])
>>> figure = result.plot()
>>> result.to_pandas("impacts")["zone"].iloc[0]
'ditch'

Next steps:

- with a scenario file: `load_scenario`, then `run` and `write_report`;
- with a scenario that has the key ``uncertainty``: `assess` and `least_size`;
- with a film: `track`; with an experiment: `load_experiment`; then `diagnose` and `predict`;
- `.view()` opens the page of a result in the browser;
- a mistake in the input raises `InputError`, which has a code and fields.

Names are imported at their first use, so that ``import rock2d`` is fast.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from rock2d import schemas as schemas
from rock2d.version import __version__ as __version__

if TYPE_CHECKING:
    from rock2d.api.films import DiagnosisResult, TrackResult, diagnose, predict, track
    from rock2d.api.sites import RunResult, assess, least_size, run, write_report
    from rock2d.design.assessment import Assessment
    from rock2d.design.least_size import Answer, Target
    from rock2d.effects import catalogue
    from rock2d.errors import InputError
    from rock2d.files.experiment import Experiment, load_experiment
    from rock2d.files.scenario import Scenario, load_scenario
    from rock2d.files.scenario_variants import variant
    from rock2d.laws.contact import ContactParameters
    from rock2d.laws.rebound import ReboundParameters
    from rock2d.runs.simulation import Simulation, simulate
    from rock2d.scene.blocks import Block, make_block
    from rock2d.scene.cross_section import CrossSection

__all__ = [
    "Answer",
    "Assessment",
    "Block",
    "ContactParameters",
    "CrossSection",
    "DiagnosisResult",
    "Experiment",
    "InputError",
    "ReboundParameters",
    "RunResult",
    "Scenario",
    "Simulation",
    "Target",
    "TrackResult",
    "assess",
    "catalogue",
    "diagnose",
    "least_size",
    "load_experiment",
    "load_scenario",
    "make_block",
    "predict",
    "run",
    "simulate",
    "track",
    "variant",
    "write_report",
]

_MODULES = {
    "Answer": "design.least_size",
    "Assessment": "design.assessment",
    "Block": "scene.blocks",
    "ContactParameters": "laws.contact",
    "CrossSection": "scene.cross_section",
    "DiagnosisResult": "api.films",
    "Experiment": "files.experiment",
    "InputError": "errors",
    "ReboundParameters": "laws.rebound",
    "RunResult": "api.sites",
    "Scenario": "files.scenario",
    "Simulation": "runs.simulation",
    "Target": "design.least_size",
    "TrackResult": "api.films",
    "assess": "api.sites",
    "catalogue": "effects",
    "diagnose": "api.films",
    "least_size": "api.sites",
    "load_experiment": "files.experiment",
    "load_scenario": "files.scenario",
    "make_block": "scene.blocks",
    "predict": "api.films",
    "run": "api.sites",
    "simulate": "runs.simulation",
    "track": "api.films",
    "variant": "files.scenario_variants",
    "write_report": "api.sites",
}


def __getattr__(name: str) -> Any:
    """A public name, imported when it is first used (PEP 562)."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    found = getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
