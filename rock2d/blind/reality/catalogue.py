"""All causes that can be hidden, found by their files, and the draw of their sizes."""

from importlib import import_module
from pathlib import Path

from rock2d.blind.reality.cause import Cause, Rng, scale_of
from rock2d.blind.reality.data_model import Hidden, World

LEAST_SHARE_OF_STRENGTH = 0.85  # sizes are drawn between this share of `strength` and all of it


def causes_in(package: str, folder: Path) -> dict[str, Cause]:
    """The causes of a package, name -> cause, in the order in which a seed assigns them to cases: the `CAUSES` of its
    modules as they stand there, then each `CAUSE` by the name of its file. Raises ValueError if two share a name."""
    found: dict[str, Cause] = {}
    names = sorted({path.stem for path in folder.glob("*.py")} - {"__init__"})
    modules = {name: import_module(f"{package}.{name}") for name in names}
    for name in sorted(names, key=lambda name: hasattr(modules[name], "CAUSE")):
        own = getattr(modules[name], "CAUSES", None) or {name: modules[name].CAUSE}
        if twice := found.keys() & own.keys():
            raise ValueError(f"two causes of {package} are named {min(twice)}")
        found |= own
    return found


KNOWN = causes_in(f"{__package__}.known", Path(__file__).parent / "known")
OUTSIDE_CAUSES = causes_in(f"{__package__}.outside", Path(__file__).parent / "outside")
CAUSES = {**KNOWN, **OUTSIDE_CAUSES}
FORMS = {name: cause.forms for name, cause in KNOWN.items()}  # number of forms of each effect
OUTSIDE = tuple(OUTSIDE_CAUSES)


def draw_hidden(name: str, form: int, rng: Rng, world: World, strength: float) -> Hidden:
    """A cause of `strength` (0 to 1) times the largest plausible size in this world; the rng draws its sign.

    Raises KeyError for an unknown name, ValueError for a form that does not exist."""
    forms = CAUSES[name].forms
    if not 0 <= form < forms:
        raise ValueError(f"{name} has forms 0 to {forms - 1}, got {form}")
    share = strength * float(rng.uniform(LEAST_SHARE_OF_STRENGTH, 1.0))
    values = CAUSES[name].sizes(form, share, rng, scale_of(world))
    return Hidden(name, form, {key: float(value) for key, value in values.items()})
