"""YAML files as checked models. An error names the line and column of the mistake.

The parser builds nodes only: tags never construct objects, and each key and value keeps its line and column.
Pydantic checks the plain data. The first mistake that it finds becomes one `InputError`."""

from __future__ import annotations

import copy
import io
import re
import warnings
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, ClassVar, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError, ValidationInfo, model_validator
from pydantic_core import PydanticCustomError

from rock2d.errors import InputError, OldKeyWarning
from rock2d.files.places import DataPath
from rock2d.files.text_files import DECIMAL_COMMA, json_content, place_in, read_text, reads_as_number
from rock2d.wording import without_unit

MOST_VALUES = 500_000
MOST_REPEATED = 10_000  # values that aliases add: aliases of aliases can blow up a small file
LONGEST_SHOWN = 60  # characters of a key or value in a message
SCALARS = ("null", "bool", "int", "float", "str", "timestamp", "merge")
Model = TypeVar("Model", bound=BaseModel)


class Checked(BaseModel):
    """A mapping with known keys. Other keys are refused; booleans, texts, nan and inf do not count as numbers.

    `old_keys`: former name of a key -> its name. A file with the former name is read with an `OldKeyWarning`."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)
    old_keys: ClassVar[Mapping[str, str]] = {}

    @model_validator(mode="before")
    @classmethod
    def _known_keys(cls, data: Any, info: ValidationInfo) -> Any:
        if not isinstance(data, dict):
            return data
        for old, key in cls.old_keys.items():
            if old in data:
                if key in data:
                    raise mistake(f"the former name of {key!r}, which is also given", old, at="key", code="duplicate")
                data = _renamed(data, old, key, info.context)
        if cls.model_config.get("extra") != "forbid":
            return data
        free = [key for key in cls.model_fields if key not in data]
        before: Any = None
        for key, value in data.items():
            if key not in cls.model_fields:
                known = f"known keys: {', '.join(cls.model_fields)}"
                if str(key).isdigit() and isinstance(before, (int, float)):  # {height_m: 4,5} has two keys
                    known = f"is this a decimal comma? Write {before}.{key}, not {before},{key}"
                message = f"unknown key{did_you_mean(key, free)}; {known}"
                raise mistake(message, key, at="key", code="unknown_key", key=key)
            before = value
        return data


class Table(Checked):
    """A mapping from names to values. It must contain the name `default`; every other name is free."""

    model_config = ConfigDict(extra="allow")

    @model_validator(mode="before")
    @classmethod
    def _has_default(cls, data: Any) -> Any:
        if isinstance(data, dict) and "default" not in data:
            for key in data:
                if did_you_mean(key, ["default"]):
                    message = "unknown name; expected 'default' (did you mean 'default'?)"
                    raise mistake(message, key, at="key", code="unknown_key", key=key)
        return data

    def named(self) -> dict[str, Any]:
        """All entries, `default` first."""
        return {"default": getattr(self, "default"), **(self.__pydantic_extra__ or {})}  # noqa: B009


def mistake(
    message: str, *path: str | int, at: str = "value", code: str = "bad_value", **fields: Any
) -> PydanticCustomError:
    """An error for a validator to raise: `path` leads from the model to the key that is wrong; `code` and `fields` are
    those of the `InputError` that it becomes."""
    context = {"message": message, "path": path, "at": at, "code": code, "fields": fields}
    return PydanticCustomError("mistake", "{message}", context)


def yaml_text(data: Any, width: int | None = None) -> str:
    """The text of a YAML file, its keys in their order. `width`: longest line."""
    from ruamel.yaml import YAML

    yaml, text = YAML(typ="safe", pure=True), io.StringIO()
    yaml.width = width
    yaml.sort_base_mapping_type_on_output = False  # type: ignore[assignment]  # ruamel annotates None alone
    yaml.dump(data, text)
    return text.getvalue()


def _renamed(data: dict[str, Any], old: str, key: str, document: Document | None) -> dict[str, Any]:
    """The mapping with a key renamed and the order of the keys kept; warns."""
    file, line = document.rename(data, old, key) if document is not None else (None, None)
    place = "".join(f"{part}:" for part in (file, line) if part is not None)
    message = f"{place} the key {old!r} is called {key!r}; please rename it".lstrip()
    warnings.warn(OldKeyWarning(message, file, line, old, key), stacklevel=2)
    return {key if name == old else name: value for name, value in data.items()}


def did_you_mean(word: object, choices: Iterable[str]) -> str:
    """The text " (did you mean 'x'?)" with the choice that is `word` with a unit, or closest to it; empty if none is
    close."""
    from rapidfuzz import fuzz, process

    names = list(choices)
    best = process.extract(str(word), names, scorer=fuzz.ratio, processor=str.lower, score_cutoff=60, limit=1)
    found = [name for name in names if without_unit(name)[0] == word] or [name for name, *_ in best]
    return f" (did you mean {shown(found[0])}?)" if found else ""


def shown(value: object) -> str:
    """A value as an error message quotes it: short, on one line."""
    if isinstance(value, dict):
        return "a mapping"
    if isinstance(value, list):
        return f"a list of {len(value)}"
    if value is None:
        return "nothing"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int):
        return str(value) if abs(value) < 10**50 else "a huge number"
    text = f"{value:.12g}" if isinstance(value, float) else repr(str(value))
    return _short(text)


def _short(text: str) -> str:
    return text if len(text) <= LONGEST_SHOWN else text[: LONGEST_SHOWN - 3] + "..."


def key_shown(key: str | int) -> str:
    """A key as a message shows it: short, without quotes, on one line."""
    text = str(key)
    return _short(text if text.isprintable() else repr(text)[1:-1])


class Document:
    """A YAML file as plain data that knows where each key and value stands.

    Attributes
    ----------
    file : the path as the user gave it
    data : dicts, lists, str, int, float, bool and None"""

    def __init__(self, file: str | Path, text: str | None = None) -> None:
        """Read a file, or its `text` if that is known."""
        self.file = Path(file)
        self._keys: dict[DataPath, tuple[int, int]] = {}
        self._values: dict[DataPath, tuple[int, int]] = {(): (1, 1)}
        self._mappings: dict[int, DataPath] = {}  # identity of a mapping in `data` -> where it stands
        self.data = self._read(read_text(self.file) if text is None else text)

    def error(
        self, message: str, *path: str | int, at: str = "value", code: str = "bad_value", **fields: Any
    ) -> InputError:
        """An `InputError` at the value (or the key, `at="key"`) under `path`, or its nearest parent."""
        for n in range(len(path), -1, -1):
            parent = path[:n]
            place = self._keys.get(parent) if at == "key" else self._values.get(parent)
            place = place or self._values.get(parent)
            if place:
                break
        dotted = ".".join(map(key_shown, path))
        text = f"{dotted}: {message}" if dotted else message
        return InputError(text, self.file, *(place or (1, 1)), code=code, **fields)

    def with_data(self, data: Any) -> Document:
        """This file with other data of the same structure; mistakes are found in the same places."""
        other = copy.copy(self)
        other.data = data
        return other

    def rename(self, mapping: dict[str, Any], old: str, key: str) -> tuple[Path, int | None]:
        """Rename a key of a mapping and its recorded places; returns file and line of the key."""
        if id(mapping) not in self._mappings:
            return self.file, None
        parent = self._mappings[id(mapping)]
        for places in (self._keys, self._values):
            for path in [path for path in places if path[: len(parent) + 1] == (*parent, old)]:
                places[(*parent, key, *path[len(parent) + 1 :])] = places[path]
        renamed = {key if name == old else name: value for name, value in mapping.items()}
        mapping.clear()
        mapping.update(renamed)
        return self.file, self._keys[(*parent, old)][0]

    def check(self, model: type[Model]) -> Model:
        """The data as `model`; raises `InputError` on the first mistake (missing keys come last)."""
        try:
            return model.model_validate(self.data, context=self)
        except ValidationError as error:
            raise self._first_mistake(error) from None

    def _first_mistake(self, error: ValidationError) -> InputError:
        mistakes = []
        for item in error.errors(include_url=False):
            path, value = self._locate(item["loc"])
            context = item.get("ctx", {})
            if item["type"] == "mistake":
                path += tuple(context["path"])
                problem = self.error(
                    context["message"], *path, at=context["at"], code=context["code"], **context["fields"]
                )
            elif item["type"] == "missing":
                key = item["loc"][-1]
                problem = self.error(f"missing key {key!r}", *path, at="key", code="missing_key", key=key)
            else:
                problem = self.error(mistake_in_words(item["type"], item["msg"], context, value), *path)
            mistakes.append((item["type"] == "missing", problem.line or 0, problem.column or 0, problem))
        return min(mistakes, key=lambda entry: entry[:3])[3]

    def _locate(self, loc: DataPath) -> tuple[DataPath, Any]:
        """Path into the data for a pydantic location, which also holds the tags of unions."""
        path, here = [], self.data
        for step in loc:
            if (isinstance(here, dict) and step in here) or (
                isinstance(here, list) and isinstance(step, int) and step < len(here)
            ):
                here = here[step]  # type: ignore[index]
                path.append(step)
        return tuple(path), here

    def _read(self, text: str) -> Any:
        from ruamel.yaml import YAML
        from ruamel.yaml.error import MarkedYAMLError, YAMLError
        from ruamel.yaml.reader import ReaderError

        yaml = YAML(typ="safe", pure=True)
        try:
            root = yaml.compose(text)
            if root is None:
                raise InputError("the file is empty; expected keys and values", self.file, 1, 1, code="empty")
            self._check_aliases(root)
            return self._plain(root, (), (), yaml)
        except MarkedYAMLError as error:
            mark = error.problem_mark or error.context_mark
            place = (mark.line + 1, mark.column + 1) if mark else (1, 1)
            what = " ".join(str(part) for part in (error.context, error.problem) if part)
            what += _other_space(text, place[0])
            raise InputError(f"not YAML: {what}", self.file, *place, code="not_yaml") from None
        except ReaderError as error:
            place = place_in(text, error.position)
            raise InputError(
                "not YAML: a character that YAML does not allow", self.file, *place, code="not_yaml"
            ) from None
        except RecursionError:
            raise InputError("nested too deeply", self.file, 1, 1, code="not_yaml") from None
        except (YAMLError, ArithmeticError, AssertionError, AttributeError, LookupError, TypeError, ValueError):
            # the parser raises these on malformed input
            raise InputError("not YAML that can be read", self.file, 1, 1, code="not_yaml") from None

    def _check_aliases(self, root: Any) -> None:
        """Refuse aliases that would repeat too many values."""
        values: dict[int, int] = {}  # identity of a node -> values in it, 0 while they are counted

        def count(node: Any) -> int:
            if id(node) not in values:
                values[id(node)] = 0
                parts = node.value if isinstance(node.value, list) else ()
                below = (item for part in parts for item in (part if isinstance(part, tuple) else (part,)))
                values[id(node)] = 1 + sum(map(count, below))
            return values[id(node)]

        if count(root) > len(values) + MOST_REPEATED:
            message = f"aliases repeat more than {MOST_REPEATED} values"
            raise InputError(message, self.file, 1, 1, code="not_yaml")

    def _plain(self, node: Any, path: DataPath, above: tuple[int, ...], yaml: Any) -> Any:
        line, column = node.start_mark.line + 1, node.start_mark.column + 1
        self._values[path] = (line, column)
        if id(node) in above:
            raise InputError("an alias that contains itself", self.file, line, column, code="not_yaml")
        if len(self._values) > MOST_VALUES:
            raise InputError(f"more than {MOST_VALUES} values", self.file, line, column, code="not_yaml")
        kind = str(node.tag).removeprefix("tag:yaml.org,2002:")
        above = (*above, id(node))
        if kind == "seq":
            return [self._plain(item, (*path, i), above, yaml) for i, item in enumerate(node.value)]
        if kind == "map":
            out: dict[str, Any] = {}
            self._mappings[id(out)] = path
            for key_node, value_node in node.value:
                place = (key_node.start_mark.line + 1, key_node.start_mark.column + 1)
                key = key_node.value
                if not isinstance(key, str):
                    raise InputError("a key must be a single word", self.file, *place, code="not_yaml")
                if key in out:
                    first = self._keys[(*path, key)][0]
                    message = f"key {shown(key)} stands twice (first in line {first})"
                    raise InputError(message, self.file, *place, code="duplicate", key=key)
                self._keys[(*path, key)] = place
                out[key] = self._plain(value_node, (*path, key), above, yaml)
            return out
        if not isinstance(node.value, str) or kind not in SCALARS:
            raise InputError(
                f"tag {shown(str(node.tag))} is not allowed here", self.file, line, column, code="not_yaml"
            )
        if kind == "null":
            return None
        try:
            if kind == "bool":
                return yaml.constructor.construct_yaml_bool(node)
            if kind == "int":
                return yaml.constructor.construct_yaml_int(node)
            if kind == "float":
                return yaml.constructor.construct_yaml_float(node)
        except (ValueError, KeyError, ArithmeticError):
            raise InputError(f"{shown(node.value)} is not a {kind}", self.file, line, column) from None
        return node.value


class JsonDocument(Document):
    """A JSON file. JSON is YAML, whose reader knows where everything stands."""

    def _read(self, text: str) -> Any:
        data = json_content(text, self.file)
        super()._read(text)
        self._mappings = dict(_mappings(data))
        return data


def _other_space(text: str, number: int) -> str:
    """What to write if this line (from 1) or the one before it has a tab or a no-break space; else empty."""
    lines = re.split(r"\r\n|\r|\n", text)
    for line in range(number, max(number - 2, 0), -1):
        for character, name in (("\t", "tab"), ("\u00a0", "no-break space")):
            if character in "".join(lines[line - 1 : line]):
                return f"; write plain spaces for the {name} in line {line}"
    return ""


def _mappings(data: Any, path: DataPath = ()) -> Iterator[tuple[int, DataPath]]:
    """Identity and path of each mapping in plain data."""
    parts: Iterable[tuple[str | int, Any]] = ()
    if isinstance(data, dict):
        yield id(data), path
        parts = data.items()
    elif isinstance(data, list):
        parts = enumerate(data)
    for key, value in parts:
        yield from _mappings(value, (*path, key))


def mistake_in_words(kind: str, message: str, context: dict[str, Any], value: Any) -> str:
    """An error of pydantic in the form "expected ..., found ..."."""
    found = shown(value)
    if kind == "float_type":
        hint = "; write it without quotes" if isinstance(value, str) and reads_as_number(value) else ""
        if isinstance(value, str) and DECIMAL_COMMA.fullmatch(value):
            hint = f"; write {value.replace(',', '.')}"
        return f"expected a number, found {found}{hint}"
    if kind in ("int_type", "int_from_float"):
        hint = f"; write {value:.0f}, without point or exponent" if isinstance(value, float) and value % 1 == 0 else ""
        return f"expected a whole number, found {found}{hint}"
    if kind == "finite_number":
        return f"expected a finite number, found {found}"
    if kind == "bool_type":
        return f"expected true or false, found {found}"
    if kind == "string_type":
        hint = "; put it in quotes" if isinstance(value, (int, float)) else ""
        return f"expected text, found {found}{hint}"
    if kind in ("model_type", "dict_type", "model_attributes_type"):
        return f"expected a mapping (key: value), found {found}"
    if kind == "list_type":
        return f"expected a list, found {found}"
    if kind == "literal_error":
        choices = re.findall(r"'([^']*)'", str(context.get("expected", "")))
        return f"expected {context.get('expected')}, found {found}{did_you_mean(value, choices)}"
    if kind == "string_pattern_mismatch":
        return f"expected a name of letters (a to z), digits, '_', '-' and '.', found {found}"
    expected = re.sub(r"^(Input|Value|List|Dictionary|String) should (be|have)", r"expected", message)
    return re.sub(r" after validation, not \d+$", "", expected) + f", found {found}"
