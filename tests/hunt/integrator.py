"""One impact by an independent integrator: `python -m tests.hunt.integrator --impacts 200 --seed 7` holds the engines
to it.

Shared with the engines are the laws alone; geometry (`own_geometry`), springs, regimes and time integration (DOP853,
every change of regime an event) are of its own. The contact law in its regimes: a contact loads for the first time,
unloads elastically (or loads again), or is free above the bottom of its indentation; its tangential spring holds or
slips, its rolling spring winds or is at its cap."""

import sys
from dataclasses import dataclass, field
from math import inf
from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_ivp

from rock2d.laws.contact import ContactParameters, normal_force, residual_indentation, rolling_moment, tangential_force
from rock2d.scene.blocks import Block
from rock2d.scene.cross_section import CrossSection
from tests.hunt.cases import GRAVITY_M_S2, Site
from tests.hunt.own_geometry import Feature, LeftOutError, Scene, first_touch

Array = np.ndarray

LOADING, ELASTIC, FREE = "loading", "elastic", "free"
RTOL, ATOL = 1e-11, 1e-13
LONGEST_STEP = 0.25  # rad of the stiffest oscillation: events come one by one
LONGEST_HOP = 0.01  # radii that a block which no contact presses moves in a step
BEHIND = 1e-12  # how far behind an event a segment ends, in radii and incident speeds
JUMP = 1e-6  # radii: contacts whose depth jumps by more are left out
MOST_SEGMENTS, MOST_STEPS = 600, 10000


@dataclass
class Contact:
    """Memory of a contact. `slips` and `capped`: -1 or 1 while the spring is at that end of its limit, 0 while not."""

    key: object
    feature: Feature
    law: ContactParameters
    zone: str
    offset: float
    peak: float = 0.0
    regime: str = LOADING
    slips: int = 0
    capped: int = 0

    @property
    def bottom(self) -> float:
        """Bottom of the indentation in m."""
        return residual_indentation(self.peak, self.law.k_l_N_m, self.law.k_ul_N_m)


class Motion(NamedTuple):
    """A contact at one instant: place, penetration, rates of penetration and slip, normal force, its rate."""

    nx: float
    ny: float
    rx: float
    ry: float
    delta: float
    rate: float
    slip: float
    force: float
    force_rate: float


@dataclass
class Outcome:
    """What an impact did: instants and states (6,) at the touch and when the ground last pressed, the largest depth,
    and how it went."""

    touch_s: float
    before: Array
    after_s: float = np.nan
    after: Array = field(default_factory=lambda: np.full(6, np.nan))
    penetration_m: float = 0.0
    most_contacts: int = 0
    at_vertex: bool = False
    segments: int = 0


class Impact:
    """The first impact of a release (state (6,) in flight) on a site."""

    def __init__(self, site: Site, state: Array, gravity_m_s2: float = GRAVITY_M_S2) -> None:
        self.site, self.block, self.r = site, site.block, site.block.reach_m
        self.gravity = gravity_m_s2
        touch_s, before = first_touch(site.block, site.cross_section, state, self.gravity, site.time_limit_s)
        self.origin = before[:2].copy()
        self.scene = Scene(site.block, site.cross_section, self.origin)
        self.y = before - np.array([*self.origin, 0, 0, 0, 0])
        self.t, self.steps, self.outcome = 0.0, 0, Outcome(touch_s, before)
        self.speed = float(np.hypot(*before[3:5]))
        self.contacts: list[Contact] = []
        free = 1 / self.block.mass_kg + self.r**2 / self.block.inertia_kg_m2
        stiff = max(
            max((law.k_ul_N_m + law.k_t_N_m) * free, law.k_r_Nm_rad / self.block.inertia_kg_m2)
            for law in site.soils.values()
        )
        self.longest_step = LONGEST_STEP / np.sqrt(stiff)
        winding = max(law.k_r_Nm_rad for law in site.soils.values()) / self.block.inertia_kg_m2
        self.longest_hop = LONGEST_STEP / np.sqrt(winding) if winding > 0.0 else inf
        self._left: tuple[float, Array] | None = None
        self._touch()

    def run(self) -> Outcome:
        """Integrate until no contact is left."""
        while True:
            self._settle()
            if not self.contacts:
                break
            self._segment()
        assert self._left is not None
        out = self.outcome
        out.after_s, out.after = out.touch_s + self._left[0], self._left[1][:6].copy()
        out.after[:2] += self.origin
        return out

    # the law ------------------------------------------------------------------------------------------------

    def _motion(self, c: Contact, y: Array) -> Motion:
        x, h, theta, vx, vy, omega = y[:6].tolist()
        depth, nx, ny, rx, ry = self.scene.place(c.feature, x, h, theta)
        ux, uy = vx - omega * ry, vy + omega * rx
        delta, rate = depth - c.offset, -(ux * nx + uy * ny)
        stiffness, start = {
            LOADING: (c.law.k_l_N_m, 0.0), ELASTIC: (c.law.k_ul_N_m, c.bottom), FREE: (0.0, 0.0),
        }[c.regime]  # fmt: skip
        force, force_rate = stiffness * (delta - start), stiffness * rate
        return Motion(nx, ny, rx, ry, delta, rate, ux * ny - uy * nx, force, force_rate)

    def _friction(self, c: Contact, m: Motion, spring: float) -> float:
        """Force of the tangential spring in N; slipping, it is the limit whatever the spring."""
        if c.regime == FREE or c.law.k_t_N_m == 0.0 or c.law.tan_phi == 0.0:
            return 0.0
        return c.slips * c.law.tan_phi * m.force if c.slips else c.law.k_t_N_m * spring

    def _rolling(self, c: Contact, m: Motion, turned: float) -> float:
        """Moment of the rolling spring in N m."""
        if not self._winds(c):
            return 0.0
        if c.capped:
            return c.capped * float(np.hypot(m.rx, m.ry)) * m.force
        return c.law.k_r_Nm_rad * turned

    def _winds(self, c: Contact) -> bool:
        """Whether the rolling spring acts: with a cap there is nothing to wind while unpressed."""
        if c.law.k_r_Nm_rad == 0.0:
            return False
        return c.regime != FREE or (c.law.rolling_in_indentation and not c.law.rolling_cap)

    def _rates(self, _: float, y: Array) -> Array:
        """Rates of the state and of each contact's springs (tangential displacement, rotation)."""
        out = np.zeros(len(y))
        fx = fy = moment = 0.0
        for i, c in enumerate(self.contacts):
            m, k = self._motion(c, y), 6 + 2 * i
            along = self._friction(c, m, y[k])
            gx, gy = m.force * m.nx - along * m.ny, m.force * m.ny + along * m.nx
            fx, fy = fx + gx, fy + gy
            moment += m.rx * gy - m.ry * gx - self._rolling(c, m, y[k + 1])
            out[k] = m.slip if c.regime != FREE and not c.slips else 0.0
            out[k + 1] = y[5] if self._winds(c) and not c.capped else 0.0
        out[:3] = y[3:6]
        out[3:6] = (
            fx / self.block.mass_kg, fy / self.block.mass_kg - self.gravity, moment / self.block.inertia_kg_m2,
        )  # fmt: skip
        return out

    # the regimes --------------------------------------------------------------------------------------------

    def _margins(self, y: Array) -> list[tuple[float, str, int]]:
        """What must stay positive for the regimes to last, in radii and incident speeds: (margin, what ends, index of
        the contact)."""
        out: list[tuple[float, str, int]] = []
        fresh, same = self._follow(y)
        out.append((1.0 if same else -1.0, "feature", -1))
        out += [(-depth / self.r, "touch", -1) for _, depth in fresh.values()]
        for i, c in enumerate(self.contacts):
            m, r, v = self._motion(c, y), self.r, self.speed
            if c.regime == LOADING:
                out.append((m.rate / v, "turns", i))
            elif c.regime == ELASTIC:
                out += [((c.peak - m.delta) / r, "reloads", i), ((m.delta - c.bottom) / r, "lifts", i)]
            else:
                out += [((c.bottom - m.delta) / r, "presses", i), ((m.delta + c.offset) / r, "ends", i)]
            if c.regime != FREE:
                out += self._spring_margins(i, m, y)
        return out

    def _limits(self, i: int, m: Motion, y: Array) -> tuple[float, float, float, float]:
        """Limits of the springs of contact i (m, rad), and their rates."""
        c, (vx, vy, omega) = self.contacts[i], y[3:6].tolist()
        slip = rate = turn = turn_rate = inf
        if c.law.k_t_N_m > 0.0 and c.law.tan_phi < inf:
            slip, rate = (c.law.tan_phi / c.law.k_t_N_m * f for f in (m.force, m.force_rate))
        if c.law.k_r_Nm_rad > 0.0 and c.law.rolling_cap:
            arm, dt = float(np.hypot(m.rx, m.ry)), 1e-5 * self.r / (self.speed + abs(omega) * self.r)
            arms = [
                np.hypot(*self.scene.place(c.feature, *(y[:3] + s * dt * np.array([vx, vy, omega])))[3:])
                for s in (-1.0, 1.0)
            ]
            turn = arm * m.force / c.law.k_r_Nm_rad
            arm_rate = float(arms[1] - arms[0]) / (2 * dt)
            turn_rate = (arm_rate * m.force + arm * m.force_rate) / c.law.k_r_Nm_rad
        return slip, rate, turn, turn_rate

    def _spring_margins(self, i: int, m: Motion, y: Array) -> list[tuple[float, str, int]]:
        c, (slip, slip_rate, turn, turn_rate) = self.contacts[i], self._limits(i, m, y)
        out = []
        if c.slips and slip < inf:
            out.append(((c.slips * m.slip - slip_rate) / self.speed, "holds", i))
        elif slip < inf and c.law.tan_phi > 0.0:
            out.append(((slip - abs(y[6 + 2 * i])) / self.r, "slips", i))
        if c.capped and turn < inf:
            out.append(((c.capped * y[5] - turn_rate) * self.r / self.speed, "winds", i))
        elif turn < inf:
            out.append((turn - abs(y[7 + 2 * i]), "caps", i))
        return out

    def _follow(self, y: Array) -> tuple[dict[object, tuple[Feature, float]], bool]:
        """Features that no contact has, by key, and whether every contact has the feature found for it."""
        fresh, features = self._found(y)
        return fresh, all(f is not None and f[1] == c.feature for f, c in zip(features, self.contacts, strict=True))

    def _found(self, y: Array) -> tuple[dict, list[tuple[object, Feature] | None]]:
        pose = y[:3].tolist()
        found = self.scene.search(*pose)
        features: list[tuple[object, Feature] | None] = []
        for c in self.contacts:
            features.append((c.key, found.pop(c.key)[0]) if c.key in found else None)
        for i, c in enumerate(self.contacts):
            if features[i] is None and isinstance(c.key, int):
                beside = [k for k in (c.key - 1, c.key + 1) if k in found]
                if beside:
                    features[i] = beside[0], found.pop(beside[0])[0]
                elif kept := self.scene.kept_vertex(c.feature, *pose):
                    features[i] = c.key, kept
        return found, features

    # from segment to segment -----------------------------------------------------------------------------------

    def _segment(self) -> None:
        """Integrate to the next change of regime."""

        def event(_: float, y: Array) -> float:
            self.steps += 1
            if self.steps > MOST_STEPS:
                raise LeftOutError("too many steps")
            return min(m[0] for m in self._margins(y)) + BEHIND

        event.terminal, event.direction = True, -1  # type: ignore[attr-defined]
        r, v, longest = self.r, self.speed, self.longest_step
        if all(c.regime == FREE for c in self.contacts):
            pace = float(np.hypot(*self.y[3:5])) + abs(self.y[5]) * r + np.sqrt(self.gravity * r)
            longest = max(longest, min(self.longest_hop, LONGEST_HOP * r / pace))
        scale = np.array([r, r, 1.0, v, v, v / r] + [r, 1.0] * len(self.contacts))
        end = self.t + self.site.time_limit_s
        solved = solve_ivp(
            self._rates, (self.t, end), self.y, "DOP853", events=event, rtol=RTOL, atol=ATOL * scale,
            max_step=longest, first_step=1e-3 * self.longest_step,
        )  # fmt: skip
        if not solved.t_events[0].size:
            raise LeftOutError("does not end in time")
        self.t, self.y, behind = float(solved.t[-1]), solved.y[:, -1].copy(), 1e-12 * longest
        while min(m[0] for m in self._margins(self.y)) >= -0.5 * BEHIND and behind < 1e-6 * longest:
            # the root of a jump, as that of a feature, or of rounding, lies just before it
            self.t, self.y = self.t + behind, self.y + behind * self._rates(self.t, self.y)
            behind *= 2.0
        deepest = max(self.scene.place(c.feature, *self.y[:3]).depth for c in self.contacts)
        self.outcome.penetration_m = max(self.outcome.penetration_m, deepest)
        if self.scene.centre_depth(*self.y[:2]) > 0.0:
            raise LeftOutError("is buried")

    def _settle(self) -> None:
        """Change regimes until all can last; note when the ground stopped pressing."""
        for _ in range(40):
            margin, what, i = min(self._margins(self.y), key=lambda m: m[0])
            if margin >= -0.5 * BEHIND:
                break
            self._change(what, i)
            self.outcome.segments += 1
        else:
            raise LeftOutError("regimes without end")
        if self.outcome.segments > MOST_SEGMENTS:
            raise LeftOutError("too many regimes")
        self._hold_to_law()
        self.outcome.most_contacts = max(self.outcome.most_contacts, len(self.contacts))
        if any(c.regime != FREE for c in self.contacts):
            self._left = None
        elif self._left is None:
            self._left = self.t, self.y.copy()

    def _change(self, what: str, i: int) -> None:
        """Make the change of regime `what` of contact i."""
        if what == "touch":
            self._touch()
        elif what == "feature":
            self._move_on()
        elif what == "ends":
            self._end(i)
        else:
            c, k = self.contacts[i], 6 + 2 * i
            m = self._motion(c, self.y)
            slip, _, turn, _ = self._limits(i, m, self.y)
            if what == "turns":
                c.peak, c.regime = max(c.peak, m.delta), ELASTIC
            elif what == "reloads":
                c.regime = LOADING
            elif what == "lifts":
                c.regime, c.slips, c.capped, self.y[k] = FREE, 0, 0, 0.0
                if c.law.rolling_cap:
                    self.y[k + 1] = 0.0
            elif what == "presses":
                c.regime = ELASTIC
                self._start_springs(i)
            elif what == "holds":
                self.y[k], c.slips = c.slips * slip, 0
            elif what == "slips":
                c.slips = int(np.sign(self.y[k]))
            elif what == "winds":
                self.y[k + 1], c.capped = c.capped * turn, 0
            elif what == "caps":
                c.capped = int(np.sign(self.y[k + 1]))

    def _touch(self) -> None:
        """Begin the contact that lies deepest of those that no contact has."""
        fresh, _ = self._follow(self.y)
        key, (feature, depth) = max(fresh.items(), key=lambda item: item[1][1])
        if depth > JUMP * self.r:
            raise LeftOutError("a contact begins below the surface")
        zone = self.scene.zone(feature)
        self.contacts.append(Contact(key, feature, self.site.soils[zone], zone, depth))
        self.y = np.append(self.y, [0.0, 0.0])
        self.outcome.at_vertex |= feature[0] in ("face", "vertex")
        self._start_springs(len(self.contacts) - 1)

    def _start_springs(self, i: int) -> None:
        """Springs of a contact that begins to be pressed: they slip at once if their limits grow more slowly."""
        c = self.contacts[i]
        m = self._motion(c, self.y)
        _, rate, _, turn_rate = self._limits(i, m, self.y)
        if c.law.tan_phi > 0.0 and abs(m.slip) > rate:
            c.slips = int(np.sign(m.slip))
        if abs(self.y[5]) > turn_rate:
            c.capped = int(np.sign(self.y[5]))

    def _move_on(self) -> None:
        """Let contacts go on at the features that are theirs now."""
        _, features = self._found(self.y)
        for i in reversed(range(len(features))):
            c, found = self.contacts[i], features[i]
            depth = self.scene.place(c.feature, *self.y[:3]).depth
            if found is None:
                if depth > JUMP * self.r:
                    raise LeftOutError("a contact loses its feature")
                self._end(i)
            elif found[1] != c.feature:
                if abs(self.scene.place(found[1], *self.y[:3]).depth - depth) > JUMP * self.r:
                    raise LeftOutError("a contact jumps between features")
                zone = self.scene.zone(found[1], c.zone)
                if self.site.soils[zone] != c.law:
                    raise LeftOutError("a contact slides into another zone")
                c.key, c.feature, c.zone = *found, zone
                self.outcome.at_vertex |= c.feature[0] in ("face", "vertex")

    def _end(self, i: int) -> None:
        del self.contacts[i]
        self.y = np.delete(self.y, [6 + 2 * i, 7 + 2 * i])

    def _hold_to_law(self) -> None:
        """Each regime's forces must be what the law's functions say."""
        for i, c in enumerate(self.contacts):
            m, law, (s, turned) = self._motion(c, self.y), c.law, self.y[6 + 2 * i : 8 + 2 * i].tolist()
            near, pressed = 1e-9 * law.k_ul_N_m * self.r, c.regime != FREE
            arm, force = float(np.hypot(m.rx, m.ry)), max(m.force, 0.0)
            normal = normal_force(m.delta, c.peak, law.k_l_N_m, law.k_ul_N_m)
            s, turned = (1e3 * self.r * c.slips if c.slips else s), (1e3 * c.capped if c.capped else turned)
            friction = tangential_force(s, force, law.k_t_N_m, law.tan_phi)
            row = law.k_r_Nm_rad, float(law.rolling_cap), float(law.rolling_in_indentation)
            rolling = rolling_moment(turned, force, arm, *row)
            assert abs(normal - m.force) < near, (c, normal, m)
            if pressed and force > near:
                assert abs(friction - self._friction(c, m, s)) < near * max(1.0, law.k_t_N_m / law.k_l_N_m), c
                assert abs(rolling - self._rolling(c, m, turned)) < near * self.r, (c, rolling)


def on_plane(
    law: ContactParameters, ball: Block, v_n_m_s: float, v_t_m_s: float = 0.0, omega_rad_s: float = 0.0,
    gravity_m_s2: float = 0.0,
) -> Outcome:  # fmt: skip
    """A ball that falls by its radius and touches a wide plane with these velocities (v_n > 0 is inward)."""
    half = 1e3 * ball.reach_m * (1.0 + abs(v_t_m_s) / v_n_m_s)
    plane = CrossSection([[-half, 0.0], [half, 0.0]], ["floor"])
    above = np.sqrt(v_n_m_s**2 - 2.0 * gravity_m_s2 * ball.reach_m)
    # turned a little: a slip of exactly 0 lies on the limits of the regimes
    state = np.array([0.0, 2.0 * ball.reach_m, 0.3, v_t_m_s, -above, omega_rad_s])
    return Impact(Site(ball, {}, plane, {"floor": law}), state, gravity_m_s2).run()


if __name__ == "__main__":
    from tests.hunt.impact_check import main

    sys.exit(main())
