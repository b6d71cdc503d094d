/* What is wrong with a command's arguments as far as no board is needed to say so. */
#include <stdio.h>
#include <string.h>

#include "base/text.h"
#include "console/script/cmd_priv.h"
#include "console/script/condition.h"
#include "ctrl/ctrl_rig.h"
#include "driver/fault_script.h"
#include "mechkit/number.h"
#include "mechkit/swingup.h"

enum mk_status cmd_check_rate(struct cmd_known *known, int argc, char **argv, struct mk_error *err)
{
    double rate;
    (void)known, (void)argc;
    return cmd_rate(argv[0], &rate, err);
}

enum mk_status cmd_check_seed(struct cmd_known *known, int argc, char **argv, struct mk_error *err)
{
    uint64_t seed;
    (void)known, (void)argc;
    return cmd_seed(argv[0], &seed, err);
}

static bool read_seconds(const char *text, double *out)
{
    return mk_parse_double_z(text, out) && *out >= 0.0 && *out <= MK_LOOP_WAIT_MAX_S;
}

/* The run goes on for so long: what its signal is then is known before it begins. */
static enum mk_status go_on(struct cmd_known *known, double seconds, struct mk_error *err)
{
    struct mk_signal *signal;
    const double from_s = known->run_s;
    known->run_s += seconds;
    if (!known->signal[0] || (known->setup && !known->setup->takes_signal))
        return MK_OK;
    enum mk_status st = mk_signal_create(known->signal, &signal, err);
    if (st == MK_OK)
        st = session_check_signal(signal, from_s, known->run_s, err);
    mk_signal_destroy(signal);
    if (st != MK_OK)
        known->signal[0] = '\0'; /* once is enough */
    return st;
}

enum mk_status cmd_check_seconds(struct cmd_known *known, int argc, char **argv,
                                 struct mk_error *err)
{
    double seconds;
    (void)argc;
    if (!read_seconds(argv[0], &seconds))
        return mk_error_set(err, MK_ERR_PARSE, "expected seconds from 0 to %.0f, not '%s'",
                            MK_LOOP_WAIT_MAX_S, argv[0]);
    return known && known->running ? go_on(known, seconds, err) : MK_OK;
}

/* --- words ------------------------------------------------------------------------------- */

enum mk_status cmd_check_on_off(struct cmd_known *known, int argc, char **argv,
                                struct mk_error *err)
{
    (void)known, (void)argc;
    if (strcmp(argv[0], "on") == 0 || strcmp(argv[0], "off") == 0)
        return MK_OK;
    return mk_error_set(err, MK_ERR_PARSE, "expected on or off, not '%s'", argv[0]);
}

/* The blanks before the last such word of a text; NULL: there is none. *rest: what follows it. */
static char *find_last(char *text, const char *word, char **rest)
{
    size_t n = strlen(word);
    char *found = NULL;
    for (char *at = strstr(text, word); at; at = strstr(at + 1, word))
        if (at > text && strchr(" \t", at[-1]) && (!at[n] || strchr(" \t", at[n])))
            found = at;
    if (found)
        *rest = found + n + strspn(found + n, " \t");
    while (found && found > text && strchr(" \t", found[-1]))
        found--;
    return found;
}

bool cmd_split_seconds(char *text, const char *word, double *seconds)
{
    char *rest, *at = find_last(text, word, &rest);
    if (!at || !read_seconds(rest, seconds))
        return false;
    *at = '\0';
    return true;
}

/* A condition may hold `within` itself: a word that no seconds follow is taken for theirs where
 * what stands before it is a condition already. */
static enum mk_status check_condition(const char *condition, const char *word, struct mk_error *err)
{
    char text[1024], *rest;
    double seconds;
    snprintf(text, sizeof text, "%s", condition);
    if (cmd_split_seconds(text, word, &seconds))
        return condition_check(text, err);
    char *at = find_last(text, word, &rest);
    if (at)
        *at = '\0';
    if (!at || condition_check(text, NULL) != MK_OK)
        return condition_check(condition, err);
    return mk_error_set(err, MK_ERR_PARSE, "expected seconds from 0 to %.0f after '%s'%s%s%s",
                        MK_LOOP_WAIT_MAX_S, word, *rest ? ", not '" : "", rest, *rest ? "'" : "");
}

enum mk_status cmd_check_expect(struct cmd_known *known, int argc, char **argv,
                                struct mk_error *err)
{
    (void)known, (void)argc;
    return check_condition(argv[0], "for", err);
}

enum mk_status cmd_check_wait_until(struct cmd_known *known, int argc, char **argv,
                                    struct mk_error *err)
{
    (void)known, (void)argc;
    return check_condition(argv[0], "within", err);
}

enum mk_status cmd_check_faults(struct cmd_known *known, int argc, char **argv,
                                struct mk_error *err)
{
    struct mk_fault_script script;
    (void)known, (void)argc;
    if (strlen(argv[0]) >= SESSION_PATH)
        return mk_error_set(err, MK_ERR_RANGE, "the fault script is too long: put it into a file");
    /* Which joints there are is the next setup's affair. */
    return mk_fault_script_read(argv[0], MK_MAX_JOINTS, &script, err);
}

/* --- what the setup makes of it ----------------------------------------------------------- */

/* *setup NULL: not known. */
static enum mk_status find_setup(const struct cmd_known *known, const struct mk_ctrl_ops **setup,
                                 struct mk_error *err)
{
    *setup = known ? known->setup : NULL;
    return !known || known->have_setup ? MK_OK : cmd_no_setup(err);
}

static enum mk_status check_rig(const struct cmd_known *known, const struct mk_ctrl_ops *setup,
                                struct mk_error *err)
{
    enum mk_plant_kind kind;
    const struct mk_plant_info *rig = known->have_nominal ? known->nominal : known->model;
    enum mk_status st = known->have_model ? MK_OK : session_own_rig(setup, &kind, err);
    return st == MK_OK && rig ? mk_ctrl_check_rig(setup, rig->kind, err) : st;
}

enum mk_status cmd_check_setup(struct cmd_known *known, int argc, char **argv, struct mk_error *err)
{
    const struct mk_ctrl_ops *setup;
    (void)argc;
    enum mk_status st = session_find_setup(argv[0], &setup, err);
    if (!known)
        return st;
    known->have_setup = true;
    known->setup = setup;
    known->running = false;
    return st == MK_OK ? check_rig(known, setup, err) : st;
}

enum mk_status cmd_check_gains(struct cmd_known *known, int argc, char **argv, struct mk_error *err)
{
    double value[MK_CTRL_MAX_PARAMS];
    const struct mk_ctrl_ops *setup;
    for (int i = 0; i < argc; i++)
        if (cmd_number(argv[i], &value[i], err) != MK_OK)
            return MK_ERR_PARSE;
    enum mk_status st = find_setup(known, &setup, err);
    return st == MK_OK && setup ? cmd_read_gains(setup, argc, argv, value, err) : st;
}

enum mk_status cmd_check_set(struct cmd_known *known, int argc, char **argv, struct mk_error *err)
{
    double value[MK_CTRL_MAX_PARAMS];
    const struct mk_ctrl_ops *setup;
    (void)argc;
    enum mk_status st = cmd_number(argv[1], &value[0], err);
    if (st == MK_OK)
        st = find_setup(known, &setup, err);
    return st == MK_OK && setup ? cmd_read_set(setup, argv, value, err) : st;
}

enum mk_status cmd_check_limit(struct cmd_known *known, int argc, char **argv, struct mk_error *err)
{
    struct mk_safety_limits limits;
    const struct mk_ctrl_ops *setup;
    double value, *at;
    (void)argc;
    enum mk_status st = cmd_find_limit(&limits, argv[0], &at, err);
    if (st == MK_OK)
        st = cmd_number(argv[1], &value, err);
    if (st == MK_OK)
        st = cmd_check_limit_value(argv[0], value, NULL, err);
    return st == MK_OK ? find_setup(known, &setup, err) : st;
}

enum mk_status cmd_check_show(struct cmd_known *known, int argc, char **argv, struct mk_error *err)
{
    const struct mk_ctrl_ops *setup;
    (void)argc;
    if (strcmp(argv[0], "gains") == 0 || strcmp(argv[0], "limits") == 0 ||
        strcmp(argv[0], "stats") == 0)
        return find_setup(known, &setup, err);
    return mk_error_set(err, MK_ERR_PARSE, "expected gains, limits or stats, not '%s'", argv[0]);
}

enum mk_status cmd_check_start(struct cmd_known *known, int argc, char **argv, struct mk_error *err)
{
    const struct mk_ctrl_ops *setup;
    (void)argc, (void)argv;
    if (known) {
        known->may_write_logs = known->running = true;
        known->run_s = 0.0;
    }
    return find_setup(known, &setup, err);
}

enum mk_status cmd_check_halt(struct cmd_known *known, int argc, char **argv, struct mk_error *err)
{
    (void)argc, (void)argv, (void)err;
    if (known)
        known->running = false;
    return MK_OK;
}

/* --- files ------------------------------------------------------------------------------- */

enum mk_status cmd_check_writes_model(struct cmd_known *known, int argc, char **argv,
                                      struct mk_error *err)
{
    (void)argc, (void)argv, (void)err;
    if (known)
        known->may_write_models = true;
    return MK_OK;
}

/* A model whose rig is not known yet: *rig NULL. */
static enum mk_status read_rig(const struct cmd_known *known, const char *name,
                               const struct mk_plant_info **rig, struct mk_error *err)
{
    char path[SESSION_PATH];
    struct mk_model model;
    *rig = NULL;
    if (known->may_write_models)
        return MK_OK;
    enum mk_status st =
        mk_model_read(session_beside(known->folder, name, path, sizeof path), &model, err);
    if (st == MK_OK)
        *rig = mk_plant(model.plant);
    return st;
}

enum mk_status cmd_check_model(struct cmd_known *known, int argc, char **argv, struct mk_error *err)
{
    (void)argc;
    if (!known || known->keep_model)
        return MK_OK;
    known->have_model = true;
    return read_rig(known, argv[0], &known->model, err);
}

enum mk_status cmd_check_believe(struct cmd_known *known, int argc, char **argv,
                                 struct mk_error *err)
{
    (void)argc;
    if (!known)
        return MK_OK;
    known->have_nominal = true;
    return read_rig(known, argv[0], &known->nominal, err);
}

enum mk_status cmd_check_swingup(struct cmd_known *known, int argc, char **argv,
                                 struct mk_error *err)
{
    char path[SESSION_PATH];
    struct mk_swingup *read;
    (void)argc;
    if (!known || strcmp(argv[0], "energy") == 0)
        return MK_OK;
    session_beside(known->folder, argv[0], path, sizeof path);
    enum mk_status st = mk_swingup_read(path, &read, err);
    mk_swingup_free(read);
    return st;
}

enum mk_status cmd_check_signal(struct cmd_known *known, int argc, char **argv,
                                struct mk_error *err)
{
    struct mk_signal *made;
    char found[SESSION_PATH + 1];
    (void)argc;
    enum mk_status st = session_takes_signal(known ? known->setup : NULL, err);
    if (st != MK_OK)
        return st;
    bool in_file = argv[0][strspn(argv[0], " \t")] == '@';
    if (known)
        known->signal[0] = '\0';
    if (in_file && (!known || known->may_write_logs))
        return MK_OK; /* it may not exist yet */
    const char *folder = known ? known->folder : NULL;
    st = mk_signal_create(session_signal(folder, argv[0], found, sizeof found), &made, err);
    const double now = known && known->running ? known->run_s : 0.0;
    if (st == MK_OK && known)
        st = session_check_signal(made, now, now, err);
    if (st == MK_OK && known)
        snprintf(known->signal, sizeof known->signal, "%s", in_file ? "" : argv[0]);
    mk_signal_destroy(made);
    return st;
}
