// Chooses the fast kernel that fits the machine.
#include "sim/fast.hpp"

#include <cmath>

#include "sim/instruction_sets.hpp"

namespace mk
{

namespace isa_generic
{
extern const FastKernel kernel;
}
#ifdef MK_WIDE_KERNELS // set by the Makefile where they are built
namespace isa_avx2
{
extern const FastKernel kernel;
}
namespace isa_avx512
{
extern const FastKernel kernel;
}
#endif

const FastKernel *fast_kernel(int index)
{
    const FastKernel *usable[3] = {&isa_generic::kernel, nullptr, nullptr};
#ifdef MK_WIDE_KERNELS
    int count = 1;
    if (has_avx2())
        usable[count++] = &isa_avx2::kernel;
    if (has_avx512())
        usable[count++] = &isa_avx512::kernel;
#endif
    return index >= 0 && index < 3 ? usable[index] : nullptr;
}

} // namespace mk

static bool same_effects(const mk_model &a, const mk_model &b)
{
    for (int e = 0; e < a.effect_count; e++)
        if (a.effect[e].index != b.effect[e].index || a.effect[e].joint != b.effect[e].joint)
            return false;
    return true;
}

static enum mk_status check(const mk_batch *b, mk_error *err)
{
    if (b->model_count < 1 || b->samples < 0 || !(b->dt > 0.0) || !b->x0 || !b->x ||
        !(b->u || b->drive))
        return mk_error_set(err, MK_ERR_INVALID,
                            "a batch needs models, samples, a start and a drive");
    for (int i = 0; i < b->model_count; i++) {
        const mk_model *m = &b->model[i];
        if (!mk_model_is_smooth(m) || mk_model_command_delay(m) > 0.0)
            return mk_error_set(err, MK_ERR_NOTSUP,
                                "the fast path is for models without states, contact or delay");
        if (m->plant != b->model[0].plant || m->effect_count != b->model[0].effect_count)
            return mk_error_set(err, MK_ERR_INVALID, "the models of a batch must be of one kind");
        if (!same_effects(*m, b->model[0]))
            return mk_error_set(err, MK_ERR_INVALID,
                                "the models of a batch must have the same effects");
        enum mk_status st = mk_model_check(m, err);
        if (st != MK_OK)
            return st;
    }
    return MK_OK;
}

enum mk_status mk_simulate_batch(mk_batch *batch, mk_error *err)
{
    enum mk_status st = check(batch, err);
    if (st != MK_OK)
        return st;
    if (!(batch->rtol > 0.0))
        batch->rtol = 1e-8;
    if (!(batch->atol > 0.0))
        batch->atol = 1e-10;
    batch->steps = 0;
    const mk::FastKernel *best = mk::fast_kernel(0);
    for (int i = 1; mk::fast_kernel(i); i++)
        best = mk::fast_kernel(i);
    return best->run(batch, err);
}
