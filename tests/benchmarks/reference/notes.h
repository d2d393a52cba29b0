/* What tests/benchmarks/bench_events.py asks for: with -DCOUNTS what a descent consists of, with -DPARTS functions that
   a profiler can tell apart. Without them the kernel is the plain one. */
enum { FLIGHTS, STRIDES, HOPS, FAST_STEPS, FULL_STEPS, TRIALS, LANDED_ON, HALVED, NORMAL_EVENTS, FRICTION_EVENTS,
       ROLLING_EVENTS, N_NOTES };

#ifdef PARTS
#define APART __attribute__((noinline))
#else
#define APART
#endif

#ifdef COUNTS
double noted[N_NOTES];
#define NOTE(what) (noted[what] += 1.0)
/* the branches of the law at the end of the step before, of each contact; -1: not known, the contact begins */
static struct { int normal, slips, turns; } branch_of[MOST_CONTACTS];
static void forget_branches(int64_t j) { branch_of[j].normal = branch_of[j].slips = branch_of[j].turns = -1; }
static void note_branch(int *before, int now, int event) {
    if (*before >= 0 && *before != now) NOTE(event);
    *before = now;
}
#else
#define NOTE(what) ((void)0)
#define forget_branches(j) ((void)0)
#endif
