"""Hunt for files that end otherwise than with a result or one clear message.

    python -m tests.hunt.files --scenarios 5000 --experiments 2000 --diagnoses 500 --seed 1
    python -m tests.hunt.files --repeat scenario/1/17

The files are read in a process of its own, which is stopped when a file takes too long. A failure is printed with its
name, the smallest set of its changes that still fails, and the traceback."""

import argparse
import sys
from collections import Counter
from collections.abc import Callable, Sequence
from functools import partial
from time import perf_counter
from typing import NamedTuple

from tests.hunt.answering import Answering
from tests.hunt.mutations import Mutant, mutant
from tests.hunt.trials import FAILED, HANG, KINDS, REFUSED, Outcome, commanded, tried
from tests.hunt.valid_files import Files

FAILURES = (FAILED, HANG)
REPORT_EVERY = 500
LIMIT_SECONDS = 30.0  # processor time of one file
# one in so many files is used, not only read; and one in so many is also given to the command
USED_EVERY = {"scenario": 50, "experiment": 1, "diagnosis": 2}
COMMAND_EVERY = {"scenario": 250, "experiment": 100, "diagnosis": 25}


class Failure(NamedTuple):
    """A failing mutant with its name, made as small as it still fails."""

    name: str
    mutant: Mutant
    outcome: Outcome


class Reader(Answering):
    """Reads files of one kind in a process of its own."""

    def __init__(self, kind: str) -> None:
        super().__init__(partial(_reading, kind), LIMIT_SECONDS)

    def outcome(self, damaged: Mutant, use: bool) -> Outcome:
        """What becomes of a mutant."""
        try:
            return self((damaged, use))
        except TimeoutError as error:
            return Outcome(HANG, str(error))
        except (EOFError, OSError):
            return Outcome(FAILED, "the process ended")


def _reading(kind: str) -> Callable[[tuple[Mutant, bool]], Outcome]:
    sources = KINDS[kind].sources()
    tried(kind, sources[0], True)  # compiles
    return lambda given: tried(kind, given[0].files(sources), given[1])


def hunt(kind: str, count: int, seed: int, read_only: bool) -> Counter[str]:
    """Number of each outcome of `count` mutants, those of the command as "command: ..."; prints each failure.

    `read_only`: no file is used, and none is given to the command."""
    sources, reader = KINDS[kind].sources(), Reader(kind)
    counts: Counter[str] = Counter()
    for number in range(count):
        name = f"{kind}/{seed}/{number}"
        damaged, use = mutant(name, sources), not read_only and number % USED_EVERY[kind] == 0
        outcome = reader.outcome(damaged, use)
        counts[outcome.what] += 1
        if outcome.what in FAILURES:
            show(Failure(name, *_smallest(reader, damaged, outcome, use)), sources)
        # a diagnosis that is accepted would be fitted, which takes minutes
        elif not read_only and number % COMMAND_EVERY[kind] == 0 and (kind != "experiment" or outcome.what == REFUSED):
            outcome = commanded(kind, damaged.files(sources))
            counts[f"command: {outcome.what}"] += 1
            if outcome.what in FAILURES:
                show(Failure(name, damaged, outcome), sources)
        if number % REPORT_EVERY == REPORT_EVERY - 1:
            print(f"{kind} {number + 1}: {dict(counts)}", flush=True)
    reader.close()
    return counts


def _smallest(reader: Reader, damaged: Mutant, outcome: Outcome, use: bool) -> tuple[Mutant, Outcome]:
    """The mutant with the fewest changes that ends in the same way; for a hang, which costs time, with one or all."""
    for fewer in damaged.smaller():
        if outcome.what == HANG and len(fewer.changes) > 1:
            break
        again = reader.outcome(fewer, use)
        if again.what == outcome.what:
            return fewer, again
    return damaged, outcome


def show(failure: Failure, sources: Sequence[Files]) -> None:
    """Print a failure and the changed lines of its file."""
    name, damaged, outcome = failure
    before, after = sources[damaged.source][damaged.file], damaged.files(sources)[damaged.file]
    old = set(before.splitlines())
    lines = [line[:300] for line in after.splitlines() if line not in old][:5]
    print(f"\n{name}: {outcome.what}; {damaged.file} (set {damaged.source}), {damaged.how}, {damaged.changes}")
    print(*(f"  | {line!r}" for line in lines), outcome.text.rstrip()[-1500:], sep="\n", flush=True)


def repeat(name: str) -> Outcome:
    """Try the mutant of that name in this process and print its file."""
    kind = name.split("/")[0]
    sources = KINDS[kind].sources()
    damaged = mutant(name, sources)
    outcome = tried(kind, damaged.files(sources), True)
    show(Failure(name, damaged, outcome), sources)
    return outcome


def main() -> None:
    """Hunt, print the failures and a table; exit code 1 if there is a failure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for option in ("scenarios", "experiments", "diagnoses"):
        parser.add_argument(f"--{option}", type=int, default=0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--read-only", action="store_true", help="faster: no runs, predictions and commands")
    parser.add_argument("--repeat", metavar="NAME")
    given = parser.parse_args()
    if given.repeat:
        sys.exit(repeat(given.repeat).what == FAILED)
    rows = []
    for kind, count in zip(KINDS, (given.scenarios, given.experiments, given.diagnoses), strict=True):
        if not count:
            continue
        begin = perf_counter()
        counts = hunt(kind, count, given.seed, given.read_only)
        rows.append((kind, count, f"{count / (perf_counter() - begin):.0f}/s", counts))
    print("\n" + "\n".join(f"{kind:12} {count:6} {rate:>6}  {dict(counts)}" for kind, count, rate, counts in rows))
    failed = any(FAILED in outcome or HANG in outcome for *_, counts in rows for outcome in counts)
    sys.exit(failed)


if __name__ == "__main__":
    main()
