#include "console/script/condition.h"
#include "base/text.h"

#include <ctype.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "mechkit/number.h"

#define MAX_DEPTH 20
#define HELD_S 0.5 /* balanced for less is still being caught */

struct parser {
    const char *text, *at;
    const struct mk_loop_snapshot *snap;
    struct mk_error *err;
    enum mk_status status;
    int depth;
};

static double fail(struct parser *p, const char *what)
{
    if (p->status == MK_OK)
        p->status = mk_error_at(p->err, MK_ERR_PARSE, NULL, 0, (int)(p->at - p->text) + 1,
                                "condition '%s': %s at character %d", p->text, what,
                                (int)(p->at - p->text) + 1);
    return (double)NAN;
}

static void skip_blanks(struct parser *p)
{
    while (*p->at == ' ' || *p->at == '\t')
        p->at++;
}

static size_t word_length(const char *at)
{
    size_t n = 0;
    while (isalnum((unsigned char)at[n]) || at[n] == '_' ||
           (n && at[n] == '-' && isalpha((unsigned char)at[n + 1])))
        n++;
    return n;
}

static bool word_is(const char *at, size_t n, const char *word)
{
    return strlen(word) == n && strncmp(at, word, n) == 0;
}

/* Takes `word` if it comes next as a whole word. */
static bool accept_word(struct parser *p, const char *word)
{
    skip_blanks(p);
    if (!word_is(p->at, word_length(p->at), word))
        return false;
    p->at += strlen(word);
    return true;
}

/* --- numbers ----------------------------------------------------------------------------- */

static bool find_value(const struct mk_loop_snapshot *s, const char *at, size_t n, double *out)
{
    const struct {
        const char *name;
        double value;
    } names[] = {
        {"t", s->sample.t},        {"q1", s->sample.q[0]},      {"q2", s->sample.q[1]},
        {"dq1", s->sample.v[0]},   {"dq2", s->sample.v[1]},     {"u", s->sample.u},
        {"ref", s->sample.ref},    {"late", (double)s->late},   {"overruns", (double)s->overruns},
        {"lost", (double)s->lost}, {"ticks", (double)s->ticks}, {"caught", s->caught_t}};
    for (size_t i = 0; i < sizeof names / sizeof names[0]; i++)
        if (word_is(at, n, names[i].name)) {
            *out = names[i].value;
            return true;
        }
    return false;
}

/* Everything that a condition can name. */
static const char *const known_names[] = {
    "t",    "q1",    "q2",     "dq1",      "dq2",     "u",    "ref",     "late",    "overruns",
    "lost", "ticks", "caught", "balanced", "running", "idle", "faulted", "no-fault"};

static double fail_unknown(struct parser *p, size_t length)
{
    char word[40], text[120], hint[80];
    snprintf(word, sizeof word, "%.*s", (int)length, p->at);
    struct mk_meant meant = {.word = word};
    for (size_t i = 0; i < sizeof known_names / sizeof known_names[0]; i++)
        mk_meant_try(&meant, known_names[i]);
    for (int f = 1; f < MK_FAULT_COUNT; f++)
        mk_meant_try(&meant, mk_fault_name((enum mk_fault)f));
    snprintf(text, sizeof text, "unknown name%s", mk_meant_text(&meant, hint, sizeof hint));
    return fail(p, text);
}

static double sum(struct parser *p);

static double absolute(struct parser *p)
{
    p->at++;
    double value = fabs(sum(p));
    skip_blanks(p);
    if (*p->at != '|')
        return fail(p, "expected |");
    p->at++;
    return value;
}

static double literal(struct parser *p)
{
    const char *from = p->at;
    double value;
    while (isalnum((unsigned char)*p->at) || *p->at == '.' ||
           ((*p->at == '-' || *p->at == '+') && (p->at[-1] == 'e' || p->at[-1] == 'E')))
        p->at++;
    if (*p->at == ',')
        return fail(p, "decimals come after a point");
    if (!mk_parse_double(from, p->at, &value)) {
        p->at = from;
        return fail(p, "not a number");
    }
    if (!isfinite(value)) {
        p->at = from;
        return fail(p, "this number is too large");
    }
    return value;
}

static double named(struct parser *p)
{
    double value;
    const size_t n = word_length(p->at);
    if (n == 0)
        return fail(p, "expected a name or a number");
    if (!find_value(p->snap, p->at, n, &value))
        return fail_unknown(p, n);
    p->at += n;
    return value;
}

static double item(struct parser *p)
{
    double value;
    skip_blanks(p);
    if (++p->depth > MAX_DEPTH)
        return fail(p, "nested too deeply");
    if (*p->at == '-') {
        p->at++;
        value = -item(p);
    } else if (*p->at == '|') {
        value = absolute(p);
    } else if (isdigit((unsigned char)*p->at) || *p->at == '.') {
        value = literal(p);
    } else {
        value = named(p);
    }
    p->depth--;
    return value;
}

static double sum(struct parser *p)
{
    double value = item(p);
    for (;;) {
        skip_blanks(p);
        if (*p->at == '+')
            p->at++, value += item(p);
        else if (*p->at == '-')
            p->at++, value -= item(p);
        else
            return value;
        if (p->status != MK_OK)
            return (double)NAN;
    }
}

/* --- truths ------------------------------------------------------------------------------ */

static bool state_word(struct parser *p, bool *truth)
{
    const struct mk_loop_snapshot *s = p->snap;
    const struct {
        const char *word;
        bool truth;
    } words[] = {{"balanced", s->sample.t - s->balanced_since >= HELD_S},
                 {"running", s->state == MK_LOOP_RUNNING},
                 {"idle", s->state == MK_LOOP_IDLE},
                 {"faulted", s->fault != MK_FAULT_NONE},
                 {"no-fault", s->fault == MK_FAULT_NONE}};
    skip_blanks(p);
    size_t n = word_length(p->at);
    for (size_t i = 0; i < sizeof words / sizeof words[0]; i++)
        if (word_is(p->at, n, words[i].word)) {
            p->at += n;
            *truth = words[i].truth;
            return true;
        }
    for (int f = 1; f < MK_FAULT_COUNT; f++)
        if (word_is(p->at, n, mk_fault_name((enum mk_fault)f))) {
            p->at += n;
            *truth = s->fault == (enum mk_fault)f;
            return true;
        }
    return false;
}

static bool within(struct parser *p, double value)
{
    skip_blanks(p);
    if (*p->at == '-')
        return fail(p, "a tolerance is not negative"), false;
    double tolerance = sum(p);
    skip_blanks(p);
    bool percent = *p->at == '%';
    p->at += percent;
    if (!accept_word(p, "of"))
        return fail(p, "expected 'of'"), false;
    double target = sum(p);
    return fabs(value - target) <= (percent ? tolerance / 100.0 * fabs(target) : tolerance);
}

/* Takes one of < <= > >= == != : its first sign, and whether "=" follows; '\0': there is none. */
static char take_sign(struct parser *p, bool *equal)
{
    const char c = *p->at;
    *equal = c && p->at[1] == '=';
    if (!c || !strchr("<>=!", c) || (strchr("=!", c) && !*equal))
        return '\0';
    p->at += *equal ? 2 : 1;
    return c;
}

static bool compare(double left, char sign, bool equal, double right)
{
    switch (sign) {
    case '<':
        return equal ? left <= right : left < right;
    case '>':
        return equal ? left >= right : left > right;
    case '=':
        return !(left < right) && !(left > right);
    default:
        return left < right || left > right;
    }
}

static bool comparison(struct parser *p)
{
    double left = sum(p);
    bool equal;
    if (p->status != MK_OK)
        return false;
    if (accept_word(p, "within"))
        return within(p, left);
    const char sign = take_sign(p, &equal);
    if (!sign)
        return fail(p, "expected < <= > >= == != or within"), false;
    double right = sum(p);
    return !isnan(left) && !isnan(right) && compare(left, sign, equal, right);
}

static bool evaluate(struct parser *p)
{
    bool all = true;
    do {
        bool truth;
        if (!state_word(p, &truth))
            truth = comparison(p);
        all = all && truth;
    } while (p->status == MK_OK && accept_word(p, "and"));
    skip_blanks(p);
    if (p->status == MK_OK && *p->at)
        fail(p, "expected 'and' or the end");
    return p->status == MK_OK && all;
}

enum mk_status condition_check(const char *text, struct mk_error *err)
{
    static const struct mk_loop_snapshot blank;
    struct parser p = {.text = text, .at = text, .snap = &blank, .err = err};
    (void)evaluate(&p);
    return p.status;
}

bool condition_holds(const char *text, const struct mk_loop_snapshot *snapshot)
{
    struct parser p = {.text = text, .at = text, .snap = snapshot};
    return evaluate(&p);
}
