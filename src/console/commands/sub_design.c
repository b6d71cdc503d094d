/* mechkit design: linearisation, controllability, gains, poles. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "console/commands/design_swingup.h"
#include "console/commands/options.h"
#include "experiment/linear.h"
#include "mechkit/design.h"
#include "mechkit/json.h"
#include "mechkit/model.h"
#include "mechkit/number.h"

#define STATES LINEAR_STATES

struct options {
    const char *model, *at, *json;
    const char *poles, *lqr, *lqrd, *gains;
    double rate;
    bool friction, delay;
    struct swingup_request swingup;
};

struct result {
    int n; /* gains; one more than states when there is a delay */
    double k[STATES + 1];
    double re[STATES + 1], im[STATES + 1]; /* closed loop; of the samples (z) when `sampled` */
    bool sampled;
};

static const struct option_row option_rows[] = {
    {"model", OPTION_TEXT(model), "M.ini", "the rig", .required = true},
    {"at", OPTION_TEXT(at), "NAME", "equilibrium, as hanging, mid, top; default: the inverted one"},
    {"poles", OPTION_TEXT(poles), "LIST", "place the poles, e.g. \"-10 -10 -5+3i -5-3i\""},
    {"lqr", OPTION_TEXT(lqr), "LIST",
     "continuous LQR: weights of the states; of u, e.g. \"10 1 10 1; 0.5\""},
    {"lqrd", OPTION_TEXT(lqrd), "LIST", "the same problem for a command held between samples"},
    {"delay", OPTION_FLAG(delay), NULL,
     "with --lqrd: the command acts a sample late; one more gain"},
    {"gains", OPTION_TEXT(gains), "LIST", "no design: the closed loop of these gains"},
    {"rate", OPTION_NUMBER(rate), "HZ", "sample rate for --lqrd and swingup; default 500",
     .wants = "samples per second above 0"},
    {"friction", OPTION_FLAG(friction), NULL,
     "keep the friction of the motor joint in the linearisation"},
    {"out", OPTION_OUTPUT(swingup.out), "FILE",
     "swingup: the trajectory; default: beside the model, MODEL-AT-swingup.csv"},
    {"reserve", OPTION_NUMBER(swingup.options.reserve), "SHARE",
     "swingup: share of the command left to follow it; default 0.25", 0.0, 0.6},
    {"slack", OPTION_NUMBER(swingup.options.slack), "SHARE",
     "swingup: how much longer than the shortest; default 0.1", 0.0, 1.0},
    {"json", OPTION_FIGURES(json), "FILE", "the result; \"-\": standard output"},
    {0}};

static int run(int argc, char **argv);

const struct subcommand sub_design = {
    .name = "design",
    .summary = "linearise a rig and compute feedback gains",
    .synopsis = "--model M.ini [options]\nswingup --model M.ini [--at NAME] [options]",
    .about =
        "Prints A and B at an equilibrium, controllability, gains and closed-loop poles. The "
        "states\n"
        "come in the order in which the command `gains` takes their gains. With swingup:\n"
        "finds the time-optimal swing-up to that equilibrium and writes it as a file that the\n"
        "command `swingup` takes (docs/swingup.md).",
    .options = option_rows,
    .argument = "what to design",
    .argument_is_name = true,
    .most = 1,
    .run = run,
};

/* `mechkit design swingup` is about a trajectory, without that word about gains. */
static int check_swingup(const struct options *o)
{
    if (o->poles || o->lqr || o->lqrd || o->gains || o->delay || o->friction)
        return report_usage("design", "swingup takes --model, --at, --rate, --reserve, --slack, "
                                      "--out and --json");
    return EXIT_OK;
}

static int check(const struct options *o)
{
    if (o->swingup.out)
        return report_usage("design", "--out goes with swingup");
    if ((o->poles != NULL) + (o->lqr != NULL) + (o->lqrd != NULL) + (o->gains != NULL) > 1)
        return report_usage("design", "one of --poles, --lqr, --lqrd, --gains at a time");
    if (o->delay && !o->lqrd)
        return report_usage("design", "--delay goes with --lqrd");
    return EXIT_OK;
}

/* "-5+3i" to a complex number. */
static bool parse_complex(const char *text, double *re, double *im)
{
    size_t n = strlen(text);
    *im = 0.0;
    if (n == 0 || (text[n - 1] != 'i' && text[n - 1] != 'j'))
        return mk_parse_double_z(text, re);
    size_t split = n - 1;
    while (split > 0 && !((text[split] == '+' || text[split] == '-') && text[split - 1] != 'e' &&
                          text[split - 1] != 'E'))
        split--;
    *re = 0.0;
    if (split > 0 && !mk_parse_double(text, text + split, re))
        return false;
    return mk_parse_double(text + split, text + n - 1, im);
}

/* Reads up to `most` finite (complex, if im is given) numbers separated by blanks, commas or
 * semicolons; -1: bad. */
static int parse_list(const char *text, int most, double *re, double *im)
{
    char copy[256];
    int n = 0;
    if (strlen(text) >= sizeof copy)
        return -1;
    strcpy(copy, text);
    char *save = NULL;
    for (char *word = strtok_r(copy, " ,;\t", &save); word; word = strtok_r(NULL, " ,;\t", &save)) {
        double x, y;
        if (n == most || !parse_complex(word, &x, &y) || !isfinite(x) || !isfinite(y) ||
            (!im && y != 0.0))
            return -1;
        re[n] = x;
        if (im)
            im[n] = y;
        n++;
    }
    return n;
}

static const struct mk_equilibrium *find_equilibrium(const struct mk_plant_info *plant,
                                                     const char *name)
{
    if (!name)
        return &plant->equilibrium[plant->equilibrium_count - 1];
    for (int i = 0; i < plant->equilibrium_count; i++)
        if (strcmp(plant->equilibrium[i].name, name) == 0)
            return &plant->equilibrium[i];
    return NULL;
}

/* The setup that holds this equilibrium by the gains that are printed; NULL: none does. */
static int no_equilibrium(const struct mk_plant_info *plant, const char *name)
{
    char list[128] = "";
    for (int i = 0; i < plant->equilibrium_count; i++) {
        size_t n = strlen(list);
        snprintf(list + n, sizeof list - n, "%s%s", i ? ", " : "", plant->equilibrium[i].name);
    }
    return report_usage("design", "--at %s: the equilibria of the %s are %s", name, plant->name,
                        list);
}

static int design_poles(const struct options *o, const struct linear *sys, struct result *r,
                        struct mk_error *err)
{
    double re[STATES], im[STATES];
    if (parse_list(o->poles, sys->n, re, im) != sys->n)
        return report_usage("design", "--poles '%s': expected %d poles", o->poles, sys->n);
    r->n = sys->n;
    return mk_design_place(sys->n, sys->a, sys->b, re, im, r->k, err) == MK_OK ? EXIT_OK
                                                                               : report_error(err);
}

static int design_lqr(const struct options *o, const struct linear *sys, struct result *r,
                      struct mk_error *err)
{
    const char *text = o->lqr ? o->lqr : o->lqrd;
    double w[STATES + 1], q[STATES * STATES] = {0};
    if (parse_list(text, sys->n + 1, w, NULL) != sys->n + 1)
        return report_usage("design", "--%s '%s': expected %d weights for the states and one for u",
                            o->lqr ? "lqr" : "lqrd", text, sys->n);
    for (int i = 0; i < sys->n; i++)
        q[i * sys->n + i] = w[i];
    r->sampled = o->lqrd != NULL;
    r->n = sys->n + o->delay;
    double weight = w[sys->n];
    enum mk_status st = o->lqr ? mk_design_lqr(sys->n, sys->a, sys->b, q, weight, r->k, NULL, err)
                               : mk_design_lqrd(sys->n, sys->a, sys->b, q, weight, 1.0 / o->rate,
                                                o->delay, r->k, NULL, err);
    return st == MK_OK ? EXIT_OK : report_error(err);
}

static int find_gains(const struct options *o, const struct linear *sys, struct result *r,
                      struct mk_error *err)
{
    if (o->poles)
        return design_poles(o, sys, r, err);
    if (o->lqr || o->lqrd)
        return design_lqr(o, sys, r, err);
    if (o->gains) {
        r->n = parse_list(o->gains, sys->n, r->k, NULL);
        if (r->n != sys->n)
            return report_usage("design", "--gains '%s': expected %d numbers", o->gains, sys->n);
    }
    return EXIT_OK;
}

/* Poles of the loop with the gains. With a delay the state of the sampled loop is [x, u]. */
static enum mk_status find_poles(const struct options *o, const struct linear *sys,
                                 struct result *r, struct mk_error *err)
{
    int n = sys->n;
    double a[(STATES + 1) * (STATES + 1)] = {0.0}, b[STATES + 1] = {0.0};
    if (!r->sampled)
        return mk_design_poles(n, sys->a, sys->b, r->k, r->re, r->im, err);
    double ad[STATES * STATES], bd[STATES];
    enum mk_status st = mk_design_c2d(n, sys->a, sys->b, 1.0 / o->rate, ad, bd, err);
    if (st != MK_OK)
        return st;
    for (int i = 0; i < n; i++) {
        memcpy(&a[i * r->n], &ad[i * n], (size_t)n * sizeof *ad);
        if (o->delay)
            a[i * r->n + n] = bd[i];
        else
            b[i] = bd[i];
    }
    if (o->delay)
        b[n] = 1.0;
    return mk_design_poles(r->n, a, b, r->k, r->re, r->im, err);
}

static void print_matrix(const struct linear *sys)
{
    printf("\n  %-8s %10s", "", "A:");
    for (int j = 0; j < sys->n; j++)
        printf("%11s", sys->state[j]);
    printf("%12s\n", "B");
    for (int i = 0; i < sys->n; i++) {
        printf("  %8s%10s '", "", sys->state[i]);
        for (int j = 0; j < sys->n; j++)
            printf("%11.4g", sys->a[i * sys->n + j]);
        printf("%12.5g\n", sys->b[i]);
    }
}

static void print_poles(const char *title, int n, const double *re, const double *im)
{
    printf("  %s", title);
    for (int i = 0; i < n; i++)
        printf(im[i] != 0.0 ? "  %.4g%+.4gi" : "  %.4g", re[i], im[i]);
    printf("\n");
}

/* Poles z of samples as those s of a continuous loop that decays as fast: z = exp(s / rate). */
static void print_sampled_poles(const struct result *r, double rate)
{
    double re[STATES + 1], im[STATES + 1];
    int n = 0;
    for (int i = 0; i < r->n; i++) {
        double size = hypot(r->re[i], r->im[i]);
        if (size < 1e-6)
            continue; /* the delay itself: gone after a sample */
        re[n] = rate * log(size);
        im[n++] = rate * atan2(r->im[i], r->re[i]);
    }
    print_poles("closed-loop poles, z:", r->n, r->re, r->im);
    print_poles("  as s = rate ln z:  ", n, re, im);
}

static void print_gains(const struct options *o, const char *setup, const struct linear *sys,
                        const struct result *r)
{
    printf("\n  gains");
    for (int i = 0; i < r->n; i++)
        printf(" %.6g", r->k[i]);
    printf("\n    on");
    for (int i = 0; i < sys->n; i++)
        printf(" %s", sys->state[i]);
    if (o->delay)
        printf(" and the command of the sample before: u = -K [x - x_eq, u]\n"
               "    setups predict the state themselves: `gains` takes those without --delay\n");
    else if (setup)
        printf(": u = -K (x - x_eq), in the order in which `gains` of setup %s takes them\n",
               setup);
    else
        printf(": u = -K (x - x_eq); no setup holds this equilibrium\n");
}

static void print_result(const struct options *o, const char *setup, const struct linear *sys,
                         const struct result *r, int rank, double condition)
{
    double re[STATES], im[STATES];
    print_matrix(sys);
    printf("\n  controllability: rank %d of %d, condition %.3g\n", rank, sys->n, condition);
    if (mk_design_poles(sys->n, sys->a, sys->b, NULL, re, im, NULL) == MK_OK)
        print_poles("open-loop poles:  ", sys->n, re, im);
    if (r->n == 0)
        return;
    print_gains(o, setup, sys, r);
    if (r->sampled)
        print_sampled_poles(r, o->rate);
    else
        print_poles("closed-loop poles:", sys->n, r->re, r->im);
}

static void add_poles(cJSON *root, const char *name, int n, const double *re, const double *im)
{
    cJSON *poles = cJSON_AddArrayToObject(root, name);
    for (int i = 0; i < n; i++)
        cJSON_AddItemToArray(poles, mk_json_numbers((double[]){re[i], im[i]}, 2));
}

static enum mk_status write_json(const struct options *o, const struct mk_model *model,
                                 const struct mk_equilibrium *eq, const struct linear *sys,
                                 const struct result *r, int rank, struct mk_error *err)
{
    cJSON *root = cJSON_CreateObject();
    cJSON_AddStringToObject(root, "rig", mk_plant(model->plant)->name);
    cJSON_AddStringToObject(root, "at", eq->name);
    cJSON *states = cJSON_AddArrayToObject(root, "states");
    cJSON *rows = cJSON_AddArrayToObject(root, "A");
    for (int i = 0; i < sys->n; i++) {
        cJSON_AddItemToArray(states, cJSON_CreateString(sys->state[i]));
        cJSON_AddItemToArray(rows, mk_json_numbers(&sys->a[i * sys->n], (size_t)sys->n));
    }
    cJSON_AddItemToObject(root, "B", mk_json_numbers(sys->b, (size_t)sys->n));
    cJSON_AddItemToObject(root, "controllability_rank", mk_json_number(rank));
    cJSON_AddItemToObject(root, "gains", mk_json_numbers(r->k, (size_t)r->n));
    add_poles(root, r->sampled ? "closed_loop_poles_z" : "closed_loop_poles", r->n, r->re, r->im);
    if (r->sampled)
        cJSON_AddItemToObject(root, "sample_rate_hz", mk_json_number(o->rate));
    enum mk_status st = mk_json_write(o->json, root, err);
    cJSON_Delete(root);
    return st;
}

static void print_place(const struct mk_model *model, const struct mk_equilibrium *eq)
{
    printf("%s at %s,", mk_plant(model->plant)->name, eq->name);
    for (int j = 0; j < mk_model_joints(model); j++)
        printf(" q%d = %.4g %s,", j + 1, eq->q[j], mk_model_unit(model, j, "rad"));
    printf(" g = %.4g m/s^2\n", model->g);
}

/* The gains, their poles, and what is written of both. */
static int design_gains(const struct options *o, const struct mk_model *model,
                        const struct mk_equilibrium *eq)
{
    struct linear sys;
    struct result r = {0};
    struct mk_error err = MK_ERROR_INIT;
    double condition;
    linear_at(model, eq->q, o->friction, &sys);
    int rank = mk_design_controllability(sys.n, sys.a, sys.b, 1e-12, &condition);
    int code = find_gains(o, &sys, &r, &err);
    if (code != EXIT_OK)
        return code;
    if (r.n > 0 && find_poles(o, &sys, &r, &err) != MK_OK)
        return report_error(&err);
    if (o->json && write_json(o, model, eq, &sys, &r, rank, &err) != MK_OK)
        return report_output_error(&err);
    if (!is_standard_output(o->json)) {
        print_place(model, eq);
        print_result(o, linear_setup(model->plant, eq->name), &sys, &r, rank, condition);
    }
    return EXIT_OK;
}

static int run(int argc, char **argv)
{
    struct options o = {.rate = 500.0};
    struct arguments what;
    mk_swingup_default(&o.swingup.options);
    int code = options_parse(&sub_design, argc, argv, &o, &what);
    if (code == EXIT_OK && what.count && strcmp(what.text[0], "swingup") != 0)
        code = report_usage("design",
                            "'%s': a design is of gains, or with the word swingup of a "
                            "trajectory",
                            what.text[0]);
    if (code == EXIT_OK)
        code = what.count ? check_swingup(&o) : check(&o);
    if (code != EXIT_OK)
        return code;
    struct mk_model model;
    struct mk_error err = MK_ERROR_INIT;
    if (mk_model_read(o.model, &model, &err) != MK_OK)
        return report_error(&err);
    const struct mk_equilibrium *eq = find_equilibrium(mk_plant(model.plant), o.at);
    if (!eq)
        return no_equilibrium(mk_plant(model.plant), o.at);
    if (!what.count)
        return design_gains(&o, &model, eq);
    o.swingup.model_path = o.model;
    o.swingup.json = o.json;
    o.swingup.options.rate_hz = o.rate;
    return design_swingup(&o.swingup, &model, eq);
}
