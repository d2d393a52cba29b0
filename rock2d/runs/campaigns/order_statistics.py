"""Exact values of given ranks among many numbers, of which few are in memory.

A number is read as an unsigned integer of 64 bits with the same order, its key. A count of all numbers by the leading
digit of their keys, 16 bits, tells the leading digit of each sought number. What shares it is a small part of all
numbers, which a pass over them collects; where it is too much, a pass counts the next digit.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np

Array = np.ndarray

KEY_BITS, DIGIT_BITS = 64, 16
DIGITS = 1 << DIGIT_BITS
MOST_COLLECTED = 1 << 22  # numbers in memory, 32 MB
_SIGN = np.int64(-1 << 63)


def leading_digits(numbers: Array) -> Array:
    """(n,) int64 in [0, DIGITS) of finite numbers."""
    return (_keys(numbers) >> np.uint64(KEY_BITS - DIGIT_BITS)).view(np.int64)


class OrderStatistics:
    """Numbers of given ranks, from 0 in ascending order; `values` gives them once nothing is `open`.

    leading : (DIGITS,) how many of all numbers have each leading digit

    All numbers, in parts and in any order, go through `add`; then `narrow` is called. As often as it takes, see `open`.
    """

    def __init__(self, ranks: Sequence[int], leading: Array) -> None:
        self._ranks = list(ranks)
        self._within = list(ranks)  # rank among the numbers that share the settled bits
        self._settled = [0] * len(ranks)  # leading bits of the key that is sought
        self._open_bits = KEY_BITS
        self._counts = {0: leading}  # settled bits -> numbers by their next digit
        self._collected: dict[int, list[Array]] = {}  # settled bits -> keys
        self.narrow()

    @property
    def open(self) -> bool:
        """Whether the values are not known yet."""
        return self._open_bits > 0

    @property
    def candidates(self) -> int:
        """How many numbers share the settled bits of one that is sought."""
        return sum(self._shared.values())

    def add(self, numbers: Array, collect: bool) -> None:
        """Collect the candidates among finite numbers, or count their next digits."""
        keys, shift = _keys(numbers), np.uint64(self._open_bits)
        leading = keys >> shift
        for settled in self._shared:
            own = keys[leading == np.uint64(settled)]
            if collect:
                self._collected.setdefault(settled, []).append(own)
                continue
            counts = self._counts.setdefault(settled, np.zeros(DIGITS, np.int64))
            digits = (own >> np.uint64(self._open_bits - DIGIT_BITS)) & np.uint64(DIGITS - 1)
            np.add.at(counts, digits.view(np.int64), 1)

    def narrow(self) -> None:
        """Take in what all numbers gave."""
        if self._collected:
            for settled, parts in self._collected.items():
                own = [i for i, leading in enumerate(self._settled) if leading == settled]
                ranked = np.partition(np.concatenate(parts), [self._within[i] for i in own])
                for i in own:
                    self._settled[i] = int(ranked[self._within[i]])
            self._collected, self._open_bits = {}, 0
            return
        self._shared: dict[int, int] = {}
        for i, settled in enumerate(self._settled):
            counts = self._counts[settled]
            below = np.cumsum(counts)
            digit = int(np.searchsorted(below, self._within[i], side="right"))
            self._within[i] -= int(below[digit] - counts[digit])
            self._settled[i] = settled << DIGIT_BITS | digit
            self._shared[self._settled[i]] = int(counts[digit])
        self._counts = {}
        self._open_bits -= DIGIT_BITS

    def values(self) -> dict[int, float]:
        """Rank -> number."""
        numbers = _numbers(np.array(self._settled, np.uint64))
        return dict(zip(self._ranks, numbers.tolist(), strict=True))


def find_order_statistics(
    sought: Mapping[Any, OrderStatistics],
    parts: Callable[[], Iterable[Mapping[Any, Array]]],
    most_collected: int | None = None,
) -> None:
    """Find the values of several sets of numbers, of which `parts` gives all, again in each pass.

    most_collected : numbers in memory; default MOST_COLLECTED
    """
    most = MOST_COLLECTED if most_collected is None else most_collected
    while any(own.open for own in sought.values()):
        collect = sum(own.candidates for own in sought.values()) <= most
        for part in parts():
            for key, own in sought.items():
                own.add(part[key], collect)
        for own in sought.values():
            own.narrow()


def _keys(numbers: Array) -> Array:
    bits = (numbers + 0.0).view(np.int64)  # + 0.0: minus zero is zero
    return (bits ^ (bits >> np.int64(63) | _SIGN)).view(np.uint64)


def _numbers(keys: Array) -> Array:
    bits = keys.view(np.int64)
    return np.where(bits < 0, bits ^ _SIGN, ~bits).view(np.float64)
