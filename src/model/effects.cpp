// The table of effects as C sees it.
#include <cstring>

#include "model/effects_list.hpp"

namespace
{

// The row of an effect with what the plants' rows say of it: where it makes no sense, and where
// a parameter does something that has nothing to do elsewhere.
constexpr mk_effect_info suited(mk_effect_info effect)
{
    effect.plants &= mk::plants_suited_to(effect.name);
    for (int k = 0; k < effect.parameter_count; k++)
        effect.parameter[k].plants = mk::plants_that_own(effect.parameter[k].name);
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

bool mk_parameter_applies(const mk_parameter_info *info, enum mk_plant_kind plant)
{
    return info->plants == 0 || (info->plants & (1u << plant)) != 0;
}

bool mk_parameter_goes_without_saying(const mk_parameter_info *info, enum mk_plant_kind plant)
{
    return (info->fit == MK_FIT_FIXED && info->optional) || !mk_parameter_applies(info, plant);
}

bool mk_model_has_own_values(const mk_model *model)
{
    for (int e = 0; e < model->effect_count; e++)
        for (double spread : model->effect[e].spread)
            if (spread > 0.0)
                return true;
    return false;
}
