"""Diagnoses of films whose hidden effect is known. The engine is the same, so the answers must be exact."""

import json
from dataclasses import replace

import numpy as np
import pytest

from rock2d.diagnosis.attribution import attribute
from rock2d.diagnosis.base_law import fit_base, fit_from_grid, register_by_fit
from rock2d.diagnosis.data import FilmData
from rock2d.diagnosis.diagnose import diagnose, findings_of_film, registered_remark
from rock2d.diagnosis.diagnosis_content import diagnosis_json
from rock2d.diagnosis.exploring import REFIT_GAIN
from rock2d.diagnosis.fitting import Convergence, fit
from rock2d.diagnosis.workload import DiagnosisBars
from rock2d.effects import catalogue
from rock2d.kinematics.flights import load_film
from rock2d.kinematics.sanity import Sanity
from rock2d.kinematics.setup_world import base_law_start, setup_world
from rock2d.laws.contact import ROLLING_IN_INDENTATION
from rock2d.processes import Processes
from tests.kinematics.synthetic_films import LAW, base_fit, data_of, effects, film, series_order, with_causes, world

RELEASES, FEW = 16, 10  # per block; ten tell apart what is as large as the hidden effects here
# the whole catalogue takes minutes
RIVALS = ("angle_offset", "inertia_error", "surface_roughness", "zone_contrast")


def test_base_law_is_recovered():
    _, found = base_fit(film(world(), RELEASES, seed=2))
    law = found.model.law(found.p)
    truth = np.array(
        [LAW.k_l_N_m, LAW.k_ul_N_m, LAW.k_t_N_m, np.tan(np.deg2rad(LAW.friction_angle_deg)), LAW.k_r_Nm_rad]
    )
    z = np.log(law / truth)[[0, 2, 3, 4]] / np.sqrt(np.diag(found.p_covariance))[[0, 2, 3, 4]]
    assert np.abs(np.log(law / truth)).max() < 0.06
    assert np.abs(z).max() < 5
    assert found.scatter[0] == pytest.approx(0.03, abs=0.02)


@pytest.mark.parametrize(
    ("name", "values", "remark"),
    [
        ("camera_tilt", [0.0, 0.5, 0.0], None),
        ("camera_tilt", [0.03, 0.5, 0.0], "turned by 1.7°"),
        ("geometry_error", [0.0, -0.12], "ground that lies"),
    ],
)
def test_a_film_is_divided_where_its_blocks_strike_the_ground(name, values, remark):
    """A turned image, or a ditch that lies elsewhere, hides impacts; in the image and over the ground that flights and
    impacts fit, the same ones are seen as in the true world. Gravity in flights tells which of them it is."""
    true = catalogue()[name].apply(world(), values)
    experiment = film(true, FEW, seed=2)
    setup = setup_world(experiment)
    data, seen = (FilmData.of(load_film(experiment), own) for own in (setup, true))
    better = register_by_fit(fit_base(setup, base_law_start(experiment), data), data)
    if remark is None:
        assert better is None
        return
    assert better is not None
    again, found = better
    assert found.view.tilt_rad == pytest.approx(true.view.tilt_rad, abs=2e-3)
    assert found.cross_section.points_m == pytest.approx(true.cross_section.points_m, abs=2e-3)
    assert remark in registered_remark(setup, found)
    missed = [abs(len(own.flight_release) - len(seen.flight_release)) for own in (data, again)]
    assert missed[1] < 0.3 * missed[0]
    findings = findings_of_film(experiment, setup, Sanity(registered=found), again)
    assert findings is not None  # what it says of the stated ground does not depend on the ground that was found
    rest = {own.block: own for own in findings.rests}["cube"]
    ditch_m = true.cross_section.points_m[1, 1]
    assert rest.height_m == pytest.approx(ditch_m, abs=1e-3)


@pytest.fixture(scope="module")
def diagnosed(request):
    """The diagnosis of a film with one effect of the catalogue at these values."""

    def make(name: str | None, values: list[float], seed: int):
        own = {name: values} if name else {}
        seen = film(with_causes(world(series_order(FEW)), own), FEW, seed=seed)
        return diagnosis_json(diagnose(seen, effects=effects(*RIVALS, *own)))

    return make


@pytest.mark.parametrize(
    ("name", "values"),
    [("zone_contrast", [0.4, 1.0, 1.0, 0.0]), ("soil_compaction", [0.04, 0.0, 0.0]), ("frame_rate_error", [1.04])],
)
def test_hidden_effect_is_named_and_measured(diagnosed, name, values):
    """A camera that is tilted is that of the tutorial, in `tests/docs/test_tutorials.py`."""
    content = diagnosed(name, values, seed=7)
    assert content["verdict"] == name
    found = [p["value"] for p in content["effects"][name]["parameters"].values()]
    assert found[0] == pytest.approx(values[0], rel=0.15)
    assert content["gap"]["closure"] > 0.85
    assert sum(content["probabilities"].values()) == pytest.approx(1.0)
    assert content["where"] and sum(c["share"] for c in content["where"]) == pytest.approx(1.0)


def test_no_effect_is_named_without_one(diagnosed):
    content = diagnosed(None, [], seed=11)
    assert content["verdict"] == "none"
    assert not [remark for remark in content["sanity"]["remarks"] if "shows no noise" in remark]
    json.dumps(content, allow_nan=False)


@pytest.fixture(scope="module")
def plain():
    """A film without an effect, two effects to try, and the content of its diagnosis in one process."""
    experiment, tried = film(world(), 6, seed=3), effects("angle_offset", "inertia_error")
    return experiment, tried, diagnosis_json(diagnose(experiment, effects=tried))


def test_result_does_not_depend_on_the_number_of_processes(plain):
    experiment, tried, one = plain
    assert one == diagnosis_json(diagnose(experiment, effects=tried, workers=2))


@pytest.fixture(scope="module")
def stuck():
    """A film, the law fitted to it, and a fit that stopped at once at another law."""
    data, proper = base_fit(film(world(), 12, seed=2))
    off = proper.p + np.array([0.4, -0.2, 0.5, 0.0, 0.0])
    return data, proper, fit(proper.model, data, off, convergence=Convergence(np.inf))


def test_a_better_law_found_with_an_effect_becomes_the_base(stuck):
    """With a poor base any effect would look good, because its fit finds the better law."""
    data, proper, stuck = stuck
    assert stuck.total() < proper.total() - 50.0
    found = attribute(stuck, data, effects("angle_offset", "air_drag"))
    assert found.base.fit.total() == pytest.approx(proper.total(), abs=REFIT_GAIN)
    assert max(c.total for c in found.candidates.values()) < REFIT_GAIN


def test_the_law_is_fitted_anew_beside_a_cause_to_which_the_base_had_adapted():
    """With a mirrored rotation the base chooses the wrong reading of the rolling resistance, and k_r is four times too
    large even beside the mirrored axis."""
    plain = world()
    rows = plain.contact.copy()
    rows[..., ROLLING_IN_INDENTATION] = 1.0
    true = catalogue()["mirrored_axis"].apply(replace(plain, contact=rows), [3.0])
    experiment = film(true, 12, seed=1)
    setup, data = data_of(experiment)
    base = fit_base(setup, base_law_start(experiment), data)
    assert not base.model.setup.contact[..., ROLLING_IN_INDENTATION].any()
    found = attribute(base, data, effects("mirrored_axis", "inertia_error"))
    law = found.final.fit.model
    assert found.named == {"mirrored_axis"} and found.outside < 0.05
    assert law.setup.contact[..., ROLLING_IN_INDENTATION].all()
    assert law.law(found.final.fit.p)[4] == pytest.approx(LAW.k_r_Nm_rad, rel=0.05)


def test_a_grid_that_leads_back_to_a_fit_gives_no_other(stuck):
    """From a law that is stuck, it leads to a better fit."""
    data, proper, stuck = stuck
    assert proper.free and fit_from_grid(proper.model, data, Processes(1, (data,)), known=proper) is None
    found = fit_from_grid(proper.model, data, Processes(1, (data,)), known=stuck)
    assert found is not None and found.total() == pytest.approx(proper.total(), abs=REFIT_GAIN)


def test_an_interrupted_diagnosis_continues_with_the_same_result(plain, tmp_path):
    experiment, tried, undisturbed = plain

    class StopAfterOne(DiagnosisBars):
        def fitted(self, names):
            if names == "angle_offset":
                raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        diagnose(experiment, effects=tried, folder=tmp_path, bars=StopAfterOne(False, len(tried), 1))
    kept = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.npz")}
    names = sorted(path.stem.rsplit("_", 1)[0] for path in kept)
    assert names == ["angle_offset", *(f"explored_{name}" for name in sorted(tried))]
    again = diagnosis_json(diagnose(experiment, effects=tried, folder=tmp_path))
    assert {path: path.stat().st_mtime_ns for path in kept} == kept
    assert again == undisturbed
