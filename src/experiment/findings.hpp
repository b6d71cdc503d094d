// The list of findings while it is made, and the checks that fill it.
#ifndef MECHKIT_EXPERIMENT_FINDINGS_HPP
#define MECHKIT_EXPERIMENT_FINDINGS_HPP

#include <string>

#include "mechkit/data_check.h"
#include "mechkit/sim.h"

namespace mk
{

// A log that is looked at.
struct CheckedLog {
    const mk_log &log;
    const mk_model &model;
    const mk_record &record;
};

class Findings
{
  public:
    Findings(mk_data_check &check_in, const mk_log &log_in) : check(check_in), log(log_in) {}
    void doubt(const std::string &what, const std::string &remedy, int line = 0)
    {
        add(MK_DATA_DOUBT, what, remedy, line);
    }
    void fatal(const std::string &what, const std::string &remedy, int line = 0)
    {
        add(MK_DATA_FATAL, what, remedy, line);
    }
    // Those of another list behind those that are there.
    static void append(mk_data_check &check, const mk_data_check &more);

  private:
    mk_data_check &check;
    const mk_log &log;

    void add(enum mk_data_severity severity, const std::string &what, const std::string &remedy,
             int line);
};

// printf into a string of at most 400 bytes.
__attribute__((format(printf, 1, 2))) std::string text(const char *format, ...);

// Angles that are wrapped, in degrees or in raw counts; what is missing or thinned; metadata that
// contradict the model or the rows.
void check_columns(const CheckedLog &log, Findings &out);
void check_metadata(const CheckedLog &log, Findings &out);
// Commands and angles beyond what the model, or any rig, has.
void check_extremes(const CheckedLog &log, Findings &out);
// Signs, units and places of columns, by the textbook and by what the model predicts.
void check_mapping(const CheckedLog &log, Findings &out);

} // namespace mk
#endif
