"""Whole releases of the batch engine make no energy, on ground where each mistake of a step would show."""

import numpy as np
import pytest

from rock2d.engines.batch import BATCH_STEP_FRACTION, Ensemble, run_batch
from rock2d.engines.energy_balance import Masses, mechanical_energy, unclosed
from rock2d.laws.contact import ContactParameters, contact_table
from rock2d.records.columns import AFTER, BEFORE, E_CORRECTED, E_INITIAL, N_STATE, STOP_BURIED, STOP_REST
from rock2d.scene.blocks import make_block
from rock2d.scene.cross_section import CrossSection
from tests.laboratory import BLOCKS, LAW, SETUP, ensemble

GRAVITY_M_S2 = 9.81
FLOOR = CrossSection([[-20, 0], [20, 0]], ["floor"])
SLAB = make_block("slab", "rectangle", 2.0, "uniform", length_m=0.2, height_m=0.14)
BALL = make_block("ball", "circle", 2.3, "uniform", diameter_m=0.1)
EGG = make_block("egg", "ellipse", 2.3, "uniform", length_m=0.12, height_m=0.07)
ELASTIC = {"k_l_N_m": 5e5, "k_ul_N_m": 5e5, "k_t_N_m": 3e5, "k_r_Nm_rad": 0.0}


def thrown(n: int, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.column_stack(
        [np.zeros(n), np.full(n, 0.3), rng.uniform(-3, 3, n), rng.normal(0, 1, n), rng.normal(-1, 1, n),
         rng.normal(0, 10, n)]
    )  # fmt: skip


@pytest.mark.parametrize("friction_deg", [43.0, 90.0])
def test_elastic_ground_gives_back_no_more_than_it_took(friction_deg):
    """Nothing but friction takes energy: whatever a spring holds at lift-off, or a step errs by, shows at once."""
    law = ContactParameters(**ELASTIC, friction_angle_deg=friction_deg)
    result = run_batch(ensemble(SLAB, FLOOR, law), thrown(60, 3), impact_room=40)
    assert not unclosed(result.energy_J).any()
    masses = Masses(SLAB.mass_kg, SLAB.inertia_kg_m2, GRAVITY_M_S2, 0.0)
    seen = result.impacts[np.isfinite(result.impacts[..., AFTER]).all(axis=-1)]
    before, after = (mechanical_energy(masses, seen[:, part].reshape(-1, N_STATE)) for part in (BEFORE, AFTER))
    gain = (sum(after) - sum(before)) / before[0]
    assert len(gain) > 300
    assert gain.max() < 1e-6


@pytest.mark.parametrize("block", [BALL, EGG], ids=lambda block: block.name)
def test_blocks_on_ground_that_unloads_forty_times_as_stiff_keep_their_balance(block):
    """A contact that turns back where it is deepest needs the step of unloading, not the longer one of loading."""
    law = ContactParameters(2e4, 8e5, 1e4, 35.0, 0.5)
    result = run_batch(ensemble(block, FLOOR, law), thrown(300, 5))
    assert not unclosed(result.energy_J).any()


@pytest.mark.parametrize("name", BLOCKS)
def test_a_release_does_not_depend_on_its_companions(name):
    """To the last bit, whatever the size of the blocks and the number of zones beside it."""
    large = make_block("large", "square", 900.0, "uniform", side_m=2.0)
    slope = CrossSection([[-0.3, 0.11], [1.7, -0.69]], ["slope"])
    table, other = contact_table(LAW, slope.zone_names), contact_table(LAW, SETUP.zone_names)
    start = thrown(20, 4) * [0.3, 1.0, 1.0, 1.0, 1.0, 3.0]
    alone = run_batch(ensemble(BLOCKS[name], slope), start)
    states = np.concatenate([start, [[0.0, 3.0, 0.1, 1.0, 0.0, 2.0]]])
    ids = np.array([1] * len(start) + [0])
    both = run_batch(
        Ensemble([large, BLOCKS[name]], [SETUP, slope], [other, table]), states, block_ids=ids,
        cross_section_ids=ids, table_ids=ids,
    )  # fmt: skip
    assert np.array_equal(alone.ends, both.ends[:-1])
    assert np.array_equal(alone.energy_J, both.energy_J[:-1])


@pytest.mark.parametrize("name", BLOCKS)
def test_what_steps_are_corrected_by_is_their_truncation_error(name):
    """The audit closes by this correction. It is of fourth order: half the step leaves a sixteenth of it, and a quarter
    of the default step less than 1e-6 of the initial energy."""
    own = ensemble(BLOCKS[name])
    corrected = []
    for part in (1.0, 0.5, 0.25):
        energy = run_batch(own, thrown(60, 3), step_fraction=part * BATCH_STEP_FRACTION).energy_J
        corrected.append(np.median(energy[:, E_CORRECTED] / energy[:, E_INITIAL]))
    assert corrected[0] / corrected[1] > 8.0 and corrected[1] / corrected[2] > 8.0
    assert corrected[0] < 1e-4 and corrected[2] < 1e-6


def test_no_ellipse_passes_through_a_spike():
    """Thin ellipses come down on a narrow ridge that they swallow to their middle: none ends below the ground."""
    ridge = CrossSection([[-2.0, -0.4], [-0.1, -0.05], [0.0, 0.0], [0.1, -0.05], [2.0, -0.4]], ["g"] * 4)
    thin = make_block("thin", "ellipse", 1.0, "uniform", length_m=0.08, height_m=0.028)
    law = ContactParameters(2e3, 1.5e4, 0.0, 25.0, 0.0)
    rng = np.random.default_rng(8)
    n = 200
    start = np.column_stack(
        [rng.normal(0, 0.02, n), np.full(n, 0.06), rng.uniform(-3, 3, n), rng.normal(0, 0.2, n),
         rng.normal(-1.5, 0.5, n), rng.normal(0, 30, n)]
    )  # fmt: skip
    result = run_batch(ensemble(thin, ridge, law), start)
    inside = ridge.covers(result.ends[:, 1:3])
    assert (result.stop[inside] == STOP_BURIED).all()
    assert (result.stop == STOP_REST).sum() + (result.stop == STOP_BURIED).sum() > 0
    assert not unclosed(result.energy_J).any()


@pytest.mark.parametrize("names", [("soft", "hard"), ("hard", "soft")])
def test_a_contact_that_begins_at_a_vertex_belongs_to_the_facet_before_it(names):
    """Whatever the order in which the zones are named, and whatever zone an earlier contact had."""
    zones = [names[1], names[0], names[1]]
    ridge = CrossSection([[-2.0, -1.0], [-1.0, -0.5], [0.0, 0.0], [1.0, -0.5]], zones)
    laws = {"soft": ContactParameters(1e3, 1e5, 0.0, 0.0, 0.0), "hard": ContactParameters(1e5, 1e5, 0.0, 0.0, 0.0)}
    # upright on the ridge: e = 1 on hard ground and 0.1 on soft ground
    result = run_batch(
        ensemble(SLAB, ridge, laws),
        np.array([0.0, 0.0701, 0.0, 0.0, -1.0, 0.0]), gravity_m_s2=0.0, impact_limit=1, impact_room=1,
    )  # fmt: skip
    expected = 1.0 if names[0] == "hard" else 0.1
    assert result.ends[0, 5] == pytest.approx(expected, rel=1e-3)
