"""Pages from templates with a common style, and the date, version and command that they state."""

from __future__ import annotations

import base64
import hashlib
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.resources import files
from typing import TYPE_CHECKING, Any

from rock2d.errors import InputError
from rock2d.wording import percent, sentence, spoken

if TYPE_CHECKING:
    from markupsafe import Markup

DATE_VARIABLE = "SOURCE_DATE_EPOCH"  # seconds since 1970; set it to get identical pages at every run
# the space before a percent sign, where no line breaks; group 1: what stays as it is, tags, and texts to copy or to run
PERCENT_IN_TEXT = re.compile(r"(<(script|style|pre)\b.*?</\2>|<[^>]*>)|(?<=[\d\])]) %", re.DOTALL)


@dataclass(frozen=True)
class Made:
    """When and how a page was made; `seed` says the seed and what it is for, None without random numbers."""

    date: str
    version: str
    command: str
    seed: str | None

    @classmethod
    def now(cls, command: str, seed: str | None) -> Made:
        """With this version of rock2d, at `page_date()`."""
        from rock2d.version import __version__

        return cls(page_date(), __version__, command, seed)


def page_date() -> str:
    """The present time in UTC, or the time in SOURCE_DATE_EPOCH if that is set.

    Raises InputError if SOURCE_DATE_EPOCH is not a whole number of seconds."""
    stated = os.environ.get(DATE_VARIABLE)
    try:
        instant = datetime.now(UTC) if stated is None else datetime.fromtimestamp(int(stated), UTC)
    except (ValueError, OverflowError, OSError):
        message = f"expected whole seconds since 1970 in {DATE_VARIABLE}, found {stated!r}"
        raise InputError(message) from None
    return instant.strftime("%Y-%m-%d %H:%M UTC")


def coded(line: str) -> Markup:
    """A text as HTML: escaped, text in backticks as code, line breaks kept."""
    from markupsafe import Markup, escape

    if "\n" in line:
        return Markup("<br>").join(coded(part) for part in line.split("\n"))
    parts = line.split("`")
    out = [escape(part) if i % 2 == 0 else Markup("<code>{}</code>").format(part) for i, part in enumerate(parts)]
    return Markup("").join(out)


def breakable(name: str) -> Markup:
    """A name as HTML that a browser may break after its underscores."""
    from markupsafe import Markup, escape

    return Markup("_<wbr>").join(escape(part) for part in name.split("_"))


def css_text(text: str) -> Markup:
    """A text as a string of a style sheet; all characters but letters and digits are escaped."""
    from markupsafe import Markup

    return Markup('"' + "".join(c if c.isalnum() else f"\\{ord(c):x} " for c in text) + '"')


def asset(name: str) -> str:
    """The text of a script or a style sheet in the folder of `rock2d.graphics`."""
    return files("rock2d.graphics").joinpath(name).read_text(encoding="utf-8")


def source_hash(script: str) -> str:
    """The hash by which a content security policy allows an inline script."""
    return f"sha256-{base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()}"


def rendered(package: str, template: str, context: Mapping[str, Any]) -> str:
    """A page from a template in the folder of a package; it can use `style` and the templates of `rock2d.graphics`."""
    import jinja2

    folders = (files(package), files("rock2d.graphics"))

    def source(name: str) -> str:
        found = next(folder.joinpath(name) for folder in folders if folder.joinpath(name).is_file())
        return found.read_text(encoding="utf-8")

    environment = jinja2.Environment(
        autoescape=True, trim_blocks=True, lstrip_blocks=True, undefined=jinja2.StrictUndefined,
        loader=jinja2.FunctionLoader(source),
    )  # fmt: skip
    filters = (breakable, coded, css_text, percent, sentence, source_hash, spoken)
    environment.filters |= {own.__name__: own for own in filters}
    made = environment.get_template(template).render({"style": source("style.css"), "live": None, **context})
    return PERCENT_IN_TEXT.sub(lambda found: found[1] or "\N{NO-BREAK SPACE}%", made)
