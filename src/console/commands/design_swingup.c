#include "console/commands/design_swingup.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "base/out_file.h"
#include "console/commands/sub.h"
#include "mechkit/json.h"
#include "mechkit/sim.h"

#define PATH 512
#define ARRIVED_RAD 0.02 /* unstable motions amplify what solvers differ by */

/* "dir/rig.ini" and "mid" to "dir/rig-mid-swingup.csv". */
static enum mk_status path_beside(const char *model, const char *at, char out[PATH],
                                  struct mk_error *err)
{
    size_t n = strlen(model);
    if (n >= 4 && strcmp(model + n - 4, ".ini") == 0)
        n -= 4;
    int used = snprintf(out, PATH, "%.*s-%s-swingup.csv", (int)n, model, at);
    return used > 0 && used < PATH
               ? MK_OK
               : mk_error_set(err, MK_ERR_INVALID, "the path is too long: %s", model);
}

/* Where the commands lead when SUNDIALS integrates them: the largest error of an angle at the end.
 */
static enum mk_status integrate(const struct mk_swingup *s, double *off, struct mk_error *err)
{
    struct mk_sim_config config = {.rtol = 1e-11, .atol = 1e-12};
    struct mk_sim *sim;
    enum mk_status st = mk_sim_create(&s->model, &config, &sim, err);
    if (st == MK_OK)
        st = mk_sim_reset(sim, 0.0, s->x, NULL);
    for (size_t k = 0; k < s->count && st == MK_OK; k++) {
        double u[MK_MAX_INPUTS] = {s->u[k], 0.0};
        st = mk_sim_advance(sim, (double)(k + 1) / s->rate_hz, u, err);
    }
    *off = 0.0;
    for (int j = 0; j < MK_MAX_JOINTS && st == MK_OK; j++)
        if (!mk_model_turns_freely(&s->model, j))
            *off = fmax(*off, fabs(mk_sim_state(sim)[j] - s->x[MK_SWINGUP_STATES * s->count + j]));
    mk_sim_destroy(sim);
    return st;
}

static double rms_command(const struct mk_swingup *s)
{
    double sum = 0.0;
    for (size_t k = 0; k < s->count; k++)
        sum += s->u[k] * s->u[k];
    return sqrt(sum / (double)s->count);
}

static enum mk_status write_json(const char *path, const struct mk_swingup *s, const char *file,
                                 double off, struct mk_error *err)
{
    const struct mk_plant_info *plant = mk_plant(s->model.plant);
    cJSON *root = cJSON_CreateObject();
    cJSON_AddStringToObject(root, "rig", plant->name);
    cJSON_AddStringToObject(root, "to", plant->equilibrium[s->equilibrium].name);
    cJSON_AddStringToObject(root, "file", file);
    cJSON_AddItemToObject(root, "optimum_s", mk_json_number(s->optimum_s));
    cJSON_AddItemToObject(root, "seconds", mk_json_number((double)s->count / s->rate_hz));
    cJSON_AddItemToObject(root, "limit", mk_json_number(s->limit));
    cJSON_AddItemToObject(root, "rms_command", mk_json_number(rms_command(s)));
    cJSON_AddItemToObject(root, "integrated_off_rad", mk_json_number(off));
    enum mk_status st = mk_json_write(path, root, err);
    cJSON_Delete(root);
    return st;
}

static void print(const struct mk_swingup *s, const char *file, double off)
{
    const struct mk_plant_info *plant = mk_plant(s->model.plant);
    printf("%s to %s: the shortest swing-up found takes %.3f s with |u| <= %g\n", plant->name,
           plant->equilibrium[s->equilibrium].name, s->optimum_s, s->model.u_max);
    printf("  to be followed: %.3f s with |u| <= %g, rms %.3g\n", (double)s->count / s->rate_hz,
           s->limit, rms_command(s));
    printf("  integrated by SUNDIALS it ends %.2g %s from the equilibrium\n", off,
           mk_model_unit(&s->model, plant->motor_joint, "rad"));
    printf("  wrote %s: `swingup %s` before `setup %s` follows it\n", show_name(file),
           show_name(file), plant->equilibrium[s->equilibrium].setup);
}

int design_swingup(const struct swingup_request *request, const struct mk_model *model,
                   const struct mk_equilibrium *to)
{
    struct mk_error err = MK_ERROR_INIT;
    struct mk_swingup *s = NULL;
    char beside[PATH];
    double off = 0.0;
    int equilibrium = (int)(to - mk_plant(model->plant)->equilibrium), code = EXIT_OK;
    enum mk_status st = path_beside(request->model_path, to->name, beside, &err);
    const char *file = request->out ? request->out : beside;
    if (st == MK_OK &&
        (mk_out_file_check(file, &err) != MK_OK || mk_out_file_check(request->json, &err) != MK_OK))
        return report_output_error(&err);
    if (st == MK_OK)
        st = mk_swingup_design(model, equilibrium, &request->options, &s, &err);
    if (st == MK_OK)
        st = integrate(s, &off, &err);
    if (st != MK_OK) {
        code = report_error(&err);
    } else if (!(off <= ARRIVED_RAD * mk_model_joint_scale(model, 0))) {
        mk_error_set(&err, MK_ERR_NUMERIC,
                     "the trajectory does not hold: integrated independently it ends %g off", off);
        code = report_error(&err);
    } else if (mk_swingup_write(file, s, &err) != MK_OK ||
               (request->json && write_json(request->json, s, file, off, &err) != MK_OK)) {
        code = report_output_error(&err);
    } else if (!request->json || strcmp(request->json, "-") != 0) {
        print(s, file, off);
    }
    mk_swingup_free(s);
    return code;
}
