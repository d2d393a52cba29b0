"""Random damage to valid files: what a tired hand, a wrong export or a broken disk would do."""

from __future__ import annotations

import copy
import random
from typing import Any

ODD = [
    None,
    True,
    "0.1",
    "",
    "x",
    -1,
    0,
    10**400,
    1e300,
    1e-300,
    float("nan"),
    float("inf"),
    [],
    {},
    [[]],
    [1, "a"],
]

JUNK = [
    *[
        b"\t",
        b"\n",
        b"\r",
        b"\0",
        b'"',
        b"'",
        b",",
        b": ",
        b"- ",
        b"? ",
        b"|",
        b"{",
        b"]",
        b"#",
        b"nan",
        b"\xff",
    ],
    *[b"&a *a", b"!!python/name:os", b"%YAML 1.1\n---\n", b"\n---\n", b"\xe2\x80\xa8"],
]


def _places(node: Any, found: list[tuple[Any, Any]]) -> list[tuple[Any, Any]]:
    for key in list(node) if isinstance(node, dict) else range(len(node)) if isinstance(node, list) else ():
        found.append((node, key))
        _places(node[key], found)
    return found


def mutate_data(data: Any, rng: random.Random) -> Any:
    """Rename, delete, swap, nest or replace something in nested dicts and lists; changes `data`."""
    odd = copy.deepcopy(ODD)
    for _ in range(rng.randint(1, 3)):
        places = _places(data, [])
        if not places:
            return data
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
            node[key] = -node[key] * rng.choice([1, 1e6, 1e-9])
        else:
            node[key] = rng.choice(odd)
    return data


def mutate_bytes(raw: bytes, rng: random.Random) -> bytes:
    """Flip, cut, repeat, drop or insert bytes."""
    for _ in range(rng.randint(1, 4)):
        i = rng.randrange(len(raw) + 1)
        action = rng.choice(("flip", "cut", "insert", "repeat", "drop"))
        if action == "flip" and i < len(raw):
            raw = raw[:i] + bytes([raw[i] ^ (1 << rng.randrange(8))]) + raw[i + 1 :]
        elif action == "cut" and rng.random() < 0.3:
            raw = raw[:i]
        elif action == "insert":
            junk = rng.choice(JUNK)
            raw = raw[:i] + junk + raw[i:]
        elif action == "repeat":
            raw = raw[:i] + raw[max(0, i - rng.randint(1, 40)) : i] + raw[i:]
        elif action == "drop":
            raw = raw[:i] + raw[i + rng.randint(1, 20) :]
    return raw
