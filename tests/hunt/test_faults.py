"""A small share of the fault hunt: what a run leaves when it is interrupted or cannot write."""

import pytest

from tests.hunt.fault_commands import COMMANDS, write_scenarios
from tests.hunt.faults import Whole, disturbed, undisturbed

RUN = next(command for command in COMMANDS if command.name == "run point_mass")


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> Whole:
    """An undisturbed run; it also compiles what the others need."""
    write_scenarios(tmp_path_factory.getbasetemp() / "inputs")
    return undisturbed(RUN, tmp_path_factory.getbasetemp() / "inputs", tmp_path_factory.mktemp("whole"))


@pytest.mark.parametrize("fault", ["kill", "interrupt", "terminate", "full disk", "file too large", "read-only"])
def test_a_disturbed_run_leaves_nothing_half_written(tmp_path, tmp_path_factory, whole, fault):
    trial = disturbed(RUN, fault, tmp_path_factory.getbasetemp() / "inputs", tmp_path, whole, 0.6)
    assert not trial.faults
    if trial.skipped == "may not mount":
        pytest.skip(trial.skipped)
