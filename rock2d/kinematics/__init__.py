"""From the frames of a film to its flights, impacts and rests, without a law of contact."""
