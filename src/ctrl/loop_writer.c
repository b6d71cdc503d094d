/* From the ring into the log: rows as they come, notes where something happened. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "ctrl/loop_priv.h"
#include "mechkit/number.h"

#define META_MAX 64
#define TEXT_MAX 4096
#define COLUMNS_MAX 16

/* --- metadata -------------------------------------------------------------------------------- */

struct meta_list {
    struct mk_log_meta row[META_MAX];
    size_t count;
    char text[TEXT_MAX]; /* values made here */
    size_t used;
};

static void meta_put(struct meta_list *m, const char *key, char *value)
{
    for (size_t i = 0; i < m->count; i++)
        if (strcmp(m->row[i].key, key) == 0)
            return; /* the caller knows better */
    if (m->count == META_MAX)
        return;
    /* The log's own list has writable strings; the writer only reads these. */
    m->row[m->count++] = (struct mk_log_meta){(char *)(uintptr_t)key, value};
}

static char *meta_room(struct meta_list *m)
{
    return m->text + m->used;
}

/* Appends to the value being made. */
static void meta_text(struct meta_list *m, size_t *length, const char *text)
{
    size_t room = TEXT_MAX - m->used - *length;
    int n = snprintf(meta_room(m) + *length, room, "%s", text);
    *length += (size_t)n < room ? (size_t)n : room - 1;
}

static void meta_number(struct meta_list *m, size_t *length, double value)
{
    char number[MK_NUMBER_MAX];
    mk_format_double(number, value);
    meta_text(m, length, number);
}

static void meta_finish(struct meta_list *m, const char *key, size_t length)
{
    char *value = meta_room(m);
    m->used += length + 1;
    if (m->used >= TEXT_MAX)
        m->used = TEXT_MAX - 1;
    meta_put(m, key, value);
}

static void meta_string(struct meta_list *m, const char *key, const char *text)
{
    size_t n = 0;
    meta_text(m, &n, text);
    meta_finish(m, key, n);
}

static void meta_double(struct meta_list *m, const char *key, double value)
{
    size_t n = 0;
    meta_number(m, &n, value);
    meta_finish(m, key, n);
}

/* "k1=48.23 k2=5.25 omega=4.5" */
static void parameter_text(char *buf, size_t size, const struct mk_ctrl_ops *setup,
                           const double *value)
{
    size_t used = 0;
    buf[0] = '\0';
    for (int i = 0; i < setup->param_count && used < size; i++) {
        char number[MK_NUMBER_MAX];
        mk_format_double(number, value[i]);
        int n = snprintf(buf + used, size - used, "%s%s=%s", i ? " " : "", setup->param[i].name,
                         number);
        used += n > 0 ? (size_t)n : 0;
    }
}

static void describe_control(struct meta_list *m, const struct mk_loop *loop)
{
    const struct mk_ctrl *ctrl = loop->ctrl;
    char all[1024];
    size_t n = 0;
    bool any = false;
    meta_string(m, "setup", ctrl->ops->name);
    for (int i = 0; i < ctrl->ops->param_count; i++) {
        if (!ctrl->ops->param[i].gain)
            continue;
        meta_text(m, &n, any ? " " : "");
        meta_number(m, &n, ctrl->value[i]);
        any = true;
    }
    if (any)
        meta_finish(m, "gains", n);
    parameter_text(all, sizeof all, ctrl->ops, ctrl->value);
    if (all[0])
        meta_string(m, "parameters", all);
    if (ctrl->ref)
        meta_string(m, "reference", mk_signal_text(ctrl->ref));
    meta_string(m, "velocity", mk_velocity_name(loop->config.velocity.kind));
}

/* The size of a count of every joint, by the turn where all have one, and the units of joints that
 * slide. */
static void describe_joints(struct meta_list *m, const struct mk_loop *loop)
{
    const struct mk_model *model = &loop->ctrl->model;
    bool slides = false, turns = true;
    size_t n = 0;
    for (int j = 0; j < loop->plant->joints; j++) {
        turns = turns && loop->identity.encoder_cpr[j] > 0;
        slides = slides || model->joint_linear[j];
    }
    for (int j = 0; j < loop->plant->joints; j++) {
        meta_text(m, &n, j ? " " : "");
        meta_number(m, &n, turns ? loop->identity.encoder_cpr[j] : loop->rad_per_count[j]);
    }
    meta_finish(m, turns ? "encoder_cpr" : "encoder_resolution", n);
    n = 0;
    for (int j = 0; slides && j < loop->plant->joints; j++) {
        meta_text(m, &n, j ? " " : "");
        meta_text(m, &n, mk_model_unit(model, j, "rad"));
    }
    if (slides)
        meta_finish(m, "joint_unit", n);
}

static void describe_board(struct meta_list *m, const struct mk_board_identity *identity)
{
    size_t n = 0;
    meta_text(m, &n, identity->name);
    meta_text(m, &n, ", ");
    meta_text(m, &n, identity->firmware);
    if (identity->serial[0]) {
        meta_text(m, &n, ", serial ");
        meta_text(m, &n, identity->serial);
    }
    meta_finish(m, "board", n);
}

static void describe_run(struct meta_list *m, const struct mk_loop *loop)
{
    meta_string(m, "rig", loop->plant->name);
    meta_double(m, "sample_rate_hz", loop->config.rate_hz);
    describe_joints(m, loop);
    meta_double(m, "u_to_torque", loop->ctrl->model.u_to_torque);
    meta_double(m, "u_max", loop->board->u_max);
    describe_board(m, &loop->identity);
    describe_control(m, loop);
    meta_string(m, "phases", "0 idle, 1 swing-up, 2 balance, 3 track");
    meta_string(m, "program", "mechkit " MK_VERSION);
    if (loop->config.stream)
        meta_string(m, "clock", "board");
    if (loop->simulated)
        meta_string(m, "realtime", "simulated time");
    else
        meta_string(m, "realtime", loop->host.note[0] ? loop->host.note : "granted");
}

/* --- rows ------------------------------------------------------------------------------------ */

static size_t column_names(int joints, const char *name[COLUMNS_MAX])
{
    static const char *const two[] = {"t",    "q1",  "q2",    "u",    "dq1",     "dq2",  "enc1",
                                      "enc2", "ref", "phase", "tick", "late_us", "flags"};
    static const char *const one[] = {"t",   "q1",    "u",    "dq1",     "enc1",
                                      "ref", "phase", "tick", "late_us", "flags"};
    size_t count = joints == 2 ? sizeof two / sizeof two[0] : sizeof one / sizeof one[0];
    memcpy(name, joints == 2 ? two : one, count * sizeof *name);
    return count;
}

static void write_row(struct mk_loop_writer *w, const struct mk_sample *s)
{
    double row[COLUMNS_MAX];
    bool lost = (s->flags & MK_FLAG_LOST) != 0;
    size_t n = 0;
    row[n++] = s->t;
    for (int j = 0; j < w->joints; j++)
        row[n++] = s->q[j]; /* NaN when lost: an empty field */
    row[n++] = s->u;
    for (int j = 0; j < w->joints; j++)
        row[n++] = lost ? (double)NAN : s->v[j];
    for (int j = 0; j < w->joints; j++)
        row[n++] = lost ? (double)NAN : s->count[j];
    row[n++] = s->ref;
    row[n++] = s->phase;
    row[n++] = (double)s->tick;
    row[n++] = s->late_us;
    row[n++] = s->flags;
    enum mk_status st = mk_log_writer_row(w->log, row);
    if (st != MK_OK)
        atomic_store_explicit(&w->status, st, memory_order_release);
}

static void note(struct mk_loop_writer *w, const char *key, const char *value)
{
    /* What fails here fails for the next row, and when the log is closed, as well. */
    (void)!mk_log_writer_note(w->log, key, value);
}

static void note_fault(struct mk_loop_writer *w, enum mk_fault fault, double t, int fault_joint)
{
    char text[96], joint[24] = "";
    if (fault == MK_FAULT_NONE || w->fault_noted)
        return;
    if (fault_joint > 0)
        snprintf(joint, sizeof joint, " joint %d", fault_joint);
    snprintf(text, sizeof text, "%s%s at %.4f s", mk_fault_name(fault), joint, t);
    note(w, "fault", text);
    w->fault_noted = true;
}

static void note_change(struct mk_loop_writer *w, const struct mk_loop_change *change)
{
    char text[1200];
    int n = snprintf(text, sizeof text, "at %.6f s: ", change->t);
    char *rest = text + n;
    size_t room = sizeof text - (size_t)n;
    if (change->flags & MK_FLAG_PARAMS) {
        parameter_text(rest, room, w->setup, change->now.value);
        note(w, "changed", text);
    }
    if (change->flags & MK_FLAG_SIGNAL) {
        const struct mk_signal *signal = change->now.signal;
        snprintf(rest, room, "reference %s", signal ? mk_signal_text(signal) : "none");
        note(w, "changed", text);
    }
}

/* What changed up to this sample. Of more changes than the ring holds between two writes the last
 * ones have no values here: their rows say at least that there was one. */
static void note_changes(struct mk_loop_writer *w, const struct mk_sample *s)
{
    char text[64];
    bool told = !(s->flags & (MK_FLAG_PARAMS | MK_FLAG_SIGNAL));
    while (w->next_waits || mk_ring_pop(w->changes, &w->next)) {
        w->next_waits = w->next.t > s->t;
        if (w->next_waits)
            break;
        told = told || w->next.t == s->t;
        note_change(w, &w->next);
    }
    if (told)
        return;
    snprintf(text, sizeof text, "at %.6f s: to what is not known", s->t);
    note(w, "changed", text);
}

void mk_loop_writer_drain(struct mk_loop_writer *w)
{
    struct mk_loop_record record;
    if (!w->log)
        return;
    while (mk_ring_pop(w->samples, &record)) {
        note_changes(w, &record.sample);
        note_fault(w, record.fault, record.sample.t, record.fault_joint);
        write_row(w, &record.sample);
    }
    enum mk_status st = mk_log_writer_flush(w->log, NULL);
    if (st != MK_OK)
        atomic_store_explicit(&w->status, st, memory_order_release);
}

/* --- opening and closing --------------------------------------------------------------------- */

enum mk_status mk_loop_writer_open(struct mk_loop *loop, const char *path,
                                   const struct mk_log_meta *meta, size_t meta_count,
                                   struct mk_error *err)
{
    struct mk_loop_writer *w = &loop->writer;
    struct mk_loop_record record;
    struct mk_loop_change change;
    while (mk_ring_pop(w->samples, &record))
        ;
    while (mk_ring_pop(w->changes, &change))
        ;
    w->next_waits = false;
    w->setup = loop->ctrl->ops;
    w->joints = loop->plant->joints;
    w->fault_noted = false;
    atomic_store_explicit(&w->status, MK_OK, memory_order_relaxed);
    if (!path)
        return MK_OK;

    struct meta_list m = {.count = 0};
    for (size_t i = 0; i < meta_count && m.count < META_MAX; i++)
        m.row[m.count++] = meta[i];
    describe_run(&m, loop);
    const char *column[COLUMNS_MAX];
    size_t columns = column_names(w->joints, column);
    return mk_log_writer_open(path, true, m.row, m.count, column, columns, &w->log, err);
}

static void note_summary(struct mk_loop *loop)
{
    struct mk_loop_stats s;
    char text[256];
    mk_loop_get_stats(loop, &s);
    snprintf(text, sizeof text,
             "%llu samples, %llu late, %llu overruns, %llu lost, %llu gaps, %llu not logged; "
             "lateness p50 %.1f p99 %.1f p99.9 %.1f max %.1f us",
             (unsigned long long)s.ticks, (unsigned long long)s.late,
             (unsigned long long)s.overruns, (unsigned long long)s.lost, (unsigned long long)s.gaps,
             (unsigned long long)s.dropped, s.late_p50_us, s.late_p99_us, s.late_p999_us,
             s.late_max_us);
    note(&loop->writer, "summary", text);
}

enum mk_status mk_loop_writer_finish(struct mk_loop *loop, struct mk_error *err)
{
    struct mk_loop_writer *w = &loop->writer;
    if (w->threaded) {
        atomic_store_explicit(&w->stop, true, memory_order_release);
        pthread_join(w->thread, NULL);
        w->threaded = false;
    }
    if (!w->log)
        return MK_OK;
    mk_loop_writer_drain(w);
    /* One that came behind the last row. */
    const struct mk_safety *safety = &loop->safety;
    note_fault(w, safety->fault, safety->fault_t, safety->fault_joint);
    note_summary(loop);
    /* Whatever could not be written on the way is told here. */
    enum mk_status st = mk_log_writer_close(w->log, err);
    w->log = NULL;
    return st;
}
