"""The catalogue as a whole: names, ranges, neutral values; adding an effect is adding a file."""

import os
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import rock2d
from rock2d.effects.columns import FIRST_EFFECT_COLUMN, N_COLUMNS, widened
from rock2d.effects.ground import as_built
from rock2d.engines.batch import Ensemble, run_batch
from rock2d.engines.pymunk_engine import run_pymunk
from rock2d.laws.contact import K_L, K_UL, contact_table
from rock2d.records.columns import E_RESIDUAL
from rock2d.scene.cross_section import ditch_facets, embankment_facets, facet_zones
from rock2d.scene.rough_ground import Roughness, roughened
from rock2d.scene.world import World
from tests.effects.worlds import (
    CATALOGUE,
    FLOOR,
    MECHANICAL,
    energies,
    falling,
    neutral,
    pymunk_release,
    run,
    typical,
    with_effect,
    world,
)
from tests.laboratory import LAW, SETUP, VELOCITIES_AFTER, after

NAMES = {
    "air_drag", "flight_damping", "magnus_lift", "camera_tilt", "scale_error", "frame_rate_error", "lens_distortion",
    "angle_offset", "mirrored_axis", "mass_eccentricity", "inertia_error", "rounded_edges", "geometry_error",
    "surface_roughness", "zone_contrast", "soil_compaction", "embankment_yield", "viscous_damping", "adhesion",
    "ploughing_drag", "slip_dependent_friction", "out_of_plane",
}  # fmt: skip
BLOCK = 2  # the slab: no effect leaves it alone


def test_the_catalogue_is_that_of_the_formats():
    assert set(CATALOGUE) >= NAMES, "names in diagnosis.json do not change"
    assert [effect.name for effect in CATALOGUE.values()] == list(CATALOGUE)
    for effect in CATALOGUE.values():
        assert effect.phase in ("flight", "impact", "all")
        assert effect.summary and effect.source and effect.parameters
        for p in effect.parameters:
            assert p.low <= p.neutral <= p.high
            assert p.meaning


@pytest.mark.parametrize("name", MECHANICAL)
def test_neutral_values_are_the_same_bits(name):
    base, states = world(), falling(12)
    same = with_effect(base, name, neutral(name))
    a, b = (run(w, states, BLOCK, impact_room=8, time_limit_s=1.0) for w in (base, same))
    for field in ("stop", "ends", "impacts", "energy_J"):
        assert np.array_equal(getattr(a, field), getattr(b, field), equal_nan=True)
    one, other = (pymunk_release(w, states[0], BLOCK) for w in (base, same))
    for _ in range(400):
        one.step()
        other.step()
    assert np.array_equal(one.q, other.q)


@pytest.mark.parametrize("name", MECHANICAL)
def test_every_effect_changes_the_motion(name):
    if name == "surface_roughness":
        return  # a slope under the next impact, which is what the diagnosis asks for; see `scene.rough_ground`
    base = world(order=np.full(1, 20.0))
    a, b = (run(w, falling(12), BLOCK, time_limit_s=0.6) for w in (base, with_effect(base, name)))
    assert np.abs(a.ends[:, 1:4] - b.ends[:, 1:4]).max() > 1e-4


@pytest.mark.parametrize("name", MECHANICAL)
def test_the_energy_audit_closes_with_every_effect(name):
    """Kinetic + potential + elastic + taken stay: to 1e-6 with the reference engine's steps, 1e-4 with the batch
    engine's, of the kinetic energy and the potential above the lowest ground."""
    w = with_effect(world(order=np.full(1, 20.0)), name)
    states = falling(6, seed=9)
    initial = energies(w, states, BLOCK)  # the lowest ground lies at y = 0
    residuals = []
    for state in states[:4]:
        sim = pymunk_release(w, state, BLOCK)
        while sim.time < 0.15:
            sim.step()
        balance = sim.energy_balance()
        residuals.append(abs(balance["residual"]) / balance["initial"])
    assert np.median(residuals) < 1e-6
    # rounded corners hand contacts over, and a dashpot ceases to be held, at events that are met to second order
    assert max(residuals) < 2e-5
    result = run(w, states, BLOCK, impact_limit=1)
    flown = result.stop == 3
    residual = np.abs(result.energy_J[flown, E_RESIDUAL])
    assert residual.max() < 1e-3 * initial.max()
    assert np.median(residual) < 1e-4 * initial.max()


@pytest.mark.parametrize("name", MECHANICAL)
def test_both_engines_agree_with_every_effect(name):
    w = with_effect(world(order=np.full(1, 20.0)), name)
    block = list(w.blocks.values())[BLOCK]
    states = falling(8, seed=4)
    batch = run(w, states, BLOCK, impact_limit=1, impact_room=1, step_fraction=0.05)
    errors = []
    for i, state in enumerate(states):
        track = run_pymunk(block, w.cross_section, w.contact[0], state, impact_limit=1, time_limit_s=1.0)
        scale = np.hypot(state[3], state[4]) / np.array([1, 1, block.radius_m])
        errors.append(np.abs((batch.impacts[i, 0, VELOCITIES_AFTER] - after(track.impacts[0])) / scale).max())
    assert np.nanmedian(errors) < 3e-4
    # where a corner leaves as the next lands, an impact ends, or not
    assert np.nanmean(np.array(errors) < 1e-3) >= 0.8


def test_tables_of_the_laws_columns_alone_go_on_working():
    table, states = contact_table(LAW, SETUP.zone_names), falling(5)
    results = [
        run_batch(Ensemble(list(world().blocks.values()), [SETUP], [t]), states).ends
        for t in (table[:, :6], table, widened(table))
    ]
    assert np.array_equal(results[0], results[1])
    assert np.array_equal(results[0], results[2])
    assert table.shape[1] == FIRST_EFFECT_COLUMN < N_COLUMNS


def test_a_world_of_many_releases_has_a_table_for_each():
    base = world(order=np.arange(6.0))
    w = with_effect(base, "soil_compaction", [0.05, *neutral("soil_compaction")[1:]])
    states = np.repeat(falling(1), 6, axis=0)
    together = run(w, states, impact_limit=1).ends
    for i in range(6):
        alone = run(replace(w, contact=w.contact[i : i + 1]), states[i : i + 1], impact_limit=1).ends[0]
        assert np.array_equal(together[i], alone)
    assert w.contact[5, 0, K_L] == pytest.approx(1.25 * base.contact[0, 0, K_L])
    assert (w.contact[..., K_UL] >= w.contact[..., K_L]).all()


def test_an_embankment_is_told_by_its_shape():
    zones = np.array(SETUP.zones)
    assert list(zones[embankment_facets(SETUP)]) == ["face", "crest", "back"]
    assert list(zones[ditch_facets(SETUP)]) == ["ditch"]
    fine = SETUP.subdivided(9)
    assert set(np.array(fine.zones)[embankment_facets(fine)]) == {"face", "crest", "back"}
    assert embankment_facets(fine).sum() == 27
    assert not embankment_facets(FLOOR).any()
    assert FLOOR.embankment is None
    rough = roughened(
        type(SETUP)([[0, 10], [20, 0]], ["slope"]), {"slope": Roughness(0.1, 0.5)}, np.random.default_rng(0)
    )
    assert not embankment_facets(rough).any()
    assert facet_zones(SETUP, embankment_facets(SETUP)).tolist() == [False, False, True, True, True, False]


def test_the_facing_turns_about_its_foot_and_keeps_its_height():
    built = as_built(SETUP, 0.1, 0.0, 0.02)
    run_, rise = built.points_m[3] - built.points_m[2]
    assert np.arctan2(rise, run_) == pytest.approx(np.arctan2(0.083, 0.0519) + 0.1)
    assert np.array_equal(np.delete(built.points_m, 3, 0), np.delete(SETUP.points_m, 3, 0))
    level = as_built(SETUP, 0.0, 0.1, 0.02)
    assert level.points_m[1:3, 1] == pytest.approx(0.0083)
    # never past the crest's end
    assert as_built(SETUP, -0.6, 0.0, 0.02).points_m[3, 0] < SETUP.points_m[4, 0]


def test_ground_without_an_embankment_is_raised_and_inclined_as_a_whole():
    built = as_built(FLOOR, 0.05, 0.1, 0.02)
    slope = np.arctan2(built.tangents[:, 1], built.tangents[:, 0])
    assert slope == pytest.approx(0.05)
    assert built.points_m[[0, -1], 1].mean() == pytest.approx(0.1 * 0.02)


def test_a_roughened_surface_keeps_the_mean_one_and_has_the_slopes_asked_for():
    rng = np.random.default_rng(3)
    rough = roughened(FLOOR, {zone: Roughness(0.2, 0.05) for zone in FLOOR.zones}, rng)
    slopes = np.arctan2(rough.tangents[:, 1], rough.tangents[:, 0])
    assert np.std(slopes) == pytest.approx(0.2, rel=0.06)
    assert np.abs(rough.points_m[:, 1]).max() < 0.05
    assert np.mean(slopes) == pytest.approx(0.0, abs=1e-6)


NEW_EFFECT = '''
"""A constant pull of the ground: the effect of a user."""

from rock2d.compiled import kernel
from rock2d.effects.changes import with_column
from rock2d.effects.effect import Effect, Parameter


@kernel
def normal(strength, depth, rate, peak, bottom, force_n):
    """F = strength × depth in N."""
    return strength * depth if depth >= bottom else 0.0


EFFECT = Effect(
    name="a_stiffer_spring", summary="beside the law's", source="a test", phase="impact", origin="impact law",
    parameters=(Parameter("strength_N_m", "N/m", 0.0, 0.0, 1e4, "of the spring"),),
    apply=lambda world, values: with_column(world, "stiffer_N_m", values[0]),
    columns=("stiffer_N_m",), normal=normal,
)
'''
USE = """
import numpy as np
from rock2d.laws.contact import ContactParameters
from rock2d.effects import catalogue, forces
from rock2d.effects.columns import ANY_EFFECT_ACTS, FIRST_EFFECT_COLUMN, column, engine_rows, widened

row = widened(ContactParameters().row())
row[column("stiffer_N_m")] = 3e4
row = engine_rows(row)
depth, rate, slip, peak, bottom, force_n = 1e-3, 0.5, 0.1, 1e-3, 8e-4, 10.0
whole, factor, drag = forces.ground_forces(row, FIRST_EFFECT_COLUMN, (depth, rate, slip, peak, bottom), force_n)
hits = forces.ground_forces.whole.stats.cache_hits
print(whole, factor, drag, row[ANY_EFFECT_ACTS], len(catalogue()), sum(hits.values()))
"""


def test_adding_an_effect_is_adding_a_file(tmp_path):
    """In a copy of the package with one more file what the engines call runs the new law, beside all the others, and a
    second process finds it compiled."""
    package = tmp_path / "rock2d"
    shutil.copytree(Path(rock2d.__file__).parent, package, ignore=shutil.ignore_patterns("__pycache__", "diagnosis"))
    (package / "effects" / "a_stiffer_spring.py").write_text(NEW_EFFECT)
    env = {**os.environ, "PYTHONPATH": str(tmp_path), "XDG_CACHE_HOME": str(tmp_path / "cache")}
    env.pop("NUMBA_CACHE_DIR", None)
    for hits in (0, 1):
        done = subprocess.run([sys.executable, "-c", USE], capture_output=True, text=True, env=env, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        assert np.array(done.stdout.split(), float) == pytest.approx([40.0, 1.0, 0.0, 1.0, len(CATALOGUE) + 1, hits])


def test_typical_values_lie_in_their_ranges():
    for name, effect in CATALOGUE.items():
        for value, p in zip(typical(name), effect.parameters, strict=True):
            assert p.low <= value <= p.high


def _same_world(a: World, b: World) -> bool:
    poses = np.array([[0.1, 0.2, 0.3], [-0.4, 0.5, -1.0]])
    return (
        np.allclose(a.view.record(poses), b.view.record(poses), atol=1e-12)
        and a.view.time_scale == b.view.time_scale
        and np.allclose(np.nan_to_num(a.contact), np.nan_to_num(b.contact))
        and np.allclose(a.cross_section.points_m, b.cross_section.points_m)
        and np.array_equal(a.slope_rad, b.slope_rad)
        and all(
            replace(mine, air=()) == replace(yours, air=()) and sum(mine.air or ()) == sum(yours.air or ())
            for mine, yours in zip(a.blocks.values(), b.blocks.values(), strict=True)
        )
    )


@pytest.mark.parametrize("name", CATALOGUE)
def test_an_effect_without_size_changes_nothing_beside_any_other_effect(name):
    for other in CATALOGUE.values():
        if other.name == name:
            continue
        there = with_effect(replace(world(), order=np.arange(3.0)), other.name)
        beside = with_effect(there, name, neutral(name))
        if CATALOGUE[name].columns:  # a law that does not act may have its columns
            beside = replace(beside, contact=beside.contact[..., : there.contact.shape[-1]])
        assert _same_world(there, beside), f"{name} beside {other.name}"


def test_an_eccentric_mass_keeps_the_moment_of_inertia_about_the_centroid():
    """I₀ = I + m r_c² (Steiner): a density that grows to one side leaves I₀ alone. A block far smaller than the others
    keeps a positive I."""
    base = world()
    moved = CATALOGUE["mass_eccentricity"].apply(base, (0.1, -0.05))
    for name, block in moved.blocks.items():
        arm = np.hypot(*block.centre_of_mass_m)
        assert arm == pytest.approx(np.hypot(0.1, 0.05) * base.mean_size_m)
        stated = base.blocks[name].inertia_kg_m2
        assert block.inertia_kg_m2 + block.mass_kg * arm**2 == pytest.approx(stated)
    small = replace(base.blocks["cube"], inertia_kg_m2=1e-3 * base.blocks["cube"].inertia_kg_m2)
    tiny = CATALOGUE["mass_eccentricity"].apply(replace(base, blocks={"cube": small}), (0.15, 0.15))
    assert 0.0 < tiny.blocks["cube"].inertia_kg_m2 < small.inertia_kg_m2


def test_an_effect_without_its_refinement_is_the_effect_with_a_neutral_one():
    refined = {name: effect for name, effect in CATALOGUE.items() if any(q.optional for q in effect.parameters)}
    assert "scale_error" in refined
    for effect in refined.values():
        plain, values = effect.without_refinement(), {q.name: 0.7 * q.high + 0.3 * q.neutral for q in effect.parameters}
        whole = [q.neutral if q.optional else values[q.name] for q in effect.parameters]
        expected, found = (
            own.apply(world(), v) for own, v in ((effect, whole), (plain, [values[q.name] for q in plain.parameters]))
        )
        assert found.view == expected.view and (found.contact == expected.contact).all()
        assert len(plain.parameters) < len(effect.parameters)
    assert all(CATALOGUE[name].without_refinement() is CATALOGUE[name] for name in CATALOGUE.keys() - refined)
