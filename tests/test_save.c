/* The logs that runs leave: their folder, their names, and that none is lost. */
#include "suites.h"

#include <dirent.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "mechkit/log.h"
#include "support/files.h"
#include "support/program.h"
#include "support/spawn.h"

START_TEST(saving_never_overwrites)
{
    const char *script = scratch_text("v.cmd", "setup pi-speed\nrepeat 3\nstart\nwait 0.1\nhalt\n"
                                               "save v.csv\nsetup pi-speed\nend\n");
    char out[256], path[300];
    snprintf(out, sizeof out, "%s", scratch("v"));
    ck_assert_int_eq(MECHKIT("run", script, "--fast", "--out", out).code, 0);
    const char *names[] = {"v.csv", "v-2.csv", "v-3.csv"};
    for (int i = 0; i < 3; i++) {
        snprintf(path, sizeof path, "%s/%s", out, names[i]);
        ck_assert_msg(access(path, R_OK) == 0, "%s", path);
    }
}
END_TEST

/* A model, a command file, whatever else somebody keeps in the folder of the logs. */
START_TEST(saving_over_a_file_replaces_logs_and_empty_files_only)
{
    char out[256], path[300];
    const char *script =
        scratch_text("keep.cmd", "setup pi-speed\nstart\nwait 0.1\nhalt\nsave! own.txt\n");
    snprintf(out, sizeof out, "%s", scratch("own"));
    ck_assert_int_eq(mkdir(out, 0777), 0);
    snprintf(path, sizeof path, "%s/own.txt", out);
    static const struct {
        const char *content;
        bool replaced;
    } rows[] = {
        {"", true},
        {"[plant]\nkind = pendubot\n", false},
        {"# by hand\n# mechkit-log: 1\nt,q1\n", true},
        {"# by hand\nt,q1\n# mechkit-log: 1\n", false},
        {"setup pi-speed # mechkit-log: 1\n", false},
    };
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
        scratch_text("own/own.txt", rows[i].content);
        struct outcome o = MECHKIT("run", script, "--fast", "--out", out);
        char *now = slurp_file(path);
        ck_assert_ptr_nonnull(now);
        ck_assert_msg((o.code == 0) == rows[i].replaced, "%zu: %d %s", i, o.code, o.err);
        ck_assert_msg((strcmp(now, rows[i].content) == 0) == !rows[i].replaced, "%zu", i);
        ck_assert(rows[i].replaced ||
                  (o.code == 1 && strstr(o.err, "own.txt: this file is no log")));
        free(now);
    }
    /* Nor does a name that means standard output elsewhere make a file. */
    struct outcome o = MECHKIT("run",
                               scratch_text("dash.cmd", "setup pi-speed\nstart\nwait 0.1\n"
                                                        "halt\nsave -\n"),
                               "--fast", "--out", out);
    ck_assert_msg(o.code == 1 && strstr(o.err, "'-' is no name of one"), "%d %s", o.code, o.err);
    ck_assert_int_eq(count_files("own/-"), 0);
}
END_TEST

/* Samples of a signal are a log like any other, and a run may want them again. */
START_TEST(saving_over_the_samples_of_the_signal_is_refused)
{
    static const char samples[] = "# mechkit-log: 1\nt,u\n0,0\n0.1,0.5\n0.2,0\n";
    const char *path = scratch_text("samples.csv", samples);
    char script[600];
    snprintf(script, sizeof script,
             "setup pi-speed\nref @%s\nstart\nwait 0.1\nhalt\nsave! samples.csv\n", path);
    struct outcome o =
        MECHKIT("run", scratch_text("samples.cmd", script), "--fast", "--out", scratch(""));
    char *now = slurp_file(path);
    ck_assert_msg(o.code == 1 && strstr(o.err, "samples.csv: the setup reads this file"), "%d %s",
                  o.code, o.err);
    ck_assert_ptr_nonnull(now);
    ck_assert_str_eq(now, samples);
    free(now);
}
END_TEST

START_TEST(saving_over_a_file_replaces_files_only)
{
    const char *script = scratch_text("over.cmd", "setup pi-speed\nstart\nwait 0.1\nhalt\n"
                                                  "save! over.csv\nsetup pi-speed\nstart\n"
                                                  "wait 0.2\nhalt\nsave! over.csv\n");
    char out[256], path[300], text[400], command[400];
    snprintf(out, sizeof out, "%s", scratch("over"));
    struct outcome o = MECHKIT("run", script, "--fast", "--out", out);
    ck_assert_msg(o.code == 0, "%s", o.err);
    snprintf(path, sizeof path, "%s/over.csv", out);
    struct mk_log *log;
    ck_assert_int_eq(mk_log_read(path, &log, NULL), MK_OK);
    ck_assert_double_gt(mk_log_get(log, "t")[log->rows - 1], 0.15); /* the second run */
    mk_log_free(log);
    /* And nothing else is left: the name replaces that of the run. */
    struct dirent **left;
    int count = scandir(out, &left, NULL, NULL);
    for (int i = 0; i < count; i++)
        free(left[i]);
    free(left);
    ck_assert_int_eq(count, 3); /* with . and .. */
    /* Another spelling of the run's own name is no other file. */
    snprintf(command, sizeof command, "%s",
             scratch_text("own.cmd", "setup pi-speed\nstart\nwait 0.1\nhalt\n"
                                     "save! ./run-001.csv\n"));
    o = MECHKIT("run", command, "--fast", "--out", out);
    ck_assert_msg(o.code == 0, "%s", o.err);
    snprintf(path, sizeof path, "%s/run-001.csv", out);
    ck_assert_int_eq(access(path, R_OK), 0);
    ck_assert_int_eq(unlink(path), 0);
    /* A pipe, a device, a folder is no log: it stays, and so does the run. */
    snprintf(path, sizeof path, "%s/pipe", out);
    ck_assert_int_eq(mkfifo(path, 0600), 0);
    snprintf(text, sizeof text, "setup pi-speed\nstart\nwait 0.1\nhalt\nsave! %s\n", path);
    snprintf(command, sizeof command, "%s", scratch_text("pipe.cmd", text));
    o = MECHKIT("run", command, "--fast", "--out", out);
    ck_assert_msg(o.code == 1 && strstr(o.err, "no regular file"), "%d %s", o.code, o.err);
    struct stat info;
    ck_assert(lstat(path, &info) == 0 && S_ISFIFO(info.st_mode));
    snprintf(path, sizeof path, "%s/run-001.csv", out);
    ck_assert_int_eq(mk_log_read(path, &log, NULL), MK_OK);
    mk_log_free(log);
}
END_TEST

START_TEST(a_name_that_is_no_file_is_refused_and_not_numbered)
{
    static const char *const names[] = {"/dev/full", "/dev/null", "/",    ".",
                                        "..",        "sub",       "sub/", "pipe"};
    char out[256], path[300], text[400], script[300];
    snprintf(out, sizeof out, "%s", scratch("kinds"));
    ck_assert_int_eq(mkdir(out, 0700), 0);
    snprintf(path, sizeof path, "%s/sub", out);
    ck_assert_int_eq(mkdir(path, 0700), 0);
    snprintf(path, sizeof path, "%s/pipe", out);
    ck_assert_int_eq(mkfifo(path, 0600), 0);
    for (size_t i = 0; i < sizeof names / sizeof names[0]; i++) {
        snprintf(text, sizeof text, "setup pi-speed\nstart\nwait 0.1\nhalt\nsave %s\n", names[i]);
        snprintf(script, sizeof script, "%s", scratch_text("kind.cmd", text));
        struct outcome o = MECHKIT("run", script, "--fast", "--out", out);
        ck_assert_msg(o.code == 1 && strstr(o.err, "no regular file"), "%s: %d %s", names[i],
                      o.code, o.err);
    }
    struct dirent **left;
    int count = scandir(out, &left, NULL, NULL);
    for (int i = 0; i < count; i++) {
        ck_assert_msg(!strstr(left[i]->d_name, "-2"), "%s", left[i]->d_name);
        free(left[i]);
    }
    free(left);
}
END_TEST

/* Whether a file begins as gzip does; it must read as a log in any case. */
static bool is_compressed(const char *path)
{
    unsigned char head[2] = {0};
    FILE *f = fopen(path, "rb");
    ck_assert_msg(f && fread(head, 1, 2, f) == 2, "%s", path);
    fclose(f);
    struct mk_log *log;
    struct mk_error err = MK_ERROR_INIT;
    ck_assert_msg(mk_log_read(path, &log, &err) == MK_OK, "%s: %s", path, err.message);
    ck_assert(!log->truncated && log->rows >= 50);
    mk_log_free(log);
    return head[0] == 0x1f && head[1] == 0x8b;
}

START_TEST(the_name_says_whether_the_log_is_compressed)
{
    const char *script =
        scratch_text("z.cmd", "setup pi-speed\nstart\nwait 0.1\nhalt\nsave z.csv.gz\n"
                              "save z.csv\nsave z.csv.gz\nsave! y.csv.gz\nsave! y.csv.gz\n"
                              "save! y.csv\n");
    static const struct {
        const char *name;
        bool compressed;
    } files[] = {{"z.csv.gz", true},
                 {"z-2.csv.gz", true},
                 {"z.csv", false},
                 {"y.csv.gz", true},
                 {"y.csv", false}};
    char out[256], path[300];
    snprintf(out, sizeof out, "%s", scratch("z"));
    struct outcome o = MECHKIT("run", script, "--fast", "--out", out);
    ck_assert_msg(o.code == 0, "%d %s", o.code, o.err);
    for (size_t i = 0; i < sizeof files / sizeof files[0]; i++) {
        snprintf(path, sizeof path, "%s/%s", out, files[i].name);
        ck_assert_msg(is_compressed(path) == files[i].compressed, "%s", path);
    }
    struct dirent **left;
    int count = scandir(out, &left, NULL, NULL);
    for (int i = 0; i < count; i++)
        free(left[i]);
    free(left);
    ck_assert_int_eq(count, 2 + 5); /* nothing else is left */
}
END_TEST

START_TEST(programs_that_share_a_folder_lose_no_log)
{
    enum { PROGRAMS = 3, RUNS = 12 };
    const char *script = scratch_text("shared.cmd", "setup pi-speed\nrepeat 12\nstart\nwait 0.05\n"
                                                    "halt\nsetup pi-speed\nend\n");
    char out[4096], folder[256];
    snprintf(folder, sizeof folder, "%s", scratch("shared"));
    /* A name that leads elsewhere is taken, too. */
    int code = run_command(out, sizeof out,
                           "mkdir -p %s && ln -s %s/elsewhere %s/run-002.csv; "
                           "for i in 1 2 3; do %s run %s --fast --out %s & done; wait",
                           folder, folder, folder, MK_TEST_APP, script, folder);
    ck_assert_int_eq(code, 0);
    int whole = 0;
    for (int n = 1; n <= PROGRAMS * RUNS + 1; n++) {
        char path[300];
        struct mk_log *log;
        snprintf(path, sizeof path, "%s/run-%03d.csv", folder, n);
        if (mk_log_read(path, &log, NULL) != MK_OK)
            continue;
        const double *t = mk_log_get(log, "t");
        whole += log->rows > 10 && t[0] < 1e-9 && t[log->rows - 1] > 0.045;
        mk_log_free(log);
    }
    ck_assert_int_eq(whole, PROGRAMS * RUNS);
    ck_assert_int_ne(access(strcat(folder, "/elsewhere"), F_OK), 0);
}
END_TEST

START_TEST(a_folder_for_logs_that_cannot_be_is_refused_before_anything_moves)
{
    const char *script = scratch_text("fine.cmd", "setup pi-speed\nstart\nwait 0.1\nhalt\n");
    const char *file = scratch_text("taken", "a file\n");
    struct outcome o = MECHKIT("run", script, "--fast", "--out", file);
    ck_assert_int_eq(o.code, 1); /* an output that cannot be made is no bad input */
    ck_assert_ptr_nonnull(strstr(o.err, "taken: cannot write logs there: Not a directory"));
    ck_assert_int_eq(MECHKIT("run", script, "--fast", "--out", "/proc/nobody/runs").code, 1);
    ck_assert_int_eq(MECHKIT("console", "--out", file).code, 1);
}
END_TEST

START_TEST(a_log_can_be_filed_by_what_it_says)
{
    const char *text = "setup furuta\nstart\nwait 0.05\nhalt\nsave f.csv\n";
    char script[256], out[256], path[300];
    struct mk_log *log;
    snprintf(script, sizeof script, "%s", scratch_text("file.cmd", text));
    for (int fast = 0; fast < 2; fast++) {
        snprintf(out, sizeof out, "%s", scratch(fast ? "filed-fast" : "filed"));
        snprintf(path, sizeof path, "%s/f.csv", out);
        setenv("SOURCE_DATE_EPOCH", "86400", 1);
        struct outcome o = MECHKIT("run", script, "--model", MK_SOURCE_DIR "/models/furuta.ini",
                                   "--out", out, fast ? "--fast" : "--quiet");
        /* Without real time a run may trip; its log says where it comes from all the same. */
        if (!fast && o.code != 0)
            continue;
        ck_assert_msg(o.code == 0, "%s", o.err);
        ck_assert_int_eq(mk_log_read(path, &log, NULL), MK_OK);
        ck_assert_str_eq(mk_log_find_meta(log, "date"), "1970-01-02T00:00:00Z");
        ck_assert_str_eq(mk_log_find_meta(log, "model"), MK_SOURCE_DIR "/models/furuta.ini");
        ck_assert_int_eq(strncmp(mk_log_find_meta(log, "model_values"), "furuta p1=", 10), 0);
        ck_assert_int_eq(mk_log_find_meta(log, "host") == NULL, fast);
        mk_log_free(log);
    }
    unsetenv("SOURCE_DATE_EPOCH");
    ck_assert_int_eq(MECHKIT("run", script, "--fast", "--out", out).code, 0);
    strcpy(strstr(path, "f.csv"), "f-2.csv");
    ck_assert_int_eq(mk_log_read(path, &log, NULL), MK_OK);
    ck_assert_ptr_null(mk_log_find_meta(log, "date")); /* byte for byte the same, whenever */
    mk_log_free(log);
}
END_TEST

START_TEST(names_that_are_too_long_are_refused_and_not_cut)
{
    char text[2000], name[600];
    memset(name, 'n', sizeof name);
    name[599] = '\0';
    snprintf(text, sizeof text, "setup pi-speed\nmodel %s\n", name);
    struct outcome o = MECHKIT("run", "--check", scratch_text("long.cmd", text));
    ck_assert_msg(o.code == 3 && strstr(o.err, ":2: model nnn") && strstr(o.err, "599 characters"),
                  "%d %s", o.code, o.err);
    snprintf(text, sizeof text, "setup pi-speed\nstart\nwait 0.1\nhalt\nsave %.500s\n", name);
    o = MECHKIT("run", scratch_text("long.cmd", text), "--fast", "--out", scratch("long"));
    ck_assert_msg(o.code == 1 && strstr(o.err, ":5: save: the name of the log and its folder"),
                  "%d %s", o.code, o.err);
}
END_TEST

START_TEST(the_same_seed_gives_byte_identical_logs)
{
    const char *script = scratch_text("d.cmd", "setup furuta\nstart\nwait 3\nhalt\nsave d.csv\n");
    char a[256], b[256];
    snprintf(a, sizeof a, "%s", scratch("a"));
    snprintf(b, sizeof b, "%s", scratch("b"));
    ck_assert_int_eq(MECHKIT("run", script, "--fast", "--seed", "7", "--out", a).code, 0);
    ck_assert_int_eq(MECHKIT("run", script, "--fast", "--seed", "7", "--out", b).code, 0);
    strcat(a, "/d.csv"), strcat(b, "/d.csv");
    char *x = slurp_file(a), *y = slurp_file(b);
    ck_assert(x && y && strlen(x) > 100000);
    ck_assert_int_eq(strcmp(x, y), 0);
    free(x);
    free(y);
}
END_TEST

START_TEST(a_signal_in_mid_run_leaves_a_complete_log)
{
    const char *script = scratch_text("t.cmd", "setup pi-speed\nstart\nwait 60\n");
    char dir[256], out[256], err[256], log[300];
    snprintf(dir, sizeof dir, "%s", scratch("t"));
    snprintf(out, sizeof out, "%s", scratch("t.out"));
    snprintf(err, sizeof err, "%s", scratch("t.err"));
    snprintf(log, sizeof log, "%s/run-001.csv", dir);
    const char *const argv[] = {"mechkit", "run", script, "--out", dir, NULL};
    pid_t child = spawn(argv, out, err);
    struct stat info = {0};
    for (int i = 0; i < 2000 && (stat(log, &info) != 0 || info.st_size < 20000); i++)
        usleep(10000);
    kill(child, SIGTERM);
    struct outcome o = finish(child, out, err);
    ck_assert_int_eq(o.code, 1);
    ck_assert_ptr_nonnull(strstr(o.err, "motor is off"));
    struct mk_log *read;
    struct mk_error why = MK_ERROR_INIT;
    ck_assert_msg(mk_log_read(log, &read, &why) == MK_OK, "%s", why.message);
    ck_assert(!read->truncated && read->rows > 50);
    mk_log_free(read);
}
END_TEST

/* Starts a script that would go on for hours and sends a signal once its log grows. */
static struct outcome interrupted(const char *lines, int number)
{
    char dir[256], out[256], err[256], log[300], script[256];
    snprintf(script, sizeof script, "%s", scratch_text("i.cmd", lines));
    snprintf(dir, sizeof dir, "%s", scratch("i"));
    snprintf(out, sizeof out, "/dev/null");
    snprintf(err, sizeof err, "%s", scratch("i.err"));
    snprintf(log, sizeof log, "%s/run-001.csv", dir);
    unlink(log);
    const char *const argv[] = {"mechkit", "run", script, "--out", dir, NULL};
    pid_t child = spawn(argv, out, err);
    struct stat info = {0};
    for (int i = 0; i < 2000 && (stat(log, &info) != 0 || info.st_size < 20000); i++)
        usleep(10000);
    kill(child, number);
    alarm(10); /* or the test ends here, and the script goes on */
    struct outcome o = finish(child, out, err);
    alarm(0);
    return o;
}

/* Nothing in the block waits, so no command of it looks whether it is to stop. */
START_TEST(a_signal_ends_a_block_that_does_not_wait)
{
    static const int numbers[] = {SIGINT, SIGTERM, SIGHUP};
    static const char *const bodies[] = {"", "echo x\n", "set kp 0.02\n"};
    char script[200];
    snprintf(script, sizeof script,
             "setup pi-speed\nref 20\nstart\nrepeat 1000000\nrepeat 1000000\n%send\nend\nhalt\n",
             bodies[_i]);
    struct outcome o = interrupted(script, numbers[_i]);
    ck_assert_msg(o.code == 1 && strstr(o.err, "i.cmd:") &&
                      strstr(o.err, "interrupted; the motor is off"),
                  "%d %s", o.code, o.err);
    char log[300];
    snprintf(log, sizeof log, "%s/run-001.csv", scratch("i"));
    struct mk_log *read;
    struct mk_error why = MK_ERROR_INIT;
    ck_assert_msg(mk_log_read(log, &read, &why) == MK_OK, "%s", why.message);
    ck_assert(!read->truncated);
    mk_log_free(read);
}
END_TEST

Suite *suite_save(void)
{
    Suite *s = suite_create("save");
    TCase *t = tcase_create("logs of runs");
    tcase_set_timeout(t, 40);
    tcase_add_test(t, saving_never_overwrites);
    tcase_add_test(t, saving_over_the_samples_of_the_signal_is_refused);
    tcase_add_test(t, saving_over_a_file_replaces_files_only);
    tcase_add_test(t, saving_over_a_file_replaces_logs_and_empty_files_only);
    tcase_add_test(t, a_name_that_is_no_file_is_refused_and_not_numbered);
    tcase_add_test(t, the_name_says_whether_the_log_is_compressed);
    tcase_add_test(t, programs_that_share_a_folder_lose_no_log);
    tcase_add_test(t, a_folder_for_logs_that_cannot_be_is_refused_before_anything_moves);
    tcase_add_test(t, a_log_can_be_filed_by_what_it_says);
    tcase_add_test(t, names_that_are_too_long_are_refused_and_not_cut);
    tcase_add_test(t, the_same_seed_gives_byte_identical_logs);
    tcase_add_test(t, a_signal_in_mid_run_leaves_a_complete_log);
    tcase_add_loop_test(t, a_signal_ends_a_block_that_does_not_wait, 0, 3);
    suite_add_tcase(s, t);
    return s;
}
