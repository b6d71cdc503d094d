// Parameters of a model by number: base parameters first, then those of the effects in order.
#include <cstdio>
#include <cstring>

#include "mechkit/ident.h"

namespace
{

// Where parameter `index` lives: effect -1 is the plant.
struct Place {
    int effect, parameter;
};

Place place_of(const mk_model &model, int index)
{
    int count = mk_plant(model.plant)->parameter_count;
    if (index < count)
        return {-1, index};
    index -= count;
    for (int e = 0; e < model.effect_count; e++) {
        int n = mk_effect(model.effect[e].index)->parameter_count;
        if (index < n)
            return {e, index};
        index -= n;
    }
    return {-1, 0};
}

// "2" for the second effect of one name.
int ordinal(const mk_model &model, int effect)
{
    int n = 1;
    for (int e = 0; e < effect; e++)
        n += model.effect[e].index == model.effect[effect].index;
    return n;
}

} // namespace

double mk_model_parameter(const mk_model *model, int index)
{
    Place p = place_of(*model, index);
    return p.effect < 0 ? model->parameter[p.parameter]
                        : model->effect[p.effect].value[p.parameter];
}

void mk_model_set_parameter(mk_model *model, int index, double value)
{
    Place p = place_of(*model, index);
    if (p.effect < 0)
        model->parameter[p.parameter] = value;
    else
        model->effect[p.effect].value[p.parameter] = value;
}

double mk_model_parameter_spread(const mk_model *model, int index)
{
    Place p = place_of(*model, index);
    return p.effect < 0 ? 0.0 : model->effect[p.effect].spread[p.parameter];
}

void mk_model_set_parameter_spread(mk_model *model, int index, double spread)
{
    Place p = place_of(*model, index);
    if (p.effect >= 0)
        model->effect[p.effect].spread[p.parameter] = spread;
}

const mk_parameter_info *mk_model_parameter_info(const mk_model *model, int index, char *name,
                                                 size_t size)
{
    Place p = place_of(*model, index);
    if (p.effect < 0) {
        const mk_parameter_info *info = &mk_plant(model->plant)->parameter[p.parameter];
        if (name)
            snprintf(name, size, "%s", info->name);
        return info;
    }
    const mk_effect_info *effect = mk_effect(model->effect[p.effect].index);
    const mk_parameter_info *info = &effect->parameter[p.parameter];
    int n = ordinal(*model, p.effect);
    if (name && n > 1)
        snprintf(name, size, "effect.%s.%d.%s", effect->name, n, info->name);
    else if (name)
        snprintf(name, size, "effect.%s.%s", effect->name, info->name);
    return info;
}

const char *mk_model_parameter_unit(const mk_model *model, int index)
{
    Place p = place_of(*model, index);
    const mk_plant_info *plant = mk_plant(model->plant);
    if (p.effect < 0)
        return mk_model_unit(model, plant->parameter_joint[p.parameter],
                             plant->parameter[p.parameter].unit);
    const mk_effect_use &use = model->effect[p.effect];
    return mk_effect_parameter_unit(model, use.joint,
                                    &mk_effect(use.index)->parameter[p.parameter]);
}
