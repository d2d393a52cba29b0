"""`setup.yaml`: what a film shows and how it was filmed."""

from __future__ import annotations

import copy
import warnings
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Field, model_validator

from rock2d.arrays import Array
from rock2d.errors import InputError, UnusualWarning, counted
from rock2d.files.checked_yaml import Checked, Document, did_you_mean, mistake, shown, yaml_text
from rock2d.files.experiment import Experiment, FromGravity
from rock2d.files.folders import path_inside, write_whole
from rock2d.files.setup_keys import BlockKeys, CrossSectionKeys, Name, Point, block_keys, warn_of_impossible_blocks
from rock2d.files.text_files import read_bytes, read_text
from rock2d.scene.blocks import Block
from rock2d.scene.cross_section import CrossSection
from rock2d.scene.plausibility import site_doubts
from rock2d_tracking import FROM_GRAVITY
from rock2d_tracking.camera import STRONGEST_BARREL, PixelMap
from rock2d_tracking.film_scale import FilmScale

SETUP = "setup.yaml"
LARGEST_DISTORTION = 0.5
LARGEST_SCALE_SPREAD = 0.02  # over a checkerboard; a larger one shows that the camera was oblique

GravityWord = Literal["gravity"]


def _number_or_gravity(value: Any) -> Any:
    if value != FROM_GRAVITY and (isinstance(value, bool) or not isinstance(value, (int, float))):
        raise mistake(f"expected a number or {FROM_GRAVITY}, found {shown(value)}")
    return value


Given = BeforeValidator(_number_or_gravity)
Pixel = Annotated[list[float], Field(min_length=2, max_length=2, description="[u, v] in px: right, down")]


class Scale(Checked):
    """Metres per pixel, in one of three ways."""

    metres_per_pixel: Annotated[Annotated[float, Field(gt=0, le=10)] | GravityWord, Given] | None = Field(
        default=None,
        description="Length of a pixel in m at the optical centre; gravity: what falls in the film gives it",
    )
    points_px: list[Pixel] | None = Field(default=None, min_length=2, max_length=2, description="Two marked points")
    distance_m: float | None = Field(default=None, gt=0, le=1.0e5, description="True distance of the two points in m")
    checkerboard: str | None = Field(
        default=None, description="Picture of a checkerboard in the plane of motion, of the size of the film in px"
    )
    columns: int = Field(default=9, ge=3, le=100, description="Inner corners of the checkerboard in a row")
    rows: int = Field(default=6, ge=3, le=100, description="Rows of inner corners")
    square_m: float | None = Field(default=None, gt=0, le=100, description="Side of a square of it in m")

    @model_validator(mode="after")
    def _one_way(self) -> Scale:
        ways = {
            "metres_per_pixel": (self.metres_per_pixel,),
            "points_px and distance_m": (self.points_px, self.distance_m),
            "checkerboard and square_m": (self.checkerboard, self.square_m),
        }
        given = [name for name, values in ways.items() if any(v is not None for v in values)]
        if len(given) != 1 or any(v is None for v in ways[given[0]]):
            raise mistake(f"expected exactly one of: {'; '.join(ways)}", at="key")
        if self.points_px is not None and self.points_px[0] == self.points_px[1]:
            raise mistake("the two points are the same", "points_px")
        return self


class Distortion(Checked):
    """Radial distortion: seen = true (1 + k ρ²), ρ over half the image's diagonal."""

    k: float = Field(
        ge=STRONGEST_BARREL, le=LARGEST_DISTORTION, description="Distortion at the corner of the image, without unit"
    )
    centre_px: Pixel | None = Field(default=None, description="Default: the middle of the image")


class CameraKeys(Checked):
    """How it was filmed. Nothing here is guessed from the file."""

    fps: Annotated[Annotated[float, Field(gt=0, le=1.0e7)] | GravityWord, Given] = Field(
        description="True frames per second of filming, not of playing; gravity: what falls in the film gives it"
    )
    scale: Scale = Field(description="Metres per pixel, in one of three ways")
    up: Literal["up", "down"] = Field(description="Where the world's y grows to in the image")
    origin_px: Pixel = Field(description="A point of the image whose place is known ...")
    origin_m: Point = Field(default=[0.0, 0.0], description="... and where it is, [x, y] in m")
    tilt_deg: float = Field(default=0.0, ge=-45, le=45, description="A level line rises by this in the image")
    distortion: Distortion | None = Field(default=None, description="Radial distortion of the lens; none")

    @model_validator(mode="after")
    def _one_is_known(self) -> CameraKeys:
        if self.fps == self.scale.metres_per_pixel == FROM_GRAVITY:
            raise mistake("gravity gives the frame rate or the scale, not both: state one of them", "fps")
        return self


class DetectionKeys(Checked):
    """How blocks are found."""

    marks: bool = Field(default=True, description="Circles carry marks from which their orientation is read")
    background_frames: list[Annotated[int, Field(ge=0)]] | None = Field(
        default=None, min_length=2, max_length=2, description="[first, last] frames without a block, counted from 0"
    )
    least_seen: float = Field(
        default=0.55, gt=0, le=1, description="Share of the outline that must be seen for a frame to be trusted"
    )

    @model_validator(mode="after")
    def _in_order(self) -> DetectionKeys:
        if (named := self.background_frames) is not None and named[0] > named[1]:
            raise mistake(f"expected the first frame, then the last, found {named[0]}, {named[1]}", "background_frames")
        return self


class SetupKeys(Checked):
    """`setup.yaml`. SI units, and px in the image."""

    name: Name = Field(description="Name of the experiment")
    gravity_m_s2: float = Field(ge=0, le=1000, description="Gravity in m/s²")
    camera: CameraKeys = Field(description="How it was filmed")
    cross_section: CrossSectionKeys = Field(description="The ground, seen from the side")
    blocks: dict[Name, BlockKeys] = Field(min_length=1, description="Block name -> its profile and mass")
    releases: list[Name] = Field(
        min_length=1, description="Block of each release in the order filmed; one name: all are of that block"
    )
    detection: DetectionKeys = Field(default=DetectionKeys(), description="How blocks are found")

    @model_validator(mode="after")
    def _known_blocks(self) -> SetupKeys:
        for i, name in enumerate(self.releases):
            if name not in self.blocks:
                raise mistake(f"no block {name!r}{did_you_mean(name, self.blocks)}", "releases", i)
        return self


class Setup:
    """A checked set-up: keys, ground, blocks, and the map from pixels once the image's size is known.

    Attributes
    ----------
    path, text : those of its file
    board : the picture of the checkerboard as it is stored, None if it names none
    board_size_px : its (width, height)
    scale : scale and frame rate; one may be unknown
    from_gravity : which of them is computed from gravity, and its error when known; None if both are stated"""

    def __init__(self, path: str | Path, text: str | None = None) -> None:
        """Read `setup.yaml`, or its `text`; raises `InputError` with the place of the first mistake. Warns with
        `UnusualWarning` of blocks that nothing is like, and of an unusual gravity from which a scale is computed."""
        self.path = Path(path)
        self.text = read_text(self.path) if text is None else text
        self._document = Document(self.path, self.text)
        self.keys = self._document.check(SetupKeys)
        self.board: bytes | None = None
        self.board_size_px: tuple[int, int] | None = None
        self.cross_section: CrossSection = self.keys.cross_section.make()
        self.blocks: dict[str, Block] = {name: keys.make(name) for name, keys in self.keys.blocks.items()}
        warn_of_impossible_blocks(self._document, self.blocks, self.cross_section)
        camera = self.keys.camera
        fps = None if camera.fps == FROM_GRAVITY else float(camera.fps)
        self.scale = FilmScale(self._metres_per_pixel(), fps, self.keys.gravity_m_s2)
        self.from_gravity: FromGravity | None = None
        if self.scale.fps is None or self.scale.metres_per_pixel is None:
            self.from_gravity = FromGravity(which="fps" if fps is None else "scale", relative_error=0.0)
            self._warn_of_unusual_gravity()

    def _warn_of_unusual_gravity(self) -> None:
        """Warn of a gravity that gives scale or frame rate, because such a film cannot check it."""
        for doubt in site_doubts(self.cross_section, self.keys.gravity_m_s2):
            if doubt.key == ("gravity_m_s2",):
                warnings.warn(UnusualWarning(str(self._document.error(doubt.text, *doubt.key, at="key"))), stacklevel=3)

    def _metres_per_pixel(self, size_px: tuple[int, int] | None = None) -> float | None:
        """The stated scale; without the size of the images, the lens is left out between marked points."""
        scale = self.keys.camera.scale
        if scale.metres_per_pixel is not None:
            return None if scale.metres_per_pixel == FROM_GRAVITY else float(scale.metres_per_pixel)
        if scale.points_px is not None and scale.distance_m is not None:
            a, b = self._map(1.0, size_px).to_world(np.array(scale.points_px))
            return float(scale.distance_m / np.hypot(*(b - a)))
        assert scale.checkerboard is not None and scale.square_m is not None
        key = ("camera", "scale", "checkerboard")
        path = path_inside(self.path.parent, scale.checkerboard, *key, error=self._document.error)
        self.board = read_bytes(path)
        image = picture_of_board(self.board, path)
        self.board_size_px = (image.shape[1], image.shape[0])
        return scale_of_board(
            image, path, (scale.columns, scale.rows), scale.square_m, self._map(1.0, self.board_size_px)
        )

    def for_images(self, size_px: tuple[int, int]) -> Setup:
        """The same set-up for images of this size (width, height): with a stated distortion, the scale between two
        marked points depends on it.

        Raises InputError if the picture of the checkerboard has another size, or if the lens would fold the picture
        over before its corners or before a stated point."""
        if self.board_size_px is not None and self.board_size_px != size_px:
            (width, height), (own_width, own_height) = size_px, self.board_size_px
            message = (
                f"the film has {width} x {height} px, the picture of the checkerboard {own_width} x {own_height} px: "
                "its squares give no scale of the film. Take a frame of a film with the same settings, uncut"
            )
            raise self._document.error(message, "camera", "scale", "checkerboard", code="wrong_kind")
        if self.keys.camera.distortion is None:
            return self
        self._map(1.0, size_px)
        if self.keys.camera.scale.points_px is None:
            return self
        own = copy.copy(self)
        own.scale = self.scale._replace(metres_per_pixel=self._metres_per_pixel(size_px))
        return own

    @property
    def metres_per_pixel(self) -> float:
        """The scale; it must be known."""
        assert self.scale.metres_per_pixel is not None
        return self.scale.metres_per_pixel

    @property
    def fps(self) -> float:
        """The frame rate of the recording; it must be known."""
        assert self.scale.fps is not None
        return self.scale.fps

    def background_missing(self, frames: int) -> InputError:
        """The error that the frames that `background_frames` names are not among those that were read."""
        message = f"begins after the last frame: {counted(frames, 'frame')} of the film are read, counted from 0"
        return self._document.error(message, "detection", "background_frames")

    def with_scale(self, scale: FilmScale, relative_error: float = 0.0) -> Setup:
        """The same set-up with scale and frame rate computed from gravity, and their relative standard error."""
        own = copy.copy(self)
        own.scale = scale
        if own.from_gravity is not None:
            own.from_gravity = own.from_gravity.model_copy(update={"relative_error": min(relative_error, 1.0)})
        return own

    def pixel_map(self, size_px: tuple[int, int] | None) -> PixelMap:
        """The map for images of this size (width, height), None if it is not known.

        Raises InputError if the size is not known and a distortion is stated, which refers to it, or if the lens would
        fold the picture over before its corners."""
        if size_px is not None:
            return self._map(self.for_images(size_px).metres_per_pixel, size_px)
        if (bent := self.keys.camera.distortion) is not None and bent.k != 0.0:
            message = (
                "cannot be taken out, because the size of the picture is not known here. Take it out in the program "
                "that tracked the film and remove the key, or track the film itself"
            )
            raise self._document.error(message, "camera", "distortion", at="key", code="wrong_kind")
        return self._map(self.metres_per_pixel)

    def _map(self, metres_per_pixel: float, size_px: tuple[int, int] | None = None) -> PixelMap:
        """The map with a scale; without the size of the images it leaves the lens out.

        Raises InputError if the lens would fold the picture over before its corners or before a stated point."""
        camera = self.keys.camera
        flat = PixelMap(
            metres_per_pixel, (camera.origin_px[0], camera.origin_px[1]), (camera.origin_m[0], camera.origin_m[1]),
            -self.down, self.down * float(np.deg2rad(camera.tilt_deg)),
        )  # fmt: skip
        bent = camera.distortion
        if bent is None or size_px is None:
            return flat
        middle = ((size_px[0] - 1) / 2, (size_px[1] - 1) / 2)
        centre = middle if bent.centre_px is None else (bent.centre_px[0], bent.centre_px[1])
        half = float(np.hypot(*middle))
        corner = np.linalg.norm(np.add(middle, np.abs(np.subtract(middle, centre)))) / half  # the farthest one
        if bent.k < (least := STRONGEST_BARREL / corner**2):
            message = f"no lens shows the corners of the picture with k = {bent.k:g}; expected at least {least:.3g}"
            raise self._document.error(message, "camera", "distortion", "k")
        lens = replace(flat, k=bent.k, centre_px=centre, half_px=half)
        self._check_lens_shows_points(lens)
        return lens

    def _check_lens_shows_points(self, lens: PixelMap) -> None:
        """Raise InputError for a stated point, outside the picture, that lies where the lens shows nothing."""
        camera = self.keys.camera
        points: list[tuple[tuple[str | int, ...], list[float]]] = [(("camera", "origin_px"), camera.origin_px)]
        points += [(("camera", "scale", "points_px", i), at) for i, at in enumerate(camera.scale.points_px or [])]
        for key, at in points:
            away = float(np.hypot(*np.subtract(at, lens.centre_px)))
            if away > lens.farthest_px * (1.0 + 1e-9):
                message = (
                    f"lies {away:.0f} px from the centre of the lens, which with k = {lens.k:g} shows nothing beyond "
                    f"{lens.farthest_px:.0f} px; take a point inside the picture"
                )
                raise self._document.error(message, *key)

    def write(self, folder: Path) -> None:
        """Write `setup.yaml` into a folder, and the picture that it names, so that it can be used from there."""
        (folder / SETUP).write_text(self.text, encoding="utf-8")
        picture = self.keys.camera.scale.checkerboard
        if picture is not None and self.board is not None:
            path = path_inside(folder, picture)
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(self.board)

    @property
    def g_px_frame2(self) -> float:
        """Acceleration of gravity along v in px per frame squared."""
        return self.down * self.scale.g_px_frame2 * float(np.cos(np.deg2rad(self.keys.camera.tilt_deg)))

    @property
    def down(self) -> int:
        """The sign of gravity along v."""
        return 1 if self.keys.camera.up == "up" else -1

    def block_of(self, release: int) -> str:
        """Name of the block of a release, counted from 0."""
        names = self.keys.releases
        return names[0] if len(names) == 1 else names[min(release, len(names) - 1)]


def write_setup(path: Path, experiment: Experiment, camera: PixelMap, releases: Sequence[str]) -> None:
    """Write what `Setup` reads; `releases`: the block of each."""
    keys = {
        "name": experiment.name,
        "gravity_m_s2": float(experiment.gravity_m_s2),
        "camera": {
            "fps": float(experiment.fps),
            "scale": {"metres_per_pixel": float(camera.metres_per_pixel)},
            "up": "up" if camera.up < 0 else "down",
            "origin_px": [float(v) for v in camera.origin_px],
            "origin_m": [float(v) for v in camera.origin_m],
            "tilt_deg": float(-camera.up * np.rad2deg(camera.tilt_rad)),
        },
        "cross_section": {
            "points_m": experiment.cross_section.points_m.tolist(),
            "zones": list(experiment.cross_section.zones),
        },
        "blocks": {name: block_keys(block) for name, block in experiment.blocks.items()},
        "releases": list(releases),
    }
    write_whole(path, yaml_text(keys))


def picture_of_board(stored: bytes, path: Path) -> Array:
    """(height, width) uint8; `stored`, `path`: a file of an image, and its name for errors.

    Raises InputError if it cannot be read."""
    import cv2

    image = cv2.imdecode(np.frombuffer(stored, np.uint8), cv2.IMREAD_GRAYSCALE) if stored else None
    if image is None:
        raise InputError("cannot be read as a picture", path)
    return np.asarray(image)


def scale_of_board(image: Array, path: Path, corners: tuple[int, int], square_m: float, camera: PixelMap) -> float:
    """Metres per pixel at the optical centre, from a picture of a checkerboard in the plane of motion.

    image : (height, width) uint8; `path` names it for errors
    corners : number of inner corners in a row, and number of rows
    camera : the map to pixels without distortion

    Raises InputError if the board is not found, or the view is oblique."""
    import cv2

    found, points = cv2.findChessboardCorners(image, corners)
    if not found:
        raise InputError(f"no checkerboard of {corners[0]} × {corners[1]} inner corners found", path)
    precise = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 50, 1e-3)
    seen = cv2.cornerSubPix(image, points, (5, 5), (-1, -1), precise).reshape(corners[1], corners[0], 2)
    grid = camera.to_world(seen)
    along, across = (np.hypot(*np.moveaxis(np.diff(grid, axis=k), -1, 0)) for k in (1, 0))
    sides = np.concatenate([along.ravel(), across.ravel()])
    halves = [*np.array_split(along, 2, axis=1), *np.array_split(across, 2)]
    uneven = float(np.ptp([np.mean(h) for h in halves]) / np.mean(sides))
    if uneven > LARGEST_SCALE_SPREAD:
        raise InputError(f"the camera looks at the board at a slant: its squares differ by {100 * uneven:.1f} %", path)
    return float(square_m / np.mean(sides))
