/* The search for the features that contacts meet, and the events of the law within a step: as in
   rock2d/engines/contact_search.py and event_detection.py, for sharp polygons and balls. */

static inline void set_found(Contact *found, int64_t kind, int64_t index, int64_t part, double depth, int64_t key) {
    found->kind = kind, found->index = index, found->part = part, found->key = key, found->depth = depth;
}

static int64_t contact_for(const Contact *memory, const Contact *found, int64_t start, int64_t key, const World *w) {
    int64_t vacant = -1, stale = -1;
    for (int64_t j = start; j < w->contacts; j++) {
        bool empty = !memory[j].active && found[j].depth == NOWHERE;
        if (memory[j].key == key && (memory[j].active || empty)) return j;
        if (empty && memory[j].key < 0) vacant = j;
        else if (empty) stale = j;
    }
    return vacant >= 0 ? vacant : stale;
}

static void offer(const Contact *memory, Contact *found, int64_t kind, int64_t index, double depth, int64_t key,
                  const World *w) {
    for (int64_t j = 0; j < w->contacts; j++)
        if (found[j].depth != NOWHERE && found[j].key == key) {
            if (depth > found[j].depth) set_found(found + j, kind, index, 0, depth, key);
            return;
        }
    int64_t j = contact_for(memory, found, 0, key, w);
    if (j >= 0) set_found(found + j, kind, index, 0, depth, key);
}

static bool is_spike(int64_t f, double x, double y, const Facet *facets) {
    const Facet *a = facets + f, *b = a + 1;
    if (a->tx * b->tx + a->ty * b->ty >= 0.0) return false;
    return (x - b->px) * b->nx + (y - b->py) * b->ny > 0.0;
}

static void offer_vertex(int64_t f, Pose at, double reach, const World *w, const Contact *memory, Contact *found) {
    const Facet *a = w->facets + f, *b = a + 1;
    Feature feature = load_feature(SMOOTH_VERTEX, f + 1, 0, w);
    Point p = place_feature(&feature, at);
    double turn_out = p.nx * a->tx + p.ny * a->ty, turn_in = p.nx * b->tx + p.ny * b->ty;
    double up = p.nx * (a->nx + b->nx) + p.ny * (a->ny + b->ny);
    if (p.depth > -reach && turn_out >= 0.0 && 0.0 >= turn_in && up > 0.0)
        offer(memory, found, SMOOTH_VERTEX, f + 1, p.depth, 2 * (int64_t)a->patch + (int64_t)b->convex, w);
}

static void keep_vertex(int64_t j, Pose at, const World *w, const Contact *memory, Contact *found) {
    int64_t vertex = memory[j].index;
    if (memory[j].kind == SMOOTH_FACET) {
        Feature f = load_feature(SMOOTH_FACET, vertex, 0, w);
        Point p = place_feature(&f, at);
        double along = (at.x + p.rx - f.px) * w->facets[vertex].tx + (at.y + p.ry - f.py) * w->facets[vertex].ty;
        vertex += along > 0.0;
    }
    if (0 < vertex && vertex < w->points - 1) {
        Feature f = load_feature(SMOOTH_VERTEX, vertex, 0, w);
        double depth = place_feature(&f, at).depth;
        if (depth > 0.0) set_found(found + j, SMOOTH_VERTEX, vertex, 0, depth, memory[j].key);
    }
}

static void smooth_features(Pose at, double reach, Range near, const World *w, const Contact *memory,
                            Contact *found) {
    double far = reach + w->radius;
    for (int64_t f = near.first; f < near.end; f++) {
        const Facet *facet = w->facets + f;
        double dx = at.x - facet->px, dy = at.y - facet->py, above = dx * facet->nx + dy * facet->ny;
        if (fabs(above) > far) continue;
        double along = dx * facet->tx + dy * facet->ty;
        if (along < -far || along > facet->length + far) continue;
        if (above > 0.0) {
            Feature feature = load_feature(SMOOTH_FACET, f, 0, w);
            Point p = place_feature(&feature, at);
            along = (at.x + p.rx - facet->px) * facet->tx + (at.y + p.ry - facet->py) * facet->ty;
            if (0.0 <= along && along <= facet->length && p.depth > -reach)
                offer(memory, found, SMOOTH_FACET, f, p.depth, 2 * (int64_t)facet->patch, w);
            if (along <= facet->length) continue;
        }
        if (f + 2 < w->points && (above > 0.0 || is_spike(f, at.x, at.y, w->facets)))
            offer_vertex(f, at, reach, w, memory, found);
    }
    for (int64_t j = 0; j < w->contacts; j++) {
        if (!memory[j].active || found[j].depth != NOWHERE) continue;
        for (int64_t k = 0; k < w->contacts; k++)
            if (!memory[k].active && found[k].depth != NOWHERE && llabs(found[k].key - memory[j].key) == 1) {
                set_found(found + j, found[k].kind, found[k].index, found[k].part, found[k].depth, found[k].key);
                found[k].depth = NOWHERE;
                break;
            }
        if (found[j].depth == NOWHERE) keep_vertex(j, at, w, memory, found);
    }
}

/* fill `found` with each contact's nearest feature, depth and rate at state q */
static APART void find_features(const double *q, double reach, Range near, const World *w, const Contact *memory,
                          Contact *found) {
    Pose at = pose_of(q);
    for (int64_t j = 0; j < w->contacts; j++) {
        if (memory[j].active)
            found[j].kind = memory[j].kind, found[j].index = memory[j].index, found[j].part = memory[j].part,
            found[j].key = memory[j].key;
        found[j].depth = NOWHERE;
    }
    if (w->corners > 0) {
        int64_t kind, index, face;
        for (int64_t i = 0; i < w->corners; i++) {
            double px = at.x + at.c * w->sides[i].x - at.s * w->sides[i].y;
            double py = at.y + at.s * w->sides[i].x + at.c * w->sides[i].y;
            double depth = near_depth(px, py, w, near, reach, &kind, &index);
            set_found(found + i, kind, index, i, depth, i);
        }
        for (int64_t v = most_i(near.first, 1); v < near.end; v++)
            if (w->facets[v].convex > 0.0) {
                double depth = polygon_depth(w->facets[v].px, w->facets[v].py, at, w, &face);
                if (depth > -reach) {
                    int64_t j = contact_for(memory, found, w->corners, v, w);
                    if (j >= 0) set_found(found + j, VERTEX_FACE, v, face, depth, v);
                }
            }
    } else {
        smooth_features(at, reach, near, w, memory, found);
    }
    for (int64_t j = 0; j < w->contacts; j++) {
        if (found[j].depth == NOWHERE) continue;
        Point p = contact_point(found + j, at, w);
        if (found[j].kind == CORNER_VERTEX && found[j].depth < 0.0) p.nx = -p.nx, p.ny = -p.ny;
        found[j].rate = -((q[VX] - q[OMEGA] * p.ry) * p.nx + (q[VY] + q[OMEGA] * p.rx) * p.ny);
    }
}

/* ---- events ---- */
static double hermite_root(double g0, double r0, double g1, double r1, double h) {
    double a1 = h * r0, a2 = 3.0 * (g1 - g0) - h * (2.0 * r0 + r1), a3 = 2.0 * (g0 - g1) + h * (r0 + r1);
    double low = 0.0, high = 1.0, s = g0 / (g0 - g1), ahead = s;
    for (int k = 0; k < 60; k++) {
        double value = g0 + s * (a1 + s * (a2 + s * a3));
        if ((value > 0.0) == (g1 > 0.0)) high = s;
        else low = s;
        double rate = a1 + s * (2.0 * a2 + 3.0 * a3 * s);
        ahead = rate != 0.0 ? s - value / rate : -1.0;
        if (!(low <= ahead && ahead <= high)) ahead = 0.5 * (low + high);
        if (fabs(ahead - s) < 1e-14) break;
        s = ahead;
    }
    return least(1.0, ahead + 1e-14) * h;
}

static double turning_time(double g0, double r0, double g1, double r1, double h) {
    double a1 = h * r0, a2 = 3.0 * (g1 - g0) - h * (2.0 * r0 + r1), a3 = 2.0 * (g0 - g1) + h * (r0 + r1);
    double root = sqrt(most(a2 * a2 - 3.0 * a1 * a3, 0.0));
    double s = a2 < 0.0 ? a1 / (root - a2) : (-a2 - root) / (3.0 * a3);
    return 0.0 < s && s < 1.0 ? h * s : h * r0 / (r0 - r1);
}

static inline double law_event(double d0, double r0, double d1, double r1, double peak, double bottom, double h) {
    if (d0 >= peak && r0 > 0.0 && r1 < 0.0) return turning_time(d0, r0, d1, r1, h);
    if ((d0 > bottom) != (d1 > bottom)) return hermite_root(d0 - bottom, r0, d1 - bottom, r1, h);
    if (d0 < peak && peak < d1) return hermite_root(d0 - peak, r0, d1 - peak, r1, h);
    if (d0 <= bottom && r0 < 0.0 && 0.0 < r1) return h * r0 / (r0 - r1);
    return h;
}

static double depth_and_rate(const Contact *c, const double *q, const World *w, double *rate) {
    Point p = contact_point(c, pose_of(q), w);
    *rate = -((q[VX] - q[OMEGA] * p.ry) * p.nx + (q[VY] + q[OMEGA] * p.rx) * p.ny);
    return p.depth;
}

static double gap_to_found(int64_t j, const double *q, const World *w, const Contact *memory, const Contact *found,
                           double *rate) {
    Pose at = pose_of(q);
    const Contact *m = memory + j;
    Point p = contact_point(m, at, w);
    double vx = q[VX] - q[OMEGA] * p.ry, vy = q[VY] + q[OMEGA] * p.rx;
    if (m->kind != found[j].kind) {
        int64_t facet = m->index, vertex = found[j].index;
        if (m->kind == CORNER_VERTEX || m->kind == SMOOTH_VERTEX) facet = found[j].index, vertex = m->index;
        if (m->kind == SMOOTH_VERTEX) {
            Feature f = load_feature(SMOOTH_FACET, facet, 0, w);
            p = place_feature(&f, at);
        }
        const Facet *own = w->facets + facet, *end = w->facets + vertex;
        double dx = q[X] + p.rx - end->px, dy = q[Y] + p.ry - end->py;
        if (m->kind >= SMOOTH_FACET) vx = q[VX], vy = q[VY];
        *rate = vx * own->tx + vy * own->ty;
        return dx * own->tx + dy * own->ty;
    }
    double r0 = vx * p.nx + vy * p.ny;
    Point other = contact_point(found + j, at, w);
    double r1 = (q[VX] - q[OMEGA] * other.ry) * other.nx + (q[VY] + q[OMEGA] * other.rx) * other.ny;
    *rate = r1 - r0;
    return p.depth - other.depth;
}

static double appearance(const Contact *found, const double *q0, const double *q1, double h, const World *w) {
    if (w->corners > 0) return h;
    double r0, r1, d0 = depth_and_rate(found, q0, w, &r0), d1 = depth_and_rate(found, q1, w, &r1);
    return d0 < 0.0 && 0.0 < d1 ? hermite_root(d0, r0, d1, r1, h) : 0.5 * h;
}

static bool same_feature(const Contact *a, const Contact *b) {
    return a->kind == b->kind && a->index == b->index && a->part == b->part;
}

static APART double first_event(double h, double whole, const double *q0, const double *q1, const World *w,
                          const Contact *memory, const Contact *found) {
    double first = h;
    for (int64_t j = 0; j < w->contacts; j++) {
        const Contact *m = memory + j;
        double d1 = found[j].depth, r1 = found[j].rate, d0 = m->depth, r0 = m->rate, t = h;
        if (d1 == NOWHERE && m->active) d1 = depth_and_rate(m, q1, w, &r1);
        if (d1 > 0.0 && !m->active && (d0 == NOWHERE || m->key != found[j].key)) {
            t = appearance(found + j, q0, q1, h, w);
            if (LEAST_EVENT * whole < t && t < first) first = t;
            continue;
        }
        if (d0 == NOWHERE || d1 == NOWHERE) continue;
        if (!m->active) {
            if (d0 < 0.0 && 0.0 < d1) t = most(hermite_root(d0, r0, d1, r1, h), 2e-3 * whole);
        } else {
            const Law *p = w->law + m->zone;
            double clear = d1 <= 0.0 && 0.0 < d0 ? hermite_root(d0, r0, d1, r1, h) + 1e-3 * whole : h;
            d0 -= m->offset, d1 -= m->offset;
            t = law_event(d0, r0, d1, r1, m->peak, residual(m->peak, p->k_l, p->k_ul), h);
            t = least(t, clear);
            if (!same_feature(m, found + j)) {
                double s0, s1, g0 = gap_to_found(j, q0, w, memory, found, &s0);
                double g1 = gap_to_found(j, q1, w, memory, found, &s1);
                if ((g0 > 0.0) != (g1 > 0.0)) {
                    double pace = most(most(fabs(s0), fabs(s1)), 1e-300);
                    double behind = most(1e-5 * whole, 1e-12 * w->radius / pace);
                    first = least(first, hermite_root(g0, s0, g1, s1, h) + behind);
                }
            }
        }
        if (LEAST_EVENT * whole < t && t < first) first = t;
    }
    return first;
}
