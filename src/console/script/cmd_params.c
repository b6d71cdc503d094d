/* Commands that set numbers: gains, set, limit. */
#include <math.h>
#include <stddef.h>
#include <stdio.h>
#include <string.h>

#include "base/text.h"
#include "console/script/cmd_priv.h"

enum mk_status cmd_no_setup(struct mk_error *err)
{
    return mk_error_set(err, MK_ERR_STATE, "choose a setup first");
}

enum mk_status cmd_need_setup(const struct session *s, struct mk_error *err)
{
    return s->ctrl ? MK_OK : cmd_no_setup(err);
}

static enum mk_status read_value(const struct mk_ctrl_ops *setup, int index, const char *text,
                                 double *value, struct mk_error *err)
{
    double x;
    enum mk_status st = cmd_number(text, &x, err);
    if (st == MK_OK)
        st = mk_ctrl_check(setup, index, x, err);
    if (st == MK_OK)
        value[index] = x;
    return st;
}

enum mk_status cmd_read_gains(const struct mk_ctrl_ops *setup, int argc, char **argv, double *value,
                              struct mk_error *err)
{
    enum mk_status st = MK_OK;
    int k = 0, want = mk_ctrl_gain_count(setup);
    if (argc != want)
        return mk_error_set(err, MK_ERR_USAGE, "setup %s takes %d gains, not %d", setup->name, want,
                            argc);
    for (int i = 0; st == MK_OK && i < setup->param_count; i++)
        if (setup->param[i].gain)
            st = read_value(setup, i, argv[k++], value, err);
    return st;
}

static enum mk_status unknown_parameter(const struct mk_ctrl_ops *setup, const char *name,
                                        struct mk_error *err)
{
    struct mk_meant meant = {.word = name};
    char text[80];
    for (int i = 0; i < setup->param_count; i++)
        mk_meant_try(&meant, setup->param[i].name);
    return mk_error_set(err, MK_ERR_NOTFOUND, "setup %s has no parameter '%s'%s", setup->name, name,
                        meant.name ? mk_meant_text(&meant, text, sizeof text)
                                   : "; `show gains` lists them");
}

enum mk_status cmd_read_set(const struct mk_ctrl_ops *setup, char **argv, double *value,
                            struct mk_error *err)
{
    int index = mk_ctrl_param_index(setup, argv[0]);
    if (index < 0)
        return unknown_parameter(setup, argv[0], err);
    return read_value(setup, index, argv[1], value, err);
}

static enum mk_status apply_values(struct session *s, const double *value, struct mk_error *err)
{
    double before[MK_CTRL_MAX_PARAMS];
    memcpy(before, s->value, sizeof before);
    memcpy(s->value, value, sizeof s->value);
    enum mk_status st = session_apply(s, err);
    if (st != MK_OK)
        memcpy(s->value, before, sizeof before);
    return st;
}

enum mk_status cmd_do_gains(struct session *s, int argc, char **argv, struct mk_error *err)
{
    double value[MK_CTRL_MAX_PARAMS];
    memcpy(value, s->value, sizeof value);
    enum mk_status st = cmd_need_setup(s, err);
    if (st == MK_OK)
        st = cmd_read_gains(s->setup, argc, argv, value, err);
    return st == MK_OK ? apply_values(s, value, err) : st;
}

enum mk_status cmd_do_set(struct session *s, int argc, char **argv, struct mk_error *err)
{
    double value[MK_CTRL_MAX_PARAMS];
    (void)argc;
    memcpy(value, s->value, sizeof value);
    enum mk_status st = cmd_need_setup(s, err);
    if (st == MK_OK)
        st = cmd_read_set(s->setup, argv, value, err);
    return st == MK_OK ? apply_values(s, value, err) : st;
}

/* --- limits -------------------------------------------------------------------------------- */

/* No joint is slower, or faster, than that, in its unit a second or a sample. */
#define SLOWEST 1e-6
#define FASTEST 1e6
#define LONGEST_S 60.0

/* What a range knows of the rig: how its joints rest, and the largest command. */
enum bound { GIVEN, REST_1, REST_2, U_MAX };

static const struct limit {
    const char *name;
    size_t at; /* in struct mk_safety_limits */
    double least, most;
    enum bound least_of, most_of; /* what stands for least and most instead */
} limits[] = {
#define LIMIT_AT(member) offsetof(struct mk_safety_limits, member)
    {"q1_min", LIMIT_AT(q_min[0]), -INFINITY, INFINITY, GIVEN, REST_1},
    {"q1_max", LIMIT_AT(q_max[0]), -INFINITY, INFINITY, REST_1, GIVEN},
    {"q2_min", LIMIT_AT(q_min[1]), -INFINITY, INFINITY, GIVEN, REST_2},
    {"q2_max", LIMIT_AT(q_max[1]), -INFINITY, INFINITY, REST_2, GIVEN},
    {"dq1_max", LIMIT_AT(v_max[0]), SLOWEST, FASTEST, GIVEN, GIVEN},
    {"dq2_max", LIMIT_AT(v_max[1]), SLOWEST, FASTEST, GIVEN, GIVEN},
    {"jump1", LIMIT_AT(jump_rad[0]), SLOWEST, FASTEST, GIVEN, GIVEN},
    {"jump2", LIMIT_AT(jump_rad[1]), SLOWEST, FASTEST, GIVEN, GIVEN},
    {"rest1", LIMIT_AT(rest_tolerance[0]), 0.0, INFINITY, GIVEN, GIVEN},
    {"rest2", LIMIT_AT(rest_tolerance[1]), 0.0, INFINITY, GIVEN, GIVEN},
    {"stuck_s", LIMIT_AT(stuck_s), 0.001, LONGEST_S, GIVEN, GIVEN},
    {"stuck_u", LIMIT_AT(stuck_u), 0.0, INFINITY, GIVEN, U_MAX},
    {"model_share", LIMIT_AT(model_share), 0.0, 1.0, GIVEN, GIVEN},
    {"runaway_s", LIMIT_AT(runaway_s), 0.0, LONGEST_S, GIVEN, GIVEN}};
#define LIMITS ((int)(sizeof limits / sizeof limits[0]))

/* `model` NULL: not known yet, and what depends on it is not looked at. */
static double bound(enum bound of, double given, const struct mk_model *model)
{
    if (of == GIVEN || !model)
        return given;
    return of == U_MAX ? model->u_max : mk_plant(model->plant)->rest[of == REST_2];
}

enum mk_status cmd_check_limit_value(const char *name, double x, const struct mk_model *model,
                                     struct mk_error *err)
{
    for (int i = 0; i < LIMITS; i++) {
        const struct limit *l = &limits[i];
        double least = bound(l->least_of, l->least, model);
        double most = bound(l->most_of, l->most, model);
        if (strcmp(l->name, name) == 0 && !(x >= least && x <= most))
            return mk_error_set(err, MK_ERR_RANGE, "limit %s is %g, it must be %g .. %g", name, x,
                                least, most);
    }
    return MK_OK;
}

const char *cmd_limit_name(int index)
{
    return index >= 0 && index < LIMITS ? limits[index].name : NULL;
}

enum mk_status cmd_find_limit(struct mk_safety_limits *in, const char *name, double **at,
                              struct mk_error *err)
{
    char known[256] = "", text[80];
    struct mk_meant meant = {.word = name};
    for (int i = 0; i < LIMITS; i++) {
        size_t used = strlen(known);
        if (strcmp(limits[i].name, name) == 0) {
            *at = (double *)(void *)((char *)in + limits[i].at);
            return MK_OK;
        }
        snprintf(known + used, sizeof known - used, "%s%s", i ? ", " : "", limits[i].name);
        mk_meant_try(&meant, limits[i].name);
    }
    return mk_error_set(err, MK_ERR_NOTFOUND, "there is no limit '%s'%s%s %s", name,
                        mk_meant_text(&meant, text, sizeof text),
                        meant.name ? " There are" : "; there are", known);
}

enum mk_status cmd_do_limit(struct session *s, int argc, char **argv, struct mk_error *err)
{
    double x, *at;
    (void)argc;
    enum mk_status st = cmd_need_setup(s, err);
    if (st == MK_OK && s->running)
        st = mk_error_set(err, MK_ERR_STATE, "limits are changed between runs: halt first");
    if (st == MK_OK)
        st = cmd_find_limit(&s->config.limits, argv[0], &at, err);
    if (st == MK_OK)
        st = cmd_number(argv[1], &x, err);
    if (st == MK_OK)
        st = cmd_check_limit_value(argv[0], x, &s->model, err);
    if (st == MK_OK)
        *at = x;
    return st;
}
