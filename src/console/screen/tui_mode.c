/* What lies over the main screen: setup chooser, command line, help, question before the end. */
#include <stdio.h>
#include <string.h>

#include "console/screen/tui.h"

/* --- chooser --------------------------------------------------------------------------------- */

static void setup_key(struct tui *t, int key)
{
    int n = tui_setup_count();
    if (key == TK_UP || key == 'k')
        t->chosen = (t->chosen + n - 1) % n;
    else if (key == TK_DOWN || key == 'j')
        t->chosen = (t->chosen + 1) % n;
    else if (key >= '1' && key < '1' + n)
        t->chosen = key - '1';
    else if (key == TK_RETURN)
        tui_post(t, "setup %s", mk_ctrl_setup(t->chosen)->name);
    if (key == TK_RETURN || key == TK_ESCAPE || key == 'q')
        t->mode = MODE_MAIN;
}

static void rigs_of(const struct mk_ctrl_ops *ops, char *buf, size_t size)
{
    size_t used = 0;
    buf[0] = '\0';
    for (int k = 0; k < MK_PLANT_COUNT && used < size; k++)
        if (ops->plants & 1u << k)
            used += (size_t)snprintf(buf + used, size - used, "%s%s", used ? ", " : "",
                                     mk_plant((enum mk_plant_kind)k)->name);
    if (ops->plants == (1u << MK_PLANT_COUNT) - 1)
        snprintf(buf, size, "any rig; say which with --model or :model FILE");
}

/* Where not all setups have room the list scrolls, the chosen one in sight; n is how many are
 * shown. */
static void draw_setup(struct tui *t, struct tui_rect area)
{
    const int count = tui_setup_count(),
              around = 8; /* its frame, the one around that, what stands below */
    struct canvas *c = &t->canvas;
    int room = area.rows >= count + around + 3 ? 3 : 0; /* for the whole of a long line */
    int n = area.rows - around < count ? area.rows - around : count;
    int first = t->chosen < n ? 0 : t->chosen - n + 1;
    struct tui_rect r = {area.row + 1, 2, n + around - 2 + room, c->cols - 4};
    canvas_fill(c, r, ' ', STYLE_NORMAL);
    struct tui_rect in = canvas_frame(c, r, "choose a setup");
    for (int i = first; i < first + n; i++) {
        const struct mk_ctrl_ops *ops = mk_ctrl_setup(i);
        const int row = in.row + i - first;
        enum tui_style style = i == t->chosen ? STYLE_SELECTED : STYLE_NORMAL;
        canvas_fill(c, (struct tui_rect){row, in.col, 1, in.cols}, ' ', style);
        canvas_print(c, row, in.col + 1, in.cols - 1, style, "%c %d  %-16s %s",
                     i == t->chosen ? '>' : ' ', i + 1, ops->name, ops->help);
    }
    if (first > 0)
        canvas_print(c, in.row, in.col + in.cols - 2, 1, STYLE_KEY, "^");
    if (first + n < count)
        canvas_print(c, in.row + n - 1, in.col + in.cols - 2, 1, STYLE_KEY, "v");
    char rigs[120];
    const struct mk_ctrl_ops *chosen = mk_ctrl_setup(t->chosen);
    if (room > 0)
        canvas_wrap(c, (struct tui_rect){in.row + n + 1, in.col + 1, 2, in.cols - 2}, STYLE_NORMAL,
                    chosen->help);
    rigs_of(chosen, rigs, sizeof rigs);
    canvas_print(c, in.row + n + room + 1, in.col + 1, in.cols - 1, STYLE_DIM, "rig: %s", rigs);
    canvas_text(c, in.row + n + room + 3, in.col + 1, in.cols - 1, STYLE_KEY,
                "Up Down choose   Enter takes it   Esc leaves");
}

/* --- command line ---------------------------------------------------------------------------- */

/* `halt` and `estop` do not queue up behind a command that waits. */
static void execute(struct tui *t, const char *line)
{
    const char *word = line + strspn(line, " \t");
    size_t n = strcspn(word, " \t");
    if (n == 4 && strncmp(word, "halt", n) == 0)
        t->door.halt(t->door.user);
    else if (n == 5 && strncmp(word, "estop", n) == 0)
        t->door.estop(t->door.user);
    else if (n > 0)
        tui_post(t, "%s", line);
}

static void prompt_mode_key(struct tui *t, int key)
{
    enum prompt_answer a = prompt_key(&t->prompt, key, &t->status);
    if (a == PROMPT_GOES_ON)
        return;
    t->mode = MODE_MAIN;
    if (a == PROMPT_DONE) {
        prompt_remember(&t->prompt, t->prompt.text);
        execute(t, t->prompt.text);
    }
}

/* --- the end --------------------------------------------------------------------------------- */

static void quit_key(struct tui *t, int key)
{
    if (key == 'y' || key == 'Y') {
        t->door.halt(t->door.user);
        t->leave = true;
    }
    t->mode = MODE_MAIN;
}

static void draw_quit(struct tui *t, struct tui_rect area)
{
    struct canvas *c = &t->canvas;
    struct tui_rect r = {area.row + area.rows / 2 - 2, c->cols / 2 - 26, 5, 52};
    canvas_fill(c, r, ' ', STYLE_NORMAL);
    struct tui_rect in = canvas_frame(c, r, "quit");
    canvas_text(c, in.row, in.col + 1, in.cols - 1, STYLE_WARN,
                t->status.running ? "The motor runs." : "A command is under way.");
    canvas_text(c, in.row + 1, in.col + 1, in.cols - 1, STYLE_NORMAL,
                "y  motor off, log complete, end");
    canvas_text(c, in.row + 2, in.col + 1, in.cols - 1, STYLE_NORMAL, "any other key: go on");
}

/* --- all ------------------------------------------------------------------------------------- */

void tui_mode_key(struct tui *t, int key)
{
    switch (t->mode) {
    case MODE_SETUP:
        setup_key(t, key);
        break;
    case MODE_GAINS:
        gains_key(t, key);
        break;
    case MODE_PROMPT:
        prompt_mode_key(t, key);
        break;
    case MODE_QUIT:
        quit_key(t, key);
        break;
    default:
        t->mode = MODE_MAIN;
        break;
    }
}

static void draw_help(struct tui *t, struct tui_rect area)
{
    canvas_fill(&t->canvas, area, ' ', STYLE_NORMAL);
    struct tui_rect in = canvas_frame(&t->canvas, area, "keys; bright: what can be done now");
    in.col++, in.cols--;
    tui_draw_help(t, in);
}

void tui_draw_mode(struct tui *t, struct tui_rect body)
{
    struct canvas *c = &t->canvas;
    if (t->mode == MODE_PROMPT) {
        canvas_fill(c, (struct tui_rect){c->rows - 2, 0, 2, c->cols}, ' ', STYLE_NORMAL);
        prompt_draw(&t->prompt, c, c->rows - 1);
        return;
    }
    int col = canvas_text(c, c->rows - 1, 1, 20, STYLE_BAD, "Space");
    canvas_text(c, c->rows - 1, col + 1, 20, STYLE_NORMAL, "E-STOP");
    if (t->mode == MODE_SETUP)
        draw_setup(t, body);
    else if (t->mode == MODE_GAINS)
        gains_draw(t, (struct tui_rect){body.row, 0, body.rows, gains_columns(c->cols)});
    else if (t->mode == MODE_HELP)
        draw_help(t, body);
    else
        draw_quit(t, body);
}
