#include "console/commands/budget.h"

#include <math.h>
#include <string.h>

enum { LABEL = 50 }; /* columns of a row's label */

/* Times the noise of the readings: what is no farther is as good as read. */
static const double AT_NOISE = 2.0;

/* Errors of the joints in thousandths of their unit: mrad, mm. */
static void print_row(FILE *out, const struct mk_explanation *e, const char *label,
                      const double *rms)
{
    fprintf(out, "  %-*.*s", LABEL, LABEL, label);
    for (int j = 0; j < mk_model_joints(&e->given); j++)
        fprintf(out, " %9.3g", 1e3 * rms[j]);
}

static void print_item(FILE *out, const struct mk_explanation *e, const struct mk_budget_item *item)
{
    char name[160], label[168];
    mk_budget_item_name(e, item, name, sizeof name);
    snprintf(label, sizeof label, "  + %s", name);
    /* A long name has a line of its own. */
    if (strlen(label) > LABEL) {
        fprintf(out, "  %s\n", label);
        label[0] = 0;
    }
    print_row(out, e, label, item->rms);
    fprintf(out, "  %4.0f %%  [%.0f .. %.0f]\n", 100.0 * item->share, 100.0 * item->low,
            100.0 * item->high);
    for (int i = 0; i < e->rival_count; i++) {
        const struct mk_rival *r = &e->rival[i];
        if (item->cause < 0 || r->instead_of != item->cause || r->distinguishable)
            continue;
        fprintf(out, "      or: %s", r->effect->name);
        fprintf(out, r->joint > 0 ? " at joint %d\n" : "\n", r->joint);
    }
}

static void print_rest(FILE *out, const struct mk_explanation *e)
{
    const struct mk_budget *b = &e->budget;
    if (b->rest_joint == 0)
        return;
    char label[] = "unexplained";
    fprintf(out, "  %-*s", LABEL + 10 * mk_model_joints(&e->given), label);
    fprintf(out, "  %4.0f %%  most at joint %d", 100.0 * b->rest, b->rest_joint);
    for (int i = 0; i < b->goes_with_count; i++)
        fprintf(out, "%s%s", i ? ", " : "; it goes with ", b->goes_with[i]);
    fprintf(out, "\n");
}

/* A share of a large gap rounds to all of it while much is left, in units of what can be read. */
static void print_times_noise(FILE *out, const struct mk_explanation *e)
{
    const struct mk_budget *b = &e->budget;
    double most = 0.0;
    for (int j = 0; j < mk_model_joints(&e->given); j++)
        if (b->noise[j] > 0.0)
            most = fmax(most, b->extended[j] / b->noise[j]);
    if (most > AT_NOISE)
        fprintf(out, "  %.2g times the noise", most);
}

void budget_print(FILE *out, const struct mk_explanation *e)
{
    const struct mk_budget *b = &e->budget;
    char head[80];
    const char *unit = mk_model_unit(&e->given, 0, "mrad");
    const char *other = mk_model_unit(&e->given, mk_model_joints(&e->given) - 1, "mrad");
    bool same = strcmp(unit, other) == 0;
    snprintf(head, sizeof head, "Free runs of %g s on held-out data, rms in %s%s%s", e->window_s,
             unit, same ? "" : ", ", same ? "" : other);
    fprintf(out, "%-*s", LABEL + 2, head);
    for (int j = 0; j < mk_model_joints(&e->given); j++)
        fprintf(out, "   joint %d", j + 1);
    fprintf(out, "  share of the gap\n");
    if (e->held_back)
        fprintf(out, "  (held back: the last log from %.3g to %.3g s)\n", e->held_from, e->held_to);
    print_row(out, e, "given model", b->given);
    fprintf(out, "\n");
    print_row(out, e, "refitted", b->refit);
    fprintf(out, b->item_count > 0 ? "   100 %%\n" : "\n");
    for (int i = 0; i < b->item_count; i++)
        print_item(out, e, &b->item[i]);
    if (b->item_count > 0) {
        print_row(out, e, "extended", b->extended);
        fprintf(out, "  %4.0f %%", 100.0 * b->closed);
        print_times_noise(out, e);
        fprintf(out, "\n");
        print_rest(out, e);
    }
    print_row(out, e, "readings' own noise", b->noise);
    fprintf(out, "\n");
}
