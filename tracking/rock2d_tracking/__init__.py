"""From high-speed video to an experiment folder."""

FROM_GRAVITY = "gravity"  # what stands for a scale or a frame rate that gravity is to give
