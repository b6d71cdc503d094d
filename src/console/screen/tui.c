#include "console/screen/tui.h"
#include "console/script/fault_text.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "experiment/linear.h"
#include "mechkit/sim.h"

#define LIVE_POINTS 131072 /* a minute at the highest rate */

enum mk_status tui_init(struct tui *t, const struct tui_door *door)
{
    memset(t, 0, sizeof *t);
    t->door = *door;
    t->status.progress = -1.0;
    t->play_speed = 1.0;
    enum mk_status st = scope_init(&t->live, LIVE_POINTS);
    return st == MK_OK ? scope_init(&t->log, 1) : st;
}

void tui_free(struct tui *t)
{
    scope_free(&t->live);
    scope_free(&t->log);
    canvas_free(&t->canvas);
}

/* --- news ------------------------------------------------------------------------------------ */

static void card_line(struct tui_card *card, const char *fmt, ...) MK_PRINTF(2, 3);
static void card_line(struct tui_card *card, const char *fmt, ...)
{
    va_list args;
    if (card->count == TUI_CARD_LINES)
        return;
    va_start(args, fmt);
    vsnprintf(card->line[card->count++], sizeof card->line[0], fmt, args);
    va_end(args);
}

static void show_steps(struct tui_card *card, const struct run_summary *r)
{
    char line[200];
    for (size_t i = 0; i < r->steps && i < SUMMARY_STEPS; i++)
        card_line(card, "%s",
                  step_response_line(&r->step[i], summary_speed_unit(r), line, sizeof line));
}

static void show_fault(const struct tui *t, struct tui_card *card)
{
    const struct host_status *st = &t->status;
    char value[FAULT_VALUE_SIZE] = "";
    if (st->have_loop)
        fault_value(&st->snap, &st->config.limits, &st->model, value, sizeof value);
    card_line(card, "FAULT     %.120s", st->summary.fault);
    if (value[0])
        card_line(card, "          %s", value);
}

/* What a run was like, in words. */
static void show_summary(struct tui *t)
{
    const struct run_summary *r = &t->status.summary;
    struct tui_card *card = &t->card;
    *card = (struct tui_card){.shown = true};
    snprintf(card->title, sizeof card->title, "after the run: %s, %.2f s", r->setup, r->seconds);
    if (r->fault[0])
        show_fault(t, card);
    if (!isnan(r->caught_t))
        card_line(card, "caught    at %.2f s; %s %.2f s", r->caught_t,
                  r->balanced_at_end ? "then held for"
                  : r->fault[0]      ? "balanced for"
                                     : "lost again after",
                  r->held_s);
    else if (t->status.setup && linear_equilibrium(t->status.model.plant, t->status.setup->name))
        card_line(card, "caught    never");
    for (int j = 0; j < MK_MAX_JOINTS; j++)
        if (!isnan(r->rms[j]))
            card_line(card, "stillness q%d within %.4f %s rms", j + 1, r->rms[j],
                      summary_unit(r, j));
    if (!isnan(r->track_rms))
        card_line(card, "tracking  speed error %.3f %s rms at the end", r->track_rms,
                  summary_speed_unit(r));
    show_steps(card, r);
    if (r->commands > 0)
        card_line(card, "command   %.2f rms, %.2f at most", r->command[0].rms, r->command[0].peak);
    card_line(card, "loop      %.0f us late at most; %zu of %zu late or lost", r->late_max_us,
              r->lost, r->rows);
    card_line(card, "log       %.180s", t->status.log_path);
    card_line(card, "%s", "");
    card_line(card, "w save  m model  i identify  e explain  p replay");
}

void tui_set_status(struct tui *t, const struct host_status *status)
{
    bool new_setup = status->setup != t->status.setup;
    bool started = status->running && !t->was_running;
    bool summed_up = status->have_summary && !t->status.have_summary;
    t->status = *status;
    if (new_setup || started) {
        scope_clear(&t->live, status->setup ? mk_plant(status->model.plant) : NULL);
        t->in_log = t->playing = t->have_newest = false;
        t->card.shown = false;
    }
    if (summed_up)
        show_summary(t);
    t->was_running = status->running;
}

/* A command that says more than a line or two gets a card; the summary of a run has one already. */
static void collect(struct tui *t, const struct host_event *e)
{
    struct tui_card *card = &t->collecting;
    if (e->kind == HOST_COMMAND) {
        *card = (struct tui_card){.shown = true};
        snprintf(card->title, sizeof card->title, "%.79s", e->text);
    } else if (e->kind == HOST_SAYS) {
        card_line(card, "%s", e->text);
        if (card->count > 2) {
            t->card = *card;
            t->card.shown = true;
        }
    }
}

void tui_add_event(struct tui *t, const struct host_event *e)
{
    if (t->events == TUI_EVENTS) {
        memmove(t->event, t->event + 1, sizeof t->event - sizeof t->event[0]);
        t->events--;
    }
    t->event[t->events++] = *e;
    collect(t, e);
}

void tui_add_sample(struct tui *t, const struct mk_sample *s)
{
    scope_add(&t->live, s);
    t->newest = *s;
    t->have_newest = true;
}

void tui_show_log(struct tui *t, struct host_show *show)
{
    const char *rig = mk_log_find_meta(show->log, "rig");
    const struct mk_plant_info *plant = rig ? mk_plant_by_name(rig) : NULL;
    scope_clear(&t->log, plant ? plant : mk_plant(t->status.model.plant));
    t->log_plant = plant ? plant->kind : t->status.model.plant;
    for (int j = 0; j < MK_MAX_JOINTS; j++)
        t->log_slides[j] = mk_record_joint_slides(show->log, j);
    if (scope_load(&t->log, show->log, show->model) == MK_OK) {
        const char *slash = show->log->path ? strrchr(show->log->path, '/') : NULL;
        const char *name = slash ? slash + 1 : show->log->path ? show->log->path : "";
        snprintf(t->log_name, sizeof t->log_name, "%s", name);
        t->in_log = true;
        t->card.shown = false;
        t->playing = show->play;
        t->play_t = scope_first_t(&t->log);
        t->log.frozen = true;
        t->log.end_t = show->play ? t->play_t : scope_last_t(&t->log);
        t->log.window_s = show->play ? t->live.window_s : fmin(20.0, t->live.window_s);
    }
    mk_log_free(show->log);
    mk_log_free(show->model);
    *show = (struct host_show){NULL, NULL, false};
}

void tui_tick(struct tui *t, double clock_s)
{
    double passed = t->clock_s > 0.0 ? clock_s - t->clock_s : 0.0;
    t->clock_s = clock_s;
    if (!t->in_log || !t->playing)
        return;
    t->play_t = fmin(t->log.end_t + passed * t->play_speed, scope_last_t(&t->log));
    t->log.end_t = t->play_t;
    if (t->play_t >= scope_last_t(&t->log))
        t->playing = false;
}

/* --- keys ------------------------------------------------------------------------------------ */

void tui_key(struct tui *t, int key)
{
    /* A blank stops wherever it is no text; in a text the second in a row does. */
    bool text = t->mode == MODE_PROMPT;
    bool again = t->blank_typed || (text && !t->prompt.text[0]);
    t->blank_typed = key == ' ';
    if (key == ' ' && (!text || again)) {
        t->door.estop(t->door.user);
        return;
    }
    if (key == TK_CTRL('z'))
        t->suspend = true;
    else if (key == TK_CTRL('l'))
        t->redraw = true;
    else if (t->mode == MODE_MAIN)
        tui_main_key(t, key);
    else
        tui_mode_key(t, key);
}
