"""Check of a set-up file against the experiment that was tracked with it."""

from __future__ import annotations

from rock2d.errors import InputError
from rock2d.files.experiment import Experiment
from rock2d_tracking.setup_file import Setup
from rock2d_tracking.tracked_film import film_of


def check_sanity(experiment: Experiment, setup: Setup, *, guessed: bool = False) -> list[str]:
    """Remarks on an experiment. Raises InputError if frame rate, scale or axes must be wrong. `guessed`: whether the
    ground is a guess; it is then not checked."""
    from rock2d.kinematics.sanity import ABOVE_GROUND, FEW_RELEASES, check_film

    sanity = check_film(experiment, film_of(experiment, setup))
    harmless = {FEW_RELEASES, ABOVE_GROUND} if guessed else {FEW_RELEASES}
    wrong = [fault.message for fault in sanity.faults if fault.code not in harmless]
    if wrong:
        raise InputError("; ".join(wrong), setup.path)
    if sanity.mirror:
        raise InputError(
            f"seen with {sanity.mirror} mirrored, blocks would fall and stay above the ground: "
            "is the film upside down (camera: up), or was it filmed from behind?",
            setup.path,
        )
    if sanity.registered is not None:
        raise InputError(sanity.remarks[-1], setup.path)
    return sanity.remarks
