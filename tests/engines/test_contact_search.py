"""How far a block may move before its contacts can change: within that distance a search finds the same contacts."""

from dataclasses import replace

import numpy as np
import pytest

from rock2d.engines.contact_search import TURN_ARM, find_features, guard_distance
from rock2d.engines.contact_state import ACTIVE, DEPTH, INDEX, KIND, contact_count, new_contacts
from rock2d.engines.contact_step import begin_contacts
from rock2d.engines.geometry import (
    RUN_FIRST,
    RUN_LAST,
    SMOOTH_VERTEX,
    WorldArrays,
    block_arrays,
    ground_arrays,
    point_depth,
)
from rock2d.scene.blocks import make_block
from rock2d.scene.cross_section import CrossSection

BALL = make_block("ball", "circle", 1.0, diameter_m=0.5)
EGG = make_block("egg", "ellipse", 1.0, length_m=0.8, height_m=0.5)
THIN = make_block("thin", "ellipse", 1.0, length_m=0.8, height_m=0.2)
OFF = replace(BALL, name="off", centre_of_mass_m=(0.1, 0.05))
BOX = make_block("box", "rectangle", 1.0, length_m=0.8, height_m=0.4)
# a slope, a hollow, an edge, a slope that is divided, a step
GROUND = CrossSection(
    np.array([[-3, 2], [0, 0.5], [1, 0.45], [2, 0.9], [2.6, 0.88], [3.2, 0.862], [4.5, 0.2], [4.8, 0.6], [8, 0.5]]),
    ["soil"] * 8,
)  # fmt: skip
MOVES = 30  # tried from each pose


@pytest.mark.parametrize("block", [BALL, EGG, THIN, OFF, BOX], ids=lambda b: b.name)
def test_contacts_stay_the_same_within_the_guard(block):
    arrays = block_arrays(block)
    world = WorldArrays(arrays, ground_arrays(GROUND), np.zeros((1, 1)), 9.81)
    facets, rng, guarded = world.ground.facets, np.random.default_rng(5), 0
    near, reach = (0, len(GROUND.points_m) - 1), arrays.radius
    for _ in range(300):
        memory, found = (new_contacts(contact_count(block)) for _ in range(2))
        q = np.array([rng.uniform(-1, 6), 0.0, rng.uniform(0, 6.3), 0.0, 0.0, 0.0])
        q[1] = np.interp(q[0], *GROUND.points_m.T) + 0.99 * rng.uniform(0.3, 1.1) * arrays.radius
        if begin_contacts(q, near, world, memory, found) == 0:
            continue
        depth, _, _ = point_depth(q[0], q[1], facets, *near)
        # the centroid of a release stays above the ground
        guard = min(-depth, guard_distance(q, 0.5 * arrays.radius, near, world, memory))
        guarded += guard > 0.0
        for _ in range(MOVES if guard > 0.0 else 0):
            part = rng.dirichlet(np.ones(3)) * rng.choice([-1, 1], 3) * guard
            moved = q + np.array([part[0], part[1], part[2] / (TURN_ARM * arrays.radius), 0.0, 0.0, 0.0])
            find_features(moved, reach, near, world, memory, found)
            for own, new in zip(memory.ints, found.ints, strict=True):
                if own[ACTIVE]:
                    first, last = facets[own[INDEX], RUN_FIRST], facets[own[INDEX], RUN_LAST]
                    joint = new[KIND] == SMOOTH_VERTEX and first < new[INDEX] <= last  # inside the run
                    assert joint or (new[KIND] == own[KIND] and first <= new[INDEX] <= last)
            idle = memory.ints[:, ACTIVE] == 0
            assert (found.reals[idle, DEPTH] <= 0.0).all()
    assert guarded > 20
