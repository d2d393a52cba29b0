"""The acting effects of a diagnosis, applied to the releases of a scenario.

An effect acts if it changes blocks, soil or ground. Effects of the camera concern the film only and do not act. Each
release of a scenario counts as the first of its series."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from rock2d.arrays import Array
from rock2d.effects import catalogue
from rock2d.files.diagnosis_keys import fitted_scale
from rock2d.laws.contact import CONTACT_LAW_COLUMNS
from rock2d.records.columns import POSE_NAMES
from rock2d.scene.blocks import Block
from rock2d.scene.cross_section import CrossSection
from rock2d.scene.rough_ground import Roughness
from rock2d.scene.world import World

if TYPE_CHECKING:
    from rock2d.files.diagnosed_model import FittedModel
    from rock2d.files.experiment import Experiment
    from rock2d.files.scenario import Scenario

ROUGHNESS = "surface_roughness"


@dataclass(frozen=True)
class ActingEffects:
    """The effects of a diagnosed model that act on a site.

    Attributes
    ----------
    model : soil and effects
    blocks : blocks of the scenario
    cross_section : the cross-section of the scenario, without effects
    fitted_scale : see `World`"""

    model: FittedModel
    blocks: Mapping[str, Block]
    cross_section: CrossSection
    gravity_m_s2: float
    fitted_scale: tuple[float, float] | None

    @classmethod
    def of(cls, model: FittedModel, scenario: Scenario) -> ActingEffects:
        """On the site of a scenario."""
        scale = fitted_scale(scenario.diagnosed.blocks) if scenario.diagnosed is not None else None
        return cls(model, scenario.make_blocks(), scenario.make_cross_section(), scenario.gravity_m_s2, scale)

    @cached_property
    def acting(self) -> tuple[str, ...]:
        """Effects that change blocks, soil or ground of a release."""
        known = catalogue()
        return tuple(name for name in self.model.effects if not (known[name].camera or known[name].scatter))

    @property
    def any_acts(self) -> bool:
        """Whether any effect acts."""
        return bool(self.acting or self.roughness())

    def ground(self) -> CrossSection:
        """The cross-section with the effects."""
        return self._with_effects(
            self.blocks, np.zeros((1, len(self.cross_section.zone_names), len(CONTACT_LAW_COLUMNS)))
        ).cross_section

    def roughness(self) -> dict[str, Roughness]:
        """Zone -> roughness by the effect surface_roughness; pieces are as long as the mean size of the blocks."""
        if ROUGHNESS not in self.model.effects:
            return {}
        (sd_rad,) = self.model.values(ROUGHNESS)
        if sd_rad <= 0.0:
            return {}
        roughness = Roughness(sd_rad, float(np.mean([block.size_m for block in self.blocks.values()])))
        return dict.fromkeys(self.cross_section.zone_names, roughness)

    def applied(self, block: Block, parameters: Array) -> tuple[Block, Array]:
        """Block and parameters (zones, columns) of the contact law of a release with the effects.

        The blocks of the scenario determine the changes of the ground, the block of the release its own changes."""
        if not self.acting:
            return block, parameters
        world = self._with_effects(self.blocks, parameters[None])
        if block is not self.blocks[block.name]:
            changed = self._with_effects({**self.blocks, block.name: block}, parameters[None])
            return changed.blocks[block.name], world.contact[0]
        return world.blocks[block.name], world.contact[0]

    def without_change(self) -> list[str]:
        """Acting effects that change nothing on this site, for example an effect of the embankment without one."""
        rows = np.tile([1.0, 2.0, 1.0, 1.0, 1.0, 0.0, 0.0], (1, len(self.cross_section.zone_names), 1))
        return [name for name in self.acting if not self._changes(name, rows)]

    def _changes(self, name: str, rows: Array) -> bool:
        from rock2d.effects.columns import widened

        before = self._world(self.blocks, rows)
        after = self._with_effect(name, before)
        blocks = any(
            (block.air or None) != (after.blocks[key].air or None)
            or block.inertia_kg_m2 != after.blocks[key].inertia_kg_m2
            or block.rounding_m != after.blocks[key].rounding_m
            or block.centre_of_mass_m != after.blocks[key].centre_of_mass_m
            for key, block in before.blocks.items()
        )
        ground = not np.array_equal(before.cross_section.points_m, after.cross_section.points_m)
        return blocks or ground or not np.array_equal(widened(before.contact), widened(after.contact))

    def _world(self, blocks: Mapping[str, Block], rows: Array) -> World:
        return World(blocks, self.cross_section, rows, self.gravity_m_s2, fitted_scale=self.fitted_scale)

    def _with_effects(self, blocks: Mapping[str, Block], rows: Array) -> World:
        world = self._world(blocks, rows)
        for name in self.acting:
            world = self._with_effect(name, world)
        return world

    def _with_effect(self, name: str, world: World) -> World:
        """The world with one effect, whose values may differ between blocks."""
        effect, shared = catalogue()[name], self.model.values(name)
        own = {block: values for block in world.blocks if (values := self.model.values(name, block)) != shared}
        return effect.on_blocks(effect.apply(world, shared), own)


def camera_errors(scenario: Scenario) -> list[str]:
    """Errors of the camera that the diagnosis of a scenario found."""
    found = scenario.diagnosed.model.effects if scenario.diagnosed is not None else {}
    return [name for name in found if catalogue()[name].camera]


def corrects_film(scenario: Scenario) -> bool:
    """Whether the diagnosis of a scenario is about the film whose releases restart."""
    film, diagnosed = scenario.experiment, scenario.diagnosed
    return film is not None and diagnosed is not None and film.name == diagnosed.experiment


def true_film(scenario: Scenario) -> Experiment:
    """The film whose releases restart, without the errors of the camera that its own diagnosis found: true poses at
    true instants."""
    film, diagnosed = scenario.experiment, scenario.diagnosed
    assert film is not None
    errors = camera_errors(scenario)
    if film.trajectories is None or diagnosed is None or not errors or not corrects_film(scenario):
        return film
    world = World(film.blocks, film.cross_section, np.empty((1, 0, 0)), film.gravity_m_s2)
    for name in errors:
        world = catalogue()[name].apply(world, diagnosed.model.values(name))
    view, rows, poses = world.view, film.trajectories, list(POSE_NAMES)
    pose = view.true(rows[poses].to_numpy(float))
    true = rows.assign(t_s=rows["t_s"] * view.time_scale, **dict(zip(poses, pose.T, strict=True)))
    noise_m = film.position_noise_m / float(view.scales.mean())
    return replace(film, trajectories=true, fps=film.fps / view.time_scale, position_noise_m=noise_m)
