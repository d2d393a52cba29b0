"""Films like those of users: a ball that falls and bounces, for several kinds of camera and file, with the truth.

Phone, slow motion, shiny balls, a file with an edit list or with frames out of order, a hand-held camera, a wide angle,
a cluttered room. Light and camera are those of `real_looks`."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path

import numpy as np

from tests.tracking.real_looks import (
    REST_FRAMES,
    RealFrame,
    RealLook,
    drawn_look,
    flights_of,
    floor_px,
    instants_of,
    real_film,
)  # fmt: skip

Array = np.ndarray

GRAVITY_M_S2 = 9.81
TICKS = 90_000  # clock ticks per second of a film with a varying frame rate
HIDDEN_FRAMES = 7  # frames before its beginning that a file with an edit list keeps


@dataclass(frozen=True)
class FilmKind:
    """A kind of film.

    Attributes
    ----------
    fps, metres_per_pixel : of the recording
    frames : length, in frames
    looks : kinds of looks of the ball
    file : "mp4", "edit list" (MP4), "avi" (frames out of order), "webm"
    shutter : largest open share of the frame interval"""

    fps: float
    metres_per_pixel: float
    frames: int
    looks: tuple[str, ...]
    file: str = "mp4"
    shutter: float = 0.5
    shake_px: float = 0.0
    lens: float = 0.0
    rolling: float = 0.0  # share of the frame interval in which the rows are read, one after the other
    room: float = 0.4
    falls_out: bool = False  # of the picture, before it meets the floor
    uneven: float = 0.0  # relative variation of the time between frames
    stated_fps: float = 0.0  # frame rate stated by the user, if it is wrong


PHONE_LOOKS = ("shaded", "coloured", "textured", "matte")
FILM_KINDS = {
    "phone": FilmKind(30.0, 4e-3, 75, PHONE_LOOKS),
    "phone, frames out of order": FilmKind(30.0, 4e-3, 75, PHONE_LOOKS, "avi"),
    "slow motion": FilmKind(200.0, 1.5e-3, 240, ("shaded", "textured", "white"), "webm", 0.3),
    "shiny black": FilmKind(1000.0, 3e-4, 220, ("shiny black",), shutter=0.2, room=0.15),
    "shiny red": FilmKind(30.0, 4e-3, 75, ("shiny red",)),
    "edit list, wide angle": FilmKind(60.0, 8e-3, 50, PHONE_LOOKS, "edit list", lens=0.04, falls_out=True),
    "hand-held": FilmKind(30.0, 4e-3, 75, PHONE_LOOKS, shake_px=1.0),
    "cluttered room": FilmKind(30.0, 4e-3, 75, PHONE_LOOKS, room=1.0),
    "rolling shutter": FilmKind(30.0, 4e-3, 75, PHONE_LOOKS, rolling=0.6),
    "wide angle": FilmKind(30.0, 4e-3, 75, PHONE_LOOKS, lens=0.06),
    "slow motion, wrong rate": FilmKind(
        200.0, 1.5e-3, 240, ("shaded", "textured", "white"), "webm", 0.3, stated_fps=30.0
    ),
    "variable rate": FilmKind(30.0, 4e-3, 65, PHONE_LOOKS, uneven=0.5),
}


@dataclass(frozen=True)
class UserFilm:
    """A film of a kind and its appearance; `look.restitution` is the true restitution of its bounces."""

    kind: str
    look: RealLook
    size_px: tuple[int, int]

    @property
    def camera(self) -> FilmKind:
        """Its kind."""
        return FILM_KINDS[self.kind]

    @property
    def bounces(self) -> Array:
        """(n,) instants in frames at which the ball meets the floor while it is in the picture."""
        if self.camera.falls_out:
            return np.empty(0)
        hits = np.array([b.flown for b in flights_of(self.look, self.size_px)[1:]]) + REST_FRAMES
        frames = np.interp(hits, self.instants, np.arange(self.camera.frames), right=np.inf)
        return np.asarray(frames[frames < self.camera.frames - 1])

    @property
    def instants(self) -> Array:
        """(frames,) instants of its frames, in units of the usual time between two."""
        return instants_of(self.look, self.camera.frames)


def drawn_user_film(kind: str, index: int, seed: int, size_px: tuple[int, int] = (480, 270)) -> UserFilm:
    """Film `index` of a kind and a seed."""
    own = FILM_KINDS[kind]
    rng = np.random.default_rng(np.random.SeedSequence([seed, index, *kind.encode()]))
    like = own.looks[int(rng.integers(len(own.looks)))]
    width, height = size_px
    base = drawn_look(0, "moderate", int(rng.integers(2**31)))
    wall = rng.uniform(0.25, 0.55) if like in ("shiny black", "shiny red", "coloured") else rng.uniform(0.08, 0.35)
    background = wall * rng.uniform(0.8, 1.2, 3)
    colour = {
        "shiny black": np.full(3, 0.012), "shiny red": np.array([0.03, 0.04, 0.5]),
        "coloured": rng.permutation([0.08, 0.3, 0.8]), "matte": np.full(3, 0.75), "white": np.full(3, 0.9),
    }.get(like, np.array([0.35, 0.6, 0.8]))  # fmt: skip
    shiny, flat = like.startswith("shiny"), like in ("matte", "white")
    light = rng.normal(size=3) * [0.6, 0.3, 0.0] + [0.0, -0.6, 0.7]
    fall = GRAVITY_M_S2 / own.metres_per_pixel / own.fps**2
    drawn = replace(
        base, kind=like, shape="circle", radius_px=rng.uniform(7, 15) if own.fps < 100 else rng.uniform(10, 18),
        g_px_frame2=fall, colour=colour, background=background, light=light / np.linalg.norm(light),
        ambient=0.7 if flat else rng.uniform(0.3, 0.5), diffuse=0.3 if flat else rng.uniform(0.5, 0.9),
        specular=rng.uniform(0.5, 1.2) if shiny else 0.2 * rng.random(), shine=rng.uniform(20, 60),
        texture=0.6 if like == "textured" else 0.05, opacity=1.0, untidy=0.3, shadow=rng.uniform(0.0, 0.2),
        hand=bool(rng.random() < 0.7), moving=0.0, shutter=rng.uniform(0.3, 1.0) * own.shutter, rolling=own.rolling,
        exposure=rng.uniform(1.0, 1.3), noise=rng.uniform(1.0, 3.0), blur_px=rng.uniform(0.6, 1.1), quality=95, crf=0.0,
        restitution=rng.uniform(0.6, 0.85), room=own.room, shake_px=own.shake_px * rng.uniform(0.6, 1.6),
        shake_frames=rng.uniform(6, 14), lens=own.lens * rng.uniform(0.5, 1.5), uneven=own.uneven,
    )  # fmt: skip
    floor = 1e4 if own.falls_out else floor_px(drawn, size_px)
    start = (rng.uniform(0.15, 0.35) * width, rng.uniform(0.2, 0.35) * min(height, floor))
    across = rng.uniform(0.25, 0.6) * width / own.frames
    up = -rng.uniform(0.0, 0.9) * np.sqrt(2 * fall * (start[1] - 1.5 * drawn.radius_px))
    drawn = replace(drawn, throw=(*start, across, up))
    step = float(np.hypot(across, np.sqrt(up**2 + 2 * fall * (min(floor, height) - start[1]))))
    return UserFilm(kind, replace(drawn, step_px=step), size_px)


def write_user_film(path: Path, film: UserFilm) -> list[RealFrame]:
    """Write the film to `path`; returns its frames before encoding, with their truth."""
    own, look, size_px = film.camera, film.look, film.size_px
    if own.falls_out:  # a floor far below the picture
        look = replace(look, restitution=0.0)
    shots = list(real_film(look, size_px, own.frames))
    pictures = [s.image for s in shots]
    if own.file == "edit list":
        before = [pictures[0]] * HIDDEN_FRAMES
        _encode(path, before + pictures, own, "libx264", {"crf": "25", "bf": "2"})
        hide_first_frames(path, HIDDEN_FRAMES, len(pictures), own.fps)
    elif own.file == "avi":
        _encode(path, pictures, own, "libx264", {"crf": "25", "bf": "2"})
    elif own.file == "webm":
        _encode(path, pictures, own, "libvpx", {"crf": "12", "b": "1500k", "deadline": "realtime", "cpu-used": "4"})
    else:
        _encode(path, pictures, own, "libx264", {"crf": "25"}, film.instants if own.uneven else None)
    return shots


SUFFIXES = {"mp4": ".mp4", "edit list": ".mp4", "avi": ".avi", "webm": ".webm"}


def _encode(
    path: Path,
    pictures: Sequence[Array],
    kind: FilmKind,
    codec: str,
    options: dict[str, str],
    instants: Array | None = None,
) -> None:
    """Write pictures as a film, at a constant rate or at `instants`."""
    import av

    played = Fraction(min(kind.fps, 60.0)).limit_denominator(1000)
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=played, options=options)
        assert isinstance(stream, av.VideoStream)
        stream.height, stream.width, stream.pix_fmt = *pictures[0].shape[:2], "yuv420p"
        stream.codec_context.thread_count = 1  # the pictures must not depend on the machine
        if instants is not None:
            stream.codec_context.time_base = Fraction(1, TICKS)
        for number, picture in enumerate(pictures):
            frame = av.VideoFrame.from_ndarray(picture, format="bgr24")
            frame.pts, frame.time_base = number, 1 / played
            if instants is not None:
                frame.pts, frame.time_base = (round(float(instants[number] / played * TICKS)), Fraction(1, TICKS))
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))


def hide_first_frames(path: Path, hidden: int, shown: int, fps: float) -> None:
    """Set the edit list of an MP4 file to begin `hidden` frames later and to last `shown` frames, as when a phone trims
    a film."""
    stored = bytearray(path.read_bytes())

    def number(at: int) -> int:
        return int.from_bytes(stored[at : at + 4], "big")

    film_clock, clock = number(stored.index(b"mvhd") + 16), number(stored.index(b"mdhd") + 16)
    at = stored.index(b"elst") + 12  # after version, flags and the number of edits
    begins = number(at + 4) + round(hidden * clock / fps)
    stored[at : at + 8] = round(shown * film_clock / fps).to_bytes(4, "big") + begins.to_bytes(4, "big")
    path.write_bytes(stored)
