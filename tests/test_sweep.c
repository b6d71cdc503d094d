/* Sweeps: the same result from any number of threads and processes, and after a kill; and what a
 * spec file gets told that is wrong. */
#include "suites.h"

#include <fcntl.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "experiment/basin.h"
#include "experiment/sweep_journal.h"
#include "explain/sweep_explain.h"
#include "support/files.h"
#include "support/program.h"
#include "support/spawn.h"

#define RUNS 24
static const char small[] = "[sweep]\nkind = robustness\nruns = 4\nseed = 7\n"
                            "[rig]\nsetup = reaction-wheel, furuta\n"
                            "[spread]\nparameters = 0, 0.1, 0.4\n"
                            "[trial]\ncatch = 4\nhold = 0.5\n";

static char *sweep_to(const char *spec, const char *csv, const char *options)
{
    char out[8192], path[512];
    snprintf(path, sizeof path, "%s", scratch(csv));
    int code = run_mechkit(out, sizeof out, "sweep %s --out %s %s", spec, path, options);
    ck_assert_msg(code == 0, "%d: %s", code, out);
    char *text = slurp_file(path);
    ck_assert_ptr_nonnull(text);
    return text;
}

START_TEST(one_thread_and_two_write_the_same_file)
{
    const char *spec = scratch_text("s.ini", small);
    char *one = sweep_to(spec, "one.csv", "--threads 1"),
         *two = sweep_to(spec, "two.csv", "--threads 2");
    ck_assert_str_eq(one, two);
    ck_assert_int_eq(count_files("*.journal"), 0);
    int rows = 0;
    for (const char *at = one; (at = strchr(at, '\n')); at++)
        rows++;
    ck_assert_int_eq(rows, 4 + 1 + RUNS); /* metadata, names, runs */
    ck_assert_ptr_nonnull(strstr(one, "run,setup,parameters,catch,hold,seed,outcome,caught_s,"));
    ck_assert_ptr_nonnull(strstr(one, "\n23,furuta,0.4,4,0.5,10,"));
    free(one);
    free(two);
}
END_TEST

static int fields_of(const char *line)
{
    int n = 1;
    for (; *line && *line != '\n'; line++)
        n += *line == ',';
    return n;
}

/* Of a run that was never caught: the first column has nothing in it. */
static const struct {
    const char *spec, *outcome;
} uncaught[] = {
    {"[sweep]\nkind = basin\n[rig]\nsetup = pendubot-mid\n[start]\nq1 = -0.5 : 0.5 : 3\n",
     ",not caught,,"},
    {"[sweep]\nkind = robustness\nruns = 2\n[rig]\nsetup = furuta\n[trial]\ncatch = 0.1\n",
     ",never caught,,"},
};

START_TEST(a_column_with_nothing_in_it_keeps_its_place)
{
    char *csv = sweep_to(scratch_text("u.ini", uncaught[_i].spec), "u.csv", "--threads 1");
    const char *head = strstr(csv, "\nrun,");
    ck_assert_ptr_nonnull(head);
    int rows = 0, columns = fields_of(++head);
    for (const char *at = head; (at = strchr(at, '\n')) && *++at; rows++)
        ck_assert_msg(fields_of(at) == columns, "%d, not %d: %s", fields_of(at), columns, at);
    ck_assert_int_ge(rows, 2);
    ck_assert_msg(strstr(csv, uncaught[_i].outcome), "%s", csv);
    free(csv);
}
END_TEST

static int lines_of(const char *path)
{
    char *text = access(path, R_OK) == 0 ? slurp_file(path) : NULL;
    int n = 0;
    for (const char *at = text; at && (at = strchr(at, '\n')); at++)
        n++;
    free(text);
    return n;
}

/* Starts a sweep and sends it a signal once its journal has some results. Returns how it ended. */
static int signal_once(const char *spec, const char *csv, int number, const char *errors)
{
    char journal[600];
    snprintf(journal, sizeof journal, "%s.journal", csv);
    pid_t child = fork();
    ck_assert_int_ge(child, 0);
    if (child == 0) {
        signal(number, SIG_DFL); /* nohup ignores SIGHUP for all that it starts */
        dup2(open(errors, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600), STDERR_FILENO);
        execl(MK_TEST_APP, "mechkit", "sweep", spec, "--out", csv, "--threads", "1", "--quiet",
              (char *)NULL);
        _exit(127);
    }
    for (int i = 0; i < 30000 && lines_of(journal) < 4 && access(csv, F_OK) != 0; i++)
        nanosleep(&(struct timespec){0, 1000000}, NULL);
    kill(child, number);
    int status = 0;
    waitpid(child, &status, 0);
    return status;
}

/* The same, and again where a busy machine let this process sleep until the sweep had ended. */
static int signal_midway(const char *spec, const char *csv, int number, const char *errors)
{
    char journal[600];
    snprintf(journal, sizeof journal, "%s.journal", csv);
    int status = signal_once(spec, csv, number, errors);
    for (int i = 0; i < 5 && access(csv, F_OK) == 0; i++) {
        ck_assert_int_eq(unlink(csv), 0);
        status = signal_once(spec, csv, number, errors);
    }
    ck_assert_int_ge(lines_of(journal), 4);
    ck_assert_int_ne(access(csv, F_OK), 0);
    return status;
}

static void kill_midway(const char *spec, const char *csv)
{
    int status = signal_midway(spec, csv, SIGKILL, "/dev/null");
    ck_assert_msg(WIFSIGNALED(status), "it ended before it was killed");
}

START_TEST(a_signal_stops_a_sweep_which_says_what_is_kept)
{
    static const int numbers[] = {SIGINT, SIGTERM, SIGHUP};
    char csv[512], spec[512], errors[512];
    snprintf(spec, sizeof spec, "%s", scratch_text("s.ini", small));
    snprintf(csv, sizeof csv, "%s", scratch("stopped.csv"));
    snprintf(errors, sizeof errors, "%s", scratch("stopped.err"));
    int status = signal_midway(spec, csv, numbers[_i], errors);
    char *said = slurp_file(errors);
    ck_assert_msg(WIFEXITED(status) && WEXITSTATUS(status) == 1 && strstr(said, "stopped: ") &&
                      strstr(said, "runs are done and kept in"),
                  "%d %s", status, said);
    free(said);
}
END_TEST

START_TEST(a_killed_sweep_goes_on_and_gives_the_same_file)
{
    char killed[512], journal[600], spec[512], out[4096];
    snprintf(spec, sizeof spec, "%s", scratch_text("s.ini", small));
    snprintf(killed, sizeof killed, "%s", scratch("killed.csv"));
    snprintf(journal, sizeof journal, "%s.journal", killed);
    kill_midway(spec, killed);
    FILE *f = fopen(journal, "a"); /* and half a line, as a crash of the machine may leave */
    ck_assert_ptr_nonnull(f);
    fputs("23,0,1.2", f);
    fclose(f);
    ck_assert_int_eq(run_mechkit(out, sizeof out, "sweep %s --out %s --threads 2", spec, killed),
                     0);
    ck_assert_msg(strstr(out, "of them from before"), "%s", out);
    char *whole = sweep_to(spec, "whole.csv", "--threads 1"), *resumed = slurp_file(killed);
    ck_assert_str_eq(whole, resumed);
    free(whole);
    free(resumed);
}
END_TEST

START_TEST(a_full_disk_keeps_what_was_done)
{
    char out[4096], csv[512], spec[512];
    snprintf(spec, sizeof spec, "%s", scratch_text("s.ini", small));
    snprintf(csv, sizeof csv, "%s", scratch("full.csv"));
    int code =
        run_command(out, sizeof out, "ulimit -f 1; " MK_TEST_APP " sweep %s --out %s", spec, csv);
    ck_assert_msg(code == 1, "%d: %s", code, out);
    ck_assert_msg(strstr(out, "full.csv"), "%s", out);
    code = run_mechkit(out, sizeof out, "sweep %s --out %s", spec, csv);
    ck_assert_msg(code == 0 && strstr(out, "of them from before"), "%s", out);
    char *whole = sweep_to(spec, "whole.csv", ""), *resumed = slurp_file(csv);
    ck_assert_str_eq(whole, resumed);
    free(whole);
    free(resumed);
}
END_TEST

/* Not after hours, when it is to be written. */
START_TEST(an_output_that_cannot_be_written_is_refused_before_the_sweep)
{
    char out[4096], folder[512], spec[512];
    snprintf(spec, sizeof spec, "%s", scratch_text("s.ini", small));
    snprintf(folder, sizeof folder, "%s", scratch("folder"));
    ck_assert_int_eq(mkdir(folder, 0700), 0);
    int code = run_mechkit(out, sizeof out, "sweep %s --out %s", spec, folder);
    ck_assert_msg(code == 1 && strstr(out, "folder: cannot write: Is a directory"), "%d %s", code,
                  out);
    code = run_mechkit(out, sizeof out, "sweep %s --out %s --plot %s/none/p.svg", spec,
                       scratch("s.csv"), folder);
    ck_assert_msg(code == 1 && strstr(out, "p.svg: cannot write: No such file"), "%d %s", code,
                  out);
    ck_assert_ptr_null(strstr(out, "runs"));
    ck_assert_int_eq(count_files("*.journal") + count_files("*.tmp"), 0);
    char *path = strdup(getenv("PATH"));
    setenv("PATH", "/nowhere", 1);
    struct outcome o =
        MECHKIT("sweep", spec, "--out", scratch("s.csv"), "--plot", scratch("s.svg"));
    setenv("PATH", path, 1);
    free(path);
    ck_assert_msg(o.code == 1 && strstr(o.err, "gnuplot is not installed"), "%d %s", o.code, o.err);
    ck_assert_int_eq(count_files("s.csv*"), 0);
}
END_TEST

/* Only the spec says that this file is read. */
START_TEST(an_output_does_not_replace_a_model_that_the_spec_names)
{
    char out[4096], model[512], spec[512];
    snprintf(model, sizeof model, "%s", scratch("own.ini"));
    ck_assert_int_eq(run_command(NULL, 0, "cp %s/models/furuta.ini %s", MK_SOURCE_DIR, model), 0);
    char *before = slurp_file(model);
    snprintf(spec, sizeof spec, "%s",
             scratch_text("own-model.ini", "[sweep]\nkind = basin\n[rig]\nsetup = furuta\n"
                                           "model = own.ini\n[start]\nq2 = 0\n"));
    int code = run_mechkit(out, sizeof out, "sweep %s --out %s", spec, model);
    ck_assert_msg(code == 2 && strstr(out, "own.ini: that is a model of the sweep"), "%d %s", code,
                  out);
    char *after = slurp_file(model);
    ck_assert_str_eq(before, after);
    free(before);
    free(after);
}
END_TEST

START_TEST(processes_under_mpirun_write_the_same_file)
{
    char out[4096];
    const char *spec = scratch_text("s.ini", small);
    if (!have_program("mpirun", "sweeps over processes"))
        return;
    if (run_command(out, sizeof out, "ldd " MK_TEST_APP " | grep -q libmpi") != 0) {
        fprintf(stderr, "skipped: sweeps over processes (built without MPI)\n");
        return;
    }
    char csv[512];
    snprintf(csv, sizeof csv, "%s", scratch("ranks.csv"));
    int code = run_command(out, sizeof out,
                           "mpirun --allow-run-as-root --oversubscribe -n 3 " MK_TEST_APP
                           " sweep %s --out %s --threads 1",
                           spec, csv);
    ck_assert_msg(code == 0 && strstr(out, "each of 3 processes"), "%d: %s", code, out);
    char *ranks = slurp_file(csv), *one = sweep_to(spec, "one.csv", "");
    ck_assert_str_eq(ranks, one);
    free(ranks);
    free(one);
}
END_TEST

START_TEST(two_processes_do_not_write_one_journal)
{
    struct sweep s;
    struct sweep_journal first, second;
    struct mk_error err = MK_ERROR_INIT;
    ck_assert_int_eq(sweep_read(scratch_text("s.ini", small), &s, &err), MK_OK);
    ck_assert_int_eq(sweep_journal_open(&first, &s, scratch("busy.csv"), &err), MK_OK);
    ck_assert_int_eq(sweep_journal_open(&second, &s, scratch("busy.csv"), &err), MK_ERR_BUSY);
    sweep_journal_close(&second, false);
    sweep_journal_close(&first, true);
    sweep_free(&s);
}
END_TEST

START_TEST(a_journal_of_another_sweep_is_refused)
{
    struct sweep a, b;
    struct sweep_journal j;
    struct mk_error err = MK_ERROR_INIT;
    ck_assert_int_eq(sweep_read(scratch_text("a.ini", small), &a, &err), MK_OK);
    ck_assert_int_eq(sweep_read(scratch_text("b.ini", "[sweep]\nkind = robustness\nruns = 4\n"
                                                      "[rig]\nsetup = furuta\n"),
                                &b, &err),
                     MK_OK);
    ck_assert(a.fingerprint != b.fingerprint);
    ck_assert_int_eq(sweep_journal_open(&j, &a, scratch("x.csv"), &err), MK_OK);
    ck_assert_int_eq(sweep_journal_add(&j, 3, 0, "1,2,3,4,5", &err), MK_OK);
    sweep_journal_close(&j, false);
    ck_assert_int_eq(sweep_journal_open(&j, &b, scratch("x.csv"), &err), MK_ERR_STATE);
    ck_assert_ptr_nonnull(strstr(err.message, "another sweep"));
    sweep_journal_close(&j, false);
    ck_assert_int_eq(sweep_journal_open(&j, &a, scratch("x.csv"), &err), MK_OK);
    ck_assert_uint_eq(j.done, 1);
    ck_assert_str_eq(j.result[3].text, "1,2,3,4,5");
    sweep_journal_close(&j, true);
    sweep_free(&a);
    sweep_free(&b);
}
END_TEST

/* Whatever somebody else has under the name that the journal would have. */
START_TEST(a_journal_of_models_with_another_spread_is_refused)
{
    struct mk_error err = MK_ERROR_INIT;
    struct mk_model model;
    struct sweep a, b;
    char spec[300];
    mk_model_default(MK_PLANT_FURUTA, &model);
    ck_assert_int_eq(mk_model_add_effect(&model, "encoder-offset", 2, NULL), MK_OK);
    snprintf(spec, sizeof spec, "%s",
             scratch_text("spread.ini", "[sweep]\nkind = robustness\n"
                                        "[rig]\nsetup = furuta\nmodel = logs-own.ini\n"));
    model.effect[0].spread[0] = 0.01;
    ck_assert_int_eq(mk_model_write(scratch("logs-own.ini"), &model, NULL, &err), MK_OK);
    ck_assert_msg(sweep_read(spec, &a, &err) == MK_OK, "%s", err.message);
    model.effect[0].spread[0] = 0.02;
    ck_assert_int_eq(mk_model_write(scratch("logs-own.ini"), &model, NULL, &err), MK_OK);
    ck_assert_msg(sweep_read(spec, &b, &err) == MK_OK, "%s", err.message);
    ck_assert(a.fingerprint != b.fingerprint);
    sweep_free(&a);
    sweep_free(&b);
}
END_TEST

START_TEST(a_file_that_is_no_journal_is_left_alone)
{
    static const char *const foreign[] = {"Dear diary,\ntoday nothing fell over.\n",
                                          "no line",
                                          "\n",
                                          "# mechkit",
                                          "# mechkit-sweep-journal: 2 0123456789abcdef 24\n",
                                          "\n# mechkit-sweep-journal: 1"};
    char out[4096], spec[512], csv[512], journal[600];
    snprintf(spec, sizeof spec, "%s", scratch_text("s.ini", small));
    snprintf(csv, sizeof csv, "%s", scratch("theirs.csv"));
    snprintf(journal, sizeof journal, "%s.journal", csv);
    for (size_t i = 0; i < sizeof foreign / sizeof foreign[0]; i++) {
        scratch_text("theirs.csv.journal", foreign[i]);
        int code = run_mechkit(out, sizeof out, "sweep %s --out %s", spec, csv);
        bool prefix = strcmp(foreign[i], "# mechkit") == 0; /* as a kill would leave of ours */
        ck_assert_msg(code == (prefix ? 0 : 1), "%s: %d: %s", foreign[i], code, out);
        if (prefix)
            continue;
        ck_assert_msg(strstr(out, "theirs.csv.journal:1: ") &&
                          strstr(out, i == 4 ? "another sweep" : "is no journal"),
                      "%s", out);
        char *left = slurp_file(journal);
        ck_assert_str_eq(left, foreign[i]);
        free(left);
    }
    ck_assert_int_eq(unlink(journal), 0);
    ck_assert_int_eq(mkfifo(journal, 0600), 0);
    int code = run_mechkit(out, sizeof out, "sweep %s --out %s", spec, csv);
    ck_assert_msg(code == 1 && strstr(out, "no file that a sweep"), "%d: %s", code, out);
    ck_assert_int_eq(unlink(journal), 0);
}
END_TEST

/* As a program wrote it that left empty columns out. */
START_TEST(a_journal_whose_rows_lack_a_column_is_refused)
{
    struct sweep s;
    struct sweep_journal j;
    struct mk_error err = MK_ERROR_INIT;
    ck_assert_int_eq(sweep_read(scratch_text("s.ini", small), &s, &err), MK_OK);
    for (int i = 0; i < 2; i++) {
        const char *row = i ? "1,2,3,4,5,6" : "1,2,3,4";
        ck_assert_int_eq(sweep_journal_open(&j, &s, scratch("few.csv"), &err), MK_OK);
        ck_assert_int_eq(sweep_journal_add(&j, 3, 1, row, &err), MK_OK);
        sweep_journal_close(&j, false);
        ck_assert_int_eq(sweep_journal_open(&j, &s, scratch("few.csv"), &err), MK_ERR_PARSE);
        ck_assert_int_eq(err.line, 2);
        sweep_journal_close(&j, true);
    }
    sweep_free(&s);
}
END_TEST

/* Every byte of it by itself; the file of before is left as it is, and is good without the line. */
START_TEST(a_journal_with_a_wrong_byte_is_refused)
{
    struct sweep s;
    struct sweep_journal j;
    struct mk_error err = MK_ERROR_INIT;
    ck_assert_int_eq(sweep_read(scratch_text("s.ini", small), &s, &err), MK_OK);
    const char *csv = scratch("flipped.csv");
    ck_assert_int_eq(sweep_journal_open(&j, &s, csv, &err), MK_OK);
    const size_t heading = j.size;
    ck_assert_int_eq(sweep_journal_add(&j, 3, 0, "1.25,2,3,4,5", &err), MK_OK);
    const size_t size = j.size;
    ck_assert_int_eq(sweep_journal_add(&j, 4, 0, "1.25,2,3,4,5", &err), MK_OK);
    char path[sizeof j.path];
    snprintf(path, sizeof path, "%s", j.path);
    sweep_journal_close(&j, false);
    int fd = open(path, O_RDWR | O_CLOEXEC);
    ck_assert_int_ge(fd, 0);
    for (size_t at = heading; at < size; at++) {
        char was, is;
        ck_assert_int_eq(pread(fd, &was, 1, (off_t)at), 1);
        is = (char)(was ^ 1);
        ck_assert_int_eq(pwrite(fd, &is, 1, (off_t)at), 1);
        ck_assert_int_eq(sweep_journal_open(&j, &s, csv, &err), MK_ERR_PARSE);
        ck_assert_int_eq(err.line, 2);
        ck_assert_msg(strstr(err.message, "damaged"), "%s", err.message);
        sweep_journal_close(&j, false);
        ck_assert_int_eq(pwrite(fd, &was, 1, (off_t)at), 1);
    }
    close(fd);
    ck_assert_int_eq(sweep_journal_open(&j, &s, csv, &err), MK_OK);
    ck_assert_uint_eq(j.done, 2);
    sweep_journal_close(&j, true);
    sweep_free(&s);
}
END_TEST

/* Zeros, as a crash of the machine may leave where a line was being written, and lines after them.
 */
START_TEST(a_journal_with_a_hole_is_refused_and_one_that_ends_in_zeros_goes_on)
{
    struct sweep s;
    struct sweep_journal j;
    struct mk_error err = MK_ERROR_INIT;
    static const char zeros[20];
    ck_assert_int_eq(sweep_read(scratch_text("s.ini", small), &s, &err), MK_OK);
    ck_assert_int_eq(sweep_journal_open(&j, &s, scratch("hole.csv"), &err), MK_OK);
    ck_assert_int_eq(sweep_journal_add(&j, 3, 0, "1,2,3,4,5", &err), MK_OK);
    size_t size = j.size;
    ck_assert_int_eq(pwrite(j.fd, zeros, sizeof zeros, 0), sizeof zeros); /* at the end: O_APPEND */
    sweep_journal_close(&j, false);
    ck_assert_int_eq(sweep_journal_open(&j, &s, scratch("hole.csv"), &err), MK_OK);
    ck_assert_uint_eq(j.done, 1);
    ck_assert_uint_eq(j.size, size);
    ck_assert_int_eq(pwrite(j.fd, zeros, sizeof zeros, 0), sizeof zeros);
    ck_assert_int_eq(sweep_journal_add(&j, 4, 0, "1,2,3,4,5", &err), MK_OK);
    sweep_journal_close(&j, false);
    ck_assert_int_eq(sweep_journal_open(&j, &s, scratch("hole.csv"), &err), MK_ERR_PARSE);
    ck_assert_int_eq(err.line, 3);
    sweep_journal_close(&j, false);
    sweep_free(&s);
}
END_TEST

START_TEST(every_combination_has_its_runs_and_points_share_their_draws)
{
    struct sweep s;
    struct mk_error err = MK_ERROR_INIT;
    ck_assert_int_eq(sweep_read(scratch_text("s.ini", "[sweep]\nkind = basin\nruns = 3\nseed = 5\n"
                                                      "[rig]\nsetup = furuta\n[start]\n"
                                                      "q1 = -1 : 1 : 5\nv1 = 1 : 100 : 3 log\n"),
                                &s, &err),
                     MK_OK);
    ck_assert_uint_eq(s.points, 15);
    ck_assert_uint_eq(s.total, 45);
    size_t run = (3 * 3 + 2) * 3 + 1; /* the fourth of q1, the third of v1, the second run */
    ck_assert_double_eq(sweep_number(&s, run, "start.q1", NAN), 0.5);
    ck_assert_double_eq_tol(sweep_number(&s, run, "start.v1", NAN), 100.0, 1e-12);
    ck_assert_double_eq_tol(sweep_number(&s, run - 3, "start.v1", NAN), 10.0, 1e-12);
    ck_assert_double_eq(sweep_number(&s, run, "start.q2", 0.25), 0.25);
    ck_assert_uint_eq(sweep_seed(&s, run), 6);
    ck_assert_uint_eq(sweep_seed(&s, 1), 6);
    sweep_free(&s);
}
END_TEST

#define HEAD "[sweep]\nkind = robustness\n[rig]\nsetup = furuta\n"
static const struct {
    const char *spec, *says;
} bad[] = {
    {"[rig]\nsetup = furuta\n", "bad.ini: [sweep] kind is missing: robustness, basin or explain"},
    {"[sweep]\nkind = magic\n", "bad.ini:2: kind = 'magic': expected robustness, basin or explain"},
    {"[sweep]\nkind = robustness\n", "[rig] setup is missing"},
    {"[sweep]\nkind = robustness\nruns = 1.5\n",
     "bad.ini:3: runs = '1.5': expected a whole number"},
    {"[sweep]\nkind = robustness\nruns = 3e47\n",
     "bad.ini:3: runs = '3e47': expected a whole number"},
    {"[sweep]\nkind = robustness\n[rig]\nsetup = pi-speed\n",
     "bad.ini:4: rig.setup: 'pi-speed' is no setup that balances: expected"},
    {HEAD "[spread]\nparameters = 0 : 1\n", "bad.ini:6: parameters = '0 : 1': expected a number, "},
    {HEAD "[spread]\nparameters = 0 : 0.5 : 3 log\n", "bad.ini:6: parameters"},
    {HEAD "[spread]\nparameters = 0.1, x\n", "bad.ini:6: parameters = '0.1, x': expected"},
    {HEAD "[spread]\ndelay = 1.5\n", "bad.ini:6: spread.delay: 1.5: expected whole numbers from 0"},
    {HEAD "[spread]\nfriction = -1\n", "bad.ini:6: spread.friction: -1: expected numbers from 0"},
    {"[sweep]\nkind = robustness\nfriction = 1\n[rig]\nsetup = furuta\n",
     "bad.ini:3: unknown key 'friction' in [sweep]; a sweep of robustness has "},
    {HEAD "[spread]\nmass = 1\n", "bad.ini:6: unknown key 'mass' in [spread]; a sweep of"},
    {HEAD "[spread]\nfrction = 0.1\n",
     "bad.ini:6: unknown key 'frction' in [spread]: did you mean friction?; a sweep of"},
    {HEAD "[colour]\n", "bad.ini:5: unknown section [colour]"},
    {HEAD "[colour]\nred = 1\n", "bad.ini:6: unknown key 'red' in unknown section [colour]"},
    {HEAD "[gains]\nk9 = 1\n", "bad.ini:6: gains.k9: setup furuta has no parameter 'k9'"},
    {HEAD "[gains]\nlevel = 0.5, 2\n", "bad.ini:6: gains.level: "},
    {HEAD "[spread]\nfriction = 0:1:1000\nparameters = 0:0.9:1000\n", "more than 1000000 runs"},
    {HEAD "setup = furuta\n", "bad.ini:5: key 'setup' is there twice"},
    {"[sweep]\nkind = explain\n[rig]\nkind = furuta\n", "[effects] is missing"},
    {"[sweep]\nkind = explain\n[rig]\nkind = fan\n", "bad.ini:4: rig.kind: 'fan': expected"},
    {"[sweep]\nkind = explain\n[rig]\nkind = furuta\n[effects]\nmagic = 1\n",
     "bad.ini:6: effects.magic: there is no such effect"},
    {"[sweep]\nkind = explain\n[rig]\nkind = furuta\n[effects]\nviscous = 1\n",
     "bad.ini:6: effects.viscous: effect 'viscous' needs joint"},
    {"[sweep]\nkind = explain\n[rig]\nkind = furuta\n[effects]\nviscous@2 = -1\n",
     "bad.ini:6: effects.viscous@2: -1: coefficient is from 0"},
};

START_TEST(what_is_wrong_in_a_spec_is_told_with_its_line)
{
    struct sweep s;
    struct mk_error err = MK_ERROR_INIT;
    char text[1024];
    enum mk_status st = sweep_read(scratch_text("bad.ini", bad[_i].spec), &s, &err);
    ck_assert_int_ne(st, MK_OK);
    mk_error_format(&err, text, sizeof text);
    ck_assert_msg(strstr(text, bad[_i].says), "%s\nsays: %s", bad[_i].spec, text);
    sweep_free(&s);
}
END_TEST

/* A pipe that nobody writes to would be waited for. */
START_TEST(a_model_of_a_spec_is_a_file)
{
    struct sweep s;
    struct mk_error err = MK_ERROR_INIT;
    char text[1024];
    ck_assert_int_eq(mkfifo(scratch("pipe.ini"), 0600), 0);
    const char *spec = scratch_text("piped.ini", "[sweep]\nkind = robustness\n[rig]\n"
                                                 "setup = furuta\nmodel = pipe.ini\n");
    ck_assert_int_eq(sweep_read(spec, &s, &err), MK_ERR_PARSE);
    mk_error_format(&err, text, sizeof text);
    ck_assert_msg(strstr(text, "pipe.ini: cannot read the model: it is a pipe, not a file"), "%s",
                  text);
    sweep_free(&s);
}
END_TEST

START_TEST(bad_files_and_usage_have_their_exit_codes)
{
    char out[4096];
    ck_assert_int_eq(run_mechkit(out, sizeof out, "sweep %s", scratch_text("b.ini", "[sweep]\n")),
                     3);
    ck_assert_int_eq(run_mechkit(out, sizeof out, "sweep /nowhere/s.ini --out x.csv"), 3);
    ck_assert_int_eq(run_mechkit(out, sizeof out, "sweep"), 2);
    ck_assert_int_eq(run_mechkit(out, sizeof out, "sweep a.ini --threads 0"), 2);
    ck_assert_int_eq(run_mechkit(out, sizeof out, "sweep a.ini --plot x.pdf"), 2);
    ck_assert_int_eq(run_mechkit(out, sizeof out, "sweep a.ini b.ini"), 2);
    int code = run_mechkit(out, sizeof out, "sweep %s --out %s/none/x.csv",
                           scratch_text("s.ini", small), scratch("."));
    ck_assert_msg(code == 1 && strstr(out, "x.csv: cannot write: No such file"), "%d: %s", code,
                  out);
}
END_TEST

START_TEST(a_start_at_the_equilibrium_is_held_and_one_far_off_is_not)
{
    struct trial_spread spread;
    struct mk_model model;
    struct basin_run near, far;
    struct mk_error err = MK_ERROR_INIT;
    const struct mk_ctrl_ops *setup = mk_ctrl_setup_by_name("pendubot-top");
    trial_spread_default(&spread);
    mk_model_default(MK_PLANT_PENDUBOT, &model);
    struct basin_start from = {.off = {0.01, -0.01, 0.0, 0.0}, .within_s = 0.1, .hold_s = 2.0};
    ck_assert_int_eq(basin_run(setup, &model, &spread, &from, 0, &near, &err), MK_OK);
    ck_assert_int_eq(near.end, BASIN_HELD);
    ck_assert_double_lt(near.caught_s, 0.1);
    ck_assert_double_lt(near.tilt_rad, 0.2);
    from.off[0] = 0.9;
    ck_assert_int_eq(basin_run(setup, &model, &spread, &from, 0, &far, &err), MK_OK);
    ck_assert_int_ne(far.end, BASIN_HELD);
}
END_TEST

START_TEST(gains_of_the_spec_are_what_the_controller_has)
{
    struct trial_spread spread;
    struct mk_model model;
    struct trial designed, weak;
    struct mk_error err = MK_ERROR_INIT;
    const struct mk_ctrl_ops *setup = mk_ctrl_setup_by_name("furuta");
    trial_spread_default(&spread);
    mk_model_default(MK_PLANT_FURUTA, &model);
    ck_assert_int_eq(trial_run(setup, &model, &spread, 1, &designed, &err), MK_OK);
    ck_assert_int_eq(designed.end, TRIAL_HELD);
    /* Trusting a hundredth of the region, it catches at another time. */
    spread.change_count = 1;
    spread.change[0] =
        (struct trial_change){.index = mk_ctrl_param_index(setup, "level"), .value = 0.01};
    ck_assert_int_eq(trial_run(setup, &model, &spread, 1, &weak, &err), MK_OK);
    ck_assert(weak.caught_s != designed.caught_s);
    spread.change[0].value = 7.0;
    ck_assert_int_eq(trial_run(setup, &model, &spread, 1, &weak, &err), MK_ERR_RANGE);
}
END_TEST

START_TEST(a_hidden_delay_is_named_and_nothing_where_there_is_none)
{
    const char *spec =
        scratch_text("e.ini", "[sweep]\nkind = explain\nruns = 1\n[rig]\nkind = inertia-wheel\n"
                              "[record]\nseconds = 4\nlogs = 1\n[effects]\nnone = 0\n"
                              "input-delay = 0.01\n");
    char *csv = sweep_to(spec, "e.csv", "");
    ck_assert_msg(strstr(csv, ",none,0,1,right,"), "%s", csv);
    ck_assert_msg(strstr(csv, ",input-delay,0.01,1,right,input-delay,") ||
                      strstr(csv, ",input-delay,0.01,1,tied,"),
                  "%s", csv);
    free(csv);
}
END_TEST

START_TEST(a_picture_is_drawn)
{
    if (!have_program("gnuplot", "pictures of sweeps"))
        return;
    char options[600];
    const char *spec =
        scratch_text("m.ini", "[sweep]\nkind = basin\n[rig]\nsetup = furuta\n[start]\n"
                              "q2 = -0.6 : 0.6 : 6\nv2 = -3 : 3 : 6\n[trial]\nhold = 0.2\n");
    snprintf(options, sizeof options, "--plot %s", scratch("m.svg"));
    free(sweep_to(spec, "m.csv", options));
    char *svg = slurp_file(scratch("m.svg"));
    ck_assert_msg(svg && strstr(svg, "</svg>") && strstr(svg, "<image"), "no map in the picture");
    free(svg);
}
END_TEST

/* Causes beside a rest without a name are named all the same. */
START_TEST(a_cause_beside_a_rest_is_judged_as_one_without)
{
    struct mk_explanation *e = calloc(1, sizeof *e);
    ck_assert_ptr_nonnull(e);
    const struct mk_effect_info *coulomb = mk_effect_by_name("coulomb"),
                                *viscous = mk_effect_by_name("viscous");
    e->cause_count = 2;
    e->cause[0].effect = coulomb, e->cause[0].joint = 2;
    e->cause[1].effect = viscous, e->cause[1].joint = 1;
    const enum mk_verdict named[] = {MK_VERDICT_EFFECT, MK_VERDICT_PARTIAL};
    for (int i = 0; i < 2; i++) {
        e->verdict = named[i];
        ck_assert_int_eq(sweep_judge(e, NULL, 0), SWEEP_WRONG);
        ck_assert_int_eq(sweep_judge(e, coulomb, 2), SWEEP_RIGHT);
        ck_assert_int_eq(sweep_judge(e, viscous, 1), SWEEP_TIED);
        ck_assert_int_eq(sweep_judge(e, coulomb, 1), SWEEP_WRONG);
    }
    e->verdict = MK_VERDICT_UNKNOWN;
    ck_assert_int_eq(sweep_judge(e, NULL, 0), SWEEP_WRONG);
    ck_assert_int_eq(sweep_judge(e, coulomb, 2), SWEEP_UNKNOWN);
    e->verdict = MK_VERDICT_PARAMETERS;
    ck_assert_int_eq(sweep_judge(e, NULL, 0), SWEEP_RIGHT);
    ck_assert_int_eq(sweep_judge(e, coulomb, 2), SWEEP_MISSED);
    free(e);
}
END_TEST

Suite *suite_sweep(void)
{
    Suite *s = suite_create("sweep");
    TCase *t = tcase_create("sweeps");
    tcase_set_timeout(t, 120);
    tcase_add_test(t, one_thread_and_two_write_the_same_file);
    tcase_add_loop_test(t, a_column_with_nothing_in_it_keeps_its_place, 0,
                        (int)(sizeof uncaught / sizeof uncaught[0]));
    suite_add_tcase(s, t);
    t = tcase_create("journals and specs");
    tcase_set_timeout(t, 120);
    tcase_set_tags(t, "one-thread"); /* whose runs are those of the sweeps above */
    tcase_add_test(t, a_cause_beside_a_rest_is_judged_as_one_without);
    tcase_add_test(t, a_full_disk_keeps_what_was_done);
    tcase_add_test(t, two_processes_do_not_write_one_journal);
    tcase_add_test(t, a_journal_of_another_sweep_is_refused);
    tcase_add_test(t, a_journal_of_models_with_another_spread_is_refused);
    tcase_add_test(t, a_file_that_is_no_journal_is_left_alone);
    tcase_add_test(t, a_journal_with_a_wrong_byte_is_refused);
    tcase_add_test(t, a_journal_with_a_hole_is_refused_and_one_that_ends_in_zeros_goes_on);
    tcase_add_test(t, a_journal_whose_rows_lack_a_column_is_refused);
    tcase_add_test(t, every_combination_has_its_runs_and_points_share_their_draws);
    tcase_add_loop_test(t, what_is_wrong_in_a_spec_is_told_with_its_line, 0,
                        (int)(sizeof bad / sizeof bad[0]));
    tcase_add_test(t, a_model_of_a_spec_is_a_file);
    tcase_add_test(t, bad_files_and_usage_have_their_exit_codes);
    tcase_add_test(t, a_start_at_the_equilibrium_is_held_and_one_far_off_is_not);
    tcase_add_test(t, gains_of_the_spec_are_what_the_controller_has);
    suite_add_tcase(s, t);
    t = tcase_create("long sweeps");
    tcase_set_timeout(t, 120);
    tcase_set_tags(t, "long");
    tcase_add_test(t, a_killed_sweep_goes_on_and_gives_the_same_file);
    tcase_add_loop_test(t, a_signal_stops_a_sweep_which_says_what_is_kept, 0, 3);
    tcase_add_test(t, an_output_that_cannot_be_written_is_refused_before_the_sweep);
    tcase_add_test(t, an_output_does_not_replace_a_model_that_the_spec_names);
    tcase_add_test(t, processes_under_mpirun_write_the_same_file);
    tcase_add_test(t, a_hidden_delay_is_named_and_nothing_where_there_is_none);
    tcase_add_test(t, a_picture_is_drawn);
    suite_add_tcase(s, t);
    return s;
}
