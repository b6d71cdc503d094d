/* Completion of the command line, and what the command that is typed takes. */
#include <dirent.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>

#include "console/screen/tui_prompt.h"
#include "console/script/cmd.h"

struct candidates {
    const char *word; /* what has been typed of it */
    size_t typed;
    int count;
    char *common, *list;
    size_t common_size, list_size;
};

static void offer(struct candidates *c, const char *name)
{
    if (strncmp(name, c->word, c->typed) != 0)
        return;
    if (c->count++ == 0) {
        snprintf(c->common, c->common_size, "%s", name);
    } else {
        size_t n = 0;
        while (c->common[n] && c->common[n] == name[n])
            n++;
        c->common[n] = '\0';
    }
    size_t used = strlen(c->list);
    snprintf(c->list + used, c->list_size - used, "%s%s", used ? "  " : "", name);
}

static void offer_files(struct candidates *c)
{
    char folder[PROMPT_TEXT] = ".", path[PROMPT_TEXT * 2], name[PROMPT_TEXT * 2];
    const char *slash = strrchr(c->word, '/');
    int keep = slash ? (int)(slash - c->word) + 1 : 0;
    if (slash)
        snprintf(folder, sizeof folder, "%.*s", keep, c->word);
    DIR *dir = opendir(folder);
    struct dirent *e;
    struct stat info;
    int seen = 0;
    while (dir && seen++ < 5000 && (e = readdir(dir)) != NULL) {
        if (e->d_name[0] == '.')
            continue;
        snprintf(path, sizeof path, "%s/%s", folder, e->d_name);
        bool is_folder = stat(path, &info) == 0 && S_ISDIR(info.st_mode);
        snprintf(name, sizeof name, "%.*s%s%s", keep, c->word, e->d_name, is_folder ? "/" : "");
        offer(c, name);
    }
    if (dir)
        closedir(dir);
}

static void offer_setups(struct candidates *c)
{
    const struct mk_ctrl_ops *ops;
    for (int i = 0; (ops = mk_ctrl_setup(i)) != NULL; i++)
        offer(c, ops->name);
}

static void offer_parameters(struct candidates *c, const struct host_status *status)
{
    if (!status->setup)
        return;
    for (int i = 0; i < status->setup->param_count; i++)
        offer(c, status->setup->param[i].name);
}

static void offer_limits(struct candidates *c)
{
    const char *name;
    for (int i = 0; (name = cmd_limit_name(i)) != NULL; i++)
        offer(c, name);
}

static void offer_words(struct candidates *c, const char *words)
{
    char word[32];
    while (*words) {
        size_t n = strcspn(words, " |");
        snprintf(word, sizeof word, "%.*s", (int)n, words);
        offer(c, word);
        words += n + strspn(words + n, " |");
    }
}

static void offer_commands(struct candidates *c)
{
    const struct cmd *row;
    for (int i = 0; (row = cmd_at(i)) != NULL; i++)
        offer(c, row->name);
    offer(c, "source");
}

static void offer_arguments(struct candidates *c, const char *name,
                            const struct host_status *status)
{
    static const char *const files[] = {"model",    "believe", "source", "replay",
                                        "save",     "save!",   "record", "faults",
                                        "identify", "explain", "compare"};
    const struct cmd *row = cmd_by_name(name);
    if (strcmp(name, "setup") == 0)
        offer_setups(c);
    else if (strcmp(name, "set") == 0)
        offer_parameters(c, status);
    else if (strcmp(name, "limit") == 0)
        offer_limits(c);
    else if (strncmp(name, "wait-", 5) == 0 || strcmp(name, "expect") == 0)
        offer_words(c, "balanced running idle faulted no-fault within for");
    else if (row && strchr(row->usage, '|'))
        offer_words(c, row->usage);
    for (size_t i = 0; i < sizeof files / sizeof files[0]; i++)
        if (strcmp(name, files[i]) == 0)
            offer_files(c);
}

int complete(const char *text, int at, const struct host_status *status, char *common,
             size_t common_size, char *list, size_t list_size)
{
    char line[PROMPT_TEXT], name[PROMPT_TEXT];
    snprintf(line, sizeof line, "%.*s", at, text);
    const char *blank = strrchr(line, ' '), *word = blank ? blank + 1 : line;
    struct candidates c = {word, strlen(word), 0, common, list, common_size, list_size};
    common[0] = list[0] = '\0';
    const char *first = line + strspn(line, " ");
    snprintf(name, sizeof name, "%.*s", (int)strcspn(first, " "), first);
    if (word <= first)
        offer_commands(&c);
    else
        offer_arguments(&c, name, status);
    return c.count;
}

void complete_usage(const char *text, char *buf, size_t size)
{
    char name[32];
    text += strspn(text, " ");
    snprintf(name, sizeof name, "%.*s", (int)strcspn(text, " "), text);
    const struct cmd *c = cmd_by_name(name);
    if (c)
        snprintf(buf, size, "%s %s: %s", c->name, c->usage, c->help);
    else if (strcmp(name, "source") == 0)
        snprintf(buf, size, "source FILE: execute a command file");
    else
        snprintf(buf, size,
                 "Tab completes, arrows recall, Esc leaves; a blank twice is the e-stop");
}
