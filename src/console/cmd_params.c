/* Commands that set numbers: gains, set, limit. */
#include <string.h>

#include "console/cmd_priv.h"

enum mk_status cmd_need_setup(const struct session *s, struct mk_error *err)
{
    return s->ctrl ? MK_OK : mk_error_set(err, MK_ERR_STATE, "choose a setup first");
}

/* Checks and stores one value; the caller applies. */
static enum mk_status put_value(struct session *s, int index, const char *text, double *value,
                                struct mk_error *err)
{
    double x;
    enum mk_status st = cmd_number(text, &x, err);
    if (st == MK_OK)
        st = mk_ctrl_check(s->setup, index, x, err);
    if (st == MK_OK)
        value[index] = x;
    return st;
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
    enum mk_status st = cmd_need_setup(s, err);
    if (st != MK_OK)
        return st;
    int want = mk_ctrl_gain_count(s->setup);
    if (argc != want)
        return mk_error_set(err, MK_ERR_USAGE, "setup %s takes %d gains, not %d", s->setup->name,
                            want, argc);
    double value[MK_CTRL_MAX_PARAMS];
    memcpy(value, s->value, sizeof value);
    int k = 0;
    for (int i = 0; st == MK_OK && i < s->setup->param_count; i++)
        if (s->setup->param[i].gain)
            st = put_value(s, i, argv[k++], value, err);
    return st == MK_OK ? apply_values(s, value, err) : st;
}

enum mk_status cmd_do_set(struct session *s, int argc, char **argv, struct mk_error *err)
{
    (void)argc;
    enum mk_status st = cmd_need_setup(s, err);
    if (st != MK_OK)
        return st;
    int index = mk_ctrl_param_index(s->setup, argv[0]);
    if (index < 0)
        return mk_error_set(err, MK_ERR_NOTFOUND,
                            "setup %s has no parameter '%s'; `show gains` lists them",
                            s->setup->name, argv[0]);
    double value[MK_CTRL_MAX_PARAMS];
    memcpy(value, s->value, sizeof value);
    st = put_value(s, index, argv[1], value, err);
    return st == MK_OK ? apply_values(s, value, err) : st;
}

/* "q1_min" and so on, to the limit's place. */
double *cmd_limit_at(struct session *s, const char *name)
{
    struct mk_safety_limits *l = &s->config.limits;
    const struct {
        const char *name;
        double *at;
    } rows[] = {{"q1_min", &l->q_min[0]},         {"q1_max", &l->q_max[0]},
                {"q2_min", &l->q_min[1]},         {"q2_max", &l->q_max[1]},
                {"dq1_max", &l->v_max[0]},        {"dq2_max", &l->v_max[1]},
                {"jump1", &l->jump_rad[0]},       {"jump2", &l->jump_rad[1]},
                {"rest1", &l->rest_tolerance[0]}, {"rest2", &l->rest_tolerance[1]},
                {"stuck_s", &l->stuck_s},         {"stuck_u", &l->stuck_u},
                {"runaway_s", &l->runaway_s}};
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++)
        if (strcmp(rows[i].name, name) == 0)
            return rows[i].at;
    return NULL;
}

enum mk_status cmd_do_limit(struct session *s, int argc, char **argv, struct mk_error *err)
{
    (void)argc;
    double x;
    enum mk_status st = cmd_need_setup(s, err);
    if (st == MK_OK && s->running)
        st = mk_error_set(err, MK_ERR_STATE, "limits are changed between runs: halt first");
    double *at = st == MK_OK ? cmd_limit_at(s, argv[0]) : NULL;
    if (st == MK_OK && !at)
        st = mk_error_set(err, MK_ERR_NOTFOUND, "there is no limit '%s'; `show limits` lists them",
                          argv[0]);
    if (st == MK_OK)
        st = cmd_number(argv[1], &x, err);
    if (st == MK_OK)
        *at = x;
    return st;
}
