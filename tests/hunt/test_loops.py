"""Short loops of commands, each on the files of the commands before; `tests.hunt.loops` has the long ones."""

import pytest

from tests.hunt.loop_cases import QUIRKS, named, random_loop
from tests.hunt.loops import REFUSED, WHOLE, gone

# a film with noise through every command; an export and its import, with a refusal that is true; a survey to its dam
LOOPS = {
    "run/flat_floor/batch/6/1/plain": WHOLE,
    "import/flat_floor:tracker/batch/6/1/one_release": REFUSED,
    "profile/table/point_mass/6/1/plain": WHOLE,
}


@pytest.mark.parametrize("name", LOOPS)
def test_a_loop_goes_to_its_last_command(name, tmp_path):
    outcome = gone(named(name), tmp_path.resolve())
    assert not outcome.faults, outcome.faults
    assert outcome.what == LOOPS[name], outcome.refusal


def test_a_loop_is_made_again_by_its_name_and_smaller_ones_have_less():
    loops = [random_loop(7, number) for number in range(40)]
    assert loops == [named(loop.name) for loop in loops]
    assert {quirk for loop in loops for quirk in loop.quirks} == set(QUIRKS)
    for loop in loops:
        for fewer in loop.smaller():
            assert len(fewer.quirks) <= len(loop.quirks) and fewer != loop
