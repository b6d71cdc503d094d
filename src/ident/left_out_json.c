#include "ident/left_out_json.h"

cJSON *left_out_json(const struct mk_left_out *all, int count)
{
    cJSON *list = cJSON_CreateArray();
    for (int i = 0; i < count; i++) {
        cJSON *one = cJSON_CreateObject();
        cJSON_AddStringToObject(one, "file", all[i].file);
        cJSON_AddItemToObject(one, "from_s", mk_json_number(all[i].from_s));
        cJSON_AddItemToObject(one, "to_s", mk_json_number(all[i].to_s));
        if (all[i].joint > 0)
            cJSON_AddItemToObject(one, "joint", cJSON_CreateNumber(all[i].joint));
        cJSON_AddStringToObject(one, "why", all[i].why);
        cJSON_AddItemToArray(list, one);
    }
    return list;
}
