"""Findings about a film without a model of contact: gravity in its flights, heights at rest, missing angles.

The measured gravity is s g if lengths are recorded s times too long, and q² g if the true duration is q times the
recorded one. Gravity alone cannot tell a wrong scale from a wrong frame rate.

A block at rest above the stated ground indicates a wrong size, scale, origin or ground. Only heights above the ground
are judged: the depth of a block in its indentation is a property of the soil.

With the true outline, the penetration of a block does not depend on its angle. The depth at the lowest point of each
impact is fitted with harmonics of the angle between block and ground. The second and the fourth harmonic distinguish
circles, squares and elongated blocks."""

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rock2d.arrays import Array
from rock2d.effects.flight import drag_coefficient
from rock2d.engines.geometry import block_arrays, ground_arrays
from rock2d.errors import comma_list, counted
from rock2d.files.diagnosis_keys import FilmRest
from rock2d.files.experiment import FromGravity
from rock2d.files.folders import write_whole
from rock2d.kinematics.film_segments import FilmSegments
from rock2d.kinematics.flight_gravity import FlightGravity, Measured, flight_gravity
from rock2d.kinematics.flights import CONTACT_MARGIN_FRAMES, Film, block_clearances, clearances
from rock2d.kinematics.rest_poses import (
    FARTHEST_RADII,
    FEWEST_RESTS,
    SHARED_ANGLE_RAD,
    STEEPEST_SIDE_RAD,
    RestPoses,
    heights_and_angles,
    still_poses,
)
from rock2d.kinematics.window_gravity import GRAVITY_RATIO
from rock2d.records.columns import POSITION, THETA, X, Y
from rock2d.scene.nearest_facet import nearest_facets
from rock2d.scene.world import World

FILM_FILE = "film.json"
SCALE_OR_RATE = ("scale_error", "frame_rate_error")
DRAG_COEFFICIENT = {"circle": 0.5}  # for a ball; Hoerner (1965), Fluid-dynamic drag
OTHER_DRAG_COEFFICIENT = 1.0  # for a body with edges
LOCAL_GRAVITY = 0.003  # relative variation of gravity on the earth about its mean
# least mean height or angle for a remark, in its standard errors; least height in block radii
CLEAR_HEIGHT, LEAST_HEIGHT_RADII = 4.0, 0.005

# check of the stated shapes
HARMONICS = (1, 2, 3, 4)
TELLING_HARMONICS = (1, 3)  # indices of the second and the fourth harmonic
FEWEST_SHAPE_IMPACTS = 20  # fewest impacts of a block
MOST_IMPACT_FRAMES = 40  # most frames of an impact; longer contacts are rolling or sliding
# least amplitude in block radii (half of that of a square stated as its circumscribed circle), and in standard errors
LEAST_AMPLITUDE_RADII, CLEAR_AMPLITUDE = 0.06, 6.0
LARGEST_CONDITION = 1.0e3
OUTLYING_DEPTH_MADS = 6.0  # distance of a depth from the median, in median deviations


def rest_heights(film: Film, world: World) -> list[FilmRest]:
    """Height at rest of each block that comes to rest on the ground of a world, or near it.

    It is that of the side on which the block lies, which a wrong tracked angle does not change, or of its lowest point
    if it lies on none."""
    found = []
    _, block_at, pose = still_poses(film, world)
    side_m, angle_rad = heights_and_angles(world, block_at, pose).T
    lowest_m = block_clearances(world, block_at, world.view.true(pose))
    height_m = np.where(np.abs(angle_rad) < STEEPEST_SIDE_RAD, side_m, lowest_m)
    for b, (name, block) in enumerate(world.blocks.items()):
        found_m = height_m[(block_at == b) & (np.abs(height_m) < FARTHEST_RADII * block.radius_m)]
        if n := len(found_m):
            error = float(found_m.std(ddof=1) / np.sqrt(n)) if n > 1 else None
            height = float(found_m.mean())
            found.append(
                FilmRest(block=name, rests=n, height_m=height, error_m=error, height_radii=height / block.radius_m)
            )
    return found


def _is_above_ground(own: FilmRest) -> bool:
    """Whether a block at rest is significantly above the ground."""
    above = own.height_radii > LEAST_HEIGHT_RADII
    return above and own.error_m is not None and own.height_m > CLEAR_HEIGHT * own.error_m


def rest_remarks(data: FilmSegments, world: World) -> list[str]:
    """A remark on each block that comes to rest above the ground of a world, or not parallel to it."""
    lies_above = [
        f"at rest, block {own.block} lies {1e3 * own.height_m:.2g} ± {1e3 * own.error_m:.1g} mm above the ground (mean "
        f"of {counted(own.rests, 'release')}): are its sizes, the scale, the origin and the ground right?"
        for own in rest_heights(data.film, world)
        if own.rests >= FEWEST_RESTS and _is_above_ground(own) and own.error_m is not None
    ]
    return lies_above + _inclined_rest_remarks(data.rests, world)


def slow_error_remarks(data: FilmSegments) -> list[str]:
    """A remark on errors of the track that change slowly, if it has any."""
    times = float(data.slow[:, X].max(initial=0.0))
    if not times:
        return []
    of_flights = data.slow[:, X] * data.film.long_noise[X] * data.flights.level
    off_mm = 1e3 * float(np.median(of_flights[data.slow[:, X] > 0.0]))
    return [
        f"in flights after a contact the track is off by about {off_mm:.1g} mm, {times:.0f} times as much as the noise "
        "explains: dust, shadow or soil may pull the outline. All releases may share this error, and nothing is named "
        "for it"
    ]


def _inclined_rest_remarks(rests: RestPoses, world: World) -> list[str]:
    """A remark on each polygon whose side is clearly not parallel to the ground of a world at rest."""
    remarks = list[str]()
    angle_rad = heights_and_angles(world, rests.block, rests.pose)[:, 1]
    for b, name in enumerate(world.blocks):
        own = angle_rad[rests.block == b]
        if not len(own) or abs(mean := own.mean()) <= SHARED_ANGLE_RAD:
            continue
        if abs(mean) > CLEAR_HEIGHT * (error := own.std(ddof=1) / np.sqrt(len(own))):
            turn = f"{np.rad2deg(mean):.2f} ± {np.rad2deg(error):.1g}".replace("-", "−")
            remarks.append(
                f"at rest, the side on which block {name} lies is turned by {turn}° against the ground "
                f"(mean of {counted(len(own), 'release')}): are the tracked angle, the ground and the horizon right?"
            )
    return remarks


@dataclass(frozen=True)
class FilmFindings:
    """Findings about a film.

    Attributes
    ----------
    stated_m_s2, fps : stated gravity and frame rate
    gravity : gravity measured in the flights; None if no flight shows it
    flights, releases : numbers of flights and releases that show it; `left_out`: number of the other flights
    air : expected relative change of gravity by air drag, and its angle in rad, for bodies of the stated mass and size
    spin : largest relative change of gravity by the lift of a spin that was not measured
    rests : heights at rest
    without_angle : blocks whose angle was not measured
    from_gravity : quantity that was computed from gravity, so that flights cannot check it; None if scale and frame
        rate were measured"""

    stated_m_s2: float
    fps: float
    gravity: FlightGravity | None
    flights: int
    releases: int
    left_out: int
    air: tuple[float, float]
    spin: float
    rests: list[FilmRest]
    without_angle: list[str]
    from_gravity: FromGravity | None = None

    @property
    def ratio(self) -> Measured | None:
        """Measured over stated gravity: 1 if scale and frame rate are right."""
        if self.gravity is None:
            return None
        measured = self.gravity.gravity_m_s2
        return Measured(measured.value / self.stated_m_s2, measured.error / self.stated_m_s2)

    @property
    def off(self) -> bool:
        """Whether scale or frame rate must be wrong: the deviation of gravity is larger than its error, air and the
        place on the earth explain."""
        if self.from_gravity is not None or (ratio := self.ratio) is None:
            return False
        return ratio.off(1.0) and not self._explained(ratio)

    @property
    def unexplained_error(self) -> float:
        """Relative standard error of gravity as a reference for scale or frame rate: error of the flights, air, spin
        and place on the earth."""
        assert self.ratio is not None
        return float(np.hypot(self.ratio.error, np.hypot(np.hypot(self.air[0], self.spin), 0.5 * LOCAL_GRAVITY)))

    def _explained(self, ratio: Measured) -> bool:
        """Whether air drag up to twice as strong as expected, an unmeasured spin and the place on the earth explain the
        deviation."""
        beyond = ratio.value - 1.0
        rest = min((abs(beyond - share) for share in np.linspace(0.0, 2.0 * self.air[0], 21)), default=beyond)
        return max(rest - self.spin - LOCAL_GRAVITY, 0.0) <= 2.0 * ratio.error

    @property
    def turned(self) -> bool:
        """Whether the direction of gravity in the picture deviates from the vertical by more than air explains."""
        return bool(self._tilt_sentence())

    @property
    def spin_hides(self) -> bool:
        """Whether the lift of an unmeasured spin can hide a wrong scale or frame rate."""
        return (ratio := self.ratio) is not None and not self.off and self.spin > ratio.error

    @property
    def unjudged(self) -> dict[str, str]:
        """Effect that this film can never show -> reason."""
        if self.from_gravity is None:
            return {}
        given = "frame rate" if self.from_gravity.which == "fps" else "scale"
        return dict.fromkeys(SCALE_OR_RATE, f"the {given} was taken from gravity, so that flights cannot check it")

    @property
    def suspects(self) -> list[str]:
        """Effects of which at least one acts."""
        return list(SCALE_OR_RATE) if self.off else []

    def parameters(self) -> dict[str, dict[str, dict[str, Any]]]:
        """Effect -> its parameter if it acts alone: value, 95 % interval, unit."""
        if (ratio := self.ratio) is None or self.from_gravity is not None:
            return {}
        rate = Measured(ratio.value**0.5, 0.5 * ratio.error / ratio.value**0.5)
        return {
            name: {parameter: {"value": own.value, "ci95": list(own.ci95), "unit": "1"}}
            for name, parameter, own in zip(SCALE_OR_RATE, ("scale", "time_scale"), (ratio, rate), strict=True)
        }

    def true_fps(self) -> Measured | None:
        """The frame rate with which the measured gravity equals the stated one."""
        if (ratio := self.ratio) is None:
            return None
        value = self.fps / ratio.value**0.5
        return Measured(value, 0.5 * value * ratio.error / ratio.value)

    def content(self) -> dict[str, Any]:
        """The findings as plain data for `film.json` and `diagnosis.json`."""
        return {
            "gravity": self._gravity_content() if self.from_gravity is None else None,
            "from_gravity": None if self.from_gravity is None else self.from_gravity.model_dump(),
            "rests": [rest.model_dump() for rest in self.rests],
            "without_angle": self.without_angle,
            "said": self.sentences(),
        }

    def _gravity_content(self) -> dict[str, Any] | None:
        gravity, fps = self.gravity, self.true_fps()
        if gravity is None or fps is None:
            return None
        return {
            "value_m_s2": gravity.gravity_m_s2.value,
            "error_m_s2": gravity.gravity_m_s2.error,
            "ci95_m_s2": list(gravity.gravity_m_s2.ci95),
            "stated_m_s2": self.stated_m_s2,
            "flights": self.flights,
            "releases": self.releases,
            "left_out": self.left_out,
            "position_noise_m": gravity.noise_m,
            "instant_noise_s": gravity.instant_noise_s,
            "slow_errors": gravity.slow,
            "air_share": self.air[0],
            "tilt_rad": gravity.tilt_rad.value,
            "tilt_ci95_rad": list(gravity.tilt_rad.ci95),
            "off": self.off,
            "effects": self.suspects,
            "parameters": self.parameters(),
            "true_fps": {"value": fps.value, "ci95": list(fps.ci95)},
        }

    def sentences(self) -> list[str]:
        """The findings in sentences; the first one is about gravity."""
        sentences = [self._gravity_sentence()]
        sentences += [line for line in (self._tilt_sentence(),) if line]
        sentences += [_rest_sentence(rest) for rest in self.rests]
        if names := self.without_angle:
            whose = f"block {names[0]}" if len(names) == 1 else f"the blocks {', '.join(names)}"
            sentences.append(
                f"the angle of {whose} was not measured: the spin is unknown, so that effects on the spin, and on the "
                "speed along the ground after an impact, can hardly be judged"
            )
        return sentences

    def _gravity_sentence(self) -> str:
        ratio, fps = self.ratio, self.true_fps()
        if self.gravity is None or ratio is None or fps is None:
            return "no flight shows gravity clearly: scale and frame rate cannot be checked"
        if self.from_gravity is not None:
            return self._given_sentence(self.from_gravity)
        found = (
            f"g = {with_error(self.gravity.gravity_m_s2)} m/s² in {counted(self.flights, 'flight')} of "
            f"{counted(self.releases, 'release')}"
        )
        size = Measured(100.0 * abs(ratio.value - 1.0), 100.0 * ratio.error)
        if self.off:
            way = "long" if ratio.value > 1.0 else "short"
            near = GRAVITY_RATIO[0] < ratio.value < GRAVITY_RATIO[1]
            carried = "" if near else ". Did the block fly there, or did something carry it?"
            return (
                f"{{{', '.join(SCALE_OR_RATE)}}}: {with_error(size, ' %')}. {found}, stated {self.stated_m_s2:g}: "
                f"lengths are {with_error(size, ' %')} too {way}, or the true frame rate is {with_error(fps)} and "
                f"not {self.fps:g} frames/s, or both are off. Flights alone cannot tell which{carried}"
            )
        if ratio.off(1.0):
            spin = f", the lift of an unmeasured spin (up to {_rounded(100 * self.spin)} %)" if self.spin else ""
            return (
                f"{found} differs from the stated {self.stated_m_s2:g} by {with_error(size, ' %')}, no more than air "
                f"(about {_rounded(100 * abs(self.air[0]))} %){spin} and the place on the earth "
                f"({100 * LOCAL_GRAVITY:g} %) explain"
            )
        return (
            f"{found} agrees with the stated {self.stated_m_s2:g}: scale, or the square of the frame rate, is right to "
            f"{_rounded(100.0 * (abs(ratio.value - 1.0) + 1.96 * ratio.error))} %, unless their errors cancel"
        )

    def _given_sentence(self, given: FromGravity) -> str:
        rate = given.which == "fps"
        error = given.relative_error
        what = f"the frame rate, {with_error(Measured(self.fps, self.fps * error))} frames/s," if rate else "the scale"
        off = "all speeds" if rate else "all lengths and speeds"
        return (
            f"{what} was taken from gravity, {self.stated_m_s2:g} m/s², in {counted(self.flights, 'flight')} of "
            f"{counted(self.releases, 'release')}: scale and frame rate cannot be checked, and {off} may be off alike "
            f"by {_rounded(100 * error)} % (1 standard error)"
        )

    def _tilt_sentence(self) -> str:
        gravity = self.gravity
        if gravity is None or not gravity.tilt_rad.off(0.0):
            return ""
        tilt, air = gravity.tilt_rad, self.air[1]
        if min(abs(tilt.value - share) for share in np.linspace(0.0, 2.0 * air, 21)) <= 2.0 * tilt.error:
            return ""
        degrees = Measured(float(np.rad2deg(abs(tilt.value))), float(np.rad2deg(tilt.error)))
        way = "counter-clockwise" if tilt.value > 0 else "clockwise"
        return (
            f"{{camera_tilt}}: {with_error(degrees, '°')}. Blocks do not fall straight down in the picture: it is "
            f"turned {way} against the vertical, or a force acts along x"
        )


def film_findings(
    data: FilmSegments, world: World, fps: float, from_gravity: FromGravity | None = None
) -> FilmFindings:
    """The findings about a film, from its segments in a `world`. `fps`: stated frame rate; `from_gravity`: scale or
    frame rate, if it was computed from gravity."""
    film, flights = data.film, data.flights
    gravity = flight_gravity(film, flights, world.gravity_m_s2) if world.gravity_m_s2 > 0 else None
    used = gravity.used if gravity is not None else np.zeros(len(flights), bool)
    # expected drag over mass, c / m in 1/m
    drag_of = [
        DRAG_COEFFICIENT.get(block.shape, OTHER_DRAG_COEFFICIENT) / drag_coefficient(block, 1.0)
        for block in world.blocks.values()
    ]
    drag, air, spin = np.array(drag_of)[flights.block], (0.0, 0.0), 0.0
    if gravity is not None:
        change = -(gravity.weight * drag) @ gravity.speed_velocity
        air = float(-change[Y] / world.gravity_m_s2), float(change[X] / world.gravity_m_s2)
        # lift acts across the velocity and may be as strong as drag: Mehta (1985)
        lift = gravity.weight * drag * ~film.angle_known[flights.release]
        spin = float(lift @ np.abs(gravity.speed_velocity[:, X])) / world.gravity_m_s2
    return FilmFindings(
        world.gravity_m_s2, fps, gravity, int(used.sum()), len(np.unique(flights.release[used])), int((~used).sum()),
        air, spin, rest_heights(film, world), film.blocks_without_angle, from_gravity,
    )  # fmt: skip


def write_film_findings(folder: Path, findings: FilmFindings) -> None:
    """Write `film.json` into an experiment folder."""
    text = json.dumps(findings.content(), indent=1, allow_nan=False, ensure_ascii=False)
    write_whole(folder / FILM_FILE, text + "\n")


def _rest_sentence(own: FilmRest) -> str:
    way = "above" if own.height_m > 0 else "below"
    size = f"{1e3 * abs(own.height_m):.2g}"
    error = "" if own.error_m is None else f" ± {1e3 * own.error_m:.1g}"
    ask = ": are its size, the scale, the origin and the ground right?" if _is_above_ground(own) else ""
    return (
        f"at rest, block {own.block} lies {size}{error} mm {way} the stated ground, "
        f"{100 * abs(own.height_radii):.2g} % of its radius ({counted(own.rests, 'release')}){ask}"
    )


def _decimals(error: float) -> int:
    """Number of decimals with which an error has one significant digit, or two if the first is 1."""
    if not (error > 0.0 and math.isfinite(error)):
        return 3
    first = math.floor(math.log10(error))
    return max(0, -first + (error / 10.0**first < 1.95))


def with_error(own: Measured, unit: str = "") -> str:
    """A value and its standard error, with as many digits as the error allows."""
    places = _decimals(own.error)
    return f"{own.value:.{places}f}{unit} ± {own.error:.{places}f}"


def _rounded(value: float) -> str:
    return f"{value:.2g}"


def flightless_remarks(data: FilmSegments) -> list[str]:
    """A remark on releases without a recognised flight."""
    film = data.film
    missing = np.setdiff1d(np.arange(len(film.release_names)), data.flights.release)
    if not len(missing):
        return []
    number = f"{counted(len(missing), 'release')} ({comma_list(film.release_names[missing].tolist())})"
    return [
        f"no flight was recognised in {number}: nothing is learnt from it. The frames do not lie on parabolas to "
        "within the noise of the film, or the block never flies"
    ]


def shape_remarks(data: FilmSegments, world: World) -> list[str]:
    """A remark on each block whose penetration depends on its angle, as with a wrong shape."""
    depth, angle, block = _lowest_points(data, world)
    remarks = []
    for b, name in enumerate(data.film.block_names):
        rows = block == b
        if rows.sum() >= FEWEST_SHAPE_IMPACTS and _depends(depth[rows], angle[rows]):
            remarks.append(
                f"the depth to which block {name} sinks into the ground depends on its angle: are its shape "
                f"({world.blocks[name].shape}) and sizes right?"
            )
    return remarks


def _lowest_points(data: FilmSegments, world: World) -> tuple[Array, Array, Array]:
    """For each impact: height of the block above the ground at its lowest, in radii, angle between block and ground,
    and index of the block."""
    flights, film, blocks = data.flights, data.film, list(world.blocks.values())
    arrays = [block_arrays(b) for b in blocks]
    ground = ground_arrays(world.cross_section)
    rows = []
    for before, after in zip(data.impacts.before, data.impacts.after, strict=True):
        first = flights.last[before] - CONTACT_MARGIN_FRAMES
        last = flights.first[after] + CONTACT_MARGIN_FRAMES
        if last - first > MOST_IMPACT_FRAMES or not film.angle_known[flights.release[before]]:
            continue
        block = int(flights.block[before])
        pose = world.view.true(film.pose[first:last])
        clearance = clearances(arrays[block], ground, pose)
        low = int(np.argmin(clearance))
        facet = nearest_facets(pose[low : low + 1, POSITION], world.cross_section.points_m)[0]
        tangent = world.cross_section.tangents[facet]
        turn = pose[low, THETA] - np.arctan2(tangent[1], tangent[0])
        rows.append((clearance[low] / blocks[block].radius_m, turn, block))
    columns = np.array(rows, float).reshape(-1, 3).T
    return columns[0], columns[1], columns[2]


def _depends(depth: Array, angle: Array) -> bool:
    """Whether the second or fourth harmonic of the depth is large and significant."""
    off = np.abs(depth - np.median(depth))
    use = off <= OUTLYING_DEPTH_MADS * np.median(off)
    waves = [wave(n * angle[use]) for n in HARMONICS for wave in (np.cos, np.sin)]
    design = np.column_stack([np.ones(use.sum()), *waves])
    freedom = len(design) - design.shape[1]
    if freedom < 1 or np.linalg.cond(design) > LARGEST_CONDITION:  # the angles vary too little
        return False
    fitted = np.linalg.lstsq(design, depth[use], rcond=None)[0]
    variance = ((depth[use] - design @ fitted) ** 2).sum() / freedom
    error = np.sqrt(variance * np.diag(np.linalg.inv(design.T @ design)))[1:].reshape(-1, 2).max(axis=1)
    amplitude = np.hypot(*fitted[1:].reshape(-1, 2).T)
    clear = (amplitude > LEAST_AMPLITUDE_RADII) & (amplitude > CLEAR_AMPLITUDE * error)
    return bool(clear[list(TELLING_HARMONICS)].any())
