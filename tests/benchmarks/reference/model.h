/* What the reference kernel works on, and the contact law: as in rock2d/engines/geometry.py, contact_state.py
   and rock2d/laws/contact.py. SI units. */
#include <math.h>
#include <stdbool.h>
#include <stdint.h>

#define MOST_CONTACTS 40
#define NOWHERE (-1.0e300) /* depth of a contact that has no feature */
#define LEAST_EVENT 1e-3   /* of a step: an event that comes sooner has been landed on */

static inline double least(double a, double b) { return a < b ? a : b; }
static inline double most(double a, double b) { return a > b ? a : b; }
static inline int64_t least_i(int64_t a, int64_t b) { return a < b ? a : b; }
static inline int64_t most_i(int64_t a, int64_t b) { return a > b ? a : b; }

enum { X, Y, THETA, VX, VY, OMEGA, N_STATE };
enum { CORNER_FACET, CORNER_VERTEX, VERTEX_FACE, SMOOTH_FACET, SMOOTH_VERTEX };

typedef struct { double px, py, tx, ty, nx, ny, length, zone, patch, convex, run_first, run_last; } Facet;
typedef struct { double x, y, face_x, face_y, face_offset; } Side;
typedef struct { double low_x, low_y, high_x, high_y, hull_x, hull_y, hull_offset; } Node;
typedef struct { double k_l, k_ul, k_t, mu, k_r, cap, indentation; } Law;
typedef struct { double x, y, c, s; } Pose;
typedef struct { int64_t first, end; } Range; /* of facets, one past the last */

typedef struct {
    const Side *sides;
    int64_t corners; /* 0: a ball */
    double mass, inertia, radius;
    const Facet *facets; /* one row more than facets */
    int64_t points;
    const int64_t *first, *last; /* facets by bins of x */
    int64_t bins;
    double x_start, bins_per_m, x_low, x_high, facet_m;
    const Node *tree;
    int64_t nodes;
    const Law *law; /* by zone */
    const double (*lines)[4];
    int64_t line_count;
    double gravity;
    int64_t contacts;
} World;

/* the memory of a contact, or what a search of the ground found for it */
typedef struct {
    int64_t active, kind, index, part, zone, key;
    double depth, rate, peak, displacement, rotation, offset;
} Contact;

/* ground point, facet normal, shape of the block there */
typedef struct { int64_t kind; double px, py, nx, ny, w1, w2, w3; } Feature;
typedef struct { double depth, nx, ny, rx, ry; } Point;

/* an active contact, loaded for the steps to come */
typedef struct {
    Feature feature;
    Law law;
    double offset, peak, displacement, rotation, bottom;
    bool pressed;
    int64_t which;
    double unlimited_displacement, unlimited_rotation, slip_rate, spin_rate; /* of the springs, in a step */
    double depth_0, rate_0, depth_1, rate_1, arm;                    /* before and after a trial step */
    double peak_1, displacement_1, rotation_1, normal_0, normal_1, tangential_0, tangential_1, moment_1, plastic;
} Loaded;

typedef struct { double plastic, friction, rolling, corrected, pending; } Audit;

static inline Pose pose_of(const double *q) { return (Pose){q[X], q[Y], cos(q[THETA]), sin(q[THETA])}; }

/* ---- the law ---- */
static inline double residual(double peak, double k_l, double k_ul) { return peak * (1.0 - k_l / k_ul); }

static inline double force_at(double delta, double peak, double bottom, double k_l, double k_ul) {
    if (delta <= 0.0) return 0.0;
    if (delta >= peak) return k_l * delta;
    return most(0.0, least(k_l * delta, k_ul * (delta - bottom)));
}

static inline double normal_force(double delta, double peak, const Law *p) {
    return force_at(delta, peak, residual(peak, p->k_l, p->k_ul), p->k_l, p->k_ul);
}

static inline double tangential_force(double displacement, double force_n, double k_t, double mu) {
    double force = k_t * displacement, limit = mu * force_n;
    if (force_n <= 0.0) return 0.0;
    if (mu == INFINITY) return force;
    return least(most(force, -limit), limit);
}

static inline double rolling_moment(double rotation, double force_n, double arm, const Law *p) {
    if (force_n <= 0.0 && p->indentation == 0.0) return 0.0;
    double moment = p->k_r * rotation;
    if (p->cap > 0.0) {
        double limit = arm * force_n;
        moment = least(most(moment, -limit), limit);
    }
    return moment;
}

static inline double plastic_work(double peak, double k_l, double k_ul) {
    return 0.5 * k_l * peak * peak * (1.0 - k_l / k_ul);
}

static inline double elastic_energy(double force_n, double force_t, const Law *p) {
    double energy = 0.5 * force_n * force_n / p->k_ul;
    if (p->k_t > 0.0) energy += 0.5 * force_t * force_t / p->k_t;
    return energy;
}

static inline double rolling_energy(double rotation, const Law *p) { return 0.5 * p->k_r * rotation * rotation; }

/* a contact goes on at another feature, `jump` deeper: new offset and forces; returns the energy lost */
static double change_feature(const Law *p, double depth, double jump, double *offset, double peak, double *force_n,
                             double *force_t) {
    if (*offset + jump >= 0.0) {
        *offset += jump;
        return 0.0;
    }
    double new_n = normal_force(depth, peak, p);
    double new_t = tangential_force(p->k_t > 0.0 ? *force_t / p->k_t : 0.0, new_n, p->k_t, p->mu);
    double lost = elastic_energy(*force_n, *force_t, p) - elastic_energy(new_n, new_t, p);
    *offset = 0.0, *force_n = new_n, *force_t = new_t;
    return lost;
}

/* ---- energy and pressure ---- */
static inline double kinetic_energy(const double *q, const World *w) {
    return 0.5 * (w->mass * (q[VX] * q[VX] + q[VY] * q[VY]) + w->inertia * q[OMEGA] * q[OMEGA]);
}

static double stored_energy(const Contact *memory, const World *w) {
    double total = 0.0;
    for (int64_t j = 0; j < w->contacts; j++) {
        const Contact *m = memory + j;
        if (!m->active) continue;
        const Law *p = w->law + m->zone;
        double force_n = normal_force(m->depth - m->offset, m->peak, p);
        double force_t = tangential_force(m->displacement, force_n, p->k_t, p->mu);
        total += elastic_energy(force_n, force_t, p) + rolling_energy(m->rotation, p);
    }
    return total;
}

static int64_t pressure(const Contact *memory, const World *w, double *force, double *deepest) {
    int64_t active = 0;
    *force = *deepest = 0.0;
    for (int64_t j = 0; j < w->contacts; j++) {
        const Contact *m = memory + j;
        if (!m->active) continue;
        *force += normal_force(m->depth - m->offset, m->peak, w->law + m->zone);
        *deepest = most(*deepest, m->depth);
        active++;
    }
    return active;
}

static double step_growth(double reference, const Contact *memory, const World *w) {
    double energy = stored_energy(memory, w);
    bool touching = false;
    for (int64_t j = 0; j < w->contacts; j++)
        if (memory[j].active) {
            energy += 0.5 * w->mass * memory[j].rate * memory[j].rate;
            touching = true;
        }
    if (!touching) return 1.0;
    if (energy <= 0.0) return 5.0;
    return least(5.0, most(1.0, 0.25 * sqrt(reference / energy)));
}
