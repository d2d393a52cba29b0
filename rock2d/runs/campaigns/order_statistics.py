"""Exact order statistics of many numbers with little memory.

The key of a number is an unsigned integer of 64 bits with the same order. Counts of all numbers by the leading digit of
their keys (16 bits) give the leading digit of each order statistic. A second pass over the numbers collects the
candidates with this digit; if these are too many, it counts their next digits instead."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from rock2d.arrays import Array

KEY_BITS, DIGIT_BITS = 64, 16
DIGITS = 1 << DIGIT_BITS
MOST_COLLECTED = 1 << 22  # numbers in memory, 32 MB
_SIGN = np.int64(-1 << 63)


def leading_digits(numbers: Array) -> Array:
    """(n,) leading digits of the keys of finite numbers, int64 in [0, DIGITS)."""
    return (_keys(numbers) >> np.uint64(KEY_BITS - DIGIT_BITS)).view(np.int64)


class OrderStatistics:
    """Numbers of given ranks, which count from 0 in ascending order.

    leading : (DIGITS,) counts of all numbers by their leading digits

    While `open`: pass all numbers to `add`, in parts and in any order, then call `narrow`. After that, `values` gives
    the numbers."""

    def __init__(self, ranks: Sequence[int], leading: Array) -> None:
        self._ranks = list(ranks)
        self._within = list(ranks)  # rank among the numbers that share the settled bits
        self._settled = [0] * len(ranks)  # known leading bits of the keys
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
        """Number of candidates: numbers with the settled bits of an order statistic."""
        return sum(self._shared.values())

    def add(self, numbers: Array, collect: bool) -> None:
        """Collect the candidates among finite numbers, or count their next digits."""
        keys, shift = _keys(numbers), np.uint64(self._open_bits)
        leading = keys >> shift
        for settled in self._shared:
            candidates = keys[leading == np.uint64(settled)]
            if collect:
                self._collected.setdefault(settled, []).append(candidates)
                continue
            counts = self._counts.setdefault(settled, np.zeros(DIGITS, np.int64))
            digits = (candidates >> np.uint64(self._open_bits - DIGIT_BITS)) & np.uint64(DIGITS - 1)
            np.add.at(counts, digits.view(np.int64), 1)

    def narrow(self) -> None:
        """Settle further bits from one pass over all numbers."""
        if self._collected:
            for settled, parts in self._collected.items():
                indices = [i for i, leading in enumerate(self._settled) if leading == settled]
                ranked = np.partition(np.concatenate(parts), [self._within[i] for i in indices])
                for i in indices:
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
    """Find the order statistics of several sets of numbers. In each pass, `parts` gives all numbers of all sets.

    most_collected : most numbers in memory; default MOST_COLLECTED"""
    most = MOST_COLLECTED if most_collected is None else most_collected
    while any(statistics.open for statistics in sought.values()):
        collect = sum(statistics.candidates for statistics in sought.values()) <= most
        for part in parts():
            for key, statistics in sought.items():
                statistics.add(part[key], collect)
        for statistics in sought.values():
            statistics.narrow()


def _keys(numbers: Array) -> Array:
    bits = (numbers + 0.0).view(np.int64)  # + 0.0: minus zero is zero
    return (bits ^ (bits >> np.int64(63) | _SIGN)).view(np.uint64)


def _numbers(keys: Array) -> Array:
    bits = keys.view(np.int64)
    return np.where(bits < 0, bits ^ _SIGN, ~bits).view(np.float64)
