// How long each stage of the road took: one is under way at any time.
#ifndef MECHKIT_EXPLAIN_STAGE_CLOCK_HPP
#define MECHKIT_EXPLAIN_STAGE_CLOCK_HPP

#include <chrono>
#include <cstring>

#include "mechkit/explain.h"

namespace mk
{

class StageClock
{
  public:
    explicit StageClock(mk_explanation &out_in) : out(out_in) {}
    // From here on time counts for this stage, again if it was under way before. `name` is static.
    void enter(const char *name)
    {
        stop();
        at = 0;
        while (at < out.stage_count && std::strcmp(out.stage[at].name, name) != 0)
            at++;
        if (at == MK_MAX_STAGES)
            at--; // the last one takes what has no place of its own
        else if (at == out.stage_count)
            out.stage[out.stage_count++] = {name, 0.0};
    }
    void stop()
    {
        const auto now = std::chrono::steady_clock::now();
        if (at >= 0)
            out.stage[at].seconds += std::chrono::duration<double>(now - since).count();
        since = now;
        at = -1;
    }

  private:
    mk_explanation &out;
    int at = -1; // stage under way; -1: none
    std::chrono::steady_clock::time_point since;
};

} // namespace mk
#endif
