"""Pages from templates of this folder, with one style; when, by what and with which version they were made."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.resources import files
from typing import TYPE_CHECKING, Any

from rock2d.diagnosis.report import text
from rock2d.errors import InputError

if TYPE_CHECKING:
    from markupsafe import Markup

DATE_VARIABLE = "SOURCE_DATE_EPOCH"  # seconds since 1970, for pages that are the same at every run
IN_PYTHON = "rock2d.diagnose in Python"


@dataclass(frozen=True)
class Made:
    """When and how a page was made; `seed` is None if nothing was drawn."""

    date: str
    version: str
    command: str
    seed: int | None

    @classmethod
    def now(cls, command: str, seed: int | None) -> Made:
        """By this version of rock2d, at `page_date()`."""
        from rock2d import __version__

        return cls(page_date(), __version__, command, seed)


def page_date() -> str:
    """Now in UTC, or the instant of SOURCE_DATE_EPOCH if that is set.

    Raises `InputError` if SOURCE_DATE_EPOCH is no number of seconds.
    """
    stated = os.environ.get(DATE_VARIABLE)
    try:
        instant = datetime.now(UTC) if stated is None else datetime.fromtimestamp(int(stated), UTC)
    except (ValueError, OverflowError, OSError):
        message = f"expected whole seconds since 1970 in {DATE_VARIABLE}, found {stated!r}"
        raise InputError(message) from None
    return instant.strftime("%Y-%m-%d %H:%M UTC")


def coded(line: str) -> Markup:
    """A text as HTML: escaped, with what stands in backticks as code and line breaks where it has them."""
    from markupsafe import Markup, escape

    if "\n" in line:
        return Markup("<br>").join(coded(part) for part in line.split("\n"))
    parts = line.split("`")
    out = [
        escape(part) if i % 2 == 0 else Markup("<code>{}</code>").format(part) for i, part in enumerate(parts)
    ]
    return Markup("").join(out)


def rendered(template: str, context: Mapping[str, Any]) -> str:
    """A page from a template of this folder; `style` is given to it."""
    import jinja2

    folder = files("rock2d.diagnosis.report")

    def source(name: str) -> str:
        return folder.joinpath(name).read_text(encoding="utf-8")

    environment = jinja2.Environment(
        autoescape=True, trim_blocks=True, lstrip_blocks=True, undefined=jinja2.StrictUndefined,
        loader=jinja2.FunctionLoader(source),
    )  # fmt: skip
    environment.filters |= {
        "spoken": text.spoken, "percent": text.percent, "number": text.number, "coded": coded,
    }  # fmt: skip
    return environment.get_template(template).render({"style": source("style.css"), **context})
