#include "console/commands/fix.h"

#include <stdio.h>
#include <string.h>

#include "mechkit/ident.h"

static int find(const struct mk_model *model, const char *wanted)
{
    for (int i = 0; i < mk_model_parameter_count(model); i++) {
        char name[64];
        mk_model_parameter_info(model, i, name, sizeof name);
        if (strcmp(name, wanted) == 0)
            return i;
    }
    return -1;
}

static int unknown(const char *command, const struct mk_model *model, const char *wanted)
{
    char name[64], known[600] = "";
    for (int i = 0; i < mk_model_parameter_count(model); i++) {
        mk_model_parameter_info(model, i, name, sizeof name);
        size_t used = strlen(known);
        snprintf(known + used, sizeof known - used, "%s%s", i ? ", " : "", name);
    }
    return report_usage(command, "--fix %s: the model has no such parameter; it has %s", wanted,
                        known);
}

int fix_parameters(const char *command, const struct option_texts *names,
                   const struct mk_model *model, bool *fixed)
{
    for (size_t k = 0; k < names->count; k++) {
        int index = find(model, names->text[k]);
        if (index < 0)
            return unknown(command, model, names->text[k]);
        fixed[index] = true;
    }
    return EXIT_OK;
}
