"""The page of a score: complete, and without markup from the files of a trial."""

from __future__ import annotations

import pandas as pd

from rock2d.blind.page import write_page
from rock2d.blind.scoring import summary


def test_labels_cannot_become_markup(tmp_path):
    row = {"case": "<i>0", "label": "<b>$x^$", "verdict": "<script>", "p": 0.9, "right": False, "top3": False,
           "p_truth": 0.1, "p_none": 0.0, "p_unknown": 0.0, "brier": 1.0, "signal_to_noise": 20.0, "releases": 30,
           "noise": 0.01, "diagnosed": True, "phase": "flight", "phases": "flight", "closure": 0.1,
           "runner_up": 0.1, "regression_closure": 0.1, "heldout_base": 1.0, "heldout_diagnosed": 1.0,
           "seconds": 1.0}  # fmt: skip
    cases = pd.DataFrame([row, row | {"case": "001"}])
    pair = {
        "label": "<b>$x^$",
        "verdict": "<script>",
        "count": 2,
        "cosine": None,
        "median_signal_to_noise": 20.0,
    }
    write_page(cases, summary(cases) | {"confused": [pair]}, "0" * 64, tmp_path / "score.html")
    page = (tmp_path / "score.html").read_text(encoding="utf-8")
    assert not any(tag in page for tag in ("<script", "<i>", "<b>"))
    assert all(text in page for text in ("&lt;script&gt;", "&lt;i&gt;", "&lt;b&gt;"))
    assert page.count("<img ") == 5
