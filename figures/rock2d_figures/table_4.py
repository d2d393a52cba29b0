"""Table 4: the deterministic model's parameters, the paper's and this calibration's."""

from __future__ import annotations

import numpy as np
import pandas as pd

from rock2d.reproduction import published, summary
from rock2d.reproduction.hypotheses import CONTACT, DETERMINISTIC_SPACE
from rock2d.reproduction.results import Results


def table(results: Results) -> pd.DataFrame:
    """Paper's value, posterior and what was learnt, one row a parameter; k_ul follows from k_l and the restitution."""
    found = summary.identified_table(DETERMINISTIC_SPACE, results.samples["deterministic"].u, CONTACT)
    theirs = {
        **published.CONTACT,
        "restitution": float(np.sqrt(published.CONTACT["k_l_N_m"] / published.CONTACT["k_ul_N_m"])),
    }
    found.insert(1, "paper", [theirs[name] for name in found["quantity"]])
    values = results.values("deterministic")
    low, middle, high = np.percentile(values["k_l_N_m"] / values["restitution"] ** 2, [2.5, 50.0, 97.5])
    row = {
        "quantity": "k_ul_N_m", "paper": theirs["k_ul_N_m"], "low95": low, "median": middle, "high95": high,
        "prior": "k_l over the restitution squared",
    }  # fmt: skip
    return pd.concat([found, pd.DataFrame([row])], ignore_index=True)
