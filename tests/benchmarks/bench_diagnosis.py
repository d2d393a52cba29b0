"""Where the processor time of a diagnosis goes: a film of the own engine, taken by a tilted camera."""

import cProfile
import pstats
from pathlib import Path
from time import process_time

import rock2d.diagnosis.attribution as attribution
import rock2d.diagnosis.base_law as base_law
import rock2d.diagnosis.cause_sets as cause_sets
import rock2d.diagnosis.diagnose as diagnosis
from rock2d.diagnosis.cross_validation import cross_validate
from rock2d.diagnosis.data import FilmData
from rock2d.diagnosis.likelihood import fit_scatter
from rock2d.effects import catalogue
from rock2d.engines import batch
from rock2d.processes import one_thread
from tests.benchmarks.bench_engines import row
from tests.kinematics.synthetic_films import film, series_order, world

RELEASES = 60
TILT = [0.03, 0.0, 0.0]
STAGES = {  # one after another, each with all that it calls
    "cutting into flights and impacts": diagnosis.check_and_segment,
    "what the film says of itself": diagnosis.findings_of_film,
    "fit of the base law": base_law.fit_base,
    "each effect alone": cause_sets.Search.try_alone,
    "sets of effects": cause_sets.Search.run,
    "which causes stay, beside what is learnt": attribution._evidence_of_sets,
    "regression of what is left": attribution._regressions,
    "where the gap lies": diagnosis.locate_gap,
}
WITHIN = {
    "of all: simulated impacts, with what surrounds them": FilmData.residuals,
    "of all: the contact law in them": batch._run_releases,
    "of all: cross-validation": cross_validate,
    "of all: scatter of the soil": fit_scatter,
}


def test_diagnosis_by_stage(benchmark):
    experiment = film(catalogue()["camera_tilt"].apply(world(series_order(RELEASES)), TILT), RELEASES, seed=7)
    one_thread()
    diagnosis.diagnose(experiment)  # compiles, if it must
    begin = process_time()
    found = diagnosis.diagnose(experiment)
    total_s = process_time() - begin
    profile = cProfile.Profile()
    benchmark.pedantic(profile.runcall, (diagnosis.diagnose, experiment), rounds=1)
    spent = {
        (Path(file).name, name): cumulative_s
        for (file, _, name), (_, _, _, cumulative_s, _) in pstats.Stats(profile).stats.items()
    }

    def share(function):
        code = getattr(function, "__code__", None) or function.py_func.__code__
        return spent[Path(code.co_filename).name, code.co_name] / spent["diagnose.py", "diagnose"]

    benchmark.extra_info["rows"] = [
        row(f"{len(found.data.impact_release)} impacts, processor time", [total_s], "s"),
        *(row(what, [share(function)]) for what, function in {**STAGES, **WITHIN}.items()),
    ]
