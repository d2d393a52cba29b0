"""Plausibility of a site: impossible and unusual values, with the usual range.

Wrong units are the most expensive mistakes in input files: a block of 4.7 kg instead of 4.7 t runs without an error.
Each check compares two numbers of the input with each other, or one number with the range in nature."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rock2d.arrays import Array
from rock2d.scene.blocks import Block
from rock2d.scene.cross_section import CrossSection, Embankment, ditch_before
from rock2d.scene.rough_ground import Roughness, smooth_share

USUAL_DENSITY_KG_M3 = (1500.0, 4000.0)  # rock and concrete
POSSIBLE_DENSITY_KG_M3 = (5.0, 22_600.0)  # the lightest foams; osmium
USUAL_LENGTH_M, LARGEST_LENGTH_M = (0.2, 5000.0), 50_000.0  # of a cross-section
LARGEST_RELIEF_M = 9000.0
LARGEST_BLOCK_SHARE, SMALLEST_BLOCK_SHARE = 0.2, 2e-4  # size of a block as a share of the extent of the site
NARROWEST_CREST_SIZES = 0.5  # in sizes of the block
USUAL_FRICTION_DEG = (5.0, 60.0)  # from ice on; a smaller number may be in rad
USUAL_SLOPE_REDUCTION_DEG = (1.0, 45.0)  # the same, where there is one
LEAST_ROUGHNESS_DEG, LARGEST_SMOOTH_SHARE = 1.0, 0.1  # of a rough zone; the latter of facets too short to be cut
HIGHEST_START_M, HIGHEST_START_SIZES = 10.0, 10.0  # above the highest ground, in m and in sizes of the block
USUAL_INDENTATION_SIZES = (0.001, 2.0)  # in sizes of the block, at the highest speed that the site allows
USUAL_SPEED_M_S = 50.0
LARGEST_ANGLE_RAD = 6.3  # a full turn; a larger number may be in degrees
USUAL_GRAVITY_M_S2 = (9.7, 9.9)
MOST_INRADII_ABOVE_FOOT = 3.0  # inradii above the foot of a line: at usual facings, centroids cross lower
# factor that gives a usual density -> likely mistake
UNIT_ERRORS = {
    1000.0: "mass in t instead of kg, or the density in t/m³", 1e-3: "mass in g instead of kg",
    1e6: "size in cm instead of m", 1e9: "size in mm instead of m",
}  # fmt: skip


@dataclass(frozen=True)
class Doubt:
    """An impossible or unusual value of an input.

    Attributes
    ----------
    text : a sentence with the number and the usual range
    key : path of the key in a scenario
    impossible : no site has such a value"""

    text: str
    key: tuple[str, ...]
    impossible: bool = False


def density_kg_m3(block: Block) -> tuple[float, float]:
    """(density of the deepest, of the thinnest plausible body) with this profile.

    The depth of the body is the largest, or the smallest, diameter of the profile. A smooth profile counts as a
    spheroid, which has two thirds of the volume of the prism."""
    volume = block.area_m2 * (2.0 / 3.0 if block.smooth else 1.0)
    return block.mass_kg / (volume * 2.0 * block.radius_m), block.mass_kg / (volume * 2.0 * block.inradius_m)


def site_doubts(ground: CrossSection, gravity_m_s2: float) -> Iterator[Doubt]:
    """Doubts about the extent of the cross-section and about gravity."""
    length, relief = np.ptp(ground.points_m, axis=0)
    extent, key = f"the cross-section is {length:.4g} m long and {relief:.4g} m high", ("cross_section",)
    if length > LARGEST_LENGTH_M or relief > LARGEST_RELIEF_M:
        yield Doubt(f"{extent}: no slope is so large. Are its points in mm?", key, impossible=True)
    elif not USUAL_LENGTH_M[0] <= length <= USUAL_LENGTH_M[1]:
        yield Doubt(f"{extent}; usual lengths: {_range(USUAL_LENGTH_M)} m. Are its points in m?", key)
    if gravity_m_s2 and not USUAL_GRAVITY_M_S2[0] <= gravity_m_s2 <= USUAL_GRAVITY_M_S2[1]:
        yield Doubt(f"gravity is {gravity_m_s2:g} m/s²; on the earth it is 9.78 to 9.83", ("gravity_m_s2",))


def block_doubts(block: Block, ground: CrossSection) -> Iterator[Doubt]:
    """Doubts about the density of a block, and about its size compared with the site."""
    key, (low, high) = ("blocks", block.name), USUAL_DENSITY_KG_M3
    lightest, heaviest = density_kg_m3(block)
    if heaviest < low or lightest > high:
        density = heaviest if heaviest < low else lightest
        unit = next((f". Is the {said}?" for times, said in UNIT_ERRORS.items() if low <= times * density <= high), "")
        text = (
            f"block {block.name} has a density of {density:.3g} kg/m³ ({block.mass_kg:g} kg, {block.size_m:.3g} m); "
            f"usual: {_range(USUAL_DENSITY_KG_M3)}{unit}"
        )
        yield Doubt(text, key, not POSSIBLE_DENSITY_KG_M3[0] <= density <= POSSIBLE_DENSITY_KG_M3[1])
    extent = float(np.ptp(ground.points_m, axis=0).max())
    text = f"block {block.name} of {block.size_m:.3g} m on a site of {extent:.3g} m; usual:"
    if block.size_m > LARGEST_BLOCK_SHARE * extent:
        yield Doubt(f"{text} less than a fifth", key, impossible=block.size_m > extent)
    elif block.size_m < SMALLEST_BLOCK_SHARE * extent:
        yield Doubt(f"{text} more than {SMALLEST_BLOCK_SHARE:g} of it. Is its size in m?", key)


def earthwork_doubts(block: Block, ground: CrossSection) -> Iterator[Doubt]:
    """Doubts about the size of a block compared with each embankment, its crest, and the level ground before it, which
    need not be a ditch."""
    key = ("blocks", block.name)
    for number, bank in _numbered(ground):
        level = float(np.abs(np.diff(ground.points_m[:, 0]))[ditch_before(ground, bank)].sum())
        if 0.0 < level < block.size_m:
            text = f"block {block.name} of {block.size_m:.3g} m is larger than the level ground before the embankment"
            yield Doubt(f"{text}{number}, {level:.3g} m wide", key)
        if block.size_m > bank.height_m:
            text = f"block {block.name} of {block.size_m:.3g} m is higher than the embankment{number} of "
            yield Doubt(f"{text}{bank.height_m:.3g} m", key)
        crest = float(np.ptp(ground.points_m[[bank.crest, bank.crest_end], 0]))
        of = f" of embankment{number}" if number else ""
        if crest < NARROWEST_CREST_SIZES * block.size_m:
            text = f"block {block.name} of {block.size_m:.3g} m meets a crest{of} {crest:.3g} m wide; usual: wider "
            yield Doubt(f"{text}than half the block. rock2d does not model damage of the embankment", key)


def angle_doubts(words: str, angles_deg: Mapping[str, float], usual_deg: tuple[float, float]) -> Iterator[Doubt]:
    """Doubts about an angle by zone that may be in rad; 0 is none."""
    for zone, angle in angles_deg.items():
        if 0.0 < angle < usual_deg[0]:
            text = f"the {words} in {zone} is {angle:.3g} degrees; usual: {_range(usual_deg)}"
            yield Doubt(f"{text}. Is it in rad?", ("model",))


def contact_doubts(block: Block, stiffness_N_m: Mapping[str, float], speed_m_s: float) -> Iterator[Doubt]:
    """Doubts about the penetration of a block at the highest speed into the ground of each zone, v √(m / k_l). At most
    one doubt of each kind."""
    depth = {zone: speed_m_s * np.sqrt(block.mass_kg / k) / block.size_m for zone, k in stiffness_N_m.items()}
    if not depth:
        return
    low, high = USUAL_INDENTATION_SIZES
    for zone in {min(depth, key=depth.__getitem__), max(depth, key=depth.__getitem__)}:
        if not low <= depth[zone] <= high:
            yield Doubt(
                f"at {speed_m_s:.3g} m/s, the highest speed that the site allows, block {block.name} goes "
                f"{depth[zone] * block.size_m:.3g} m deep into {zone}, {depth[zone]:.3g} of its size; usual: "
                f"{low:g} to {high:g}. Is k_l_N_m ({stiffness_N_m[zone]:.3g}) that of such a block?", ("model",),
            )  # fmt: skip


def start_doubts(
    block: Block, states: Array, ground: CrossSection, gravity_m_s2: float, key: tuple[str, ...]
) -> Iterator[Doubt]:
    """Doubts about possible starts (n, 6) of a block: speed, angle, spin, height, and place relative to embankment and
    measure lines."""
    name, speed = block.name, float(np.hypot(states[:, 3], states[:, 4]).max())
    if speed > USUAL_SPEED_M_S:
        text = f"block {name} starts with up to {speed:.3g} m/s; the fastest blocks on slopes reach {USUAL_SPEED_M_S:g}"
        yield Doubt(text, key)
    angle, spin = (float(np.abs(states[:, i]).max()) for i in (2, 5))
    if angle > LARGEST_ANGLE_RAD:
        text = f"block {name} starts at angles of up to {angle:.3g} rad; usual: up to a full turn, {2 * np.pi:.3g} rad"
        yield Doubt(f"{text}. Is theta_rad in degrees?", key)
    if (rim := spin * block.radius_m) > USUAL_SPEED_M_S:
        text = f"block {name} starts with a spin of up to {spin:.3g} rad/s, {rim:.3g} m/s at its rim; usual: up to "
        yield Doubt(f"{text}{USUAL_SPEED_M_S:g} m/s. Is omega_rad_s in degrees per second?", key)
    if states[:, 3].mean() < 0.0 and ground.points_m[0, 1] > ground.points_m[-1, 1]:
        text = f"block {name} starts to the left, with {states[:, 3].mean():.3g} m/s on average"
        yield Doubt(f"{text}; the ground falls to the right", key)
    above = float(states[:, 1].max() - ground.points_m[:, 1].max())
    if above > max(HIGHEST_START_M, HIGHEST_START_SIZES * block.size_m):
        text = f"block {name} starts up to {above:.3g} m above the highest ground"
        yield Doubt(f"{text}; usual: up to {HIGHEST_START_M:g} m. Is y_m its height above the ground?", key)
    for number, bank in _numbered(ground):
        crest_end = ground.points_m[bank.crest_end, 0]
        if states[:, 0].min() > crest_end:
            text = f"block {name} starts behind the crest of the embankment{number}, which ends at x = "
            yield Doubt(f"{text}{crest_end:.4g} m", key)
    if gravity_m_s2 <= 0.0:
        return
    head = float((states[:, 1] + np.sum(states[:, 3:5] ** 2, axis=1) / (2.0 * gravity_m_s2)).max())
    for line, ends in ground.measure_lines.items():
        lowest = float(np.min(ends[:, 1]))
        if lowest > head:
            text = (
                f"no block {name} reaches measure line {line}: it begins {lowest:.4g} m high, and the energy at the "
                f"start lifts the block to {head:.4g} m"
            )
            yield Doubt(text, ("cross_section", "measure_lines", line))


def rough_ground_doubts(ground: CrossSection, roughness: Mapping[str, Roughness]) -> Iterator[Doubt]:
    """Doubts about rough zones: slopes that hardly vary, and facets that are too short to be cut."""
    for zone, own in roughness.items():
        key, sd_deg = ("roughness", zone), np.rad2deg(own.sd_rad)
        if sd_deg < LEAST_ROUGHNESS_DEG:
            text = f"the slopes in {zone} vary by {sd_deg:.3g} degrees; usual: {LEAST_ROUGHNESS_DEG:g} to 20"
            yield Doubt(f"{text}. Is sd_deg in rad?", key)
        if (share := smooth_share(ground, zone, own)) > LARGEST_SMOOTH_SHARE:
            text = f"{100 * share:.0f} % of {zone} stay smooth, in facets shorter than length_m, {own.length_m:g} m"
            yield Doubt(f"{text}: leave out points (rock2d profile --tolerance), or make length_m smaller", key)


def rough_point_doubts(zones: Sequence[str]) -> Iterator[Doubt]:
    """Doubts about point masses in these rough zones, which have no slope reduction of the rebound law."""
    if zones:
        yield Doubt(
            f"point masses meet rough ground without a slope reduction in {', '.join(zones)}: many stop early, "
            "because only the reduction turns their speed away from the ground again. With slope_reduction_deg there, "
            "which then stands for the roughness, more of them arrive", ("roughness",),
        )  # fmt: skip


def highest_speed_m_s(states: Array, ground: CrossSection, gravity_m_s2: float) -> float:
    """Highest speed after a fall without loss from the starts (n, 6) to the lowest ground."""
    fall = np.maximum(states[:, 1] - ground.points_m[:, 1].min(), 0.0)
    return float(np.sqrt((states[:, 3:5] ** 2).sum(axis=1) + 2.0 * gravity_m_s2 * fall).max())


def line_remarks(cross_section: CrossSection, blocks: Iterable[Block]) -> list[str]:
    """A remark on each measure line that the centroid of a block cannot cross, or only far above its foot.

    The centroid stays at least the inradius of the block away from the surface, except for the penetration. So blocks
    cross a line close to a steep facing only above the facing."""
    import shapely

    surface = shapely.LineString(cross_section.points_m)
    lines = {
        name: (shapely.Point(cross_section.foot_and_head(ends)[0]), shapely.LineString(ends))
        for name, ends in cross_section.measure_lines.items()
    }
    remarks = []
    for block in blocks:
        out_of_reach = surface.buffer(block.inradius_m)
        for name, (foot, line) in lines.items():
            pieces = [
                piece
                for piece in shapely.get_parts(shapely.difference(line, out_of_reach))
                if not piece.is_empty
                and not cross_section.covers(np.array(piece.interpolate(0.5, normalized=True).coords))[0]
            ]
            lowest = min((foot.distance(piece) for piece in pieces), default=np.inf)
            if not pieces:
                remarks.append(
                    f"the centroid of block {block.name} cannot cross measure line {name}: the whole line is closer to "
                    f"the ground than {block.inradius_m:.3g} m"
                )
            elif lowest > MOST_INRADII_ABOVE_FOOT * block.inradius_m and foot.distance(surface) < block.inradius_m:
                remarks.append(
                    f"the centroid of block {block.name} can cross measure line {name} only {lowest:.3g} m or more "
                    f"above its foot: below, the line is closer to the ground than {block.inradius_m:.3g} m"
                )
    return remarks


def _numbered(ground: CrossSection) -> Iterator[tuple[str, Embankment]]:
    """The embankments with their numbers as text; the text is empty if there is only one."""
    banks = ground.embankments
    for i, bank in enumerate(banks, start=1):
        yield f" {i}" if len(banks) > 1 else "", bank


def _range(ends: tuple[float, float]) -> str:
    return f"{ends[0]:,g} to {ends[1]:,g}"
