"""From filmed releases to a diagnosis: where the simulation is wrong, what is missing, how far the gap shrinks."""
