"""MkDocs hook: pages that are made from the code, and the pictures of the folder `figures`."""

from __future__ import annotations

import json
from typing import Any

from pages import KEPT, PAGES, ROOT, SCHEMAS, schema_text


def on_files(files: Any, config: Any) -> Any:
    """Add generated pages, JSON Schemas and pictures to the files of the site."""
    from mkdocs.structure.files import File

    for path, text in PAGES.items():
        if path not in KEPT:
            files.append(File.generated(config, path, content=text()))
    for kind in SCHEMAS:
        content = json.dumps(schema_text(kind), indent=2, ensure_ascii=False) + "\n"
        files.append(File.generated(config, f"formats/{kind}.schema.json", content=content))
    for picture in sorted((ROOT / "figures").glob("*.png")):
        files.append(File.generated(config, f"pictures/{picture.name}", abs_src_path=str(picture)))
    return files
