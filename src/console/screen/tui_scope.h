/* The scope: samples of a run, or a log with a prediction beside it, over time in lanes. Pure: it
 * knows neither session nor terminal. */
#ifndef MECHKIT_CONSOLE_SCREEN_TUI_SCOPE_H
#define MECHKIT_CONSOLE_SCREEN_TUI_SCOPE_H

#include "console/screen/tui_canvas.h"
#include "mechkit/log.h"
#include "mechkit/loop.h"

enum scope_channel { CH_Q1, CH_Q2, CH_V1, CH_V2, CH_U, CH_REF, CH_COUNT };
/* Predictions are drawn into the lanes of q1 and q2. */
enum { CH_MODEL1 = CH_COUNT, CH_MODEL2, CH_STORED };

enum scope_trigger { TRIGGER_OFF, TRIGGER_RISING, TRIGGER_FALLING, TRIGGER_CATCH, TRIGGER_COUNT };

struct scope_point {
    double t;
    float y[CH_STORED];
    float late_us;
    uint16_t flags;
    uint8_t phase;
};

struct scope {
    struct scope_point *point; /* a ring of `room`; the newest are kept */
    size_t room, first, count;
    int joints;
    bool has_ref, has_model;
    /* Whole turns that are left out of angles, rad: of an upright that was reached the other way
     * round. Readings and logs go on counting. */
    double turns[MK_MAX_JOINTS];
    const struct mk_plant_info *plant; /* NULL: not known yet */

    unsigned shown; /* bits of channels */
    enum scope_channel selected;
    double window_s;
    double half_range[CH_COUNT]; /* set by hand; 0: fits what is in the window */
    double centre[CH_COUNT];
    bool frozen;
    double end_t; /* right edge when frozen */
    enum scope_trigger trigger;
    double level; /* of the selected channel */
    bool cursor_on;
    double cursor_t;
    bool waiting; /* for the trigger; set when drawn */
};

MK_NODISCARD enum mk_status scope_init(struct scope *s, size_t room);
void scope_free(struct scope *s);
/* Forgets samples, keeps settings; another plant gets the lanes that tell most about it. */
void scope_clear(struct scope *s, const struct mk_plant_info *plant);
void scope_add(struct scope *s, const struct mk_sample *sample);
/* A whole log, with the prediction of its rows (may be NULL). MK_ERR_NOMEM. */
MK_NODISCARD enum mk_status scope_load(struct scope *s, const struct mk_log *log,
                                       const struct mk_log *model);

const struct scope_point *scope_at(const struct scope *s, size_t index); /* 0: oldest kept */
/* The last point at or before t; NULL: none. */
const struct scope_point *scope_find(const struct scope *s, double t);
double scope_first_t(const struct scope *s);
double scope_last_t(const struct scope *s);

/* Settings, as keys change them. */
void scope_zoom_time(struct scope *s, int steps);
void scope_zoom_value(struct scope *s, int steps);
void scope_auto_value(struct scope *s);
void scope_toggle(struct scope *s, enum scope_channel ch);
void scope_select(struct scope *s, int step);
void scope_freeze(struct scope *s, bool on);
void scope_next_trigger(struct scope *s);
void scope_move_level(struct scope *s, int steps);
void scope_move_cursor(struct scope *s, int steps);
void scope_pan(struct scope *s, int windows);

const char *scope_channel_name(enum scope_channel ch);
bool scope_has(const struct scope *s, enum scope_channel ch);
/* One line: window, trigger, freeze, cursor. */
void scope_caption(const struct scope *s, char *buf, size_t size);
void scope_draw(struct scope *s, struct canvas *c, struct tui_rect r);

#endif
