#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "episode.h"

static const char *const setups[] = {"pendubot-mid", "pendubot-top", "reaction-wheel",
                                     "furuta",       "pi-speed",     "open-loop"};
#define SETUPS ((int)(sizeof setups / sizeof setups[0]))

double draw_between(struct mk_random *random, double low, double high)
{
    return low + (high - low) * mk_random_uniform(random);
}

int draw_below(struct mk_random *random, int n)
{
    return (int)(mk_random_uniform(random) * n);
}

static void add(struct script *s, const char *fmt, ...) MK_PRINTF(2, 3);
static void add(struct script *s, const char *fmt, ...)
{
    va_list args;
    if (s->count == EPISODE_LINES)
        return;
    va_start(args, fmt);
    vsnprintf(s->line[s->count++], sizeof s->line[0], fmt, args);
    va_end(args);
}

static void draw_rule(struct mk_random *r, char *text, size_t size)
{
    int at = (int)pow(10.0, draw_between(r, 0.0, 4.3)); /* often early, sometimes late */
    int length = (int)pow(10.0, draw_between(r, 0.0, 2.5));
    switch (draw_below(r, 11)) {
    case 0:
        snprintf(text, size, "at %d drop %d", at, length);
        break;
    case 1:
        snprintf(text, size, "at %d mute %d", at, length);
        break;
    case 2:
        snprintf(text, size, "at %d delay %dus", at, draw_below(r, 40000));
        break;
    case 3:
        snprintf(text, size, "at %d stuck 1 for %d", at, 10 * length);
        break;
    case 4:
        snprintf(text, size, "at %d jump 1 by %d", at, draw_below(r, 2000) - 1000);
        break;
    case 5:
        snprintf(text, size, "from %d to %d noise %.3g", at, at + length, draw_between(r, 0.1, 20));
        break;
    case 6:
        snprintf(text, size, "at %d saturate %.3g for %d", at, draw_between(r, 0.0, 8.0), length);
        break;
    case 7:
        snprintf(text, size, "at %d alarm", at);
        break;
    case 8:
        snprintf(text, size, "at %d disconnect", at);
        break;
    case 9:
        snprintf(text, size, "at %d stuck 1", at);
        break;
    default:
        snprintf(text, size, "from %d to %d delay %dus", at, at + length, draw_below(r, 3000));
    }
}

static void draw_faults(struct script *s, struct mk_random *r)
{
    char text[400] = "";
    int n = draw_below(r, 5);
    for (int i = 0; i < n; i++) {
        char rule[80];
        draw_rule(r, rule, sizeof rule);
        snprintf(text + strlen(text), sizeof text - strlen(text), "%s%s", i ? "; " : "", rule);
    }
    if (n > 0)
        add(s, "faults %s", text);
    s->faults += n;
}

/* A parameter near what it is, or anywhere in its range. */
static void draw_change(struct script *s, struct mk_random *r, const struct mk_ctrl_ops *setup)
{
    const struct mk_ctrl_param *p = &setup->param[draw_below(r, setup->param_count)];
    double low = fmax(p->min, -1e4), high = fmin(p->max, 1e4), x = draw_between(r, low, high);
    if (!isnan(p->initial) && draw_below(r, 3) > 0)
        x = fmin(high, fmax(low, p->initial * draw_between(r, 0.5, 1.6)));
    add(s, "set %s %.6g", p->name, x);
    s->changes++;
}

static void draw_input(struct script *s, struct mk_random *r, const char *setup)
{
    bool open = strcmp(setup, "open-loop") == 0;
    double size = draw_between(r, 0.2, open ? 4.0 : 60.0);
    char text[64];
    switch (draw_below(r, 5)) {
    case 0:
        snprintf(text, sizeof text, "sin(%.3g*t)", draw_between(r, 0.5, 20.0));
        break;
    case 1:
        snprintf(text, sizeof text, "square(%.3g)", draw_between(r, 0.1, 4.0));
        break;
    case 2:
        snprintf(text, sizeof text, "noise(%.3g,3)", draw_between(r, 1.0, 40.0));
        break;
    case 3:
        snprintf(text, sizeof text, "chirp(0.1,%.3g,5)", draw_between(r, 1.0, 20.0));
        break;
    default:
        snprintf(text, sizeof text, "step(%.3g)", draw_between(r, 0.0, 2.0));
    }
    add(s, "%s %.3g*%s", open ? "input" : "ref", size, text);
}

static void draw_run(struct script *s, struct mk_random *r, const struct mk_ctrl_ops *setup,
                     double longest)
{
    if (draw_below(r, 3) == 0)
        draw_change(s, r, setup);
    if (draw_below(r, 12) == 0)
        add(s, "log %s", draw_below(r, 3) ? "on" : "off");
    add(s, "start");
    for (int n = draw_below(r, 5); n >= 0; n--) {
        double t = longest * pow(10.0, draw_between(r, -2.0, 0.0));
        switch (draw_below(r, 8)) {
        case 0:
            draw_change(s, r, setup);
            break;
        case 1:
            add(s, "wait-until balanced within %.3g", t);
            break;
        case 2:
            add(s, "expect |u| < 9 for %.3g", 0.2 * t);
            break;
        case 3:
            add(s, "wait-until |q1| > 2 within %.3g", t);
            break;
        default:
            add(s, "wait %.3g", t);
        }
    }
    if (draw_below(r, 10) == 0)
        add(s, "estop");
    add(s, "halt");
    add(s, "ack");
    if (draw_below(r, 4) == 0)
        add(s, "save kept.csv");
}

static enum mk_plant_kind draw_plant(struct mk_random *r, const struct mk_ctrl_ops *setup)
{
    int kind = draw_below(r, MK_PLANT_COUNT);
    while (!(setup->plants & (1u << kind)))
        kind = (kind + 1) % MK_PLANT_COUNT;
    return (enum mk_plant_kind)kind;
}

void script_draw(struct script *s, struct mk_random *r, bool real_time)
{
    memset(s, 0, sizeof *s);
    for (int blocks = 1 + draw_below(r, 2); blocks > 0; blocks--) {
        const char *name = setups[draw_below(r, SETUPS)];
        const struct mk_ctrl_ops *setup = mk_ctrl_setup_by_name(name);
        bool open = strcmp(name, "open-loop") == 0;
        add(s, "model models/%s.ini", mk_plant(draw_plant(r, setup))->name);
        if (draw_below(r, 3) == 0)
            add(s, "rate %d", 100 + 50 * draw_below(r, real_time ? 10 : 39));
        if (draw_below(r, 2) == 0)
            add(s, "seed %d", 1 + draw_below(r, 1000));
        draw_faults(s, r);
        if (open || strcmp(name, "pi-speed") == 0)
            draw_input(s, r, name);
        add(s, "setup %s", name);
        for (int runs = 1 + draw_below(r, 3); runs > 0; runs--)
            draw_run(s, r, setup, real_time ? 1.0 : 60.0);
    }
}
