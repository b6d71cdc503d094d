#include "console/script/cmd_priv.h"

#include <stdio.h>
#include <string.h>

#include "console/commands/summary.h"
#include "console/script/condition.h"
#include "console/script/fault_text.h"

/* --- choosing ---------------------------------------------------------------------------- */

static enum mk_status do_setup(struct session *s, int argc, char **argv, struct mk_error *err)
{
    (void)argc;
    enum mk_status st = session_setup(s, argv[0], err);
    if (st == MK_OK)
        session_say(s, "setup %s on the %s, board %s", argv[0], mk_plant(s->model.plant)->name,
                    s->backend->name);
    return st;
}

static enum mk_status do_model(struct session *s, int argc, char **argv, struct mk_error *err)
{
    (void)argc;
    if (s->running)
        return mk_error_set(err, MK_ERR_STATE, "halt first");
    if (s->options.keep_model && s->options.model) {
        session_say(s, "model %s is left aside: --model %s", argv[0], s->options.model);
        return MK_OK;
    }
    char path[SESSION_PATH];
    return session_load_model(s, session_find(s, argv[0], path, sizeof path), false, err);
}

static enum mk_status do_believe(struct session *s, int argc, char **argv, struct mk_error *err)
{
    (void)argc;
    if (s->running)
        return mk_error_set(err, MK_ERR_STATE, "halt first");
    char path[SESSION_PATH];
    return session_load_model(s, session_find(s, argv[0], path, sizeof path), true, err);
}

static enum mk_status do_swingup(struct session *s, int argc, char **argv, struct mk_error *err)
{
    (void)argc;
    return session_set_swingup(s, strcmp(argv[0], "energy") == 0 ? NULL : argv[0], err);
}

static enum mk_status do_rate(struct session *s, int argc, char **argv, struct mk_error *err)
{
    (void)argc;
    return cmd_rate(argv[0], &s->options.rate_hz, err);
}

static enum mk_status do_seed(struct session *s, int argc, char **argv, struct mk_error *err)
{
    (void)argc;
    return cmd_seed(argv[0], &s->options.seed, err);
}

static enum mk_status do_faults(struct session *s, int argc, char **argv, struct mk_error *err)
{
    (void)argc, (void)err;
    snprintf(s->faults, sizeof s->faults, "%s", argv[0]);
    if (s->board)
        session_say(s, "faults take effect at the next setup: this one goes on without a change");
    return MK_OK;
}

static enum mk_status do_log(struct session *s, int argc, char **argv, struct mk_error *err)
{
    (void)argc, (void)err;
    s->log_on = strcmp(argv[0], "on") == 0;
    return MK_OK;
}

static enum mk_status do_signal(struct session *s, int argc, char **argv, struct mk_error *err)
{
    (void)argc;
    return session_set_signal(s, argv[0], err);
}

/* --- running ----------------------------------------------------------------------------- */

static enum mk_status do_start(struct session *s, int argc, char **argv, struct mk_error *err)
{
    (void)argc, (void)argv;
    return session_start(s, err);
}

static void say_summary(struct session *s)
{
    struct run_summary r;
    char line[300];
    if (!s->log_path[0] || summarise(s->log_path, &r, NULL) != MK_OK)
        return;
    session_say(s, "%s", summary_line(&r, line, sizeof line));
    if (s->options.show)
        return; /* a screen shows the whole summary */
    for (size_t i = 0; i < r.steps && i < SUMMARY_STEPS; i++)
        session_say(s, "  %s",
                    step_response_line(&r.step[i], summary_speed_unit(&r), line, sizeof line));
}

static enum mk_status do_halt(struct session *s, int argc, char **argv, struct mk_error *err)
{
    (void)argc, (void)argv;
    bool ran = s->running;
    enum mk_status st = session_halt(s, err);
    if (ran && st == MK_OK)
        say_summary(s);
    return st;
}

static enum mk_status need_run(const struct session *s, struct mk_error *err)
{
    return s->running ? MK_OK : mk_error_set(err, MK_ERR_STATE, "nothing runs: start first");
}

/* What may have made samples late: a run that was not granted real time. */
static const char *why_late(enum mk_fault fault, const struct mk_loop_stats *stats)
{
    bool timing = fault == MK_FAULT_OVERRUN || fault == MK_FAULT_WATCHDOG || fault == MK_FAULT_LINK;
    return timing && !stats->realtime ? stats->note : "";
}

static enum mk_status fault_ends_it(struct session *s, enum mk_status st, struct mk_error *err)
{
    if (st == MK_ERR_FAULT) {
        struct mk_loop_snapshot snap;
        mk_loop_get_snapshot(s->loop, &snap);
        char joint[32] = "", value[FAULT_VALUE_SIZE];
        if (snap.fault_joint > 0)
            snprintf(joint, sizeof joint, " (joint %d)", snap.fault_joint);
        struct mk_loop_stats stats;
        mk_loop_get_stats(s->loop, &stats);
        const char *why = why_late(snap.fault, &stats);
        fault_value(&snap, &s->config.limits, &s->model, value, sizeof value);
        mk_error_set(
            err, MK_ERR_FAULT, "fault %s%s at t = %.3f s: %s%s%s; %s%s%s%s%s",
            mk_fault_name(snap.fault), joint, snap.fault_t, mk_fault_text(snap.fault),
            value[0] ? ": " : "", value,
            snap.unconfirmed ? "the board has not confirmed that the motor is off, and its "
                               "watchdog has to see to that"
                             : "the motor is off",
            why[0] ? ". The run had " : "", why, s->log_path[0] ? "; log " : "", s->log_path);
    }
    if (st == MK_ERR_INTR)
        mk_error_set(err, MK_ERR_INTR, "interrupted; the motor is off");
    return st;
}

static enum mk_status do_wait(struct session *s, int argc, char **argv, struct mk_error *err)
{
    double seconds = 0.0;
    (void)argc;
    enum mk_status st = need_run(s, err);
    if (st == MK_OK)
        st = cmd_number(argv[0], &seconds, err);
    if (st == MK_OK)
        st = fault_ends_it(s, session_wait(s, seconds, NULL, NULL, err), err);
    return st;
}

static bool holds(const struct mk_loop_snapshot *snap, void *text)
{
    return condition_holds(text, snap);
}

static bool violated(const struct mk_loop_snapshot *snap, void *text)
{
    return !condition_holds(text, snap);
}

static enum mk_status do_wait_until(struct session *s, int argc, char **argv, struct mk_error *err)
{
    double seconds = 60.0;
    (void)argc;
    enum mk_status st = need_run(s, err);
    if (st != MK_OK)
        return st;
    cmd_split_seconds(argv[0], "within", &seconds);
    st = fault_ends_it(s, session_wait(s, seconds, holds, argv[0], err), err);
    if (st == MK_ERR_TIMEOUT)
        return mk_error_set(err, MK_ERR_EXPECT, "%s: not within %g s", argv[0], seconds);
    return st;
}

static enum mk_status not_met(const struct mk_loop_snapshot *snap, const char *text,
                              struct mk_error *err)
{
    return mk_error_set(err, MK_ERR_EXPECT,
                        "expected %s, but at t = %.3f s: phase %s, q1 %.4g, q2 %.4g, dq1 %.4g, dq2 "
                        "%.4g, u %.4g, fault %s",
                        text, snap->sample.t, mk_phase_name(snap->sample.phase), snap->sample.q[0],
                        snap->sample.q[1], snap->sample.v[0], snap->sample.v[1], snap->sample.u,
                        mk_fault_name(snap->fault));
}

static enum mk_status do_expect(struct session *s, int argc, char **argv, struct mk_error *err)
{
    double seconds = 0.0;
    struct mk_loop_snapshot snap;
    (void)argc;
    memset(&snap, 0, sizeof snap);
    bool lasting = cmd_split_seconds(argv[0], "for", &seconds);
    if (s->loop)
        mk_loop_get_snapshot(s->loop, &snap);
    if (!condition_holds(argv[0], &snap))
        return not_met(&snap, argv[0], err);
    if (!lasting)
        return MK_OK;
    enum mk_status st = need_run(s, err);
    if (st != MK_OK)
        return st;
    st = session_wait(s, seconds, violated, argv[0], err);
    if (st == MK_ERR_TIMEOUT)
        return MK_OK; /* never violated */
    if (st != MK_OK)
        return fault_ends_it(s, st, err);
    mk_loop_get_snapshot(s->loop, &snap);
    return not_met(&snap, argv[0], err);
}

static enum mk_status do_estop(struct session *s, int argc, char **argv, struct mk_error *err)
{
    (void)argc, (void)argv;
    if (s->loop)
        mk_loop_estop(s->loop);
    return session_halt(s, err);
}

static enum mk_status do_ack(struct session *s, int argc, char **argv, struct mk_error *err)
{
    (void)argc, (void)argv;
    if (s->running)
        return mk_error_set(err, MK_ERR_STATE, "halt first");
    if (s->loop)
        mk_loop_acknowledge(s->loop);
    return MK_OK;
}

/* --- results ----------------------------------------------------------------------------- */

static enum mk_status save(struct session *s, const char *name, bool overwrite,
                           struct mk_error *err)
{
    char saved[SESSION_PATH];
    enum mk_status st = session_save(s, name, overwrite, saved, sizeof saved, err);
    if (st == MK_OK)
        session_say(s, "saved %s", saved);
    return st;
}

static enum mk_status do_save(struct session *s, int argc, char **argv, struct mk_error *err)
{
    (void)argc;
    return save(s, argv[0], false, err);
}

static enum mk_status do_save_over(struct session *s, int argc, char **argv, struct mk_error *err)
{
    (void)argc;
    return save(s, argv[0], true, err);
}

static enum mk_status do_echo(struct session *s, int argc, char **argv, struct mk_error *err)
{
    (void)err;
    session_say(s, "%s", argc ? argv[0] : "");
    return MK_OK;
}

static void show_gains(struct session *s)
{
    for (int i = 0; i < s->setup->param_count; i++) {
        const struct mk_ctrl_param *p = &s->setup->param[i];
        session_say(s, "  %-12s %12.6g %-10s %g .. %g  %s%s", p->name, s->value[i],
                    mk_model_unit(&s->model, -1, p->unit), p->min, p->max, p->gain ? "[gain] " : "",
                    p->help);
    }
}

static void show_limits(struct session *s)
{
    const char *name;
    for (int i = 0; (name = cmd_limit_name(i)) != NULL; i++) {
        double *at;
        if (cmd_find_limit(&s->config.limits, name, &at, NULL) == MK_OK)
            session_say(s, "  %-12s %g", name, *at);
    }
}

static void show_stats(struct session *s)
{
    struct mk_loop_stats st;
    if (!s->loop)
        return;
    mk_loop_get_stats(s->loop, &st);
    session_say(s, "  %llu ticks, %llu late, %llu overruns, %llu lost, %llu dropped",
                (unsigned long long)st.ticks, (unsigned long long)st.late,
                (unsigned long long)st.overruns, (unsigned long long)st.lost,
                (unsigned long long)st.dropped);
    session_say(s, "  lateness p50 %.1f p99 %.1f p99.9 %.1f max %.1f us", st.late_p50_us,
                st.late_p99_us, st.late_p999_us, st.late_max_us);
    if (st.note[0])
        session_say(s, "  %s", st.note);
}

static enum mk_status do_show(struct session *s, int argc, char **argv, struct mk_error *err)
{
    (void)argc;
    enum mk_status st = cmd_need_setup(s, err);
    if (st != MK_OK)
        return st;
    if (strcmp(argv[0], "gains") == 0)
        show_gains(s);
    else if (strcmp(argv[0], "limits") == 0)
        show_limits(s);
    else
        show_stats(s);
    return MK_OK;
}

static enum mk_status do_help(struct session *s, int argc, char **argv, struct mk_error *err)
{
    (void)argc, (void)argv, (void)err;
    const struct cmd *c;
    for (int i = 0; (c = cmd_at(i)) != NULL; i++)
        session_say(s, "  %-11s %-24s %s", c->name, c->usage, c->help);
    return MK_OK;
}

static enum mk_status do_quit(struct session *s, int argc, char **argv, struct mk_error *err)
{
    (void)argc, (void)argv;
    return session_halt(s, err);
}

/* --- table ------------------------------------------------------------------------------- */

static const struct cmd commands[] = {
    {"setup", "NAME", "choose what to run: board, controller and limits", 1, 1, false,
     cmd_check_setup, do_setup},
    {"gains", "K1 K2 ...", "the setup's feedback gains, in order; also while it runs", 1,
     MK_CTRL_MAX_PARAMS, false, cmd_check_gains, cmd_do_gains},
    {"set", "NAME VALUE", "a parameter of the setup; also while it runs", 2, 2, false,
     cmd_check_set, cmd_do_set},
    {"ref", "SIGNAL", "reference of the setup, e.g. 50*step(1); also while it runs", 1, 1, true,
     cmd_check_signal, do_signal},
    {"input", "SIGNAL", "command of open-loop, e.g. 1.5*sin(6*t) or @FILE; also while it runs", 1,
     1, true, cmd_check_signal, do_signal},
    {"start", "", "check that the links hang and run; the first start zeroes the counters there", 0,
     0, false, cmd_check_start, do_start},
    {"halt", "", "motor off, log complete", 0, 0, false, cmd_check_halt, do_halt},
    {"wait", "SECONDS", "let it run", 1, 1, false, cmd_check_seconds, do_wait},
    {"wait-until", "COND [within S]", "let it run until a condition holds (60 s at most)", 1, 1,
     true, cmd_check_wait_until, do_wait_until},
    {"expect", "COND [for S]", "fail unless a condition holds (for so long)", 1, 1, true,
     cmd_check_expect, do_expect},
    {"save", "FILE", "name the log of the last run; never overwrites (FILE-2, ...)", 1, 1, false,
     NULL, do_save},
    {"save!", "FILE", "the same, but replaces a log of that name", 1, 1, false, NULL, do_save_over},
    {"estop", "", "motor off at once, fault e-stop", 0, 0, false, cmd_check_halt, do_estop},
    {"ack", "", "acknowledge a latched fault", 0, 0, false, NULL, do_ack},
    {"model", "FILE", "the rig, from the next setup on", 1, 1, false, cmd_check_model, do_model},
    {"believe", "FILE", "what controllers believe, from the next setup on", 1, 1, false,
     cmd_check_believe, do_believe},
    {"swingup", "FILE|energy",
     "how setups swing up: along a trajectory of `mechkit design swingup`, or by energy (default)",
     1, 1, false, cmd_check_swingup, do_swingup},
    {"rate", "HZ", "samples per second, from the next setup on", 1, 1, false, cmd_check_rate,
     do_rate},
    {"log", "on|off", "whether runs are logged; default on", 1, 1, false, cmd_check_on_off, do_log},
    {"limit", "NAME VALUE", "a safety limit, until the next setup", 2, 2, false, cmd_check_limit,
     cmd_do_limit},
    {"seed", "N", "noise of the virtual rig, from the next setup on", 1, 1, false, cmd_check_seed,
     do_seed},
    {"faults", "SCRIPT", "faults of the virtual board (docs/faults.md), from the next setup on", 1,
     1, true, cmd_check_faults, do_faults},
    {"identify", "[MODEL.ini]", "fit what is believed of the rig to the last run", 0, 1, false,
     cmd_check_writes_model, cmd_do_identify},
    {"explain", "[DIR]", "what the model gets wrong about the last run, and why", 0, 1, false,
     cmd_check_writes_model, cmd_do_explain},
    {"compare", "[LOG]", "the last run, or a log, beside the simulation of the model", 0, 1, false,
     NULL, cmd_do_compare},
    {"replay", "[LOG]", "show the last run, or a log, on the screen", 0, 1, false, NULL,
     cmd_do_replay},
    {"record", "FILE|off", "write commands and pauses into a command file", 1, 1, false, NULL,
     cmd_do_record},
    {"show", "gains|limits|stats", "what is set, or how the loop does", 1, 1, false, cmd_check_show,
     do_show},
    {"echo", "TEXT", "say something", 0, 1, true, NULL, do_echo},
    {"help", "", "this list", 0, 0, false, NULL, do_help},
    {"quit", "", "motor off, end", 0, 0, false, NULL, do_quit},
};

const struct cmd *cmd_at(int index)
{
    int count = (int)(sizeof commands / sizeof commands[0]);
    return index >= 0 && index < count ? &commands[index] : NULL;
}

const struct cmd *cmd_by_name(const char *name)
{
    const struct cmd *c;
    for (int i = 0; (c = cmd_at(i)) != NULL; i++)
        if (strcmp(c->name, name) == 0)
            return c;
    return NULL;
}

int cmd_execute(struct session *s, struct cmd_line *line, struct mk_error *err)
{
    if (!line->cmd)
        return MK_OK;
    char text[1200] = "";
    if (s->record)
        cmd_record_line(s, line, text, sizeof text);
    enum mk_status st = line->cmd->exec(s, line->argc, line->argv, err);
    if (s->record && st == MK_OK)
        cmd_record(s, text);
    return st == MK_OK && line->cmd->exec == do_quit ? CMD_QUIT : (int)st;
}
