"""Effects of a diagnosis in a run: they act on blocks, soil and ground; those of the camera do not."""

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

import rock2d
from rock2d.commands.run import RunRequest, run_scenarios
from rock2d.design.command import run_design
from rock2d.design.least_size import Target
from rock2d.design.report_tables import model_text, parameter_tables
from rock2d.diagnosis.predict import diagnosed_world
from rock2d.effects import catalogue
from rock2d.effects.columns import column
from rock2d.errors import InputError
from rock2d.files.experiment import write_experiment
from rock2d.files.scenario_variants import variant
from rock2d.graphics.figure_files import NoFigures
from rock2d.laws.contact import ContactParameters, contact_table
from rock2d.runs.acting_effects import ActingEffects
from rock2d.runs.campaigns.campaign import Workers
from rock2d.runs.conditions import Conditions, starts
from rock2d.runs.diagnosis_remarks import diagnosis_remarks
from rock2d.runs.model_comparison import diagnosed_models, model_table
from rock2d.runs.printed_tables import PRINTED_TABLES, print_tables, table_note
from rock2d.scene.cross_section import CrossSection, embankment_facets
from rock2d.scene.world import View, World
from tests.diagnosed_files import BLOCKS, JOINT, SOIL, content, diagnosed, effect, numbers, undiagnosed
from tests.programs import commanded
from tests.scenarios_of_tests import scenario_file

TILT = effect(tilt_rad=(0.03, 0.02, 0.04), centre_right=(0.0, -0.1, 0.1), centre_up=(0.0, -0.1, 0.1))
SHORT = "time_limit_s: 1.6"  # long enough for the first impact


def drag(value: float, **more):
    return content("air_drag", {"air_drag": effect(drag_per_mass_1_m=(value, 0.9 * value, 1.1 * value))}, **more)


def knots(scenario, **options):
    return [track.knots for track in rock2d.run(scenario, **options).tracks]


def same(first, second):
    return all(np.array_equal(a, b, equal_nan=True) for a, b in zip(first, second, strict=True))


@pytest.mark.parametrize("engine", ["batch", "pymunk"])
def test_air_drag_slows_a_fall_to_its_closed_form(tmp_path, engine):
    k, height, g = 0.2, 100.0, 9.81
    more = "time_limit_s: 60"
    scenario = diagnosed(tmp_path, drag(k), engine=engine, more=more)
    scenario.incident["default"] = scenario.incident["default"].model_copy(
        update={"distribution": scenario.incident["default"].distribution.model_copy(
            update={"x_m": 50.0, "y_m": height + 0.3, "theta_rad": 0.0, "vx_m_s": 0.0})}
    )  # fmt: skip
    result = rock2d.run(scenario, releases=1, workers=1)
    hit = result.to_pandas("impacts").groupby("block")["vy_m_s"].first()
    for block in ("ball", "box"):  # drag is the same per mass
        assert hit[block] == pytest.approx(-np.sqrt(g / k * (1 - np.exp(-2 * k * height))), rel=1e-4)
    before = rock2d.run(
        scenario.with_diagnosed(scenario.diagnosed.using(scenario.diagnosed.before)), releases=1, workers=1
    )
    assert before.to_pandas("impacts")["vy_m_s"][0] == pytest.approx(-np.sqrt(2 * g * height), rel=1e-6)


def test_each_block_has_its_own_drag(tmp_path):
    given = drag(0.101)
    each = {name: {"value": v, "ci95": [0.9 * v, 1.1 * v]} for name, v in (("ball", 0.2), ("cone", 0.1), ("box", 2e-3))}
    given["effects"]["air_drag"]["parameters"]["drag_per_mass_1_m"]["by_block"] = each
    scenario = diagnosed(tmp_path, given, more="uncertainty: {sites: 4, releases: 20}")
    own = {met.block.name: max(met.block.air) / met.block.mass_kg for met in Conditions(scenario, "batch", 1).common}
    assert own == pytest.approx({"ball": 0.2, "box": 0.002})
    places = [f"diagnosis.air_drag.drag_per_mass_1_m.{name}" for name in ("ball", "box")]
    assert list(scenario.unknown()) == places
    met = Conditions(variant(scenario, {places[1]: 0.003}), "batch", 1).common
    assert [max(one.block.air) / one.block.mass_kg for one in met] == pytest.approx([0.2, 0.003])
    said = " ".join(diagnosis_remarks(scenario))
    assert "acts: drag_per_mass_1_m.ball = 0.2 [0.18, 0.22] 1/m, drag_per_mass_1_m.box = 0.002 [0.0018, 0.0022]" in said
    del each["box"]
    scenario = diagnosed(tmp_path, given, more="uncertainty: {sites: 4, releases: 20}")
    own = {met.block.name: max(met.block.air) / met.block.mass_kg for met in Conditions(scenario, "batch", 1).common}
    assert own == pytest.approx({"ball": 0.2, "box": 0.101}) and len(scenario.unknown()) == 2


def test_the_camera_does_not_change_a_bit(tmp_path):
    found = knots(diagnosed(tmp_path, content("camera_tilt", {"camera_tilt": TILT})))
    assert same(found, knots(undiagnosed(tmp_path, numbers(JOINT))))
    assert not same(found, knots(undiagnosed(tmp_path, numbers(SOIL))))


@pytest.mark.parametrize("engine", ["batch", "pymunk"])
def test_no_effect_is_the_base_law_bit_for_bit(tmp_path, engine):
    found = knots(diagnosed(tmp_path, content("none"), engine=engine, more=SHORT), releases=2, workers=1)
    by_hand = undiagnosed(tmp_path, numbers(SOIL), engine, more=SHORT)
    assert same(found, knots(by_hand, releases=2, workers=1))


@pytest.mark.parametrize("name, corrected", [("bench", True), ("other", False)])
def test_restarted_releases_start_from_true_poses_at_true_instants(tmp_path, name, corrected):
    made = rock2d.run(undiagnosed(tmp_path, numbers(SOIL), more=SHORT), releases=2, workers=1)
    film, poses = made.experiment(), ["x_m", "y_m", "theta_rad"]
    seen = View(theta_offset_rad=0.1, mirror=(-1.0, 1.0, 1.0)).record(film.trajectories[poses].to_numpy())
    recorded = film.trajectories.assign(t_s=film.trajectories["t_s"] / 1.1, **dict(zip(poses, seen.T, strict=True)))
    write_experiment(tmp_path / "film", replace(film, name=name, trajectories=recorded, fps=film.fps * 1.1))
    fitted = {
        "mirrored_axis": effect(axis=(1.0, 1.0, 1.0)), "angle_offset": effect(offset_rad=(0.1, 0.1, 0.1)),
        "frame_rate_error": effect(time_scale=(1.1, 1.1, 1.1)),
    }  # fmt: skip
    sizes = {cause: own["parameters"] for cause, own in fitted.items()}
    given = content("angle_offset", fitted, model={"base": SOIL, "parameters": sizes})
    (tmp_path / "d.json").write_text(json.dumps(given))
    start = "from_experiment: {folder: film}"
    file = scenario_file(
        tmp_path, "again", releases=2, blocks=BLOCKS, model="{diagnosis: d.json}", incident=start, more=SHORT
    )
    scenario = rock2d.load_scenario(file, tmp_path)
    result = rock2d.run(scenario, workers=1)
    first = [np.append(track.knots[0, 0], track.knots[0, 1:7]) for track in made.tracks]
    found = [np.append(start.t_s, start.state) for start in result.incident_states]
    assert np.allclose(found, first, rtol=1e-3, atol=1e-3) == corrected
    said = " ".join(diagnosis_remarks(scenario))
    assert ("the frames are corrected for" in said) == corrected != ("as they were recorded" in said)
    residuals = result.write(tmp_path / "out", figures=NoFigures())["residuals"]
    assert (residuals[["dx_m", "dy_m"]].abs().to_numpy().max() < 0.01) == corrected


def test_the_reading_of_the_rolling_resistance_comes_along(tmp_path):
    given = content("none", law={"rolling_in_indentation": True})
    assert not same(knots(diagnosed(tmp_path, given)), knots(undiagnosed(tmp_path, numbers(SOIL))))


def test_both_engines_meet_the_same_effects(tmp_path):
    given = content("adhesion", {"adhesion": effect(pull_per_weight=(1.0, 0.5, 1.5))})
    scenario = diagnosed(tmp_path, given, more=SHORT)
    first = {engine: rock2d.run(scenario, engine=engine, releases=1, workers=1) for engine in ("batch", "pymunk")}
    after = {k: v.to_pandas("impacts").groupby("release")["vy_after_m_s"].first() for k, v in first.items()}
    without = rock2d.run(undiagnosed(tmp_path, numbers(JOINT), more=SHORT), releases=1).to_pandas("impacts")
    assert after["batch"].to_numpy() == pytest.approx(after["pymunk"].to_numpy(), rel=1e-3, abs=1e-3)
    assert after["batch"][0] != pytest.approx(without["vy_after_m_s"][0], abs=1e-3)


def test_a_contrast_of_soils_is_that_of_the_embankment(tmp_path):
    own = effect(stiffness=(0.5, 0.4, 0.6), restitution=(1.0, 0.9, 1.1), friction=(1.0, 0.9, 1.1))
    scenario = diagnosed(tmp_path, content("zone_contrast", {"zone_contrast": own}))
    met = Conditions(scenario, "batch", 1).common[0]
    ground = met.cross_section
    on = np.unique(ground.zone_ids[embankment_facets(ground)])
    expected = np.full(len(ground.zone_names), JOINT["k_l_N_m"])
    expected[on] *= 0.5
    assert 0 < len(on) < len(expected) and np.array_equal(met.parameters[:, 0], expected)


def test_an_effect_without_its_object_says_so(tmp_path):
    scenario = diagnosed(tmp_path, content("soil_compaction", {"soil_compaction": effect(
        rate=(0.05, 0.04, 0.06), excess=(0.0, -0.01, 0.01))}))  # fmt: skip
    assert any("soil_compaction changes nothing: each release is the first" in r for r in diagnosis_remarks(scenario))
    assert same(knots(scenario), knots(undiagnosed(tmp_path, numbers(JOINT))))


def test_every_effect_of_the_catalogue_acts_or_says_why_not(tmp_path):
    for name, own in catalogue().items():
        given = effect(**{q.name: (v := q.low + 0.7 * (q.high - q.low), v, v) for q in own.parameters})
        scenario = diagnosed(tmp_path, content(name, {name: given}))
        changed = (
            Conditions(scenario, "batch", 1).of_releases(0, 0, 1)[0],
            Conditions(scenario, "batch", 1).of_releases(1, 0, 1)[0],
        )
        plain = Conditions(scenario.with_diagnosed(scenario.diagnosed.using(
            scenario.diagnosed.model._replace(effects={}))), "batch", 1).common  # fmt: skip
        acts = any(
            c.parameters.shape[1] > 7 or name == "zone_contrast"
            or c.block.inertia_kg_m2 != p.block.inertia_kg_m2 or c.block.air != p.block.air
            or c.block.rounding_m != p.block.rounding_m or c.block.centre_of_mass_m != p.block.centre_of_mass_m
            or not np.array_equal(c.cross_section.points_m, p.cross_section.points_m)
            for c, p in zip(changed, plain, strict=True)
        )  # fmt: skip
        said = " ".join(diagnosis_remarks(scenario))
        quiet = f"{name} does not act" in said or f"{name} changes nothing" in said
        assert acts != quiet, name
        assert quiet == (own.camera or name == "soil_compaction"), name


def test_roughness_of_impacts_becomes_a_rough_surface(tmp_path):
    given = content("surface_roughness", {"surface_roughness": effect(sd_rad=(0.1, 0.1, 0.1))})
    conditions = Conditions(diagnosed(tmp_path, given), "batch", 1)
    slopes = []
    for met in conditions.of_releases(0, 0, 200):
        step = np.diff(met.cross_section.points_m[met.cross_section.points_m[:, 0] <= 20.0 + 1e-9], axis=0)
        slopes.append(np.arctan2(step[:, 1], step[:, 0]) + np.pi / 4)
    size = np.mean([block.size_m for block in conditions.blocks])
    assert len(slopes[0]) == 2 * round(20 * np.sqrt(2) / (2 * size))
    assert np.std(np.concatenate(slopes)) == pytest.approx(0.1, rel=0.05)  # cut off at 3 sd


def test_a_centre_of_mass_beside_the_centroid_starts_where_the_centroid_does(tmp_path):
    given = content("mass_eccentricity", {"mass_eccentricity": effect(along=(0.1, 0.1, 0.1), across=(0.0, 0.0, 0.0))})
    scenario = diagnosed(tmp_path, given)
    plain = undiagnosed(tmp_path, numbers(JOINT))
    result = rock2d.run(scenario, releases=2)
    found, stated = (
        own.to_pandas("trajectories").groupby("release").first() for own in (result, rock2d.run(plain, releases=2))
    )
    assert found[["x_m", "y_m", "theta_rad"]].to_numpy() == pytest.approx(
        stated[["x_m", "y_m", "theta_rad"]].to_numpy()
    )
    moved = np.hypot(*(result.tracks[0].states(np.zeros(1))[0, :2] - stated[["x_m", "y_m"]].to_numpy()[0]))
    assert moved == pytest.approx(0.1 * np.mean([block.size_m for block in plain.make_blocks().values()]))


def test_a_scattered_soil_has_the_effects_too(tmp_path):
    model = "{diagnosis: d.json, deterministic: {default: {friction_angle_deg: 30}}}"
    more = "scatter: {model.deterministic.default.friction_angle_deg: {uniform: {low: 25, high: 35}}}"
    given = content("out_of_plane", {"out_of_plane": effect(angle_rad=(0.2, 0.1, 0.3))})
    own = [met for _, met in starts(Conditions(diagnosed(tmp_path, given, model=model, more=more), "batch", 1))]
    angles = np.rad2deg(np.arctan([met.parameters[0, 3] for met in own]))
    assert all((met.parameters[:, column("out_of_plane_rad")] == 0.2).all() for met in own)
    assert angles == pytest.approx([met.drawn["model.deterministic.default.friction_angle_deg"] for met in own])


def test_the_point_mass_engine_is_refused(tmp_path):
    scenario = diagnosed(tmp_path, content())
    with pytest.raises(InputError, match="engine point_mass does not have; use batch or pymunk"):
        rock2d.run(scenario, engine="point_mass")


def test_before_and_after_share_their_releases(tmp_path):
    scenario = diagnosed(tmp_path, drag(0.05))
    result = rock2d.run(scenario)
    models = diagnosed_models(scenario, "batch")
    table = model_table(models, scenario.seed, scenario.releases)
    assert [m.name for m in models] == ["before", "soil", "after"]
    after = table[table["model"] == "after"].set_index(["block", "line"])
    passing = result.to_pandas("passing").set_index(["block", "line"])
    assert after["frequency"].equals(passing["frequency"])
    before = rock2d.run(undiagnosed(tmp_path, numbers(SOIL))).to_pandas("passing").set_index(["block", "line"])
    assert table[table["model"] == "before"].set_index(["block", "line"])["passed"].equals(before["passed"])
    assert before["passed"].sum() > after["passed"].sum()  # or the comparison says nothing
    assert "before and after" in model_text(table, "before and after the diagnosis")


def test_a_run_says_on_every_table_that_it_leaves_learnt_changes_out(tmp_path, capsys):
    learnt = {"closes": 0.93, "closes_ci95": [0.9, 0.95], "changes": ["flight of height"]}
    found = {"p": 0.98, "share": 0.9, "depends_on": ["height"], "learnt": learnt}
    scenario = diagnosed(tmp_path, {**content("unknown"), "schema": 2, "outside": found})
    assert any("flight of height (closes 93 % of the gap" in line for line in diagnosis_remarks(scenario))
    result = rock2d.run(scenario)
    print_tables(result.scenario, "batch", {name: result.to_pandas(name) for name in PRINTED_TABLES})
    note = "without the learnt changes of d.json"
    table = model_table(diagnosed_models(scenario, "batch"), scenario.seed, scenario.releases)
    shown = [*capsys.readouterr().out.splitlines(), model_text(table, "before and after", note)]
    assert sum(note in line for line in shown) == 3  # passing, stops, before and after
    rock2d.write_report(result, tmp_path / "page")
    page = (tmp_path / "page" / "report.html").read_text(encoding="utf-8")
    assert page.count(note) >= 5 and "flight of height (closes 93\N{NO-BREAK SPACE}%" in page


def test_a_run_says_that_the_soil_of_flights_alone_was_not_fitted(tmp_path):
    scenario = diagnosed(tmp_path, content("none", law={"fitted": False}))
    said = diagnosis_remarks(scenario)
    assert any(line.startswith("warning") and "not fitted" in line for line in said)
    assert "no effect was found: only the paper's soil" in " ".join(said) and "refitted" not in " ".join(said)
    assert table_note(scenario) == "with the unfitted soil of d.json where the scenario states none"
    assert all("not fitted" in table.note for table in parameter_tables(scenario, "batch"))
    fitted = diagnosed(tmp_path, content("none"))
    assert not table_note(fitted) and not any(table.note for table in parameter_tables(fitted, "batch"))


def test_the_least_embankment_brings_its_diagnosis_along_and_its_page_says_what_is_not_known(tmp_path):
    (tmp_path / "fitted.csv").write_text("blocks.box.mass_kg\n" + "".join(f"{mass}\n" for mass in range(570, 590)))
    diagnosed(tmp_path, drag(0.01), more="uncertainty: {sites: 4, releases: 20, posterior: fitted.csv}")
    target = Target("facing_1_3", 0.9, 0.5)
    run_design(tmp_path / "diagnosed.yaml", "embankment.height_m", (2.0, 3.0), target, tmp_path / "least",
               tolerance=1.0, progress=False)  # fmt: skip
    least = rock2d.load_scenario(tmp_path / "least" / "least.yaml")
    assert least.diagnosed.verdict == "air_drag"
    page = (tmp_path / "least" / "report.html").read_text(encoding="utf-8")
    assert "air_drag acts: drag_per_mass_1_m = 0.01 [0.009, 0.011]" in page
    assert "Not known: blocks.box.mass_kg, as in the 20 draws of fitted.csv" in page
    assert "Not known: diagnosis.air_drag.drag_per_mass_1_m, as d.json gives it" in page


def test_a_search_finds_the_diagnosis_under_the_data_root(tmp_path):
    (tmp_path / "data").mkdir()
    (tmp_path / "d.json").write_text(json.dumps(drag(0.01)))
    path = undiagnosed(tmp_path, "{diagnosis: d.json}").document.file
    (tmp_path / "d.json").rename(tmp_path / "data" / "d.json")
    words = ["design", path, "--range", 3, 2, "--out", tmp_path / "least"]
    assert "no file 'd.json'" in str(commanded(*words).exception)
    assert "must rise" in str(commanded(*words, "--data", tmp_path / "data").exception)


@pytest.mark.parametrize("name", ["x" * 5000, "a\\b", "d.json/../../d.json"])
def test_a_path_that_no_file_has_is_one_message(tmp_path, name):
    with pytest.raises(InputError):
        undiagnosed(tmp_path, f"{{diagnosis: '{name}'}}")


def test_the_command_writes_the_comparison_and_names_the_diagnosis(tmp_path):
    diagnosed(tmp_path, drag(0.05), more="uncertainty: {sites: 4, releases: 20}")
    said: list[str] = []
    request = RunRequest(tmp_path / "out", workers=Workers(1), progress=False, report=said.append)
    run_scenarios([tmp_path / "diagnosed.yaml"], request)
    folder = tmp_path / "out" / "diagnosed_batch"
    about = json.loads((folder / "run.json").read_text())["diagnosis"]
    assert (about["path"], about["verdict"], about["schema"]) == ("d.json", "air_drag", 1)
    assert len(about["sha256"]) == 64
    assert set(pd.read_csv(folder / "before_after.csv")["model"]) == {"before", "soil", "after"}
    sites = pd.read_csv(folder / "sites.csv")
    assert list(sites) == ["diagnosis.air_drag.drag_per_mass_1_m"] and sites.iloc[:, 0].std() > 0
    assert any("air_drag acts: drag_per_mass_1_m = 0.05 [0.045, 0.055]" in line for line in said)


@pytest.mark.parametrize(
    "blocks, said",
    [({}, "cannot be checked"), ({"a": {"mass_kg": 0.02, "size_m": 0.02}}, "do not hold at this scale"),
     ({"a": {"mass_kg": 400.0, "size_m": 0.6}}, "")],
)  # fmt: skip
def test_another_scale_is_warned_of(tmp_path, blocks, said):
    warned = [r for r in diagnosis_remarks(diagnosed(tmp_path, content(blocks=blocks))) if r.startswith("warning")]
    assert bool(warned) == bool(said) and all(said in line for line in warned)


TWO_SMALL = {"a": {"mass_kg": 0.02, "size_m": 0.01}, "b": {"mass_kg": 0.04, "size_m": 0.03}}


@pytest.mark.parametrize("blocks", [{}, TWO_SMALL])
def test_what_ground_and_soil_have_keeps_its_size_with_other_blocks(tmp_path, blocks):
    fitted = {
        "embankment_yield": effect(mass_ratio=(0.1, 0.1, 0.1)),
        "adhesion": effect(pull_per_weight=(0.5, 0.5, 0.5)),
        "ploughing_drag": effect(rate_1_s=(40.0, 40.0, 40.0)),
        "viscous_damping": effect(rate_1_s=(10.0, 10.0, 10.0), deep_rate_1_s=(20.0, 20.0, 20.0)),
        "mass_eccentricity": effect(along=(0.1, 0.1, 0.1), across=(0.0, 0.0, 0.0)),
        "geometry_error": effect(facing_rad=(0.0, 0.0, 0.0), ditch_level=(0.1, 0.1, 0.1)),
    }
    sizes = {cause: own["parameters"] for cause, own in fitted.items()}
    given = content("adhesion", fitted, model={"base": SOIL, "parameters": sizes}, blocks=blocks)
    scenario = diagnosed(tmp_path, given)
    own = scenario.make_blocks().values()
    size_m = 0.02 if blocks else np.mean([block.size_m for block in own])
    mass_kg = 0.03 if blocks else np.mean([block.mass_kg for block in own])
    bare = CrossSection([[0.0, 1.0], [9.0, 1.0]], ["floor"])
    acting = replace(ActingEffects.of(scenario.diagnosed.model, scenario), cross_section=bare)
    table = contact_table(ContactParameters(), bare.zone_names)[None]
    world = diagnosed_world(given, World(acting.blocks, bare, table), np.zeros(1), base_only=False)
    for ground in (acting.ground(), world.cross_section):
        assert ground.points_m[:, 1] == pytest.approx(1.0 + 0.1 * size_m)
    met = Conditions(scenario, "batch", 1).common[0]
    assert met.block.centre_of_mass_m == world.blocks["ball"].centre_of_mass_m == pytest.approx((0.1 * size_m, 0.0))
    assert met.parameters[:, column("recoil_1_kg")].max() == pytest.approx(0.1 / mass_kg)
    for row in (met.parameters[0], world.contact[0, 0]):
        assert row[column("adhesion_N")] == pytest.approx(0.5 * mass_kg * 9.80665)
        assert row[column("ploughing_Ns_m2")] == pytest.approx(40.0 * mass_kg / size_m)
        assert row[column("viscous_Ns_m")] == pytest.approx(10.0 * mass_kg)
        assert row[column("viscous_Ns_m2")] == pytest.approx(20.0 * mass_kg / size_m)


def test_a_possible_site_has_its_own_effect(tmp_path):
    scenario = diagnosed(tmp_path, drag(0.05), more="uncertainty: {sites: 4, releases: 20}")
    site = variant(scenario, {"diagnosis.air_drag.drag_per_mass_1_m": 0.07})
    met = Conditions(site, "batch", 1).common[0]
    assert met.block == replace(met.block, air=met.block.air)
    assert max(met.block.air) == pytest.approx(0.07 * 305)
