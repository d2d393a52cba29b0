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

Names are imported at their first use, so that ``import rock2d`` is fast."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from rock2d import schemas as schemas
from rock2d.version import __version__ as __version__

if TYPE_CHECKING:
    from rock2d.api.films import DiagnosisResult as DiagnosisResult
    from rock2d.api.films import TrackResult as TrackResult
    from rock2d.api.films import diagnose as diagnose
    from rock2d.api.films import predict as predict
    from rock2d.api.films import track as track
    from rock2d.api.sites import RunResult as RunResult
    from rock2d.api.sites import assess as assess
    from rock2d.api.sites import least_size as least_size
    from rock2d.api.sites import run as run
    from rock2d.api.sites import write_report as write_report
    from rock2d.design.assessment import Assessment as Assessment
    from rock2d.design.least_size import Answer as Answer
    from rock2d.design.least_size import Target as Target
    from rock2d.effects import catalogue as catalogue
    from rock2d.errors import InputError as InputError
    from rock2d.files.experiment import Experiment as Experiment
    from rock2d.files.experiment import load_experiment as load_experiment
    from rock2d.files.scenario import Scenario as Scenario
    from rock2d.files.scenario_reading import load_scenario as load_scenario
    from rock2d.files.scenario_variants import variant as variant
    from rock2d.laws.contact import ContactParameters as ContactParameters
    from rock2d.laws.rebound import ReboundParameters as ReboundParameters
    from rock2d.runs.simulation import Simulation as Simulation
    from rock2d.runs.simulation import simulate as simulate
    from rock2d.scene.blocks import Block as Block
    from rock2d.scene.blocks import make_block as make_block
    from rock2d.scene.cross_section import CrossSection as CrossSection

_NAMES = {  # module -> public names
    "api.films": ("DiagnosisResult", "TrackResult", "diagnose", "predict", "track"),
    "api.sites": ("RunResult", "assess", "least_size", "run", "write_report"),
    "design.assessment": ("Assessment",),
    "design.least_size": ("Answer", "Target"),
    "effects": ("catalogue",),
    "errors": ("InputError",),
    "files.experiment": ("Experiment", "load_experiment"),
    "files.scenario": ("Scenario",),
    "files.scenario_reading": ("load_scenario",),
    "files.scenario_variants": ("variant",),
    "laws.contact": ("ContactParameters",),
    "laws.rebound": ("ReboundParameters",),
    "runs.simulation": ("Simulation", "simulate"),
    "scene.blocks": ("Block", "make_block"),
    "scene.cross_section": ("CrossSection",),
}
_MODULES = {name: module for module, names in _NAMES.items() for name in names}
__all__ = sorted(_MODULES)


def __getattr__(name: str) -> Any:
    """A public name, imported when it is first used (PEP 562)."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    found = getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
