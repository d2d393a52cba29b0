"""Links within the text lead somewhere, and pictures are small."""

import re

import pytest

from tests.docs.sources import DOCS, ROOT, generator, pages

LINK = re.compile(r"\]\(([^)\s]+)\)")
CODE = re.compile(r"```.*?```|`[^`]*`", re.DOTALL)
MOST_BYTES = 150_000


def exists(target) -> bool:
    """If the documentation or the repository has such a file, generated ones included."""
    if target.exists():
        return True
    if not target.is_relative_to(DOCS):
        return False
    name = str(target.relative_to(DOCS))
    made = set(generator().PAGES) | {f"formats/{kind}.schema.json" for kind in generator().SCHEMAS}
    return name in made or (name.startswith("pictures/") and (ROOT / "figures" / target.name).exists())


@pytest.mark.parametrize("path, text", [pytest.param(p, t, id=str(p.relative_to(ROOT))) for p, t in pages()])
def test_links_lead_somewhere(path, text):
    for link in LINK.findall(CODE.sub("", text)):
        if link.startswith(("http://", "https://", "#")):
            continue
        target = (path.parent / link.split("#")[0]).resolve()
        assert exists(target), f"{path.relative_to(ROOT)}: {link} leads nowhere"


def test_pictures_are_small_and_used():
    text = "\n".join(text for _, text in pages())
    for picture in (DOCS / "pictures").glob("*"):
        assert picture.stat().st_size < MOST_BYTES, picture.name
        assert picture.name in text, f"{picture.name} is on no page"


def test_nothing_comes_from_the_network():
    config = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    assert "font: false" in config
    assert "https://" not in config
    for _, text in pages():
        assert not re.search(r"!\[[^\]]*\]\(https?://", text), "pictures lie in the repository"
