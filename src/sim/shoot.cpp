// Chooses the shooting kernel for the machine, for how many stretches go side by side and for the
// number of derivatives.
#include "sim/shoot.hpp"
#include "sim/instruction_sets.hpp"

namespace mk
{

#define MK_DECLARE_KERNEL(isa, width, derivatives)                                                 \
    namespace isa_##isa##_##width##_##derivatives                                                  \
    {                                                                                              \
        extern const ShootKernel shoot_kernel;                                                     \
    }
// As built by the Makefile: alone and side by side, without and with derivatives.
#define MK_DECLARE_KERNELS(isa, width)                                                             \
    MK_DECLARE_KERNEL(isa, 1, 0)                                                                   \
    MK_DECLARE_KERNEL(isa, 1, 1)                                                                   \
    MK_DECLARE_KERNEL(isa, width, 0)                                                               \
    MK_DECLARE_KERNEL(isa, width, 1)
MK_DECLARE_KERNELS(generic, 2)
#ifdef MK_WIDE_KERNELS // set by the Makefile where they are built
MK_DECLARE_KERNELS(avx2, 4)
MK_DECLARE_KERNELS(avx512, 8)
#endif

namespace
{

struct Family {
    const ShootKernel *alone[2], *beside[2]; // without, with derivatives
};
#define MK_KERNEL(isa, width, derivatives) &isa_##isa##_##width##_##derivatives::shoot_kernel
#define MK_FAMILY(isa, width)                                                                      \
    {                                                                                              \
        {MK_KERNEL(isa, 1, 0), MK_KERNEL(isa, 1, 1)},                                              \
        {                                                                                          \
            MK_KERNEL(isa, width, 0), MK_KERNEL(isa, width, 1)                                     \
        }                                                                                          \
    }

const Family &family()
{
    static const Family generic = MK_FAMILY(generic, 2);
#ifdef MK_WIDE_KERNELS
    static const Family avx2 = MK_FAMILY(avx2, 4), avx512 = MK_FAMILY(avx512, 8);
    if (has_avx512())
        return avx512;
    if (has_avx2())
        return avx2;
#endif
    return generic;
}

} // namespace

void shoot(ShootTask *tasks, int count)
{
    if (count < 1)
        return;
    const bool derivatives = tasks->columns > 0;
    // Lanes that stay empty cost as much as full ones; all of eight as much as two alone, with
    // derivatives, or three without.
    const Family &f = family();
    const bool crowd = 3 * count >= (derivatives ? 6 : f.beside[0]->width);
    const ShootKernel *const *kernels = crowd ? f.beside : f.alone;
    int done = 0;
    do
        done += kernels[derivatives]->run(tasks, count, done);
    while (derivatives && done < tasks->free_count);
}

void gram(const GramTask &task, double *out)
{
    family().beside[1]->gram(task, out);
}

} // namespace mk
