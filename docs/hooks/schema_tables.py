"""Tables of the keys of a file, made from its JSON Schema."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass, field
from typing import Any

Schema = dict[str, Any]


@dataclass
class KeyTables:
    """Markdown of all keys of a file: one section for each mapping, in the order in which a reader meets them."""

    schema: Schema
    level: int = 2
    lines: list[str] = field(default_factory=list)
    written: dict[str, str] = field(default_factory=dict)  # name of a definition -> its section
    waiting: list[tuple[str, str]] = field(default_factory=list)  # section, name of a definition

    def markdown(self, top: str) -> str:
        """The page's tables; `top` is the heading of the outermost mapping."""
        self._section(top, self.schema, "")
        return "\n".join(self.lines) + "\n"

    def _section(self, heading: str, node: Schema, path: str) -> None:
        self.lines += ["", f"{'#' * self.level} {heading}", ""]
        if path and node.get("description"):
            self.lines += [_sentence(node["description"]), ""]
        rows = list(node.get("properties", {}).items())
        others = node.get("additionalProperties")
        if isinstance(others, dict) and others:
            rows.append(("<name>", others))
        required = set(node.get("required", []))
        self.lines += ["| key | value | default | meaning |", "|---|---|---|---|"]
        for key, value in rows:
            place = f"{path}.{key}" if path else key
            default = "required" if key in required else _default(value)
            kind = self._kind(value, place)
            shown = "*name*" if key == "<name>" else f"`{key}`"
            self.lines.append(f"| {shown} | {kind} | {default} | {_cell(_meaning(self.schema, value))} |")
        inner, self.waiting = self.waiting, []
        for place, name in inner:
            self._section(f"`{place}`", self.schema["$defs"][name], place)

    def _kind(self, node: Schema, path: str) -> str:
        if "$ref" in node:
            return self._reference(node["$ref"], path)
        for word in ("anyOf", "oneOf"):
            if word in node:
                kinds = [self._kind(one, path) for one in node[word] if one.get("type") != "null"]
                return " or ".join(dict.fromkeys(kinds))
        if "const" in node:
            return f"`{json.dumps(node['const'])}`".replace('"', "")
        if "enum" in node:
            return ", ".join(f"`{value}`" for value in node["enum"])
        kind = node.get("type")
        if isinstance(kind, list):
            return " or ".join(self._kind({**node, "type": one}, path) for one in kind if one != "null")
        if kind == "array":
            return self._array(node, path)
        if kind == "object":
            return self._object(node, path)
        return {"string": "text", "boolean": "true or false", "integer": "whole number"}.get(
            str(kind), "number"
        ) + _bounds(node)

    def _reference(self, reference: str, path: str) -> str:
        name = reference.rsplit("/", 1)[1]
        node = self.schema["$defs"][name]
        if "properties" not in node and not isinstance(node.get("additionalProperties"), dict):
            return self._kind(node, path)
        if name not in self.written:
            shape = node.get("properties", {}).get("shape", {}).get("const")
            section = f"{path}, shape: {shape}" if shape else path
            self.written[name] = section
            self.waiting.append((section, name))
        section = self.written[name]
        return (
            f"[mapping](#{_anchor(section)})" if ", shape" not in section else f"[{name.lower()}](#{_anchor(section)})"
        )

    def _array(self, node: Schema, path: str) -> str:
        items = node.get("items", {})
        if items.get("type") == "array" and items.get("description"):  # a point
            return f"list of {_cell(items['description'])}" + _count(node)
        kind = self._kind(items, path)
        return f"list of {kind}" + _count(node)

    def _object(self, node: Schema, path: str) -> str:
        others = node.get("additionalProperties")
        if "properties" in node:
            name = path.replace(".", "_")
            self.schema.setdefault("$defs", {})[name] = node
            return self._reference(f"#/$defs/{name}", path)
        if isinstance(others, dict) and others:
            return f"name → {self._kind(others, path + '.<name>')}"
        return "mapping"


def _count(node: Schema) -> str:
    least, most = node.get("minItems"), node.get("maxItems")
    if least is not None and least == most:
        return f", {least} of them"
    return f", at least {least}" if least else ""


def _bounds(node: Schema) -> str:
    low, high = node.get("minimum"), node.get("maximum")
    if "exclusiveMinimum" in node:
        return f" > {node['exclusiveMinimum']:g}"
    if low is not None and high is not None and abs(high) < 1e5:
        return f", {low:g} to {high:g}"
    return f" ≥ {low:g}" if low is not None and low >= 0 else ""


def _meaning(schema: Schema, node: Schema) -> str:
    if node.get("description"):
        return str(node["description"])
    for one in (node, *node.get("anyOf", [])):
        if "$ref" in one:
            own = schema["$defs"][one["$ref"].rsplit("/", 1)[1]].get("description", "")
            return str(own)
    return ""


def _default(node: Schema) -> str:
    value = node.get("default")
    if value is None or value == "" or isinstance(value, (dict, list)):
        return ""
    return f"`{json.dumps(value)}`".replace('"', "")


def _sentence(text: str) -> str:
    return re.sub(r"\s+", " ", text).strip()


def _cell(text: str) -> str:
    return _sentence(text).replace("|", "\\|").replace("<", "&lt;")


def _anchor(heading: str) -> str:
    """The anchor that Python-Markdown makes of a heading in code marks."""
    value = re.sub(r"[^\w\s-]", "", heading.replace("`", "")).strip().lower()
    return re.sub(r"[-\s]+", "-", value)
