"""Table 3: the probabilistic model's parameters, the paper's and this calibration's."""

from __future__ import annotations

import numpy as np
import pandas as pd

from rock2d.reproduction import published, summary
from rock2d.reproduction.hypotheses import PROBABILISTIC_SPACE, REBOUND
from rock2d.reproduction.results import Results
from rock2d.reproduction.stages import REDUCTIONS_DEG


def table(results: Results) -> pd.DataFrame:
    """Paper's value, posterior and what was learnt, one row a parameter; slope reductions last."""
    found = summary.identified_table(PROBABILISTIC_SPACE, results.samples["probabilistic"].u, REBOUND)
    found.insert(1, "paper", [published.REBOUND[name] for name in found["quantity"]])
    rows = []
    for block, alpha in results.reduction_deg.items():
        if block == "sphere":
            continue
        low, middle, high = np.percentile(alpha, [2.5, 50.0, 97.5])
        spread = float(np.std(REDUCTIONS_DEG))
        rows.append(
            {
                "quantity": f"{block}.slope_reduction_deg", "paper": published.SLOPE_REDUCTION_DEG[block],
                "prior_low": REDUCTIONS_DEG[0], "prior_high": REDUCTIONS_DEG[-1], "low95": low, "median": middle,
                "high95": high, "sd_over_prior_sd": float(alpha.std() / spread),
                "prior": "from the block's own cells alone",
            }
        )  # fmt: skip
    return pd.concat([found, pd.DataFrame(rows)], ignore_index=True)
