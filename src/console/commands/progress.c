#include "console/commands/progress.h"

#include <math.h>
#include <stdio.h>
#include <time.h>
#include <unistd.h>

#define WIDTH 64
/* Below, what has passed says little of what is to come. */
#define ENOUGH_DONE 0.05
#define ENOUGH_S 1.0

static double now_s(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

bool progress_begin(struct progress *p)
{
    *p = (struct progress){.begin_s = now_s(), .percent = -1, .second = -1};
    return isatty(STDERR_FILENO);
}

const char *progress_text(struct progress *p, double passed_s, double done, const char *what,
                          char *buf, size_t size)
{
    char share[16] = "", expected[40] = "";
    p->most = fmax(p->most, fmin(done, 1.0));
    if (p->most > 0.0)
        snprintf(share, sizeof share, "%3.0f %%, ", floor(100.0 * p->most));
    if (p->most >= ENOUGH_DONE && passed_s >= ENOUGH_S)
        snprintf(expected, sizeof expected, " of about %.0f s",
                 fmax(passed_s, ceil(passed_s / p->most)));
    snprintf(buf, size, "%s%.0f s%s: %.24s", share, passed_s, expected, what);
    return buf;
}

bool progress_show(void *context, double done, const char *what)
{
    struct progress *p = context;
    char text[120];
    double passed_s = now_s() - p->begin_s;
    progress_text(p, passed_s, done, what, text, sizeof text);
    int percent = (int)(100.0 * p->most), second = (int)passed_s;
    if (percent == p->percent && second == p->second)
        return true;
    p->percent = percent;
    p->second = second;
    p->shown = true;
    fprintf(stderr, "\r%-*.*s", WIDTH, WIDTH, text);
    return true;
}

void progress_end(struct progress *p)
{
    if (p->shown)
        fprintf(stderr, "\r%*s\r", WIDTH, "");
    p->shown = false;
}
