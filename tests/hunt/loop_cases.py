"""Random loops: kind, scenario, engine, number of releases, seed, and what is odd about the files."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

SMALL = {  # scenario -> time limit in s, frames per second, position noise in m
    "paper_setup": (0.7, 400.0, 2e-4),
    "flat_floor": (0.9, 300.0, 2e-4),
    "real_squares": (0.9, 300.0, 2e-4),
    "slope_embankment": (6.0, 50.0, 0.01),
    "design_site": (6.0, 50.0, 0.01),
    "rough_slope": (6.0, 50.0, 0.01),
    "tschamut": (5.0, 60.0, 0.005),
}
ANGLE_NOISE_RAD = 0.02
BENCH = ("paper_setup", "flat_floor")  # whose films are small enough to be tracked
ENGINES = ("batch", "pymunk", "point_mass")
FORMATS = ("tracker", "kinovea", "dltdv", "deeplabcut")
SURVEYS = ("table", "dxf", "terrain")
FEWEST, MOST = 6, 12  # releases in all

NO_NOISE, NO_POSITION_NOISE, NO_ANGLE_NOISE = "no_noise", "no_position_noise", "no_angle_noise"
NO_ANGLES, ONE_BLOCK, ONE_RELEASE, FEW_RELEASES = "no_angles", "one_block", "one_release", "few_releases"
NO_IMPACT, LOST_FRAMES = "no_impact", "lost_frames"
NO_TANGENTIAL, NEVER_SLIPS = "no_tangential", "never_slips"
OTHER_DIAGNOSIS = "other_diagnosis"  # compare two films, not one with itself
QUIRKS = (
    NO_NOISE, NO_POSITION_NOISE, NO_ANGLE_NOISE, NO_ANGLES, ONE_BLOCK, ONE_RELEASE, FEW_RELEASES, NO_IMPACT,
    LOST_FRAMES, NO_TANGENTIAL, NEVER_SLIPS, OTHER_DIAGNOSIS,
)  # fmt: skip
REFUSED_SOON, RARE = (ONE_RELEASE, NO_IMPACT), 0.3  # such films can hardly be diagnosed: fewer of them
KIND_SHARES = {"run": 0.55, "table": 0.1, "import": 0.1, "film": 0.05, "profile": 0.1, "outside": 0.1}
SHARE_PLAIN = 0.25  # share of the loops without a quirk


@dataclass(frozen=True)
class Loop:
    """What a user does: a kind of loop, with its files.

    Attributes
    ----------
    scenario : a shipped scenario; of `import` also the format of the files, of `profile` that of the survey, of
        `outside` the cause
    releases : in all
    quirks : some of `QUIRKS`"""

    kind: str
    scenario: str
    engine: str
    releases: int
    seed: int
    quirks: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """All of it in one word, from which `named` makes it again."""
        odd = "+".join(self.quirks) or "plain"
        return f"{self.kind}/{self.scenario}/{self.engine}/{self.releases}/{self.seed}/{odd}"

    def smaller(self) -> Iterator[Loop]:
        """Loops with less in them, simplest first."""
        if len(self.quirks) > 1:
            yield replace(self, quirks=())
        for quirk in self.quirks:
            yield replace(self, quirks=tuple(own for own in self.quirks if own != quirk))
        if self.kind in ("run", "table") and self.scenario != "flat_floor":
            yield replace(self, scenario="flat_floor")
        if self.engine != "batch":
            yield replace(self, engine="batch")


def named(name: str) -> Loop:
    """The loop of that name."""
    kind, scenario, engine, releases, seed, odd = name.split("/")
    quirks = () if odd == "plain" else tuple(odd.split("+"))
    return Loop(kind, scenario, engine, int(releases), int(seed), quirks)


def random_loop(seed: int, number: int) -> Loop:
    """Loop `number` of a hunt."""
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(number,)))
    kind = str(rng.choice(list(KIND_SHARES), p=list(KIND_SHARES.values())))
    scenario, engine = str(rng.choice(list(SMALL))), str(rng.choice(ENGINES, p=[0.5, 0.3, 0.2]))
    quirks = _random_quirks(rng)
    if kind in ("table", "import", "film"):
        scenario, engine = str(rng.choice(BENCH)), str(rng.choice(ENGINES[:2]))
    if kind == "film":
        scenario = "paper_setup"
    if kind == "import":
        scenario += f":{rng.choice(FORMATS)}"
    if kind == "profile":
        scenario, engine, quirks = str(rng.choice(SURVEYS)), str(rng.choice(["batch", "point_mass"])), ()
    if kind == "outside":
        from rock2d.blind import reality

        scenario, engine, quirks = str(rng.choice(list(reality.OUTSIDE))), "batch", _of_a_film(quirks)
    return Loop(kind, scenario, engine, int(rng.integers(FEWEST, MOST + 1)), int(rng.integers(1e6)), quirks)


def _random_quirks(rng: np.random.Generator) -> tuple[str, ...]:
    count = 0 if rng.random() < SHARE_PLAIN else int(rng.integers(1, 4))
    weights = np.array([RARE if quirk in REFUSED_SOON else 1.0 for quirk in QUIRKS])
    drawn = rng.choice(QUIRKS, count, replace=False, p=weights / weights.sum())
    return tuple(sorted(map(str, drawn), key=QUIRKS.index))


def _of_a_film(quirks: tuple[str, ...]) -> tuple[str, ...]:
    """Those that change a film that is there."""
    return tuple(own for own in quirks if own in (NO_ANGLES, LOST_FRAMES))
