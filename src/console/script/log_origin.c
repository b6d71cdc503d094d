#include "console/script/log_origin.h"

#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/origin.h"
#include "mechkit/number.h"

static void put(struct log_origin *o, const char *text)
{
    size_t n = strlen(text), room = sizeof o->text - o->used - 1;
    n = n < room ? n : room;
    memcpy(o->text + o->used, text, n);
    o->used += n;
    o->text[o->used] = '\0';
}

static void put_number(struct log_origin *o, const char *name, double value)
{
    char number[MK_NUMBER_MAX];
    mk_format_double(number, value);
    put(o, " ");
    put(o, name);
    put(o, "=");
    put(o, number);
}

/* A value begins at the end of the text and reaches as far as is put until `finish`. */
static char *begin(struct log_origin *o)
{
    return o->text + o->used;
}

static void finish(struct log_origin *o, const char *key, char *value)
{
    if (o->used + 1 < sizeof o->text)
        o->used++; /* behind its zero */
    o->text[o->used] = '\0';
    /* The log's own list has writable strings; the writer only reads these. */
    o->row[o->count++] = (struct mk_log_meta){(char *)(uintptr_t)key, value};
}

static void put_text(struct log_origin *o, const char *key, const char *text)
{
    char *value = begin(o);
    put(o, text);
    finish(o, key, value);
}

/* "pendubot p1=0.054 p2=0.011; backlash joint 2 width=0.02 ..." */
static void put_values(struct log_origin *o, const char *key, const struct mk_model *model)
{
    const struct mk_plant_info *plant = mk_plant(model->plant);
    char *value = begin(o);
    put(o, plant->name);
    for (int i = 0; i < plant->parameter_count; i++)
        put_number(o, plant->parameter[i].name, model->parameter[i]);
    for (int k = 0; k < model->effect_count; k++) {
        const struct mk_effect_use *use = &model->effect[k];
        const struct mk_effect_info *info = mk_effect(use->index);
        put(o, "; ");
        put(o, info->name);
        if (use->joint > 0)
            put(o, use->joint == 1 ? " joint 1" : " joint 2");
        for (int i = 0; i < info->parameter_count; i++)
            put_number(o, info->parameter[i].name, use->value[i]);
    }
    finish(o, key, value);
}

void log_origin_of(struct log_origin *o, const struct session *s)
{
    char date[MK_DATE_TEXT], host[256] = "";
    memset(o, 0, sizeof *o);
    if (!s->options.fast || getenv("SOURCE_DATE_EPOCH"))
        put_text(o, "date", mk_date_text(date));
    if (!s->options.fast && gethostname(host, sizeof host - 1) == 0)
        put_text(o, "host", host);
    put_text(o, "model", s->have_model && s->model_path[0] ? s->model_path : "the setup's own");
    put_values(o, "model_values", &s->model);
    if (!s->have_nominal)
        return;
    put_text(o, "believed", s->nominal_path);
    put_values(o, "believed_values", &s->nominal);
}
