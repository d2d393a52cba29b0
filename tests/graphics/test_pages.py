"""Pages hold their figures, and text from files cannot become markup."""

from __future__ import annotations

import base64
import io

import numpy as np
from PIL import Image

from rock2d.graphics.figure_style import save_figure
from rock2d.graphics.pages import (
    blank_axes,
    embedded,
    embedded_picture,
    html_figure,
    html_list,
    html_page,
    html_table,
)


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


def test_a_figure_from_its_file_is_the_figure_drawn_for_the_page(tmp_path):
    figure, (axis,) = blank_axes(3.0, 2.0)
    axis.fill_between([0, 1], [0, 1])
    found = embedded_picture(save_figure(figure, tmp_path / "figure.png"))
    drawn, reduced = (
        np.asarray(Image.open(io.BytesIO(base64.b64decode(uri.split(",")[1]))).convert("L"), float)
        for uri in (embedded(figure), found)
    )
    assert drawn.shape == reduced.shape == (220, 330)
    coarse = [grey.reshape(22, 10, 33, 10).mean(axis=(1, 3)) for grey in (drawn, reduced)]
    assert np.corrcoef(coarse[0].ravel(), coarse[1].ravel())[0, 1] > 0.95  # the layout may lie a pixel beside
