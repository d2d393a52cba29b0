/* Distances to the ground: as in rock2d/engines/geometry.py, free_flight.py and contact_search.py, for sharp polygons and
   balls. */
#define NO_BOX 1.0e300

static inline Range facet_range(const World *w, double low, double high) {
    int64_t b0 = (int64_t)((low - w->x_start) * w->bins_per_m), b1 = (int64_t)((high - w->x_start) * w->bins_per_m);
    b0 = least_i(most_i(b0, 0), w->bins - 1), b1 = least_i(most_i(b1, 0), w->bins - 1);
    return (Range){w->first[b0], w->last[b1] + 1};
}

static double point_depth(double px, double py, const Facet *facets, int64_t f0, int64_t f1, int64_t *kind,
                          int64_t *index) {
    double best = INFINITY, sign = 1.0;
    *kind = CORNER_FACET, *index = f0;
    for (int64_t f = f0; f < f1; f++) {
        double dx = px - facets[f].px, dy = py - facets[f].py;
        double along = dx * facets[f].tx + dy * facets[f].ty, above = dx * facets[f].nx + dy * facets[f].ny;
        if (above * above >= best) continue;
        if (0.0 <= along && along <= facets[f].length) {
            best = above * above, *kind = CORNER_FACET, *index = f;
            sign = above >= 0.0 ? 1.0 : -1.0;
            continue;
        }
        int64_t v = along < 0.0 ? f : f + 1;
        dx = px - facets[v].px, dy = py - facets[v].py;
        if (dx * dx + dy * dy < best) {
            best = dx * dx + dy * dy, *kind = CORNER_VERTEX, *index = v;
            double nx = facets[v].nx, ny = facets[v].ny;
            if (v > 0) nx += facets[v - 1].nx, ny += facets[v - 1].ny;
            sign = nx * dx + ny * dy >= 0.0 ? 1.0 : -1.0;
        }
    }
    return -sign * sqrt(best);
}

static double near_depth(double px, double py, const World *w, Range near, double reach, int64_t *kind,
                         int64_t *index) {
    if (near.end - near.first <= 8) return point_depth(px, py, w->facets, near.first, near.end, kind, index);
    Range g = facet_range(w, px, px);
    g.first = most_i(near.first, g.first), g.end = least_i(near.end, g.end);
    double depth = point_depth(px, py, w->facets, g.first, g.end, kind, index);
    double width = depth < 0.0 ? least(-depth, reach) : depth;
    Range h = facet_range(w, px - width, px + width);
    h.first = most_i(near.first, h.first), h.end = least_i(near.end, h.end);
    if (h.first >= g.first && h.end <= g.end) return depth;
    return point_depth(px, py, w->facets, h.first, h.end, kind, index);
}

static double polygon_depth(double px, double py, Pose at, const World *w, int64_t *face) {
    double bx = at.c * (px - at.x) + at.s * (py - at.y), by = -at.s * (px - at.x) + at.c * (py - at.y);
    double depth = INFINITY;
    *face = 0;
    for (int64_t k = 0; k < w->corners; k++) {
        double d = w->sides[k].face_offset - w->sides[k].face_x * bx - w->sides[k].face_y * by;
        if (d < depth) depth = d, *face = k;
    }
    return depth;
}

static bool crosses(int64_t f, Pose at, const World *w) {
    const Facet *facet = w->facets + f;
    double dx = facet->px - at.x, dy = facet->py - at.y;
    double bx = at.c * dx + at.s * dy, by = -at.s * dx + at.c * dy;
    double tx = at.c * facet->tx + at.s * facet->ty, ty = -at.s * facet->tx + at.c * facet->ty;
    double begin = 0.0, end = facet->length;
    for (int64_t k = 0; k < w->corners; k++) {
        const Side *side = w->sides + k;
        double depth = side->face_offset - side->face_x * bx - side->face_y * by;
        double climb = side->face_x * tx + side->face_y * ty;
        if (climb > 0.0) end = least(end, depth / climb);
        else if (climb < 0.0) begin = most(begin, depth / climb);
        else if (depth <= 0.0) return false;
        if (begin >= end) return false;
    }
    return true;
}

static inline Feature load_feature(int64_t kind, int64_t index, int64_t part, const World *w) {
    const Facet *facet = w->facets + index;
    Feature f = {kind, facet->px, facet->py, 0.0, 0.0, w->radius, 0.0, 0.0};
    if (kind == CORNER_FACET || kind == SMOOTH_FACET) f.nx = facet->nx, f.ny = facet->ny;
    if (kind <= CORNER_VERTEX) f.w1 = w->sides[part].x, f.w2 = w->sides[part].y;
    if (kind == VERTEX_FACE)
        f.w1 = w->sides[part].face_x, f.w2 = w->sides[part].face_y, f.w3 = w->sides[part].face_offset;
    return f;
}

static inline Point place_feature(const Feature *f, Pose at) {
    if (f->kind <= CORNER_VERTEX) {
        double rx = at.c * f->w1 - at.s * f->w2, ry = at.s * f->w1 + at.c * f->w2;
        double dx = at.x + rx - f->px, dy = at.y + ry - f->py;
        if (f->kind == CORNER_FACET) return (Point){-(dx * f->nx + dy * f->ny), f->nx, f->ny, rx, ry};
        double distance = sqrt(dx * dx + dy * dy);
        if (distance == 0.0) return (Point){0.0, 0.0, 1.0, rx, ry};
        return (Point){distance, -dx / distance, -dy / distance, rx, ry};
    }
    if (f->kind == VERTEX_FACE) {
        double nx = -(at.c * f->w1 - at.s * f->w2), ny = -(at.s * f->w1 + at.c * f->w2);
        double rx = f->px - at.x, ry = f->py - at.y;
        return (Point){f->w3 + nx * rx + ny * ry, nx, ny, rx, ry};
    }
    if (f->kind == SMOOTH_FACET) {
        double rx = -f->w1 * f->nx, ry = -f->w1 * f->ny;
        return (Point){-((at.x + rx - f->px) * f->nx + (at.y + ry - f->py) * f->ny), f->nx, f->ny, rx, ry};
    }
    double dx = f->px - at.x, dy = f->py - at.y, distance = sqrt(dx * dx + dy * dy);
    double nx = -dx / distance, ny = -dy / distance;
    return (Point){f->w1 - distance, nx, ny, -f->w1 * nx, -f->w1 * ny};
}

static inline Point contact_point(const Contact *c, Pose at, const World *w) {
    Feature f = load_feature(c->kind, c->index, c->part, w);
    return place_feature(&f, at);
}

/* ---- a lower bound of the time to the ground ---- */
static inline double safe_time(double distance, double speed, double gravity) {
    if (distance <= 0.0) return 0.0;
    if (gravity <= 0.0) return distance / most(speed, 1e-300);
    return 2.0 * distance / (speed + sqrt(speed * speed + 2.0 * gravity * distance));
}

static inline double fall_time(double gap, double rate, double pull) {
    if (gap <= 0.0) return 0.0;
    double square = rate * rate + 2.0 * pull * gap;
    if (square < 0.0) return NO_BOX;
    double root = sqrt(square);
    if (rate < 0.0) return 2.0 * gap / (root - rate);
    return pull > 0.0 ? (root + rate) / pull : NO_BOX;
}

static inline double line_time(double nx, double ny, double offset, const double *q, Pose at, const World *w) {
    double height = q[X] * nx + q[Y] * ny - offset, rate = q[VX] * nx + q[VY] * ny;
    if (w->corners == 0) return fall_time(height - w->radius, rate, w->gravity * ny);
    double soonest = NO_BOX, pull = w->gravity * ny + q[OMEGA] * q[OMEGA] * w->radius;
    for (int64_t i = 0; i < w->corners; i++) {
        double rx = at.c * w->sides[i].x - at.s * w->sides[i].y, ry = at.s * w->sides[i].x + at.c * w->sides[i].y;
        double turning = q[OMEGA] * (rx * ny - ry * nx);
        soonest = least(soonest, fall_time(height + rx * nx + ry * ny, rate + turning, pull));
    }
    return soonest;
}

static double node_time(const Node *node, const double *q, Pose at, double speed, const World *w) {
    if (node->low_x > node->high_x) return NO_BOX;
    double dx = most(most(node->low_x - q[X], q[X] - node->high_x), 0.0);
    double dy = most(most(node->low_y - q[Y], q[Y] - node->high_y), 0.0);
    double away = safe_time(most(sqrt(dx * dx + dy * dy) - w->radius, 0.0), speed, w->gravity);
    return most(away, line_time(node->hull_x, node->hull_y, node->hull_offset, q, at, w));
}

static double time_to_ground(const double *q, const World *w) {
    int64_t leaves = w->nodes / 2, n = w->points - 1, stack[64], top = 1;
    Pose at = pose_of(q);
    double speed = sqrt(q[VX] * q[VX] + q[VY] * q[VY]), soonest = NO_BOX;
    stack[0] = 1;
    while (top > 0) {
        int64_t node = stack[--top];
        if (node < leaves) {
            int64_t near = 2 * node, far = 2 * node + 1;
            double t_near = node_time(w->tree + near, q, at, speed, w);
            double t_far = node_time(w->tree + far, q, at, speed, w);
            if (t_far < t_near) {
                int64_t other = near;
                double t = t_near;
                near = far, far = other, t_near = t_far, t_far = t;
            }
            if (t_far < soonest) stack[top++] = far;
            if (t_near < soonest) stack[top++] = near;
            continue;
        }
        int64_t start = (node - leaves) * 4;
        for (int64_t f = start; f < least_i(start + 4, n); f++) {
            const Facet *facet = w->facets + f;
            double dx = q[X] - facet->px, dy = q[Y] - facet->py;
            double along = least(most(dx * facet->tx + dy * facet->ty, 0.0), facet->length);
            dx -= along * facet->tx, dy -= along * facet->ty;
            double away = safe_time(most(sqrt(dx * dx + dy * dy) - w->radius, 0.0), speed, w->gravity);
            if (away >= soonest) continue;
            double offset = facet->px * facet->nx + facet->py * facet->ny;
            soonest = least(soonest, most(away, line_time(facet->nx, facet->ny, offset, q, at, w)));
        }
    }
    return soonest;
}

static double gap_to_ground(const double *q, Range near, const World *w) {
    Pose at = pose_of(q);
    double gap = INFINITY;
    int64_t kind, index;
    for (int64_t i = 0; i < w->corners; i++) {
        double px = at.x + at.c * w->sides[i].x - at.s * w->sides[i].y;
        double py = at.y + at.s * w->sides[i].x + at.c * w->sides[i].y;
        gap = least(gap, -near_depth(px, py, w, near, least(gap, w->radius), &kind, &index));
    }
    for (int64_t v = most_i(near.first, 1); v < near.end; v++)
        if (w->facets[v].convex > 0.0)
            gap = least(gap, -polygon_depth(w->facets[v].px, w->facets[v].py, at, w, &index));
    for (int64_t f = near.first; f < near.end; f++)
        if (gap > 0.0 && crosses(f, at, w)) gap = 0.0;
    return gap;
}

static APART double time_to_contact(const double *q, const World *w, double h_contact) {
    double tau = time_to_ground(q, w);
    if (tau < h_contact && w->corners > 0) {
        Range near = facet_range(w, q[X] - 2.0 * w->radius, q[X] + 2.0 * w->radius);
        double gap = gap_to_ground(q, near, w);
        if (gap > 0.0) {
            double speed = sqrt(q[VX] * q[VX] + q[VY] * q[VY]);
            tau = safe_time(least(gap, 0.5 * w->radius), speed + fabs(q[OMEGA]) * w->radius, w->gravity);
        }
    }
    return tau;
}

/* ---- how far the block may move before its contacts can change ---- */
static inline double within_run(double px, double py, int64_t own, const Facet *facets) {
    const Facet *first = facets + (int64_t)facets[own].run_first, *last = facets + (int64_t)facets[own].run_last;
    double behind = (px - first->px) * first->tx + (py - first->py) * first->ty;
    double ahead = last->length - (px - last->px) * last->tx - (py - last->py) * last->ty;
    return least(behind, ahead);
}

static double ball_guard(double x, double y, double guard, Range near, const World *w, const Contact *memory) {
    const Facet *facets = w->facets;
    for (int64_t j = 0; j < w->contacts; j++)
        if (memory[j].active) {
            if (memory[j].kind != SMOOTH_FACET) return 0.0;
            guard = least(guard, within_run(x, y, memory[j].index, facets));
        }
    int64_t f = near.first;
    while (f < near.end && guard > 0.0) {
        bool owned = false;
        for (int64_t j = 0; j < w->contacts; j++)
            if (memory[j].active && facets[f].run_first <= memory[j].index && memory[j].index <= facets[f].run_last)
                owned = true;
        if (owned) {
            f = (int64_t)facets[f].run_last + 1;
            continue;
        }
        double dx = x - facets[f].px, dy = y - facets[f].py;
        double along = dx * facets[f].tx + dy * facets[f].ty, above = dx * facets[f].nx + dy * facets[f].ny;
        guard = least(guard, most(most(above - w->radius, -along), along - facets[f].length));
        f++;
    }
    for (int64_t v = most_i(near.first, 1); v < near.end; v++) {
        if (facets[v].convex <= 0.0) continue;
        bool owned = false;
        for (int64_t j = 0; j < w->contacts; j++)
            if (memory[j].active) {
                const Facet *own = facets + memory[j].index;
                owned = owned || own->run_first == v || own->run_last == v - 1;
            }
        if (!owned) {
            double dx = x - facets[v].px, dy = y - facets[v].py;
            guard = least(guard, sqrt(dx * dx + dy * dy) - w->radius);
        }
    }
    return most(guard, 0.0);
}

static double guard_distance(const double *q, double guard, Range near, const World *w, const Contact *memory) {
    if (w->corners == 0) return ball_guard(q[X], q[Y], guard, near, w, memory);
    Pose at = pose_of(q);
    const Facet *facets = w->facets;
    int64_t kind, index;
    for (int64_t i = 0; i < w->corners; i++) {
        double px = at.x + at.c * w->sides[i].x - at.s * w->sides[i].y;
        double py = at.y + at.s * w->sides[i].x + at.c * w->sides[i].y;
        if (!memory[i].active) {
            guard = least(guard, -near_depth(px, py, w, near, guard, &kind, &index));
        } else if (memory[i].kind != CORNER_FACET) {
            return 0.0;
        } else {
            int64_t own = memory[i].index;
            double above = (px - facets[own].px) * facets[own].nx + (py - facets[own].py) * facets[own].ny;
            guard = least(guard, within_run(px, py, own, facets));
            double width = guard + 2.0 * fabs(above), other = INFINITY;
            Range g = facet_range(w, px - width, px + width);
            for (int64_t f = most_i(near.first, g.first); f < least_i(near.end, g.end); f++) {
                if (facets[own].run_first <= f && f <= facets[own].run_last) continue;
                double dx = px - facets[f].px, dy = py - facets[f].py;
                double along = dx * facets[f].tx + dy * facets[f].ty, away = dx * facets[f].nx + dy * facets[f].ny;
                double beyond = most(most(-along, along - facets[f].length), 0.0);
                other = least(other, away * away + beyond * beyond);
            }
            guard = least(guard, 0.5 * (sqrt(other) - fabs(above)));
        }
        if (guard <= 0.0) return 0.0;
    }
    for (int64_t v = most_i(near.first, 1); v < near.end; v++) {
        if (facets[v].convex <= 0.0) continue;
        double dx = facets[v].px - at.x, dy = facets[v].py - at.y;
        double bx = at.c * dx + at.s * dy, by = -at.s * dx + at.c * dy;
        double nearest = INFINITY, second = INFINITY;
        for (int64_t k = 0; k < w->corners; k++) {
            double d = w->sides[k].face_offset - w->sides[k].face_x * bx - w->sides[k].face_y * by;
            if (d < nearest) second = nearest, nearest = d;
            else if (d < second) second = d;
        }
        guard = least(guard, nearest > 0.0 ? 0.5 * (second - nearest) : -nearest);
    }
    return most(guard, 0.0);
}
