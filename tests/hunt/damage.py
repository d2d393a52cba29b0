"""Damaged files of one kind: which file of a set is changed, in its text or its structure, and by which changes.

A mutant is named by a text, `kind/seed/number`, which repeats it. Every change has a random number of its own, so that
a mutant can be made again with fewer changes.
"""

from __future__ import annotations

import io
import json
import random
from collections.abc import Iterator, Sequence
from itertools import combinations
from typing import Any, NamedTuple

from ruamel.yaml import YAML

from tests.hunt.mutations import change_data, change_table, changed_bytes
from tests.hunt.valid_files import Files

MOST_CHANGES = 4


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
