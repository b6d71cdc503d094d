#include "console/commands/gnuplot.h"

#include <ctype.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include "base/out_file.h"
#include "base/text.h"

void gnuplot_quote(FILE *f, const char *text)
{
    char shown[1000];
    mk_show_text(shown, sizeof shown, text);
    fputc('"', f);
    for (const char *at = shown; *at; at++)
        if (isalnum((unsigned char)*at) || *at == ' ' || (unsigned char)*at >= 0x80)
            fputc(*at, f);
        else
            fprintf(f, "\\%03o", (unsigned)(unsigned char)*at);
    fputc('"', f);
}

void gnuplot_picture(FILE *f, const char *path, int width, int height)
{
    size_t n = strlen(path);
    bool png = n >= 4 && strcmp(path + n - 4, ".png") == 0;
    fprintf(f,
            "set terminal %s noenhanced size %d,%d %sfont 'DejaVu Sans,%d' background '#ffffff'\n",
            png ? "pngcairo" : "svg", width, height, png ? "" : "dynamic ", png ? 11 : 12);
}

/* Starts gnuplot with the script as its standard input, its standard output in `out` and its
 * complaints in `complaints`. */
static pid_t start(FILE *script, int out, FILE *complaints)
{
    fflush(stdout);
    pid_t child = fork();
    if (child != 0)
        return child;
    signal(SIGPIPE, SIG_DFL); /* so that it ends when nobody reads any more */
    dup2(fileno(script), STDIN_FILENO);
    dup2(out, STDOUT_FILENO);
    dup2(fileno(complaints), STDERR_FILENO);
    execlp("gnuplot", "gnuplot", "-d", "/dev/stdin", (char *)NULL);
    _exit(errno == ENOENT ? 127 : 126);
}

static enum mk_status is_not_installed(struct mk_error *err)
{
    return mk_error_set(err, MK_ERR_NOTSUP, "gnuplot is not installed: install gnuplot-nox");
}

/* As execlp(3) looks for it. */
enum mk_status gnuplot_check(struct mk_error *err)
{
    char path[PATH_MAX];
    const char *rest = getenv("PATH");
    rest = rest ? rest : "/bin:/usr/bin";
    while (*rest) {
        const int length = (int)strcspn(rest, ":");
        if (snprintf(path, sizeof path, "%.*s/gnuplot", length ? length : 1, length ? rest : ".") <
                (int)sizeof path &&
            access(path, X_OK) == 0)
            return MK_OK;
        rest += (size_t)length + (rest[length] == ':');
    }
    return is_not_installed(err);
}

/* The last line of the complaints, which says what is wrong; the place in the script before it
 * means nothing to a user. */
static void last_complaint(FILE *complaints, char *text, size_t size)
{
    char line[256];
    text[0] = '\0';
    rewind(complaints);
    while (fgets(line, sizeof line, complaints)) {
        line[strcspn(line, "\n")] = '\0';
        const char *at = strstr(line, " line "), *colon = at ? strchr(at, ':') : NULL;
        const char *says = line[0] == '"' && colon ? colon + 1 : line;
        says += strspn(says, " ^\t");
        if (*says)
            snprintf(text, size, "%s", says);
    }
}

static enum mk_status finish(pid_t child, FILE *complaints, struct mk_error *err)
{
    int status = 0;
    char text[200];
    while (waitpid(child, &status, 0) < 0 && errno == EINTR)
        continue;
    if (WIFEXITED(status) && WEXITSTATUS(status) == 0)
        return MK_OK;
    last_complaint(complaints, text, sizeof text);
    /* 127 is also what the loader ends with: it says why. */
    if (WIFEXITED(status) && WEXITSTATUS(status) == 127 && !text[0])
        return is_not_installed(err);
    return mk_error_set(err, MK_ERR_EXPECT, "gnuplot cannot draw this: %s", text);
}

/* Everything that comes through the pipe goes to the file. */
static enum mk_status collect(int from, struct mk_out_file *file, struct mk_error *err)
{
    char block[16384];
    enum mk_status st = MK_OK;
    ssize_t n = 0;
    while (st == MK_OK && ((n = read(from, block, sizeof block)) > 0 || (n < 0 && errno == EINTR)))
        if (n > 0)
            st = mk_out_file_write(file, block, (size_t)n, err);
    if (st == MK_OK && n < 0)
        st = mk_error_errno(err, errno, file->path, "cannot read what gnuplot draws");
    return st;
}

/* gnuplot's "dumb" terminal puts a form feed before every panel, and no end of line after it. */
static enum mk_status copy_panels(int from, struct mk_error *err)
{
    char block[4096];
    bool first = true;
    ssize_t n;
    while ((n = read(from, block, sizeof block)) > 0 || (n < 0 && errno == EINTR))
        for (ssize_t i = 0; i < n; i++) {
            if (block[i] != '\f')
                putchar(block[i]);
            else if (!first)
                putchar('\n');
            first = first && block[i] != '\f';
        }
    putchar('\n');
    if (n < 0)
        return mk_error_errno(err, errno, NULL, "cannot read what gnuplot draws");
    return MK_OK; /* whether it could be written is looked at when the program ends */
}

static enum mk_status draw_to_terminal(FILE *script, FILE *complaints, struct mk_error *err)
{
    int ends[2];
    pid_t child = pipe2(ends, O_CLOEXEC) == 0 ? start(script, ends[1], complaints) : -1;
    if (child < 0)
        return mk_error_errno(err, errno, NULL, "cannot start gnuplot");
    close(ends[1]);
    enum mk_status st = copy_panels(ends[0], err);
    close(ends[0]);
    enum mk_status ended = finish(child, complaints, st == MK_OK ? err : NULL);
    return st == MK_OK ? ended : st;
}

/* Through a pipe: gnuplot itself does not tell when a disk is full. */
static enum mk_status draw_to_file(FILE *script, const char *path, FILE *complaints,
                                   struct mk_error *err)
{
    struct mk_out_file file;
    int ends[2];
    enum mk_status st = mk_out_file_open(&file, path, err);
    if (st != MK_OK)
        return st;
    pid_t child = pipe2(ends, O_CLOEXEC) == 0 ? start(script, ends[1], complaints) : -1;
    if (child < 0) {
        st = mk_error_errno(err, errno, NULL, "cannot start gnuplot");
        mk_out_file_abandon(&file);
        return st;
    }
    close(ends[1]);
    st = collect(ends[0], &file, err);
    close(ends[0]);
    enum mk_status ended = finish(child, complaints, st == MK_OK ? err : NULL);
    if (st == MK_OK)
        st = ended;
    return mk_out_file_finish(&file, st, err);
}

static enum mk_status run(FILE *script, const char *path, struct mk_error *err)
{
    FILE *complaints = tmpfile();
    if (!complaints)
        return mk_error_errno(err, errno, NULL, "cannot make a temporary file in " P_tmpdir);
    enum mk_status st = path ? draw_to_file(script, path, complaints, err)
                             : draw_to_terminal(script, complaints, err);
    fclose(complaints);
    return st;
}

enum mk_status gnuplot_run(const char *path,
                           enum mk_status (*write)(FILE *f, const void *user, struct mk_error *err),
                           const void *user, struct mk_error *err)
{
    FILE *script = tmpfile(); /* without a name: nothing is left of it, whatever happens */
    if (!script)
        return mk_error_errno(err, errno, NULL, "cannot make a temporary file in " P_tmpdir);
    enum mk_status st = write(script, user, err);
    if (st == MK_OK && (fflush(script) != 0 || fseek(script, 0, SEEK_SET) != 0))
        st = mk_error_errno(err, errno, NULL, "cannot write a temporary file in " P_tmpdir);
    if (st == MK_OK)
        st = run(script, path, err);
    fclose(script);
    return st;
}
