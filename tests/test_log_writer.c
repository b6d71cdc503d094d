/* Logs written while a run goes on: whatever ends it, whole lines are there. */
#include "suites.h"

#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include "base/out_file.h"
#include "base/temporary.h"
#include "mechkit/log.h"
#include "support/comma_locale.h"
#include "support/files.h"

static struct mk_log_writer *open_writer(const char *path)
{
    static const char *const columns[] = {"t", "q1", "u"};
    char key[] = "rig", value[] = "pendulum";
    struct mk_log_meta meta[] = {{key, value}};
    struct mk_log_writer *w;
    struct mk_error err = MK_ERROR_INIT;
    ck_assert_msg(mk_log_writer_open(path, false, meta, 1, columns, 3, &w, &err) == MK_OK, "%s",
                  err.message);
    return w;
}

START_TEST(rows_written_during_a_run_are_a_log)
{
    const char *path = scratch("run.csv");
    struct mk_log_writer *w = open_writer(path);
    struct mk_error err = MK_ERROR_INIT;
    for (int i = 0; i < 5000; i++) {
        double row[] = {i * 0.1, i % 7 ? i / 3.0 : (double)NAN, -i};
        ck_assert_int_eq(mk_log_writer_row(w, row), MK_OK);
        if (i == 2500)
            ck_assert_int_eq(mk_log_writer_note(w, "event", "gains\nchanged"), MK_OK);
    }
    ck_assert_int_eq(mk_log_writer_close(w, &err), MK_OK);
    struct mk_log *log;
    ck_assert_msg(mk_log_read(path, &log, &err) == MK_OK, "%s", err.message);
    ck_assert_uint_eq(log->rows, 5000);
    ck_assert_str_eq(mk_log_find_meta(log, "event"), "gains changed");
    ck_assert(mk_log_get(log, "q1")[4] == 4 / 3.0);
    mk_log_free(log);
    static const char *const columns[] = {"t"};
    ck_assert_int_ne(mk_log_writer_open(path, false, NULL, 0, columns, 1, &w, &err), MK_OK);
}
END_TEST

START_TEST(kill_9_leaves_whole_lines)
{
    char path[256];
    snprintf(path, sizeof path, "%s", scratch("killed.csv"));
    int ready[2];
    ck_assert_int_eq(pipe(ready), 0);
    pid_t child = fork();
    if (child == 0) {
        struct mk_log_writer *w = open_writer(path);
        for (long i = 0;; i++) {
            double row[] = {i * 0.001, i / 3.0, i};
            if (mk_log_writer_row(w, row) != MK_OK)
                _exit(1);
            if (i == 20000 && write(ready[1], "x", 1) != 1)
                _exit(1);
        }
    }
    char c;
    ck_assert_int_eq(read(ready[0], &c, 1), 1);
    kill(child, SIGKILL);
    waitpid(child, NULL, 0);
    struct mk_log *log;
    struct mk_error err = MK_ERROR_INIT;
    ck_assert_msg(mk_log_read(path, &log, &err) == MK_OK, "%s", err.message);
    ck_assert_uint_gt(log->rows, 10000);
    for (size_t i = 0; i < log->rows; i++)
        ck_assert(mk_log_get(log, "u")[i] == (double)i);
    mk_log_free(log);
}
END_TEST

START_TEST(a_full_disk_is_reported_and_leaves_whole_lines)
{
    const char *path = scratch("full.csv");
    limit_file_size(300000);
    struct mk_log_writer *w = open_writer(path);
    enum mk_status st = MK_OK;
    for (int i = 0; st == MK_OK && i < 1000000; i++) {
        double row[] = {i * 0.001, i / 3.0, i};
        st = mk_log_writer_row(w, row);
    }
    limit_file_size(0);
    ck_assert_int_eq(st, MK_ERR_NOSPACE);
    struct mk_error err = MK_ERROR_INIT;
    ck_assert_int_eq(mk_log_writer_close(w, &err), MK_ERR_NOSPACE);
    struct mk_log *log;
    ck_assert_msg(mk_log_read(path, &log, &err) == MK_OK, "%s", err.message);
    ck_assert(!log->truncated);
    ck_assert_uint_gt(log->rows, 1000);
    for (size_t i = 0; i < log->rows; i++)
        ck_assert(mk_log_get(log, "u")[i] == (double)i);
    mk_log_free(log);
}
END_TEST

START_TEST(a_full_device_is_reported_once_and_for_all)
{
    static const char *const columns[] = {"t", "q1"};
    struct mk_log_writer *w;
    struct mk_error err = MK_ERROR_INIT;
    ck_assert_int_eq(mk_log_writer_open("/dev/full", true, NULL, 0, columns, 2, &w, &err),
                     MK_ERR_NOSPACE);
    ck_assert_ptr_null(w);
    ck_assert_str_eq(err.file, "/dev/full");

    const char *path = scratch("limit.csv");
    ck_assert_int_eq(mk_log_writer_open(path, false, NULL, 0, columns, 2, &w, &err), MK_OK);
    double row[] = {0, 0.1};
    for (int i = 0; i < 10; i++, row[0]++)
        ck_assert_int_eq(mk_log_writer_row(w, row), MK_OK); /* buffered */
    limit_file_size(44);
    enum mk_status st = mk_log_writer_flush(w, &err);
    limit_file_size(0); /* room again, but a log with a hole would be worse than its end */
    ck_assert_int_eq(st, MK_ERR_NOSPACE);
    ck_assert_str_eq(err.file, path);
    ck_assert_int_eq(mk_log_writer_row(w, row), MK_ERR_NOSPACE);
    ck_assert_int_eq(mk_log_writer_note(w, "event", "late"), MK_ERR_NOSPACE);
    ck_assert_int_eq(mk_log_writer_flush(w, NULL), MK_ERR_NOSPACE);
    ck_assert_int_eq(mk_log_writer_close(w, &err), MK_ERR_NOSPACE);
    char *text = slurp_file(path);
    ck_assert_str_eq(text, "# mechkit-log: 1\nt,q1\n0,0.1\n1,0.1\n2,0.1\n"); /* 40 of 44 bytes */
    free(text);
}
END_TEST

START_TEST(what_is_flushed_is_in_the_file_to_the_letter)
{
    static const char *const columns[] = {"t", "q1", "tick"};
    char key[] = "rig", value[] = "furuta\nor so", version[] = "mechkit-log", one[] = "1";
    struct mk_log_meta meta[] = {{key, value}, {version, one}};
    struct mk_log_writer *w;
    struct mk_error err = MK_ERROR_INIT;
    const char *path = scratch("exact.csv");
    ck_assert_int_eq(mk_log_writer_open(path, false, meta, 2, columns, 3, &w, &err), MK_OK);
    double rows[][3] = {{0, -0.0, 99999}, {0.002, NAN, 100000}, {0.004, 1.0 / 3, 100001}};
    ck_assert_int_eq(mk_log_writer_row(w, rows[0]), MK_OK);
    ck_assert_int_eq(mk_log_writer_note(w, "event", "start"), MK_OK);
    ck_assert_int_eq(mk_log_writer_row(w, rows[1]), MK_OK);
    ck_assert_int_eq(mk_log_writer_flush(w, &err), MK_OK);
    char *text = slurp_file(path);
    ck_assert_str_eq(text, "# rig: furuta or so\n# mechkit-log: 1\nt,q1,tick\n0,-0,99999\n"
                           "# event: start\n0.002,,100000\n");
    free(text);
    ck_assert_int_eq(mk_log_writer_row(w, rows[2]), MK_OK);
    ck_assert_int_eq(mk_log_writer_close(w, &err), MK_OK);
    text = slurp_file(path);
    ck_assert_ptr_nonnull(strstr(text, "\n0.004,0.3333333333333333,100001\n"));
    free(text);
}
END_TEST

START_TEST(an_old_log_is_overwritten_only_when_asked)
{
    static const char *const columns[] = {"t"};
    struct mk_log_writer *w;
    struct mk_error err = MK_ERROR_INIT;
    const char *path = scratch_text("there.csv", "t,q1\n0,1\n");
    ck_assert_int_eq(mk_log_writer_open(path, false, NULL, 0, columns, 1, &w, &err), MK_ERR_IO);
    ck_assert_ptr_nonnull(strstr(err.message, "exists already"));
    char *text = slurp_file(path);
    ck_assert_str_eq(text, "t,q1\n0,1\n");
    free(text);
    ck_assert_int_eq(mk_log_writer_open(path, true, NULL, 0, columns, 1, &w, &err), MK_OK);
    ck_assert_int_eq(mk_log_writer_close(w, &err), MK_OK);
    text = slurp_file(path);
    ck_assert_str_eq(text, "# mechkit-log: 1\nt\n");
    free(text);
    ck_assert_int_eq(mk_log_writer_open(scratch("no/x.csv"), true, NULL, 0, columns, 1, &w, &err),
                     MK_ERR_NOTFOUND);
    ck_assert_int_eq(mk_log_writer_open("/tmp", true, NULL, 0, columns, 1, &w, &err), MK_ERR_IO);
    ck_assert_int_eq(mk_log_writer_close(NULL, NULL), MK_OK);
}
END_TEST

START_TEST(columns_that_could_not_be_read_back_are_refused)
{
    static const char *const bad[][2] = {{"t", "t"},    {"q1", "u"}, {"t", "a,b"},
                                         {"t", "a\nb"}, {"t", ""},   {"#t", "t"}};
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        struct mk_log_writer *w;
        struct mk_error err = MK_ERROR_INIT;
        ck_assert_int_eq(mk_log_writer_open(scratch("bad.csv"), true, NULL, 0, bad[i], 2, &w, &err),
                         MK_ERR_INVALID);
        ck_assert_int_eq(count_files("bad.csv"), 0);
    }
    struct mk_log_writer *w;
    ck_assert_int_eq(mk_log_writer_open(scratch("bad.csv"), true, NULL, 0, NULL, 0, &w, NULL),
                     MK_ERR_INVALID);
}
END_TEST

START_TEST(notes_longer_than_the_buffer_stay_one_line)
{
    const char *path = scratch("note.csv");
    struct mk_log_writer *w = open_writer(path);
    struct mk_error err = MK_ERROR_INIT;
    size_t size = 300000;
    char *note = malloc(size + 1);
    memset(note, 'n', size);
    note[size] = '\0';
    note[size / 2] = '\r';
    double row[] = {1, 2, 3};
    ck_assert_int_eq(mk_log_writer_row(w, row), MK_OK);
    ck_assert_int_eq(mk_log_writer_note(w, "event", note), MK_OK);
    ck_assert_int_eq(mk_log_writer_note(w, "a:b", "x"), MK_ERR_INVALID); /* not a lasting failure */
    row[0] = 2;
    ck_assert_int_eq(mk_log_writer_row(w, row), MK_OK);
    ck_assert_int_eq(mk_log_writer_close(w, &err), MK_OK);
    struct mk_log *log;
    ck_assert_msg(mk_log_read(path, &log, &err) == MK_OK, "%s", err.message);
    note[size / 2] = ' ';
    ck_assert_uint_eq(log->rows, 2);
    ck_assert_str_eq(mk_log_find_meta(log, "event"), note);
    mk_log_free(log);
    free(note);
}
END_TEST

START_TEST(a_locale_with_a_decimal_comma_does_not_matter)
{
    if (!use_comma_locale())
        return;
    const char *path = scratch("comma.csv");
    struct mk_log_writer *w = open_writer(path);
    struct mk_error err = MK_ERROR_INIT;
    double row[] = {0.25, 1234567.5, -0.125};
    ck_assert_int_eq(mk_log_writer_row(w, row), MK_OK);
    ck_assert_int_eq(mk_log_writer_close(w, &err), MK_OK);
    char *text = slurp_file(path);
    ck_assert_ptr_nonnull(strstr(text, "\n0.25,1234567.5,-0.125\n"));
    free(text);
}
END_TEST

/* fsync(2) of everything under test: whether it is called can be seen nowhere else. The next calls
 * fail with these errors, in turn. */
static int synced;
static const int *sync_failure;

int fsync(int fd)
{
    synced++;
    if (sync_failure && *sync_failure) {
        errno = *sync_failure++;
        return -1;
    }
    return (int)syscall(SYS_fsync, fd);
}

/* The whole of it is said where the disk is lost between the last write and the end. */
START_TEST(a_disk_that_fails_at_the_end_is_told)
{
    static const int broken[] = {EIO, 0}, interrupted[] = {EINTR, EINTR, 0};
    static const int none[][2] = {{EINVAL, 0}, {EROFS, 0}, {ENOTSUP, 0}};
    struct mk_error err = MK_ERROR_INIT;
    const char *path = scratch("broken.csv"), *text = scratch("broken.txt");
    struct mk_log_writer *w = open_writer(path);
    sync_failure = broken;
    ck_assert_int_eq(mk_log_writer_close(w, &err), MK_ERR_IO);
    ck_assert_str_eq(err.file, path);
    sync_failure = broken;
    ck_assert_int_eq(mk_out_file_save(text, "all of it", 9, &err), MK_ERR_IO);
    ck_assert_int_ne(access(text, F_OK), 0);
    sync_failure = interrupted; /* by a signal: once more */
    synced = 0;
    ck_assert_int_eq(mk_out_file_save(text, "all of it", 9, &err), MK_OK);
    ck_assert_int_eq(synced, 3);
    for (int k = 0; k < 3; k++) {
        sync_failure = none[k]; /* a pipe has nothing to bring to a disk */
        ck_assert_int_eq(mk_out_file_save(text, "all of it", 9, &err), MK_OK);
    }
    sync_failure = NULL;
}
END_TEST

/* As some disks across a network do; what had failed before is told, and not that. */
START_TEST(a_file_that_cannot_be_closed_is_told)
{
    const int before = open_files();
    ck_assert_int_eq(mk_close_written(-1, 0), EBADF);
    ck_assert_int_eq(mk_close_written(-1, EIO), EIO);
    for (int failure = 0; failure <= ENOSPC; failure += ENOSPC) {
        const int fd = open("/dev/null", O_WRONLY | O_CLOEXEC);
        errno = EIO; /* of something else, some time before */
        ck_assert_int_eq(mk_close_written(fd, failure), failure);
    }
    ck_assert_int_eq(open_files(), before);
}
END_TEST

/* A run of many notes and few rows takes no more memory than another. */
START_TEST(notes_go_to_the_file_as_they_come)
{
    const char *path = scratch("notes.csv");
    struct mk_log_writer *w = open_writer(path);
    struct stat info;
    for (int i = 0; i < 10000; i++)
        ck_assert_int_eq(mk_log_writer_note(w, "event", "something happened"), MK_OK);
    ck_assert_int_eq(stat(path, &info), 0);
    ck_assert_int_gt(info.st_size, 200000);
    ck_assert_int_eq(mk_log_writer_close(w, NULL), MK_OK);
}
END_TEST

START_TEST(a_file_is_on_the_disk_before_it_gets_its_name)
{
    struct mk_out_file file;
    const char *path = scratch("whole.txt");
    synced = 0;
    ck_assert_int_eq(mk_out_file_open(&file, path, NULL), MK_OK);
    ck_assert_int_eq(mk_out_file_write(&file, "all of it", 9, NULL), MK_OK);
    ck_assert_int_eq(synced, 0);
    ck_assert_int_eq(access(path, F_OK), -1);
    ck_assert_int_eq(mk_out_file_commit(&file, NULL), MK_OK);
    ck_assert_int_eq(synced, 1);
    ck_assert_int_eq(access(path, F_OK), 0);
}
END_TEST

/* Whoever finds it later has to know whose it was, and what it was to become. */
START_TEST(a_temporary_file_is_beside_its_target_and_names_its_maker)
{
    struct mk_out_file file;
    char path[300], wanted[340];
    snprintf(path, sizeof path, "%s", scratch("named.txt"));
    snprintf(wanted, sizeof wanted, "%s.%ld-0.tmp", path, (long)getpid());
    ck_assert_int_eq(mk_out_file_open(&file, path, NULL), MK_OK);
    ck_assert_str_eq(file.temporary, wanted);
    ck_assert_int_eq(access(wanted, F_OK), 0);
    mk_out_file_abandon(&file);
    ck_assert_int_ne(access(wanted, F_OK), 0);
}
END_TEST

/* A process elsewhere, whose number says nothing here, holds its file; and what is no file at all
 * nobody has begun to write. */
START_TEST(what_a_dead_program_left_is_removed_and_nothing_that_looks_like_it)
{
    char path[300], left[340], held[340], pipe_[340];
    pid_t dead = fork();
    if (dead == 0)
        _exit(0);
    ck_assert_int_eq(waitpid(dead, NULL, 0), dead);
    snprintf(path, sizeof path, "%s", scratch("cleaned.txt"));
    snprintf(left, sizeof left, "%s.%ld-0.tmp", path, (long)dead);
    snprintf(held, sizeof held, "%s.%ld-1.tmp", path, (long)dead);
    snprintf(pipe_, sizeof pipe_, "%s.%ld-2.tmp", path, (long)dead);
    close(open(left, O_WRONLY | O_CREAT, 0600));
    int fd = open(held, O_WRONLY | O_CREAT, 0600);
    ck_assert_int_eq(flock(fd, LOCK_EX | LOCK_NB), 0);
    ck_assert_int_eq(mkfifo(pipe_, 0600), 0);
    const int before = open_files();
    mk_temporary_clean(path);
    ck_assert_int_eq(open_files(), before);
    ck_assert_int_ne(access(left, F_OK), 0);
    ck_assert_int_eq(access(held, F_OK), 0);
    ck_assert_int_eq(access(pipe_, F_OK), 0);
    close(fd);
    unlink(held);
    unlink(pipe_);
}
END_TEST

/* As the handler of a signal does that comes while a file is written. */
START_TEST(a_program_that_ends_removes_what_is_temporary_and_nothing_else)
{
    char path[300], done[300];
    snprintf(path, sizeof path, "%s", scratch("ended.txt"));
    snprintf(done, sizeof done, "%s", scratch("done.txt"));
    setenv("TMPDIR", scratch("."), 1);
    pid_t child = fork();
    if (child == 0) {
        struct mk_out_file file;
        struct mk_temporary_folder folder;
        char inside[PATH_MAX];
        bool good = mk_out_file_save(done, "all of it", 9, NULL) == MK_OK &&
                    mk_out_file_open(&file, path, NULL) == MK_OK &&
                    mk_temporary_folder_open(&folder, NULL, "ended", NULL) == MK_OK;
        snprintf(inside, sizeof inside, "%s/file", folder.path);
        mk_temporary_add(inside);
        close(open(inside, O_WRONLY | O_CREAT, 0600));
        good = good && access(file.temporary, F_OK) == 0 && access(inside, F_OK) == 0;
        mk_temporary_remove();
        _exit(good ? 0 : 1);
    }
    int status;
    ck_assert_int_eq(waitpid(child, &status, 0), child);
    ck_assert_int_eq(status, 0);
    ck_assert_int_eq(count_files("ended*"), 0);
    ck_assert_int_eq(count_files("done.txt*"), 1);
    unsetenv("TMPDIR");
}
END_TEST

/* The next folder of its name finds it; a link of that name leads elsewhere. */
START_TEST(a_folder_that_a_dead_program_left_is_removed)
{
    struct mk_temporary_folder folder;
    char left[320], linked[320], mine[320];
    pid_t dead = fork();
    if (dead == 0)
        _exit(0);
    ck_assert_int_eq(waitpid(dead, NULL, 0), dead);
    setenv("TMPDIR", scratch("."), 1);
    snprintf(mine, sizeof mine, "%s", scratch("mine"));
    ck_assert_int_eq(mkdir(mine, 0700), 0);
    snprintf(left, sizeof left, "%s/shop.%ld-0.tmp", scratch("."), (long)dead);
    snprintf(linked, sizeof linked, "%s/shop.%ld-1.tmp", scratch("."), (long)dead);
    ck_assert_int_eq(mkdir(left, 0700), 0);
    ck_assert_int_eq(symlink(mine, linked), 0);
    strcat(left, "/file");
    close(open(left, O_WRONLY | O_CREAT, 0600));
    ck_assert_int_eq(mk_temporary_folder_open(&folder, NULL, "shop", NULL), MK_OK);
    ck_assert_int_eq(count_files("shop.*-0.tmp"), 1);
    mk_temporary_folder_close(&folder);
    ck_assert_int_eq(count_files("shop.*-0.tmp"), 0);
    ck_assert_int_eq(count_files("shop.*-1.tmp"), 1);
    ck_assert_int_eq(access(mine, F_OK), 0);
    struct mk_error err = MK_ERROR_INIT;
    setenv("TMPDIR", "/nowhere", 1);
    ck_assert_int_eq(mk_temporary_folder_open(&folder, NULL, "shop", &err), MK_ERR_NOTFOUND);
    ck_assert_str_eq(err.file, "/nowhere");
    unsetenv("TMPDIR");
}
END_TEST

/* The first file that it opens has the descriptor 0 then. */
START_TEST(a_program_without_standard_input_writes_its_files)
{
    int kept = dup(STDIN_FILENO);
    const int before = open_files();
    struct mk_error err = MK_ERROR_INIT;
    struct mk_log *log;
    struct mk_out_file file;
    const double row[] = {0.0, 1.0, 2.0};
    close(STDIN_FILENO);
    struct mk_log_writer *w = open_writer(scratch("without.csv"));
    ck_assert_int_eq(mk_log_writer_row(w, row), MK_OK);
    ck_assert_int_eq(mk_log_writer_close(w, &err), MK_OK);
    ck_assert_int_eq(mk_out_file_save(scratch("without.txt"), "all of it", 9, &err), MK_OK);
    ck_assert_int_eq(mk_out_file_open(&file, scratch("abandoned.txt"), &err), MK_OK);
    ck_assert_int_eq(file.fd, STDIN_FILENO);
    mk_out_file_abandon(&file);
    ck_assert_int_eq(fcntl(STDIN_FILENO, F_GETFD), -1);
    ck_assert_int_eq(mk_copy_new(scratch("without.csv"), scratch("copied.csv")), 0);
    ck_assert_msg(mk_log_read(scratch("copied.csv"), &log, &err) == MK_OK, "%s", err.message);
    mk_log_free(log);
    dup2(kept, STDIN_FILENO);
    ck_assert_int_eq(open_files(), before);
    close(kept);
    char *text = slurp_file(scratch("without.txt"));
    ck_assert_str_eq(text, "all of it");
    free(text);
}
END_TEST

/* Asked before a long computation; devices and standard output are left alone. */
START_TEST(whether_a_file_can_be_written_is_known_before_and_leaves_nothing_behind)
{
    char folder[300], file[330], name[340];
    struct mk_error err = MK_ERROR_INIT;
    snprintf(folder, sizeof folder, "%s", scratch("asked"));
    snprintf(file, sizeof file, "%s/there.txt", folder);
    snprintf(name, sizeof name, "%s/new.txt", folder);
    ck_assert_int_eq(mkdir(folder, 0755), 0);
    ck_assert_int_eq(mk_out_file_save(file, "all of it", 9, &err), MK_OK);
    ck_assert_int_eq(mk_out_file_check(NULL, &err), MK_OK);
    ck_assert_int_eq(mk_out_file_check("-", &err), MK_OK);
    ck_assert_int_eq(mk_out_file_check("/dev/full", &err), MK_OK);
    ck_assert_int_eq(mk_out_file_check(file, &err), MK_OK);
    ck_assert_int_eq(mk_out_file_check(name, &err), MK_OK);
    ck_assert_int_ne(mk_out_file_check(folder, &err), MK_OK);
    ck_assert_str_eq(err.file, folder);
    snprintf(name, sizeof name, "%s/nowhere/new.txt", folder);
    ck_assert_int_eq(mk_out_file_check(name, &err), MK_ERR_NOTFOUND);
    char *text = slurp_file(file);
    ck_assert_str_eq(text, "all of it");
    free(text);
    ck_assert_int_eq(unlink(file), 0);
    ck_assert_int_eq(rmdir(folder), 0); /* empty */
}
END_TEST

/* A copy that is cut short is none: the original is removed after it. */
START_TEST(a_copy_is_whole_or_is_not_there)
{
    char from[256], to[256], text[16] = "";
    snprintf(from, sizeof from, "%s", scratch("original.csv"));
    snprintf(to, sizeof to, "%s", scratch("copy.csv"));
    scratch_text("original.csv", "t,q1\n0,1\n");
    ck_assert_int_eq(mk_copy_new(from, to), 0);
    FILE *f = fopen(to, "r");
    ck_assert_uint_eq(fread(text, 1, sizeof text, f), 9);
    fclose(f);
    ck_assert_str_eq(text, "t,q1\n0,1\n");
    ck_assert_int_eq(mk_copy_new(from, to), EEXIST);
    ck_assert_int_eq(access(to, F_OK), 0);
    remove(to);
    /* A folder opens and cannot be read, as a file on a broken disk. */
    ck_assert_int_eq(mk_copy_new(scratch(""), to), EISDIR);
    ck_assert_int_ne(access(to, F_OK), 0);
    ck_assert_int_eq(mk_copy_new(scratch("none.csv"), to), ENOENT);
    ck_assert_int_ne(access(to, F_OK), 0);
    /* As it is where the disk fails at the very end; no file stays open on the way. */
    static const int broken[] = {EIO, 0};
    const int before = open_files();
    sync_failure = broken;
    ck_assert_int_eq(mk_copy_new(from, to), EIO);
    sync_failure = NULL;
    ck_assert_int_ne(access(to, F_OK), 0);
    ck_assert_int_eq(mk_copy_new(from, to), 0);
    ck_assert_int_eq(open_files(), before);
}
END_TEST

START_TEST(a_log_is_on_the_disk_when_it_is_closed)
{
    struct mk_log_writer *w = open_writer(scratch("synced.csv"));
    synced = 0;
    ck_assert_int_eq(mk_log_writer_close(w, NULL), MK_OK);
    ck_assert_int_ge(synced, 1);
}
END_TEST

START_TEST(a_temporary_file_never_takes_one_that_is_there)
{
    char path[300], taken[340];
    snprintf(path, sizeof path, "%s", scratch("kept.txt"));
    snprintf(taken, sizeof taken, "%s.%ld-0.tmp", path, (long)getpid());
    FILE *f = fopen(taken, "w");
    ck_assert(f && fputs("somebody's", f) >= 0 && fclose(f) == 0);
    ck_assert_int_eq(mk_out_file_save(path, "mine", 4, NULL), MK_OK);
    char *theirs = slurp_file(taken), *ours = slurp_file(path);
    ck_assert_str_eq(theirs, "somebody's");
    ck_assert_str_eq(ours, "mine");
    free(theirs);
    free(ours);
    unlink(taken);
}
END_TEST

START_TEST(a_file_that_does_not_get_its_name_is_told_and_leaves_nothing)
{
    struct mk_out_file file;
    struct mk_error err = MK_ERROR_INIT;
    char path[300], temporary[340];
    snprintf(path, sizeof path, "%s", scratch("becomes-a-folder"));
    ck_assert_int_eq(mk_out_file_open(&file, path, NULL), MK_OK);
    snprintf(temporary, sizeof temporary, "%s", file.temporary);
    ck_assert_int_eq(mkdir(path, 0777), 0);
    ck_assert_int_eq(mk_out_file_write(&file, "all of it", 9, NULL), MK_OK);
    ck_assert_int_eq(mk_out_file_commit(&file, &err), MK_ERR_IO);
    ck_assert_int_eq(file.fd, -1); /* closed once: the number may be another file's by now */
    ck_assert_str_eq(err.file, path);
    ck_assert_int_ne(access(temporary, F_OK), 0);
    ck_assert_int_eq(rmdir(path), 0);
}
END_TEST

START_TEST(what_cannot_be_begun_leaves_no_file_open)
{
    static const char *const columns[] = {"t", "q1"};
    struct mk_log_writer *w;
    struct mk_out_file file;
    const int before = open_files();
    ck_assert_int_eq(mk_log_writer_open("/dev/full", true, NULL, 0, columns, 2, &w, NULL),
                     MK_ERR_NOSPACE);
    ck_assert_int_eq(open_files(), before);
    ck_assert_int_eq(mk_copy_new("/dev/null", "/dev/full"), EEXIST);
    ck_assert_int_eq(mk_out_file_save("/dev/full", "all of it", 9, NULL), MK_ERR_NOSPACE);
    ck_assert_int_eq(open_files(), before);
    ck_assert_int_eq(mk_out_file_open(&file, scratch("abandoned"), NULL), MK_OK);
    ck_assert_int_eq(open_files(), before + 1);
    mk_out_file_abandon(&file);
    ck_assert_int_eq(open_files(), before);
    ck_assert_int_ne(access(scratch("abandoned"), F_OK), 0);
}
END_TEST

/* The compressor has a descriptor of its own. */
START_TEST(a_compressed_log_is_told_when_there_are_no_more_files_to_be_had)
{
    struct mk_log *log;
    struct mk_error err = MK_ERROR_INIT;
    struct rlimit limit;
    char path[256];
    snprintf(path, sizeof path, "%s", scratch("second.csv.gz"));
    ck_assert_int_eq(mk_log_read(scratch_text("first.csv", "t,q1\n0,1\n"), &log, &err), MK_OK);
    const int before = open_files(), next = dup(STDOUT_FILENO);
    close(next);
    ck_assert_int_eq(getrlimit(RLIMIT_NOFILE, &limit), 0);
    const struct rlimit one_more = {(rlim_t)next + 1, limit.rlim_max};
    ck_assert_int_eq(setrlimit(RLIMIT_NOFILE, &one_more), 0);
    enum mk_status st = mk_log_write(path, log, &err);
    ck_assert_int_eq(setrlimit(RLIMIT_NOFILE, &limit), 0);
    ck_assert_int_eq(st, MK_ERR_IO);
    ck_assert_str_eq(err.file, path);
    ck_assert_ptr_nonnull(strstr(err.message, strerror(EMFILE)));
    ck_assert_int_eq(open_files(), before);
    ck_assert_int_eq(count_files("second.csv.gz*"), 0);
    ck_assert_int_eq(mk_log_write(path, log, &err), MK_OK);
    mk_log_free(log);
}
END_TEST

Suite *suite_log_writer(void)
{
    Suite *s = suite_create("log_writer");
    TCase *t = tcase_create("files");
    tcase_set_timeout(t, 30);
    tcase_add_test(t, rows_written_during_a_run_are_a_log);
    tcase_add_test(t, kill_9_leaves_whole_lines);
    tcase_add_test(t, a_full_disk_is_reported_and_leaves_whole_lines);
    tcase_add_test(t, a_file_that_does_not_get_its_name_is_told_and_leaves_nothing);
    tcase_add_test(t, what_cannot_be_begun_leaves_no_file_open);
    tcase_add_test(t, a_disk_that_fails_at_the_end_is_told);
    tcase_add_test(t, a_file_that_cannot_be_closed_is_told);
    tcase_add_test(t, notes_go_to_the_file_as_they_come);
    tcase_add_test(t, a_full_device_is_reported_once_and_for_all);
    tcase_add_test(t, what_is_flushed_is_in_the_file_to_the_letter);
    tcase_add_test(t, an_old_log_is_overwritten_only_when_asked);
    tcase_add_test(t, columns_that_could_not_be_read_back_are_refused);
    tcase_add_test(t, notes_longer_than_the_buffer_stay_one_line);
    tcase_add_test(t, a_locale_with_a_decimal_comma_does_not_matter);
    tcase_add_test(t, a_file_is_on_the_disk_before_it_gets_its_name);
    tcase_add_test(t, a_temporary_file_is_beside_its_target_and_names_its_maker);
    tcase_add_test(t, a_program_that_ends_removes_what_is_temporary_and_nothing_else);
    tcase_add_test(t, a_folder_that_a_dead_program_left_is_removed);
    tcase_add_test(t, what_a_dead_program_left_is_removed_and_nothing_that_looks_like_it);
    tcase_add_test(t, a_program_without_standard_input_writes_its_files);
    tcase_add_test(t, whether_a_file_can_be_written_is_known_before_and_leaves_nothing_behind);
    tcase_add_test(t, a_copy_is_whole_or_is_not_there);
    tcase_add_test(t, a_log_is_on_the_disk_when_it_is_closed);
    tcase_add_test(t, a_temporary_file_never_takes_one_that_is_there);
    tcase_add_test(t, a_compressed_log_is_told_when_there_are_no_more_files_to_be_had);
    suite_add_tcase(s, t);
    return s;
}
