#include "console/screen/history.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "console/script/session.h"

/* The folder that holds ours; false: there is none. */
static bool state_folder(char *path, size_t size)
{
    const char *state = getenv("XDG_STATE_HOME"), *home = getenv("HOME");
    int n = -1;
    if (state && state[0] == '/') /* the specification wants others ignored */
        n = snprintf(path, size, "%s", state);
    else if (home && home[0] == '/')
        n = snprintf(path, size, "%s/.local/state", home);
    return n > 0 && (size_t)n < size;
}

static bool history_path(char *path, size_t size)
{
    char folder[SESSION_PATH];
    if (!state_folder(folder, sizeof folder))
        return false;
    int n = snprintf(path, size, "%s/mechkit/history", folder);
    return n > 0 && (size_t)n < size;
}

/* Makes the folders above a file, for this user alone. */
static bool make_folders(const char *path)
{
    char part[SESSION_PATH];
    for (const char *slash = strchr(path + 1, '/'); slash; slash = strchr(slash + 1, '/')) {
        snprintf(part, sizeof part, "%.*s", (int)(slash - path), path);
        if (mkdir(part, 0700) != 0 && errno != EEXIST)
            return false;
    }
    return true;
}

/* Lines that are too long for the prompt are left out, those of other bytes than text too. */
static void read_lines(const char *path, struct tui_prompt *p)
{
    char line[PROMPT_TEXT + 1];
    FILE *f = fopen(path, "re");
    bool whole = true; /* the last piece ended a line */
    while (f && fgets(line, sizeof line, f)) {
        size_t n = strcspn(line, "\n");
        bool ends = line[n] == '\n', plain = true;
        line[n] = '\0';
        for (size_t i = 0; i < n; i++)
            plain = plain && (unsigned char)line[i] >= ' ' && line[i] != 0x7f;
        if (whole && ends && plain && n < PROMPT_TEXT)
            prompt_remember(p, line);
        whole = ends;
    }
    if (f)
        fclose(f);
}

void history_load(struct tui_prompt *p)
{
    char path[SESSION_PATH];
    p->lines = 0;
    if (history_path(path, sizeof path))
        read_lines(path, p);
    p->typed_lines = 0;
}

static bool write_lines(const char *path, const struct tui_prompt *p)
{
    int fd = open(path, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600);
    FILE *f = fd >= 0 ? fdopen(fd, "w") : NULL;
    for (int i = 0; f && i < p->lines; i++)
        fprintf(f, "%s\n", p->history[i]);
    bool well = f && !ferror(f);
    return f && fclose(f) == 0 && well;
}

void history_save(const struct tui_prompt *p)
{
    char path[SESSION_PATH], fresh[SESSION_PATH + 16];
    if (p->typed_lines == 0 || !history_path(path, sizeof path) || !make_folders(path))
        return;
    struct tui_prompt *all = calloc(1, sizeof *all);
    if (!all)
        return;
    read_lines(path, all);
    for (int i = p->lines - p->typed_lines; i < p->lines; i++)
        prompt_remember(all, p->history[i]);
    /* A new file in the old one's place: nobody ever sees half of it. */
    snprintf(fresh, sizeof fresh, "%s.%ld", path, (long)getpid());
    if (!write_lines(fresh, all) || rename(fresh, path) != 0)
        (void)unlink(fresh);
    free(all);
}
