"""The key `project` of a scenario: what stands in the head of a report that is handed in."""

from __future__ import annotations

from datetime import date

from pydantic import Field, field_validator

from rock2d.files.checked_yaml import Checked, mistake, shown

LONGEST_TEXT = 200


def _text(description: str) -> str:
    return Field(default="", max_length=LONGEST_TEXT, description=description)


class Project(Checked):
    """Head of the report. What is not given is left out."""

    title: str = _text("Title of the project")
    number: str = _text("Number of the project or the document, in quotes if it has digits alone")
    client: str = _text("Who asked for the report")
    author: str = _text("Who made it, and signs")
    checked_by: str = _text("Who checked it, and signs")
    date: str = _text("Date of the report, year-month-day")

    @field_validator("date")
    @classmethod
    def _iso(cls, text: str) -> str:
        try:
            day = date.fromisoformat(text).isoformat()
        except ValueError:
            day = ""
        if day != text:  # other forms of ISO 8601, such as 20250331
            raise mistake(f"expected a date as 2025-03-31, found {shown(text)}")
        return text
