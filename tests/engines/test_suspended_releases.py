"""A release that is suspended on its way and goes on with the memory of its contacts is the whole release."""

import numpy as np
import pytest

from rock2d.design.shared_descents import OVERSHOOT_RADII
from rock2d.engines.batch import BATCH_STEP_FRACTION, BatchResult, run_batch
from rock2d.engines.energy_balance import unclosed
from rock2d.laws.contact import ContactParameters
from rock2d.records.columns import E_ELASTIC, INSTANT_STATE, INSTANT_VX, INSTANT_X, STOP_REACHED, STOPS, TIME
from rock2d.scene.blocks import make_block
from rock2d.scene.cross_section import CrossSection
from tests.laboratory import ensemble

GROUND = CrossSection(
    [[-2, 20], [20, 5], [60, 1]], ["slope", "run_out"], {"gate": [[25, 0], [25, 20]], "far": [[40, 0], [40, 20]]}
)
SOIL = ContactParameters(4e6, 2.4e7, 1e6, 30.0, 4e3, rolling_cap=True)
BLOCKS = {
    "ball": make_block("ball", "circle", mass_kg=305, diameter_m=0.6, inertia="solid_sphere"),
    "slab": make_block("slab", "rectangle", mass_kg=600, length_m=1.0, height_m=0.5),
}
ENSEMBLES = {name: ensemble(block, GROUND, SOIL) for name, block in BLOCKS.items()}
SUSPEND_X_M, LIMIT_S = 15.0, 60.0


def starts(n: int) -> np.ndarray:
    rng = np.random.default_rng(4)
    ranges = ((0, 2), (19.5, 22), (-3, 3), (1, 4))
    return np.column_stack([*(rng.uniform(low, high, n) for low, high in ranges), np.zeros((n, 2))])


def whole_and_suspended(name: str, n: int = 200) -> tuple[BatchResult, BatchResult, BatchResult]:
    whole = run_batch(ENSEMBLES[name], starts(n), time_limit_s=LIMIT_S)
    first = run_batch(ENSEMBLES[name], starts(n), time_limit_s=LIMIT_S, suspend_x_m=SUSPEND_X_M)
    on = first.stop == STOP_REACHED
    rest = run_batch(
        ENSEMBLES[name],
        first.ends[on, INSTANT_STATE],
        time_limit_s=LIMIT_S - first.ends[on, TIME],
        saved_contacts=first.saved_contacts[on],
    )
    return whole, first, rest


@pytest.mark.parametrize("name", BLOCKS)
def test_it_goes_on_as_if_it_had_not_been_held(name):
    """Steps fall elsewhere: nine of ten speeds at the next line change by less than a thousandth of the speed, and by
    less than half the step changes the median."""
    whole, first, rest = whole_and_suspended(name)
    on = first.stop == STOP_REACHED
    assert on.mean() > 0.9
    x = first.ends[on, INSTANT_X]
    assert (x < SUSPEND_X_M + OVERSHOOT_RADII * BLOCKS[name].radius_m).all()
    now, then = rest.crossings[:, 0].copy(), whole.crossings[on, 0]
    now[:, TIME] += first.ends[on, TIME]
    assert np.array_equal(np.isfinite(now[:, TIME]), np.isfinite(then[:, TIME]))
    fine = run_batch(ENSEMBLES[name], starts(200), time_limit_s=LIMIT_S, step_fraction=0.5 * BATCH_STEP_FRACTION)
    apart, of_a_step = (np.abs(found[:, INSTANT_VX] - then[:, INSTANT_VX]) for found in (now, fine.crossings[on, 0]))
    most = np.nanpercentile(apart, 90)
    assert most < 1e-3 * np.nanmedian(then[:, INSTANT_VX])
    assert most < np.nanmedian(of_a_step)
    assert [np.mean(whole.stop[on] == k) for k in range(len(STOPS))] == pytest.approx(
        [np.mean(rest.stop == k) for k in range(len(STOPS))], abs=0.02
    )


@pytest.mark.parametrize("name", BLOCKS)
def test_both_parts_of_its_way_keep_their_energy(name):
    """Some are suspended while springs are pressed: what they store is given back in the second part."""
    _, first, rest = whole_and_suspended(name)
    assert not unclosed(first.energy_J).any() and not unclosed(rest.energy_J).any()
    on = first.stop == STOP_REACHED
    pressed = first.energy_J[on, E_ELASTIC] > 0.0
    assert pressed.any()


def test_a_release_that_begins_beyond_is_held_at_once():
    found = run_batch(ENSEMBLES["ball"], starts(3), suspend_x_m=-1.0)
    assert (found.stop == STOP_REACHED).all() and (found.ends[:, TIME] == 0.0).all()
    assert np.array_equal(found.ends[:, INSTANT_STATE], starts(3))
