"""MkDocs hook: equations become MathML while the documentation is built, so that a browser needs no script for them."""

from __future__ import annotations

import html
import re
from typing import Any

INLINE = re.compile(r'<span class="arithmatex">\\\((.*?)\\\)</span>', re.DOTALL)
BLOCK = re.compile(r'<div class="arithmatex">\s*\\\[(.*?)\\\]\s*</div>', re.DOTALL)


def on_page_content(content: str, **_: Any) -> str:
    """The page with every equation as MathML."""
    from latex2mathml.converter import convert

    def mathml(tex: str, display: str) -> str:
        return convert(html.unescape(tex).strip(), display=display)

    content = BLOCK.sub(lambda found: mathml(found[1], "block"), content)
    return INLINE.sub(lambda found: mathml(found[1], "inline"), content)
