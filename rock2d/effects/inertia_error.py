"""The moment of inertia differs from the stated block's."""

from collections.abc import Sequence
from dataclasses import replace

from rock2d.effects.changes import with_blocks
from rock2d.effects.effect import Effect, Parameter
from rock2d.effects.fitted_effect import FittedEffect
from rock2d.scene.world import World


def apply(world: World, values: Sequence[float]) -> World:
    """I true = factor × I stated, for every block."""
    factor = float(values[0])
    return with_blocks(world, lambda block: replace(block, inertia_kg_m2=factor * block.inertia_kg_m2))


def remedy(fitted: FittedEffect) -> str:
    """State the fitted moment of inertia."""
    inertias = {name: block.inertia_kg_m2 for name, block in fitted.setup.blocks.items()}
    stated = ", ".join(f"{name} `inertia: {fitted.values['factor'] * v:.4g}`" for name, v in inertias.items())
    return (
        f"The moment of inertia is {fitted.number('factor')} times the stated one. Set in experiment.yaml: {stated} "
        "(kg m²), and diagnose again. Measure it, for example as a pendulum: are the blocks hollow, cored or of two "
        "materials?"
    )


EFFECT = Effect(
    name="inertia_error",
    summary="the moment of inertia differs from the stated block's: hollow, cored, or not of one material",
    source="definition; a thin shell has 5/3 of a solid ball's, a square frame 2 of a solid square's",
    phase="impact",
    origin="block",
    parameters=(Parameter("factor", "1", 1.0, 0.5, 2.0, "true over stated moment of inertia"),),
    apply=apply,
    remedy=remedy,
)
