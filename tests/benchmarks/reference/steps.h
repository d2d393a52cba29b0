/* Contact steps: as in rock2d/engines/trial_step.py, contact_step.py and
   fast_contact_steps.py, without effects. */
#define MOST_LANDINGS 8
#define LANDED 0.99
#define MOST_HALVINGS 12

typedef struct { double loading, floating, other, hop, share; } StepSizes;

/* of the state after an impact, only the instant is kept; the arithmetic is that of recording.note_pressure */
typedef struct { double penetration, force, time_after, after[N_STATE]; int64_t zone; } Impact;

static bool note_pressure(Impact *impact, bool left, double force, double depth, double t, const double *q) {
    impact->penetration = most(impact->penetration, depth);
    impact->force = most(impact->force, force);
    if (force > 1e-6 * impact->force) return false;
    if (!left) {
        impact->time_after = t;
        for (int i = 0; i < N_STATE; i++) impact->after[i] = q[i];
    }
    return true;
}

static APART int64_t load_active(const World *w, const Contact *memory, Loaded *loaded) {
    int64_t active = 0;
    for (int64_t j = 0; j < w->contacts; j++) {
        const Contact *m = memory + j;
        if (!m->active) continue;
        Loaded *l = loaded + active++;
        l->feature = load_feature(m->kind, m->index, m->part, w);
        l->law = w->law[m->zone];
        l->offset = m->offset, l->peak = m->peak, l->displacement = m->displacement, l->rotation = m->rotation;
        l->bottom = residual(m->peak, l->law.k_l, l->law.k_ul);
        l->which = j, l->depth_0 = m->depth, l->rate_0 = m->rate;
    }
    return active;
}

static inline void note_pressed(Loaded *loaded, int64_t active, double h) {
    for (int64_t a = 0; a < active; a++) {
        double ahead = loaded[a].depth_0 - loaded[a].offset + LEAST_EVENT * h * loaded[a].rate_0;
        loaded[a].pressed = ahead > loaded[a].bottom;
    }
}

static inline void turned(double c, double s, double angle, double *c1, double *s1) {
    double ca, sa;
    if (fabs(angle) > 0.1) {
        ca = cos(angle), sa = sin(angle);
    } else {
        double u = angle * angle;
        ca = 1.0 - u * (1.0 / 2 - u * (1.0 / 24 - u * (1.0 / 720 - u / 40320.0)));
        sa = angle * (1.0 - u * (1.0 / 6 - u * (1.0 / 120 - u * (1.0 / 5040 - u / 362880.0))));
    }
    *c1 = c * ca - s * sa, *s1 = s * ca + c * sa;
}

/* a ball that one facet presses: its depth half a step on and at the end, and its rate there */
static void oscillation(const double *q, double h, const World *w, const Loaded *l, double *half, double *end,
                        double *rate_1) {
    Point at = place_feature(&l->feature, (Pose){q[X], q[Y], 1.0, 0.0});
    double rate = -(q[VX] * at.nx + q[VY] * at.ny), pull = w->gravity * at.ny;
    double stiffness = l->law.k_ul, bottom = l->bottom, pressed = at.depth - l->offset, k_l = l->law.k_l;
    if (pressed + LEAST_EVENT * h * rate >= l->peak && rate > LEAST_EVENT * h * (k_l * pressed / w->mass - pull))
        stiffness = k_l, bottom = 0.0;
    double rest = l->offset + bottom + w->mass * pull / stiffness, omega = sqrt(stiffness / w->mass);
    double c = cos(0.5 * omega * h), s = sin(0.5 * omega * h), a = at.depth - rest, b = rate / omega;
    *half = rest + a * c + b * s;
    double c1 = c * c - s * s, s1 = 2.0 * c * s;
    *end = rest + a * c1 + b * s1, *rate_1 = omega * (b * c1 - a * s1);
}

static APART void runge_kutta(const double *q, double c0, double s0, double h, const World *w, int64_t active,
                        Loaded *loaded, double *q1, double *taken_t, double *taken_r) {
    double x = q[X], y = q[Y], vx = q[VX], vy = q[VY], omega = q[OMEGA], g = w->gravity, c = c0, s = s0;
    *taken_t = *taken_r = 0.0;
    if (active == 0) {
        q1[X] = x + h * vx, q1[Y] = y + h * (vy - 0.5 * g * h), q1[THETA] = q[THETA] + h * omega;
        q1[VX] = vx, q1[VY] = vy - h * g, q1[OMEGA] = omega;
        return;
    }
    double ax = 0.0, ay = 0.0, alpha = 0.0, per_mass = 1.0 / w->mass, per_inertia = 1.0 / w->inertia;
    double dx = 0.0, dy = 0.0, dtheta = 0.0, dvx = 0.0, dvy = 0.0, domega = 0.0, work_t = 0.0, work_r = 0.0;
    for (int64_t a = 0; a < active; a++)
        loaded[a].unlimited_displacement = loaded[a].unlimited_rotation = loaded[a].slip_rate = loaded[a].spin_rate = 0.0;
    bool oscillates = w->corners == 0 && active == 1 && loaded->feature.kind == SMOOTH_FACET && loaded->pressed;
    double half = 0.0, end = 0.0, rate = 0.0;
    if (oscillates) oscillation(q, h, w, loaded, &half, &end, &rate);
    for (int k = 0; k < 4; k++) {
        double weight = k % 3 == 0 ? 1.0 / 6.0 : 1.0 / 3.0, ahead = k == 0 ? 0.0 : (k < 3 ? 0.5 * h : h);
        if (k > 0) {
            x = q[X] + ahead * vx, y = q[Y] + ahead * vy;
            if (w->corners > 0) turned(c0, s0, ahead * omega, &c, &s);
            vx = q[VX] + ahead * ax, vy = q[VY] + ahead * ay, omega = q[OMEGA] + ahead * alpha;
            if (oscillates) {
                Point at = place_feature(&loaded->feature, (Pose){x, y, c, s});
                double up = at.depth - (k < 3 ? half : end);
                x += up * at.nx, y += up * at.ny;
            }
        }
        double fx = 0.0, fy = 0.0, moment = 0.0;
        for (int64_t a = 0; a < active; a++) {
            Loaded *l = loaded + a;
            const Law *p = &l->law;
            Point at = place_feature(&l->feature, (Pose){x, y, c, s});
            double slip = (vx - omega * at.ry) * at.ny - (vy + omega * at.rx) * at.nx;
            double force_n = force_at(at.depth - l->offset, l->peak, l->bottom, p->k_l, p->k_ul);
            if (l->pressed) force_n = most(force_n, 1e-300);
            double grip = l->pressed ? force_n : 0.0, spin = grip > 0.0 || p->indentation > 0.0 ? omega : 0.0;
            double force_t = tangential_force(l->displacement + ahead * l->slip_rate, grip, p->k_t, p->mu);
            double arm = p->cap > 0.0 ? sqrt(at.rx * at.rx + at.ry * at.ry) : 0.0;
            double rolling = rolling_moment(l->rotation + ahead * l->spin_rate, grip, arm, p);
            double f = force_n * at.nx - force_t * at.ny, e = force_n * at.ny + force_t * at.nx;
            fx += f, fy += e, moment += at.rx * e - at.ry * f - rolling;
            work_t += weight * (force_t * slip), work_r += weight * (rolling * omega);
            if (!l->pressed) slip = 0.0;
            l->unlimited_displacement += weight * slip, l->unlimited_rotation += weight * spin;
            l->slip_rate = slip, l->spin_rate = spin;
        }
        ax = fx * per_mass, ay = fy * per_mass - g, alpha = moment * per_inertia;
        dx += weight * vx, dy += weight * vy, dtheta += weight * omega;
        dvx += weight * ax, dvy += weight * ay, domega += weight * alpha;
    }
    q1[X] = q[X] + h * dx, q1[Y] = q[Y] + h * dy, q1[THETA] = q[THETA] + h * dtheta;
    q1[VX] = q[VX] + h * dvx, q1[VY] = q[VY] + h * dvy, q1[OMEGA] = q[OMEGA] + h * domega;
    if (oscillates) {
        Point at = place_feature(&loaded->feature, (Pose){q1[X], q1[Y], c, s});
        double up = at.depth - end, faster = -(q1[VX] * at.nx + q1[VY] * at.ny) - rate;
        q1[X] += up * at.nx, q1[Y] += up * at.ny, q1[VX] += faster * at.nx, q1[VY] += faster * at.ny;
    }
    for (int64_t a = 0; a < active; a++) {
        loaded[a].unlimited_displacement = loaded[a].displacement + h * loaded[a].unlimited_displacement;
        loaded[a].unlimited_rotation = loaded[a].rotation + h * loaded[a].unlimited_rotation;
    }
    *taken_t = h * work_t, *taken_r = h * work_r;
}

/* what a trial step leaves in the memory of a contact */
static inline APART void note_outcome(Loaded *l) {
    const Law *p = &l->law;
    double peak = l->peak, before = l->depth_0 - l->offset, after = l->depth_1 - l->offset, plastic = 0.0;
    l->normal_0 = force_at(before, peak, l->bottom, p->k_l, p->k_ul);
    l->normal_1 = force_at(after, peak, l->bottom, p->k_l, p->k_ul);
    if (after > peak) plastic = plastic_work(after, p->k_l, p->k_ul) - plastic_work(peak, p->k_l, p->k_ul), peak = after;
    l->tangential_0 = tangential_force(l->displacement, l->normal_0, p->k_t, p->mu);
    l->tangential_1 = tangential_force(l->unlimited_displacement, l->normal_1, p->k_t, p->mu);
    double rotation = l->unlimited_rotation, moment = p->k_r * rotation;
    if (p->cap > 0.0 && p->k_r > 0.0) moment = rolling_moment(rotation, l->normal_1, l->arm, p), rotation = moment / p->k_r;
    l->peak_1 = peak, l->plastic = plastic, l->moment_1 = moment, l->rotation_1 = rotation;
    l->displacement_1 = p->k_t > 0.0 ? l->tangential_1 / p->k_t : 0.0;
}

static inline double gain_of(const double *q, const double *q1, double h, const World *w) {
    double dx = q1[VX] - q[VX], dy = q1[VY] - q[VY] + w->gravity * h, turn = q1[OMEGA] - q[OMEGA];
    return w->mass * (q1[VX] * dx + q1[VY] * dy) + w->inertia * q1[OMEGA] * turn;
}

static inline APART bool step_error(const double *q, const double *q1, double h, double *work_t, double *work_r,
                              const World *w, int64_t active, const Loaded *loaded, double *made, double *against) {
    double kinetic = kinetic_energy(q1, w);
    double error = kinetic - kinetic_energy(q, w) + w->mass * w->gravity * (q1[Y] - q[Y]);
    double scale = kinetic + fabs(*work_t + *work_r), stored_t = 0.0, stored_r = 0.0, pressing = 0.0;
    bool slips = false, turns = false;
    for (int64_t a = 0; a < active; a++) {
        const Loaded *l = loaded + a;
        double k_ul = l->law.k_ul, k_t = l->law.k_t, k_r = l->law.k_r, old = l->normal_0, new = l->normal_1;
        error += l->plastic + 0.5 * (new * new - old * old) / k_ul;
        scale += 0.5 * most(new * new, old * old) / k_ul;
        pressing += new;
        if (k_t > 0.0) {
            old = l->tangential_0, new = l->tangential_1;
            slips = slips || new != k_t * l->unlimited_displacement;
            stored_t += 0.5 * (new * new - old * old) / k_t;
        }
        if (k_r > 0.0) {
            turns = turns || l->moment_1 != k_r * l->unlimited_rotation;
            stored_r += 0.5 * (l->moment_1 * l->moment_1 / k_r - k_r * l->rotation * l->rotation);
        }
    }
    *work_t = slips ? most(*work_t, stored_t) : stored_t;
    *work_r = turns ? most(*work_r, stored_r) : stored_r;
    error += *work_t + *work_r;
    double size = fabs(q1[X]) + fabs(q1[Y]) + w->radius * (1.0 + fabs(q1[THETA]));
    double rounding = 2e-15 * size * (w->mass * w->gravity + pressing);
    double allowed = least(0.0005 * scale, 0.01 * fabs(gain_of(q, q1, h, w)));
    *made = error, *against = scale;
    return fabs(error) > most(most(allowed, 1e-7 * kinetic), rounding);
}

static inline APART void keep_energy(const double *q, double *q1, double h, double error, double scale, const World *w,
                               Audit *audit) {
    if (fabs(error) <= 0.0005 * scale) audit->pending += error;
    double dx = q1[VX] - q[VX], dy = q1[VY] - q[VY] + w->gravity * h, turn = q1[OMEGA] - q[OMEGA];
    double gain = gain_of(q, q1, h, w), curvature = 0.5 * (w->mass * (dx * dx + dy * dy) + w->inertia * turn * turn);
    double limit = fabs(gain) * least(0.01, 0.1 * fabs(gain) / most(curvature, 1e-300));
    double paid = least(most(audit->pending, -limit), limit);
    if (paid == 0.0) return;
    double share = -paid / gain;
    share = -paid / (gain + curvature * share);
    paid = -share * (gain + curvature * share);
    q1[VX] += share * dx, q1[VY] += share * dy, q1[OMEGA] += share * turn;
    audit->corrected += fabs(paid), audit->pending -= paid;
}

/* the changes of branch since the step before; before the step is taken into the memory */
static inline void note_branches(const Loaded *loaded, int64_t active) {
#ifdef COUNTS
    for (int64_t a = 0; a < active; a++) {
        const Loaded *l = loaded + a;
        const Law *p = &l->law;
        int64_t j = l->which;
        double depth = l->depth_1 - l->offset, bottom = residual(l->peak_1, p->k_l, p->k_ul);
        bool loads = depth >= l->peak_1 && l->rate_1 > 0.0, floats_now = l->normal_1 <= 0.0 && depth <= bottom;
        note_branch(&branch_of[j].normal, loads ? 0 : floats_now ? 2 : 1, NORMAL_EVENTS);
        if (l->normal_1 <= 0.0) {
            branch_of[j].slips = branch_of[j].turns = -1;
            continue;
        }
        note_branch(&branch_of[j].slips, p->k_t > 0.0 && l->tangential_1 != p->k_t * l->unlimited_displacement,
                    FRICTION_EVENTS);
        note_branch(&branch_of[j].turns, p->k_r > 0.0 && l->moment_1 != p->k_r * l->unlimited_rotation, ROLLING_EVENTS);
    }
#else
    (void)loaded, (void)active;
#endif
}

static inline bool lands(double event_s, double h, int landings) {
    return event_s < h && landings < MOST_LANDINGS && (landings == 0 || event_s <= LANDED * h);
}
static inline bool floats(double depth, double rate, double step) { return depth <= 0.0 && depth + 0.01 * rate * step < 0.0; }
static inline bool goes_deeper(double depth, double rate, double step) { return rate * step > LEAST_EVENT * depth; }

static inline APART void place(Loaded *l, const double *q1, Pose at) {
    Point p = place_feature(&l->feature, at);
    l->depth_1 = p.depth;
    l->rate_1 = -((q1[VX] - q1[OMEGA] * p.ry) * p.nx + (q1[VY] + q1[OMEGA] * p.rx) * p.ny);
    l->arm = sqrt(p.rx * p.rx + p.ry * p.ry);
}

/* ---- full steps ---- */
static int64_t zone_of(const Contact *m, const World *w) {
    if (m->kind == CORNER_FACET || m->kind == SMOOTH_FACET) return (int64_t)w->facets[m->index].zone;
    int64_t before = (int64_t)w->facets[most_i(m->index - 1, 0)].zone;
    int64_t after = (int64_t)w->facets[least_i(m->index, w->points - 2)].zone;
    return m->active && m->zone == after ? after : before;
}

static void follow(Contact *m, const Contact *found) {
    m->kind = found->kind, m->index = found->index, m->part = found->part, m->key = found->key;
}

static bool touches(const Contact *found, const World *w) {
    return found->depth > 0.0 || (found->depth > -1e-10 * w->radius && found->rate >= 0.0);
}

static double enter_zone(Contact *m, double depth, double force_n, double force_t, const Law *p, const Law *new) {
    double stored = elastic_energy(force_n, force_t, p) + rolling_energy(m->rotation, p);
    double bottom = m->offset + residual(m->peak, p->k_l, p->k_ul);
    double force = least(force_n * least(1.0, sqrt(new->k_ul / p->k_ul)), new->k_l * most(depth, 0.0));
    double displacement = 0.0, rotation = 0.0;
    if (new->k_t > 0.0 && p->k_t > 0.0) {
        double kept = force_t * least(1.0, sqrt(new->k_t / p->k_t));
        displacement = tangential_force(kept / new->k_t, force, new->k_t, new->mu) / new->k_t;
    }
    if (new->k_r > 0.0) rotation = m->rotation * least(p->k_r / new->k_r, sqrt(p->k_r / new->k_r));
    m->peak = force / new->k_l, m->displacement = displacement, m->rotation = rotation;
    m->offset = force_n > 0.0 ? depth - m->peak : bottom;
    stored -= elastic_energy(new->k_l * m->peak, new->k_t * displacement, new);
    return stored - rolling_energy(rotation, new);
}

static bool differ(const Law *p, const Law *n) {
    return p->k_l != n->k_l || p->k_ul != n->k_ul || p->k_t != n->k_t || p->mu != n->mu || p->k_r != n->k_r ||
           p->cap != n->cap || p->indentation != n->indentation;
}

static void commit_contact(const Loaded *l, const World *w, Contact *memory, const Contact *found, Audit *audit,
                           double *gained_t, double *gained_r) {
    Contact *m = memory + l->which;
    const Contact *f = found + l->which;
    const Law *p = w->law + m->zone;
    bool gone = f->depth == NOWHERE;
    double jump = 0.0, depth = l->depth_1;
    if (!gone && !same_feature(m, f)) jump = f->depth - depth, depth = f->depth;
    follow(m, f);
    m->depth = depth, m->rate = f->rate;
    double before_r = rolling_energy(m->rotation, p), force_n = l->normal_1, force_t = l->tangential_1;
    m->peak = l->peak_1, m->displacement = l->displacement_1, m->rotation = l->rotation_1;
    audit->plastic += l->plastic;
    *gained_t = elastic_energy(0.0, force_t, p) - elastic_energy(0.0, l->tangential_0, p);
    if (jump != 0.0) audit->plastic += change_feature(p, depth, jump, &m->offset, m->peak, &force_n, &force_t);
    double after_r = depth > 0.0 ? rolling_energy(m->rotation, p) : 0.0;
    int64_t zone = zone_of(m, w);
    if (zone != m->zone && depth > 0.0 && differ(p, w->law + zone))
        audit->plastic += enter_zone(m, depth, force_n, force_t, p, w->law + zone);
    m->zone = zone;
    if (gone || depth <= 0.0) {
        p = w->law + zone;
        force_n = normal_force(m->depth - m->offset, m->peak, p);
        force_t = tangential_force(m->displacement, force_n, p->k_t, p->mu);
        audit->plastic += elastic_energy(force_n, force_t, p);
        if (depth > 0.0) audit->rolling += rolling_energy(m->rotation, p);
        m->active = 0, m->peak = m->displacement = m->rotation = m->offset = 0.0;
        m->depth = gone ? NOWHERE : depth;
        m->key = gone ? -1 : m->key;
    }
    *gained_r = after_r - before_r;
}

static void begin_contact(Contact *m, const Contact *found, const World *w) {
    follow(m, found);
    m->zone = zone_of(m, w);
    m->active = 1, m->offset = found->depth;
}

static APART void commit(const World *w, Contact *memory, const Contact *found, const Loaded *loaded, int64_t active,
                   double work_t, double work_r, Audit *audit) {
    double change_t = 0.0, change_r = 0.0, gained_t, gained_r;
    for (int64_t j = 0; j < w->contacts; j++) {
        Contact *m = memory + j;
        if (m->active) continue;
        m->depth = found[j].depth, m->key = -1;
        if (m->depth == NOWHERE) continue;
        m->rate = found[j].rate, m->key = found[j].key;
        if (touches(found + j, w)) {
            m->peak = m->displacement = m->rotation = 0.0;
            begin_contact(m, found + j, w);
            forget_branches(j);
        }
    }
    for (int64_t a = 0; a < active; a++) {
        commit_contact(loaded + a, w, memory, found, audit, &gained_t, &gained_r);
        change_t += gained_t, change_r += gained_r;
    }
    audit->friction += work_t - change_t, audit->rolling += work_r - change_r;
}

static int64_t begin(const double *q, Range near, const World *w, Contact *memory, Contact *found) {
    int64_t active = 0;
    find_features(q, w->radius, near, w, memory, found);
    for (int64_t j = 0; j < w->contacts; j++) {
        memory[j].depth = found[j].depth, memory[j].rate = found[j].rate;
        memory[j].key = found[j].depth != NOWHERE ? found[j].key : -1;
        if (touches(found + j, w)) {
            begin_contact(memory + j, found + j, w), active++;
            forget_branches(j);
        }
    }
    return active;
}

static void look_again(const double *q, Range near, const World *w, Contact *memory, Contact *found) {
    find_features(q, w->radius, near, w, memory, found);
    for (int64_t j = 0; j < w->contacts; j++)
        if (!memory[j].active) {
            memory[j].depth = found[j].depth, memory[j].rate = found[j].rate;
            memory[j].key = found[j].depth != NOWHERE ? found[j].key : -1;
        }
}

static APART double step(double *q, double h, Range near, const World *w, Contact *memory, Contact *found, Audit *audit,
                   bool floating) {
    Loaded loaded[MOST_CONTACTS];
    double q1[N_STATE], speed = sqrt(q[VX] * q[VX] + q[VY] * q[VY]), whole = h, work_t, work_r, error, scale;
    double reach = 4.0 * h * (speed + fabs(q[OMEGA]) * w->radius) + 1e-6 * w->radius;
    int64_t active = load_active(w, memory, loaded), pressing = floating ? 0 : active;
    Pose at = pose_of(q);
    if (floating)
        for (int64_t a = 0; a < active; a++)
            loaded[a].unlimited_displacement = 0.0, loaded[a].unlimited_rotation = loaded[a].rotation;
    int halvings = 0, landings = 0;
    while (true) {
        note_pressed(loaded, active, whole);
        runge_kutta(q, at.c, at.s, h, w, pressing, loaded, q1, &work_t, &work_r);
        if (active > 0) NOTE(TRIALS);
        Pose at_1 = pose_of(q1);
        for (int64_t a = 0; a < active; a++) place(loaded + a, q1, at_1), note_outcome(loaded + a);
        bool too_long = step_error(q, q1, h, &work_t, &work_r, w, active, loaded, &error, &scale);
        find_features(q1, reach, near, w, memory, found);
        double event_s = first_event(h, whole, q, q1, w, memory, found);
        if (lands(event_s, h, landings)) {
            NOTE(LANDED_ON);
            h = event_s, landings++;
            continue;
        }
        if (!too_long || halvings == MOST_HALVINGS) break;
        NOTE(HALVED);
        h *= 0.5, whole = h, landings = 0, halvings++;
    }
    if (active > 0) keep_energy(q, q1, h, error, scale, w, audit);
    for (int i = 0; i < N_STATE; i++) q[i] = q1[i];
    note_branches(loaded, active);
    commit(w, memory, found, loaded, active, work_t, work_r, audit);
    return h;
}

/* ---- fast steps ---- */
enum { GUARD_LEFT = 1, CONTACT_ENDS, HOPPED };
typedef struct { double x, y, theta, guard; } Anchor;

static void load_facet(Loaded *l, const Facet *facet, const double *q, Pose at, Audit *audit) {
    l->feature.px = facet->px, l->feature.py = facet->py, l->feature.nx = facet->nx, l->feature.ny = facet->ny;
    Point p = place_feature(&l->feature, at);
    double force_n = normal_force(l->depth_0 - l->offset, l->peak, &l->law);
    double force_t = tangential_force(l->displacement, force_n, l->law.k_t, l->law.mu);
    audit->plastic += change_feature(&l->law, p.depth, p.depth - l->depth_0, &l->offset, l->peak, &force_n, &force_t);
    l->depth_0 = p.depth;
    l->rate_0 = -((q[VX] - q[OMEGA] * p.ry) * p.nx + (q[VY] + q[OMEGA] * p.rx) * p.ny);
}

static inline APART int64_t follow_run(Loaded *l, int64_t index, const double *q, double c, double s, const World *w,
                                 Audit *audit) {
    const Facet *facets = w->facets;
    double px = q[X], py = q[Y];
    if (l->feature.kind == CORNER_FACET)
        px += c * l->feature.w1 - s * l->feature.w2, py += s * l->feature.w1 + c * l->feature.w2;
    else if (l->feature.kind != SMOOTH_FACET) return index;
    int64_t first = (int64_t)facets[index].run_first, last = (int64_t)facets[index].run_last, found = index;
    while (true) {
        const Facet *at = facets + found;
        double along = (px - at->px) * at->tx + (py - at->py) * at->ty;
        if (along < 0.0 && found > first && found <= index) found--;
        else if (along > at->length && found < last && found >= index) found++;
        else break;
    }
    if (found != index) load_facet(l, facets + found, q, (Pose){q[X], q[Y], c, s}, audit);
    return found;
}

static inline APART double first_loaded_event(double h, double whole, const Loaded *loaded, int64_t active) {
    double first = h;
    for (int64_t a = 0; a < active; a++) {
        const Loaded *l = loaded + a;
        double t = law_event(l->depth_0 - l->offset, l->rate_0, l->depth_1 - l->offset, l->rate_1, l->peak, l->bottom, h);
        if (LEAST_EVENT * whole < t && t < first) first = t;
    }
    return first;
}

static inline APART void commit_loaded(Loaded *loaded, int64_t active, double work_t, double work_r, Audit *audit,
                                 double *total, double *deepest) {
    double stored_t = 0.0, stored_r = 0.0;
    *total = *deepest = 0.0;
    for (int64_t a = 0; a < active; a++) {
        Loaded *l = loaded + a;
        double old = l->tangential_0, new = l->tangential_1, turn = l->rotation_1;
        audit->plastic += l->plastic;
        if (l->law.k_t > 0.0) stored_t += 0.5 * (new * new - old * old) / l->law.k_t;
        stored_r += 0.5 * l->law.k_r * (turn * turn - l->rotation * l->rotation);
        if (l->peak_1 != l->peak) l->peak = l->peak_1, l->bottom = residual(l->peak, l->law.k_l, l->law.k_ul);
        l->displacement = l->displacement_1, l->rotation = turn;
        l->depth_0 = l->depth_1, l->rate_0 = l->rate_1;
        *total += l->normal_1;
        *deepest = most(*deepest, l->depth_1);
    }
    audit->friction += work_t - stored_t, audit->rolling += work_r - stored_r;
}

/* how long a floating ball may fly in one step */
static APART double hop_s(const double *q, int64_t active, const Loaded *loaded, const World *w, const Contact *memory,
                    const Anchor *anchor, double longest) {
    double g = w->gravity, pace = fabs(q[VX]) + fabs(q[VY]) + g * longest;
    double time = least(longest, (anchor->guard - fabs(q[X] - anchor->x) - fabs(q[Y] - anchor->y)) / most(pace, 1e-300));
    for (int64_t a = 0; a < active; a++) {
        const Loaded *l = loaded + a;
        const Facet *f = w->facets + memory[l->which].index;
        double pull = 0.5 * g * f->ny;
        if (l->feature.kind != SMOOTH_FACET || pull <= 0.0) return 0.0;
        double along = (q[X] - f->px) * f->tx + (q[Y] - f->py) * f->ty;
        double ahead = q[VX] * f->tx + q[VY] * f->ty > 0.0 ? f->length - along : along;
        time = least(time, ahead / most(pace, 1e-300));
        double depth = l->depth_0, rate = l->rate_0;
        if (rate < 0.0 && rate * rate >= 4.0 * pull * depth) {
            double out = 2.0 * depth / (sqrt(rate * rate - 4.0 * pull * depth) - rate);
            time = least(time, 0.9 * out);
        } else {
            double above = l->bottom + l->offset - depth;
            time = least(time, 1.01 * (sqrt(rate * rate + 4.0 * pull * above) - rate) / (2.0 * pull));
        }
    }
    return time;
}

/* steps within the guard; returns why it ended, 0 for no reason of its own */
static APART int fast_contact_steps(double *q, double *now, int64_t steps, double time_limit, StepSizes sizes,
                              const Anchor *anchor, const World *w, Contact *memory, Impact *impact, bool *is_left,
                              Audit *audit, int64_t *made, double *share) {
    Loaded loaded[MOST_CONTACTS];
    int64_t active = load_active(w, memory, loaded), done = 0;
    double q1[N_STATE], c = cos(q[THETA]), s = sin(q[THETA]), t = *now;
    double arm = w->corners > 0 ? 1.5 * w->radius : 0.0;
    bool left = *is_left, hops = false;
    int why = 0;
    while (done < steps) {
        bool loading = true, unpressed = true;
        for (int64_t a = 0; a < active; a++) {
            const Loaded *l = loaded + a;
            double d0 = l->depth_0 - l->offset;
            loading = loading && d0 >= l->peak && goes_deeper(d0, l->rate_0, sizes.loading);
            unpressed = unpressed && floats(d0 - l->bottom, l->rate_0, sizes.floating) && l->law.indentation == 0.0;
        }
        unpressed = unpressed && left;
        double h = sizes.share * (loading ? sizes.loading : sizes.other);
        if (unpressed) {
            double pace = sqrt(q[VX] * q[VX] + q[VY] * q[VY]) + fabs(q[OMEGA]) * w->radius;
            h = least(sizes.floating, most(sizes.other, 0.3 * anchor->guard / most(pace, 1e-300)));
            if (w->corners == 0) {
                double hop = hop_s(q, active, loaded, w, memory, anchor, sizes.hop);
                if (hop > sizes.floating) {
                    if (done > 0) break;
                    h = hop, hops = true;
                }
            }
        }
        h = least(h, time_limit - t);
        if (h <= 0.0) break;
        double first = h, whole = h, work_t = 0.0, work_r = 0.0, error, scale, force, deepest, c1 = c, s1 = s;
        int landings = 0, halvings = 0;
        note_pressed(loaded, active, h);
        while (true) {
            runge_kutta(q, c, s, first, w, unpressed ? 0 : active, loaded, q1, &work_t, &work_r);
            NOTE(TRIALS);
            if (unpressed)
                for (int64_t a = 0; a < active; a++)
                    loaded[a].unlimited_displacement = 0.0, loaded[a].unlimited_rotation = loaded[a].rotation;
            if (w->corners > 0) c1 = cos(q1[THETA]), s1 = sin(q1[THETA]);
            double moved = fabs(q1[X] - anchor->x) + fabs(q1[Y] - anchor->y) + arm * fabs(q1[THETA] - anchor->theta);
            if (moved >= anchor->guard) why = GUARD_LEFT;
            for (int64_t a = 0; a < active; a++) {
                place(loaded + a, q1, (Pose){q1[X], q1[Y], c1, s1});
                if (loaded[a].depth_1 <= 0.0) why = CONTACT_ENDS;
                else if (w->corners == 0 && loaded[a].depth_1 > w->radius) why = GUARD_LEFT;
            }
            if (why) break;
            double event_s = first_loaded_event(first, whole, loaded, active);
            if (lands(event_s, first, landings)) {
                NOTE(LANDED_ON);
                first = event_s, landings++;
                continue;
            }
            for (int64_t a = 0; a < active; a++) note_outcome(loaded + a);
            bool too_long = step_error(q, q1, first, &work_t, &work_r, w, active, loaded, &error, &scale);
            if (!too_long || halvings == MOST_HALVINGS) break;
            NOTE(HALVED);
            first *= 0.5, sizes.share *= 0.5, whole = first, landings = 0, halvings++;
            note_pressed(loaded, active, whole);
        }
        if (why) break;
        NOTE(FAST_STEPS);
        note_branches(loaded, active);
        commit_loaded(loaded, active, work_t, work_r, audit, &force, &deepest);
        keep_energy(q, q1, first, error, scale, w, audit);
        for (int64_t a = 0; a < active; a++) {
            Contact *m = memory + loaded[a].which;
            m->index = follow_run(loaded + a, m->index, q1, c1, s1, w, audit);
        }
        for (int i = 0; i < N_STATE; i++) q[i] = q1[i];
        c = c1, s = s1, t += first, done++;
        left = note_pressure(impact, left, force, deepest, t, q);
        if (hops) {
            why = HOPPED;
            break;
        }
    }
    for (int64_t a = 0; a < active; a++) {
        Contact *m = memory + loaded[a].which;
        m->depth = loaded[a].depth_0, m->rate = loaded[a].rate_0, m->peak = loaded[a].peak;
        m->offset = loaded[a].offset, m->displacement = loaded[a].displacement, m->rotation = loaded[a].rotation;
    }
    *now = t, *is_left = left, *made = done, *share = sizes.share;
    return why;
}
