"""Pages hold their figures, and text from files cannot become markup."""

import base64
import io
from pathlib import Path

import numpy as np
from PIL import Image

from rock2d.graphics import pages
from rock2d.graphics.figure_style import save_figure
from rock2d.graphics.pages import Picture, Section, Table, blank_axes, drawn, embedded, embedded_picture, page
from rock2d.graphics.rendering import PERCENT_IN_TEXT


def test_text_is_escaped_and_what_stands_in_backticks_is_code():
    table = Table(("<h>", "x"), [("<i>", "&")])
    section = Section("<u>", ["a `<tt>` b"], ["<script>"], "<v>.webm", tables=[table])
    shown = page("a <b>", [section])
    assert "<title>a &lt;b&gt;</title>" in shown and "<h2>&lt;u&gt;</h2>" in shown
    assert "<td>&lt;i&gt;</td><td>&amp;</td>" in shown and "<th>&lt;h&gt;</th>" in shown
    assert "<script" not in shown and "<li>&lt;script&gt;</li>" in shown
    assert "<p>a <code>&lt;tt&gt;</code> b</p>" in shown and 'src="&lt;v&gt;.webm"' in shown


def test_no_line_breaks_before_a_percent_sign():
    section = Section("58 %", ["2 [1, 3] %, in % of"], pictures=[Picture("a.png", "5 %")])
    shown = page("a", [section])
    assert "<h2>58\N{NO-BREAK SPACE}%</h2>" in shown and "<p>2 [1, 3]\N{NO-BREAK SPACE}%, in % of</p>" in shown
    assert 'alt="5 %"' in shown  # what is no text of the page stays as it is
    copied = "<pre><b>5 %</b></pre><script>5 %</script>"
    assert PERCENT_IN_TEXT.sub(r"\1", copied) == copied


def test_what_a_section_does_not_have_is_left_out():
    shown = page("a", [Section()])
    assert not any(f"<{tag}" in shown for tag in ("h2", "p", "ul", "table", "video", "figure"))


def test_pages_fit_the_width_of_a_phone():
    assert '<meta name="viewport" content="width=device-width' in page("a", [])


def test_figures_are_inside_the_page():
    figure, (left, right) = blank_axes(3.0, 2.0, columns=2)
    left.plot([0, 1])
    assert not right.spines["top"].get_visible()
    kind, data = embedded(figure).split(",")
    assert kind == "data:image/png;base64" and base64.b64decode(data).startswith(b"\x89PNG")
    assert embedded(figure, "svg") == embedded(figure, "svg")
    assert "data:image/svg+xml" in page("a", [Section("title", pictures=[drawn(figure, "words", "svg")])])


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


def test_scripts_have_one_place_for_the_digits_of_a_number():
    """There, no zero has a minus."""
    scripts = sorted(Path(pages.__file__).parent.glob("*.js"))
    assert [path.name for path in scripts if ".toFixed(" in path.read_text(encoding="utf-8")] == ["live.js"]
