"""What exists is documented: effects, scenarios, keys of files, tables of a run; and in the words of the glossary."""

import json
import re

import pytest

from rock2d.design.norms import NORM_NUMBERS
from rock2d.effects import catalogue
from rock2d.scene.soils import SOIL_CLASSES
from rock2d.schemas import SCHEMAS, file_schema
from tests.docs.sources import DOCS, ROOT, generator, pages

# words of the former private language; the glossary names `bench` once, to say what it means elsewhere
FORBIDDEN = (
    "crater", "virgin", "kink", "seating", "leftover", "dials", "slots", "told", "weighing", "bench", "hand-dealt",
)  # fmt: skip
ALLOWED = re.compile(
    r"`?make bench`?|\[\"bench\"\]|A \*bench\* is a berm|a \*bench\* is a berm|rolling_in_crater|"
    r"paper_bench\.yaml|bench\.yaml|benchmarks?"
)
MOST_LINES_OF_README = 120


@pytest.mark.parametrize("name", catalogue())
def test_effect_is_documented(name):
    page = generator().effects_page()
    effect = catalogue()[name]
    section = page.split(f"### {name}\n")[1].split("\n### ")[0]
    assert effect.source in section
    assert list(generator().equations(effect)), f"{name}: neither its law nor `apply` says its equation"
    for parameter in effect.parameters:
        assert f"`{parameter.name}`" in section


@pytest.mark.parametrize("soil", SOIL_CLASSES.values(), ids=list(SOIL_CLASSES))
def test_soil_class_is_documented_with_its_numbers(soil):
    page = (DOCS / "theory" / "soil-classes.md").read_text(encoding="utf-8")
    (row,) = re.findall(rf"^\| `{soil.name}` \|(.*)\|$", page, re.MULTILINE)
    numbers = [[float(n) for n in re.findall(r"[\d.]+", cell)] for cell in row.split("|")[1:]]
    assert numbers == [
        [soil.restitution, *soil.restitution_range],
        [soil.friction_angle_deg, *soil.friction_range_deg],
        [soil.stiffness, *soil.stiffness_range],
        [soil.rolling_share],
        [soil.tangential_restitution],
        [soil.slope_reduction_deg],
    ]
    guide = (DOCS / "guide" / "own-slope.md").read_text(encoding="utf-8")
    assert f"`{soil.name}`" in guide


def test_every_scenario_is_in_the_gallery():
    page = generator().gallery_page()
    for path in generator().scenario_files():
        assert f"rock2d run scenarios/{path.name}" in page
        assert list((DOCS / "pictures").glob(f"{path.stem}_*.png")), f"run docs/make_gallery.py {path.stem}"


def test_every_table_of_a_run_is_documented():
    page = generator().results_page()
    for name, columns in generator().result_columns().items():
        assert f"### {name}.csv" in page
        assert f"`{name}.csv`" in page, f"docs/hooks/heads/formats_results.md does not say what {name}.csv holds"
        assert all(f"`{column}`" in page for column in columns)


@pytest.mark.parametrize("kind", SCHEMAS)
def test_every_key_is_documented(kind):
    page = generator().PAGES[f"formats/{kind}.md"]()
    keys = re.findall(r'"properties": \{', json.dumps(file_schema(kind)))
    # fewer only where a mapping is an alias of another
    assert page.count("\n| key | value |") >= len(keys) - 1
    for row in re.findall(r"^\| `(\w+)` \|.*\| *\|$", page, re.MULTILINE):
        pytest.fail(f"{kind}: key {row} has no description")


def test_pages_that_are_kept_in_the_repository_are_up_to_date():
    for name in generator().KEPT:
        kept = (DOCS / name).read_text(encoding="utf-8")
        assert kept == generator().PAGES[name](), f"run python docs/hooks/pages.py, and commit docs/{name}"


def test_every_tutorial_has_a_page_and_its_output():
    index = (DOCS / "tutorials" / "index.md").read_text(encoding="utf-8")
    for path in generator().tutorial_files():
        assert f"({path.stem}.md)" in index
        assert path.with_suffix(".txt").exists(), f"run docs/make_gallery.py {path.stem}"


def test_words_are_those_of_the_glossary():
    for path, text in pages():
        if path.name in ("CHANGELOG.md", "changelog.md"):
            continue
        plain = ALLOWED.sub("", text)
        for word in FORBIDDEN:
            found = re.search(rf"\b{word}\b", plain, re.IGNORECASE)
            assert not found, f"{path.relative_to(ROOT)}: {word!r}: {plain[max(0, found.start() - 40) :][:90]!r}"


def test_readme_is_short():
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= MOST_LINES_OF_README


def test_examples_of_files_are_valid(tmp_path):
    """The YAML examples of the guide are read by the checks of the real files."""
    from rock2d_tracking.setup_file import Setup

    from rock2d.design.possible_sites import draw_sites, variants_of
    from rock2d.files.scenario_reading import load_scenario
    from rock2d.runs.conditions import Conditions, starts

    def examples(name: str) -> list[str]:
        text = (DOCS / "guide" / name).read_text(encoding="utf-8")
        return re.findall(r"```yaml\n(.*?)```", text, re.DOTALL)

    scenario = tmp_path / "slope.yaml"
    scenario.write_text("".join(examples("own-slope.md")), encoding="utf-8")
    site = load_scenario(scenario)
    assert site.releases == 500 and site.scatter and site.roughness
    begun = starts(Conditions(site, site.engine, site.seed), 20)
    assert {start.block for start, _ in begun} == {"boulder", "slab", "scree_blocks"}
    assert {len(met.drawn) for _, met in begun} == {1, 2, 3}  # numbers drawn for slab, boulder and population
    further = [t for t in examples("design.md") if t.startswith("design_values:") or "\n  site:" in t]
    assert len(further) == 2
    scenario.write_text("".join(examples("own-slope.md") + further), encoding="utf-8")
    site = load_scenario(scenario)
    assert site.design_values.onr_24810.gamma_e == 1.15
    assert len(variants_of(site, draw_sites(site, 1, 4))) == 4 * (4 + 2)
    (several,) = [t for t in examples("design.md") if t.startswith("embankment:")]
    one = re.sub(r"^(embankment|ditch): .*\n", "", "".join(examples("own-slope.md")), flags=re.MULTILINE)
    one = re.sub(r"\b(uphill_face|crest|downhill_face):", r"\1_1:", one)
    scenario.write_text(one + several, encoding="utf-8")
    assert {"crest_1", "arrival_2"} < set(load_scenario(scenario).make_cross_section().measure_lines)
    setup = tmp_path / "setup.yaml"
    setup.write_text(examples("own-film.md")[0], encoding="utf-8")
    assert Setup(setup).metres_per_pixel == pytest.approx(0.5 / 800, rel=1e-3)


def test_the_guide_says_who_states_each_number_of_a_norm():
    page = (DOCS / "guide" / "design.md").read_text(encoding="utf-8")
    table = page.split("| verified or not |\n")[1].split("\n\n")[0].splitlines()[1:]
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in table]
    assert rows == [
        [n.norm, n.name, n.values, *(*n.sources, "none", "none")[:2], "verified" if n.verified else "not verified"]
        for n in NORM_NUMBERS
    ]


def test_every_public_name_is_documented():
    import rock2d

    page = generator().api_page()
    for name in rock2d.__all__:
        assert f"::: rock2d.{name}\n" in page
        assert getattr(rock2d, name).__doc__
