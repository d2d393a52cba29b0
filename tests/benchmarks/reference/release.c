/* The reference kernel: one release of the batch engine in plain C, the same algorithm with the same arithmetic in the
   same order. It tells how fast the law and the geometry can be; see tests/benchmarks/reference_kernel.py.

   As rock2d/engines/release.py, rest.py and recording.py, for sharp polygons and balls, without air, effects, samples,
   knots, held releases, and the rules that stop a release before it rests or leaves. */
#include <stdlib.h>
#include "model.h"
#include "notes.h"
#include "ground.h"
#include "contacts.h"
#include "steps.h"

enum { STOP_TIME, STOP_REST, STOP_EXIT, STOP_IMPACTS, STOP_SPENT, STOP_BURIED };
typedef struct { double begin, x, y, low_x, high_x, low_y, high_y, kinetic, before; } Watch;

static void fly(double *q, double tau, double gravity) {
    q[X] += q[VX] * tau;
    q[Y] += q[VY] * tau - 0.5 * gravity * tau * tau;
    q[THETA] += q[OMEGA] * tau;
    q[VY] -= gravity * tau;
}

static bool on_line(double x, double y, const double *line, double ax, double ay) {
    double at = ((x - line[0]) * ax + (y - line[1]) * ay) / (ax * ax + ay * ay);
    return 0.0 <= at && at <= 1.0;
}

/* the instant in (0, tau] at which the way from q0 to q1 crosses a line; -1 if it does not */
static double crossing_time(const double *line, double ax, double ay, const double *q0, const double *q1, double tau,
                            bool flight, double gravity) {
    double side0 = (q0[Y] - line[1]) * ax - (q0[X] - line[0]) * ay;
    double side1 = (q1[Y] - line[1]) * ax - (q1[X] - line[0]) * ay, when = -1.0;
    if (!flight) return side0 * side1 < 0.0 ? tau * side0 / (side0 - side1) : -1.0;
    double a = -0.5 * gravity * ax, b = q0[VY] * ax - q0[VX] * ay;
    if (a == 0.0) {
        if (b != 0.0) when = -side0 / b;
    } else {
        double disc = b * b - 4.0 * a * side0;
        if (disc > 0.0) {
            double root = -0.5 * (b + copysign(sqrt(disc), b));
            double one = root / a, two = root != 0.0 ? side0 / root : 0.0;
            double low = least(one, two), high = most(one, two);
            double x = q0[X] + q0[VX] * low, y = q0[Y] + q0[VY] * low - 0.5 * gravity * low * low;
            when = low > 0.0 && on_line(x, y, line, ax, ay) ? low : high;
        }
    }
    return 0.0 < when && when <= tau ? when : -1.0;
}

static void cross(double t, double tau, const double *q0, const double *q1, bool flight, const World *w,
                  double (*crossings)[7]) {
    for (int64_t k = 0; k < w->line_count; k++) {
        const double *line = w->lines[k];
        if (crossings[k][0] == crossings[k][0] || line[0] != line[0]) continue;
        double ax = line[2] - line[0], ay = line[3] - line[1], q[N_STATE];
        double when = crossing_time(line, ax, ay, q0, q1, tau, flight, w->gravity);
        if (when < 0.0) continue;
        for (int i = 0; i < N_STATE; i++) q[i] = flight ? q0[i] : q0[i] + when / tau * (q1[i] - q0[i]);
        if (flight) fly(q, when, w->gravity);
        if (!on_line(q[X], q[Y], line, ax, ay)) continue;
        crossings[k][0] = t + when;
        for (int i = 0; i < N_STATE; i++) crossings[k][1 + i] = q[i];
    }
}

static bool near_line(const double *q, double reach, const World *w, const double (*crossings)[7]) {
    for (int64_t k = 0; k < w->line_count; k++) {
        const double *line = w->lines[k];
        if (crossings[k][0] == crossings[k][0] || line[0] != line[0]) continue;
        double ax = line[2] - line[0], ay = line[3] - line[1], dx = q[X] - line[0], dy = q[Y] - line[1];
        double along = least(most((dx * ax + dy * ay) / (ax * ax + ay * ay), 0.0), 1.0);
        dx -= along * ax, dy -= along * ay;
        if (dx * dx + dy * dy < reach * reach) return true;
    }
    return false;
}

static void forget_rest(Watch *watch) { watch->begin = -1.0, watch->before = INFINITY; }

static bool watch_rest(Watch *r, double t, const double *q, const World *w) {
    double x = q[X], y = q[Y], radius = w->radius;
    if (r->begin < 0.0) *r = (Watch){t, x, y, x, x, y, y, 0.0, r->before};
    r->kinetic = most(r->kinetic, kinetic_energy(q, w));
    r->low_x = least(r->low_x, x), r->high_x = most(r->high_x, x);
    r->low_y = least(r->low_y, y), r->high_y = most(r->high_y, y);
    if (t - r->begin < 2.0 * sqrt(radius / most(w->gravity, 1e-9))) return false;
    double net = sqrt((x - r->x) * (x - r->x) + (y - r->y) * (y - r->y));
    double box = most(r->high_x - r->low_x, r->high_y - r->low_y);
    bool steady = net < least(0.4 * radius, 1.05 * r->before + 0.01 * radius);
    bool at_rest = steady && r->before < INFINITY && box < 0.6 * radius;
    at_rest = at_rest && r->kinetic < 0.25 * w->mass * w->gravity * radius;
    r->begin = -1.0, r->before = net;
    return at_rest;
}

static Impact open_impact(const Contact *memory, const World *w) {
    Impact impact = {0};
    for (int64_t j = w->contacts - 1; j >= 0; j--)
        if (memory[j].active) impact.zone = memory[j].zone;
    return impact;
}

static bool is_buried(const double *q, const World *w) {
    Range near = facet_range(w, q[X] - 2.0 * w->radius, q[X] + 2.0 * w->radius);
    int64_t kind, index;
    return point_depth(q[X], q[Y], w->facets, near.first, near.end, &kind, &index) > 0.0;
}

/* how far the centroid can come until the next look */
static double reach_of(const double *q, double h, const World *w, const Contact *memory) {
    double held = kinetic_energy(q, w) + stored_energy(memory, w), span = 8 * 8.0 * h;
    return span * (sqrt(2.0 * held / w->mass) + fabs(w->gravity) * span);
}

static APART bool set_anchor(Anchor *anchor, const double *q, double h, const World *w, const Contact *memory) {
    bool ball = w->corners == 0;
    int64_t kind, index;
    double allowance = least(ball ? 9.0 : 1.0, most(0.1, 16 * w->facet_m / w->radius)) * w->radius;
    double half = most(2.0 * w->radius, w->radius + allowance);
    Range near = facet_range(w, q[X] - half, q[X] + half);
    double depth = near_depth(q[X], q[Y], w, near, w->radius, &kind, &index);
    double guard = guard_distance(q, allowance, near, w, memory), pace = fabs(q[VX]) + fabs(q[VY]);
    if (!ball) guard = least(guard, most(-depth, 0.0)), pace += 1.5 * w->radius * fabs(q[OMEGA]);
    if (guard < h * pace) guard = 0.0;
    *anchor = (Anchor){q[X], q[Y], q[THETA], guard};
    return depth > 0.0;
}

static void pressing(const Contact *memory, const World *w, double loading_s, double floating_s, bool *loading,
                     bool *floating) {
    *loading = *floating = true;
    for (int64_t j = 0; j < w->contacts; j++) {
        const Contact *m = memory + j;
        if (!m->active) continue;
        const Law *p = w->law + m->zone;
        double pressed = m->depth - m->offset;
        *loading = *loading && pressed >= m->peak && goes_deeper(pressed, m->rate, loading_s);
        *floating = *floating && p->indentation == 0.0 &&
                    floats(pressed - residual(m->peak, p->k_l, p->k_ul), m->rate, floating_s);
    }
}

/* One release from its start to its end; q ends as the last state. Returns why it stopped. */
static int release(const World *w, double *q, StepSizes sizes, double time_limit, int64_t impact_limit, double *ended,
                   int64_t *impacts, double (*crossings)[7]) {
    Contact memory[MOST_CONTACTS] = {0}, found[MOST_CONTACTS] = {0};
    Anchor anchor = {0};
    Watch watch;
    Audit audit = {0};
    Impact impact = {0};
    double t = 0.0, until, old[N_STATE], highest = 0.0, growth = 1.0, share = 1.0, force, depth, h_contact = sizes.other;
    int64_t active = 0, steps = 0, looked = 0, count = 0, done;
    bool aloft = false, is_open = false, left = false, stale = false, noticed = false, buried = is_buried(q, w), near, flying;
    int stop = STOP_TIME;
    for (int64_t j = 0; j < w->contacts; j++)
        memory[j].key = found[j].key = -1, memory[j].depth = found[j].depth = NOWHERE;
    forget_rest(&watch);
    if (buried) stop = STOP_BURIED, time_limit = 0.0;

    while (t < time_limit) {
        if (!(w->x_low <= q[X] && q[X] <= w->x_high)) {
            stop = STOP_EXIT;
            break;
        }
        flying = active == 0;
        for (int i = 0; i < N_STATE; i++) old[i] = q[i];
        if (flying) {
            double tau = time_to_contact(q, w, h_contact);
            if (tau >= (w->corners > 0 ? h_contact : 0.01 * h_contact)) {
                tau = least(tau, time_limit - t);
                fly(q, tau, w->gravity);
                cross(t, tau, old, q, true, w, crossings);
                NOTE(STRIDES);
                if (!aloft) NOTE(FLIGHTS);
                aloft = true;
                t += tau;
                noticed = stale = false;
                continue;
            }
        }
        if (active > 0) aloft = false;
        if (steps >= looked) {
            looked = steps + 8;
            growth = least(4.0, step_growth(highest, memory, w)), share = 1.0;
            if (active > 0 && is_open && watch_rest(&watch, t, q, w)) {
                stop = STOP_REST;
                break;
            }
        }
        double h = h_contact * growth;
        if (active > 0 && anchor.guard > 0.0) {
            near = w->line_count > 0 &&
                   near_line(q, least(reach_of(q, h, w, memory), 2.0 * anchor.guard), w, crossings);
            until = t;
            int why = fast_contact_steps(q, &until, near ? 1 : looked - steps, time_limit,
                                         (StepSizes){sizes.loading * growth, 8.0 * h, h, 64.0 * h, share}, &anchor, w, memory, &impact,
                                         &left, &audit, &done, &share);
            steps += done;
            flying = why == HOPPED;
            if (flying) {
                NOTE(HOPS);
                looked = steps;
            } else if (why) {
                bool moved = done > 0 || old[X] != anchor.x || old[Y] != anchor.y;
                anchor.guard = 0.0;
                if (why == GUARD_LEFT && moved) buried = set_anchor(&anchor, q, h, w, memory);
            }
            stale = stale || done > 0;
            if (done == 0) continue;
        } else {
            bool loading, floating;
            steps++;
            near = true;
            pressing(memory, w, sizes.loading * growth, 8.0 * h, &loading, &floating);
            floating = floating && left && active > 0;
            if (active > 0) h = floating ? 8.0 * h : (loading ? sizes.loading * growth : h);
            double speed = sqrt(q[VX] * q[VX] + q[VY] * q[VY]);
            double pace = most(speed + fabs(q[OMEGA]) * w->radius, 1e-300);
            h = least(least(h, time_limit - t), most(h_contact, 0.1 * w->radius / pace));
            double half = (speed + w->gravity * h) * h + 1.1 * w->radius;
            Range seen = facet_range(w, q[X] - half, q[X] + half);
            if (active == 0 && !noticed) {
                for (int64_t j = 0; j < w->contacts; j++)
                    memory[j] = (Contact){.key = -1, .depth = NOWHERE};
                active = begin(q, seen, w, memory, found);
                noticed = true;
                if (active > 0) {
                    is_open = true, left = false;
                    impact = open_impact(memory, w);
                    highest = most(highest, kinetic_energy(q, w));
                }
            }
            flying = active == 0;
            if (stale) look_again(q, seen, w, memory, found), stale = false;
            NOTE(FULL_STEPS);
            until = t + step(q, h, seen, w, memory, found, &audit, floating);
            int64_t before = active;
            active = pressure(memory, w, &force, &depth);
            if (is_open) {
                left = note_pressure(&impact, left, force, depth, until, q);
            } else if (active > 0) {
                is_open = true, left = false;
                impact = open_impact(memory, w);
                highest = most(highest, kinetic_energy(q, w));
            }
            if (active > before || flying) looked = steps;
            buried = active > 0 ? set_anchor(&anchor, q, h, w, memory) : is_buried(q, w);
        }
        if (near) cross(t, until - t, old, q, flying, w, crossings);
        t = until;
        if (buried) {
            stop = STOP_BURIED;
            break;
        }
        if (active == 0 && is_open) {
            count++;
            is_open = false;
            forget_rest(&watch);
            if (count == impact_limit) {
                stop = STOP_IMPACTS;
                break;
            }
        }
    }
    if (is_open && stop != STOP_IMPACTS) count++;
    *ended = t, *impacts = count;
    return stop;
}

/* n releases from `states` (n, 6); fills stop (n), ends (n, 7) and crossings (n, lines, 7), which come as NaN */
void run_releases(const World *w, int64_t n, const double (*states)[N_STATE], const double (*step_sizes)[2],
                  const double *time_limits, int64_t impact_limit, int64_t *stop, int64_t *impacts, double (*ends)[7],
                  double (*crossings)[7]) {
    for (int64_t i = 0; i < n; i++) {
        double q[N_STATE];
        for (int k = 0; k < N_STATE; k++) q[k] = states[i][k];
        StepSizes sizes = {step_sizes[i][0], 0.0, step_sizes[i][1], 0.0, 1.0};
        stop[i] = release(w, q, sizes, time_limits[i], impact_limit, ends[i], impacts + i, crossings + i * w->line_count);
        for (int k = 0; k < N_STATE; k++) ends[i][1 + k] = q[k];
    }
}
