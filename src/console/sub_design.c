/* mechkit design: linearisation, controllability, gains, poles. */
#include <getopt.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "console/sub.h"
#include "mechkit/design.h"
#include "mechkit/json.h"
#include "mechkit/model.h"
#include "mechkit/number.h"

#define STATES 4

struct options {
    const char *model, *at, *json;
    const char *poles, *lqr, *lqrd, *gains;
    double rate;
    bool friction;
};

/* A linear system whose state is in the order in which `gains` takes it: q1 dq1 q2 dq2; a wheel's
 * angle, which no law needs, is left out. */
struct linear {
    int n;
    double a[STATES * STATES], b[STATES];
    const char *state[STATES];
};

struct result {
    int n; /* gains; one more than states when there is a delay */
    double k[STATES + 1];
    double re[STATES], im[STATES];
};

static int parse(int argc, char **argv, struct options *o)
{
    static const struct option names[] = {
        {"model", required_argument, NULL, 'm'}, {"at", required_argument, NULL, 'a'},
        {"poles", required_argument, NULL, 'p'}, {"lqr", required_argument, NULL, 'l'},
        {"lqrd", required_argument, NULL, 'd'},  {"gains", required_argument, NULL, 'g'},
        {"rate", required_argument, NULL, 'r'},  {"friction", no_argument, NULL, 'f'},
        {"json", required_argument, NULL, 'j'},  {NULL, 0, NULL, 0}};
    int c;
    opterr = 0;
    optind = 1;
    while ((c = getopt_long(argc, argv, ":", names, NULL)) != -1) {
        switch (c) {
        case 'm':
            o->model = optarg;
            break;
        case 'a':
            o->at = optarg;
            break;
        case 'p':
            o->poles = optarg;
            break;
        case 'l':
            o->lqr = optarg;
            break;
        case 'd':
            o->lqrd = optarg;
            break;
        case 'g':
            o->gains = optarg;
            break;
        case 'r':
            if (!mk_parse_double_z(optarg, &o->rate) || !(o->rate > 0.0))
                return report_usage("design", "--rate %s: expected samples per second", optarg);
            break;
        case 'f':
            o->friction = true;
            break;
        case 'j':
            o->json = optarg;
            break;
        case ':':
            return report_usage("design", "%s needs a value", argv[optind - 1]);
        default:
            return report_usage("design", "unknown option '%s'", argv[optind - 1]);
        }
    }
    if (optind < argc)
        return report_usage("design", "'%s' is too much", argv[optind]);
    if (!o->model)
        return report_usage("design", "--model is missing");
    if ((o->poles != NULL) + (o->lqr != NULL) + (o->lqrd != NULL) + (o->gains != NULL) > 1)
        return report_usage("design", "one of --poles, --lqr, --lqrd, --gains at a time");
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

/* Reads up to `most` (complex, if im is given) numbers separated by blanks or commas; -1: bad. */
static int parse_list(const char *text, int most, double *re, double *im)
{
    char copy[256];
    int n = 0;
    if (strlen(text) >= sizeof copy)
        return -1;
    strcpy(copy, text);
    char *save = NULL;
    for (char *word = strtok_r(copy, " ,\t", &save); word; word = strtok_r(NULL, " ,\t", &save)) {
        double x, y;
        if (n == most || !parse_complex(word, &x, &y) || (!im && y != 0.0))
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

/* mk_plant_linearise's order [q1 q2 dq1 dq2] to that of `gains`. The reaction wheel's law is on
 * absolute angles (report 2.3): its third state is dq1 + dq2. */
static void linearise(const struct mk_model *model, const double *q, bool friction,
                      struct linear *out)
{
    static const char *const names[] = {"q1", "dq1", "q2", "dq2"};
    const struct mk_plant_info *plant = mk_plant(model->plant);
    int n = plant->joints, ns = 2 * n, order[STATES], count = 0;
    double a[STATES * STATES], b[STATES];
    mk_plant_linearise(model, q, friction, a, b);
    for (int j = 0; j < n; j++) {
        if (!plant->joint_is_wheel[j]) {
            out->state[count] = names[2 * j];
            order[count++] = j;
        }
        out->state[count] = names[2 * j + 1];
        order[count++] = n + j;
    }
    out->n = count;
    for (int i = 0; i < count; i++) {
        for (int j = 0; j < count; j++)
            out->a[i * count + j] = a[order[i] * ns + order[j]];
        out->b[i] = b[order[i]];
    }
    if (model->plant != MK_PLANT_REACTION_WHEEL)
        return;
    /* z3 = x2 + x3: row 3 += row 2, then column 2 -= column 3. */
    out->state[2] = "dq1+dq2";
    for (int j = 0; j < 3; j++)
        out->a[6 + j] += out->a[3 + j];
    out->b[2] += out->b[1];
    for (int i = 0; i < 3; i++)
        out->a[i * 3 + 1] -= out->a[i * 3 + 2];
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
        return report_usage("design", "weights '%s': expected %d for the states and one for u",
                            text, sys->n);
    for (int i = 0; i < sys->n; i++)
        q[i * sys->n + i] = w[i];
    enum mk_status st;
    if (o->lqr)
        st = mk_design_lqr(sys->n, sys->a, sys->b, q, w[sys->n], r->k, NULL, err);
    else
        st =
            mk_design_lqrd(sys->n, sys->a, sys->b, q, w[sys->n], 1.0 / o->rate, 1, r->k, NULL, err);
    r->n = sys->n + (o->lqrd != NULL);
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
            return report_usage("design", "--gains '%s': expected %d", o->gains, sys->n);
    }
    return EXIT_OK;
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

static void print_result(const struct linear *sys, const struct result *r, int rank,
                         double condition)
{
    double re[STATES], im[STATES];
    print_matrix(sys);
    printf("\n  controllability: rank %d of %d, condition %.3g\n", rank, sys->n, condition);
    if (mk_design_poles(sys->n, sys->a, sys->b, NULL, re, im, NULL) == MK_OK) {
        printf("  open-loop poles:  ");
        for (int i = 0; i < sys->n; i++)
            printf(im[i] != 0.0 ? "  %.4g%+.4gi" : "  %.4g", re[i], im[i]);
        printf("\n");
    }
    if (r->n == 0)
        return;
    printf("\n  gains");
    for (int i = 0; i < r->n; i++)
        printf(" %.6g", r->k[i]);
    printf("\n    u = -K (x - x_eq), in the order of the states above%s\n",
           r->n > sys->n ? "; the last gain is on the command of the sample before" : "");
    if (r->n > sys->n)
        return;
    printf("  closed-loop poles:");
    for (int i = 0; i < sys->n; i++)
        printf(r->im[i] != 0.0 ? "  %.4g%+.4gi" : "  %.4g", r->re[i], r->im[i]);
    printf("\n");
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
    cJSON *poles = cJSON_AddArrayToObject(root, "closed_loop_poles");
    for (int i = 0; r->n == sys->n && i < sys->n; i++) {
        double pole[2] = {r->re[i], r->im[i]};
        cJSON_AddItemToArray(poles, mk_json_numbers(pole, 2));
    }
    enum mk_status st = mk_json_write(o->json, root, err);
    cJSON_Delete(root);
    return st;
}

int sub_design(int argc, char **argv)
{
    struct options o = {.rate = 500.0};
    int code = parse(argc, argv, &o);
    if (code != EXIT_OK)
        return code;
    struct mk_model model;
    struct mk_error err = MK_ERROR_INIT;
    if (mk_model_read(o.model, &model, &err) != MK_OK)
        return report_error(&err);
    const struct mk_equilibrium *eq = find_equilibrium(mk_plant(model.plant), o.at);
    if (!eq)
        return report_usage("design", "a %s has no equilibrium '%s'", mk_plant(model.plant)->name,
                            o.at);
    struct linear sys;
    struct result r = {0};
    linearise(&model, eq->q, o.friction, &sys);
    double condition;
    int rank = mk_design_controllability(sys.n, sys.a, sys.b, 1e-12, &condition);
    code = find_gains(&o, &sys, &r, &err);
    if (code != EXIT_OK)
        return code;
    if (r.n == sys.n && mk_design_poles(sys.n, sys.a, sys.b, r.k, r.re, r.im, &err) != MK_OK)
        return report_error(&err);
    if (o.json && write_json(&o, &model, eq, &sys, &r, rank, &err) != MK_OK)
        return report_error(&err);
    if (!(o.json && strcmp(o.json, "-") == 0)) {
        printf("%s at %s, q = (%.4g", mk_plant(model.plant)->name, eq->name, eq->q[0]);
        if (mk_model_joints(&model) == 2)
            printf(", %.4g", eq->q[1]);
        printf(") rad, g = %.4g m/s^2\n", model.g);
        print_result(&sys, &r, rank, condition);
    }
    return EXIT_OK;
}
