"""The page of a score: complete, and without markup from the files of a trial."""

from rock2d.blind.page import write_page
from rock2d.blind.scoring import scored_case, summary
from tests.blind.test_scoring import TRIAL


def test_labels_cannot_become_markup(tmp_path):
    label, result = TRIAL["000"]
    cause = result["diagnosis"]["causes"][0] | {"effect": "<script>", "p": 0.95}
    result = result | {"diagnosis": result["diagnosis"] | {"causes": [cause]}}
    cases = [scored_case("<i>0", label, result), scored_case("1", label | {"base": "<b>$x^$"}, result)]
    write_page(cases, summary(cases), "0" * 64, tmp_path / "score.html")
    page = (tmp_path / "score.html").read_text(encoding="utf-8")
    assert not any(tag in page for tag in ("<script", "<i>", "<b>"))
    assert all(text in page for text in ("&lt;script&gt;", "&lt;i&gt;", "&lt;b&gt;"))
