/* The screen: what is shown of a session, and what keys do. It sees the session through a copy of
 * its state and a door for command lines, so tests and tools can put anything behind it.
 *
 * tui_keys.c  the table of keys           tui_view.c   layout and panels
 * tui_mode.c  chooser, help, questions    tui_gains.c  the gains editor
 * tui_prompt.c  the command line          tui_scope.c, tui_rig.c  pictures
 */
#ifndef MECHKIT_CONSOLE_SCREEN_TUI_H
#define MECHKIT_CONSOLE_SCREEN_TUI_H

#include "console/screen/tui_canvas.h"
#include "console/screen/tui_gains.h"
#include "console/screen/tui_prompt.h"
#include "console/screen/tui_scope.h"
#include "console/screen/tui_term.h"
#include "console/script/host.h"

#define TUI_EVENTS 200
#define TUI_CARD_LINES 60
#define TUI_MIN_ROWS 16
#define TUI_MIN_COLS 60

/* Where keys lead. */
struct tui_door {
    void *user;
    void (*post)(void *user, const char *line);
    void (*halt)(void *user);
    void (*estop)(void *user);
    void (*cancel)(void *user);
};

enum tui_mode { MODE_MAIN, MODE_PROMPT, MODE_SETUP, MODE_GAINS, MODE_HELP, MODE_QUIT };

/* What a command had to say, or the summary of a run: stays until it is dismissed. */
struct tui_card {
    char title[80];
    char line[TUI_CARD_LINES][HOST_TEXT];
    int count, top;
    bool shown;
};

struct tui {
    struct tui_door door;
    struct canvas canvas;
    struct host_status status;
    struct mk_sample newest; /* of the run, while there is one */
    bool have_newest;
    struct host_event event[TUI_EVENTS]; /* oldest first */
    int events;
    struct tui_card card, collecting;

    struct scope live, log;
    bool in_log;  /* the log is shown instead of the run */
    bool playing; /* and moves on */
    double play_t, play_speed;
    char log_name[80];
    bool log_slides[MK_MAX_JOINTS];
    enum mk_plant_kind log_plant;

    enum tui_mode mode;
    int chosen; /* row of the setup chooser */
    struct tui_gains gains;
    struct tui_prompt prompt;
    bool blank_typed; /* the last key was a blank in a text */
    bool was_running;
    bool leave, suspend, redraw;
    double clock_s; /* monotonic, given from outside */
    char clock[16]; /* wall clock as shown */
};

MK_NODISCARD enum mk_status tui_init(struct tui *t, const struct tui_door *door);
void tui_free(struct tui *t);

/* News from the session. */
void tui_set_status(struct tui *t, const struct host_status *status);
void tui_add_event(struct tui *t, const struct host_event *e);
void tui_add_sample(struct tui *t, const struct mk_sample *s);
/* Takes over the logs. */
void tui_show_log(struct tui *t, struct host_show *show);
/* Time goes on: replay moves. */
void tui_tick(struct tui *t, double clock_s);

void tui_key(struct tui *t, int key);
void tui_draw(struct tui *t, int rows, int cols);

/* --- between the files of the screen --------------------------------------------------------- */

void tui_post(struct tui *t, const char *fmt, ...) MK_PRINTF(2, 3);
struct scope *tui_scope_in_view(struct tui *t);
/* One key of the main screen; false: it means nothing there. tui_keys.c. */
bool tui_main_key(struct tui *t, int key);
/* The keys that can be pressed now, in order of weight, into one line. */
void tui_draw_keys(struct tui *t, struct canvas *c, int row);
void tui_draw_help(struct tui *t, struct tui_rect r);
/* tui_mode.c */
void tui_mode_key(struct tui *t, int key);
void tui_draw_mode(struct tui *t, struct tui_rect body);
int tui_setup_count(void);
void tui_open_setup(struct tui *t);
void tui_open_prompt(struct tui *t, const char *label, const char *text);
/* tui_check.c: what to look at before a start. */
void tui_draw_check(struct tui *t, struct tui_rect r);

#endif
