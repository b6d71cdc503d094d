/* Parser and evaluation of fault scripts. A rule is a line of words:
 *
 *     at N ACTION [ARGUMENTS] [for COUNT]
 *     from A to B ACTION [ARGUMENTS]
 */
#include "driver/fault_script.h"

#include <ctype.h>
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/in_file.h"
#include "base/text.h"
#include "mechkit/number.h"

#define SCRIPT_MAX_BYTES 65536
#define WORDS_MAX 12
#define SAMPLES_MAX 1000000000000 /* years; sums stay far from wrapping */
#define TEXT_OF(x) TEXT_OF_(x)
#define TEXT_OF_(x) #x

enum argument { ARG_NONE, ARG_COUNT, ARG_TIME, ARG_JOINT, ARG_JOINT_BY, ARG_VALUE };
enum extent { EXTENT_ONE, EXTENT_REST }; /* how long `at N` lasts without `for` */

static const struct action_row {
    const char *name;
    const char *usage;
    enum argument argument;
    enum extent extent;
} actions[MK_FAULT_ACTION_COUNT] = {
    [MK_FAULT_DROP] = {"drop", "drop [COUNT]", ARG_COUNT, EXTENT_ONE},
    [MK_FAULT_MUTE] = {"mute", "mute [COUNT]", ARG_COUNT, EXTENT_ONE},
    [MK_FAULT_DELAY] = {"delay", "delay TIME (5ms, 200us)", ARG_TIME, EXTENT_ONE},
    [MK_FAULT_STICK] = {"stuck", "stuck JOINT [for COUNT]", ARG_JOINT, EXTENT_REST},
    [MK_FAULT_SLIP] = {"jump", "jump JOINT by COUNTS", ARG_JOINT_BY, EXTENT_ONE},
    [MK_FAULT_NOISE] = {"noise", "noise COUNTS [for COUNT]", ARG_VALUE, EXTENT_REST},
    [MK_FAULT_SATURATE] = {"saturate", "saturate COMMAND [for COUNT]", ARG_VALUE, EXTENT_REST},
    [MK_FAULT_ALARM] = {"alarm", "alarm [for COUNT]", ARG_NONE, EXTENT_REST},
    [MK_FAULT_DISCONNECT] = {"disconnect", "disconnect", ARG_NONE, EXTENT_REST},
};

/* One rule being read: its words, and where it stands for messages. */
struct line {
    const char *file;
    int number;
    int joints;
    int count, next;
    char *word[WORDS_MAX];
    int column[WORDS_MAX];
    struct mk_error *err;
};

static enum mk_status complain(const struct line *l, enum mk_status st, const char *what)
{
    int i = l->next < l->count ? l->next : l->count - 1;
    const char *word = l->next < l->count ? l->word[i] : "end of rule";
    return mk_error_at(l->err, st, l->file, l->number, i >= 0 ? l->column[i] : 0,
                       "fault script: %s, not '%s'", what, word);
}

static bool accept(struct line *l, const char *word)
{
    if (l->next >= l->count || strcmp(l->word[l->next], word) != 0)
        return false;
    l->next++;
    return true;
}

static enum mk_status expect(struct line *l, const char *word)
{
    char what[32];
    snprintf(what, sizeof what, "expected '%s'", word);
    return accept(l, word) ? MK_OK : complain(l, MK_ERR_PARSE, what);
}

static enum mk_status whole_number(struct line *l, const char *what, uint64_t *out)
{
    const char *text = l->next < l->count ? l->word[l->next] : "";
    if (!isdigit((unsigned char)text[0]))
        return complain(l, MK_ERR_PARSE, what);
    char *end;
    errno = 0;
    unsigned long long n = strtoull(text, &end, 10);
    if (*end || errno)
        return complain(l, MK_ERR_PARSE, what);
    *out = n;
    l->next++;
    return MK_OK;
}

static enum mk_status sample_number(struct line *l, uint64_t *out)
{
    int at = l->next;
    enum mk_status st = whole_number(l, "expected the number of a sample", out);
    if (st != MK_OK || *out <= SAMPLES_MAX)
        return st;
    l->next = at;
    return complain(l, MK_ERR_RANGE, "samples go from 0 to " TEXT_OF(SAMPLES_MAX));
}

static enum mk_status count_of_samples(struct line *l, uint64_t *out)
{
    int at = l->next;
    enum mk_status st = whole_number(l, "expected how many samples", out);
    if (st != MK_OK || (*out >= 1 && *out <= SAMPLES_MAX))
        return st;
    l->next = at;
    return complain(l, MK_ERR_RANGE, "a count starts at 1 and ends at " TEXT_OF(SAMPLES_MAX));
}

static enum mk_status number(struct line *l, double min, double max, const char *what, double *out)
{
    double v;
    if (l->next >= l->count || !mk_parse_double_z(l->word[l->next], &v))
        return complain(l, MK_ERR_PARSE, what);
    if (!(v >= min && v <= max))
        return complain(l, MK_ERR_RANGE, what);
    *out = v;
    l->next++;
    return MK_OK;
}

/* "5ms", "0.2s", "300us". */
static enum mk_status duration(struct line *l, double *out_s)
{
    static const char what[] = "expected a time such as 5ms, 200us or 0.1s";
    static const struct {
        const char *name;
        double s;
    } units[] = {{"ns", 1e-9}, {"us", 1e-6}, {"ms", 1e-3}, {"s", 1.0}};
    const char *text = l->next < l->count ? l->word[l->next] : "";
    size_t digits = strspn(text, "0123456789.");
    for (size_t i = 0; i < sizeof units / sizeof units[0]; i++) {
        double v;
        if (strcmp(text + digits, units[i].name) != 0)
            continue;
        if (!mk_parse_double(text, text + digits, &v))
            break;
        if (v * units[i].s > 10.0)
            return complain(l, MK_ERR_RANGE, "a delay is at most 10s");
        *out_s = v * units[i].s;
        l->next++;
        return MK_OK;
    }
    return complain(l, MK_ERR_PARSE, what);
}

static enum mk_status joint(struct line *l, int *out)
{
    uint64_t n = 0;
    int at = l->next;
    enum mk_status st = whole_number(l, "expected the number of a joint", &n);
    if (st == MK_OK && (n < 1 || n > (uint64_t)l->joints)) {
        l->next = at;
        return complain(l, MK_ERR_RANGE,
                        l->joints == 1 ? "this rig has joint 1 only"
                                       : "this rig has joints 1 and 2");
    }
    *out = (int)n - 1;
    return st;
}

static enum mk_status find_action(struct line *l, enum mk_fault_action *out)
{
    for (int i = 0; i < MK_FAULT_ACTION_COUNT; i++) {
        if (accept(l, actions[i].name)) {
            *out = (enum mk_fault_action)i;
            return MK_OK;
        }
    }
    return complain(l, MK_ERR_PARSE,
                    "expected drop, mute, delay, stuck, jump, noise, saturate, alarm or "
                    "disconnect");
}

/* The arguments of an action; a count after drop and mute is their extent. */
static enum mk_status arguments(struct line *l, struct mk_fault_rule *rule, uint64_t *extent)
{
    enum mk_status st = MK_OK;
    switch (actions[rule->action].argument) {
    case ARG_NONE:
        return MK_OK;
    case ARG_COUNT:
        if (l->next < l->count && strcmp(l->word[l->next], "for") != 0)
            st = count_of_samples(l, extent);
        return st;
    case ARG_TIME:
        return duration(l, &rule->value);
    case ARG_JOINT:
        return joint(l, &rule->joint);
    case ARG_JOINT_BY:
        if ((st = joint(l, &rule->joint)) != MK_OK || (st = expect(l, "by")) != MK_OK)
            return st;
        return number(l, -8388608.0, 8388607.0, "expected a number of counts", &rule->value);
    case ARG_VALUE:
        return number(l, 0.0, 1e6, "expected a number from 0 on", &rule->value);
    }
    return st;
}

/* "at N" or "from N to M": the first sample, and the first after the last one (0 of "at"). */
static enum mk_status when(struct line *l, uint64_t *first, uint64_t *end)
{
    enum mk_status st;
    const bool range = accept(l, "from");
    *end = 0;
    if (!range && (st = expect(l, "at")) != MK_OK)
        return st;
    if ((st = sample_number(l, first)) != MK_OK || !range)
        return st;
    if ((st = expect(l, "to")) != MK_OK)
        return st;
    const int at = l->next;
    if ((st = sample_number(l, end)) != MK_OK)
        return st;
    if (*end > *first)
        return MK_OK;
    l->next = at;
    return complain(l, MK_ERR_RANGE, "the last sample must come after the first");
}

/* The action, its arguments, and for how many samples: 0 where the rule does not say. */
static enum mk_status what(struct line *l, bool range, struct mk_fault_rule *rule, uint64_t *extent)
{
    enum mk_status st = find_action(l, &rule->action);
    const int argument = l->next;
    if (st == MK_OK)
        st = arguments(l, rule, extent);
    if (st != MK_OK)
        return st;
    if (range && *extent != 0) {
        l->next = argument;
        return complain(l, MK_ERR_PARSE, "'from' and 'to' say how many samples; expected no more");
    }
    return !range && *extent == 0 && accept(l, "for") ? count_of_samples(l, extent) : MK_OK;
}

static enum mk_status parse_rule(struct line *l, struct mk_fault_rule *rule)
{
    uint64_t extent = 0, end = 0;
    enum mk_status st = when(l, &rule->first, &end);
    const bool range = end > 0;
    if (st == MK_OK)
        st = what(l, range, rule, &extent);
    if (st != MK_OK)
        return st;
    if (l->next < l->count) {
        char usage[80];
        snprintf(usage, sizeof usage, "usage: %s; expected no more", actions[rule->action].usage);
        return complain(l, MK_ERR_PARSE, usage);
    }
    if (extent == 0)
        extent = actions[rule->action].extent == EXTENT_REST ? UINT64_MAX - rule->first : 1;
    rule->end = range ? end : rule->first + extent;
    return MK_OK;
}

/* Splits one rule in place; '#' ends it. */
static enum mk_status split(struct line *l, char *text, int column)
{
    l->count = 0;
    l->next = 0;
    text[strcspn(text, "#")] = '\0';
    for (char *p = text; *p;) {
        if (isspace((unsigned char)*p)) {
            p++;
            continue;
        }
        if (l->count == WORDS_MAX)
            return mk_error_at(l->err, MK_ERR_PARSE, l->file, l->number, column + (int)(p - text),
                               "fault script: a rule of more than %d words", WORDS_MAX);
        l->word[l->count] = p;
        l->column[l->count++] = column + (int)(p - text);
        p += strcspn(p, " \t\r\v\f");
        if (*p)
            *p++ = '\0';
    }
    return MK_OK;
}

static enum mk_status parse_line(struct line *l, char *text, struct mk_fault_script *out)
{
    int column = 1;
    text[strcspn(text, "#")] = '\0';
    for (char *part = text; part;) {
        char *next = strchr(part, ';');
        int length = next ? (int)(next - part) + 1 : 0;
        if (next)
            *next++ = '\0';
        enum mk_status st = split(l, part, column);
        if (st != MK_OK)
            return st;
        if (l->count > 0) {
            if (out->count == MK_FAULT_RULES_MAX)
                return mk_error_at(l->err, MK_ERR_RANGE, l->file, l->number, column,
                                   "fault script: more than %d rules", MK_FAULT_RULES_MAX);
            struct mk_fault_rule rule = {0};
            if ((st = parse_rule(l, &rule)) != MK_OK)
                return st;
            out->rule[out->count++] = rule;
        }
        column += length;
        part = next;
    }
    return MK_OK;
}

static enum mk_status parse_text(char *text, const char *file, int joints,
                                 struct mk_fault_script *out, struct mk_error *err)
{
    struct line l = {.file = file, .joints = joints, .err = err};
    for (char *p = text; p;) {
        char *next = strchr(p, '\n');
        if (next)
            *next++ = '\0';
        l.number++;
        enum mk_status st = parse_line(&l, p, out);
        if (st != MK_OK)
            return st;
        p = next;
    }
    return MK_OK;
}

static enum mk_status read_file(const char *path, char *buf, size_t size, struct mk_error *err)
{
    enum mk_status st = mk_in_file_check(path, "the fault script", err);
    if (st != MK_OK)
        return st;
    FILE *f = fopen(path, "re");
    if (!f)
        return mk_error_errno(err, errno, path, "cannot open the fault script");
    size_t n = fread(buf, 1, size, f);
    int failed = ferror(f) ? errno : 0;
    fclose(f);
    if (failed)
        return mk_error_errno(err, failed, path, "cannot read fault script");
    if (n == size)
        return mk_error_at(err, MK_ERR_RANGE, path, 0, 0, "fault script: larger than %d bytes",
                           SCRIPT_MAX_BYTES);
    if (memchr(buf, '\0', n))
        return mk_error_at(err, MK_ERR_PARSE, path, 0, 0, "fault script: not a text file");
    const size_t mark = mk_byte_order_mark(buf, n);
    memmove(buf, buf + mark, n - mark);
    buf[n - mark] = '\0';
    return MK_OK;
}

static bool is_inline(const char *source)
{
    return strncmp(source, "at ", 3) == 0 || strncmp(source, "from ", 5) == 0 ||
           strpbrk(source, ";\n") != NULL;
}

enum mk_status mk_fault_script_read(const char *source, int joints, struct mk_fault_script *out,
                                    struct mk_error *err)
{
    memset(out, 0, sizeof *out);
    if (!source || !source[0])
        return MK_OK;
    char *text = malloc(SCRIPT_MAX_BYTES + 1);
    if (!text)
        return mk_error_set(err, MK_ERR_NOMEM, "no memory for the fault script");
    bool inside = is_inline(source);
    enum mk_status st = MK_OK;
    if (!inside)
        st = read_file(source, text, SCRIPT_MAX_BYTES + 1, err);
    else if (strlen(source) > SCRIPT_MAX_BYTES)
        st =
            mk_error_set(err, MK_ERR_RANGE, "fault script: larger than %d bytes", SCRIPT_MAX_BYTES);
    else
        strcpy(text, source);
    if (st == MK_OK)
        st = parse_text(text, inside ? "(fault script)" : source, joints, out, err);
    free(text);
    return st;
}

static void apply(const struct mk_fault_rule *r, struct mk_fault_effects *out)
{
    switch (r->action) {
    case MK_FAULT_DROP:
        out->drop = true;
        break;
    case MK_FAULT_MUTE:
        out->mute = true;
        break;
    case MK_FAULT_DELAY:
        out->delay_s += r->value;
        break;
    case MK_FAULT_STICK:
        out->stuck[r->joint] = true;
        break;
    case MK_FAULT_SLIP:
        out->slip[r->joint] += (int32_t)lround(r->value);
        break;
    case MK_FAULT_NOISE:
        out->noise_counts = hypot(out->noise_counts, r->value);
        break;
    case MK_FAULT_SATURATE:
        out->u_limit = fmin(out->u_limit, r->value);
        break;
    case MK_FAULT_ALARM:
        out->alarm = true;
        break;
    case MK_FAULT_DISCONNECT:
        out->disconnect = true;
        break;
    case MK_FAULT_ACTION_COUNT:
        break;
    }
}

void mk_fault_script_at(const struct mk_fault_script *script, uint64_t sample,
                        struct mk_fault_effects *out)
{
    memset(out, 0, sizeof *out);
    out->u_limit = INFINITY;
    for (int i = 0; i < script->count; i++) {
        const struct mk_fault_rule *r = &script->rule[i];
        if (sample >= r->first && sample < r->end)
            apply(r, out);
    }
}
