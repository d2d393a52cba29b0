"""The hunt for loops that break: `python -m tests.hunt.loops --loops 300 --seed 1 --workers 2`.

A loop is a chain of commands as a user types them, on the files that the commands before wrote, to the last step. It
breaks at a traceback, a warning of numpy, something that is no number, a half-written output, a refusal that is not one
of `loop_commands.TRUE_REFUSALS`, a page that differs from its tables, or a prediction that breaks what
`loop_predictions` demands. `--repeat NAME` goes one loop again and shows its commands."""

import argparse
import itertools
import os
import sys
import tempfile
import traceback
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from multiprocessing.pool import ThreadPool
from pathlib import Path
from time import perf_counter
from typing import NamedTuple

from rock2d.errors import counted
from tests.hunt.answering import Answering
from tests.hunt.loop_cases import KIND_SHARES, Loop, named, random_loop
from tests.hunt.loop_commands import Fault

WHOLE, BROKEN, REFUSED = "whole", "broken", "refused"
LIMIT_SECONDS = 150.0  # processor time of one loop
MOST_TEXT = 1500
COARSE_DPI = 40
MOST_SHRUNK = 4  # loops tried to make one smaller


class Outcome(NamedTuple):
    """WHOLE, BROKEN or REFUSED; what is refused; the faults; the commands; seconds."""

    what: str
    refusal: str = ""
    faults: tuple[Fault, ...] = ()
    commands: tuple[str, ...] = ()
    seconds: float = 0.0

    def of(self, cause: str) -> Fault | None:
        """The first fault of this cause."""
        return next((fault for fault in self.faults if fault.cause == cause), None)


def gone(loop: Loop, folder: Path) -> Outcome:
    """Go a loop in an empty folder."""
    from tests.hunt.loop_commands import BrokenError, Chain, RefusedError
    from tests.hunt.loop_kinds import KINDS

    chain, begin, refusal = Chain(folder, loop), perf_counter(), ""
    try:
        KINDS[loop.kind](chain)
    except RefusedError as error:
        refusal = str(error)
    except BrokenError:
        pass
    except Exception as error:  # a fault of the hunt itself, or of files that it cannot read
        chain.note(f"{type(error).__name__} in the loop", traceback.format_exc())
    what = BROKEN if chain.faults else REFUSED if refusal else WHOLE
    faults = tuple(Fault(cause, facts[-MOST_TEXT:], count) for cause, facts, count in chain.faults)
    return Outcome(what, refusal, faults, tuple(chain.commands), perf_counter() - begin)


def _going() -> Callable[[Loop], tuple]:
    """Goes the loops that come, each in a folder of its own."""
    import matplotlib
    import numba

    from rock2d.graphics.figure_style import save_figure

    matplotlib.use("Agg")
    save_figure.__defaults__ = (COARSE_DPI,)  # nobody looks at these pictures, and drawing is half of a loop
    numba.set_num_threads(1)
    with open(os.devnull, "w") as nothing:
        os.dup2(nothing.fileno(), 2)

    def go(loop: Loop) -> tuple:
        with tempfile.TemporaryDirectory(prefix="loop_") as name:
            return tuple(gone(loop, Path(name).resolve()))

    return go


def all_gone(loops: Sequence[Loop], workers: Sequence[Answering]) -> Iterator[tuple[Loop, Outcome]]:
    """The loops with their outcomes, in the order in which they end."""
    idle = list(workers)

    def go(loop: Loop) -> tuple[Loop, Outcome]:
        worker = idle.pop()
        try:
            return loop, Outcome(*worker(loop))
        except (EOFError, OSError) as error:
            cause = str(error) if isinstance(error, TimeoutError) else "the process ended"
            return loop, Outcome(BROKEN, faults=(Fault(cause, "", 0),))
        finally:
            idle.append(worker)

    with ThreadPool(len(workers)) as pool:
        yield from pool.imap_unordered(go, loops)


def shortest(loop: Loop, outcome: Outcome, cause: str, worker: Answering) -> tuple[Loop, Outcome]:
    """The loop with the least in it that breaks for this cause, of a few that are tried."""
    tried, smaller = 0, True
    while smaller and tried < MOST_SHRUNK:
        smaller = False
        for fewer in itertools.islice(loop.smaller(), MOST_SHRUNK - tried):
            tried += 1
            _, again = next(all_gone([fewer], [worker]))
            if again.of(cause):
                loop, outcome, smaller = fewer, again, True
                break
    return loop, outcome


def show(loop: Loop, outcome: Outcome, fault: Fault) -> None:
    """Print a fault with the commands that lead to it."""
    print(f"\n{loop.name}: {fault.cause}", *(f"  $ {c}" for c in outcome.commands[: fault.commands]), sep="\n")
    print(*(f"  | {line}" for line in fault.facts.splitlines()), sep="\n", flush=True)


def hunt(count: int, seed: int, workers: int, kinds: Sequence[str]) -> int:
    """Go `count` random loops and print what breaks; the number of broken ones."""
    loops = [loop for i in range(count) if (loop := random_loop(seed, i)).kind in kinds]
    crew = [Answering(_going, LIMIT_SECONDS) for _ in range(workers)]
    counts: Counter[tuple[str, str]] = Counter()
    refused: Counter[str] = Counter()
    broken: dict[str, list[tuple[Loop, Outcome]]] = {}
    begin = perf_counter()
    for number, (loop, outcome) in enumerate(all_gone(loops, crew), 1):
        counts[loop.kind, outcome.what] += 1
        causes = list(dict.fromkeys(fault.cause for fault in outcome.faults))
        said = "; ".join(causes) or outcome.refusal
        print(f"{number:4d} {outcome.seconds:5.1f} s {outcome.what:8s} {loop.name} {said}", flush=True)
        if outcome.what == REFUSED:
            refused[outcome.refusal] += 1
        for cause in causes:
            broken.setdefault(cause, []).append((loop, outcome))
    print(f"\n{'kind':10s}{'made':>6s}{'broken':>8s}{'refused':>9s}")
    for kind in kinds:
        made = sum(counts[kind, what] for what in (WHOLE, BROKEN, REFUSED))
        print(f"{kind:10s}{made:6d}{counts[kind, BROKEN]:8d}{counts[kind, REFUSED]:9d}")
    print(f"{len(loops)} loops in {perf_counter() - begin:.0f} s; true refusals: {dict(refused)}")
    for cause, found in sorted(broken.items(), key=lambda item: -len(item[1])):
        loop, outcome, fault = _least(cause, found, crew[0])
        print(f"\n{len(found)} of: {cause}; the shortest takes {counted(fault.commands, 'command')}:", end="")
        show(loop, outcome, fault)
    for worker in crew:
        worker.close()
    return sum(counts[kind, BROKEN] for kind in kinds)


def _least(cause: str, found: Sequence[tuple[Loop, Outcome]], worker: Answering) -> tuple[Loop, Outcome, Fault]:
    """The smallest loop that breaks for this cause, of those found and of smaller ones."""

    def size(one: tuple[Loop, Outcome]) -> tuple[int, int]:
        fault = one[1].of(cause)
        return (fault.commands if fault else 0, len(one[0].quirks))

    loop, outcome = shortest(*min(found, key=size), cause, worker)
    fault = outcome.of(cause)
    assert fault is not None
    return loop, outcome, fault


def repeat(name: str, folder: Path | None) -> int:
    """Go the loop of that name in this process; 1 if it breaks. Its files stay in `folder`."""
    with tempfile.TemporaryDirectory(prefix="loop_") as other:
        place = folder or Path(other)
        place.mkdir(parents=True, exist_ok=True)
        outcome = gone(named(name), place.resolve())
    print(outcome.what, outcome.refusal, *(f"  $ {command}" for command in outcome.commands), sep="\n")
    for fault in outcome.faults:
        show(named(name), outcome, fault)
    return int(outcome.what == BROKEN)


def main() -> None:
    """Hunt; exit code 1 if a loop breaks."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--loops", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--kinds", nargs="*", choices=list(KIND_SHARES), default=list(KIND_SHARES))
    parser.add_argument("--repeat", metavar="NAME")
    parser.add_argument("--folder", type=Path, help="of the files of the repeated loop, which stay")
    given = parser.parse_args()
    if given.repeat:
        sys.exit(repeat(given.repeat, given.folder))
    sys.exit(hunt(given.loops, given.seed, given.workers, given.kinds) > 0)


if __name__ == "__main__":
    main()
