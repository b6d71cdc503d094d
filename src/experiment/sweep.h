/* Sweeps: the same computation for every combination of the values in a spec file, so many times
 * each. docs/sweep.md describes the file. Which run is which is counted through: the index of a run
 * says everything about it, so neither threads nor machines nor a kill in between change a result.
 */
#ifndef MECHKIT_EXPERIMENT_SWEEP_H
#define MECHKIT_EXPERIMENT_SWEEP_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "mechkit/model.h"
#include "mechkit/status.h"

#define SWEEP_AXES 32
#define SWEEP_VALUES 1000 /* of an axis */
#define SWEEP_RUNS_MAX 1000000
#define SWEEP_WORD 64
#define SWEEP_OUTCOMES 6
#define SWEEP_LINE 256

struct sweep;

/* A key of the spec file. */
struct sweep_key {
    const char *section, *key;
    enum { SWEEP_NUMBER, SWEEP_WHOLE, SWEEP_WORDS } type;
    double min, max;
};

/* What can be swept. */
struct sweep_kind {
    const char *name;
    const struct sweep_key *key; /* ends with a section of NULL */
    const char *free_section;    /* any key in it is taken as an axis of numbers; NULL: none */
    int default_runs;            /* at every point */
    int batch;                   /* runs that another process takes at once */
    const char *outcome[SWEEP_OUTCOMES + 1]; /* words; the first `successes` of them are good */
    int successes;
    const char *columns; /* of a result, behind the outcome; the first may be text, the rest not */
    /* Checks what values mean together, and loads what they name. */
    enum mk_status (*prepare)(struct sweep *s, struct mk_error *err);
    /* One run; its columns, comma between them, go to `text`. Any thread. */
    enum mk_status (*run)(const struct sweep *s, size_t index, int *outcome, char text[SWEEP_LINE],
                          struct mk_error *err);
};
extern const struct sweep_kind sweep_robustness, sweep_basin, sweep_explain;

struct sweep_axis {
    const struct sweep_key *key; /* NULL: of the free section */
    char name[SWEEP_WORD];       /* "section.key", or the key where that is plain */
    int line;
    int count;
    bool with_last;           /* turns together with the axis before it */
    double *value;            /* NULL: words */
    char (*word)[SWEEP_WORD]; /* NULL: numbers */
};

struct sweep {
    const struct sweep_kind *kind;
    char path[512];
    int runs; /* at every point */
    uint64_t seed;
    int axis_count;
    struct sweep_axis axis[SWEEP_AXES]; /* in the order of the file; the last one turns fastest */
    size_t points, total;               /* total = points * runs */
    uint64_t fingerprint;               /* of everything that results depend on */
    struct mk_model model[MK_PLANT_COUNT]; /* believed, by kind of rig */
    bool own_model[MK_PLANT_COUNT];        /* given by [rig] model */
    char *model_path[MK_PLANT_COUNT];      /* of it; NULL where there is none */
};

/* Errors name file, line and what would be right. sweep_free also after a failure. */
MK_NODISCARD enum mk_status sweep_read(const char *path, struct sweep *out, struct mk_error *err);
void sweep_free(struct sweep *s);

static inline size_t sweep_point(const struct sweep *s, size_t index)
{
    return index / (size_t)s->runs;
}
/* Runs of the same number have the same seed at every point: points are compared on the same draws.
 */
static inline uint64_t sweep_seed(const struct sweep *s, size_t index)
{
    return s->seed + index % (size_t)s->runs;
}
/* Which value of an axis a run has. */
int sweep_at(const struct sweep *s, size_t index, int axis);
/* The axis of that name; -1: the spec has none. */
int sweep_find(const struct sweep *s, const char *name);
/* The run's value of "section.key", or what holds when the spec does not say. */
double sweep_number(const struct sweep *s, size_t index, const char *name, double otherwise);
const char *sweep_word(const struct sweep *s, size_t index, const char *name,
                       const char *otherwise);
/* A value of an axis as text; returns buf. */
const char *sweep_value_text(const struct sweep_axis *a, int at, char buf[SWEEP_WORD]);
/* Appends the column of that number, from 0, to a result: nothing in it when it is not a number. */
void sweep_put(char text[SWEEP_LINE], int column, double x);
/* MK_ERR_PARSE with the line of the axis. */
enum mk_status sweep_refuse(const struct sweep *s, const struct sweep_axis *a, struct mk_error *err,
                            const char *fmt, ...) MK_PRINTF(4, 5);

#endif
