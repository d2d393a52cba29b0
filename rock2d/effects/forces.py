"""The combined compiled laws of all effects, which the engines add to the contact law and to free flight.

An effect can define any of these laws, compiled (`rock2d.compiled.kernel`). The first arguments are the effect's own
columns, in the order of `Effect.columns`. The engines call a law only if one of its columns is not 0:

- normal(columns, depth, rate, peak, bottom, force_n): normal force in N to be added to the contact law's `force_n`.
  While the ground presses (depth >= bottom of the indentation) the sum is at least 0; in the indentation it
  can be negative (a pull)
- friction(columns, slip): factor on tan φ
- tangential(columns, depth, slip, force_n): force in N against the slip, in addition to the tangential spring;
  `force_n` is the whole normal force
- flight(columns, vx, vy, omega, mass, inertia): accelerations (m/s², m/s², rad/s²), in flight and in contact
- recoil(columns, force, shift, speed): acceleration in m/s² that the frame of ground that yields horizontally as a body
  adds to the block, see `effects/ground.py`; `force` in N on the block along x by all contacts with this ground; its
  displacement in m in this impact and its speed in m/s. The ground recoils where the first of the columns is not 0
- departure(columns, vx, vy, omega): the velocities (m/s, m/s, rad/s) at the end of an impact in this zone

depth, peak : penetration in m, and the deepest of this contact; rate : of the depth in m/s; slip : tangential velocity
of the contact point in m/s. No law adds energy; the dissipated energy is the share "effects" of the energy audit."""

from typing import Any

from rock2d.compiled import kernel
from rock2d.effects import catalogue
from rock2d.effects.columns import AIR_NAMES, CONTACT_NAMES


def _combined_law(law: str, arguments: str, start: str, step: str) -> Any:
    """One compiled function of (row, first column, arguments) that combines the `law` of every effect that has one.

    `start`: start values of the result, as statements "name = value"; `step`: statement that updates them with the
    result `new` of an effect. The source is compiled under this file's name, so that numba caches the function on disk.
    """
    names = CONTACT_NAMES if law != "flight" else AIR_NAMES
    values = ", ".join(part.split("=")[0].strip() for part in start.split(";"))
    source = [f"def {law}(row, first, {arguments}):" if arguments else f"def {law}(row, first):", f"    {start}"]
    laws = {}
    for name, effect in catalogue().items():
        compiled = getattr(effect, law)
        if compiled is None:
            continue
        laws[name] = compiled
        columns = [f"row[first + {names.index(c)}]" for c in effect.columns]
        source += [
            f"    if {' or '.join(f'{c} != 0.0' for c in columns)}:",
            f"        new = {name}({', '.join([*columns, *([arguments] if arguments else [])])})",
            f"        {step}",
        ]
    source.append(f"    return {values}")
    scope: dict[str, Any] = {**laws, "__name__": __name__}
    exec(compile("\n".join(source), __file__, "exec"), scope)
    return kernel(scope[law])


normal = _combined_law("normal", "depth, rate, peak, bottom, force_n", "total = 0.0", "total += new")
friction = _combined_law("friction", "slip", "factor = 1.0", "factor *= new")
tangential = _combined_law("tangential", "depth, slip, force_n", "total = 0.0", "total += new")
recoil = _combined_law("recoil", "force, shift, speed", "total = 0.0", "total += new")
RECOIL_COLUMN = next(CONTACT_NAMES.index(e.columns[0]) for e in catalogue().values() if e.recoil is not None)
departure = _combined_law("departure", "vx, vy, omega", "vx = vx; vy = vy; omega = omega", "vx, vy, omega = new")
_flight = _combined_law(
    "flight", "vx, vy, omega, mass, inertia", "ax = 0.0; ay = 0.0; alpha = 0.0",
    "ax, ay, alpha = ax + new[0], ay + new[1], alpha + new[2]",
)  # fmt: skip


@kernel
def flight(air, vx, vy, omega, mass, inertia):
    """Accelerations (m/s², m/s², rad/s²) of a block with these `air` columns, in addition to gravity."""
    return _flight(air, 0, vx, vy, omega, mass, inertia)


@kernel
def ground_forces(row, first, motion, force_n):
    """(whole normal force in N, factor on tan φ, force against the slip in N) of a contact with effects.

    motion : (depth in m, its rate in m/s, slip in m/s, peak depth in m, depth of the indentation's bottom in m)"""
    depth, rate, slip, peak, bottom = motion
    total = force_n + normal(row, first, depth, rate, peak, bottom, force_n)
    if depth >= bottom:
        total = max(0.0, total)
    return total, friction(row, first, slip), tangential(row, first, depth, slip, total)
