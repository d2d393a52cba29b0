"""diagnosis.json as a prediction reads it: with learnt changes of quantities that this version knows."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from rock2d.diagnosis.learnt_prediction import read_changes
from rock2d.diagnosis.levers import LEVER_QUANTITIES, LEVER_SIZES
from rock2d.errors import InputError
from rock2d.files.checked_yaml import Document, key_shown
from rock2d.files.diagnosis import read_model
from rock2d.files.fitted_keys import ChangeKeys


def read_for_prediction(path: str | Path) -> dict[str, Any]:
    """Content of diagnosis.json, checked for what a prediction needs.

    Raises InputError if it cannot be used; warns if it has keys with old names.
    """
    document, read = read_model(path)
    if read.model is not None and read.model.learnt is not None:
        for i, change in enumerate(read.model.learnt.changes):
            _check_change(document, i, change)
    return read.content()


def _check_change(document: Document, i: int, change: ChangeKeys) -> None:
    """Refuse a learnt change whose coefficients do not fit its curves, or whose quantities its lever does not have."""

    def wrong(message: str, *place: str | int, **fields: Any) -> InputError:
        return document.error(message, "model", "learnt", "changes", i, *place, **fields)

    for k, curve in enumerate(change.curves):
        if curve.quantity not in LEVER_QUANTITIES[change.lever]:
            message = f"no quantity {key_shown(curve.quantity)}"
            raise wrong(message, "curves", k, "quantity", code="unknown_name", name=curve.quantity)
    given = read_changes([change.model_dump()])[0]
    try:
        functions = given.basis.features(
            {c.quantity: np.zeros(1) for c in change.curves} or {"": np.zeros(1)}
        )
    except ValueError:
        raise wrong("breakpoints of a spline must rise", "curves") from None
    widths = {len(row) for row in change.coefficients}
    if widths != {functions.shape[1]} or len(change.coefficients) not in LEVER_SIZES[change.lever]:
        raise wrong("coefficients do not fit the curves", "coefficients")
