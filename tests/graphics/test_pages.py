"""Pages hold their figures, and text from files cannot become markup."""

from __future__ import annotations

import base64

from rock2d.graphics.pages import blank_axes, embedded, html_figure, html_list, html_page, html_table


def test_text_is_escaped():
    page = html_page("a <b>", html_table([("<i>", "&")], head=("<h>", "x")) + html_list(["<script>"]))
    assert "<title>a &lt;b&gt;</title>" in page
    assert "<td>&lt;i&gt;</td><td>&amp;</td>" in page and "<th>&lt;h&gt;</th>" in page
    assert "<script" not in page and "<li>&lt;script&gt;</li>" in page


def test_pages_fit_the_width_of_a_phone():
    assert "<meta name='viewport' content='width=device-width" in html_page("a", "b")


def test_figures_are_inside_the_page():
    figure, (left, right) = blank_axes(3.0, 2.0, columns=2)
    left.plot([0, 1])
    assert not right.spines["top"].get_visible()
    kind, data = embedded(figure).split(",")
    assert kind == "data:image/png;base64" and base64.b64decode(data).startswith(b"\x89PNG")
    assert embedded(figure, "svg") == embedded(figure, "svg")
    shown = html_figure("it's <1>", figure, "text & more", image_format="svg")
    assert "<h2>it&#x27;s &lt;1&gt;</h2><p>text &amp; more</p>" in shown and "image/svg+xml" in shown
