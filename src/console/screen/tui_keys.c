/* The keys of the main screen: one table for what they do, when they do it, and what the help says.
 * A key is a shortcut for a command wherever there is one. */
#include <stdio.h>
#include <string.h>

#include "console/screen/tui.h"

struct binding {
    int key;
    const char *name;  /* as shown */
    const char *label; /* in the line of keys; "": in the help only */
    const char *help;  /* "": told beside the key before */
    bool (*can)(const struct tui *t);
    void (*act)(struct tui *t);
};

/* --- when ------------------------------------------------------------------------------------ */

static bool always(const struct tui *t)
{
    (void)t;
    return true;
}

static bool is_faulted(const struct tui *t)
{
    return t->status.have_loop && t->status.snap.state == MK_LOOP_FAULTED && !t->status.running;
}

static bool can_start(const struct tui *t)
{
    return t->status.setup && !t->status.running && !t->status.doing[0] && !is_faulted(t);
}

static bool is_active(const struct tui *t)
{
    return t->status.running || t->status.doing[0];
}

static bool is_stopped(const struct tui *t)
{
    return !t->status.running && !t->status.doing[0];
}

static bool has_setup(const struct tui *t)
{
    return t->status.setup != NULL;
}

static bool has_log(const struct tui *t)
{
    return is_stopped(t) && t->status.log_path[0];
}

static bool has_samples(const struct tui *t)
{
    return (t->in_log ? t->log.count : t->live.count) > 0;
}

static bool can_leave_something(const struct tui *t)
{
    return t->card.shown || t->in_log || t->live.cursor_on || t->live.frozen;
}

/* --- what ------------------------------------------------------------------------------------ */

static void estop(struct tui *t)
{
    t->door.estop(t->door.user);
}

static void halt(struct tui *t)
{
    t->door.halt(t->door.user);
}

static void start(struct tui *t)
{
    tui_post(t, "start");
}

static void acknowledge(struct tui *t)
{
    tui_post(t, "ack");
}

/* The name says what was run, and when: nothing to think up. */
static void save(struct tui *t)
{
    char text[160];
    snprintf(text, sizeof text, "save %s.csv", t->status.setup ? t->status.setup->name : "run");
    tui_open_prompt(t, ":", text);
}

static void command(struct tui *t)
{
    tui_open_prompt(t, ":", "");
}

static void gains(struct tui *t)
{
    gains_open(t);
    t->mode = MODE_GAINS;
}

static void help(struct tui *t)
{
    t->mode = MODE_HELP;
}

static void quit(struct tui *t)
{
    if (is_active(t))
        t->mode = MODE_QUIT;
    else
        t->leave = true;
}

static void identify(struct tui *t)
{
    tui_post(t, "identify");
}

static void explain(struct tui *t)
{
    tui_post(t, "explain");
}

static void compare(struct tui *t)
{
    tui_post(t, "compare");
}

static void replay(struct tui *t)
{
    tui_post(t, "replay %s", t->status.log_path);
}

static void record(struct tui *t)
{
    if (t->status.record_path[0])
        tui_post(t, "record off");
    else
        tui_open_prompt(t, ":", "record session.cmd");
}

static void freeze(struct tui *t)
{
    struct scope *s = tui_scope_in_view(t);
    if (t->in_log)
        t->playing = !t->playing;
    else
        scope_freeze(s, !s->frozen);
    s->cursor_on = s->cursor_on && s->frozen;
}

static void trigger(struct tui *t)
{
    scope_next_trigger(tui_scope_in_view(t));
}

static void level_up(struct tui *t)
{
    scope_move_level(tui_scope_in_view(t), 1);
}

static void level_down(struct tui *t)
{
    scope_move_level(tui_scope_in_view(t), -1);
}

static void shorter(struct tui *t)
{
    scope_zoom_time(tui_scope_in_view(t), -1);
}

static void longer(struct tui *t)
{
    scope_zoom_time(tui_scope_in_view(t), 1);
}

static void enlarge(struct tui *t)
{
    scope_zoom_value(tui_scope_in_view(t), 1);
}

static void reduce(struct tui *t)
{
    scope_zoom_value(tui_scope_in_view(t), -1);
}

static void fit(struct tui *t)
{
    scope_auto_value(tui_scope_in_view(t));
}

static void next_lane(struct tui *t)
{
    scope_select(tui_scope_in_view(t), 1);
}

static void cursor_left(struct tui *t)
{
    t->playing = false;
    scope_move_cursor(tui_scope_in_view(t), -1);
}

static void cursor_right(struct tui *t)
{
    t->playing = false;
    scope_move_cursor(tui_scope_in_view(t), 1);
}

static void card_up(struct tui *t)
{
    if (t->card.shown)
        t->card.top -= t->card.top > 0;
    else
        scope_select(tui_scope_in_view(t), -1);
}

static void card_down(struct tui *t)
{
    if (t->card.shown)
        t->card.top += t->card.top < t->card.count - 1;
    else
        scope_select(tui_scope_in_view(t), 1);
}

static void earlier(struct tui *t)
{
    t->playing = false;
    scope_pan(tui_scope_in_view(t), -1);
}

static void later(struct tui *t)
{
    t->playing = false;
    scope_pan(tui_scope_in_view(t), 1);
}

static void leave(struct tui *t)
{
    struct scope *s = tui_scope_in_view(t);
    if (t->card.shown)
        t->card.shown = false;
    else if (s->cursor_on)
        s->cursor_on = false;
    else if (t->in_log)
        t->in_log = t->playing = false;
    else
        scope_freeze(s, false);
}

static void suspend(struct tui *t)
{
    t->suspend = true;
}

static void redraw(struct tui *t)
{
    t->redraw = true;
}

/* In order of weight: the line of keys shows as many as fit. */
static const struct binding bindings[] = {
    {' ', "Space", "E-STOP", "motor off at once, anywhere", is_active, estop},
    {'a', "a", "acknowledge", "acknowledge the fault", is_faulted, acknowledge},
    {'h', "h", "halt", "motor off; ends what goes on", is_active, halt},
    {'r', "r", "run", "start, if the links hang still", can_start, start},
    {'s', "s", "setup", "choose what to run", is_stopped, tui_open_setup},
    {'g', "g", "gains", "gains, also while it runs", has_setup, gains},
    {'w', "w", "save", "name the log of the last run", has_log, save},
    {'e', "e", "explain", "what the model gets wrong, why", has_log, explain},
    {'i', "i", "identify", "fit the model to the last run", has_log, identify},
    {'m', "m", "model", "last run beside the model", has_log, compare},
    {'p', "p", "replay", "the last run once more", has_log, replay},
    {TK_ESCAPE, "Esc", "back", "close what is in front", can_leave_something, leave},
    {'f', "f", "freeze", "hold the picture; replay: pause", has_samples, freeze},
    {':', ":", "command", "type a command; Tab completes", always, command},
    {'?', "?", "help", "this list", always, help},
    {'q', "q", "quit", "motor off, end", always, quit},
    {'[', "[ ]", "", "shorter, longer time", always, shorter},
    {']', "", "", "", always, longer},
    {'+', "+ -", "", "enlarge, reduce the chosen lane", has_samples, enlarge},
    {'-', "", "", "", has_samples, reduce},
    {'=', "=", "", "fit it to what is in view", has_samples, fit},
    {TK_TAB, "Tab", "", "choose the next lane", always, next_lane},
    {'t', "t", "", "trigger: off, rise, fall, catch", always, trigger},
    {'>', "> <", "", "raise, lower its level", always, level_up},
    {'<', "", "", "", always, level_down},
    {TK_LEFT, "Left", "", "and Right: cursor, reads out", has_samples, cursor_left},
    {TK_RIGHT, "", "", "", has_samples, cursor_right},
    {TK_PAGE_UP, "PgUp", "", "and PgDn: earlier, later", has_samples, earlier},
    {TK_PAGE_DOWN, "", "", "", has_samples, later},
    {TK_UP, "Up", "", "and Down: scroll; choose a lane", always, card_up},
    {TK_DOWN, "", "", "", always, card_down},
    {'R', "R", "", "record a command file; end", always, record},
    {TK_CTRL('z'), "^Z", "", "motor off, out to the shell", always, suspend},
    {TK_CTRL('l'), "^L", "", "draw the screen anew", always, redraw},
    {TK_CTRL('c'), "^C", "", "as h", is_active, halt},
};
#define BINDINGS ((int)(sizeof bindings / sizeof bindings[0]))

static bool toggle_channel(struct tui *t, int key)
{
    if (key < '1' || key >= '1' + CH_COUNT)
        return false;
    scope_toggle(tui_scope_in_view(t), (enum scope_channel)(key - '1'));
    return true;
}

bool tui_main_key(struct tui *t, int key)
{
    for (int i = 0; i < BINDINGS; i++) {
        if (bindings[i].key != key)
            continue;
        if (!bindings[i].can(t))
            return false;
        bindings[i].act(t);
        return true;
    }
    return toggle_channel(t, key);
}

void tui_draw_keys(struct tui *t, struct canvas *c, int row)
{
    int col = 1;
    for (int i = 0; i < BINDINGS; i++) {
        const struct binding *b = &bindings[i];
        int width = tui_columns(b->name) + 1 + tui_columns(b->label) + 2;
        if (!b->label[0] || !b->can(t) || col + width > c->cols)
            continue;
        col = canvas_text(c, row, col, width, b->key == ' ' ? STYLE_BAD : STYLE_KEY, b->name) + 1;
        col = canvas_text(c, row, col, width, STYLE_NORMAL, b->label) + 2;
    }
}

static void draw_help_line(struct canvas *c, struct tui_rect r, const char *name, const char *help,
                           bool can)
{
    canvas_text(c, r.row, r.col, 6, can ? STYLE_KEY : STYLE_DIM, name);
    canvas_text(c, r.row, r.col + 6, r.cols - 7, can ? STYLE_NORMAL : STYLE_DIM, help);
}

/* In one column or two; where there is no room for all, the last ones are left out. */
void tui_draw_help(struct tui *t, struct tui_rect r)
{
    int lines = 1, k = 0;
    for (int i = 0; i < BINDINGS; i++)
        lines += bindings[i].help[0] != '\0';
    int columns = r.rows >= lines ? 1 : 2, each = (lines + columns - 1) / columns;
    each = each < r.rows ? each : r.rows;
    struct tui_rect at = {.rows = 1, .cols = r.cols / columns};
    for (int i = 0; i <= BINDINGS && k < each * columns; i++) {
        if (i < BINDINGS && !bindings[i].help[0])
            continue;
        at.row = r.row + k % each;
        at.col = r.col + k++ / each * at.cols;
        if (i < BINDINGS)
            draw_help_line(&t->canvas, at, bindings[i].name, bindings[i].help, bindings[i].can(t));
        else
            draw_help_line(&t->canvas, at, "1..6", "q1 q2 dq1 dq2 u ref on, off", true);
    }
}
