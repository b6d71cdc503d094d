// report.json, to the letter of docs/formats.md.
#include <cmath>
#include <cstdio>
#include <memory>
#include <string>

#include "experiment/data_check_json.h"
#include "ident/input_report.h"
#include "ident/left_out_json.h"
#include "mechkit/explain.h"
#include "mechkit/json.h"

namespace
{

cJSON *parameters_of(const mk_model &model, const mk_cause &c)
{
    cJSON *all = cJSON_CreateObject();
    for (int k = 0; k < c.effect->parameter_count; k++) {
        if (!mk_parameter_applies(&c.effect->parameter[k], model.plant))
            continue;
        cJSON *p = cJSON_AddObjectToObject(all, c.effect->parameter[k].name);
        cJSON_AddItemToObject(p, "value", mk_json_number(c.value[k]));
        // Whole numbers were tried one by one: no other is near.
        const bool whole = c.effect->parameter[k].fit == MK_FIT_INTEGER;
        cJSON_AddItemToObject(p, "stderr", mk_json_number(whole ? 0.0 : c.std_error[k]));
        if (whole)
            cJSON_AddTrueToObject(p, "integer");
        cJSON_AddStringToObject(p, "unit",
                                mk_effect_parameter_unit(&model, c.joint, &c.effect->parameter[k]));
    }
    return all;
}

cJSON *joint_of(int joint)
{
    return joint > 0 ? cJSON_CreateNumber(joint) : cJSON_CreateNull();
}

// What differs from log to log, beside the parameter's common value.
void add_own_values(cJSON *parameters, const mk_explanation &e, const mk_cause &c)
{
    for (int k = 0; k < c.effect->parameter_count; k++) {
        cJSON *p = cJSON_GetObjectItem(parameters, c.effect->parameter[k].name);
        if (!(c.spread[k] > 0.0))
            continue;
        cJSON_AddItemToObject(p, "spread", mk_json_number(c.spread[k]));
        cJSON *values = cJSON_AddArrayToObject(p, "own_values");
        for (int i = 0; i < e.per_log_count; i++) {
            const mk_per_log &v = e.per_log[i];
            if (v.effect != c.effect || v.joint != c.joint || v.parameter != k)
                continue;
            cJSON *one = cJSON_CreateObject();
            cJSON_AddItemToObject(one, "log", cJSON_CreateNumber(v.log + 1));
            cJSON_AddItemToObject(one, "value", mk_json_number(v.value));
            cJSON_AddItemToObject(one, "stderr", mk_json_number(v.std_error));
            if (v.mean_open)
                cJSON_AddTrueToObject(one, "mean_open");
            cJSON_AddItemToArray(values, one);
        }
    }
}

cJSON *cause_json(const mk_explanation &e, const mk_cause &c)
{
    cJSON *o = cJSON_CreateObject();
    cJSON_AddStringToObject(o, "name", c.effect->name);
    cJSON_AddItemToObject(o, "joint", joint_of(c.joint));
    cJSON *parameters = parameters_of(e.given, c);
    add_own_values(parameters, e, c);
    cJSON_AddItemToObject(o, "parameters", parameters);
    cJSON *nlml = cJSON_AddObjectToObject(o, "evidence");
    cJSON_AddItemToObject(nlml, "delta_bic", mk_json_number(c.delta_bic));
    cJSON_AddItemToObject(nlml, "p_value", mk_json_number(c.p_value));
    cJSON_AddItemToObject(o, "confidence", mk_json_number(c.confidence));
    if (const mk_effect_words *words = mk_effect_in_words(c.effect); words->title) {
        cJSON_AddStringToObject(o, "title", words->title);
        cJSON_AddStringToObject(o, "usual_cause", words->usual);
        cJSON_AddStringToObject(o, "what_to_do", words->remedy);
    }
    return o;
}

cJSON *suspects_json(const mk_explanation &e)
{
    cJSON *all = cJSON_CreateArray();
    for (int i = 0; i < e.suspect_count; i++) {
        const mk_suspect &s = e.suspect[i];
        cJSON *o = cJSON_CreateObject();
        cJSON_AddStringToObject(o, "name", s.effect->name);
        cJSON_AddItemToObject(o, "joint", joint_of(s.joint));
        cJSON_AddItemToObject(o, "share", mk_json_number(s.share));
        cJSON_AddNumberToObject(o, "parts", s.parts);
        cJSON_AddNumberToObject(o, "better_in", s.better_in);
        cJSON_AddItemToArray(all, o);
    }
    return all;
}

// A cause that every log has a value of its own of.
cJSON *log_value_json(const mk_explanation &e, const mk_cause &c)
{
    cJSON *o = cause_json(e, c);
    cJSON_AddTrueToObject(o, "per_log");
    return o;
}

// What may stand in the place of a cause as well.
cJSON *instead_json(const mk_explanation &e, int cause)
{
    cJSON *all = cJSON_CreateArray();
    for (int i = 0; i < e.rival_count; i++) {
        const mk_rival &r = e.rival[i];
        char name[96];
        if (r.instead_of != cause || r.distinguishable)
            continue;
        snprintf(name, sizeof name, r.joint ? "%s at joint %d" : "%s", r.effect->name, r.joint);
        cJSON_AddItemToArray(all, cJSON_CreateString(name));
    }
    return all;
}

cJSON *budget_json(const mk_explanation &e)
{
    const mk_budget &b = e.budget;
    const size_t n = (size_t)mk_model_joints(&e.given);
    const int named = e.verdict == MK_VERDICT_UNKNOWN ? 0 : e.cause_count - e.piece_count;
    cJSON *o = cJSON_CreateObject();
    cJSON *units = cJSON_AddArrayToObject(o, "unit");
    for (size_t j = 0; j < n; j++)
        cJSON_AddItemToArray(units, cJSON_CreateString(mk_model_unit(&e.given, (int)j, "rad")));
    cJSON_AddItemToObject(o, "given", mk_json_numbers(b.given, n));
    cJSON_AddItemToObject(o, "refit", mk_json_numbers(b.refit, n));
    cJSON_AddItemToObject(o, "extended", mk_json_numbers(b.extended, n));
    cJSON_AddItemToObject(o, "noise", mk_json_numbers(b.noise, n));
    cJSON_AddItemToObject(o, "closed", mk_json_number(b.closed));
    cJSON *items = cJSON_AddArrayToObject(o, "items");
    for (int i = 0; i < b.item_count; i++) {
        const mk_budget_item &item = b.item[i];
        cJSON *one = cJSON_CreateObject();
        // Causes, then what differs from log to log, then terms without a name.
        const int place = item.log_value >= 0                     ? named + item.log_value
                          : item.cause >= 0 && item.cause < named ? item.cause
                                                                  : -1;
        cJSON_AddItemToObject(one, "cause",
                              place < 0 ? cJSON_CreateNull() : cJSON_CreateNumber(place));
        if (item.input)
            cJSON_AddTrueToObject(one, "input");
        else if (place < 0)
            cJSON_AddItemToObject(one, "term", cJSON_CreateNumber(item.cause - named));
        cJSON_AddItemToObject(one, "share", mk_json_number(item.share));
        cJSON_AddItemToObject(one, "low", mk_json_number(item.low));
        cJSON_AddItemToObject(one, "high", mk_json_number(item.high));
        cJSON_AddItemToObject(one, "inclusion", mk_json_number(item.inclusion));
        cJSON_AddItemToObject(one, "instead", instead_json(e, item.cause));
        cJSON_AddItemToObject(one, "rms", mk_json_numbers(item.rms, n));
        cJSON_AddItemToArray(items, one);
    }
    cJSON *rest = cJSON_AddObjectToObject(o, "rest");
    cJSON_AddItemToObject(rest, "share", mk_json_number(b.rest));
    cJSON_AddItemToObject(rest, "joint", joint_of(b.rest_joint));
    cJSON *goes = cJSON_AddArrayToObject(rest, "goes_with");
    for (int i = 0; i < b.goes_with_count; i++)
        cJSON_AddItemToArray(goes, cJSON_CreateString(b.goes_with[i]));
    return o;
}

cJSON *rivals_json(const mk_explanation &e)
{
    cJSON *all = cJSON_CreateArray();
    for (int i = 0; i < e.rival_count; i++) {
        const mk_rival &r = e.rival[i];
        cJSON *o = cJSON_CreateObject();
        cJSON_AddStringToObject(o, "name", r.effect->name);
        cJSON_AddItemToObject(o, "joint", joint_of(r.joint));
        cJSON_AddItemToObject(o, "delta_bic", mk_json_number(r.delta_bic));
        cJSON_AddBoolToObject(o, "distinguishable", r.distinguishable);
        if (r.instead_of < e.cause_count)
            cJSON_AddStringToObject(o, "instead_of", e.cause[r.instead_of].effect->name);
        cJSON_AddItemToArray(all, o);
    }
    return all;
}

cJSON *limits_json(const mk_explanation &e)
{
    cJSON *all = cJSON_CreateArray();
    for (int i = 0; i < e.detection_limit_count; i++) {
        const mk_detection_limit &l = e.detection_limit[i];
        const mk_parameter_info &p = l.effect->parameter[l.parameter];
        cJSON *o = cJSON_CreateObject();
        cJSON_AddStringToObject(o, "name", l.effect->name);
        cJSON_AddItemToObject(o, "joint", joint_of(l.joint));
        cJSON_AddStringToObject(o, "parameter", p.name);
        cJSON_AddItemToObject(o, "least", mk_json_number(l.least));
        cJSON_AddStringToObject(o, "unit", mk_effect_parameter_unit(&e.given, l.joint, &p));
        cJSON_AddItemToArray(all, o);
    }
    return all;
}

cJSON *base_parameters(const mk_explanation &e)
{
    cJSON *all = cJSON_CreateObject();
    const mk_plant_info *plant = mk_plant(e.given.plant);
    const mk_model &fitted = e.offered ? e.extended : e.refit;
    for (int i = 0; i < plant->parameter_count; i++) {
        cJSON *p = cJSON_AddObjectToObject(all, plant->parameter[i].name);
        cJSON_AddItemToObject(p, "value", mk_json_number(fitted.parameter[i]));
        cJSON_AddItemToObject(p, "stderr", mk_json_number(e.std_error[i]));
        cJSON_AddItemToObject(p, "prior", mk_json_number(e.given.parameter[i]));
        cJSON_AddItemToObject(p, "refit", mk_json_number(e.refit.parameter[i]));
    }
    return all;
}

cJSON *holdout_json(const mk_explanation &e, const char *const *names, size_t count)
{
    cJSON *o = cJSON_CreateObject();
    cJSON *files = cJSON_AddArrayToObject(o, "files");
    for (size_t i = 0; i < count; i++)
        cJSON_AddItemToArray(files, cJSON_CreateString(names[i]));
    if (e.held_back) {
        cJSON_AddItemToObject(o, "held_back_from_s", mk_json_number(e.held_from));
        cJSON_AddItemToObject(o, "held_back_to_s", mk_json_number(e.held_to));
    }
    size_t n = (size_t)mk_model_joints(&e.given);
    cJSON_AddItemToObject(o, "window_s", mk_json_number(e.window_s));
    cJSON_AddItemToObject(o, "nrmse_before", mk_json_numbers(e.before, n));
    cJSON_AddItemToObject(o, "nrmse_refit", mk_json_numbers(e.refitted, n));
    cJSON_AddItemToObject(o, "nrmse_after", mk_json_numbers(e.after, n));
    cJSON_AddItemToObject(o, "noise_floor", mk_json_numbers(e.floor, n));
    cJSON_AddItemToObject(o, "command_beyond", mk_json_number(e.command_beyond));
    if (e.held_counts_corrected > 0)
        cJSON_AddNumberToObject(o, "counts_corrected", e.held_counts_corrected);
    if (e.cause_count > 0 && !e.offered)
        cJSON_AddItemToObject(o, "nrmse_declined", mk_json_numbers(e.declined, n));
    cJSON_AddItemToObject(o, "closed", mk_json_number(e.closed));
    return o;
}

// One-step predictions of the training data.
cJSON *residuals_json(const mk_explanation &e)
{
    cJSON *o = cJSON_CreateObject();
    size_t n = (size_t)mk_model_joints(&e.given);
    cJSON_AddItemToObject(o, "one_step_refit", mk_json_numbers(e.one_step_refit, n));
    cJSON_AddItemToObject(o, "one_step_extended", mk_json_numbers(e.one_step_extended, n));
    cJSON *tests = cJSON_AddArrayToObject(o, "tests");
    for (int i = 0; i < e.residual_test_count; i++) {
        const mk_residual_test &t = e.residual_test[i];
        cJSON *one = cJSON_CreateObject();
        cJSON_AddItemToObject(one, "joint", cJSON_CreateNumber(t.joint));
        cJSON_AddStringToObject(one, "with", t.with);
        cJSON_AddItemToObject(one, "refit", mk_json_number(t.before));
        cJSON_AddItemToObject(one, "p_refit", mk_json_number(t.p_before));
        cJSON_AddItemToObject(one, "extended", mk_json_number(t.after));
        cJSON_AddItemToObject(one, "p_extended", mk_json_number(t.p_after));
        cJSON_AddItemToArray(tests, one);
    }
    return o;
}

cJSON *figures_json(const mk_control_figures &f)
{
    cJSON *o = cJSON_CreateObject();
    cJSON_AddItemToObject(o, "held", mk_json_number(f.held));
    cJSON_AddItemToObject(o, "caught_s", mk_json_number(f.caught_s));
    cJSON_AddItemToObject(o, "error_rms", mk_json_number(f.error));
    cJSON_AddItemToObject(o, "off_rms", mk_json_number(f.off));
    cJSON_AddItemToObject(o, "command_rms", mk_json_number(f.effort));
    cJSON_AddItemToObject(o, "command_peak", mk_json_number(f.peak));
    return o;
}

// What the extension is worth to the rig's setups; only where it was tried.
cJSON *control_json(const mk_explanation &e)
{
    cJSON *all = cJSON_CreateObject();
    for (int i = 0; i < e.control_count; i++) {
        const mk_control_gain &c = e.control[i];
        cJSON *o = cJSON_AddObjectToObject(all, c.setup);
        cJSON_AddItemToObject(o, "runs", cJSON_CreateNumber(c.runs));
        cJSON_AddItemToObject(o, "given", figures_json(c.given));
        cJSON_AddItemToObject(o, "refit", figures_json(c.refit));
        cJSON_AddItemToObject(o, "extended", figures_json(c.extended));
        const char *believing, *worse = mk_control_gain_worse(&c, &believing);
        cJSON_AddBoolToObject(o, "recommended", !worse);
        cJSON_AddStringToObject(o, "worse", worse ? worse : "");
    }
    return all;
}

cJSON *origin_json(const mk_origin &origin)
{
    cJSON *o = cJSON_CreateObject();
    cJSON_AddStringToObject(o, "date", origin.date);
    cJSON_AddStringToObject(o, "program", "mechkit " MK_VERSION);
    cJSON_AddStringToObject(o, "command", origin.command);
    cJSON_AddStringToObject(o, "model", origin.model);
    cJSON *logs = cJSON_AddArrayToObject(o, "logs");
    for (size_t i = 0; i < origin.log_count; i++)
        cJSON_AddItemToArray(logs, cJSON_CreateString(origin.logs[i]));
    return o;
}

// Shifts of the readings to the zero of the first log.
cJSON *places_json(const mk_explanation &e)
{
    const mk_places &p = e.places;
    cJSON *o = cJSON_CreateObject();
    cJSON_AddNumberToObject(o, "joint", p.joint);
    cJSON_AddStringToObject(o, "by", p.by->name);
    cJSON_AddNumberToObject(o, "cycles", p.cycles);
    cJSON_AddStringToObject(o, "unit", mk_model_unit(&e.given, p.joint - 1, "rad"));
    cJSON *shifts = cJSON_AddArrayToObject(o, "shifts");
    for (int i = 0; i < p.count; i++) {
        const bool learned = i < p.learned;
        cJSON *one = cJSON_CreateObject();
        cJSON_AddNumberToObject(one, learned ? "log" : "holdout",
                                learned ? i + 1 : i - p.learned + 1);
        cJSON_AddItemToObject(one, "value", mk_json_number(p.shift[i]));
        cJSON_AddItemToObject(one, "stderr", mk_json_number(p.std_error[i]));
        cJSON_AddItemToArray(shifts, one);
    }
    return o;
}

} // namespace

enum mk_status mk_explanation_write_json(const mk_explanation *e, const char *path,
                                         const char *const *holdout_names, size_t holdout_count,
                                         mk_error *err)
{
    std::unique_ptr<cJSON, void (*)(cJSON *)> root(cJSON_CreateObject(), cJSON_Delete);
    cJSON *o = root.get();
    if (!o)
        return mk_error_set(err, MK_ERR_NOMEM, "no memory for the report");
    if (e->origin)
        cJSON_AddItemToObject(o, "origin", origin_json(*e->origin));
    cJSON_AddItemToObject(o, "data_checks", data_check_json(&e->data_check));
    bool unknown = e->verdict == MK_VERDICT_UNKNOWN;
    cJSON_AddStringToObject(o, "verdict", mk_verdict_name(e->verdict));
    cJSON_AddItemToObject(o, "left_out", left_out_json(e->left_out, e->left_out_count));
    cJSON *causes = cJSON_AddArrayToObject(o, "causes");
    const int named = unknown ? 0 : e->cause_count - e->piece_count;
    for (int i = 0; i < named; i++)
        cJSON_AddItemToArray(causes, cause_json(*e, e->cause[i]));
    for (int i = 0; i < e->log_value_count; i++)
        cJSON_AddItemToArray(causes, log_value_json(*e, e->log_value[i]));
    if (named < e->cause_count) {
        cJSON *terms = cJSON_AddArrayToObject(o, "terms");
        for (int i = named; i < e->cause_count; i++)
            cJSON_AddItemToArray(terms, cause_json(*e, e->cause[i]));
    }
    if (e->input.made)
        cJSON_AddItemToObject(o, "input", mk_input_json(&e->input));
    if (e->places.joint > 0)
        cJSON_AddItemToObject(o, "places", places_json(*e));
    cJSON_AddItemToObject(o, "rivals", rivals_json(*e));
    cJSON_AddItemToObject(o, "suspects", suspects_json(*e));
    cJSON_AddItemToObject(o, "budget", budget_json(*e));
    cJSON_AddStringToObject(o, "structure", e->structure);
    cJSON_AddItemToObject(o, "detection_limits", limits_json(*e));
    cJSON_AddItemToObject(o, "parameters", base_parameters(*e));
    cJSON_AddStringToObject(o, "scale", e->scale_free ? "free" : "known");
    if (e->scale_free)
        cJSON_AddStringToObject(o, "scale_held",
                                mk_plant(e->given.plant)->parameter[e->scale_holder].name);
    cJSON_AddItemToObject(o, "holdout", holdout_json(*e, holdout_names, holdout_count));
    if (e->next.input[0]) {
        cJSON *next = cJSON_AddObjectToObject(o, "next_experiment");
        cJSON_AddStringToObject(next, "why", e->next.why);
        cJSON_AddStringToObject(next, "input", e->next.input);
        cJSON_AddItemToObject(next, "log_odds", mk_json_number(e->next.odds));
        cJSON_AddStringToObject(next, "script", "next.cmd");
    } else {
        cJSON_AddNullToObject(o, "next_experiment");
    }
    cJSON_AddItemToObject(o, "residuals", residuals_json(*e));
    if (e->control_count > 0)
        cJSON_AddItemToObject(o, "control", control_json(*e));
    cJSON *misfit = cJSON_AddObjectToObject(o, "misfit");
    const std::string unit = mk_model_unit(&e->given, -1, "rad/s per sqrt(s)");
    const double size = mk_model_joint_scale(&e->given, mk_plant(e->given.plant)->motor_joint);
    cJSON_AddStringToObject(misfit, "what", ("process noise of the speeds, " + unit).c_str());
    cJSON_AddItemToObject(misfit, "refit", mk_json_number(e->process_noise_refit * size));
    cJSON_AddItemToObject(misfit, "extended", mk_json_number(e->process_noise_extended * size));
    cJSON_AddItemToObject(o, "seconds", mk_json_number(e->seconds));
    cJSON *stages = cJSON_AddObjectToObject(o, "stage_seconds");
    for (int i = 0; i < e->stage_count; i++)
        cJSON_AddItemToObject(stages, e->stage[i].name, mk_json_number(e->stage[i].seconds));
    return mk_json_write(path, o, err);
}
