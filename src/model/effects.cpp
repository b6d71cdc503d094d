// The table of effects as C sees it.
#include <cstring>

#include "model/effects_list.hpp"

namespace
{

// The row of an effect without the plants that say that it makes no sense on them.
constexpr mk_effect_info suited(mk_effect_info effect)
{
    effect.plants &= mk::plants_suited_to(effect.name);
    return effect;
}

constexpr mk_effect_info effects[] = {
#define MK_EFFECT_INFO(E) suited(mk::E::info),
    MK_EFFECT_TABLE(MK_EFFECT_INFO)
#undef MK_EFFECT_INFO
};
const mk_effect_words *const words[] = {
#define MK_EFFECT_WORDS(E) &mk::E::words,
    MK_EFFECT_TABLE(MK_EFFECT_WORDS)
#undef MK_EFFECT_WORDS
};
constexpr int effect_count = sizeof effects / sizeof effects[0];

} // namespace

int mk_effect_count(void)
{
    return effect_count;
}

const mk_effect_info *mk_effect(int index)
{
    return index >= 0 && index < effect_count ? &effects[index] : nullptr;
}

static int index_of(const char *name)
{
    for (int i = 0; i < effect_count; i++)
        if (strcmp(effects[i].name, name) == 0)
            return i;
    return -1;
}

const mk_effect_info *mk_effect_by_name(const char *name)
{
    int i = name ? index_of(name) : -1;
    return i < 0 ? nullptr : &effects[i];
}

const mk_effect_words *mk_effect_in_words(const mk_effect_info *effect)
{
    return words[index_of(effect->name)];
}

int mk_effect_parameter_index(const mk_effect_info *effect, const char *name)
{
    for (int i = 0; i < effect->parameter_count; i++)
        if (strcmp(effect->parameter[i].name, name) == 0)
            return i;
    return -1;
}

bool mk_parameter_may_differ(const mk_parameter_info *info)
{
    return info->fit == MK_FIT_FREE || info->fit == MK_FIT_CENTRE;
}

bool mk_parameter_goes_without_saying(const mk_parameter_info *info)
{
    return info->fit == MK_FIT_FIXED && info->optional;
}

bool mk_model_has_own_values(const mk_model *model)
{
    for (int e = 0; e < model->effect_count; e++)
        for (double spread : model->effect[e].spread)
            if (spread > 0.0)
                return true;
    return false;
}

static enum mk_status check_fit(const mk_model *model, const mk_effect_info *info, int joint,
                                mk_error *err)
{
    const mk_plant_info *plant = mk_plant(model->plant);
    if (!(info->plants & (1u << model->plant)))
        return mk_error_set(err, MK_ERR_INVALID, "effect '%s' makes no sense on the %s", info->name,
                            plant->name);
    if (info->joint_rule == MK_EFFECT_JOINT_NONE && joint != 0)
        return mk_error_set(err, MK_ERR_INVALID, "effect '%s' acts on the rig: leave out joint",
                            info->name);
    bool needs = info->joint_rule == MK_EFFECT_JOINT_ANY;
    if (joint < (needs ? 1 : 0) || joint > plant->joints)
        return mk_error_set(err, MK_ERR_INVALID, "effect '%s' needs joint = 1%s, not %d",
                            info->name, plant->joints > 1 ? " or 2" : "", joint);
    return MK_OK;
}

enum mk_status mk_model_add_effect(mk_model *model, const char *name, int joint, mk_error *err)
{
    int index = name ? index_of(name) : -1;
    if (index < 0)
        return mk_error_set(err, MK_ERR_NOTFOUND, "there is no effect '%s'", name ? name : "");
    const mk_effect_info *info = &effects[index];
    enum mk_status st = check_fit(model, info, joint, err);
    if (st != MK_OK)
        return st;
    if (model->effect_count >= MK_MAX_EFFECTS)
        return mk_error_set(err, MK_ERR_RANGE, "a model has at most %d effects", MK_MAX_EFFECTS);
    mk_effect_use *use = &model->effect[model->effect_count];
    int states = mk_model_state_count(model) + info->state_count;
    int events = mk_model_event_count(model) + info->event_count;
    if (states > MK_MAX_STATES || events > MK_MAX_EVENTS)
        return mk_error_set(err, MK_ERR_RANGE, "too many effects with states or switching");
    *use = {};
    use->index = index;
    use->joint = joint;
    for (int i = 0; i < info->parameter_count; i++)
        use->value[i] = strcmp(info->parameter[i].name, mk::SHARPNESS.name) == 0
                            ? mk_model_sharpness(model, joint - 1)
                            : info->parameter[i].initial;
    model->effect_count++;
    return MK_OK;
}
