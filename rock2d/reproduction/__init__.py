"""The calibration and comparison of the paper, repeated and averaged over the quantities that it does not give."""
