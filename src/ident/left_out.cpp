// Rows of logs that are not used: found, and marked in copies of the logs.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <new>
#include <vector>

#include "ident/left_out.hpp"

#include "ident/contact.hpp"
#include "ident/fit_log.hpp"
#include "mechkit/ident.h"

namespace mk
{

namespace
{

// What is kept of a log, as if the rest were not there.
struct Part {
    mk_record record = {};
    double start = 0.0, length = 0.0; // s from the log's first row; of the whole log
};

Part part_of(const mk_record &whole, const mk_row_choice &choice)
{
    const double *t = whole.t, *end = t + whole.rows;
    Part part;
    part.record = whole;
    if (whole.rows == 0)
        return part;
    part.length = end[-1] - t[0];
    const double last = choice.to_s > 0.0 ? t[0] + choice.to_s : HUGE_VAL;
    const size_t first_row = (size_t)(std::lower_bound(t, end, t[0] + choice.from_s) - t);
    const size_t last_row = (size_t)(std::upper_bound(t, end, last) - t);
    part.record.t += first_row;
    part.record.rows = last_row > first_row ? last_row - first_row : 0;
    const auto cut = [first_row](const double *&column) {
        if (column)
            column += first_row;
    };
    for (const double *&q : part.record.q)
        cut(q);
    for (const double *&u : part.record.u)
        cut(u);
    cut(part.record.late_us);
    cut(part.record.flags);
    cut(part.record.left_out);
    part.start = part.record.rows ? part.record.t[0] - t[0] : 0.0;
    return part;
}

class List
{
  public:
    List(const mk_log *const *given, mk_left_out *to, int *number)
        : logs(given), out(to), count(number)
    {
        *count = 0;
    }
    bool full() const { return lacks_room; }
    void add_unasked(size_t log, double from, double to, const Part &part)
    {
        if (mk_left_out *one = add(log, from, to, part))
            snprintf(one->why, sizeof one->why, "was not asked for");
    }
    void add_contact(const mk_model &model, const Contact &c, const Part &part)
    {
        const double end = part.record.t[part.record.rows - 1] - part.record.t[0];
        mk_left_out *one =
            add(c.log, part.start + c.from_s, part.start + std::min(c.to_s, end), part);
        if (!one)
            return;
        one->joint = c.joint;
        snprintf(one->why, sizeof one->why,
                 "a torque of up to %.3g %s acts on joint %d that is in no model, %.1f times "
                 "all that is missing elsewhere: somebody's hand, or a collision?",
                 c.torque, mk_model_unit(&model, c.joint - 1, "N m"), c.joint, c.times);
    }

  private:
    const mk_log *const *logs;
    mk_left_out *out;
    int *count;
    bool lacks_room = false;

    mk_left_out *add(size_t log, double from, double to, const Part &part)
    {
        lacks_room = lacks_room || *count == MK_MAX_LEFT_OUT;
        if (lacks_room)
            return nullptr;
        mk_left_out *one = &out[(*count)++];
        *one = {log, from, to, part.length, 0, "", ""};
        if (logs[log]->path)
            snprintf(one->file, sizeof one->file, "%s", logs[log]->path);
        return one;
    }
};

bool is_in(const mk_left_out &span, double t)
{
    return t >= span.from_s && t <= span.to_s;
}

enum mk_status copy_columns(const mk_log &log, mk_log &made)
{
    for (size_t c = 0; c < log.column_count; c++) {
        if (!log.columns[c].data || std::strcmp(log.columns[c].name, "left_out") == 0)
            continue;
        double *data = mk_log_add_column(&made, log.columns[c].name);
        if (!data)
            return MK_ERR_NOMEM;
        std::copy_n(log.columns[c].data, log.rows, data);
    }
    return MK_OK;
}

enum mk_status copy_meta(const mk_log &log, mk_log &made)
{
    for (size_t m = 0; m < log.meta_count; m++)
        if (log.meta[m].key[0] &&
            mk_log_set_meta(&made, log.meta[m].key, log.meta[m].value) == MK_ERR_NOMEM)
            return MK_ERR_NOMEM;
    return MK_OK;
}

// The column left_out: what the log has there, and 1 within the spans of this log.
enum mk_status mark_rows(const mk_log &log, size_t number, const mk_left_out *left_out, int count,
                         mk_log &made)
{
    const double *t = mk_log_get(&log, "t"), *before = mk_log_get(&log, "left_out");
    double *mark = mk_log_add_column(&made, "left_out");
    if (!t || !mark)
        return MK_ERR_NOMEM;
    for (size_t k = 0; k < log.rows; k++) {
        mark[k] = before ? before[k] : 0.0;
        for (int i = 0; i < count; i++)
            if (left_out[i].log == number && is_in(left_out[i], t[k] - t[0]))
                mark[k] = 1.0;
    }
    return MK_OK;
}

// Angles of marked rows are missing.
void hide_marked(mk_log &made)
{
    const double *mark = mk_log_get(&made, "left_out");
    for (size_t c = 0; c < made.column_count; c++) {
        const mk_log_column &column = made.columns[c];
        const bool angle = std::strcmp(column.name, mk_log_angle(0)) == 0 ||
                           std::strcmp(column.name, mk_log_angle(1)) == 0;
        for (size_t k = 0; angle && k < made.rows; k++)
            if (mark[k] != 0.0)
                column.data[k] = std::nan("");
    }
}

enum mk_status copy_without(const mk_log &log, size_t number, const mk_left_out *left_out,
                            int count, mk_log &made)
{
    enum mk_status st = copy_columns(log, made);
    if (st == MK_OK)
        st = mark_rows(log, number, left_out, count, made);
    if (st != MK_OK)
        return st;
    hide_marked(made);
    st = copy_meta(log, made);
    if (st != MK_OK)
        return st;
    made.path = log.path ? strdup(log.path) : nullptr;
    return MK_OK;
}

} // namespace

enum mk_status leave_out(const mk_model &model, const mk_row_choice &choice,
                         std::vector<const mk_log *> &logs, std::vector<OwnedLog> &made,
                         mk_left_out *out, int *count, mk_error *err)
{
    enum mk_status st =
        mk_find_left_out(&model, logs.data(), logs.size(), &choice, out, count, err);
    for (size_t i = 0; i < logs.size() && st == MK_OK; i++) {
        mk_log *copy = nullptr;
        st = mk_leave_out(logs[i], i, out, *count, &copy, err);
        if (!copy)
            continue;
        made.emplace_back(copy);
        logs[i] = copy;
    }
    return st;
}

} // namespace mk

enum mk_status mk_find_left_out(const mk_model *model, const mk_log *const *logs, size_t log_count,
                                const mk_row_choice *choice, mk_left_out *out, int *count,
                                mk_error *err)
try {
    const mk_row_choice all = {};
    const mk_row_choice &asked = choice ? *choice : all;
    mk::List list(logs, out, count);
    std::vector<mk::Part> parts;
    std::vector<mk_record> records;
    for (size_t i = 0; i < log_count; i++) {
        mk_record record;
        enum mk_status st = mk_record_from_log(logs[i], model, &record, err);
        if (st != MK_OK)
            return st;
        parts.push_back(mk::part_of(record, asked));
        records.push_back(parts.back().record);
        if (record.rows > 0 && records.back().rows == 0)
            return mk_error_at(err, MK_ERR_RANGE, logs[i]->path, 0, 0,
                               "no row of this log was asked for: it is %.4g s long",
                               parts.back().length);
        constexpr double INSTANT = 1e-9; // s: rows on the limit are kept
        if (asked.from_s > 0.0)
            list.add_unasked(i, 0.0, asked.from_s - INSTANT, parts[i]);
        if (asked.to_s > 0.0 && asked.to_s < parts[i].length)
            list.add_unasked(i, asked.to_s + INSTANT, parts[i].length, parts[i]);
    }
    if (!asked.keep_all)
        for (const mk::Contact &c : mk::find_contacts(*model, records))
            list.add_contact(*model, c, parts[c.log]);
    if (list.full())
        return mk_error_set(err, MK_ERR_RANGE,
                            "more than %d stretches of these logs would be left out: give fewer "
                            "logs, or without the rows that are not to be used",
                            MK_MAX_LEFT_OUT);
    return MK_OK;
} catch (const std::bad_alloc &) {
    return mk_error_set(err, MK_ERR_NOMEM, "no memory to look for what is to be left out");
}

enum mk_status mk_leave_out(const mk_log *log, size_t number, const mk_left_out *left_out,
                            int count, mk_log **out, mk_error *err)
{
    *out = nullptr;
    if (std::none_of(left_out, left_out + count,
                     [&](const mk_left_out &one) { return one.log == number; }))
        return MK_OK;
    mk_log *made = nullptr;
    enum mk_status st = mk_log_create(log->rows, &made);
    if (st == MK_OK)
        st = mk::copy_without(*log, number, left_out, count, *made);
    if (st != MK_OK) {
        mk_log_free(made);
        return mk_error_set(err, st, "no memory for a log without what is left out");
    }
    *out = made;
    return MK_OK;
}
