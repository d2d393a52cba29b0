"""Short loops of commands, each on the files of the commands before; `tests.hunt.loops` has the long ones."""

import pytest

from tests.hunt.loop_cases import named
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
