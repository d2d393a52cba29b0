"""From high-speed video to an experiment folder.

The way of a frame: its picture (`film_reading.Frames`) shows candidates (`candidates.CANDIDATE`); those of a block in
flight lie on an arc (`arcs.Arc`). The fits of a release (`following.Follower`) make a `sights.Sight` of it, and this a
row of `tracked_film.TrackedFilm.frames`. If it is trusted, it is in the experiment, which `rock2d.kinematics` divides
into flights and impacts."""

FROM_GRAVITY = "gravity"  # stands for a scale or a frame rate that is computed from gravity
