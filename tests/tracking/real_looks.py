"""Synthetic films as difficult as real ones: shaded, shiny, textured, coloured or half transparent blocks in front of
an untidy background, with hands, soft shadows, motion blur, a rolling shutter, over-exposure, and compression of each
picture (JPEG) or of the film (H.264).

Light is summed in linear units (1 is white), then exposed, raised to 1 / gamma, and rounded. The tracking trial uses
twenty looks, drawn from a seed, at three severities."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import NamedTuple

import numpy as np

Array = np.ndarray

LOOK_KINDS = ("matte", "shaded", "shiny black", "textured", "coloured", "half transparent", "white")
LOOK_SEVERITIES = {"mild": 0.25, "moderate": 0.6, "severe": 1.0}
FINE = 3  # parts of the side of a pixel
EXPOSURE_POSES = 6  # poses while the shutter is open
MOST_SIZE_ERROR = 0.03  # relative error of the size that is stated for a block
REFLECTANCE_TEXTURE = 0.6  # share by which the darkest spot of a textured block is darker
SKIN = np.array([0.22, 0.34, 0.55])  # blue, green, red
SHAPES = ("circle", "circle", "square", "rectangle")  # half of the blocks are balls
H264_SHARE, MILDEST_CRF = 0.5, 17.0  # share of the looks whose films are H.264, and its least rate factor
LENGTH_RATIO = 0.6  # height of a rectangle over its length
MOST_BOUNCES = 20
# of a varying frame rate: its period in frames, random delay of a frame over the variation of the rate, and share of
# the frames that are left out
SLOWER_FRAMES, LATE_SHARE, LEFT_OUT_SHARE = 45, 0.2, 0.03
REST_FRAMES = 6  # at the start, in which the hand holds the block
SWINGS = np.array([1.0, 1.7, 3.0, 6.0])  # periods of the motion of a hand, over the shortest
LENS_ROUNDS = 6  # iterations that invert a weak distortion
SHADOW_AWAY_RADII = np.array([2.2, 1.2])  # offset of the shadow on the wall behind the block


@dataclass(frozen=True)
class RealLook:
    """The appearance of a film; lengths in px, light from 0 to 1, colours blue, green, red.

    Attributes
    ----------
    radius_px : half the size of the block
    stated_size : size stated in a set-up file, over the true one
    step_px, g_px_frame2 : displacement of the block per frame, and gravity in px per frame squared
    quality, crf : quality of JPEG, 1 to 100; constant rate factor of H.264, 0 for JPEG pictures
    throw : (4,) place and velocity along u and v of the release, in px and px per frame; None for the usual throw
    restitution : of the bounces on the floor
    room : contrast of floor, furniture and a shadow on the floor, 0 to 1
    shake_px : root mean square displacement of a hand-held camera along each axis; `shake_frames`: its shortest period
    lens : relative shift toward the centre of a point half a picture width away from it
    uneven : relative variation of the time between frames"""

    kind: str
    shape: str
    radius_px: float
    stated_size: float
    step_px: float
    g_px_frame2: float
    colour: Array
    background: Array
    light: Array
    ambient: float
    diffuse: float
    specular: float
    shine: float
    texture: float
    opacity: float
    untidy: float
    shadow: float
    hand: bool
    moving: float
    shutter: float
    rolling: float
    exposure: float
    gamma: float
    noise: float
    blur_px: float
    quality: int
    seed: int
    crf: float
    throw: tuple[float, float, float, float] | None = None
    restitution: float = 0.75
    room: float = 0.0
    shake_px: float = 0.0
    shake_frames: float = 12.0
    lens: float = 0.0
    uneven: float = 0.0


class RealFrame(NamedTuple):
    """A frame and the truth: u, v in px and angle in rad, from u toward v, and whether the block is whole and free."""

    image: Array
    pose: Array
    free: bool


def drawn_look(index: int, severity: str, seed: int = 0) -> RealLook:
    """Look `index` of a seed; the severity scales the faults of the film, not its contents."""
    rng = np.random.default_rng(np.random.SeedSequence([seed, index]))
    hard = LOOK_SEVERITIES[severity]
    kind = LOOK_KINDS[index % len(LOOK_KINDS)]
    shape = SHAPES[int(rng.integers(len(SHAPES)))] if kind != "shiny black" else "circle"
    dark = kind not in ("white", "shiny black") and rng.random() < 0.5
    wall = rng.uniform(0.01, 0.05) if dark or kind == "white" else rng.uniform(0.15, 0.5)
    background = wall * rng.uniform(0.8, 1.2, 3)
    bright = rng.uniform(0.5, 0.9) if wall < 0.1 else rng.uniform(0.6, 0.95)
    colour = bright * np.ones(3)
    if kind == "shiny black":
        colour = np.full(3, 0.01)
    if kind == "coloured":  # as bright as the wall in grey, but of another colour
        colour = np.roll(np.array([0.1, 0.3, 1.0]), int(rng.integers(3)))
        colour *= wall / float(colour @ [0.114, 0.587, 0.299])
        colour = np.clip(colour, 0.0, 1.0)
    fast = rng.random() < 0.5
    radius = rng.uniform(5, 12) if fast else rng.uniform(10, 28)
    light = rng.normal(size=3) * [0.6, 0.3, 0.0] + [0.0, -0.6, 0.7]
    step = rng.uniform(8, 20) if fast else rng.uniform(1.5, 5)
    return RealLook(
        kind, shape, radius, 1.0 + MOST_SIZE_ERROR * hard * rng.uniform(-1, 1), step,
        rng.uniform(1.5, 4.0) if fast else rng.uniform(0.05, 0.2),
        colour, background, light / np.linalg.norm(light),
        ambient=0.8 if kind in ("matte", "white") else rng.uniform(0.25, 0.5),
        diffuse=0.2 if kind in ("matte", "white") else rng.uniform(0.5, 0.9),
        specular=rng.uniform(0.6, 1.2) if kind == "shiny black" else 0.3 * rng.random(),
        shine=rng.uniform(20, 60),
        texture=REFLECTANCE_TEXTURE if kind == "textured" else 0.1 * rng.random(),
        opacity=rng.uniform(0.45, 0.65) if kind == "half transparent" else 1.0,
        untidy=hard * rng.uniform(0.3, 0.8), shadow=hard * rng.uniform(0.2, 0.5),
        hand=bool(rng.random() < 0.3 + 0.6 * hard), moving=hard * rng.uniform(0.0, 0.15),
        shutter=hard * rng.uniform(0.1, 0.5), rolling=hard * rng.uniform(0.0, 0.6),
        exposure=1.0 + hard * rng.uniform(-0.1, 0.6), gamma=rng.uniform(1.8, 2.4),
        noise=0.3 + hard * rng.uniform(1.0, 4.0), blur_px=0.5 + hard * rng.uniform(0.1, 0.8),
        quality=int(98 - hard * rng.uniform(20, 50)), seed=int(rng.integers(2**31)),
        crf=MILDEST_CRF + hard * rng.uniform(4, 12) if rng.random() < H264_SHARE else 0.0,
    )  # fmt: skip


def path_of(look: RealLook, frames: int, size_px: tuple[int, int]) -> Array:
    """(frames, 3) poses in the middle of the exposures at the top row: a throw, and bounces on a floor."""
    return _path(look, instants_of(look, frames), size_px)


def instants_of(look: RealLook, frames: int) -> Array:
    """(frames,) instants of the frames in units of the usual frame interval. As with a phone in changing light, the
    frame rate varies slowly, frames are late, and some are left out."""
    rng = np.random.default_rng(np.random.SeedSequence([look.seed, 3]))
    slower = look.uneven * (0.5 + 0.5 * np.sin(2 * np.pi * (np.arange(frames) / SLOWER_FRAMES + rng.random())))
    late = LATE_SHARE * look.uneven * rng.standard_normal(frames)
    left_out = (look.uneven > 0) * (rng.random(frames) < LEFT_OUT_SHARE)
    steps = (1.0 + slower + np.clip(late, -0.3, 0.3)) * (1 + left_out)
    return np.concatenate([[0.0], np.cumsum(steps[1:])])


class Bounce(NamedTuple):
    """The instant in frames after the release at which the block is at height v_px with `pace` px per frame along v."""

    flown: float
    v_px: float
    pace: float


def floor_px(look: RealLook, size_px: tuple[int, int]) -> float:
    """Height v in the picture at which the middle of the block meets the floor."""
    return size_px[1] - 1.6 * look.radius_px - 12


def flights_of(look: RealLook, size_px: tuple[int, int]) -> list[Bounce]:
    """The beginning of each flight: the release first, then the bounces."""
    throw = look.throw
    if throw is None:
        throw = (0.12 * size_px[0] + look.radius_px, 0.35 * size_px[1], 0.6 * look.step_px, -0.6 * look.step_px)
    _, v, _, pace = throw
    floor, begins = floor_px(look, size_px), [Bounce(0.0, v, pace)]
    for _ in range(MOST_BOUNCES):
        flown, v, pace = begins[-1]
        root = pace * pace + 2 * look.g_px_frame2 * (floor - v)
        hit = (-pace + np.sqrt(max(root, 0.0))) / look.g_px_frame2
        begins.append(Bounce(flown + hit, floor, -look.restitution * (pace + look.g_px_frame2 * hit)))
    return begins


def _path(look: RealLook, t: Array, size_px: tuple[int, int]) -> Array:
    begins = np.array(flights_of(look, size_px))
    flown = np.maximum(t - REST_FRAMES, 0.0)
    own = begins[np.searchsorted(begins[:, 0], flown, side="right") - 1]
    since = flown - own[:, 0]
    v = own[:, 1] + own[:, 2] * since + 0.5 * look.g_px_frame2 * since**2
    u, _, pace, _ = look.throw or (0.12 * size_px[0] + look.radius_px, 0.0, 0.6 * look.step_px, 0.0)
    return np.column_stack([
        u + pace * flown, np.minimum(v, floor_px(look, size_px)), 0.6 * pace / look.radius_px * flown
    ])  # fmt: skip


def real_film(look: RealLook, size_px: tuple[int, int] = (640, 400), frames: int = 90) -> Iterator[RealFrame]:
    """Film a block of this look until it leaves the picture, at most `frames` frames; `size_px` is even."""
    shots = _rendered(look, size_px, frames)
    if look.crf == 0.0:
        for shot in shots:
            yield shot._replace(image=_as_jpeg(shot.image, look.quality))
        return
    film = list(shots)
    for shot, image in zip(film, compressed([s.image for s in film], look.crf), strict=True):
        yield shot._replace(image=image)


def _as_jpeg(image: Array, quality: int) -> Array:
    import cv2

    jpeg = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
    return np.asarray(cv2.imdecode(jpeg, cv2.IMREAD_COLOR))


def _rendered(look: RealLook, size_px: tuple[int, int], frames: int) -> Iterator[RealFrame]:
    """The film before it is compressed."""
    import cv2

    rng = np.random.default_rng(np.random.SeedSequence([look.seed, 1]))
    wall = _wall(look, size_px, rng)
    width, height = size_px
    times = _times(look, instants_of(look, frames), size_px)
    poses = _path(look, times, size_px)
    for i in range(frames):
        if poses[i, 0] > width + 2 * look.radius_px:
            return
        light = _with_swaying_curtain(wall, look, i)
        _draw_shadow(light, look, poses[i])
        _draw_floor_shadow(light, look, poses[i], size_px)
        spread = look.shutter * (np.arange(EXPOSURE_POSES) / EXPOSURE_POSES - 0.5 + 0.5 / EXPOSURE_POSES)
        count = EXPOSURE_POSES if look.shutter * look.step_px > 0.3 else 1
        exposed = _path(look, times[i] + (spread if count > 1 else np.zeros(1)), size_px)
        for cover, colour, box in [_drawn(look, pose, size_px) for pose in exposed]:
            if cover.size:
                light[box] += look.opacity * cover[..., None] / count * (colour - wall[box])
        touched = look.hand and _draw_hand(light, look, i, poses)
        light = cv2.GaussianBlur(through_camera(light, look.lens, camera_shift(look, i)), (0, 0), look.blur_px)
        image = 255.0 * np.clip(look.exposure * light, 0.0, 1.0) ** (1.0 / look.gamma)
        image += look.noise * rng.standard_normal(image.shape, np.float32)
        reach = 1.5 * look.radius_px
        u, v = poses[i, :2]
        free = not touched and reach < u < width - reach and reach < v < height - reach and i >= REST_FRAMES
        seen = np.append(through_lens(poses[i, :2], look.lens, size_px), poses[i, 2])
        yield RealFrame(np.clip(np.rint(image), 0, 255).astype(np.uint8), seen, bool(free))


def camera_shift(look: RealLook, frame: int) -> Array:
    """(2,) displacement in px of the picture of a frame by a hand-held camera."""
    return hand_shake(look.seed, look.shake_px, look.shake_frames, np.array([frame]))[0]


def _times(look: RealLook, t: Array, size_px: tuple[int, int]) -> Array:
    """Instants at which the rows of the block are read, in frames: a rolling shutter reads one row after the other."""
    at = t.copy()
    for _ in range(4):
        at = t + look.rolling * _path(look, at, size_px)[:, 1] / size_px[1]
    return at


def _wall(look: RealLook, size_px: tuple[int, int], rng: np.random.Generator) -> Array:
    """(height, width, 3) float32: uneven light, stains, and posters with edges."""
    import cv2

    width, height = size_px
    wall = np.ones((height, width, 3), np.float32) * look.background.astype(np.float32)
    stains = cv2.GaussianBlur(rng.standard_normal((height, width)).astype(np.float32), (0, 0), 12)
    wall *= np.clip(1.0 + 0.3 * look.untidy * stains / stains.std(), 0.2, 2.0)[..., None]
    for _ in range(int(12 * look.untidy)):
        u, v = int(rng.integers(width)), int(rng.integers(height))
        du, dv = rng.integers(8, 90, 2).tolist()
        shade = look.background * np.exp(rng.normal(0.0, 0.9 * look.untidy, 3))
        cv2.rectangle(wall, (u, v), (u + du, v + dv), np.clip(shade, 0, 1).tolist(), -1, cv2.LINE_AA)
    if look.room:
        _furnish(wall, look, size_px, rng)
    return wall


def _furnish(wall: Array, look: RealLook, size_px: tuple[int, int], rng: np.random.Generator) -> None:
    """A floor with planks, and furniture: boxes, poles and round things of any colour."""
    import cv2

    (width, height), foot = size_px, int(floor_px(look, size_px) - 0.5 * look.radius_px)
    for _ in range(int(20 * look.room)):
        colour = np.clip(look.background * np.exp(rng.normal(0.0, 0.8 * look.room, 3)), 0, 1).tolist()
        u, v = int(rng.integers(width)), int(rng.integers(foot))
        kind = int(rng.integers(3))
        if kind == 0:
            cv2.rectangle(wall, (u, v), (u + int(rng.integers(20, 90)), foot), colour, -1, cv2.LINE_AA)
        elif kind == 1:
            cv2.line(wall, (u, v), (u + int(rng.integers(-20, 20)), foot), colour, int(rng.integers(2, 9)), cv2.LINE_AA)
        else:
            cv2.circle(wall, (u, v), int(rng.integers(6, 30)), colour, -1, cv2.LINE_AA)
    wall[foot:] *= (1.0 + look.room * rng.uniform(-0.5, 0.5, 3)).astype(np.float32)
    for u in range(0, width, 37):
        cv2.line(wall, (u, foot), (int(width / 2 + 1.6 * (u - width / 2)), height), (look.background * 0.6).tolist(), 1)


def _draw_floor_shadow(light: Array, look: RealLook, pose: Array, size_px: tuple[int, int]) -> None:
    """The shadow under the block: wider and fainter, the higher it is."""
    if look.room == 0.0:
        return
    high = max(0.0, floor_px(look, size_px) - pose[1]) / look.radius_px
    half = look.radius_px * (0.9 + 0.15 * high)
    v, u = np.ogrid[: light.shape[0], : light.shape[1]]
    foot = floor_px(look, size_px) + look.radius_px
    soft = np.exp(-0.5 * (((u - pose[0]) / half) ** 2 + ((v - foot) / (0.3 * half)) ** 2))
    light *= (1.0 - 0.6 * look.room / (1.0 + 0.3 * high) * soft[..., None]).astype(np.float32)


def _with_swaying_curtain(wall: Array, look: RealLook, frame: int) -> Array:
    """The wall in one frame: its right upper quarter, a curtain, sways."""
    if look.moving == 0.0:
        return wall.copy()
    out, height, width = wall.copy(), *wall.shape[:2]
    shift = round(30 * look.moving * np.sin(0.4 * frame))
    part = np.s_[: height // 3, 2 * width // 3 :]
    out[part] = np.roll(wall[part], shift, axis=1)
    return out


def _draw_shadow(light: Array, look: RealLook, pose: Array) -> None:
    away = SHADOW_AWAY_RADII * look.radius_px
    half = 1.1 * look.radius_px
    v, u = np.ogrid[: light.shape[0], : light.shape[1]]
    soft = np.exp(-0.5 * (((u - pose[0] - away[0]) / half) ** 2 + ((v - pose[1] - away[1]) / half) ** 2) ** 2)
    light *= (1.0 - look.shadow * soft[..., None]).astype(np.float32)


def _draw_hand(light: Array, look: RealLook, frame: int, poses: Array) -> bool:
    """Draw a hand that throws the block and moves back; returns whether it touches the block."""
    import cv2

    follow = min(frame, REST_FRAMES + 2)
    back = max(frame - REST_FRAMES - 2, 0) * 0.5 * look.step_px
    tip = poses[follow, :2] + [-0.4 * look.radius_px - back, 0.7 * look.radius_px + 0.7 * back]
    size = 2.0 * look.radius_px + 12
    palm = [(tip + np.array([-size * 0.6, 0.25 * size]), 0.5 * size), (tip, 0.28 * size)]
    for (u, v), r in palm:
        cv2.circle(light, (int(u), int(v)), int(r), (SKIN * 0.6).tolist(), -1, cv2.LINE_AA)
    cv2.line(
        light,
        (int(palm[0][0][0]), int(palm[0][0][1])),
        (-20, int(palm[0][0][1] + 60)),
        (SKIN * 0.5).tolist(),
        max(2, int(0.5 * size)),
        cv2.LINE_AA,
    )
    gap = min(float(np.hypot(*(poses[frame, :2] - centre))) - r for centre, r in palm)
    return gap < 1.6 * look.radius_px


def half_axes_px(look: RealLook) -> tuple[float, float]:
    """Half length and half height of the block."""
    r = look.radius_px
    return (r, r) if look.shape != "rectangle" else (r, LENGTH_RATIO * r)


def _drawn(look: RealLook, pose: Array, size_px: tuple[int, int]) -> tuple[Array, Array, tuple[slice, slice]]:
    """Share of each pixel that the block covers, its colour there, and the window in the picture."""
    import cv2

    a, b = half_axes_px(look)
    reach = int(np.ceil(np.hypot(a, b))) + 2
    u0, v0 = int(pose[0]) - reach, int(pose[1]) - reach
    n = 2 * reach + 1
    left, top = max(u0, 0), max(v0, 0)
    right, bottom = min(u0 + n, size_px[0]), min(v0 + n, size_px[1])
    if right <= left or bottom <= top:
        return np.empty(0), np.empty(0), np.s_[0:0, 0:0]
    grid = (np.arange(FINE * n) + 0.5) / FINE - 0.5
    x, y = grid[None, :] + u0 - pose[0], grid[:, None] + v0 - pose[1]
    c, s = np.cos(pose[2]), np.sin(pose[2])
    qx, qy = c * x + s * y, -s * x + c * y
    if look.shape == "circle":
        inside = x * x + y * y <= a * a
        nx, ny = np.clip(x / a, -1, 1) + 0 * y, np.clip(y / a, -1, 1) + 0 * x
        nz = np.sqrt(np.clip(1 - nx * nx - ny * ny, 0, 1))
    else:
        inside = (np.abs(qx) <= a) & (np.abs(qy) <= b)
        nx, ny, nz = 0.3 * qx / a, 0.3 * qy / b, np.full(qx.shape, 0.95)  # faces are a little uneven
    lit = np.clip(nx * look.light[0] + ny * look.light[1] + nz * look.light[2], 0, 1)
    half = look.light + np.array([0.0, 0.0, 1.0])
    half /= np.linalg.norm(half)
    gloss = np.clip(nx * half[0] + ny * half[1] + nz * half[2], 0, 1) ** look.shine
    spots = 0.5 + 0.5 * np.sin(4.0 * qx / a + 1.0) * np.sin(5.0 * qy / b)
    shade = (look.ambient + look.diffuse * lit) * (1.0 - look.texture * spots)
    colour = shade[..., None] * look.colour + look.specular * gloss[..., None]
    cover = cv2.resize(inside.astype(np.float32), (n, n), interpolation=cv2.INTER_AREA)
    seen = cv2.resize((colour * inside[..., None]).astype(np.float32), (n, n), interpolation=cv2.INTER_AREA)
    seen /= np.maximum(cover, 1e-6)[..., None]
    box = np.s_[top - v0 : bottom - v0, left - u0 : right - u0]
    return cover[box], seen[box], np.s_[top:bottom, left:right]


def hand_shake(seed: int, shake_px: float, shortest_frames: float, frames: Array) -> Array:
    """(n, 2) displacement of the picture in px at the frames (n,) from frame 0: slow oscillations, `shake_px` root mean
    square along each axis."""
    rng = np.random.default_rng(np.random.SeedSequence([seed, 2]))
    way = np.zeros((len(frames), 2))
    for period in SWINGS:
        begin = rng.uniform(0, 2 * np.pi, 2)
        swing = np.sin(2 * np.pi * frames[:, None] / (shortest_frames * period) + begin) - np.sin(begin)
        way += shake_px * swing * np.sqrt(2.0 / (SWINGS**2).sum()) * period
    return way


def through_lens(places: Array, lens: float, size_px: tuple[int, int]) -> Array:
    """(..., 2) places after distortion by a lens; `lens`: relative shift toward the centre of a point half a picture
    width away from it."""
    middle = 0.5 * (np.array(size_px) - 1.0)
    off = np.asarray(places) - middle
    return np.asarray(middle + off * (1.0 - lens * ((off / middle[0]) ** 2).sum(axis=-1, keepdims=True)))


def through_camera(light: Array, lens: float, way_px: Array) -> Array:
    """The light (height, width, 3) seen through a lens by a camera that moves the picture by `way_px` (2,)."""
    import cv2

    size_px = (light.shape[1], light.shape[0])
    if lens:
        v, u = np.mgrid[: size_px[1], : size_px[0]]
        seen = np.stack([u, v], axis=-1).astype(float)
        even = seen
        for _ in range(LENS_ROUNDS):
            even = even + seen - through_lens(even, lens, size_px)
        u32, v32 = (np.ascontiguousarray(even[..., k], np.float32) for k in range(2))
        light = cv2.remap(light, u32, v32, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    if way_px.any():
        moved = np.array([[1.0, 0.0, way_px[0]], [0.0, 1.0, way_px[1]]])
        light = cv2.warpAffine(light, moved, size_px, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return light


def compressed(pictures: Sequence[Array], quality_crf: float) -> Iterator[Array]:
    """BGR pictures (height, width, 3), even in size, encoded as one film and decoded again.

    quality_crf : constant rate factor of x264; 18 looks like the original, 28 gives small files"""
    import av

    if not pictures:
        return
    encoder = av.CodecContext.create("libx264", "w")
    decoder = av.CodecContext.create("h264", "r")
    assert isinstance(encoder, av.VideoCodecContext) and isinstance(decoder, av.VideoCodecContext)
    encoder.height, encoder.width = pictures[0].shape[:2]
    encoder.pix_fmt, encoder.time_base = "yuv420p", Fraction(1, 30)
    # one thread: the pictures must not depend on the machine
    encoder.thread_count = decoder.thread_count = 1
    encoder.options = {"preset": "veryfast", "crf": f"{quality_crf:g}"}
    packets = []
    for number, picture in enumerate(pictures):
        frame = av.VideoFrame.from_ndarray(picture, format="bgr24")
        frame.pts = number
        packets += encoder.encode(frame)
    for packet in [*packets, *encoder.encode(None), None]:
        for frame in decoder.decode(packet):
            yield frame.to_ndarray(format="bgr24")
