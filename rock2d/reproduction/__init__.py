"""The paper's calibration and comparison, redone with what it did not publish marginalised over."""
