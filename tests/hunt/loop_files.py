"""Files that commands write: numbers where numbers are expected, and pages that say what the tables say."""

import base64
import html
import io
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

NO_NUMBER = re.compile(r"(?<![\w.-])[-+]?(nan|inf|infinity)(?![\w.-])", re.IGNORECASE)
DATA = re.compile(r"data:[\w/+.;=-]+;base64,[\w+/=]+")
DOWNLOAD = re.compile(r'download="([^"]+\.csv)" href="data:text/csv;charset=utf-8;base64,([\w+/=]+)"')
ROW = re.compile(r"<tr>(.*?)</tr>", re.DOTALL)
CELL = re.compile(r"<t[dh][^>]*>(.*?)</t[dh]>", re.DOTALL)
# table -> columns that must hold a number in every row
NUMBERS = {
    "impacts.csv": ("t_s", "x_m", "y_m", "vx_m_s", "vy_m_s"),
    "stops.csv": ("t_s", "x_m", "y_m", "runout_m"),
    "starts.csv": ("x_m", "y_m", "theta_rad", "vx_m_s", "vy_m_s", "omega_rad_s"),
    "energy.csv": ("kinetic_J", "potential_J", "initial_J", "residual_J"),
    "passing.csv": ("releases", "passed", "unresolved", "frequency", "low95", "high95"),
    "crossings.csv": ("t_s", "x_m", "y_m", "speed_m_s", "kinetic_J"),
    "percentiles.csv": ("percentile", "passed"),
    "before_after.csv": ("releases", "passed", "frequency", "low95", "high95"),
    "design.csv": ("size",),
}
ROUNDED = 6e-3  # relative rounding of a number on a page, which has three digits


def unnumbered(path: Path) -> tuple[str, str] | None:
    """What is written, and where, in place of a number; None if the file is as it should be."""
    if path.suffix == ".csv":
        return _unnumbered_table(path)
    if path.suffix in (".json", ".yaml", ".html"):
        text = path.read_text(encoding="utf-8")
        if path.suffix == ".json":
            json.loads(text)
        plain = DATA.sub("", text)
        if found := NO_NUMBER.search(plain):
            around = plain[max(0, found.start() - 100) : found.end() + 40]
            return f"{found.group().lower()} into {path.name}", f"{path}: {around!r}"
    return None


def _unnumbered_table(path: Path) -> tuple[str, str] | None:
    text = path.read_text(encoding="utf-8")
    if found := NO_NUMBER.search(text):
        return f"{found.group().lower()} into {path.name}", text[max(0, found.start() - 100) : found.end()]
    table = pd.read_csv(io.StringIO(text)) if text.count("\n") > 1 else pd.DataFrame()
    for column in NUMBERS.get(path.name, ()):
        if column in table and table[column].isna().any():
            row = table[table[column].isna()].iloc[0]
            return f"no {column} into {path.name}", f"{path}: {row.to_dict()}"
    return None


def page_faults(folder: Path) -> list[str]:
    """Where report.html of a run's folder differs from its tables."""
    page = (folder / "report.html").read_text(encoding="utf-8")
    faults = []
    for name, data in DOWNLOAD.findall(page):
        if (folder / name).is_file():
            faults += _differing(name, pd.read_csv(folder / name), _table(base64.b64decode(data).decode()))
    rows = [tuple(_words(cell) for cell in CELL.findall(row)) for row in ROW.findall(page)]
    for own in pd.read_csv(folder / "passing.csv").itertuples():
        said = [row for row in rows if row[:3] == (own.line, own.block, str(own.releases)) and len(row) > 7]
        shares = {
            "passing": (6, own.frequency, own.low95, own.high95),
            "per arriving": (7, own.per_arriving, own.per_arriving_low95, own.per_arriving_high95),
        }
        for what, (cell, *values) in shares.items():
            numbers = [float(word) for word in re.findall(r"[\d.e+-]*\d[\d.e+-]*", said[0][cell])] if said else []
            stated = [100.0 * value for value in values if np.isfinite(value)]
            if not said or not _alike(numbers, stated):
                faults.append(f"{what} of {own.block} at {own.line}: {stated} in the table, {numbers} on the page")
    return faults


def _alike(numbers: list[float], stated: list[float]) -> bool:
    return len(numbers) == len(stated) and np.allclose(numbers, stated, rtol=ROUNDED, atol=1e-9)


def diagnosis_page_faults(folder: Path) -> list[str]:
    """Where report.html of a diagnosis differs from its diagnosis.json."""
    content = json.loads((folder / "diagnosis.json").read_text(encoding="utf-8"))
    page = (folder / "report.html").read_text(encoding="utf-8")
    tables = {name: _table(base64.b64decode(data).decode()) for name, data in DOWNLOAD.findall(page)}
    faults = []
    if "probabilities.csv" in tables:
        said = dict(zip(*(tables["probabilities.csv"].iloc[:, i] for i in (0, 1)), strict=True))
        for name, p in content["probabilities"].items():
            if not np.isclose(said.get(name, said.get(name.replace("_", " "), np.nan)), p, rtol=1e-4, atol=1e-9):
                faults.append(f"probability of {name}: {p} in the file, {said.get(name)} on the page")
    verdict = content["probabilities"].get(content["verdict"])
    if verdict is not None and not content["sanity"]["faults"] and f"{100 * verdict:.0f} %" not in _words(page):
        faults.append(f"the page does not say the verdict's {100 * verdict:.0f} %")
    return faults


def _differing(name: str, written: pd.DataFrame, shown: pd.DataFrame) -> list[str]:
    """How a table of the page differs from that of the folder, of which it may show a part."""
    words = [column for column in shown.columns if not pd.api.types.is_numeric_dtype(shown[column])]
    if len(shown) < len(written) and words:
        own = set(shown[words].astype(str).itertuples(index=False, name=None))
        kept = [row in own for row in written[words].astype(str).itertuples(index=False, name=None)]
        written = written[kept]
    if len(written) != len(shown):
        return [f"{name}: {len(written)} rows in the folder, {len(shown)} in the page"]
    faults = []
    for column in shown.columns:
        a, b = (pd.to_numeric(table[column], errors="coerce") for table in (written, shown))
        if not np.allclose(a, b, rtol=1e-4, atol=1e-12, equal_nan=True):
            faults.append(f"{name}: column {column} differs")
    return faults


def _table(text: str) -> pd.DataFrame:
    return pd.read_csv(io.StringIO(text), comment="#")


def _words(markup: str) -> str:
    """The text of some markup."""
    plain: Any = re.sub(r"<[^>]+>", " ", DATA.sub("", markup))
    return " ".join(html.unescape(plain).split())
