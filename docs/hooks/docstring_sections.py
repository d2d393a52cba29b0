"""Griffe extension: entries "name : meaning" of docstrings are shown as a meaning, not as a type."""

from __future__ import annotations

import re
from typing import Any

from griffe import Extension

HEAD = re.compile(r"^(?P<indent> *)(?P<names>[A-Za-z_*][\w, *]*?) : (?P<rest>.+)$")
TYPE_WORDS = {
    "str", "int", "float", "bool", "path", "dict", "list", "tuple", "array", "mapping", "callable", "optional", "or",
    "of", "to", "one", "them", "zone", "names", "None",
}  # fmt: skip
UNDERLINE = re.compile(r"^\s*-{3,}$")
RAISES = re.compile(r"^(?:It r|R)aises `?(\w+)`? (.*)$")


def is_type(text: str) -> bool:
    """If what stands behind the colon is a type, as `int, optional` or `Block`, and no meaning."""
    bare = re.sub(r"\{[^}]*\}|\([^)]*\)|\[[^\]]*\]", " ", text)
    words = re.findall(r"[\w.]+", bare)
    return all(word in TYPE_WORDS or re.fullmatch(r"([a-z]\w*\.)*[A-Z]\w*", word) for word in words)


def meanings_below(text: str) -> str:
    """The docstring with every meaning on the line below its name."""
    out: list[str] = []
    inside = False
    for line in text.split("\n"):
        if UNDERLINE.match(line):
            inside = True
        raises = RAISES.match(line) if inside else None
        if raises:  # a paragraph below a section: it would count as an entry of that section
            out += ["Raises", "------", raises[1], f"    {raises[2]}"]
            continue
        found = HEAD.match(line) if inside else None
        if found and not found["indent"] and not is_type(found["rest"]):
            out += [found["names"], f"    {found['rest']}"]
        else:
            out.append(line)
    return "\n".join(out)


class MeaningsBelow(Extension):
    """Rewrites every docstring before it is parsed."""

    def on_object(self, *, obj: Any, **_: Any) -> None:
        """Called for each module, class, function and attribute."""
        if obj.docstring is not None:
            obj.docstring.value = meanings_below(obj.docstring.value)
