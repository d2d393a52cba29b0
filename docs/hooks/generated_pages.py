"""MkDocs hook: pages that are made from the code, so that they cannot fall behind it."""

from __future__ import annotations

import json
from typing import Any

from pages import PAGES, SCHEMAS, schema_text


def on_files(files: Any, config: Any) -> Any:
    """Add the generated pages and the JSON Schemas to the files of the site."""
    from mkdocs.structure.files import File

    for path, text in PAGES.items():
        files.append(File.generated(config, path, content=text()))
    for kind in SCHEMAS:
        content = json.dumps(schema_text(kind), indent=2, ensure_ascii=False) + "\n"
        files.append(File.generated(config, f"formats/{kind}.schema.json", content=content))
    return files
