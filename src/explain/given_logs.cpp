#include "explain/given_logs.hpp"

#include "ident/scale.hpp"

namespace mk
{

enum mk_status check_data(const mk_model &model, const LogSpan &logs, const LogSpan &holdouts,
                          const mk_explain_options &options, mk_data_check &check, mk_error *err)
{
    enum mk_status st = MK_OK;
    if (options.data_check)
        check = *options.data_check;
    else
        st = mk_data_check_logs(&model, logs.logs, logs.count, MK_DATA_EXPLAIN, options.threads,
                                &check, err);
    if (st == MK_OK && !options.data_check)
        st = mk_data_check_logs(&model, holdouts.logs, holdouts.count, MK_DATA_HOLD_OUT,
                                options.threads, &check, err);
    const mk_data_finding *fatal = mk_data_check_fatal(&check);
    if (st == MK_OK && fatal && !options.force)
        return mk_error_at(err, MK_ERR_EXPECT, fatal->file, fatal->line, 0, "%s; %s", fatal->what,
                           fatal->remedy);
    return st;
}

LogList used_logs(const mk_model &model, const LogSpan &given, enum mk_data_use use)
{
    LogList used;
    for (size_t i = 0; i < given.count; i++)
        if (mk_data_check_uses(&model, given.logs[i], use))
            used.push_back(given.logs[i]);
    return used;
}

bool nothing_drives(const mk_model &model, const LogList &logs)
{
    std::vector<mk_record> records(logs.size());
    for (size_t i = 0; i < logs.size(); i++)
        if (mk_record_from_log(logs[i], &model, &records[i], nullptr) != MK_OK)
            return model.no_motor;
    return scale_is_free(model, records);
}

} // namespace mk
