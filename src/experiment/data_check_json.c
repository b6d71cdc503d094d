#include "experiment/data_check_json.h"

cJSON *data_check_json(const struct mk_data_check *check)
{
    cJSON *list = cJSON_CreateArray();
    for (int i = 0; i < check->count; i++) {
        const struct mk_data_finding *f = &check->finding[i];
        cJSON *one = cJSON_CreateObject();
        cJSON_AddStringToObject(one, "file", f->file);
        cJSON_AddItemToObject(one, "line",
                              f->line > 0 ? cJSON_CreateNumber(f->line) : cJSON_CreateNull());
        cJSON_AddStringToObject(one, "severity", mk_data_severity_name(f->severity));
        cJSON_AddStringToObject(one, "what", f->what);
        cJSON_AddStringToObject(one, "do", f->remedy);
        cJSON_AddItemToArray(list, one);
    }
    return list;
}
