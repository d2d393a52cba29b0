"""Random damage to valid files: what a tired hand, a wrong export or a broken disk would do.

A mutant says which file of a set is changed, in its text or its structure, and by which changes. It is named by a text,
`kind/seed/number`, which repeats it. Every change has a random number of its own, so that a mutant can be made again
with fewer changes."""

from __future__ import annotations

import copy
import io
import json
import random
from collections.abc import Iterator, Sequence
from itertools import combinations
from typing import Any, NamedTuple

from ruamel.yaml import YAML

from tests.hunt.valid_files import Files

MOST_CHANGES = 4

ODD = [
    None, True, "0.1", "", "x", -1, 0, 10**400, 1e300, 1e-300, float("nan"), float("inf"), [], {}, [[]], [1, "a"],
]  # fmt: skip
JUNK = [
    b"\t", b"\n", b"\r", b"\0", b'"', b"'", b",", b": ", b"- ", b"? ", b"|", b"{", b"]", b"#", b"nan", b"\xff",
    b"&a *a", b"!!python/name:os", b"%YAML 1.1\n---\n", b"\n---\n", b"\xe2\x80\xa8",
]  # fmt: skip
ODD_CELLS = [
    "", "nan", "inf", "1e400", "-1", "0", "x", "1,5", '"', "1_000", "٣", "1e9", "-1e-300", "0x10", " ", "\0",
]  # fmt: skip


def _places(node: Any, found: list[tuple[Any, Any]]) -> list[tuple[Any, Any]]:
    for key in list(node) if isinstance(node, dict) else range(len(node)) if isinstance(node, list) else ():
        found.append((node, key))
        _places(node[key], found)
    return found


def change_data(data: Any, rng: random.Random) -> None:
    """One change of nested dicts and lists."""
    places = _places(data, [])
    if not places:
        return
    odd = copy.deepcopy(ODD)
    node, key = rng.choice(places)
    action = rng.choice(("rename", "delete", "odd", "nest", "swap", "flip"))
    if action == "rename" and isinstance(node, dict):
        node[rng.choice([str(key)[:-1], str(key) + "s", str(key).upper(), "default", ""])] = node.pop(key)
    elif action == "delete":
        del node[key]
    elif action == "nest":
        node[key] = [node[key]] if rng.random() < 0.5 else {"normal": node[key]}
    elif action == "swap":
        other, where = rng.choice(places)
        node[key] = other[where] if not isinstance(other[where], (dict, list)) else rng.choice(odd)
    elif action == "flip" and isinstance(node[key], (int, float)) and abs(node[key]) < 1e290:
        node[key] = -node[key] * rng.choice([1, -2, 0.1, 1e6, 1e-9])
    else:
        node[key] = rng.choice(odd)


def changed_bytes(raw: bytes, rng: random.Random) -> bytes:
    """One change of bytes."""
    i = rng.randrange(len(raw) + 1)
    action = rng.choice(("flip", "cut", "insert", "repeat", "drop"))
    if action == "flip" and i < len(raw):
        return raw[:i] + bytes([raw[i] ^ (1 << rng.randrange(8))]) + raw[i + 1 :]
    if action == "cut" and rng.random() < 0.3:
        return raw[:i]
    if action == "insert":
        return raw[:i] + rng.choice(JUNK) + raw[i:]
    if action == "repeat":
        return raw[:i] + raw[max(0, i - rng.randint(1, 40)) : i] + raw[i:]
    if action == "drop":
        return raw[:i] + raw[i + rng.randint(1, 20) :]
    return raw


def change_table(rows: list[list[str]], rng: random.Random) -> None:
    """One change of the cells of a CSV with a header: of a cell, a row or a whole column."""
    action = rng.choice(("cell", "column", "scale", "constant", "lost", "drop_row", "repeat_row", "order", "header"))
    i, k = rng.randrange(1, max(len(rows), 2)), rng.randrange(len(rows[0]))
    if len(rows) < 3 or any(len(row) != len(rows[0]) for row in rows):
        return
    body = rows[1:]
    if action == "cell":
        rows[i][k] = rng.choice(ODD_CELLS)
    elif action == "column":
        for row in rows:
            row.pop(k)
    elif action == "scale":
        factor = rng.choice([-1.0, 0.0, 1e-3, 0.1, 2.0, 57.3, 1e3, 1e8])
        for row in body:
            row[k] = _scaled(row[k], factor)
    elif action == "constant":
        for row in body:
            row[k] = body[0][k]
    elif action == "lost":
        share, columns = rng.choice([0.1, 0.5, 0.99, 1.0]), range(3, len(rows[0]))
        for row in body:
            if rng.random() < share:
                for c in columns:
                    row[c] = ""
    elif action == "drop_row":
        del rows[i : i + rng.choice([1, 10, len(rows)])]
    elif action == "repeat_row":
        rows.insert(i, list(rows[i]))
    elif action == "order":
        rows[1:] = rng.choice([body[::-1], rng.sample(body, len(body))])
    else:
        other = rng.randrange(len(rows[0]))
        rows[0][k], rows[0][other] = rows[0][other], rows[0][k]


def _scaled(cell: str, factor: float) -> str:
    try:
        return repr(float(cell) * factor)
    except ValueError:
        return cell


class Mutant(NamedTuple):
    """Which file of which set is damaged, how ("text" or "structure"), and the random number of each change."""

    source: int
    file: str
    how: str
    changes: tuple[int, ...]

    def files(self, sources: Sequence[Files]) -> dict[str, bytes]:
        """The set of files with the damage."""
        files = dict(sources[self.source])
        raw = files[self.file]
        if self.how == "text":
            for change in self.changes:
                raw = changed_bytes(raw, random.Random(change))
            files[self.file] = raw
        else:
            files[self.file] = _restructured(self.file, raw, self.changes)
        return files

    def smaller(self) -> Iterator[Mutant]:
        """The same with fewer changes, fewest first."""
        for count in range(1, len(self.changes)):
            for changes in combinations(self.changes, count):
                yield self._replace(changes=changes)


def mutant(name: str, sources: Sequence[Files]) -> Mutant:
    """The mutant of that name."""
    rng = random.Random(name)
    source = rng.randrange(len(sources))
    file = rng.choice(sorted(sources[source]))
    changes = tuple(rng.getrandbits(48) for _ in range(rng.randint(1, MOST_CHANGES)))
    return Mutant(source, file, rng.choice(("text", "structure")), changes)


def _restructured(file: str, raw: bytes, changes: Sequence[int]) -> bytes:
    text = raw.decode()
    if file.endswith(".csv"):
        rows = [line.split(",") for line in text.splitlines()]
        for change in changes:
            change_table(rows, random.Random(change))
        return "\n".join(map(",".join, rows)).encode()
    if file.endswith(".json"):
        return json.dumps(_changed(json.loads(text), changes)).encode()
    yaml, out = YAML(typ="safe"), io.BytesIO()
    yaml.dump(_changed(yaml.load(text), changes), out)
    return out.getvalue()


def _changed(data: Any, changes: Sequence[int]) -> Any:
    for change in changes:
        change_data(data, random.Random(change))
    return data
