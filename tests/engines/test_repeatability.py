"""Every engine gives the same bits in another process, with another hash seed and another number of threads."""

import hashlib

import numpy as np

from rock2d.engines.batch import Ensemble, run_batch
from rock2d.engines.pymunk_engine import run_pymunk
from rock2d.laws.contact import contact_table
from tests.engines import test_batch, test_point_mass, test_point_mass_batch
from tests.laboratory import BLOCKS, CONTRAST, CUBE, LAW, SETUP, SPHERE, random_state
from tests.programs import other_hash_seed, printed


def digests() -> dict[str, str]:
    """Engine -> digest of what it gives."""
    two = Ensemble([CUBE, SPHERE], [SETUP], [contact_table(LAW, SETUP.zone_names)])
    cubes = test_point_mass_batch.ensemble("slope_embankment", "cube_1m", 300)[2]
    thrown = test_point_mass.run([-0.5, 0.7, 0.2, 1.5, 0.5, 30], law=test_point_mass.RANDOM_LAW, seed=7)
    given = {
        "pymunk": [
            run_pymunk(block, SETUP, CONTRAST, random_state(i), time_limit_s=0.3).knots
            for i, block in enumerate(BLOCKS.values())
        ],
        "batch": [run_batch(two, test_batch.states(40, 3), block_ids=np.arange(40) % 2).ends],
        "point_mass": [thrown.knots],
        "point_mass_batch": [cubes.ends, cubes.crossings, cubes.impact_count],
    }
    return {
        engine: hashlib.sha256(b"".join(own.tobytes() for own in arrays)).hexdigest()
        for engine, arrays in given.items()
    }


def test_another_process_hash_seed_and_number_of_threads_give_the_same_bits():
    code = "from tests.engines.test_repeatability import digests; print(digests())"
    there = printed(code, NUMBA_NUM_THREADS="2", PYTHONHASHSEED=other_hash_seed())
    assert there == str(digests())  # here on one thread
