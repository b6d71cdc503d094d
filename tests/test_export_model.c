/* Models in other languages against the library: every law of the catalogue on every rig as C,
 * whole runs with contact and delays, and the same in Octave against `mechkit simulate`. */
#include "suites.h"

#include <dlfcn.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "mechkit/exchange.h"
#include "mechkit/log.h"
#include "mechkit/sim.h"
#include "support/files.h"
#include "support/program.h"
#include "support/spawn.h"
#include "support/unzip.h"

/* The exported C, driven by lines of text: "e t x.. u1 u2" evaluates the equations, "s x.." starts,
 * "a t u1 u2" advances; every line is answered by numbers. */
static const char *const driver =
    "#include <stdio.h>\n#include \"rig.h\"\n"
    "static void get(double *v, int n) { while (n--) if (scanf(\"%lf\", v++) != 1) *v = 0; }\n"
    "static void put(const double *v, int n) { while (n--) printf(\"%.17g \", *v++); }\n"
    "int main(void)\n{\n"
    "    static struct rig s;\n"
    "    double t, x[32], u[2], dx[32], y[2] = {0}, g[32], rest[32];\n"
    "    char what;\n"
    "    rig_init(&s);\n"
    "    while (scanf(\" %c\", &what) == 1) {\n"
    "        if (what == 's') {\n"
    "            get(x, RIG_STATES);\n            rig_start_at(&s, 0, x);\n"
    "        } else if (what == 'a') {\n"
    "            get(&t, 1), get(u, 2);\n"
    "            if (rig_advance(&s, t, u) != 0)\n                return 1;\n"
    "            rig_measure(&s, y);\n            put(y, RIG_JOINTS), put(s.x, RIG_STATES);\n"
    "        } else {\n"
    "            get(&t, 1), get(x, RIG_STATES), get(u, 2);\n"
    "            rig_rhs(s.p, t, x, u, dx), rig_readings(s.p, t, x, y);\n"
    "            rig_surfaces(s.p, t, x, g), rig_at_rest(s.p, x, x + RIG_JOINTS, rest);\n"
    "            put(dx, RIG_STATES), put(y, RIG_JOINTS), put(g, RIG_SURFACES);\n"
    "            put(rest, RIG_STATES);\n"
    "        }\n"
    "        puts(\"\");\n"
    "    }\n    return 0;\n}\n";

/* Exports a model as C, compiles it with a driver, feeds it `script`, and opens what it answers. */
static FILE *answers(const struct mk_model *model, const char *script)
{
    char out[4096], dir[256];
    struct mk_error err = MK_ERROR_INIT;
    ck_assert_msg(mk_export_c(scratch("rig.c"), model, &err) == MK_OK, "%s", err.message);
    snprintf(dir, sizeof dir, "%s", scratch("."));
    const char *main_c = scratch_text("driver.c", driver);
    int code = run_command(out, sizeof out,
                           "cd %s && ${CC:-cc} -std=c99 -O1 -Wall -Wextra -Werror -o rig_driver %s "
                           "rig.c -lm && ./rig_driver <%s >answers.txt",
                           dir, main_c, script);
    ck_assert_msg(code == 0, "%s", out);
    FILE *f = fopen(scratch("answers.txt"), "r");
    ck_assert_ptr_nonnull(f);
    return f;
}

static double next_number(FILE *f)
{
    double value;
    ck_assert_int_eq(fscanf(f, "%lf", &value), 1);
    return value;
}

static void put_numbers(FILE *f, const double *values, int count)
{
    for (int i = 0; i < count; i++)
        fprintf(f, " %.17g", values[i]);
}

static void same_numbers(FILE *f, const double *want, int count, double tolerance, const char *what)
{
    for (int i = 0; i < count; i++) {
        double got = next_number(f), scale = fmax(1.0, fabs(want[i]));
        ck_assert_msg(fabs(got - want[i]) <= tolerance * scale, "%s %d: %.17g, not %.17g", what, i,
                      got, want[i]);
    }
}

/* --- equations --------------------------------------------------------------------------- */

static double pseudo_random(void)
{
    static unsigned long long state = 1;
    state = state * 6364136223846793005ULL + 1442695040888963407ULL;
    return (double)(state >> 11) / 9007199254740992.0 * 2.0 - 1.0;
}

/* Parameters that make each effect felt: the ones its search starts with, a bit off. */
static void shake(struct mk_model *m, int e)
{
    const struct mk_effect_info *info = mk_effect(m->effect[e].index);
    for (int k = 0; k < info->parameter_count; k++) {
        const struct mk_parameter_info *p = &info->parameter[k];
        double value = p->initial + (p->fit == MK_FIT_ANGLE || p->initial == 0.0 ? 0.3 : 0.0);
        if (p->fit == MK_FIT_FIXED)
            value = 1 + (m->effect_count + e) % (p->max > 8 ? 17 : 8);
        m->effect[e].value[k] = fmin(fmax(value, p->min), p->max);
    }
}

static void check_equations(const struct mk_model *m)
{
    enum { POINTS = 12 };
    double t[POINTS], x[POINTS][MK_MAX_STATES], u[POINTS][2];
    int states = mk_model_state_count(m), joints = mk_model_joints(m);
    const char *script = scratch("script.txt");
    FILE *f = fopen(script, "w");
    ck_assert_ptr_nonnull(f);
    for (int k = 0; k < POINTS; k++) {
        t[k] = 2.5 + 2.5 * pseudo_random();
        for (int i = 0; i < states; i++)
            x[k][i] = (i < joints ? 4.0 : 1.5) * pseudo_random();
        u[k][0] = 13.0 * pseudo_random(), u[k][1] = pseudo_random();
        fprintf(f, "e %.17g", t[k]);
        put_numbers(f, x[k], states);
        put_numbers(f, u[k], 2);
        fputs("\n", f);
    }
    fclose(f);
    f = answers(m, script);
    for (int k = 0; k < POINTS; k++) {
        double want[MK_MAX_STATES], second = u[k][1];
        /* A reaction wheel has one motor: the second input is nothing. */
        double command[2] = {u[k][0], m->plant == MK_PLANT_REACTION_WHEEL ? 0.0 : second};
        mk_model_rhs(m, t[k], x[k], command, want);
        same_numbers(f, want, states, 1e-9, "slope");
        mk_model_measure(m, t[k], x[k], want);
        same_numbers(f, want, joints, 1e-13, "reading");
        mk_model_events(m, t[k], x[k], command, want);
        same_numbers(f, want, mk_model_event_count(m), 1e-13, "surface");
        mk_model_initial_state(m, x[k], x[k] + joints, want);
        same_numbers(f, want, states, 1e-13, "state at rest");
    }
    fclose(f);
}

START_TEST(exported_equations_are_the_library_s_with_every_effect)
{
    struct mk_model m;
    int seen = 0;
    mk_model_default((enum mk_plant_kind)_i, &m);
    check_equations(&m);
    for (int e = 0; e < mk_effect_count(); e++) {
        const struct mk_effect_info *info = mk_effect(e);
        if (!(info->plants & (1u << _i)))
            continue;
        int joint = info->joint_rule == MK_EFFECT_JOINT_NONE ? 0 : mk_model_joints(&m);
        if (mk_model_add_effect(&m, info->name, joint, NULL) != MK_OK) {
            check_equations(&m); /* full: go on with an empty one */
            mk_model_default((enum mk_plant_kind)_i, &m);
            ck_assert_int_eq(mk_model_add_effect(&m, info->name, joint, NULL), MK_OK);
        }
        shake(&m, m.effect_count - 1);
        seen++;
    }
    check_equations(&m);
    ck_assert_int_gt(seen, 25);
}
END_TEST

/* --- runs -------------------------------------------------------------------------------- */

static void add(struct mk_model *m, const char *effect, int joint)
{
    struct mk_error err = MK_ERROR_INIT;
    ck_assert_msg(mk_model_add_effect(m, effect, joint, &err) == MK_OK, "%s", err.message);
}

/* Rigs with what is hard to integrate: contact, bristles, delays. */
static void hard_model(int which, struct mk_model *m)
{
    static const enum mk_plant_kind rig[] = {
        MK_PLANT_PENDUBOT,      MK_PLANT_FURUTA,    MK_PLANT_REACTION_WHEEL, MK_PLANT_PENDULUM,
        MK_PLANT_INERTIA_WHEEL, MK_PLANT_CART_POLE, MK_PLANT_ACROBOT};
    _Static_assert(sizeof rig / sizeof rig[0] == MK_PLANT_COUNT, "a plant is not listed");
    mk_model_default(rig[which], m);
    switch (which) {
    case 0:
        add(m, "backlash", 2);
        break;
    case 1:
        add(m, "input-delay", 0);
        add(m, "sensor-delay", 0);
        add(m, "actuator-lag", 0);
        m->effect[0].value[0] = 0.0047;
        m->effect[1].value[0] = 0.0053;
        break;
    case 2:
        add(m, "stiction", 1);
        add(m, "cable-hysteresis", 2);
        add(m, "base-tilt", 0);
        break;
    case 3:
        add(m, "end-stop", 1);
        add(m, "encoder-offset", 1);
        add(m, "deadband", 0);
        m->effect[0].value[0] = 0.2;
        m->effect[1].value[0] = 0.03;
        break;
    case 5:
        add(m, "end-stop", 1);
        add(m, "base-compliance", 0);
        add(m, "base-tilt", 0);
        m->effect[0].value[0] = 0.05;
        break;
    case 6:
        add(m, "backlash", 2);
        break;
    default:
        add(m, "backlash", 1);
        add(m, "gain-drift", 0);
    }
}

static double command_at(double t)
{
    return 2.5 * sin(6.0 * t) + 0.7 * sin(17.0 * t);
}

START_TEST(an_exported_model_runs_as_the_simulation_does)
{
    enum { SAMPLES = 1000 };
    const double dt = 0.002;
    struct mk_model m;
    struct mk_sim *sim;
    hard_model(_i, &m);
    m.rtol = 1e-11, m.atol = 1e-13;
    int states = mk_model_state_count(&m), joints = mk_model_joints(&m);
    double x[MK_MAX_STATES], v[2] = {0.3, -0.2}, y[2];
    const char *script = scratch("script.txt");
    FILE *f = fopen(script, "w");
    ck_assert_ptr_nonnull(f);
    mk_model_initial_state(&m, mk_plant(m.plant)->rest, v, x);
    fputs("s", f);
    put_numbers(f, x, states);
    for (int k = 0; k < SAMPLES; k++)
        fprintf(f, "\na %.17g %.17g 0", dt * (k + 1), command_at(dt * k));
    fclose(f);
    f = answers(&m, script);
    ck_assert_int_eq(mk_sim_create(&m, NULL, &sim, NULL), MK_OK);
    ck_assert_int_eq(mk_sim_reset(sim, 0, x, NULL), MK_OK);
    for (int k = 0; k < SAMPLES; k++) {
        double u[2] = {command_at(dt * k), 0.0};
        ck_assert_int_eq(mk_sim_advance(sim, dt * (k + 1), u, NULL), MK_OK);
        mk_sim_measure(sim, y);
        same_numbers(f, y, joints, 1e-6, "reading");
        same_numbers(f, mk_sim_state(sim), joints, 1e-6, "joint");
        for (int i = joints; i < states; i++)
            next_number(f);
    }
    mk_sim_destroy(sim);
    fclose(f);
}
END_TEST

/* --- Octave ------------------------------------------------------------------------------ */

START_TEST(octave_s_model_predicts_what_simulate_predicts)
{
    if (!have_program("octave-cli", "octave_s_model_predicts_what_simulate_predicts"))
        return;
    static const char *const rigs[] = {"pendubot", "furuta"};
    for (int k = 0; k < 2; k++) {
        char out[8192];
        struct mk_model m;
        hard_model(k, &m);
        if (k == 1)
            m.effect_count = 2, m.effect[1] = m.effect[2]; /* delay of the command, and lag */
        const char *ini = scratch("hard.ini"), *log = open_loop_log(rigs[k], "1.5*sin(6*t)", 0.5);
        ck_assert_int_eq(mk_model_write(ini, &m, NULL, NULL), MK_OK);
        int code = run_mechkit(out, sizeof out, "simulate --model %s --input %s --out %s --states",
                               ini, log, scratch("pred.csv"));
        ck_assert_msg(code == 0, "%s", out);
        code = run_mechkit(out, sizeof out, "export --model %s --out %s", ini, scratch("rig.m"));
        ck_assert_msg(code == 0, "%s", out);
        code = run_command(out, sizeof out,
                           "MECHKIT=%s octave-cli --no-gui --quiet --no-init-file --path "
                           "%s/tools/matlab_export %s/tests/octave/test_models.m %s %s %s %s",
                           MK_TEST_APP, MK_SOURCE_DIR, MK_SOURCE_DIR, scratch("rig.m"), log,
                           scratch("pred.csv"), ini);
        ck_assert_msg(code == 0 && strstr(out, "the model agrees"), "%s", out);
    }
}
END_TEST

/* --- FMU --------------------------------------------------------------------------------- */

/* With little damping play bounces often, and every impact multiplies the errors before it. */
static void bouncing_model(struct mk_model *m)
{
    hard_model(0, m);
    m->effect[0].value[2] = 0.05;
}

/* The functions of FMI 2.0 that a master of a co-simulation calls. */
struct fmu {
    void *handle, *unit;
    void *(*instantiate)(const char *, int, const char *, const char *, const void *, int, int);
    void (*release)(void *);
    int (*setup)(void *, int, double, double, int, double);
    int (*enter)(void *), (*leave)(void *), (*reset)(void *);
    int (*get)(void *, const unsigned *, size_t, double *);
    int (*set)(void *, const unsigned *, size_t, const double *);
    int (*set_boolean)(void *, const unsigned *, size_t, const int *);
    int (*step)(void *, double, double, int);
    int (*get_state)(void *, void **), (*set_state)(void *, void *), (*free_state)(void *, void **);
};

static void *symbol(struct fmu *f, const char *name)
{
    void *p = dlsym(f->handle, name);
    ck_assert_msg(p != NULL, "the FMU has no %s", name);
    return p;
}

static void open_fmu(struct fmu *f, const char *path, const char *guid)
{
    f->handle = dlopen(path, RTLD_NOW);
    ck_assert_msg(f->handle != NULL, "%s", dlerror());
    *(void **)&f->instantiate = symbol(f, "fmi2Instantiate");
    *(void **)&f->release = symbol(f, "fmi2FreeInstance");
    *(void **)&f->setup = symbol(f, "fmi2SetupExperiment");
    *(void **)&f->enter = symbol(f, "fmi2EnterInitializationMode");
    *(void **)&f->leave = symbol(f, "fmi2ExitInitializationMode");
    *(void **)&f->reset = symbol(f, "fmi2Reset");
    *(void **)&f->get = symbol(f, "fmi2GetReal");
    *(void **)&f->set = symbol(f, "fmi2SetReal");
    *(void **)&f->set_boolean = symbol(f, "fmi2SetBoolean");
    *(void **)&f->step = symbol(f, "fmi2DoStep");
    *(void **)&f->get_state = symbol(f, "fmi2GetFMUstate");
    *(void **)&f->set_state = symbol(f, "fmi2SetFMUstate");
    *(void **)&f->free_state = symbol(f, "fmi2FreeFMUstate");
    ck_assert_ptr_null(f->instantiate("rig", 1, "{another}", "", NULL, 0, 0));
    f->unit = f->instantiate("rig", 1, guid, "", NULL, 0, 0);
    ck_assert_ptr_nonnull(f->unit);
}

/* Value reference of a variable, from the description. */
static unsigned reference(const char *xml, const char *name)
{
    char mark[96];
    snprintf(mark, sizeof mark, "name=\"%s\" valueReference=\"", name);
    const char *at = strstr(xml, mark);
    ck_assert_msg(at != NULL, "no variable %s", name);
    return (unsigned)strtoul(at + strlen(mark), NULL, 10);
}

/* Unpacks what the program exported; returns the description, to be freed. */
static char *unpacked_fmu(const struct mk_model *m, struct fmu *f)
{
    char out[4096], dir[256], guid[64] = "", path[512];
    const char *ini = scratch("hard.ini");
    snprintf(dir, sizeof dir, "%s", scratch("fmu"));
    ck_assert_int_eq(mk_model_write(ini, m, NULL, NULL), MK_OK);
    int code = run_mechkit(out, sizeof out, "export --model %s --out %s", ini, scratch("rig.fmu"));
    ck_assert_msg(code == 0 && !*out, "%s", out);
    ck_assert_int_eq(unzip_all(scratch("rig.fmu"), dir, NULL, 0), 5);
    snprintf(path, sizeof path, "%s/modelDescription.xml", dir);
    char *xml = slurp_file(path);
    ck_assert_ptr_nonnull(xml);
    ck_assert_int_eq(sscanf(strstr(xml, "guid=\"") + 6, "%63[^\"]", guid), 1);
    snprintf(path, sizeof path, "%s/binaries/linux64/rig.so", dir);
    open_fmu(f, path, guid);
    return xml;
}

/* Predicts `log` with the unit, from the state in the prediction's first row; angles must agree. */
static void follow(struct fmu *f, const char *xml, const struct mk_log *log,
                   const struct mk_log *want, int states, int joints)
{
    unsigned u = reference(xml, "u"), q[2] = {reference(xml, "q1"), reference(xml, "q2")};
    unsigned start = reference(xml, "q1_start"), rest = reference(xml, "effects_start_at_rest");
    const double *t = mk_log_get(log, "t"), *command = mk_log_get(log, "u");
    ck_assert_int_eq(f->setup(f->unit, 0, 0, t[0], 0, 0), 0);
    ck_assert_int_eq(f->enter(f->unit), 0);
    ck_assert_int_eq(f->set_boolean(f->unit, &rest, 1, &(int){0}), 0);
    for (int i = 0; i < states; i++) {
        char name[16];
        snprintf(name, sizeof name, "x%d", i + 1);
        unsigned at = start + (unsigned)i;
        ck_assert_int_eq(f->set(f->unit, &at, 1, mk_log_get(want, name)), 0);
    }
    double first;
    ck_assert_int_eq(f->get(f->unit, q, 1, &first), 0); /* start values are there at once */
    ck_assert_double_eq_tol(first, mk_log_get(want, "q1")[0], 1e-9);
    ck_assert_int_eq(f->leave(f->unit), 0);
    for (size_t k = 0; k + 1 < log->rows; k++) {
        double y[2];
        ck_assert_int_eq(f->set(f->unit, &u, 1, &command[k]), 0);
        ck_assert_int_eq(f->step(f->unit, t[k], t[k + 1] - t[k], 1), 0);
        ck_assert_int_eq(f->get(f->unit, q, (size_t)joints, y), 0);
        for (int j = 0; j < joints; j++)
            ck_assert_double_eq_tol(y[j], mk_log_get(want, j ? "q2" : "q1")[k + 1], 1e-6);
    }
}

START_TEST(an_fmu_with_play_predicts_what_simulate_predicts)
{
    struct mk_model m;
    struct fmu f;
    struct mk_log *log, *want;
    char out[4096];
    bouncing_model(&m);
    char *xml = unpacked_fmu(&m, &f);
    const char *path = open_loop_log("pendubot", "1.5*sin(6*t)", 2.0), *pred = scratch("pred.csv");
    int code = run_mechkit(out, sizeof out, "simulate --model %s --input %s --out %s --states",
                           scratch("hard.ini"), path, pred);
    ck_assert_msg(code == 0, "%s", out);
    ck_assert_int_eq(mk_log_read(path, &log, NULL), MK_OK);
    ck_assert_int_eq(mk_log_read(pred, &want, NULL), MK_OK);
    follow(&f, xml, log, want, mk_model_state_count(&m), 2);
    /* Reset and a saved state both bring it back. */
    void *saved = NULL;
    ck_assert_int_eq(f.reset(f.unit), 0);
    ck_assert_int_eq(f.get_state(f.unit, &saved), 0);
    follow(&f, xml, log, want, mk_model_state_count(&m), 2);
    ck_assert_int_eq(f.set_state(f.unit, saved), 0);
    ck_assert_int_eq(f.free_state(f.unit, &saved), 0);
    double q1;
    unsigned r = reference(xml, "q1");
    ck_assert_int_eq(f.get(f.unit, &r, 1, &q1), 0);
    ck_assert_double_eq_tol(q1, -M_PI / 2, 1e-12);
    r = 9999;
    ck_assert_int_ne(f.get(f.unit, &r, 1, &q1), 0);
    f.release(f.unit);
    dlclose(f.handle);
    mk_log_free(log);
    mk_log_free(want);
    free(xml);
}
END_TEST

/* A reading that is 50 ms old, when the unit is driven in steps of 1 ms and of 10 us. */
START_TEST(an_fmu_with_an_old_sensor_does_not_mind_tiny_steps)
{
    struct mk_model m;
    struct fmu f;
    mk_model_default(MK_PLANT_PENDULUM, &m);
    add(&m, "sensor-delay", 1);
    m.effect[0].value[0] = 0.05;
    char *xml = unpacked_fmu(&m, &f);
    unsigned u = reference(xml, "u"), q = reference(xml, "q1");
    double y[2];
    for (int tiny = 0; tiny < 2; tiny++) {
        int steps = tiny ? 30000 : 300;
        double h = 0.3 / steps, push = 3.0;
        ck_assert_int_eq(f.reset(f.unit), 0);
        ck_assert_int_eq(f.setup(f.unit, 0, 0, 0.0, 0, 0), 0);
        ck_assert_int_eq(f.enter(f.unit), 0);
        ck_assert_int_eq(f.leave(f.unit), 0);
        ck_assert_int_eq(f.set(f.unit, &u, 1, &push), 0);
        for (int k = 0; k < steps; k++)
            ck_assert_int_eq(f.step(f.unit, k * h, h, 1), 0);
        ck_assert_int_eq(f.get(f.unit, &q, 1, &y[tiny]), 0);
    }
    ck_assert_double_gt(fabs(y[0]), 0.01);
    ck_assert_double_eq_tol(y[1], y[0], 1e-7);
    f.release(f.unit);
    dlclose(f.handle);
    free(xml);
}
END_TEST

START_TEST(an_fmu_without_a_compiler_has_its_sources)
{
    char out[4096];
    int code = run_command(out, sizeof out,
                           "CC=/nowhere/cc %s export --model %s/models/furuta.ini --out %s",
                           MK_TEST_APP, MK_SOURCE_DIR, scratch("bare.fmu"));
    ck_assert_msg(code == 0 && strstr(out, "no C compiler"), "%d %s", code, out);
    ck_assert_int_eq(unzip_all(scratch("bare.fmu"), scratch("bare"), out, sizeof out), 4);
    ck_assert_msg(strstr(out, "sources/bare.c\n") && !strstr(out, ".so"), "%s", out);
}
END_TEST

/* What is wrong is in the compiler's own words, the first error of them. */
START_TEST(an_fmu_that_cannot_be_compiled_says_what_the_compiler_says)
{
    char out[1024], cc[300];
    snprintf(cc, sizeof cc, "%s",
             scratch_text("poor-cc", "#!/bin/sh\necho 'in a function:' >&2\n"
                                     "echo 'm.c:7: error: no such thing' >&2\n"
                                     "echo '7 | thing' >&2\nexit 1\n"));
    ck_assert_int_eq(chmod(cc, 0700), 0);
    int code = run_command(out, sizeof out,
                           "CC=%s " MK_TEST_APP " export --model %s/models/furuta.ini --out %s", cc,
                           MK_SOURCE_DIR, scratch("poor.fmu"));
    ck_assert_msg(code == 1 && strstr(out, "poor-cc cannot compile the model: "
                                           "m.c:7: error: no such thing\n"),
                  "%d %s", code, out);
    ck_assert_int_eq(count_files("poor.fmu"), 0);
}
END_TEST

/* A Python that has FMPy: the one MECHKIT_FMPY names, that of `make fmpy`, or the system's; NULL.
 */
static const char *fmpy_python(void)
{
    const char *const places[] = {getenv("MECHKIT_FMPY"), MK_SOURCE_DIR "/build/fmpy/bin/python",
                                  "python3"};
    for (size_t i = 0; i < sizeof places / sizeof places[0]; i++)
        if (places[i] && run_command(NULL, 0, "%s -c 'import fmpy'", places[i]) == 0)
            return places[i];
    return NULL;
}

START_TEST(an_fmu_without_a_folder_to_be_built_in_names_it)
{
    char out[1024];
    int code = run_command(out, sizeof out,
                           "TMPDIR=/nowhere " MK_TEST_APP " export --model %s/models/furuta.ini "
                           "--out %s",
                           MK_SOURCE_DIR, scratch("nowhere.fmu"));
    ck_assert_msg(code == 1 &&
                      strstr(out, "/nowhere: cannot make a temporary folder here: No such"),
                  "%d %s", code, out);
}
END_TEST

/* A compiler that takes its time, and says when it has begun. */
START_TEST(a_signal_while_the_fmu_is_built_leaves_no_folder)
{
    static const int numbers[] = {SIGTERM, SIGINT, SIGKILL};
    char folder[256], out[256], err[256], fmu[256], cc[300], begun[300];
    snprintf(folder, sizeof folder, "%s", scratch("."));
    snprintf(out, sizeof out, "%s", scratch("out"));
    snprintf(err, sizeof err, "%s", scratch("err"));
    snprintf(fmu, sizeof fmu, "%s", scratch("ended.fmu"));
    snprintf(begun, sizeof begun, "%s", scratch("begun"));
    snprintf(cc, sizeof cc, "%s",
             scratch_text("slow-cc", "#!/bin/sh\ntouch \"$TMPDIR/begun\"\nexec sleep 3\n"));
    ck_assert_int_eq(chmod(cc, 0700), 0);
    setenv("TMPDIR", folder, 1);
    setenv("CC", cc, 1);
    const char *const argv[] = {"mechkit", "export", "--model", MK_SOURCE_DIR "/models/furuta.ini",
                                "--out",   fmu,      NULL};
    pid_t child = spawn(argv, out, err);
    for (int i = 0; i < 2000 && access(begun, F_OK) != 0; i++)
        usleep(10000);
    ck_assert_int_eq(count_files("mechkit-fmu*"), 1);
    kill(child, numbers[_i]);
    struct outcome o = finish(child, out, err);
    ck_assert_int_eq(o.code, -numbers[_i]);
    ck_assert_int_eq(count_files("mechkit-fmu*"), numbers[_i] == SIGKILL ? 1 : 0);
    setenv("CC", "true", 1); /* makes nothing; what was left is gone all the same */
    ck_assert_int_eq(run_mechkit(NULL, 0, "export --model models/furuta.ini --out %s", fmu), 1);
    ck_assert_int_eq(count_files("mechkit-fmu*"), 0);
    unsetenv("CC");
    unsetenv("TMPDIR");
}
END_TEST

START_TEST(fmpy_validates_the_fmu_and_predicts_what_simulate_predicts)
{
    char out[8192];
    const char *python = fmpy_python();
    if (!python) {
        fprintf(stderr, "%s: skipped, FMPy is not installed (`make fmpy` does it in build/)\n",
                "fmpy_validates_the_fmu_and_predicts_what_simulate_predicts");
        return;
    }
    struct mk_model m;
    bouncing_model(&m);
    ck_assert_int_eq(mk_model_write(scratch("hard.ini"), &m, NULL, NULL), MK_OK);
    const char *log = open_loop_log("pendubot", "1.5*sin(6*t)", 2.0), *pred = scratch("pred.csv");
    int code = run_mechkit(out, sizeof out, "simulate --model %s --input %s --out %s --states",
                           scratch("hard.ini"), log, pred);
    ck_assert_msg(code == 0, "%s", out);
    code = run_mechkit(out, sizeof out, "export --model %s --out %s", scratch("hard.ini"),
                       scratch("rig.fmu"));
    ck_assert_msg(code == 0, "%s", out);
    code = run_command(out, sizeof out, "%s %s/tests/fmpy/follow.py %s %s %s", python,
                       MK_SOURCE_DIR, scratch("rig.fmu"), log, pred);
    ck_assert_msg(code == 0, "%s", out);
}
END_TEST

START_TEST(parameters_are_labelled_in_the_units_that_they_have)
{
    static const struct {
        double u_to_torque;
        const char *has, *has_not, *command;
    } rows[] = {{0.00494, "u s^2/rad", "kg m^2", "unit=\"u\""},
                {1.0, "kg m^2", "u s^2/rad", "unit=\"N m\""}};
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        struct mk_model m;
        bool compiled;
        struct mk_error err = MK_ERROR_INIT;
        mk_model_default(MK_PLANT_PENDULUM, &m);
        m.u_to_torque = rows[i].u_to_torque;
        ck_assert_int_eq(mk_export_c(scratch("units.c"), &m, &err), MK_OK);
        ck_assert_int_eq(mk_export_octave(scratch("units.m"), &m, &err), MK_OK);
        ck_assert_int_eq(mk_export_fmu(scratch("units.fmu"), &m, &compiled, &err), MK_OK);
        const char *files[] = {"units.c", "units.h", "units.m"};
        bool found = false;
        for (int k = 0; k < 3; k++) {
            char *text = slurp_file(scratch(files[k]));
            ck_assert_msg(!strstr(text, rows[i].has_not), "%s", files[k]);
            found = found || strstr(text, rows[i].has);
            free(text);
        }
        ck_assert(found);
        if (!have_program("unzip", "the units of an FMU"))
            continue;
        static char xml[60000];
        ck_assert_int_eq(
            run_command(xml, sizeof xml, "unzip -p %s modelDescription.xml", scratch("units.fmu")),
            0);
        char unit[80];
        snprintf(unit, sizeof unit, "<Real unit=\"%s\"", rows[i].has);
        ck_assert_msg(strstr(xml, unit), "%s", xml);
        snprintf(unit, sizeof unit, "<Unit name=\"%s\"/>", rows[i].has);
        ck_assert_ptr_nonnull(strstr(xml, unit));
        ck_assert_ptr_nonnull(strstr(xml, rows[i].command));
        ck_assert_ptr_null(strstr(xml, rows[i].has_not));
    }
}
END_TEST

START_TEST(a_file_name_that_is_no_function_name_is_refused)
{
    struct mk_model m;
    struct mk_error err = MK_ERROR_INIT;
    mk_model_default(MK_PLANT_PENDULUM, &m);
    ck_assert_int_eq(mk_export_c(scratch("2nd.c"), &m, &err), MK_ERR_USAGE);
    ck_assert_int_eq(mk_export_octave(scratch("my-rig.m"), &m, &err), MK_ERR_USAGE);
    ck_assert_int_eq(mk_export_octave(scratch("end.m"), &m, &err), MK_ERR_USAGE);
    ck_assert_int_eq(mk_export_c(scratch("double.c"), &m, &err), MK_ERR_USAGE);
    ck_assert_ptr_nonnull(strstr(err.message, "double is a word of the language"));
    char out[1024];
    ck_assert_int_eq(run_mechkit(out, sizeof out,
                                 "export --model %s/models/pendubot.ini --out x.py", MK_SOURCE_DIR),
                     2);
}
END_TEST

/* Its limit holds for one file; the source is larger than the header. */
START_TEST(a_full_disk_leaves_neither_half_of_an_export)
{
    char out[2048], folder[300];
    snprintf(folder, sizeof folder, "%s", scratch("full"));
    int code = run_command(out, sizeof out,
                           "mkdir -p %s && cd %s && (ulimit -f 8; trap '' XFSZ; "
                           "exec %s export --model %s/models/pendubot.ini --out rig.c)",
                           folder, folder, MK_TEST_APP, MK_SOURCE_DIR);
    ck_assert_msg(code == 1 && strstr(out, "rig.c: cannot write"), "%d %s", code, out);
    ck_assert_int_eq(count_files("full/*"), 0);
    code = run_command(out, sizeof out,
                       "cd %s && %s export --model %s/models/pendubot.ini --out rig.c", folder,
                       MK_TEST_APP, MK_SOURCE_DIR);
    ck_assert_msg(code == 0, "%s", out);
    ck_assert_int_eq(count_files("full/*"), 2);
}
END_TEST

Suite *suite_export_model(void)
{
    Suite *s = suite_create("export_model");
    TCase *c = tcase_create("c");
    tcase_set_timeout(c, 120);
    tcase_add_loop_test(c, exported_equations_are_the_library_s_with_every_effect, 0,
                        MK_PLANT_COUNT);
    tcase_add_loop_test(c, an_exported_model_runs_as_the_simulation_does, 0, MK_PLANT_COUNT);
    tcase_add_test(c, parameters_are_labelled_in_the_units_that_they_have);
    tcase_add_test(c, a_full_disk_leaves_neither_half_of_an_export);
    tcase_add_test(c, a_file_name_that_is_no_function_name_is_refused);
    suite_add_tcase(s, c);
    c = tcase_create("fmu");
    tcase_set_timeout(c, 120);
    tcase_add_test(c, an_fmu_with_play_predicts_what_simulate_predicts);
    tcase_add_test(c, an_fmu_with_an_old_sensor_does_not_mind_tiny_steps);
    tcase_add_test(c, an_fmu_without_a_compiler_has_its_sources);
    tcase_add_test(c, an_fmu_that_cannot_be_compiled_says_what_the_compiler_says);
    tcase_add_test(c, an_fmu_without_a_folder_to_be_built_in_names_it);
    tcase_add_loop_test(c, a_signal_while_the_fmu_is_built_leaves_no_folder, 0, 3);
    tcase_add_test(c, fmpy_validates_the_fmu_and_predicts_what_simulate_predicts);
    suite_add_tcase(s, c);
    c = tcase_create("octave");
    tcase_set_timeout(c, 300);
    tcase_add_test(c, octave_s_model_predicts_what_simulate_predicts);
    suite_add_tcase(s, c);
    return s;
}
