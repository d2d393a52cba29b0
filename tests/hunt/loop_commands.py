"""Commands as a user types them, one after the other in one folder, each held to what every command must do."""

import json
import re
import traceback
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

import numpy as np
import pandas as pd
from click.testing import CliRunner

from rock2d.cli import cli
from rock2d.errors import InputError
from rock2d.files.experiment import load_experiment
from tests.hunt.loop_cases import NEVER_SLIPS, NO_ANGLES, NO_IMPACT, Loop
from tests.hunt.loop_files import unnumbered

CUT_SHORT = 4  # exit code: releases ran out of time, or no size meets the target
SAID_OF_CUT_SHORT = ("NOT RESOLVED", "meets the target")
NOT_A_NUMBER = re.compile(r"(?<![\w.])[-+]?(nan|inf|infinity)(?![\w.])", re.IGNORECASE)
SEEN_FLIGHT_FRAMES = 12  # a flight of so many frames must be found
FEWEST_RELEASES, FEWEST_REBOUNDS = 6, 15  # that a diagnosis says that it needs
MOST_IN_GROUND = 0.2  # share of the frames with the centre in the ground that no diagnosis explains


class Fault(NamedTuple):
    """What breaks a loop: a cause in a few words, the same for the same fault; the facts; the commands to it."""

    cause: str
    facts: str
    commands: int


class BrokenError(Exception):
    """The loop cannot go on; what breaks it is the last of the chain's faults."""


class RefusedError(Exception):
    """A command refuses its files, and what it says of them is true: here the loop ends."""


@dataclass
class Film:
    """What is known of a film beyond its files, from the run that it is made of."""

    folder: Path
    releases: int
    impacts: int
    rebounds: int
    share_in_ground: float


@dataclass
class Chain:
    """The commands of a loop in its folder."""

    folder: Path
    loop: Loop
    commands: list[str] = field(default_factory=list)
    film: Film | None = None
    faults: list[Fault] = field(default_factory=list)

    def note(self, cause: str, facts: str = "") -> None:
        """A fault after which the loop goes on."""
        self.faults.append(Fault(cause, facts, len(self.commands)))

    def stop(self, cause: str, facts: str = "") -> NoReturn:
        """A fault with which the loop ends."""
        self.note(cause, facts)
        raise BrokenError(cause)

    def __call__(self, *words: object) -> str:
        """Run `rock2d WORDS`; what it prints."""
        arguments = [str(word) for word in words]
        self.commands.append("rock2d " + " ".join(arguments).replace(f"{self.folder}/", ""))
        before = self._files()
        with warnings.catch_warnings(record=True) as warned:
            warnings.simplefilter("always")
            done = CliRunner().invoke(cli, arguments, standalone_mode=False)
        name, error = arguments[0], done.exception
        for warning in warned:
            if issubclass(warning.category, RuntimeWarning):
                place = f"{Path(warning.filename).name}:{warning.lineno}"
                self.note(f"{name}: RuntimeWarning", f"{place}: {warning.message}")
        if isinstance(error, InputError):
            self._judge(name, error, before)
        if error is not None and not isinstance(error, SystemExit):
            frame = traceback.extract_tb(error.__traceback__)[-1]
            text = "".join(traceback.format_exception(error))
            self.stop(f"{name}: {type(error).__name__} in {Path(frame.filename).name}", text)
        hidden = [path.name for path in self.folder.rglob(".*")]
        if hidden:
            self.note(f"{name}: half-written output", str(hidden))
        cut_short = done.exit_code == CUT_SHORT and any(said in done.output for said in SAID_OF_CUT_SHORT)
        if done.exit_code != 0 and not cut_short:
            self.stop(f"{name}: exit code {done.exit_code}", done.output)
        if found := NOT_A_NUMBER.search(done.output):
            line = next(text for text in done.output.splitlines() if NOT_A_NUMBER.search(text))
            self.note(f"{name} prints {found.group().lower()}", line)
        for path in sorted(self._files().items() - before.items()):
            if fault := unnumbered(path[0]):
                self.note(f"{name} writes {fault[0]}", fault[1])
        return done.output

    def _files(self) -> dict[Path, int]:
        return {path: path.stat().st_mtime_ns for path in self.folder.rglob("*") if path.is_file()}

    def _judge(self, name: str, error: InputError, before: dict[Path, int]) -> None:
        """Raise `RefusedError` if the refusal is one of `TRUE_REFUSALS` and true."""
        if name != "diagnose" and (new := self._files().keys() - before.keys()):
            self.stop(f"{name}: refuses after it has written", ", ".join(sorted(map(str, new))))
        if any(code == error.code and true(self) for command, code, true in TRUE_REFUSALS if command == name):
            raise RefusedError(f"{name}: {error.code}")
        words = re.sub(r"[-+]?\d[\d.e+-]*", "#", error.message.replace(f"{self.folder}/", ""))
        self.stop(f"{name} refuses ({error.code}): {words[:90]}", str(error))

    def fault_codes(self) -> set[str]:
        """Why the last diagnosis was none, in codes."""
        file = self.folder / "diagnosis" / "diagnosis.json"
        content = json.loads(file.read_text()) if file.is_file() else {"sanity": {"fault_codes": []}}
        return set(content["sanity"]["fault_codes"])


def _cannot_be_diagnosed(chain: Chain) -> bool:
    """Every fault that the sanity checks found is one of the film."""
    film, faults = chain.film, chain.fault_codes()
    assert film is not None
    true = {
        "few_releases": film.releases < FEWEST_RELEASES,
        # point masses touch the ground with their centres: low bounces lie below it for a block of some size
        "few_impacts": film.rebounds < FEWEST_REBOUNDS or chain.loop.engine == "point_mass",
        "constant_angle": chain.loop.engine == "point_mass" or film.impacts == 0,
        "below_ground": film.share_in_ground > MOST_IN_GROUND,
    }
    return bool(faults) and all(true.get(fault, False) for fault in faults)


def _nothing_to_predict(chain: Chain) -> bool:
    """No law was fitted, or no block touches the ground."""
    assert chain.film is not None
    return bool(chain.fault_codes()) or chain.film.impacts == 0 or NO_IMPACT in chain.loop.quirks


def _above_90_deg(chain: Chain) -> bool:
    """A friction angle of 90° that the scenario multiplies by a factor that is not known."""
    return NEVER_SLIPS in chain.loop.quirks and chain.loop.scenario == "design_site"


def _without_rows(chain: Chain) -> bool:
    """A table without an impact, or a film of blocks that are not round and have no angle in any frame."""
    rows = pd.read_csv(chain.folder / "table" / "impacts.csv") if chain.loop.kind == "table" else None
    return rows.empty if rows is not None else NO_ANGLES in chain.loop.quirks


# command, code, and the condition under which the refusal is true
TRUE_REFUSALS: tuple[tuple[str, str, Callable[[Chain], bool]], ...] = (
    ("run", "bad_value", _above_90_deg),
    ("diagnose", "not_diagnosed", _cannot_be_diagnosed),
    ("diagnose", "empty", _without_rows),
    ("predict", "bad_value", _nothing_to_predict),
)


def film_of(folder: Path, impacts: pd.DataFrame, fps: float) -> Film:
    """The film in a folder; `impacts` are those of the run that it is made of: release, t_s, t_after_s."""
    frames = pd.read_csv(folder / "trajectories.csv").dropna(subset=["x_m"])
    ends = frames.groupby("release")["t_s"].max()
    seen = impacts[impacts["release"].isin(ends.index)]
    seen = seen[seen["t_s"] < ends.loc[seen["release"]].to_numpy()]
    following = seen.groupby("release")["t_s"].shift(-1).fillna(seen["release"].map(ends))
    flown = (following - seen["t_after_s"]) * fps >= SEEN_FLIGHT_FRAMES
    ground = load_experiment(folder).cross_section
    inside = float(ground.covers(frames[["x_m", "y_m"]].to_numpy()).mean())
    return Film(folder, len(ends), len(seen), int(np.count_nonzero(flown)), inside)


def read(path: Path) -> Any:
    """A JSON file."""
    return json.loads(path.read_text(encoding="utf-8"))
