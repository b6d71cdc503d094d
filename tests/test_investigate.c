/* Investigations of rigs whose truth is hidden behind the virtual board: what is found, what is not
 * claimed, and what is left after whatever ends the program. */
#include "suites.h"

#include <fcntl.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/wait.h>
#include <unistd.h>

#include "investigate/doubt.h"
#include "investigate/investigate.h"
#include "investigate/nudge.h"
#include "investigate/plan.h"
#include "investigate/runs.h"
#include "investigate/salvage.h"
#include "mechkit/log.h"
#include "mechkit/rig.h"
#include "support/files.h"
#include "support/journals.h"
#include "support/program.h"

/* Small budgets: seconds of a rig that is simulated as fast as it goes. */
#define SHORT "--fast --seconds 5 --tries 100"

static char said[16384];
static struct journal journal;

static const char *model_of(const char *rig)
{
    static char path[4][512];
    static int next;
    next = (next + 1) % 4;
    snprintf(path[next], sizeof path[0], "%s/models/%s.ini", MK_SOURCE_DIR, rig);
    return path[next];
}

/* A rig that is the textbook's but for what `effect` says. */
static const char *hidden(const char *rig, const char *effect)
{
    static char text[4096];
    char *textbook = slurp_file(model_of(rig));
    ck_assert_ptr_nonnull(textbook);
    snprintf(text, sizeof text, "%s\n%s", textbook, effect);
    free(textbook);
    return scratch_text("hidden.ini", text);
}

static const char *new_folder(const char *name)
{
    static char path[512];
    snprintf(path, sizeof path, "%s", scratch(name));
    run_command(NULL, 0, "rm -rf %s", path);
    return path;
}

static int investigate_rig(const char *rig, const char *truth, const char *folder,
                           const char *options)
{
    return run_mechkit(said, sizeof said, "investigate --model %s --rig %s --out %s %s",
                       model_of(rig), truth, folder, options);
}

static char *file_of(const char *folder, const char *name)
{
    char path[700];
    snprintf(path, sizeof path, "%s/%s", folder, name);
    return slurp_file(path);
}

static void ck_assert_says(const char *text)
{
    ck_assert_msg(strstr(said, text) != NULL, "no '%s' in:\n%s", text, said);
}

/* --- what is found ---------------------------------------------------------------------------- */

static const struct {
    const char *rig, *effect, *found;
} cases[] = {
    {"furuta", "[effect.stribeck]\njoint = 2\nlevel = 0.05\nvelocity = 1\n", "stribeck at joint 2"},
    {"inertia-wheel", "[effect.coulomb-asymmetry]\njoint = 1\ndifference = 0.1\n",
     "coulomb-asymmetry at joint 1"},
    {"pendulum", "[effect.input-delay]\ndelay = 0.006\n", "input-delay"},
    /* It pulls where the rig is zeroed, which is then not where the plant hangs. */
    {"pendubot", "[effect.cable-stiffness]\njoint = 1\nstiffness = 0.7\nrest = -1.73\n",
     "cable-stiffness at joint 1"},
    {"furuta", "[effect.encoder-offset]\njoint = 2\noffset = 0.02\n", "encoder-offset at joint 2"},
};

START_TEST(a_hidden_cause_is_found_by_name_and_the_model_passes_a_test)
{
    const char *folder = new_folder("found");
    int code =
        investigate_rig(cases[_i].rig, hidden(cases[_i].rig, cases[_i].effect), folder, SHORT);
    ck_assert_msg(code == 0, "%d: %s", code, said);
    read_journal_of(folder, &journal);
    ck_assert_str_eq(journal.stopped, "validated");
    const struct journal_finding *f = last_finding_of(&journal);
    ck_assert_int_eq(f->causes, 1);
    ck_assert_msg(strncmp(f->cause[0], cases[_i].found, strlen(cases[_i].found)) == 0, "%s",
                  f->cause[0]);
}
END_TEST

/* The model that is left is, but for the comment, the one that was on the disk before the test. */
START_TEST(nothing_is_fitted_to_a_test_that_is_passed_and_its_prediction_is_older_than_it)
{
    const char *folder = new_folder("tested");
    ck_assert_int_eq(
        investigate_rig("inertia-wheel", hidden("inertia-wheel", cases[1].effect), folder, SHORT),
        0);
    read_journal_of(folder, &journal);
    const struct experiment *test = &journal.experiment[journal.count - 1];
    ck_assert_int_eq(test->kind, EXPERIMENT_TEST);
    ck_assert(test->passed);
    char name[64];
    char *before = file_of(folder, journal_name(name, journal.count - 1, "-model.ini"));
    char *after = file_of(folder, "model.ini");
    ck_assert_str_eq(strchr(before, '\n'), strchr(after, '\n'));
    free(before);
    free(after);
    ck_assert_int_le(strcmp(test->planned_at, test->run_at), 0);
    /* In the file system as well, to the nanosecond. */
    run_command(said, sizeof said,
                "cd %s && ls -t --full-time exp-%02d.csv exp-%02d-prediction.csv"
                " | awk 'NR==1{print $NF}'",
                folder, journal.count, journal.count);
    snprintf(name, sizeof name, "exp-%02d.csv\n", journal.count);
    ck_assert_str_eq(said, name);
}
END_TEST

START_TEST(a_rig_that_is_its_model_gets_no_cause_and_the_notebook_says_so)
{
    static const char *const rigs[] = {"inertia-wheel", "pendulum", "furuta"};
    const char *folder = new_folder("clean");
    int code = investigate_rig(rigs[_i], model_of(rigs[_i]), folder, SHORT);
    ck_assert_msg(code == 0, "%d: %s", code, said);
    read_journal_of(folder, &journal);
    ck_assert_int_eq(last_finding_of(&journal)->causes, 0);
    ck_assert_str_eq(last_finding_of(&journal)->verdict, "none");
    char *html = file_of(folder, "notebook.html"), *md = file_of(folder, "notebook.md");
    ck_assert_ptr_nonnull(strstr(html, "no cause is claimed"));
    ck_assert_ptr_nonnull(strstr(html, "<svg"));
    ck_assert_ptr_null(strstr(html, "src=")); /* nothing from outside */
    ck_assert_ptr_nonnull(strstr(md, "## Experiment 2: test"));
    free(html);
    free(md);
}
END_TEST

START_TEST(the_rigs_setups_are_run_with_both_models_once)
{
    const char *folder = new_folder("control");
    ck_assert_int_eq(investigate_rig("inertia-wheel", model_of("inertia-wheel"), folder, SHORT), 0);
    /* What is over goes on with what is asked for besides. */
    ck_assert_int_eq(
        investigate_rig("inertia-wheel", model_of("inertia-wheel"), folder, SHORT " --control"), 0);
    ck_assert_int_eq(run_mechkit(said, sizeof said, "investigate --resume %s --control", folder),
                     0);
    read_journal_of(folder, &journal);
    ck_assert_int_eq(journal.controls, 2);
    for (int i = 0; i < 2; i++) {
        ck_assert_str_eq(journal.control[i].setup, "pi-speed");
        ck_assert(journal.control[i].held);
        ck_assert(journal.control[i].effort > 0.0);
    }
    ck_assert_str_eq(journal.control[0].nominal, "given");
    ck_assert_str_eq(journal.control[1].nominal, "final");
}
END_TEST

START_TEST(the_last_experiment_of_the_budget_is_a_test_and_a_spent_budget_can_be_raised)
{
    const char *folder = new_folder("budget"), *truth = hidden("inertia-wheel", cases[1].effect);
    ck_assert_int_eq(investigate_rig("inertia-wheel", truth, folder, SHORT " --experiments 1"), 1);
    ck_assert_says("The budget of 1 experiments is spent.");
    read_journal_of(folder, &journal);
    ck_assert_str_eq(journal.stopped, "budget");
    ck_assert_int_eq(journal.count, 1);
    ck_assert_int_eq(investigate_rig("inertia-wheel", truth, folder, SHORT " --experiments 2"), 0);
    ck_assert_says("The budget ends with a test.");
    read_journal_of(folder, &journal);
    ck_assert_int_eq(journal.count, 2);
    ck_assert_int_eq(journal.experiment[1].kind, EXPERIMENT_TEST);
    /* By time as well. */
    folder = new_folder("minutes");
    ck_assert_int_eq(investigate_rig("inertia-wheel", truth, folder, SHORT " --minutes 0.05"), 1);
    ck_assert_says("minutes is spent");
}
END_TEST

START_TEST(no_run_leaves_the_limits_that_the_operator_gave)
{
    const char *folder = new_folder("limits");
    ck_assert_int_eq(
        investigate_rig("pendulum", model_of("pendulum"), folder, SHORT " --u-max 2 --q1 -0.8:0.8"),
        0);
    read_journal_of(folder, &journal);
    for (int i = 0; i < journal.count; i++) {
        char name[64], path[700];
        struct mk_log *log;
        snprintf(path, sizeof path, "%s/%s", folder, journal_name(name, i, ".csv"));
        ck_assert_int_eq(mk_log_read(path, &log, NULL), MK_OK);
        const double *q = mk_log_get(log, "q1"), *u = mk_log_get(log, "u");
        double far = 0.0, most = 0.0;
        for (size_t k = 0; k < log->rows; k++) {
            far = fmax(far, fabs(q[k]));
            most = fmax(most, fabs(u[k]));
        }
        ck_assert_double_le(far, 0.8);
        ck_assert_double_le(most, 2.0);
        ck_assert_double_gt(most, 0.2);
        mk_log_free(log);
    }
}
END_TEST

/* --- what ends it ----------------------------------------------------------------------------- */

/* Killed at any time, again and again, it goes on where it was: what was run stays to the byte. */
START_TEST(an_investigation_that_is_killed_goes_on_and_runs_nothing_twice)
{
    const char *folder = new_folder("killed"); /* while it thinks, and while the rig moves */
    char sums[8192] = "", now[8192], command[1200];
    const char *truth = hidden("pendulum", cases[2].effect);
    snprintf(command, sizeof command, "%s investigate --model %s --rig %s --out %s " SHORT,
             MK_TEST_APP, model_of("pendulum"), truth, folder);
    for (int i = 0; i < 8; i++) {
        run_command(NULL, 0, "timeout -s %s %.2f %s", i % 3 == 2 ? "TERM" : "KILL", 0.1 + 0.12 * i,
                    command);
        /* A log that is whole now must stay as it is: its sum is found again. */
        run_command(now, sizeof now,
                    "cd %s 2>/dev/null && for f in exp-??.csv; do [ $(cat $f | wc -l) -gt 2500 ] "
                    "&& cksum $f; done 2>/dev/null; true",
                    folder);
        for (char *line = strtok(sums, "\n"); line; line = strtok(NULL, "\n"))
            ck_assert_msg(strstr(now, line) != NULL, "%s is another now:\n%s", line, now);
        snprintf(sums, sizeof sums, "%s", strstr(now, "exp-") ? now : "");
    }
    int code = run_command(said, sizeof said, "%s", command);
    ck_assert_msg(code == 0, "%d: %s", code, said);
    read_journal_of(folder, &journal);
    ck_assert_str_eq(journal.stopped, "validated");
    /* A delay before the motor and one behind the sensors are rivals: either explains the rig. */
    ck_assert_ptr_nonnull(strstr(last_finding_of(&journal)->cause[0], "-delay"));
    run_command(said, sizeof said, "ls %s/exp-??.csv | wc -l", folder);
    ck_assert_int_eq(atoi(said), journal.count);
    /* Over is over: the same command once more runs nothing. */
    const int count = journal.count;
    ck_assert_int_eq(run_command(said, sizeof said, "%s", command), 0);
    read_journal_of(folder, &journal);
    ck_assert_int_eq(journal.count, count);
}
END_TEST

/* A child that is killed the moment that it tells of this. In simulated time a log is written when
 * 4096 rows wait: ten seconds have more. */
#define LONGER "--fast --seconds 10 --tries 100"
#define LATE 0.9

static const char *killed_at; /* NULL: at a calculation */

static bool kill_at_its_word(void *user, double done, const char *what)
{
    const bool runs = strcmp(what, "running") == 0;
    const bool moves = runs || strstr(what, "rest") || strstr(what, "calm");
    (void)user;
    if (killed_at ? strcmp(what, killed_at) == 0 && (!runs || done > LATE) : !moves)
        raise(SIGKILL);
    return true;
}

static void investigate_until_killed(const char *rig, const char *folder)
{
    const pid_t child = fork();
    ck_assert_int_ge(child, 0);
    if (child == 0) {
        struct investigate_options o;
        investigate_default(&o);
        o.folder = folder;
        o.model = model_of(rig);
        o.settings.fast = true;
        o.settings.tries = 100;
        o.progress = kill_at_its_word;
        snprintf(o.settings.rig, sizeof o.settings.rig, "%s", model_of(rig));
        _exit(investigate(&o, &journal, NULL) == MK_OK ? 0 : 1);
    }
    int status;
    ck_assert_int_eq(waitpid(child, &status, 0), child);
    ck_assert_msg(WIFSIGNALED(status) && WTERMSIG(status) == SIGKILL, "%x", (unsigned)status);
}

/* What it was run from is on the disk before the rig moves: a log says nothing of where an arm was
 * when the counters were zeroed. */
START_TEST(a_run_whose_program_is_killed_is_kept_and_not_run_again)
{
    const char *folder = new_folder("in-a-run");
    killed_at = "running";
    investigate_until_killed("pendulum", folder);
    read_journal_of(folder, &journal);
    ck_assert_int_eq(journal.experiment[0].state, EXPERIMENT_PLANNED);
    ck_assert_str_ne(journal.experiment[0].run_at, "");
    char run_at[JOURNAL_DATE], *before = file_of(folder, "exp-01.csv");
    ck_assert_ptr_nonnull(before);
    snprintf(run_at, sizeof run_at, "%s", journal.experiment[0].run_at);
    int code = investigate_rig("pendulum", model_of("pendulum"), folder, LONGER);
    ck_assert_msg(code == 0, "%d: %s", code, said);
    ck_assert_says("its log is there");
    read_journal_of(folder, &journal);
    ck_assert_str_eq(journal.stopped, "validated");
    ck_assert_int_eq(last_finding_of(&journal)->causes, 0);
    ck_assert_str_eq(journal.experiment[0].run_at, run_at);
    char *after = file_of(folder, "exp-01.csv");
    ck_assert_str_eq(after, before);
    free(before);
    free(after);
}
END_TEST

START_TEST(a_program_that_is_killed_as_it_waits_or_calculates_goes_on)
{
    static const char *const at[] = {"coming to rest", NULL};
    const char *folder = new_folder("in-thought");
    killed_at = at[_i];
    investigate_until_killed("pendulum", folder);
    read_journal_of(folder, &journal);
    int code = investigate_rig("pendulum", model_of("pendulum"), folder, LONGER);
    ck_assert_msg(code == 0, "%d: %s", code, said);
    read_journal_of(folder, &journal);
    ck_assert_str_eq(journal.stopped, "validated");
    ck_assert_int_eq(last_finding_of(&journal)->causes, 0);
    run_command(said, sizeof said, "ls %s/exp-??.csv | wc -l", folder);
    ck_assert_int_eq(atoi(said), journal.count);
}
END_TEST

START_TEST(a_log_that_a_killed_program_left_says_what_ended_its_run)
{
    static const struct {
        const char *note, *fault;
        bool broken_off;
    } left[] = {
        {"# fault: encoder-stuck joint 2 at 0.0030 s\n", "encoder-stuck joint 2 at 0.0030 s",
         false},
        {"# fault: unplugged at 0.0030 s\n", "unplugged at 0.0030 s", true},
        {"", "broken off: the program ended while it ran", true},
    };
    for (size_t i = 0; i < sizeof left / sizeof left[0]; i++) {
        char text[200];
        bool found;
        struct experiment x = {.seconds = 5.0};
        snprintf(text, sizeof text, "# mechkit-log: 1\nt,q1,u\n0,0,0\n0.002,0,1\n%s", left[i].note);
        ck_assert_int_eq(salvage_log(&x, scratch_text("left.csv", text), &found, NULL), MK_OK);
        ck_assert(found);
        ck_assert_str_eq(x.fault, left[i].fault);
        ck_assert(x.broken_off == left[i].broken_off);
        ck_assert_double_eq_tol(x.ran_s, 0.002, 1e-12);
    }
}
END_TEST

/* Nobody knows since when a reading that stood still was wrong. A right model predicts what is left
 * of the log. */
START_TEST(a_log_is_learned_from_up_to_where_its_encoder_stood_still)
{
    static const char *const faults[] = {"at 1700 stuck 2", "at 1700 stuck 1",
                                         "at 1700 stuck 2 for 60"};
    char options[200];
    const char *folder = new_folder("stuck");
    snprintf(options, sizeof options, SHORT " --experiments 1 --faults '%s'", faults[_i]);
    (void)investigate_rig("furuta", model_of("furuta"), folder, options);
    ck_assert_says("stopped: encoder-");
    read_journal_of(folder, &journal);
    const struct experiment *x = &journal.experiment[0];
    ck_assert(x->used && !x->broken_off);
    for (int j = 0; j < 2; j++)
        ck_assert_msg(x->error[j] < 2.0 * x->noise[j], "joint %d: %g of %g", j + 1, x->error[j],
                      x->noise[j]);
    ck_assert_int_eq(last_finding_of(&journal)->causes, 0);
}
END_TEST

START_TEST(a_signal_ends_it_with_the_journal_whole)
{
    const char *folder = new_folder("signal");
    char command[1200];
    snprintf(command, sizeof command, "%s investigate --model %s --out %s --seconds 5 --tries 100",
             MK_TEST_APP, model_of("pendulum"),
             folder); /* by the clock: it is looking at the rig */
    int code = run_command(said, sizeof said, "timeout -s INT 1 %s", command);
    ck_assert_int_ne(code, 0);
    ck_assert_says("ended by a signal, motor off");
    read_journal_of(folder, &journal);
    ck_assert_int_eq(journal.count, 0);
    ck_assert_str_eq(journal.stopped, "");
}
END_TEST

START_TEST(a_board_that_fails_ends_it_with_the_motor_off_and_the_same_command_goes_on)
{
    const char *folder = new_folder("board");
    const char *truth = model_of("inertia-wheel");
    /* Later than the wheel is at rest again after the first push, and within the run. */
    int code = investigate_rig("inertia-wheel", truth, folder, SHORT " --faults 'at 2300 alarm'");
    ck_assert_msg(code == 1, "%d: %s", code, said);
    ck_assert_says("board at 4.60 s; motor off");
    char path[700];
    struct mk_log *log;
    snprintf(path, sizeof path, "%s/exp-01.csv", folder);
    ck_assert_int_eq(mk_log_read(path, &log, NULL), MK_OK);
    ck_assert_uint_gt(log->rows, 2310);
    const double *u = mk_log_get(log, "u");
    for (size_t k = 2303; k < log->rows; k++)
        ck_assert_double_eq(u[k], 0.0);
    mk_log_free(log);
    read_journal_of(folder, &journal);
    ck_assert(journal.experiment[0].broken_off);
    code = investigate_rig("inertia-wheel", truth, folder, SHORT);
    ck_assert_msg(code == 0, "%d: %s", code, said);
    read_journal_of(folder, &journal);
    ck_assert(journal.experiment[0].used); /* four seconds are worth something */
    ck_assert_str_eq(journal.stopped, "validated");
}
END_TEST

START_TEST(a_cable_that_is_pulled_ends_it_and_the_same_command_goes_on)
{
    const char *folder = new_folder("cable");
    ck_assert_int_eq(investigate_rig("inertia-wheel", model_of("inertia-wheel"), folder,
                                     SHORT " --faults 'at 2300 disconnect'"),
                     1);
    ck_assert_says("unplugged");
    int code = investigate_rig("inertia-wheel", model_of("inertia-wheel"), folder, SHORT);
    ck_assert_msg(code == 0, "%d: %s", code, said);
    read_journal_of(folder, &journal);
    ck_assert(journal.experiment[0].broken_off);
    ck_assert_str_eq(journal.stopped, "validated");
}
END_TEST

START_TEST(a_full_disk_ends_it_and_nothing_that_was_written_is_lost)
{
    const char *folder = new_folder("full");
    char command[1200];
    snprintf(command, sizeof command, "%s investigate --model %s --out %s " SHORT, MK_TEST_APP,
             model_of("pendulum"), folder);
    /* Room for predictions and half a log. */
    int code = run_command(said, sizeof said, "bash -c 'ulimit -f 130; %s'", command);
    ck_assert_msg(code == 1, "%d: %s", code, said);
    read_journal_of(folder, &journal);
    ck_assert_int_eq(journal.count, 1);
    ck_assert_str_eq(journal.stopped, "");
    code = run_command(said, sizeof said, "%s", command);
    ck_assert_msg(code == 0, "%d: %s", code, said);
    read_journal_of(folder, &journal);
    ck_assert_str_eq(journal.stopped, "validated");
    ck_assert_int_eq(count_files("full/.*tmp"), 0);
}
END_TEST

/* --- what is refused -------------------------------------------------------------------------- */

START_TEST(a_speed_that_is_held_is_told_in_its_unit)
{
    char given[300], folder[300], path[400];
    struct mk_model model;
    mk_model_default(MK_PLANT_INERTIA_WHEEL, &model);
    ck_assert_int_eq(mk_model_set_linear(&model, 0, true, NULL), MK_OK);
    model.parameter[0] = 2.0; /* kg, N s/m, N */
    model.parameter[1] = 3.0;
    model.parameter[2] = 1.0;
    model.u_to_torque = 1.0;
    snprintf(given, sizeof given, "%s", scratch("slide.ini"));
    snprintf(folder, sizeof folder, "%s", scratch("slide"));
    ck_assert_int_eq(mk_model_write(given, &model, NULL, NULL), MK_OK);
    (void)run_mechkit(said, sizeof said,
                      "investigate --model %s --out %s --fast --control --experiments 1 "
                      "--seconds 3",
                      given, folder);
    ck_assert_msg(strstr(said, "pi-speed, believing the given model: held, off by ") != NULL &&
                      strstr(said, " m/s rms") != NULL && strstr(said, "nan") == NULL,
                  "%s", said);
    snprintf(path, sizeof path, "%s/notebook.html", folder);
    char *book = slurp_file(path);
    ck_assert_ptr_nonnull(strstr(book, " mm/s<"));
    free(book);
}
END_TEST

START_TEST(a_model_of_another_plant_is_refused)
{
    const char *folder = new_folder("other");
    ck_assert_int_eq(investigate_rig("furuta", model_of("pendubot"), folder, SHORT), 3);
    ck_assert_says("is a pendubot, the model that is given a furuta");
}
END_TEST

START_TEST(another_investigation_in_the_folder_is_not_written_over)
{
    const char *folder = new_folder("mine");
    char before[64];
    ck_assert_int_eq(
        investigate_rig("pendulum", model_of("pendulum"), folder, SHORT " --experiments 1"), 1);
    run_command(before, sizeof before, "cksum <%s/journal.json", folder);
    ck_assert_int_eq(investigate_rig("inertia-wheel", hidden("inertia-wheel", ""), folder, SHORT),
                     1);
    ck_assert_says("has an investigation with another model");
    ck_assert_int_eq(investigate_rig("pendulum", model_of("pendulum"), folder, SHORT " --u-max 1"),
                     1);
    ck_assert_says("has an investigation with another limits");
    run_command(said, sizeof said, "cksum <%s/journal.json", folder);
    ck_assert_str_eq(said, before);
    int lock = open(folder, O_RDONLY | O_DIRECTORY);
    ck_assert_int_eq(flock(lock, LOCK_EX | LOCK_NB), 0);
    ck_assert_int_eq(investigate_rig("pendulum", model_of("pendulum"), folder, SHORT), 1);
    ck_assert_says("another process is at this investigation");
    close(lock);
    run_command(NULL, 0, "echo '{}' >%s/journal.json", folder);
    ck_assert_int_eq(investigate_rig("pendulum", model_of("pendulum"), folder, SHORT), 3);
    ck_assert_says("is no journal of an investigation");
}
END_TEST

START_TEST(usage_errors_say_what_would_be_right)
{
    ck_assert_int_eq(run_mechkit(said, sizeof said, "investigate"), 2);
    ck_assert_says("--model and --out, or --resume");
    ck_assert_int_eq(run_mechkit(said, sizeof said, "investigate --resume x --out y"), 2);
    ck_assert_int_eq(run_mechkit(said, sizeof said, "investigate --resume %s", scratch("nowhere")),
                     3);
    ck_assert_int_eq(run_mechkit(said, sizeof said, "investigate --model %s --out %s --board warp",
                                 model_of("pendulum"), scratch("warp")),
                     2);
    ck_assert_says("--board warp: there is no such board");
}
END_TEST

/* --- parts ------------------------------------------------------------------------------------ */

static struct mk_model rig_model;
static struct rig rig;

static void open_rig_that_flickers(const char *name, double counts)
{
    ck_assert_int_eq(mk_model_read(model_of(name), &rig_model, NULL), MK_OK);
    rig = (struct rig){.given = &rig_model, .rate_hz = 500.0, .limits = {.u_max = NAN}};
    for (int j = 0; j < MK_MAX_JOINTS; j++)
        rig.limits.q_min[j] = rig.limits.q_max[j] = rig.limits.v_max[j] = NAN;
    const struct mk_board_config config = {.model = &rig_model, .seed = 1, .count_noise = counts};
    ck_assert_int_eq(rig_open(&rig, mk_board_backend_by_name("virtual"), &config, true, NULL),
                     MK_OK);
}

static void open_rig(const char *name)
{
    open_rig_that_flickers(name, 0.0);
}

START_TEST(a_rig_without_friction_in_its_bearing_is_calmed_by_its_motor)
{
    static const char *const rigs[] = {"reaction-wheel", "cart-pole", "pendubot", "furuta",
                                       "acrobot"};
    struct rig_nudge n;
    struct rig_watch w;
    open_rig(rigs[_i]);
    ck_assert(rig_nudge(rig.board, &rig_model, NULL, &n));
    ck_assert(rig_nudge_is_well(&n));
    rig_let_calm(&rig);
    ck_assert_int_eq(rig_rest(&rig, NULL), MK_OK);
    ck_assert_double_le(rig_seconds(&rig), 120.0);
    /* And rests with the motor off. */
    rig_watch_begin(&w, rig.board, &rig_model);
    double low = 0.0, high = 0.0;
    for (int k = 0; k < 1000; k++) {
        ck_assert(rig_watch_step(&w, 0.0));
        low = fmin(low, w.q[1]);
        high = fmax(high, w.q[1]);
    }
    ck_assert_double_le(high - low, 0.02);
    rig_close(&rig);
}
END_TEST

START_TEST(a_motor_of_a_quarter_of_its_strength_is_wired_right_and_a_dead_one_is_not)
{
    static const char *const rigs[] = {"pendulum", "pendubot", "furuta"};
    for (int dead = 0; dead < 2; dead++) {
        struct rig_nudge n;
        open_rig(rigs[_i]);
        rig_close(&rig);
        struct mk_model weak = rig_model;
        ck_assert_int_eq(mk_model_add_effect(&weak, "saturation", 0, NULL), MK_OK);
        weak.effect[weak.effect_count - 1].value[0] =
            (dead ? 1e-3 : 0.25) * RIG_PUSH_SHARE * rig_model.u_max;
        rig = (struct rig){.given = &rig_model, .rate_hz = 500.0, .limits = {.u_max = NAN}};
        for (int j = 0; j < MK_MAX_JOINTS; j++)
            rig.limits.q_min[j] = rig.limits.q_max[j] = rig.limits.v_max[j] = NAN;
        const struct mk_board_config config = {.model = &weak, .seed = 1};
        ck_assert_int_eq(rig_open(&rig, mk_board_backend_by_name("virtual"), &config, true, NULL),
                         MK_OK);
        ck_assert(rig_nudge(rig.board, &rig_model, NULL, &n));
        ck_assert_msg(rig_nudge_is_well(&n) != dead, "%s: %g for %g", rigs[_i], n.moved[0],
                      n.expected[0]);
        rig_close(&rig);
    }
}
END_TEST

/* Every run zeroes the counters anew; what depends on the place must not differ from log to log. */
START_TEST(a_joint_that_rests_anywhere_is_led_back_and_its_place_is_known)
{
    static const char *const rigs[] = {"cart-pole", "furuta"};
    struct mk_model nominal;
    open_rig(rigs[_i]);
    const double size = mk_model_joint_scale(&rig_model, 0);
    nominal = rig_model;
    ck_assert_int_eq(rig_rest(&rig, NULL), MK_OK);
    rig_let_calm(&rig);
    struct rig_run run = {.nominal = &nominal, .log = scratch("wanders.csv")};
    ck_assert_int_eq(rig_experiment(&rig, &run, "6*pulse(0,0.3)", 1.0, NULL), MK_OK);
    struct mk_log *log;
    ck_assert_int_eq(mk_log_read(run.log, &log, NULL), MK_OK);
    ck_assert_double_gt(fabs(mk_log_get(log, "q1")[log->rows - 1]), 0.4 * size);
    mk_log_free(log);
    ck_assert_int_eq(rig_rest(&rig, NULL), MK_OK);
    ck_assert_double_le(fabs(rig.origin[0]), 0.1 * size);
    /* The truth, as the virtual board knows it. */
    const double *q = mk_rig_state(mk_board_virtual_rig(rig.board));
    ck_assert_double_eq_tol(rig.origin[0], q[0], 0.01 * size);
    rig_close(&rig);
}
END_TEST

/* A reading that is a count off at every zero would be a place that wanders. */
START_TEST(the_place_of_a_wheel_is_known_to_the_count_though_its_readings_flicker)
{
    open_rig_that_flickers("inertia-wheel", 0.4);
    struct mk_model nominal = rig_model;
    const double count = mk_model_count(&rig_model, 0);
    ck_assert_int_eq(rig_rest(&rig, NULL), MK_OK);
    for (int i = 0; i < 12; i++) {
        char log[40];
        snprintf(log, sizeof log, "flicker-%d.csv", i);
        struct rig_run run = {.nominal = &nominal, .log = scratch(log)};
        ck_assert_int_eq(rig_experiment(&rig, &run, "3*sin(9*t)", 0.5, NULL), MK_OK);
        ck_assert_int_eq(rig_rest(&rig, NULL), MK_OK);
        const double *q = mk_rig_state(mk_board_virtual_rig(rig.board));
        ck_assert_double_eq_tol(rig.origin[0] / count, q[0] / count, 0.52);
    }
    rig_close(&rig);
}
END_TEST

/* A rig whose operator gives up in the fifth exchange that drives the motor. */
static struct {
    struct mk_board_ops ops;
    const struct mk_board_ops *own;
    bool drives;
    int driven;
    volatile int cancel;
} watched;

static enum mk_status watched_exchange(struct mk_board *board, double u,
                                       struct mk_board_sample *out)
{
    watched.drives = u != 0.0;
    watched.driven += watched.drives;
    watched.cancel = watched.driven >= 5;
    return watched.own->exchange(board, u, out);
}

static enum mk_status watched_safe_state(struct mk_board *board)
{
    watched.drives = false;
    return watched.own->safe_state(board);
}

static void watch_rig(void)
{
    memset(&watched, 0, sizeof watched);
    watched.own = rig.board->ops;
    watched.ops = *watched.own;
    watched.ops.exchange = watched_exchange;
    watched.ops.safe_state = watched_safe_state;
    rig.board->ops = &watched.ops;
    rig.cancel = &watched.cancel;
}

START_TEST(whatever_is_cancelled_while_the_motor_drives_ends_with_the_motor_off)
{
    enum { CALMING, LEADING, EXPERIMENT };
    struct rig_nudge n;
    open_rig("cart-pole");
    struct rig_run run = {.nominal = &rig_model, .log = scratch("cancelled.csv")};
    if (_i == CALMING) {
        ck_assert(rig_nudge(rig.board, &rig_model, NULL, &n));
    } else {
        ck_assert_int_eq(rig_rest(&rig, NULL), MK_OK);
    }
    rig_let_calm(&rig);
    if (_i == LEADING) {
        ck_assert_int_eq(rig_experiment(&rig, &run, "6*pulse(0,0.3)", 1.0, NULL), MK_OK);
    }
    watch_rig();
    enum mk_status st =
        _i == EXPERIMENT ? rig_experiment(&rig, &run, "6*sin(1)", 1.0, NULL) : rig_rest(&rig, NULL);
    ck_assert_int_eq(st, MK_ERR_INTR);
    ck_assert_int_eq(watched.driven, 5);
    ck_assert(!watched.drives);
    rig.board->ops = watched.own;
    rig_close(&rig);
}
END_TEST

START_TEST(a_test_is_an_input_that_was_not_run_and_keeps_to_the_limits)
{
    struct plan p;
    struct plan_query q = {.model = &rig_model,
                           .spread = 0.03,
                           .seconds = 5.0,
                           .rate_hz = 500.0,
                           .process_noise = 1e-3,
                           .seed = 1,
                           .limits = {1.5, {-1.0, -1.0}, {1.0, 1.0}, {20.0, 20.0}},
                           .noise = {5e-4, 5e-4}};
    ck_assert_int_eq(mk_model_read(model_of("pendulum"), &rig_model, NULL), MK_OK);
    ck_assert(plan_test(&q, &p));
    char first[PLAN_INPUT];
    snprintf(first, sizeof first, "%s", p.input);
    ck_assert(plan_keeps(&q, first));
    q.past[0] = first;
    q.past_s[0] = q.seconds;
    q.past_count = 1;
    struct plan second;
    ck_assert(plan_test(&q, &second));
    ck_assert_str_ne(first, second.input);
    ck_assert_double_lt(second.gain, p.gain); /* what is known is no longer a surprise */
    q.limits.q_max[0] = 1e-3;
    ck_assert(!plan_keeps(&q, first));
    ck_assert(!plan_test(&q, &p));
}
END_TEST

START_TEST(a_light_link_gets_a_first_input_that_keeps_it_from_going_over_the_top)
{
    const char *folder = new_folder("light");
    const char *model = scratch_text("light.ini", "[rig]\nkind = pendulum\n[parameters]\n"
                                                  "p1 = 0.050767207348018636\n"
                                                  "p2 = 8.555625949258838\n"
                                                  "p3 = 0.011703837018760195\n"
                                                  "p4 = 0.41721942106149407\n");
    ck_assert_int_eq(run_mechkit(said, sizeof said,
                                 "investigate --model %s --fast --experiments 1 --out %s", model,
                                 folder),
                     1);
    ck_assert_says("The budget of 1 experiments is spent");
}
END_TEST

/* A wire of an encoder that hangs by a thread for a moment, too short or too slow for a fault; its
 * counter goes on from where it stood. */
START_TEST(readings_that_stood_still_though_the_joint_moved_are_found_and_no_others)
{
    static const struct {
        const char *rig, *input;
    } runs[] = {{"pendulum", "4*sin(5*t)"},
                {"inertia-wheel", "4*sin(5*t)"},
                {"furuta", "4*square(1.1)"},
                {"reaction-wheel", "6*sin(9*t)"},
                {"cart-pole", "3*sin(4*t)"}};
    const char *name = runs[_i].rig, *path = open_loop_log(name, runs[_i].input, 3.0);
    struct mk_log *log;
    ck_assert_int_eq(mk_model_read(model_of(name), &rig_model, NULL), MK_OK);
    ck_assert_int_eq(mk_log_read(path, &log, NULL), MK_OK);
    const int last = mk_model_joints(&rig_model) - 1;
    const size_t rows = log->rows;
    struct doubt doubt = doubt_cut(log, &rig_model);
    ck_assert_msg(doubt.joint == 0 && log->rows == rows, "joint %d at %g", doubt.joint, doubt.at_s);
    for (size_t c = 0; c < log->column_count; c++) {
        double *q = log->columns[c].data;
        if (strcmp(log->columns[c].name, last > 0 ? "q2" : "q1") != 0)
            continue;
        size_t at = 300; /* the first moment from then on that it is fast */
        while (at < 1200 && fabs(q[at] - q[at - 5]) < 40.0 * mk_model_count(&rig_model, last))
            at++;
        const double lost = q[at + 50] - q[at];
        for (size_t k = at; k < rows; k++)
            q[k] = k < at + 50 ? q[at] : q[k] - lost;
        doubt = doubt_cut(log, &rig_model);
        ck_assert_int_eq(doubt.joint, last + 1);
        ck_assert_uint_eq(log->rows, at + 1);
        ck_assert_double_eq(doubt.at_s, mk_log_get(log, "t")[at]);
    }
    mk_log_free(log);
}
END_TEST

Suite *suite_investigate(void)
{
    Suite *s = suite_create("investigate");
    TCase *found = tcase_create("found");
    tcase_set_timeout(found, 240);
    tcase_add_loop_test(found, a_hidden_cause_is_found_by_name_and_the_model_passes_a_test, 1, 2);
    suite_add_tcase(s, found);
    TCase *more = tcase_create("more found");
    tcase_set_timeout(more, 240);
    tcase_set_tags(more, "long");
    tcase_add_test(more,
                   nothing_is_fitted_to_a_test_that_is_passed_and_its_prediction_is_older_than_it);
    tcase_add_test(more, the_rigs_setups_are_run_with_both_models_once);
    tcase_add_test(more, no_run_leaves_the_limits_that_the_operator_gave);
    tcase_add_loop_test(more, a_hidden_cause_is_found_by_name_and_the_model_passes_a_test, 0, 1);
    tcase_add_loop_test(more, a_hidden_cause_is_found_by_name_and_the_model_passes_a_test, 2,
                        (int)(sizeof cases / sizeof cases[0]));
    tcase_add_loop_test(more, a_rig_that_is_its_model_gets_no_cause_and_the_notebook_says_so, 0, 3);
    tcase_add_test(more,
                   the_last_experiment_of_the_budget_is_a_test_and_a_spent_budget_can_be_raised);
    tcase_add_test(more, an_investigation_that_is_killed_goes_on_and_runs_nothing_twice);
    tcase_add_loop_test(more, a_rig_without_friction_in_its_bearing_is_calmed_by_its_motor, 0, 1);
    tcase_add_loop_test(
        more, a_motor_of_a_quarter_of_its_strength_is_wired_right_and_a_dead_one_is_not, 0, 3);
    suite_add_tcase(s, more);
    TCase *ends = tcase_create("ends");
    tcase_set_timeout(ends, 240);
    tcase_add_test(ends, a_run_whose_program_is_killed_is_kept_and_not_run_again);
    tcase_add_loop_test(ends, a_program_that_is_killed_as_it_waits_or_calculates_goes_on, 0, 2);
    tcase_add_test(ends, a_log_that_a_killed_program_left_says_what_ended_its_run);
    tcase_add_loop_test(ends, a_log_is_learned_from_up_to_where_its_encoder_stood_still, 0, 3);
    tcase_add_test(ends, a_signal_ends_it_with_the_journal_whole);
    tcase_add_test(ends,
                   a_board_that_fails_ends_it_with_the_motor_off_and_the_same_command_goes_on);
    tcase_add_test(ends, a_cable_that_is_pulled_ends_it_and_the_same_command_goes_on);
    tcase_add_test(ends, a_full_disk_ends_it_and_nothing_that_was_written_is_lost);
    suite_add_tcase(s, ends);
    TCase *refused = tcase_create("refused");
    tcase_set_timeout(refused, 120);
    tcase_add_test(refused, a_speed_that_is_held_is_told_in_its_unit);
    tcase_add_test(refused, a_model_of_another_plant_is_refused);
    tcase_add_test(refused, another_investigation_in_the_folder_is_not_written_over);
    tcase_add_test(refused, usage_errors_say_what_would_be_right);
    suite_add_tcase(s, refused);
    TCase *parts = tcase_create("parts");
    tcase_set_timeout(parts, 120);
    tcase_add_loop_test(parts, a_rig_without_friction_in_its_bearing_is_calmed_by_its_motor, 1, 5);
    tcase_add_loop_test(parts, a_joint_that_rests_anywhere_is_led_back_and_its_place_is_known, 0,
                        2);
    tcase_add_test(parts, the_place_of_a_wheel_is_known_to_the_count_though_its_readings_flicker);
    tcase_add_loop_test(parts, whatever_is_cancelled_while_the_motor_drives_ends_with_the_motor_off,
                        0, 3);
    tcase_add_loop_test(
        parts, readings_that_stood_still_though_the_joint_moved_are_found_and_no_others, 0, 5);
    tcase_add_test(parts, a_test_is_an_input_that_was_not_run_and_keeps_to_the_limits);
    tcase_add_test(more, a_light_link_gets_a_first_input_that_keeps_it_from_going_over_the_top);
    suite_add_tcase(s, parts);
    return s;
}
