"""The pages that are made from the code: text in Markdown, by the path that they get in the documentation.

Some of them also lie in the repository, to be read there: `python docs/hooks/pages.py` writes these anew.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import click
from schema_tables import KeyTables

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
SCHEMAS = ("scenario", "experiment", "setup", "diagnosis")


def schema_text(kind: str) -> dict[str, Any]:
    """The JSON Schema of a kind of file."""
    from rock2d.schemas import file_schema

    return file_schema(kind)


# the catalogue of effects ---------------------------------------------------------------------------------

PHASES = {
    "flight": "Effects that show in flight",
    "impact": "Effects that show at impacts",
    "all": "Effects that show everywhere",
}


def effects_page() -> str:
    """Every effect of the catalogue with its equation, its source and its parameters."""
    from rock2d.effects import catalogue

    effects = list(catalogue().values())
    lines = [_head("theory/effects.md")]
    for phase, heading in PHASES.items():
        lines += ["", f"## {heading}", ""]
        for effect in (e for e in effects if e.phase == phase):
            lines += ["", f"### {effect.name}", "", effect.summary[0].upper() + effect.summary[1:] + ".", ""]
            lines += [f"- {equation}" for equation in equations(effect)]
            lines += [f"- Source: {effect.source}.", "", "| parameter | unit | neutral | range | meaning |"]
            lines += ["|---|---|---|---|---|"]
            for p in effect.parameters:
                bounds = " or ".join(f"{v:g}" for v in p.choices) if p.choices else f"{p.low:g} to {p.high:g}"
                lines.append(f"| `{p.name}` | {p.unit} | {p.neutral:g} | {bounds} | {p.meaning} |")
    return "\n".join(lines) + "\n"


def equations(effect: Any) -> Iterator[str]:
    """What the docstrings of an effect's compiled laws, or of its change of the world, say."""
    laws = {name: getattr(effect, name) for name in LAW_KINDS if getattr(effect, name) is not None}
    for name, law in (laws or {"apply": effect.apply}).items():
        text = re.sub(r"\s+", " ", getattr(law, "__doc__", None) or "").strip()
        if text:
            yield f"{LAW_KINDS.get(name, 'Change of the set-up or the record')}: {text}"


LAW_KINDS = {
    "normal": "Normal force",
    "friction": "Friction",
    "tangential": "Tangential force",
    "flight": "Acceleration in flight",
    "recoil": "Recoil of the ground",
    "departure": "Departure from the ground",
}


# the command line -----------------------------------------------------------------------------------------


def commands(group: click.Group | None = None, path: str = "rock2d") -> Iterator[tuple[str, click.Command]]:
    """Every command with its words, groups left out."""
    if group is None:
        from rock2d.cli import cli as group
    for name, command in group.commands.items():
        words = f"{path} {name}"
        if isinstance(command, click.Group):
            yield from commands(command, words)
        else:
            yield words, command


def cli_page() -> str:
    """Every command with its arguments and options."""
    lines = [_head("reference/cli.md")]
    for words, command in commands():
        help_text = re.sub(r"(?<!\n)\n(?!\n)", " ", (command.help or "").strip())
        context = click.Context(command, info_name=words)
        usage = " ".join([words, *command.collect_usage_pieces(context)])
        lines += ["", f"## {words}", "", help_text, "", "```text", usage, "```", ""]
        options = [p for p in command.params if isinstance(p, click.Option)]
        if options:
            lines += ["| option | value | default | meaning |", "|---|---|---|---|"]
            lines += [_option_row(option) for option in options]
    return "\n".join(lines) + "\n"


def _option_row(option: click.Option) -> str:
    names = ", ".join(f"`{name}`" for name in option.opts)
    if option.is_flag:
        value = ""
    elif isinstance(option.type, click.Choice):
        value = ", ".join(f"`{choice}`" for choice in option.type.choices)
    else:
        value = option.metavar or {"integer range": "whole number", "float": "number"}.get(
            option.type.name, option.type.name
        )
    default = "required" if option.required else ""
    if not option.required and not option.is_flag and isinstance(option.default, (int, str, Path, tuple)):
        default = " ".join(map(str, option.default)) if isinstance(option.default, tuple) else str(option.default)
    help_text = (option.help or "").replace("|", "\\|")
    return f"| {names} | {value} | {default} | {help_text} |"


# the public API -------------------------------------------------------------------------------------------

API_GROUPS = {
    "Set-up": ("make_block", "Block", "CrossSection", "ContactParameters", "ReboundParameters"),
    "Simulate": ("simulate", "load_scenario", "Scenario", "run", "Simulation", "RunResult"),
    "Design": ("assess", "Assessment", "least_size", "Target", "Answer", "variant", "write_report"),
    "Films and experiments": (
        "track",
        "TrackResult",
        "load_experiment",
        "Experiment",
        "diagnose",
        "DiagnosisResult",
        "predict",
    ),
}

# members of a class without a leading underscore, of a base that is not public
INHERITED = {"RunResult": "    options:\n      inherited_members: [experiment, write, write_video]\n"}


def api_page() -> str:
    """Every public name, in the order of the work; names that belong to no group come last."""
    import rock2d

    public = list(rock2d.__all__)
    grouped = {name for names in API_GROUPS.values() for name in names}
    groups = API_GROUPS | {"Further names": [name for name in public if name not in grouped]}
    lines = [_head("reference/api.md")]
    for heading, names in groups.items():
        lines += ["", f"## {heading}", ""]
        lines += [f"::: rock2d.{name}\n{INHERITED.get(name, '')}" for name in names if name in public]
    lines += ["", "## JSON Schemas", "", "::: rock2d.schemas.file_schema"]
    return "\n".join(lines) + "\n"


# file formats ---------------------------------------------------------------------------------------------


def _format_page(kind: str, top: str) -> Callable[[], str]:
    def page() -> str:
        return _head(f"formats/{kind}.md") + "\n" + KeyTables(schema_text(kind)).markdown(top)

    return page


def results_page() -> str:
    """Every table that a run leaves, with its columns."""
    lines = [_head("formats/results.md")]
    for name, columns in result_columns().items():
        lines += ["", f"### {name}.csv", "", ", ".join(f"`{column}`" for column in columns), ""]
    return "\n".join(lines) + "\n"


def result_columns() -> dict[str, tuple[str, ...]]:
    """Columns of the tables of a run, by the name of the table."""
    from rock2d.files.experiment import TRAJECTORY_COLUMNS
    from rock2d.runs.simulation import indicators

    own = {name: tuple(indicator.columns) for name, indicator in indicators().items()}
    return {"trajectories": tuple(TRAJECTORY_COLUMNS)} | own


# gallery and tutorials ------------------------------------------------------------------------------------


def scenario_files() -> list[Path]:
    """The scenarios that come with rock2d."""
    return sorted((ROOT / "scenarios").glob("*.yaml"))


def gallery_page() -> str:
    """One entry for each scenario: picture, what it shows, command, what it assumes."""
    from ruamel.yaml import YAML

    lines = [_head("gallery.md")]
    for path in scenario_files():
        content = YAML(typ="safe").load(path.read_text(encoding="utf-8"))
        lines += ["", f"## {content['name']}", "", content["about"], ""]
        for picture in sorted((DOCS / "pictures").glob(f"{path.stem}_*.png")):
            engine = picture.stem.removeprefix(path.stem + "_").replace("_", "-")
            lines += [f"![{content['name']} with the {engine} engine](pictures/{picture.name})", ""]
        if (DOCS / "live" / f"{path.stem}.html").is_file():
            lines += [f"[Live page of this scenario](live/{path.stem}.html)", ""]
        text = path.read_text(encoding="utf-8")
        data = " --data DIR" if "from_experiment" in text or "field_test" in text else ""
        lines += ["```bash", f"rock2d run scenarios/{path.name}{data}", "```", ""]
        lines += ['??? note "What this scenario assumes"', ""]
        lines += [f"    - {line}" for line in content.get("assumed", [])]
    return "\n".join(lines) + "\n"


def tutorial_files() -> list[Path]:
    """The tutorials: Python scripts in percent format."""
    return sorted((DOCS / "tutorials").glob("*.py"))


def tutorial_page(path: Path) -> str:
    """A tutorial as a page: text cells, code cells, then its output and its pictures."""
    lines: list[str] = []
    for cell in re.split(r"^# %%", path.read_text(encoding="utf-8"), flags=re.MULTILINE):
        head, _, body = cell.partition("\n")
        if "[markdown]" in head:
            lines += [re.sub(r"^# ?", "", line) for line in body.strip().splitlines()] + [""]
        elif body.strip():
            lines += ["```python", body.strip(), "```", ""]
    output = path.with_suffix(".txt")
    if output.exists():
        lines += ["Output:", "", "```text", output.read_text(encoding="utf-8").strip(), "```", ""]
    for picture in sorted((DOCS / "pictures").glob(f"tutorial_{path.stem}*.png")):
        lines += [f"![Picture of this tutorial](../pictures/{picture.name})", ""]
    if (DOCS / "live" / f"{path.stem}.html").is_file():
        lines += [f"[Live page of this tutorial](../live/{path.stem}.html)", ""]
    lines += [f"The script: [{path.name}]({path.name})."]
    return "\n".join(lines) + "\n"


# pages that lie elsewhere in the repository ----------------------------------------------------------------


def _from_root(name: str) -> Callable[[], str]:
    def page() -> str:
        text = (ROOT / name).read_text(encoding="utf-8")
        return re.sub(r"\]\(docs/([^)]*)\)", r"](\1)", text)

    return page


def _head(page: str) -> str:
    """What is written by hand above a generated part: the file of that path in `heads`, with _ for /."""
    return (DOCS / "hooks" / "heads" / page.replace("/", "_")).read_text(encoding="utf-8").rstrip() + "\n"


PAGES: dict[str, Callable[[], str]] = {
    "theory/effects.md": effects_page,
    "reference/cli.md": cli_page,
    "reference/api.md": api_page,
    "formats/scenario.md": _format_page("scenario", "Keys of a scenario"),
    "formats/experiment.md": _format_page("experiment", "Keys of `experiment.yaml`"),
    "formats/setup.md": _format_page("setup", "Keys of `setup.yaml`"),
    "formats/diagnosis.md": _format_page("diagnosis", "Keys of `diagnosis.json`"),
    "formats/results.md": results_page,
    "gallery.md": gallery_page,
    "changelog.md": _from_root("CHANGELOG.md"),
    "contributing.md": _from_root("CONTRIBUTING.md"),
} | {f"tutorials/{path.stem}.md": (lambda path=path: tutorial_page(path)) for path in tutorial_files()}

KEPT = ("formats/setup.md",)  # pages that lie in the repository, too

if __name__ == "__main__":
    for name in KEPT:
        (DOCS / name).write_text(PAGES[name](), encoding="utf-8")
